"""Motion laws of a car-like base: circular arcs and clothoids, as planned and as executed.

An arc has a constant curvature, a clothoid (Euler spiral) one that changes evenly along its length. Straight moves are
arcs of curvature 0. The two poses at its ends determine either curve, so that motions need no further states:

- An arc that turns by Δ has its chord in the direction of the mean heading. Its length is chord (Δ/2)/sin(Δ/2).
- A clothoid has the heading θ(u) = θ(0) + A u² + (Δ - A) u after the share u of its length. A is the root of
  ∫ sin(θ(u) - φ) du = 0, where φ is the direction of the chord (Bertolazzi and Frego 2015, doi 10.1002/mma.3114).

A motion goes backwards if its chord points against the mean heading. Its length is then negative.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import hypot
from hpop.models.driven import gauss
from hpop.models.laws import with_waits
from hpop.models.ramps import WAY, Limits, Ramp
from hpop.motions import LawDefaults, Phase, States
from hpop.motions.laws import PACE

FEW, MANY = gauss(6), gauss(10)  # nodes of quadrature
GENTLE = (
    0.7  # rad: up to this sum of rotation and bend the few nodes suffice; both errors are below 1e-13 of the length
)
MOST_TURN = np.pi + 1e-6  # rad: largest rotation of one motion
NEWTON_STEPS = 20
CONVERGED = 1e-14
FLAT = 1e-4  # rad: below it, sin(x)/x is a Taylor polynomial
STRAIGHTENED = 1e-6  # 1/m: smaller curvatures end a turn
STEERED = 1e-9  # 1/m: smaller curvatures are straight


class CurveShape(NamedTuple):
    """Length and headings of M curves: after the share u, the yaw is yaw(0) + bend u² + (turn - bend) u.

    length  (M,)  m, negative for motions backwards
    turn    (M,)  rad, rotation
    bend    (M,)  rad, 0 for arcs
    stray   (M,)  m, signed distance by which the given end is to the left of the end of the curve, across the mean
                  heading; for clothoids 0, or inf if none was found
    """

    length: Column
    turn: Column
    bend: Column
    stray: Column

    def curvature(self, share: Column) -> Column:
        """Return the signed curvature (M,), 1/m, after a share of the length; 0 for a motion of length 0."""
        moves = np.abs(self.length) > 0
        slope = 2.0 * self.bend * share + self.turn - self.bend
        return np.where(moves, slope / np.where(moves, self.length, 1.0), 0.0)

    @property
    def sharpness(self) -> Column:
        """Change (M,) of the curvature per metre of signed length, 1/m²; 0 for a motion of length 0."""
        moves = np.abs(self.length) > 0
        return np.where(moves, 2.0 * self.bend / np.where(moves, self.length, 1.0) ** 2, 0.0)


def sinc(x: Column) -> Column:
    """Return sin(x)/x, and 1 at 0."""
    flat = np.abs(x) < FLAT
    safe = np.where(flat, 1.0, x)
    return np.where(flat, 1.0 - x * x / 6.0, np.sin(safe) / safe)


def arc_shape(start: States, end: States) -> CurveShape:
    """Return the shape of the arcs between states (M,)."""
    turn = end.yaw - start.yaw
    middle, dx, dy = start.yaw + 0.5 * turn, end.x - start.x, end.y - start.y
    ahead, left = np.cos(middle), np.sin(middle)
    return CurveShape((dx * ahead + dy * left) / sinc(0.5 * turn), turn, 0.0 * turn, dy * ahead - dx * left)


@lru_cache(maxsize=8)  # a rate reads x, y and yaw at the same ends, one after the other, on each core
def clothoid_shape(start: States, end: States) -> CurveShape:
    """Return the shape of the clothoids between states (M,); the stray is inf where Newton's method does not end."""
    turn = np.asarray(end.yaw - start.yaw)
    dx, dy, middle = end.x - start.x, end.y - start.y, start.yaw + 0.5 * turn
    sense = np.where(dx * np.cos(middle) + dy * np.sin(middle) >= 0, 1.0, -1.0)
    chord = hypot(dx, dy)
    moves = np.asarray(chord > 0)
    first = np.where(moves, start.yaw - np.arctan2(sense * dy, sense * dx), 0.0)
    first = np.where(moves, np.angle(np.exp(1j * first)), -0.5 * turn)
    bend = 3.0 * (2.0 * first + turn)
    nodes = _nodes(turn, bend)
    for _ in range(NEWTON_STEPS):
        error, slope, along = (np.zeros(np.shape(turn)) for _ in range(3))
        for node, weight in nodes:
            heading = first + node * (turn - bend * (1.0 - node))
            sine, cosine = weight * np.sin(heading), weight * np.cos(heading)
            error, slope, along = error + sine, slope - node * (1.0 - node) * cosine, along + cosine
        step = np.divide(error, slope, out=np.zeros(np.shape(turn)), where=np.abs(slope) > CONVERGED)
        bend = bend - step
        if np.abs(step).max(initial=0.0) < CONVERGED * 10:
            break
    length = sense * np.divide(chord, along, out=np.zeros(np.shape(turn)), where=along > CONVERGED)
    found = (np.abs(error) < 1e-9) & (along > CONVERGED) | ~moves
    return CurveShape(np.where(found, length, 0.0), turn, bend, np.where(found, 0.0, np.inf))


def _nodes(turn: Column, bend: Column) -> tuple[tuple[float, float], ...]:
    """Return nodes and weights of a quadrature that is exact to rounding for clothoids with these headings."""
    return FEW if (np.abs(turn) + np.abs(bend)).max(initial=0.0) < GENTLE else MANY


class SteeredGeometry(LawDefaults):
    """Geometry of motions along curves that their end poses determine; a base class."""

    varies = frozenset({"x", "y", "yaw"})
    even = frozenset({"yaw"})

    def shape(self, start: States, end: States) -> CurveShape:
        """Return the shape of the curves between states (M,)."""
        raise NotImplementedError

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return x, y or yaw after a share (0 to 1) of the length."""
        length, turn, bend, stray = self.shape(start, end)
        if name == "yaw":
            return start.yaw + share * (turn - bend * (1.0 - share))
        along = self._displacement(name, start.yaw, share, (length, turn, bend))
        aside = np.cos if name == "y" else lambda angle: -np.sin(angle)
        return getattr(start, name) + along + share * self._kept(stray) * aside(start.yaw + 0.5 * turn)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of x, y or yaw by the share of the length."""
        length, turn, bend, stray = self.shape(start, end)
        turning = turn - bend * (1.0 - 2.0 * share)
        if name == "yaw":
            return turning, 2.0 * bend + 0.0 * share
        yaw, middle, off = self.interpolate("yaw", start, end, share), start.yaw + 0.5 * turn, self._kept(stray)
        cos, sin = np.cos(yaw), np.sin(yaw)
        if name == "x":
            return length * cos - off * np.sin(middle), -length * turning * sin
        return length * sin + off * np.cos(middle), length * turning * cos

    def travel(self, start: States, end: States, lever: Column) -> Column:
        """Return an upper bound (M,), m, on the path length of a point ``lever`` metres from the axis."""
        return np.abs(self.shape(start, end).length) + lever * self.swept(start, end)

    def turned(self, start: States, end: States) -> Column:
        """Return the signed rotation (M,), rad."""
        return end.yaw - start.yaw

    def swept(self, start: States, end: States) -> Column:
        """Return the absolute rotation (M,), rad."""
        first, second = self.bends(start, end)
        return np.abs(first) + np.abs(second)

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return the signed rotations (M,), rad, before and after the curvature changes sign.

        Without such a change, they are the whole rotation and 0.
        """
        _, turn, bend, _ = self.shape(start, end)
        begin, stop = turn - bend, turn + bend
        changes = begin * stop < 0
        at = np.where(changes, begin / np.where(changes, begin - stop, 1.0), 0.0)
        first = np.where(changes, 0.5 * begin * at, turn)
        return first, np.where(changes, 0.5 * stop * (1.0 - at), 0.0)

    def strays(self, start: States, end: States) -> Column:
        """Return the distance (M,), m, of the given ends from the curve; inf for more than half a turn."""
        shape = self.shape(start, end)
        return np.where(np.abs(shape.turn) <= MOST_TURN, np.abs(shape.stray), np.inf)

    def pieces(self, start: States, end: States, reach: float, bulge: float) -> Column:
        """Return the number (M,) of equal shares into which curves must be cut for collision tests.

        No point within ``reach``, m, of the axis then leaves the chord of its path by more than ``bulge``, m.
        """
        length, turn, bend, _ = self.shape(start, end)
        turning = np.abs(turn) + np.abs(bend)
        most = np.abs(length) * turning + reach * (2.0 * np.abs(bend) + turning * turning)
        return np.ceil(np.sqrt(most / (8.0 * bulge)))

    def _displacement(self, name: str, yaw: Column, share: Column, shape: tuple[Column, Column, Column]) -> Column:
        """Return how far (M,), m, the base gets along the axis ``name`` in a share of the length."""
        raise NotImplementedError

    @staticmethod
    def _kept(stray: Column) -> Column:
        return np.where(np.isfinite(stray), stray, 0.0)


class ArcGeometry(SteeredGeometry):
    """Geometry of circular arcs and straight lines, in closed form."""

    def shape(self, start: States, end: States) -> CurveShape:
        return arc_shape(start, end)

    def _displacement(self, name: str, yaw: Column, share: Column, shape: tuple[Column, Column, Column]) -> Column:
        length, turn, _ = shape
        half = 0.5 * share * turn
        return length * share * sinc(half) * (np.cos if name == "x" else np.sin)(yaw + half)


class ClothoidGeometry(SteeredGeometry):
    """Geometry of clothoids; the Fresnel integrals are computed by Gauss-Legendre quadrature with six or ten nodes."""

    def shape(self, start: States, end: States) -> CurveShape:
        return clothoid_shape(start, end)

    def ends_turn(self, start: States, end: States) -> BoolArray:
        """Return a mask (M,): True where the curvature is 0 at the end, so that the next motion begins another turn."""
        return np.asarray(np.abs(self.shape(start, end).curvature(1.0)) < STRAIGHTENED)

    def _displacement(self, name: str, yaw: Column, share: Column, shape: tuple[Column, Column, Column]) -> Column:
        length, turn, bend = shape
        projection, total = np.cos if name == "x" else np.sin, 0.0 * share
        for node, weight in _nodes(turn, bend):
            at = node * share
            total = total + weight * projection(yaw + at * (turn - bend * (1.0 - at)))
        return length * share * total


class Cruise(SteeredGeometry):
    """Base class of planned laws: motions go at cruise speed from end to end, as if speeding up took no time."""

    speed: float
    reverse_speed: float

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the length grows evenly with time."""
        length = self.shape(start, end).length
        duration = np.where(length >= 0, length / self.speed, -length / (self.reverse_speed or self.speed))
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)


@dataclass(frozen=True)
class CircularArc(Cruise, ArcGeometry):
    """Planned law of arcs and straight moves.

    speed, reverse_speed  m/s, cruise speeds forwards and backwards
    wheelbase             m
    steering_rate         rad/s; None if the wheels take any angle at once: then there are no waits
    loss                  s, time that the base loses by stopping and starting again

    The car steers while it stands: an arc begins and ends with wheels straight ahead, and with a wait for steering and
    half the loss. Straight moves have no waits. Where two arcs meet, the planned waits are at least as long as needed.
    """

    speed: float
    reverse_speed: float
    wheelbase: float
    steering_rate: float | None
    loss: float
    kind: str = "arc"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        cruise = super().phases(start, end)
        if self.steering_rate is None:
            return cruise
        curvature = np.abs(self.shape(start, end).curvature(0.5))
        waits = np.where(
            curvature > STEERED, self.loss + 2.0 * np.arctan(self.wheelbase * curvature) / self.steering_rate, 0.0
        )
        return with_waits(cruise, waits)

    def ends_turn(self, start: States, end: States) -> BoolArray:
        """Return True (M,): each arc is a turn of its own, since it ends with wheels straight ahead."""
        return np.ones(start.size, dtype=np.bool_)


@dataclass(frozen=True)
class Clothoid(Cruise, ClothoidGeometry):
    """Planned law of clothoids, on which the car steers while it drives."""

    speed: float
    reverse_speed: float
    kind: str = "clothoid"


class SteeredRamp(Ramp, SteeredGeometry):
    """Executed timing: constant acceleration along the curve, from the pace of the start to that of the end.

    The pace is the speed as a share of the cruise speed forwards, ``speed``.
    """

    even = frozenset[str]()
    varies = frozenset({"x", "y", "yaw", PACE})
    speed: float
    acceleration: float

    @property
    def limits(self) -> Limits:
        """Largest speed and acceleration along the curve."""
        return {WAY: (self.speed, self.acceleration)}

    def changes(self, start: States, end: States) -> dict[str, Column]:
        """Return the length (M,), m, of each motion, as the only entry of a dict."""
        return {WAY: self.travel(start, end, 0.0)}

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return x, y, yaw or the pace after a share (0 to 1) of the length."""
        return (Ramp if name == PACE else SteeredGeometry).interpolate(self, name, start, end, share)

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of x, y, yaw or the pace by the share of the length."""
        return (Ramp if name == PACE else SteeredGeometry).slopes(self, name, start, end, share)

    def strays(self, start: States, end: States) -> Column:
        """Return the distance (M,), m, of the given ends from the curve; inf for impossible paces."""
        return np.maximum(Ramp.strays(self, start, end), SteeredGeometry.strays(self, start, end))


@dataclass(frozen=True)
class ArcRamp(SteeredRamp, ArcGeometry):
    """Executed law of arcs and straight moves."""

    speed: float
    acceleration: float
    kind: str = "arc_ramp"


@dataclass(frozen=True)
class ClothoidRamp(SteeredRamp, ClothoidGeometry):
    """Executed law of clothoids."""

    speed: float
    acceleration: float
    kind: str = "clothoid_ramp"


def rest_to_rest_ends(length: float, speed: float, acceleration: float) -> FloatArray:
    """Return the start and the ends of phases of a run from rest to rest, as rows of distance, m, and speed, m/s."""
    ramp = min(0.5 * speed * speed / acceleration, 0.5 * length)
    top = float(np.sqrt(2.0 * acceleration * ramp))
    rows = [(0.0, 0.0), (ramp, top), (length - ramp, top), (length, 0.0)]
    return np.array(rows if length - 2.0 * ramp > FLAT else [rows[0], rows[1], rows[3]])
