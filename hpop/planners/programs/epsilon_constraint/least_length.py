"""A length that no trajectory falls below: the shortest way on which the discs of the robot clear everything."""

from __future__ import annotations

import heapq
import math
from typing import TYPE_CHECKING

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray
from hpop.planners.goals import one_goal, start_of

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

SLACK = 1e-6  # m, by which free space is grown, so that a way along its border lies in it
ROUNDING = 1e-6  # m4, of a product of two areas: a line along a side is a tangent
MOST_CORNERS = 5000  # of free space; where there are more, nothing but the straight line is known


def least_length(problem: Problem) -> float:
    """A lower bound, m, of the length of trajectories from start to goal.

    The shortest way of a disc among polygons turns only at corners of the free space of its axis (Lozano-Perez and
    Wesley 1979, doi 10.1145/359156.359164). The arcs of that space are replaced by their chords, which makes it larger,
    so what is found is a bound. Parts that are no discs on the axis are left out, which makes it a lower one.
    """
    start, goal = np.array(start_of(problem)[:2]), np.array(one_goal(problem, "a bound of the length")[:2])
    bounds = [math.dist(start, goal)]
    for part in problem.model.platform:
        if part.on_axis:
            free = problem.world.free_space((part.z_min, part.z_max)).region
            space = shapely.buffer(shapely.buffer(free, -part.radius, quad_segs=4), SLACK, join_style="mitre")
            bounds.append(_shortest(space, start, goal))
    return max(bounds)


def _shortest(space: shapely.Geometry, start: FloatArray, goal: FloatArray) -> float:
    """The length of the shortest way in a region; 0 where there is none, or the region has too many corners.

    A* from corner to corner, along lines that are tangents at both ends; whether one sees the other is asked when it
    would be next.
    """
    corners, before, after = _corners(space)
    if len(corners) > MOST_CORNERS:
        return 0.0
    points = np.concatenate([[start, goal], corners])
    before, after = (np.concatenate([np.zeros((2, 2)), sides]) for sides in (before, after))  # all is tangent at an end
    left = np.hypot(*(points - goal).T)
    done = np.zeros(len(points), np.bool_)
    queue = [(float(left[0]), 0.0, 0, 0)]
    shapely.prepare(space)
    while queue:
        _, length, u, v = heapq.heappop(queue)
        if done[v] or (u != v and not shapely.covers(space, shapely.linestrings(points[[u, v]]))):
            continue
        if v == 1:
            return length
        done[v] = True
        ahead = points - points[v]
        taut = ~done & _tangent(ahead, before, after) & _tangent(ahead, before[v], after[v])
        longer = length + np.hypot(*ahead.T)
        for w in np.flatnonzero(taut).tolist():
            heapq.heappush(queue, (float(longer[w] + left[w]), float(longer[w]), v, w))
    return 0.0


def _corners(space: shapely.Geometry) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Vertices (n, 2) of a region at which a way may turn, where the region is on the outer side; sides to and from."""
    found = [np.zeros((0, 3, 2))]
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(space))):  # the region is to the right of each
        points = shapely.get_coordinates(ring)[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        found.append(np.stack([points, before, after], axis=1)[_cross(before, after) > 0])
    points, before, after = np.concatenate(found).transpose(1, 0, 2)
    return points, before, after


def _tangent(ahead: FloatArray, before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether lines (n, 2) leave both sides of a corner on one side."""
    return _cross(ahead, before) * _cross(ahead, after) <= ROUNDING


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
