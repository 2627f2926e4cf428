"""Joints that carry parts and bodies of a robot in the plane: lifts, slides and hinges.

A joint keeps its load upright, so a part on a lift or on a boom remains an upright prism. Joints form a chain from the
base outwards. Positions of parts and bodies are those at joint values of 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray, IntArray
from hpop.base.math import smooth_abs
from hpop.base.options import MOST, one_of, real
from hpop.errors import ModelError
from hpop.motions import Leg, States, StateSpace

ALONG = ("up", "ahead", "left", "round")
STEP = math.radians(5.0)
"""Largest turn between the outlines that cover the area swept by a hinge."""
BEYOND = 1e-6
"""Tolerance beyond a stop, m or rad."""
ALIGNED = 1e-9
"""Least change of a joint that counts as a motion, m or rad."""


@checked_arguments
@dataclass(frozen=True)
class Joint:
    """Slide, or hinge about an upright axis.

    name          name of the joint's state
    along         "up", "ahead" or "left" of a slide; "round" of a hinge, counter-clockwise
    low, high     m or rad, stops of the joint
    speed         m/s or rad/s
    acceleration  m/s² or rad/s²
    at            m, (ahead, left) of the axis of a hinge
    """

    name: str
    along: Literal["up", "ahead", "left", "round"]
    low: float
    high: float
    speed: float = 0.5
    acceleration: float = 0.5
    at: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        one_of("along", self.along, ALONG, error=ModelError)
        for name in ("low", "high"):
            real(f"{name} of the joint {self.name!r}", getattr(self, name), -MOST, MOST, "m or rad", error=ModelError)
        if self.low > self.high:
            raise ModelError(
                f"the low stop of the joint {self.name!r} must not be above its high one, got {self.low:g} and "
                f"{self.high:g}"
            )
        for name in ("speed", "acceleration"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and 0.0 < value < math.inf):
                raise ModelError(f"{name} of the joint {self.name!r} must be a positive number, got {value!r}")

    @property
    def unit(self) -> str:
        """Unit of the joint's state."""
        return "rad" if self.along == "round" else "m"

    @property
    def lever(self) -> float:
        """Distance of the axis of a hinge from that of the base, m."""
        return math.hypot(*self.at)

    @property
    def stroke(self) -> float:
        """Largest distance by which a slide moves its load in the plane, m."""
        return max(abs(self.low), abs(self.high)) if self.along in ("ahead", "left") else 0.0


def reach_of(point: tuple[float, float], on: Sequence[Joint]) -> float:
    """Return a bound on the distance, m, of a carried point from the axis of the base, at any joint values."""
    reach = math.hypot(*point)
    for joint in reversed(on):
        reach += joint.stroke + (2.0 * joint.lever if joint.along == "round" else 0.0)
    return reach


class CarriedPoint(NamedTuple):
    """Point (x, y) in the world that joints carry, m, with its velocity, m/s, and acceleration, m/s²."""

    place: tuple[Column, Column]
    velocity: tuple[Column, Column] = (0.0, 0.0)
    acceleration: tuple[Column, Column] = (0.0, 0.0)


def carried_point(
    point: tuple[Column, Column],
    on: Sequence[Joint],
    states: States,
    rates: States | None = None,
    changes: States | None = None,
) -> CarriedPoint:
    """Return position, velocity and acceleration of a point (ahead, left), m, carried by joints and base.

    on : joints that carry the point
    rates, changes : first and second derivatives of the states, for velocity and acceleration
    """
    found = CarriedPoint(point)
    for joint in reversed(on):
        if joint.along == "round":
            found = _after_turn(found, joint.name, joint.at, states, rates, changes)
        elif joint.along != "up":
            found = _after_slide(found, joint.name, int(joint.along == "left"), states, rates, changes)
    found = _after_turn(found, "yaw", (0.0, 0.0), states, rates, changes)
    for axis, name in enumerate("xy"):
        found = _after_slide(found, name, axis, states, rates, changes)
    return found


def _after_slide(
    found: CarriedPoint, name: str, axis: int, states: States, rates: States | None, changes: States | None
) -> CarriedPoint:
    columns = []
    for old, source in zip(found, (states, rates, changes), strict=True):
        new = list(old)
        if source is not None:
            new[axis] = new[axis] + getattr(source, name)
        columns.append((new[0], new[1]))
    return CarriedPoint(*columns)


def _after_turn(
    found: CarriedPoint,
    name: str,
    at: tuple[float, float],
    states: States,
    rates: States | None,
    changes: States | None,
) -> CarriedPoint:
    """Return a point rotated about another: p = a + R d, its rate R d' + w J R d, ..., with w the angle's rate."""
    angle = getattr(states, name)
    cos, sin = np.cos(angle), np.sin(angle)

    def turned(x: Column, y: Column) -> tuple[Column, Column]:
        return cos * x - sin * y, sin * x + cos * y

    ux, uy = turned(found.place[0] - at[0], found.place[1] - at[1])
    place = at[0] + ux, at[1] + uy
    if rates is None:
        return CarriedPoint(place)
    rate, (rx, ry) = getattr(rates, name), turned(*found.velocity)
    velocity = rx - rate * uy, ry + rate * ux
    if changes is None:
        return CarriedPoint(place, velocity)
    change, (bx, by) = getattr(changes, name), turned(*found.acceleration)
    square = rate * rate
    return CarriedPoint(
        place,
        velocity,
        (bx - 2.0 * rate * ry - change * uy - square * ux, by + 2.0 * rate * rx + change * ux - square * uy),
    )


def joint_sum(on: Sequence[Joint], along: str, states: States) -> Column:
    """Return the sum of the states of all joints along one direction: the lift (N,), m, or the turn (N,), rad."""
    return sum((getattr(states, joint.name) for joint in on if joint.along == along), 0.0)


def swept_corners(corners: FloatArray, on: Sequence[Joint]) -> tuple[FloatArray, float]:
    """Return points (n, 2) and a radius, m; their grown hull contains corners (c, 2) at all joint values."""
    points, grown = corners, 0.0
    for joint in reversed(on):
        if joint.along == "round":
            count = max(1, math.ceil((joint.high - joint.low) / STEP))
            angles = np.linspace(joint.low, joint.high, count + 1)[:, None]
            ux, uy = (points - joint.at).T
            cos, sin = np.cos(angles), np.sin(angles)
            turned = np.stack([cos * ux - sin * uy, sin * ux + cos * uy], axis=-1).reshape(-1, 2)
            points = turned + joint.at
            lever = float(np.hypot(*(turned.T)).max()) + grown
            grown += lever * (1.0 - math.cos(0.5 * (joint.high - joint.low) / count))
        elif joint.along != "up":
            slide = np.array([1.0, 0.0] if joint.along == "ahead" else [0.0, 1.0])
            points = np.concatenate([points + joint.low * slide, points + joint.high * slide])
    return points, grown


def legs_of_joints(space: StateSpace, legs: list[Leg], a: States, b: States, joints: Sequence[str]) -> list[Leg]:
    """Return the legs of the base, then one leg per joint, by the law of that joint; a joint that is NaN in b stays."""
    end = States(**{name: getattr(a, name) for name in space.names})
    made = []
    for leg in legs:
        end = States(**{name: getattr(leg.end if name in leg.end.names else a, name) for name in space.names})
        made.append(leg._replace(end=end))
    for joint in joints:
        asked = getattr(b, joint)
        goal = States(**end.__dict__ | {joint: np.where(np.isnan(asked), getattr(end, joint), asked)})
        change = space.differences(end, goal)[joint]
        there = np.abs(change) > ALIGNED
        end = States(**end.__dict__ | {joint: np.where(there, getattr(end, joint) + change, getattr(end, joint))})
        made.append(Leg(joint, end, there))
    return made


def stop_faults(space: StateSpace, joints: Sequence[str], states: States) -> Iterator[str]:
    """Yield joints that are beyond a stop in states (N,), each with the state in which it is farthest beyond."""
    for joint, low, high in _stops(space, joints):
        value = getattr(states, joint)
        for stop, beyond in ((low, -1.0), (high, 1.0)):
            over = beyond * (value - stop)
            if over.max() > BEYOND:
                i = int(np.argmax(over))
                unit = space.units[space.names.index(joint)]
                yield f"has a {joint} of {value[i]:.6g} {unit} in state {i}, beyond its stop at {stop:.6g}"


def beyond_stops(space: StateSpace, joints: Sequence[str], states: States) -> BoolArray:
    """Return whether a joint is beyond a stop in each state (N,)."""
    found = np.zeros(states.size, dtype=bool)
    for joint, low, high in _stops(space, joints):
        value = getattr(states, joint)
        found |= (value < low - BEYOND) | (value > high + BEYOND)
    return found


def _stops(space: StateSpace, joints: Sequence[str]) -> Iterator[tuple[str, float, float]]:
    """Yield the joints that have stops, with their stops."""
    for joint in joints:
        if joint not in space.turning:
            column = space.names.index(joint)
            yield joint, space.low[column], space.high[column]


def largest_change(joints: Sequence[Joint], start: States, end: States, lever: float) -> tuple[Column, Column]:
    """Return bounds (M,), m and rad, on the motion by joints of any point within a lever, m, of their axes."""
    moved: Column = 0.0
    turned: Column = 0.0
    for joint in joints:
        change = smooth_abs(getattr(end, joint.name) - getattr(start, joint.name))
        moved = moved + (lever * change if joint.along == "round" else change)
        turned = turned + (change if joint.along == "round" else 0.0)
    return moved, turned


class Stations(NamedTuple):
    """Stations of a lattice: states of a model at one position, and its motions in place.

    states    (S,)  x and y are 0
    headings  (S,)  index of each state's heading among the lattice's headings; moves go along it
    motions         by kind of motion in place: tails and heads (E,), both indices of states
    """

    states: States
    headings: IntArray
    motions: Mapping[str, tuple[IntArray, IntArray]]


def grid_of_stations(yaw: FloatArray, joints: Mapping[str, FloatArray]) -> tuple[Stations, IntArray]:
    """Return all combinations of headings (H,), rad, and joint values, and the station number of each.

    The numbers have one axis for the headings and one for each joint. A "turn" leads from any heading to any other, and
    a joint's law from any value of the joint to any other.
    """
    shape = (yaw.size, *(values.size for values in joints.values()))
    heading, *at = (index.ravel() for index in np.indices(shape))
    zero, number = np.zeros(heading.size), np.arange(heading.size).reshape(shape)
    columns = {name: values[index] for (name, values), index in zip(joints.items(), at, strict=True)}
    motions = {kind: _motions_along_axis(number, axis) for axis, kind in enumerate(("turn", *joints))}
    return Stations(States(x=zero, y=zero, yaw=yaw[heading], **columns), heading, motions), number


def _motions_along_axis(number: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Return tails and heads of motions between any two stations that differ only along one axis."""
    lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
    a, b = np.nonzero(~np.eye(lines.shape[1], dtype=bool))
    return lines[:, a].ravel(), lines[:, b].ravel()


def stops_of(space: StateSpace, joint: str) -> FloatArray:
    """Return both stops of a joint and 0, in ascending order; their midpoint instead of 0 if 0 is not between them."""
    column = space.names.index(joint)
    low, high = space.low[column], space.high[column]
    return np.unique([low, 0.0 if low <= 0.0 <= high else 0.5 * (low + high), high])
