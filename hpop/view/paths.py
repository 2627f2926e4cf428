"""The lines that trajectories draw: of the body that maps show, and of the camera in space."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.motions import Law, Model, Pose, States, laws_of
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.style import mapped_points

CURVE_PIECES = 12  # a motion along which a line is not straight is drawn as so many straight pieces
SWING_PIECES = 24  # the same of a camera's: an arm swings it round half a circle in one motion
LEVEL = 1e-3  # m: a camera whose heights differ by less keeps its height
IN_PLANE = frozenset({"x", "y"})


class Heights(NamedTuple):
    """From where to where a camera rises, m."""

    low: float
    high: float

    @property
    def vary(self) -> bool:
        """Whether they are more than one."""
        return self.high - self.low > LEVEL

    def __str__(self) -> str:
        return f"{round(self.low, 2):g} to {round(self.high, 2):g} m" if self.vary else f"{self.low:.3g} m"


def path_points(trajectory: Trajectory) -> FloatArray:
    """Points (N, 2), m, of the path on a map: ends of motions, and more where one is no straight line."""
    model = trajectory.model
    pieces = _base_pieces if "base" in model.provides else _camera_pieces
    return mapped_points(model, _along(trajectory, pieces))


def camera_path(trajectory: Trajectory) -> FloatArray:
    """Points (N, 3), m, of the camera's path: ends of motions, and more where one is no straight line."""
    return positions(trajectory.model.pose("camera", _along(trajectory, _camera_pieces)))


def positions(pose: Pose) -> FloatArray:
    """Where a body is (N, 3), m."""
    return np.stack(np.broadcast_arrays(pose.x, pose.y, pose.z), axis=1)


def camera_heights(problem: Problem, trajectories: Iterable[Trajectory]) -> Heights:
    """Between which heights the camera is, at the start and along some trajectories."""
    model = problem.model
    start = float(model.pose("camera", model.space.state(problem.start)).z[0])
    if not may_rise(model, model.space.state(problem.start)):
        return Heights(start, start)
    z = np.concatenate([[start], *(camera_path(trajectory)[:, 2] for trajectory in trajectories)])
    return Heights(float(z.min()), float(z.max()))


def may_rise(model: Model, state: States) -> bool:
    """Whether the camera can go up and down: a twist has the number 0.0, no column, for what is always zero."""
    rates = States(**{name: np.ones(1) for name in state.names})
    return not isinstance(model.twist("camera", state, rates).velocity[2], float)


def _along(trajectory: Trajectory, pieces_of: Callable[[Law], int]) -> States:
    """The states between motions, and more within those that are drawn in several pieces."""
    pieces = _pieces(trajectory, pieces_of)
    if not (pieces > 1).any():
        return trajectory.states
    owner = np.repeat(np.arange(len(trajectory)), pieces)
    share = np.concatenate([np.arange(count) / count for count in pieces])
    times = trajectory.times[owner] + share * trajectory.durations[owner]
    return trajectory.at(np.append(times, trajectory.duration))


def _pieces(trajectory: Trajectory, pieces_of: Callable[[Law], int]) -> IntArray:
    laws = laws_of(trajectory.model)
    return np.array([pieces_of(laws[kind]) for kind in trajectory.kinds], dtype=np.int64)


def _base_pieces(law: Law) -> int:
    return CURVE_PIECES if {"x", "yaw"} <= law.varies else 1


def _camera_pieces(law: Law) -> int:
    return 1 if law.varies <= IN_PLANE else SWING_PIECES
