"""Polylines in the place of curves: what planners that move corners start from when another planner drives curves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely

from hpop.base.arrays import FloatArray
from hpop.models.laws import Move
from hpop.planners.goals import one_goal, start_of
from hpop.planners.judgement import is_free
from hpop.planners.polylines.polyline import Polyline
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

SPACING = 0.02  # m: of the points of a curve
DEVIATIONS = (0.4, 0.2, 0.1, 0.05)  # m: how far a polyline may leave its curve, largest first: few corners are better


def straightened(trajectories: Sequence[Trajectory], problem: Problem) -> tuple[list[Trajectory], list[str]]:
    """Moves and turns in place alone: each curve gives way to a polyline near it that is free; and notes on them.

    The corners are those of Douglas and Peucker (1973), for the largest of DEVIATIONS at which the robot, which turns
    in place there, does not collide. A curve with no such polyline is left out.
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
            f"{len(deviations)} of the warm starts are curves: polylines within {max(deviations):g} m stand in for them"
        )
    if curves > len(deviations):
        notes.append(
            f"{curves - len(deviations)} of the warm starts are curves without a free polyline within "
            f"{DEVIATIONS[-1]:g} m: left out"
        )
    return straight, notes


def _points(trajectory: Trajectory, speed: float) -> FloatArray:
    """Points (N, 2), m, along a trajectory, none twice in a row."""
    states = trajectory.at(np.linspace(0.0, trajectory.duration, 2 + int(trajectory.duration * speed / SPACING)))
    points = np.stack([states.x, states.y], axis=1)
    new = np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))
    return points[new] if new.sum() > 1 else points[[0, -1]]
