"""Contact of a trajectory with moving people, checked moment by moment.

This check shares no geometry and no rules with the planners, so it can verify their results. The robot's outline is
placed every hundredth of a second. A person of uncertain position is placed at 1000 points, each of which stands for an
equal share of the normal distribution.
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
TOGETHER = 2**16  # moments that are checked together
TOUCH = 1e-3  # m: tolerance for touching surfaces and for motion between moments
RISK = 0.05  # accepted share of a prediction in contact at a moment
UNSURE = 0.01  # tolerance for the computed share; one point of POINTS is far less
POINTS = 1000
PLACED = 64  # moments whose points are computed together
FARTHEST = 4.0  # standard deviations, beyond which there is no point
SOON = 1.0  # s: a person who comes within a margin by then counts as within it from the start
GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


def contact(
    parts: Sequence[Any],
    people: Sequence[Person],
    trajectory: Trajectory,
    margin: float = 0.0,
    left: Collection[int] = (),
) -> str:
    """Return a description of the first contact, or of the first distance below a margin, m; "" if there is none.

    ``parts`` are the upright prisms of the robot (:class:`hpop.models.base.Part`). With several futures of a person, it
    counts as contact if more than 5 % of the prediction is too near; for an uncertain position, which is sampled, 6 %.
    A robot that begins within a person's margin, or is approached within a second, may leave. So may a robot that
    begins in contact (with an uncertain person, within a second), as long as its own motion does not reduce the gap.
    Standing people are not checked, except the indices in ``left``, people that the robot touches at its start.
    """
    moments = _moments(trajectory)
    for least, what in ((0.0, "touches"), (margin, f"comes within {margin:g} m of")):
        found = _earliest_contact(parts, people, moments, least, left)
        if found is not None:
            moment, who = found
            return f"{what} {who} at {moment:.2f} s"
    return ""


def first_contact(
    parts: Sequence[Any], people: Sequence[Person], trajectory: Trajectory, margin: float, *, begin: float = 0.0
) -> tuple[float, str] | None:
    """Return the first time, s, at which a robot is nearer than a margin, m, to any person, and the person's name.

    Moving and standing people count. Return None if this never happens. :func:`contact` says when a robot may leave
    people near its start, and which share of an uncertain prediction must be nearer.

    begin  s, of the trajectory, at which the predictions of people begin; the returned time counts from then
    """
    return _earliest_contact(parts, people, _moments(trajectory, begin), margin, range(len(people)))


class _Moments(NamedTuple):
    """Moments of a check: times (N,), s, and states (N,) of the robot at these times."""

    times: FloatArray
    states: States


def _moments(trajectory: Trajectory, begin: float = 0.0) -> list[_Moments]:
    """Return the moments of a check from time ``begin``, s, on, in blocks; their times count from ``begin``."""
    duration = trajectory.duration - begin
    count = math.ceil(duration / STEP) + 1
    parts = (np.arange(first, min(first + TOGETHER, count)) for first in range(0, count, TOGETHER))
    several = (np.minimum(part * STEP, duration) for part in parts)
    return [_Moments(times, trajectory.at(begin + times)) for times in several]


def _earliest_contact(
    parts: Sequence[Any],
    people: Sequence[Person],
    moments: Sequence[_Moments],
    margin: float,
    left: Collection[int] = (),
) -> tuple[float, str] | None:
    """Return the first time, s, at which a person is nearer than the margin, m, and the person's name; None if never.

    Moving people are checked, and standing people with indices in ``left``. :func:`contact` says which share of an
    uncertain prediction must be nearer.
    """
    found = [
        (moment, person.name or f"person {number}")
        for number, person in enumerate(people)
        if (person.moves or number in left)
        and (moment := _first_contact_with(parts, person, moments, margin)) is not None
    ]
    return min(found, default=None)


def _first_contact_with(
    parts: Sequence[Any], person: Person, moments: Sequence[_Moments], margin: float
) -> float | None:
    """Return the first time, s, at which the robot is nearer to one person than the margin, m, or None.

    Moments in which the robot leaves the person near its start do not count, see :func:`contact`.
    """
    uncertain = any(likely.spread or likely.growth for _, likely in person.hypotheses)
    leaves, parts_from = margin > 0.0, margin == 0.0  # it may still be leaving; or parting from contact
    for times, states in moments:
        touched = np.zeros(times.size)
        for weight, likely in person.hypotheses:
            touched += weight * _share_too_near(parts, likely, states, times, margin)
        near = touched > (RISK + UNSURE if uncertain else RISK)
        if leaves:
            away = np.flatnonzero(~near & (np.logical_or.accumulate(near) | (times > SOON)))
            near[: away[0] if away.size else near.size] = False
            leaves = not away.size
        if parts_from and (near[:1] | (uncertain and near[times <= SOON].any())).any():
            near[: _moments_of_leaving(parts, person, states, times, near)] = False
        parts_from = False
        late = np.flatnonzero(near)
        if late.size:
            return float(times[late[0]])
    return None


def _moments_of_leaving(
    parts: Sequence[Any], person: Person, states: States, times: FloatArray, near: BoolArray
) -> int:
    """Return the number of moments, from the first one on, in which contact is excused because the robot leaves.

    ``near`` marks the moments at which contact is too likely. The excuse ends with their first unbroken series, or
    earlier where the robot's own motion reduces the gap; a person may follow faster than the robot leaves. If contact
    only becomes likely after the first moment, no motion may reduce the gap: only the person's position becomes less
    certain. The number is 0 if the person's position is certain and the robot does not touch the person at first.
    """
    first = int(np.argmax(near))
    apart = np.flatnonzero(~near[first:])
    until = first + int(apart[0]) if apart.size else near.size
    for _, likely in person.hypotheses:
        x, y = (np.broadcast_to(column, times.shape)[:until] for column in likely.at(times))
        positions = np.stack([x, y], axis=1)
        gap = distance_to_outline(parts, states.take(np.arange(until)), positions)
        if gap[0] >= person.radius - TOUCH and not (likely.spread or likely.growth):  # no contact as predicted
            return 0
        change = np.diff(gap)
        if first == 0:
            change = np.maximum(
                distance_to_outline(parts, states.take(np.arange(1, until)), positions[:-1]) - gap[:-1], change
            )
        nearer = np.append(0.0, np.cumsum(change.clip(max=0.0)))
        shrinks = np.flatnonzero(nearer < -TOUCH)
        until = int(shrinks[0]) if shrinks.size else until
    return until


def _share_too_near(
    parts: Sequence[Any], person: Person, states: States, times: FloatArray, margin: float
) -> FloatArray:
    """Return the share (N,) of a person's prediction within the margin, m, at times (N,), s; 0 or 1 if certain."""
    x, y = (np.broadcast_to(column, times.shape) for column in person.at(times))
    there = np.broadcast_to(np.asarray(person.there(times), float), times.shape) > 0
    deviation = np.broadcast_to(np.asarray(person.deviation(times), float), times.shape)
    reach = max((part.reach for part in parts), default=0.0) + person.radius + margin
    near = np.flatnonzero(there & (np.hypot(states.x - x, states.y - y) < reach + FARTHEST * deviation))
    share = np.zeros(times.size)
    sure = near[deviation[near] == 0.0]
    least = person.radius + margin - TOUCH
    share[sure] = distance_to_outline(parts, states.take(sure), np.stack([x[sure], y[sure]], axis=1)) < least
    unsure = near[deviation[near] > 0.0]
    for begin in range(0, unsure.size, PLACED):
        some = unsure[begin : begin + PLACED]
        middle = np.stack([x[some], y[some]], axis=1)[:, None]
        positions = middle + deviation[some, None, None] * _normal_points()  # (n, POINTS, 2)
        here = states.take(np.repeat(some, POINTS))
        share[some] = (
            (distance_to_outline(parts, here, positions.reshape(-1, 2)) < least).reshape(-1, POINTS).mean(axis=1)
        )
    return share


def distance_to_outline(parts: Sequence[Any], states: States, positions: FloatArray) -> FloatArray:
    """Return the distance (N,), m, of positions (N, 2), m, from the robot's outline in states (N,); 0 within it."""
    x, y = positions[:, 0] - states.x, positions[:, 1] - states.y
    cos, sin = np.cos(states.yaw), np.sin(states.yaw)
    ahead, left = cos * x + sin * y, cos * y - sin * x
    nearest = np.full(len(positions), np.inf)
    for part in parts:
        nearest = np.minimum(nearest, _distance_to_hull(part.corners, ahead, left) - part.radius)
    return np.asarray(np.maximum(nearest, 0.0))


def _distance_to_hull(corners: Sequence[tuple[float, float]], x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the distance (N,), m, of points from the convex hull of some corners; 0 within it."""
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
def _normal_points() -> FloatArray:
    """Return points (POINTS, 2) with equal shares of a standard normal distribution: a spiral of golden angles."""
    number = np.arange(POINTS)
    radius = np.sqrt(-2.0 * np.log1p(-(number + 0.5) / POINTS))
    return np.stack([radius * np.cos(number * GOLDEN), radius * np.sin(number * GOLDEN)], axis=1)
