"""From a polyline to the first guess of a driven trajectory: corners cut, speeds and times to go with them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.planners.polylines.polyline import Polyline
from hpop.planners.programs.smoothing.phases import Guess, Phases
from hpop.trajectories.trajectory import STRAIGHT

if TYPE_CHECKING:
    from hpop.motions import Wheeled

CORNER = 0.35  # m: a turn begins and ends so far from its vertex, at most
SHARE = 0.4  # of a segment that each turn takes at most
CRUISE = 0.8  # share of its speed at which the robot goes straight, on average
AROUND = 0.5  # share of its speeds at which it turns


def rotations(polyline: Polyline) -> FloatArray:
    """Signed rotation (n+1,), rad, at each vertex: at the start, between segments, and at the goal."""
    headings = polyline.headings
    last = headings[-1] if polyline.goal_yaw is None else polyline.goal_yaw
    return np.asarray(wrap(np.diff([polyline.start_yaw, *headings, last])), dtype=np.float64)


def structure_of(polyline: Polyline, intervals: int) -> Phases:
    """The turns of a polyline, in place at both ends too, and straight driving between them."""
    turns = np.abs(rotations(polyline)) > STRAIGHT
    return Phases(int(turns.sum()), not turns[0], not turns[-1], intervals)


def legs(polyline: Polyline) -> tuple[FloatArray, FloatArray]:
    """Begin, middle and end (P, 3, 2), m, of each phase, and how far it turns (P,), rad."""
    corners, turned = polyline.vertices, rotations(polyline)
    along = np.diff(corners, axis=0) / polyline.lengths[:, None]
    cuts = np.minimum(CORNER, SHARE * polyline.lengths)[:, None] * along
    leave, reach = corners[:-1] + cuts, corners[1:] - cuts  # (n, 2) where each segment is straight
    if abs(turned[0]) <= STRAIGHT:
        leave[0] = corners[0]
    if abs(turned[-1]) <= STRAIGHT:
        reach[-1] = corners[-1]
    places, angles = [], []
    for i, angle in enumerate(turned):
        if abs(angle) > STRAIGHT:
            before, after = (reach[i - 1] if i else corners[0]), (leave[i] if i < len(leave) else corners[-1])
            places.append((before, corners[i], after))
            angles.append(angle)
        if i < len(leave):
            places.append((leave[i], 0.5 * (leave[i] + reach[i]), reach[i]))
            angles.append(0.0)
    return np.array(places), np.array(angles)


def first_guess(polyline: Polyline, structure: Phases, model: Wheeled) -> Guess:
    """Places, headings and speeds along a polyline whose corners are cut by parabolas."""
    places, angles = legs(polyline)
    yaw, columns, lasts = polyline.start_yaw, [], []
    for (begin, middle, end), angle, count in zip(places, angles, structure.counts, strict=True):
        span = np.hypot(*(middle - begin)) + np.hypot(*(end - middle))
        share = AROUND if angle else CRUISE
        seconds = max(span / (share * model.speed), abs(angle) / (AROUND * model.turn_rate), 0.1)
        s = np.linspace(0.0, 1.0, count + 1)
        place = np.outer((1 - s) ** 2, begin) + np.outer(2 * s * (1 - s), middle) + np.outer(s * s, end)
        heading, rate = yaw + angle * s * s * (3 - 2 * s), 6 * s * (1 - s) * angle / seconds
        columns.append(np.stack([*place.T, heading, np.full(count + 1, span / seconds), rate]))
        lasts.append(seconds)
        yaw += angle
    nodes = np.concatenate([columns[0], *(column[:, 1:] for column in columns[1:])], axis=1)
    nodes[3, [0, -1]] = 0.0
    nodes[4] = np.clip(nodes[4], -model.turn_rate, model.turn_rate)
    return Guess(nodes, np.array(lasts), np.sign(angles), polyline.goal_yaw is not None)
