"""Contact with people who move: whether a trajectory comes too near to somebody, looked at moment by moment.

It shares no geometry and no rule with the planners that keep clear: the robot's outline is put where it is, every
hundredth of a second, and an uncertain person wherever it may be, at points that stand for equal shares of its normal
distribution.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
import shapely

from hpop.arrays import FloatArray
from hpop.motions import States
from hpop.trajectory import Trajectory
from hpop.world.people import Person

STEP = 0.01  # s between moments
TOGETHER = 2**16  # moments
TOUCH = 1e-3  # m: surfaces may touch, and what happens between moments is not seen
RISK = 0.05  # of what is predicted at a moment may be contact
UNSURE = 0.01  # by which the share that is found may be off: one point of POINTS is far less
POINTS = 1000
FARTHEST = 4.0  # standard deviations, beyond which there is no point
SOON = 1.0  # s: who comes within a margin by then may be left, as one who was within it at first
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


def contact(parts: Sequence[Any], people: Sequence[Person], trajectory: Trajectory, margin: float = 0.0) -> str:
    """In words, when a robot of some upright parts first touches somebody, or is nearer than a margin, m; "" if never.

    Of somebody uncertain, or with several futures, when that is so in more than 5 % of what is predicted. A robot that
    begins within a margin, or into whose margin somebody comes within a second, may leave.
    """
    for least, what in ((0.0, "touches"), (margin, f"comes within {margin:g} m of")):
        found = first_contact(parts, people, trajectory, least)
        if found is not None:
            moment, who = found
            return f"{what} {who} at {moment:.2f} s"
    return ""


def first_contact(
    parts: Sequence[Any], people: Sequence[Person], trajectory: Trajectory, margin: float, *, begin: float = 0.0
) -> tuple[float, str] | None:
    """When, s, a robot of some parts is first nearer than a margin, m, to somebody who moves, and to whom.

    begin  s, of the trajectory, from when on people are as they are predicted; when is told from then on
    """
    found = [
        (moment, person.name or f"person {number}")
        for number, person in enumerate(people)
        if person.moves and (moment := _first(parts, person, trajectory, margin, begin)) is not None
    ]
    return min(found, default=None)


def _first(parts: Sequence[Any], person: Person, trajectory: Trajectory, margin: float, begin: float) -> float | None:
    """The first moment, s, at which one person is too near; with a margin, but for one from which the robot leaves."""
    uncertain = any(likely.spread or likely.growth for _, likely in person.hypotheses)
    leaves = margin > 0.0  # it may still be leaving
    for times in _moments(trajectory.duration - begin):
        states = trajectory.at(begin + times)
        touched = np.zeros(times.size)
        for weight, likely in person.hypotheses:
            touched += weight * _share(parts, likely, states, times, margin)
        near = touched > (RISK + UNSURE if uncertain else RISK)
        if leaves:
            away = np.flatnonzero(~near & (np.logical_or.accumulate(near) | (times > SOON)))
            near[: away[0] if away.size else near.size] = False
            leaves = not away.size
        late = np.flatnonzero(near)
        if late.size:
            return float(times[late[0]])
    return None


def _moments(duration: float) -> Iterator[FloatArray]:
    count = math.ceil(duration / STEP) + 1
    for begin in range(0, count, TOGETHER):
        yield np.minimum(np.arange(begin, min(begin + TOGETHER, count)) * STEP, duration)


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
    for i in np.setdiff1d(near, sure).tolist():
        places = np.array([x[i], y[i]]) + deviation[i] * _normal()
        here = states.take(np.full(POINTS, i))
        share[i] = float((_distance(parts, here, places) < least).mean())
    return share


def _distance(parts: Sequence[Any], states: States, places: FloatArray) -> FloatArray:
    """Distance (N,), m, of places (N, 2) from the robot in states (N,); 0 within it."""
    points = shapely.points(places)
    nearest = np.full(len(places), np.inf)
    for part in parts:
        outlines = shapely.convex_hull(shapely.multipoints(part.placed(states)))
        nearest = np.minimum(nearest, shapely.distance(outlines, points) - part.radius)
    return np.asarray(np.maximum(nearest, 0.0))


@cache
def _normal() -> FloatArray:
    """Points (POINTS, 2) that stand for equal shares of a standard normal distribution: a spiral of golden angles."""
    number = np.arange(POINTS)
    radius = np.sqrt(-2.0 * np.log1p(-(number + 0.5) / POINTS))
    return np.stack([radius * np.cos(number * GOLDEN), radius * np.sin(number * GOLDEN)], axis=1)
