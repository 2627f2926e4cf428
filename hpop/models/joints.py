"""Joints of a robot in the plane: lifts, slides and upright hinges that carry its collision parts, camera or tool.

A joint keeps its load upright, so a collision part on a lift or a boom remains an upright prism. Joints form a chain
from the base outwards. Positions of parts and bodies are given for joint values of 0.
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
"""Largest angle between two outlines of a part; outlines at this spacing cover the area that a hinge sweeps with it."""
BEYOND = 1e-6
"""Tolerance by which a joint may be beyond an end stop, m or rad."""
ALIGNED = 1e-9
"""Smallest change of a joint that counts as a motion, m or rad."""


@checked_arguments
@dataclass(frozen=True)
class Joint:
    """Joint that moves a part of the robot: a slide, or a hinge about an upright axis.

    name          name of the joint's state
    along         direction of a slide: "up", "ahead" or "left"; "round" for a hinge, positive counter-clockwise
    low, high     m or rad, end stops of the joint
    speed         m/s or rad/s, largest
    acceleration  m/s² or rad/s², largest
    at            m, position (ahead, left) of a hinge's axis relative to the axis of the base
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
                f"low must not be above high for the joint {self.name!r}, got low={self.low:g} and high={self.high:g}"
            )
        for name in ("speed", "acceleration"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and 0.0 < value < math.inf):
                raise ModelError(f"{name} of the joint {self.name!r} must be a positive number, got {value!r}")

    @property
    def unit(self) -> str:
        """Unit of the joint's state: "rad" for a hinge, "m" for a slide."""
        return "rad" if self.along == "round" else "m"

    @property
    def lever(self) -> float:
        """Distance between the axis of a hinge and the axis of the base, m."""
        return math.hypot(*self.at)

    @property
    def stroke(self) -> float:
        """Largest distance, m, of a slide's load from its place at the joint value 0; 0 for lifts and hinges."""
        return max(abs(self.low), abs(self.high)) if self.along in ("ahead", "left") else 0.0


def reach_of(point: tuple[float, float], on: Sequence[Joint]) -> float:
    """Return an upper bound, m, on how far a carried point gets from the axis of the base, over all joint values.

    point  m, (ahead, left) at joint values of 0
    on     joints that carry the point, from the base outwards
    """
    reach = math.hypot(*point)
    for joint in reversed(on):
        reach += joint.stroke + (2.0 * joint.lever if joint.along == "round" else 0.0)
    return reach


class CarriedPoint(NamedTuple):
    """Point of the robot that joints carry: position (x, y), m, velocity, m/s, and acceleration, m/s², in the world."""

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
    """Return position, velocity and acceleration in the world of a point that the base and its joints carry.

    point           m, (ahead, left) on the base at joint values of 0
    on              joints that carry the point, from the base outwards
    rates, changes  first and second time derivatives of the states; without them velocity or acceleration are not
                    computed
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
    """Return ``found`` after a slide along an axis (0 or 1): the state ``name`` is added to this coordinate.

    Its velocity and acceleration change by the rate and the second derivative of the state, where given.
    """
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
    """Return ``found`` after a rotation about the position ``at`` by the angle in the state ``name``.

    With d its offset from ``at``, R the rotation, w the rate of the angle and J a quarter turn, the new position is
    at + R d and the new velocity R d' + w J R d. The acceleration is the derivative of the velocity.
    """
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
    """Return the sum (N,) of the states of those joints whose ``along`` is the given one.

    It is the total lift, m, for "up", and the total angle, rad, for "round".
    """
    return sum((getattr(states, joint.name) for joint in on if joint.along == along), 0.0)


def swept_corners(corners: FloatArray, on: Sequence[Joint]) -> tuple[FloatArray, float]:
    """Return a bound on the area that a part's corners (c, 2) can reach over all values of its joints.

    The bound is the convex hull of the returned points (n, 2), m, grown by the returned radius, m.
    """
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
    """Return the motions from states a to b: those of the base (``legs``), then one motion of each joint.

    Each joint moves by its own law. A joint whose value in b is NaN does not move.
    """
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
    """Yield a text for each joint that is beyond an end stop in some of the states (N,); it names the worst state."""
    for joint, low, high in _stops(space, joints):
        value = getattr(states, joint)
        for stop, beyond in ((low, -1.0), (high, 1.0)):
            over = beyond * (value - stop)
            if over.max() > BEYOND:
                i = int(np.argmax(over))
                unit = space.units[space.names.index(joint)]
                yield f"has a {joint} of {value[i]:.6g} {unit} in state {i}, beyond its stop at {stop:.6g} {unit}"


def beyond_stops(space: StateSpace, joints: Sequence[str], states: States) -> BoolArray:
    """Return a mask (N,) of the states in which some joint is beyond an end stop."""
    found = np.zeros(states.size, dtype=bool)
    for joint, low, high in _stops(space, joints):
        value = getattr(states, joint)
        found |= (value < low - BEYOND) | (value > high + BEYOND)
    return found


def _stops(space: StateSpace, joints: Sequence[str]) -> Iterator[tuple[str, float, float]]:
    """Yield name, low and high end stop of each joint that has end stops."""
    for joint in joints:
        if joint not in space.turning:
            column = space.names.index(joint)
            yield joint, space.low[column], space.high[column]


def largest_change(joints: Sequence[Joint], start: States, end: States, lever: float) -> tuple[Column, Column]:
    """Return upper bounds (M,), m and rad, on how far joints move and turn a point within ``lever`` m of their axes."""
    moved: Column = 0.0
    turned: Column = 0.0
    for joint in joints:
        change = smooth_abs(getattr(end, joint.name) - getattr(start, joint.name))
        moved = moved + (lever * change if joint.along == "round" else change)
        turned = turned + (change if joint.along == "round" else 0.0)
    return moved, turned


class Stations(NamedTuple):
    """All states that a lattice uses at one grid position, and the motions in place between them.

    states    (S,)  states, with x and y 0
    headings  (S,)  index of each state's heading among the lattice's headings; straight moves go along it
    motions         for each kind of motion in place, such as "turn": indices (E,) of the states in which the E motions
                    begin, and indices (E,) of those in which they end
    """

    states: States
    headings: IntArray
    motions: Mapping[str, tuple[IntArray, IntArray]]


def grid_of_stations(yaw: FloatArray, joints: Mapping[str, FloatArray]) -> tuple[Stations, IntArray]:
    """Return a lattice's states at one position: all combinations of headings and joint values, with motions in place.

    yaw     (H,)  headings, rad
    joints  values of each joint, by its name

    A "turn" leads from any heading to any other, and a joint's own law from any of its values to any other. Also
    returned is the number of the state of each combination, as an array with one axis for the headings and one for
    each joint.
    """
    shape = (yaw.size, *(values.size for values in joints.values()))
    heading, *at = (index.ravel() for index in np.indices(shape))
    zero, number = np.zeros(heading.size), np.arange(heading.size).reshape(shape)
    columns = {name: values[index] for (name, values), index in zip(joints.items(), at, strict=True)}
    motions = {kind: _motions_along_axis(number, axis) for axis, kind in enumerate(("turn", *joints))}
    return Stations(States(x=zero, y=zero, yaw=yaw[heading], **columns), heading, motions), number


def _motions_along_axis(number: IntArray, axis: int) -> tuple[IntArray, IntArray]:
    """Return the motions that change one value, as two arrays: the state numbers at their starts, and at their ends.

    There is a motion from each value on the axis to each other value, not only to the next one.

    number  state number of each combination of heading and joint values, with one axis for the headings and one for
            each joint
    axis    axis of the heading or joint that changes
    """
    lines = np.moveaxis(number, axis, -1).reshape(-1, number.shape[axis])
    a, b = np.nonzero(~np.eye(lines.shape[1], dtype=bool))
    return lines[:, a].ravel(), lines[:, b].ravel()


def stops_of(space: StateSpace, joint: str) -> FloatArray:
    """Return the three values of a joint in a lattice, ascending: both end stops and 0.

    If 0 is not between the stops, their midpoint takes its place. Equal values are returned once.
    """
    column = space.names.index(joint)
    low, high = space.low[column], space.high[column]
    return np.unique([low, 0.0 if low <= 0.0 <= high else 0.5 * (low + high), high])
