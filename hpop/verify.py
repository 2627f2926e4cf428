"""Is a front what it claims? Costs re-evaluated, ends compared, collisions checked in space by python-fcl."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hpop.arrays import BoolArray, FloatArray
from hpop.criteria.base import trajectory_costs
from hpop.front import Front
from hpop.models.solid import SolidCollision
from hpop.motions import States
from hpop.planners.base import edge_objectives
from hpop.problem import Problem
from hpop.trajectory import Trajectory

SPACING = 0.05  # m or rad: distance between the states at which collisions are looked for
SAME = 1e-9  # relative: a re-evaluated cost is the same number but for the order of a sum


def verify(problem: Problem, front: Front) -> list[str]:
    """Faults of a front of this problem, in words; none if it holds what it claims.

    Independent of the planner: costs come from the criteria, collisions from python-fcl at states no further apart than
    5 cm or 3 degrees, the start from the problem.
    """
    faults = [*_cost_faults(problem, front), *_end_faults(problem, front)]
    free = collision_free(problem, front.trajectories)
    return [*faults, *(f"trajectory {i} collides" for i in np.flatnonzero(~free))]


def _cost_faults(problem: Problem, front: Front) -> list[str]:
    optimised = edge_objectives(problem.criteria, "front").optimised
    every = {criterion.name: criterion for criterion in (*problem.criteria, *optimised)}
    names = [*front.names, *front.reported_names]
    unknown = [name for name in names if name not in every]
    if unknown:
        return [f"costs of {', '.join(unknown)} are saved, which the problem does not ask for"]
    again = trajectory_costs([every[name] for name in names], front.trajectories, problem.world)
    saved: FloatArray = np.hstack([front.costs, front.reported])
    wrong = np.abs(again - saved) > SAME * np.maximum(1.0, np.abs(saved))
    return [
        f"trajectory {i}: {names[j]} is saved as {saved[i, j]:.9g}, re-evaluated {again[i, j]:.9g}"
        for i, j in np.argwhere(wrong)
    ]


def _end_faults(problem: Problem, front: Front) -> list[str]:
    faults = []
    for i, trajectory in enumerate(front.trajectories):
        s = trajectory.states
        if not np.allclose([s.x[0], s.y[0], np.cos(s.yaw[0] - problem.start[2])], [*problem.start[:2], 1.0], atol=1e-5):
            faults.append(f"trajectory {i} does not begin at the start")
        if problem.goal[2] is not None and not np.isclose(np.cos(s.yaw[-1] - problem.goal[2]), 1.0, atol=1e-5):
            faults.append(f"trajectory {i} does not end with the goal's heading")
    ends = {(round(t.states.x[-1], 6), round(t.states.y[-1], 6)) for t in front.trajectories}
    return [*faults, *(["the trajectories end at different places"] if len(ends) > 1 else [])]


def collision_free(problem: Problem, trajectories: Sequence[Trajectory]) -> BoolArray:
    """Whether each trajectory (n,) is free at densely sampled states; states that many share are checked once."""
    free = np.ones(len(trajectories), dtype=bool)
    if not trajectories:
        return free
    samples, owners = [], []
    for i, trajectory in enumerate(trajectories):
        states = _dense(trajectory)
        samples.append(states)
        owners.append(np.full(len(states), i))
    rows, inverse = np.unique(np.round(np.concatenate(samples), 9), axis=0, return_inverse=True)
    checker = SolidCollision(problem.model, problem.world)
    good = checker.free(States(x=rows[:, 0], y=rows[:, 1], yaw=rows[:, 2]))
    np.logical_and.at(free, np.concatenate(owners), good[inverse.ravel()])
    return free


def _dense(trajectory: Trajectory) -> FloatArray:
    """States (N, 3) along the geometry of a trajectory, the yaw in [0, 2 pi)."""
    corners = np.stack([trajectory.states.x, trajectory.states.y, trajectory.states.yaw], axis=1)
    steps = np.diff(corners, axis=0)
    counts = np.maximum(1, np.ceil(np.abs(steps).max(axis=1, initial=0.0) / SPACING - 1e-9)).astype(int)
    pieces = [a + step * np.arange(n)[:, None] / n for a, step, n in zip(corners, steps, counts, strict=False)]
    states = np.concatenate([*pieces, corners[-1:]])
    states[:, 2] %= 2 * np.pi
    return states
