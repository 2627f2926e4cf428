"""Polylines: what a nonlinear program of straight segments takes and gives, and the structure that it cannot change."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.planners.goals import one_goal, start_of
from hpop.trajectories.trajectory import STRAIGHT, Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

PIECE = 0.6  # m: a segment is integrated, and its clearance sampled, in pieces of about this length


@dataclass(frozen=True, eq=False)
class Polyline:
    """Straight segments between vertices, and the headings that are asked for at both ends.

    vertices   (n+1, 2)  m
    start_yaw  rad
    goal_yaw   rad, or None where the heading at the goal is free
    """

    vertices: FloatArray
    start_yaw: float
    goal_yaw: float | None

    @classmethod
    def of(cls, trajectory: Trajectory, problem: Problem) -> Polyline:
        """The polyline that a trajectory drives; its ends are put exactly on the problem's start and goal."""
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
        """Its structure; pieces are counted with some to spare, so that few numbers of them occur."""
        count = len(self.vertices) - 1
        if not count:
            return PolylineStructure((), False, False)
        pieces = tuple(_rounded_up(1.1 * length / PIECE) for length in self.lengths)
        first = abs(wrap(self.headings[0] - self.start_yaw)) > STRAIGHT
        last = self.goal_yaw is not None and abs(wrap(self.goal_yaw - self.headings[-1])) > STRAIGHT
        return PolylineStructure(pieces, bool(first), bool(last))

    def trajectory(self, model: Any) -> Trajectory:
        """Turns in place and straight moves along the polyline."""
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
        """Without the inner vertices at which it turns by less than ``angle``, rad."""
        turned = np.abs(wrap(np.diff(self.headings)))
        kept = np.concatenate([[True], turned >= angle, [True]]) if len(turned) else np.ones(len(self.vertices), bool)
        return Polyline(self.vertices[kept], self.start_yaw, self.goal_yaw)

    def farthest(self, other: Polyline) -> float:
        """Return the largest difference of a coordinate, m, to another polyline with as many vertices; else inf."""
        if self.vertices.shape != other.vertices.shape:
            return float("inf")
        return float(np.abs(self.vertices - other.vertices).max())

    def without(self, corner: int) -> Polyline:
        """Return the polyline without one of its vertices."""
        return Polyline(np.delete(self.vertices, corner, axis=0), self.start_yaw, self.goal_yaw)

    def moved(self, rng: np.random.Generator, by: float) -> Polyline:
        """A polyline whose interior vertices are displaced at random by about ``by`` metres."""
        vertices = self.vertices.copy()
        vertices[1:-1] += rng.normal(0.0, by, vertices[1:-1].shape)
        return Polyline(vertices, self.start_yaw, self.goal_yaw)


@dataclass(frozen=True)
class PolylineStructure:
    """What a nonlinear program cannot change of a polyline.

    pieces      (n,) in how many pieces each segment is integrated
    first_turn  whether the robot turns before the first segment
    last_turn   whether it turns after the last one, to a heading that is asked for
    """

    pieces: tuple[int, ...]
    first_turn: bool
    last_turn: bool

    @property
    def segments(self) -> int:
        """Number of straight segments n."""
        return len(self.pieces)

    def grown(self, other: PolylineStructure) -> PolylineStructure:
        """The same with as many pieces in each segment as another has, if those are more."""
        return replace(self, pieces=tuple(map(max, self.pieces, other.pieces)))

    @property
    def turns(self) -> int:
        """Number of turns in place."""
        return max(0, self.segments - 1) + self.first_turn + self.last_turn


def _rounded_up(number: float) -> int:
    """The next of 1, 2, 3, 4, 6, 8, 12, 16, 24, ..."""
    size = 1
    while size < number:
        size = size * 3 // 2 if size & (size - 1) == 0 and size > 1 else (size * 4 // 3 if size > 1 else 2)
    return size
