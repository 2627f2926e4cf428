"""Polylines as starts of nonlinear programs: their structure, replacement of curves, and a homotopy test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
import shapely

from hpop.base.arrays import FloatArray, IntArray, numbered
from hpop.base.math import wrap
from hpop.models.laws import Move
from hpop.planners.judgement import is_free
from hpop.planners.needs import one_goal, start_of
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world.geometry.planar import FreeSpace

POINTS = 20  # of a driven path in each motion, for the comparison of homotopy classes
PIECE = 0.6  # m: costs of a segment are integrated, and its clearance is sampled, in pieces of about this length


@dataclass(frozen=True, eq=False)
class Polyline:
    """Polyline of straight segments, with the headings required at both ends.

    vertices   (n+1, 2)  m
    start_yaw  rad
    goal_yaw   rad, or None where the heading at the goal is free
    """

    vertices: FloatArray
    start_yaw: float
    goal_yaw: float | None

    @classmethod
    def of(cls, trajectory: Trajectory, problem: Problem) -> Polyline:
        """Return the polyline along the moves of a trajectory, with its ends at exactly the problem's start and goal.

        Moves in one direction become one segment. Motions of other kinds than "move" are skipped.
        """
        s = trajectory.states
        rows = [(s.x[0], s.y[0])]
        heading = math.nan
        for i, kind in enumerate(trajectory.kinds):
            if kind != "move" or np.hypot(s.x[i + 1] - s.x[i], s.y[i + 1] - s.y[i]) < STRAIGHT:
                continue
            ahead = math.atan2(s.y[i + 1] - s.y[i], s.x[i + 1] - s.x[i])
            if abs(wrap(ahead - heading)) < STRAIGHT:
                rows.pop()
            rows.append((s.x[i + 1], s.y[i + 1]))
            heading = ahead
        vertices = np.array(rows, float)
        start, goal = start_of(problem), one_goal(problem, "a polyline")
        vertices[0], vertices[-1] = start[:2], goal[:2]
        return cls(vertices, start[2], goal[2])

    @property
    def lengths(self) -> FloatArray:
        """Length (n,) of each segment, m."""
        return np.asarray(np.hypot(*np.diff(self.vertices, axis=0).T), dtype=np.float64)

    @property
    def headings(self) -> FloatArray:
        """Direction (n,) of each segment, rad."""
        dx, dy = np.diff(self.vertices, axis=0).T
        return np.asarray(np.arctan2(dy, dx), dtype=np.float64)

    @property
    def structure(self) -> PolylineStructure:
        """Structure of the polyline's program: pieces of each segment, and turns at both ends.

        Numbers of pieces are rounded up to a few values, so that many polylines can share a program.
        """
        count = len(self.vertices) - 1
        if not count:
            return PolylineStructure((), False, False)
        pieces = tuple(_rounded_up(1.1 * length / PIECE) for length in self.lengths)
        first = abs(wrap(self.headings[0] - self.start_yaw)) > STRAIGHT
        last = self.goal_yaw is not None and abs(wrap(self.goal_yaw - self.headings[-1])) > STRAIGHT
        return PolylineStructure(pieces, bool(first), bool(last))

    def trajectory(self, model: Any) -> Trajectory:
        """Return the trajectory of turns in place and straight moves along the polyline."""
        headings = self.headings
        last = headings[-1] if len(headings) else self.start_yaw
        yaws = [self.start_yaw, *headings[:-1], last if self.goal_yaw is None else self.goal_yaw]
        if not len(headings):
            yaws = yaws[:1] if self.goal_yaw is None else [self.start_yaw, self.goal_yaw]
        vertices = self.vertices if len(headings) else np.repeat(self.vertices, len(yaws), axis=0)
        return Trajectory.from_poses(
            model, [(float(x), float(y), float(yaw)) for (x, y), yaw in zip(vertices, yaws, strict=True)]
        )

    def simplified(self, angle: float) -> Polyline:
        """Return the polyline without the inner vertices at which it turns by less than ``angle``, rad."""
        turned = np.abs(wrap(np.diff(self.headings)))
        stays = np.concatenate([[True], turned >= angle, [True]]) if len(turned) else np.ones(len(self.vertices), bool)
        return Polyline(self.vertices[stays], self.start_yaw, self.goal_yaw)

    def farthest(self, other: Polyline) -> float:
        """Return the largest difference in x or y, m, between a vertex and its counterpart in another polyline.

        The result is inf if the polylines have different numbers of vertices.
        """
        if self.vertices.shape != other.vertices.shape:
            return float("inf")
        return float(np.abs(self.vertices - other.vertices).max())

    def without(self, corner: int) -> Polyline:
        """Return the polyline without the vertex of index ``corner``."""
        return Polyline(np.delete(self.vertices, corner, axis=0), self.start_yaw, self.goal_yaw)

    def moved(self, rng: np.random.Generator, by: float) -> Polyline:
        """Return the polyline with its inner vertices displaced at random: standard deviation ``by``, m, in x and y."""
        vertices = self.vertices.copy()
        vertices[1:-1] += rng.normal(0.0, by, vertices[1:-1].shape)
        return Polyline(vertices, self.start_yaw, self.goal_yaw)


@dataclass(frozen=True)
class PolylineStructure:
    """Structure of a polyline: all that a nonlinear program keeps fixed while it moves the vertices.

    pieces      (n,) number of pieces in which costs of each segment are integrated
    first_turn  whether the robot turns in place before the first segment
    last_turn   whether it turns in place after the last one, to the heading of the goal
    """

    pieces: tuple[int, ...]
    first_turn: bool
    last_turn: bool

    @property
    def segments(self) -> int:
        """Number of straight segments n."""
        return len(self.pieces)

    def grown(self, other: PolylineStructure) -> PolylineStructure:
        """Return this structure with, in each segment, the larger number of pieces of both; both have n segments."""
        return replace(self, pieces=tuple(map(max, self.pieces, other.pieces)))

    @property
    def turns(self) -> int:
        """Number of turns in place."""
        return max(0, self.segments - 1) + self.first_turn + self.last_turn

    @property
    def turning(self) -> list[int]:
        """Indices of the vertices at which the robot turns."""
        return list(range(int(not self.first_turn), self.segments + self.last_turn))


def _rounded_up(number: float) -> int:
    """Return the least of 1, 2, 3, 4, 6, 8, 12, 16, 24, ... that is not less than a number."""
    size = 1
    while size < number:
        size = size * 3 // 2 if size & (size - 1) == 0 and size > 1 else (size * 4 // 3 if size > 1 else 2)
    return size


class SegmentParts(NamedTuple):
    """Parts into which the segments of a polyline are cut, n in all.

    segment  (n,) index of the segment of each part
    begin    (n,) share of the segment's length at which the part begins
    end      (n,) share at which it ends
    """

    segment: IntArray
    begin: FloatArray
    end: FloatArray

    def at(self, rows: IntArray) -> SegmentParts:
        """Return the parts with the given indices."""
        return SegmentParts(self.segment[rows], self.begin[rows], self.end[rows])


def parts_of(counts: IntArray) -> SegmentParts:
    """Cut each segment i into ``counts[i]`` equal parts, and return the parts."""
    segment, number = numbered(counts)
    return SegmentParts(segment, number / counts[segment], (number + 1) / counts[segment])


SPACING = 0.02  # m between the points of a curve
DEVIATIONS = (0.4, 0.2, 0.1, 0.05)  # m: largest distances of a polyline from its curve, tried in turn, coarsest first


def straightened(trajectories: Sequence[Trajectory], problem: Problem) -> tuple[list[Trajectory], list[str]]:
    """Replace curved trajectories by collision-free polylines; return the trajectories and notes on the curves.

    Trajectories of moves and turns in place stay as they are. Each other one is simplified to a polyline (Douglas and
    Peucker 1973), at whose corners the robot turns in place. The largest of DEVIATIONS that gives no collision is used.
    A trajectory without such a polyline is left out.
    """
    straight, yaw = list[Trajectory](), one_goal(problem, "a polyline")[2]
    curves, deviations = 0, list[float]()
    for trajectory in trajectories:
        if set(trajectory.kinds) <= {"move", "turn"}:
            straight.append(trajectory)
            continue
        curves += 1
        line = shapely.LineString(_points(trajectory, cast(Move, problem.model.laws["move"]).speed))
        for deviation in DEVIATIONS:
            corners = shapely.get_coordinates(shapely.simplify(line, deviation, preserve_topology=False))
            polyline = Polyline(corners, start_of(problem)[2], yaw).trajectory(problem.model)
            if is_free(problem, polyline):
                straight.append(polyline)
                deviations.append(deviation)
                break
    notes = []
    if deviations:
        notes.append(
            f"{len(deviations)} of the warm starts are curves, and were replaced by polylines at most "
            f"{max(deviations):g} m away"
        )
    if curves > len(deviations):
        notes.append(
            f"{curves - len(deviations)} of the warm starts are curves, and were left out: even a polyline within "
            f"{DEVIATIONS[-1]:g} m of the curve collides"
        )
    return straight, notes


def _points(trajectory: Trajectory, speed: float) -> FloatArray:
    """Return points (N, 2), m, along a trajectory, without repeated points.

    They are at most about SPACING apart if the robot is nowhere faster than ``speed``, m/s.
    """
    states = trajectory.at(np.linspace(0.0, trajectory.duration, 2 + int(trajectory.duration * speed / SPACING)))
    points = np.stack([states.x, states.y], axis=1)
    new = np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))
    return points[new] if new.sum() > 1 else points[[0, -1]]


def path_points(trajectory: Trajectory) -> FloatArray:
    """Return points (N, 2), m, along a driven trajectory."""
    share = np.arange(POINTS) / POINTS
    times = (trajectory.times[:-1, None] + trajectory.durations[:, None] * share).ravel()
    states = trajectory.at(np.append(times, trajectory.duration))
    return np.stack([states.x, states.y], axis=1)


def homotopic(first: FloatArray, second: FloatArray, space: FreeSpace) -> bool:
    """Return whether path ``first`` (N, 2) can be deformed into path ``second`` (M, 2) without crossing an obstacle.

    Both paths have the same ends, and lie in the free space. Following one path forth and the other back gives a loop.
    Draw a ray upwards from a point in each hole of the free space. The sequence of rays that the loop crosses, each
    with its direction, is a word; a crossing and an immediately following crossing back over the same ray cancel. The
    loop can be contracted if and only if the reduced word is empty, since the loops of a plane without H points form a
    free group with H generators. Winding numbers do not suffice: a loop round two obstacles, then back round each of
    them, has winding number 0 about both.

    >>> from hpop.world import World
    >>> room = World.from_polygons([shapely.box(4, 4, 6, 6)], extent=shapely.box(0, 0, 10, 10))
    >>> paths = [np.array([(1.0, 5.0), (5.0, y), (9.0, 5.0)]) for y in (2.0, 3.0, 8.0)]
    >>> [homotopic(paths[0], path, room.free_space((0.0, 1.0))) for path in paths]
    [True, True, False]
    """
    loop = np.concatenate([first, second[::-1], first[:1]])
    return not crossing_word(loop, holes(loop, space))


def holes(loop: FloatArray, space: FreeSpace) -> FloatArray:
    """Return a point (H, 2), m, in each hole of a free space that lies in the bounding box of a loop."""
    (x_min, y_min), (x_max, y_max) = loop.min(axis=0), loop.max(axis=0)
    parts = shapely.get_parts(space.region)
    inner = [shapely.get_interior_ring(part, i) for part in parts for i in range(shapely.get_num_interior_rings(part))]
    rings = np.array(inner, dtype=object)
    left, below, right, above = shapely.bounds(rings).reshape(-1, 4).T
    inside = np.flatnonzero((left > x_min) & (right < x_max) & (below > y_min) & (above < y_max))
    return shapely.get_coordinates(shapely.point_on_surface(shapely.polygons(rings[inside])))


def crossing_word(loop: FloatArray, points: FloatArray) -> list[int]:
    """Return the sequence in which a loop (L, 2), which ends where it begins, crosses rays up from points (H, 2).

    A crossing of ray i to the right is written i + 1, to the left -i - 1. A crossing is removed together with an
    immediately following crossing back over the same ray, until no such pair is left.
    """
    (x, y), (px, py) = loop.T[:, :, None], points.T[:, None, :]
    ahead = (x[:-1] <= px) & (px < x[1:])
    aback = (x[1:] <= px) & (px < x[:-1])
    segment, ray = np.nonzero(ahead | aback)
    begin, end, at = x[segment, 0], x[segment + 1, 0], px[0, ray]
    share = (at - begin) / (end - begin)
    over = y[segment, 0] + share * (y[segment + 1, 0] - y[segment, 0]) > py[0, ray]
    letter = np.where(ahead[segment, ray], ray + 1, -ray - 1)
    # If rays lie on one vertical line, each counts as slightly to the right of the ray before it.
    order = np.lexsort((letter, share, segment))
    word: list[int] = []
    for crossing in letter[order[over[order]]].tolist():
        if word and word[-1] == -crossing:
            word.pop()
        else:
            word.append(crossing)
    return word
