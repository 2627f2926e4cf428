"""Robot model "differential_drive": a base with two driven wheels that carries a camera on a mast.

Also here: the check of a trajectory for motions that this robot cannot execute.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import LEAST, MOST, real, set_reals, truth
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import PlanarModel, model, plane_space
from hpop.models.collision import Part, convex_parts, notes_on_seat
from hpop.models.driven import Drive
from hpop.models.laws import Move, Run, Spin, Turn
from hpop.models.rigid import FieldOfView, Mount, Position, checked_field_of_view, checked_seat
from hpop.models.speeds import checked_speeds, doubtful_speeds, speed_faults, speed_laws
from hpop.motions import Law, States, StateSpace, is_curve, laws_of
from hpop.trajectories.trajectory import Trajectory

CLOSE = 1e-5  # m or rad: tolerance for states that were rounded to decimals
STEPS = 100  # samples of a curve
FASTER = 1e-3  # share of its limits by which a wheel may exceed them
MAST_RADIUS = 0.05  # m, default
BODY_HEIGHT = 0.4  # m, default
LONGEST = 20.0  # m: larger robots must be a mistake in the unit
SLOWEST = 1e-3  # m/s, m/s², rad/s, rad/s²: smallest speed or acceleration that an option of a robot may have


def doubtful(law: Law, start: States, end: States, *, reverses: bool = False) -> BoolArray:
    """Return a mask (M,) of motions of one law that go sideways or, unless the robot ``reverses``, backwards.

    All curves are in the mask, because only the slower check :func:`faults` can judge them.
    """
    if is_curve(law):
        return np.ones(start.size, dtype=bool)
    if not {"x", "y"} <= law.varies:
        return np.zeros(start.size, dtype=bool)
    dx, dy, ahead, left = end.x - start.x, end.y - start.y, np.cos(start.yaw), np.sin(start.yaw)
    astray: BoolArray = np.abs(dy * ahead - dx * left) > CLOSE
    return astray if reverses else astray | (dx * ahead + dy * left < -CLOSE)


def faults(model: DifferentialDrive, trajectory: Trajectory) -> Iterator[str]:
    """Yield a text for each kind of fault, naming the first motion that wheels cannot execute because of it.

    Faults are motions sideways or, unless the model ``reverses``, backwards, and curves on which a wheel exceeds its
    speed or acceleration.
    """
    states, wrong = trajectory.states, np.zeros(len(trajectory), dtype=bool)
    kinds = np.array(trajectory.kinds, dtype=object)
    curved = np.zeros(len(trajectory), dtype=bool)
    for kind in dict.fromkeys(trajectory.kinds):
        of_law, law = np.flatnonzero(kinds == kind), laws_of(trajectory.model)[kind]
        if is_curve(law):
            curved[of_law] = True
        else:
            wrong[of_law] = doubtful(law, states.take(of_law), states.take(of_law + 1), reverses=model.reverses)
    if wrong.any():
        first = int(np.argmax(wrong))
        yield f"goes sideways or backwards in motion {first}, a {trajectory.kinds[first]}"
    yield from _curve_faults(model, trajectory, np.flatnonzero(curved))


def _curve_faults(model: DifferentialDrive, trajectory: Trajectory, curved: IntArray) -> Iterator[str]:
    """Yield a text for each kind of fault of the motions ``curved``, naming the first such motion.

    Faults are going sideways or backwards, and wheels beyond their largest speed or acceleration. Each curve is cut
    into a hundred intervals; speeds and accelerations are finite differences of the poses.
    """
    lasts = trajectory.durations[curved]
    times = trajectory.times[curved][:, None] + lasts[:, None] * np.linspace(0.0, 1.0, STEPS + 1)  # (c, STEPS + 1)
    s = trajectory.at(times.ravel())
    x, y, yaw = (np.reshape(column, times.shape) for column in (s.x, s.y, s.yaw))
    dx, dy, turned, heading = np.diff(x), np.diff(y), np.diff(yaw), 0.5 * (yaw[:, 1:] + yaw[:, :-1])
    ahead, side = dx * np.cos(heading) + dy * np.sin(heading), dy * np.cos(heading) - dx * np.sin(heading)
    wheels = np.stack([ahead + sign * 0.5 * model.wheel_base * turned for sign in (-1.0, 1.0)])  # (2, c, STEPS), m
    fastest = np.abs(wheels).max(axis=(0, 2), initial=0.0) * STEPS
    hardest = np.abs(np.diff(wheels)).max(axis=(0, 2), initial=0.0) * STEPS**2
    for wrong, fault in (
        ((np.abs(side) > CLOSE).any(axis=1) | (ahead < -CLOSE).any(axis=1), "goes sideways or backwards"),
        (fastest > model.wheel_speed * lasts * (1 + FASTER) + CLOSE, "drives faster than its wheels can turn"),
        (
            hardest > model.wheel_acceleration * lasts**2 * (1 + FASTER) + CLOSE,
            "speeds up or turns harder than its wheels can",
        ),
    ):
        if wrong.any():
            i = curved[np.argmax(wrong)]
            yield f"{fault} in motion {i}, a {trajectory.kinds[i]}"


class WheelTrack(NamedTuple):
    """Speeds, m/s, and accelerations, m/s², of both wheels at sample times, s; each field is a column (N,)."""

    times: FloatArray
    left_speed: FloatArray
    right_speed: FloatArray
    left_acceleration: FloatArray
    right_acceleration: FloatArray


class OnBase:
    """Mixin for a robot carried by a ``base`` with wheels: its properties of wheels are those of the base."""

    base: Any

    @property
    def wheel_base(self) -> float:
        """Distance between the wheels of the base, m."""
        return float(self.base.wheel_base)

    @property
    def wheel_speed(self) -> float:
        """Largest speed of a wheel, m/s."""
        return float(self.base.wheel_speed)

    @property
    def wheel_acceleration(self) -> float:
        """Largest acceleration of a wheel, m/s²."""
        return float(self.base.wheel_acceleration)

    def wheels(self, trajectory: Trajectory, times: FloatArray) -> WheelTrack:
        """Return speeds and accelerations of the base's wheels along a trajectory, at ``times`` (N,), s."""
        found: WheelTrack = self.base.wheels(trajectory, times)
        return found


@model("differential_drive")
@dataclass(frozen=True)
class DifferentialDrive(PlanarModel):
    """Base with two driven wheels and a camera on a mast, a 360-degree one by default; states x, y (m) and yaw (rad).

    radius             m       of a round footprint
    footprint          m       corners ((x, y), ...) of a polygon that contains the axis, x ahead, instead of a round
                               footprint; ``radius`` is then ignored
    body_height        m       top of the body above the floor; its outline is the footprint
    camera_height      m       of the camera above the floor; its mast reaches up to it
    camera_offset      m       of the camera from the axis, (ahead, left)
    mast_radius        m       radius of the camera's mast
    speed              m/s     cruise speed of straight moves; the largest one if there are several
    speeds             m/s     one speed, or a list of rising speeds: a plan may then choose among them at each position
                               (:mod:`hpop.models.speeds`); None for the one ``speed``
    acceleration       m/s²    of straight moves
    turn_rate          rad/s   of turns in place
    turn_rates         rad/s   one rate, or a list of rising rates of turns in place, among which a plan chooses at each
                               turn; ``turn_rate`` is then the largest. None for the one ``turn_rate``
    turn_acceleration  rad/s²  of turns in place
    wheel_base         m       distance between the wheels
    field_of_view      rad     angles of view (h, v): bearings within h/2 of the camera's yaw, elevations within
                               v/2 of its pitch; None for all round
    seat               m       position (ahead, left, height) of a passenger's seat, for the criteria of felt motion, as
                               on a wheelchair; None for no seat. The passenger must fit in the footprint and under
                               ``body_height``
    reverses                   whether it may drive backwards where people who touch it leave no other way; plans do not
                               reverse otherwise

    Motions follow the planned laws of :mod:`hpop.models.laws`. The default speed of 1 m/s is the one that users prefer.
    Turns are fast by default, because a faster turn by a given angle shortens the sensory conflict (Widdowson et al.
    2019).
    """

    radius: float = 0.3
    footprint: tuple[tuple[float, float], ...] | None = None
    body_height: float = BODY_HEIGHT
    camera_height: float = 1.2
    camera_offset: tuple[float, float] = (0.0, 0.0)
    mast_radius: float = MAST_RADIUS
    speed: float = 1.0
    acceleration: float = 1.0
    turn_rate: float = 1.5
    turn_acceleration: float = 3.0
    wheel_base: float = 0.4
    field_of_view: FieldOfView | None = None
    speeds: float | tuple[float, ...] | None = None
    turn_rates: float | tuple[float, ...] | None = None
    seat: Position | None = None
    reverses: bool = False

    def __post_init__(self) -> None:
        for one, several, unit in (("speed", "speeds", "m/s"), ("turn_rate", "turn_rates", "rad/s")):
            if getattr(self, several) is None:
                continue
            speeds, own = checked_speeds(getattr(self, several), SLOWEST, several, unit), getattr(self, one)
            if own not in (getattr(type(self), one), speeds[-1]):
                raise ModelError(f"{one} is the largest of {several}, {speeds[-1]:g}, got {shown(own)}; leave it out")
            object.__setattr__(self, one, speeds[-1])
            object.__setattr__(self, several, speeds if len(speeds) > 1 else None)
        lengths = ("radius", "body_height", "camera_height", "mast_radius", "wheel_base")
        rates = ("speed", "acceleration", "turn_rate", "turn_acceleration")
        set_reals(self, *lengths, least=LEAST, most=LONGEST, kind="a positive length in m", error=ModelError)
        set_reals(self, *rates, least=SLOWEST, most=MOST, kind="a positive number", error=ModelError)
        for name in (*lengths, *rates):
            object.__setattr__(self, name, float(getattr(self, name)))
        object.__setattr__(self, "field_of_view", checked_field_of_view(self.field_of_view))
        object.__setattr__(self, "camera_offset", checked_offset(self.camera_offset))
        object.__setattr__(self, "seat", checked_seat(self.seat))
        truth("reverses", self.reverses, error=ModelError)
        if self.footprint is not None:
            object.__setattr__(self, "footprint", checked_footprint(self.footprint))

    @property
    def provides(self) -> frozenset[str]:
        """Capabilities: those of every planar model, and "heading" and "wheels"."""
        return super().provides | {"heading", "wheels"}

    @cached_property
    def space(self) -> StateSpace:
        """State space of x, y and yaw; in distances a radian counts as the distance driven in the time of its turn."""
        return plane_space(self.speed / self.turn_rate)

    @property
    def speed_classes(self) -> tuple[float, ...]:  # type: ignore[override]  # of its parameters
        """Speeds, m/s, among which straight moves choose; () for one speed and one turn rate."""
        return self.speeds if isinstance(self.speeds, tuple) else (self.speed,) * bool(self.turn_rates)

    @property
    def _turns(self) -> dict[str, float]:
        """Rate, rad/s, of each law of turns by the ending of its name, from slow to fast; "" is the fastest."""
        *slower, fastest = self.turn_rates if isinstance(self.turn_rates, tuple) else (self.turn_rate,)
        return {**{f"_{rate:g}": rate for rate in slower}, "": fastest}

    @property
    def paces(self) -> tuple[Mapping[str, str], ...]:
        """Kinds of turns among which a plan chooses, as mappings {"turn": kind}, from slow to fast; () for one."""
        return tuple({"turn": f"turn{rate}"} for rate in self._turns) if self.turn_rates else ()

    @property
    def executed(self) -> Mapping[str, str]:  # type: ignore[override]  # depends on the turn rates
        """The kind of law by which the robot executes motions of each planned kind."""
        return {"move": "run", **{f"turn{rate}": f"spin{rate}" for rate in self._turns}}

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Motion laws by kind: planned ("move", "turn"), executed ("run", "spin"), and for curves ("drive").

        A robot with several speeds also has the law "speed_change", one with several turn rates also turns at slower
        rates, such as "turn_0.5" and "spin_0.5".
        """
        loss, change = 0.0 if self.speed_classes else self.speed / self.acceleration, self.turn_acceleration
        turns = {f"turn{name}": Turn(rate, change, loss, f"turn{name}") for name, rate in self._turns.items()}
        spins = {f"spin{name}": Spin(rate, change, f"spin{name}") for name, rate in self._turns.items()}
        return {
            "move": Move(self.speed),
            **turns,
            "run": Run(self.speed, self.acceleration),
            **spins,
            "drive": Drive(),
            **(speed_laws(self.speed_classes, self.acceleration) if self.speed_classes else {}),
        }

    @property
    def wheel_speed(self) -> float:
        """Largest speed of a wheel, m/s: the smallest that allows the model's straight moves and turns in place."""
        return max(self.speed, 0.5 * self.wheel_base * self.turn_rate)

    @property
    def wheel_acceleration(self) -> float:
        """Acceleration limit of each wheel, m/s²: just enough for straight moves and turns in place at their limits."""
        return max(self.acceleration, 0.5 * self.wheel_base * self.turn_acceleration)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remark on a seat beside the footprint."""
        return notes_on_seat(self.seat, self.body_parts)

    @cached_property
    def mounts(self) -> Mapping[str, Mount]:
        """Positions of the bodies "base", "camera" and, if there is one, "seat" on the base."""
        seat = {"seat": Mount(*self.seat)} if self.seat else {}
        return {"base": Mount(), "camera": Mount(*self.camera_offset, self.camera_height), **seat}

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """Collision geometry: the body on the floor, and the mast that carries the camera."""
        return (*self.body_parts, Part((self.camera_offset,), self.mast_radius, 0.0, self.camera_height))

    @cached_property
    def body_parts(self) -> tuple[Part, ...]:
        """Collision geometry of the body on the floor."""
        if self.footprint is None:
            return (Part(((0.0, 0.0),), float(self.radius), 0.0, self.body_height),)
        return convex_parts(self.footprint, 0.0, self.body_height)

    def wheels(self, trajectory: Trajectory, times: FloatArray) -> WheelTrack:
        """Return wheel speeds, v ± ω b/2, and wheel accelerations along a trajectory, at ``times`` (N,), s.

        Pass an executed trajectory (:meth:`execution`). In a plan speeds jump between motions, without acceleration.
        """
        states, (velocity, change) = trajectory.at(times), trajectory.rates(times)
        ahead, side = np.cos(states.yaw), np.sin(states.yaw)
        v, a = velocity.x * ahead + velocity.y * side, change.x * ahead + change.y * side
        half = 0.5 * self.wheel_base
        return WheelTrack(
            np.atleast_1d(times),
            v - half * velocity.yaw,
            v + half * velocity.yaw,
            a - half * change.yaw,
            a + half * change.yaw,
        )

    def faults(self, trajectory: Trajectory) -> Iterator[str]:
        """Yield a text for motions sideways or backwards, wheels beyond their limits, and faults of speed classes."""
        yield from faults(self, trajectory)
        yield from speed_faults(self.speed_classes, trajectory)

    def doubtful(self, law: Law, start: States, end: States) -> BoolArray:
        """Return a mask (M,) of motions that need :meth:`faults`.

        These are motions that go sideways or, unless the model ``reverses``, backwards; all curves; and motions with
        one of several speeds.
        """
        return doubtful(law, start, end, reverses=self.reverses) | doubtful_speeds(law, start, end)


def checked_offset(offset: Any) -> tuple[float, float]:
    """Check the option ``camera_offset`` and return it as two floats, m."""
    try:
        ahead, left = offset
    except (TypeError, ValueError):
        raise ModelError(f"camera_offset must be (ahead, left) in m, got {shown(offset)}") from None
    ahead, left = (
        real("camera_offset", value, -LONGEST, LONGEST, "(ahead, left) in m, each", error=ModelError)
        for value in (ahead, left)
    )
    return float(ahead), float(left)


def checked_footprint(corners: Any) -> tuple[tuple[float, float], ...]:
    """Check the option ``footprint`` and return its corners as pairs of floats, m."""
    try:
        points = tuple((float(x), float(y)) for x, y in corners)
        if not (np.abs(points) <= LONGEST).all():
            raise ValueError(f"corners must be finite, within {LONGEST:g} m of the axis")
        polygon = shapely.Polygon(points)
    except (TypeError, ValueError, OverflowError) as error:
        raise ModelError(
            f"footprint must be at least three corners (x, y) in m, got {shown(corners)}: {error}"
        ) from None
    if not polygon.is_valid or polygon.area == 0:
        raise ModelError(
            "the corners of footprint must be the outline of a polygon that does not cross itself, in order, got "
            f"{points}: {shapely.is_valid_reason(polygon)}"
        )
    if not polygon.covers(shapely.Point(0, 0)):
        raise ModelError(
            f"footprint must contain the axis of the base, (0, 0), got {points}; give corners relative to the axis"
        )
    return points
