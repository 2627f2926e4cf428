"""Contact with people who move: whether a trajectory comes too near to somebody, looked at moment by moment.

It shares no geometry and no rule with the planners that keep clear: the robot's outline is put where it is, every
hundredth of a second, and an uncertain person wherever it may be, at points that stand for equal shares of its normal
distribution.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray
from hpop.motions import States
from hpop.trajectories.trajectory import Trajectory
from hpop.world.content.people import Person

STEP = 0.01  # s between moments
TOGETHER = 2**16  # moments
TOUCH = 1e-3  # m: surfaces may touch, and what happens between moments is not seen
RISK = 0.05  # of what is predicted at a moment may be contact
UNSURE = 0.01  # by which the share that is found may be off: one point of POINTS is far less
POINTS = 1000
PLACED = 64  # moments of which all these points are looked at together
FARTHEST = 4.0  # standard deviations, beyond which there is no point
SOON = 1.0  # s: who comes within a margin by then may be left, as one who was within it at first
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


def contact(
    parts: Sequence[Any],
    people: Sequence[Person],
    trajectory: Trajectory,
    margin: float = 0.0,
    left: Collection[int] = (),
) -> str:
    """In words, when a robot of some upright parts first touches somebody, or is nearer than a margin, m; "" if never.

    Of somebody uncertain, or with several futures, when that is so in more than 5 % of what is predicted. A robot that
    begins within a margin, or into whose margin somebody comes within a second, may leave; so may one that begins in
    contact, as long as it does not make the gap smaller by itself. Of those who stand the ones whom it leaves count, by
    number.
    """
    moments = _moments(trajectory)
    for least, what in ((0.0, "touches"), (margin, f"comes within {margin:g} m of")):
        found = _first_of_all(parts, people, moments, least, left)
        if found is not None:
            moment, who = found
            return f"{what} {who} at {moment:.2f} s"
    return ""


def first_contact(
    parts: Sequence[Any], people: Sequence[Person], trajectory: Trajectory, margin: float, *, begin: float = 0.0
) -> tuple[float, str] | None:
    """When, s, a robot of some parts is first nearer than a margin, m, to somebody, who stands or moves, and to whom.

    begin  s, of the trajectory, from when on people are as they are predicted; when is told from then on
    """
    return _first_of_all(parts, people, _moments(trajectory, begin), margin, range(len(people)))


class _Moments(NamedTuple):
    """When it is looked, s, (N,) and where the robot is then."""

    times: FloatArray
    states: States


def _moments(trajectory: Trajectory, begin: float = 0.0) -> list[_Moments]:
    """All moments from a time on, s, from which they count."""
    duration = trajectory.duration - begin
    count = math.ceil(duration / STEP) + 1
    parts = (np.arange(first, min(first + TOGETHER, count)) for first in range(0, count, TOGETHER))
    several = (np.minimum(part * STEP, duration) for part in parts)
    return [_Moments(times, trajectory.at(begin + times)) for times in several]


def _first_of_all(
    parts: Sequence[Any],
    people: Sequence[Person],
    moments: Sequence[_Moments],
    margin: float,
    left: Collection[int] = (),
) -> tuple[float, str] | None:
    """When, s, the robot is first too near to somebody who moves, or is left, by number, and to whom."""
    found = [
        (moment, person.name or f"person {number}")
        for number, person in enumerate(people)
        if (person.moves or number in left) and (moment := _first(parts, person, moments, margin)) is not None
    ]
    return min(found, default=None)


def _first(parts: Sequence[Any], person: Person, moments: Sequence[_Moments], margin: float) -> float | None:
    """The first moment, s, at which one person is too near; with a margin, but for one from which the robot leaves."""
    uncertain = any(likely.spread or likely.growth for _, likely in person.hypotheses)
    leaves, parts_from = margin > 0.0, margin == 0.0  # it may still be leaving; or parting from contact
    for times, states in moments:
        touched = np.zeros(times.size)
        for weight, likely in person.hypotheses:
            touched += weight * _share(parts, likely, states, times, margin)
        near = touched > (RISK + UNSURE if uncertain else RISK)
        if leaves:
            away = np.flatnonzero(~near & (np.logical_or.accumulate(near) | (times > SOON)))
            near[: away[0] if away.size else near.size] = False
            leaves = not away.size
        if parts_from and near.size and near[0]:
            near[: _parted(parts, person, states, times, near)] = False
        parts_from = False
        late = np.flatnonzero(near)
        if late.size:
            return float(times[late[0]])
    return None


def _parted(parts: Sequence[Any], person: Person, states: States, times: FloatArray, near: BoolArray) -> int:
    """How many moments after its beginning a robot is still in contact, and does not make a gap smaller by itself.

    A person may follow faster than the robot leaves.
    """
    apart = np.flatnonzero(~near)
    until = int(apart[0]) if apart.size else near.size
    for _, likely in person.hypotheses:
        x, y = (np.broadcast_to(column, times.shape)[:until] for column in likely.at(times))
        places = np.stack([x, y], axis=1)
        gap = _distance(parts, states.take(np.arange(until)), places)
        if gap[0] >= person.radius - TOUCH:  # where the person is predicted to be there is no contact
            return 0
        own = _distance(parts, states.take(np.arange(1, until)), places[:-1]) - gap[:-1]
        nearer = np.append(0.0, np.cumsum(np.maximum(own, np.diff(gap)).clip(max=0.0)))
        shrinks = np.flatnonzero(nearer < -TOUCH)
        until = int(shrinks[0]) if shrinks.size else until
    return until


def _share(parts: Sequence[Any], person: Person, states: States, times: FloatArray, margin: float) -> FloatArray:
    """How much (N,) of what is predicted at times (N,), s, is too near: 0 or 1 of somebody whose place is sure."""
    x, y = (np.broadcast_to(column, times.shape) for column in person.at(times))
    there = np.broadcast_to(np.asarray(person.there(times), float), times.shape) > 0
    deviation = np.broadcast_to(np.asarray(person.deviation(times), float), times.shape)
    reach = max((part.reach for part in parts), default=0.0) + person.radius + margin
    near = np.flatnonzero(there & (np.hypot(states.x - x, states.y - y) < reach + FARTHEST * deviation))
    share = np.zeros(times.size)
    sure = near[deviation[near] == 0.0]
    least = person.radius + margin - TOUCH
    share[sure] = _distance(parts, states.take(sure), np.stack([x[sure], y[sure]], axis=1)) < least
    unsure = near[deviation[near] > 0.0]
    for begin in range(0, unsure.size, PLACED):
        some = unsure[begin : begin + PLACED]
        middle = np.stack([x[some], y[some]], axis=1)[:, None]
        places = middle + deviation[some, None, None] * _normal()  # (n, POINTS, 2)
        here = states.take(np.repeat(some, POINTS))
        share[some] = (_distance(parts, here, places.reshape(-1, 2)) < least).reshape(-1, POINTS).mean(axis=1)
    return share


def _distance(parts: Sequence[Any], states: States, places: FloatArray) -> FloatArray:
    """Distance (N,), m, of places (N, 2) from the robot in states (N,); 0 within it."""
    x, y = places[:, 0] - states.x, places[:, 1] - states.y
    cos, sin = np.cos(states.yaw), np.sin(states.yaw)
    ahead, left = cos * x + sin * y, cos * y - sin * x
    nearest = np.full(len(places), np.inf)
    for part in parts:
        nearest = np.minimum(nearest, _to_hull(part.corners, ahead, left) - part.radius)
    return np.asarray(np.maximum(nearest, 0.0))


def _to_hull(corners: Sequence[tuple[float, float]], x: FloatArray, y: FloatArray) -> FloatArray:
    """Distance (N,), m, of points from the convex hull of some corners; 0 within it."""
    ring = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(corners)))
    if len(ring) == 1:
        return np.asarray(np.hypot(x - ring[0, 0], y - ring[0, 1]))
    nearest, sides = np.full(x.size, np.inf), []
    for (ax, ay), (bx, by) in pairwise(ring.tolist()):
        along, across = bx - ax, by - ay
        share = np.clip(((x - ax) * along + (y - ay) * across) / (along**2 + across**2), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(x - ax - share * along, y - ay - share * across))
        sides.append(along * (y - ay) - across * (x - ax))
    if len(ring) < 4:  # a segment has no inside
        return nearest
    inside = (np.min(sides, axis=0) > 0) | (np.max(sides, axis=0) < 0)
    return np.asarray(np.where(inside, 0.0, nearest))


@cache
def _normal() -> FloatArray:
    """Points (POINTS, 2) that stand for equal shares of a standard normal distribution: a spiral of golden angles."""
    number = np.arange(POINTS)
    radius = np.sqrt(-2.0 * np.log1p(-(number + 0.5) / POINTS))
    return np.stack([radius * np.cos(number * GOLDEN), radius * np.sin(number * GOLDEN)], axis=1)
