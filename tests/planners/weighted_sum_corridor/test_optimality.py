"""Lengths through corridors are minimal by a solver that shares no code with the planner's."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize

import hpop
from hpop.planners import WeightedSumCorridor
from hpop.planners.programs.corridor.corridor import corridors
from hpop.planners.programs.polyline import Polyline
from tests.planners.perturbed import random_question


def least_length(corridor):
    """By sequential quadratic programming over the vertices, each in its overlap, on its ray where a heading asks."""
    ends, last, limits = corridor.warm.vertices[[0, -1]], corridor.segments - 2, []
    for i, overlap in enumerate(corridor.overlaps):
        limits.append({"type": "ineq", "fun": lambda z, i=i, o=overlap: o.offsets - o.normals @ z.reshape(-1, 2)[i]})
    rays = [(0, ends[0], corridor.warm.start_yaw)] if corridor.along_first else []
    rays += [(last, ends[1], corridor.warm.goal_yaw + math.pi)] if corridor.along_last else []
    for i, end, yaw in rays:
        ahead, aside = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        limits.append({"type": "eq", "fun": lambda z, i=i, e=end, d=aside: d @ (z.reshape(-1, 2)[i] - e)})
        limits.append({"type": "ineq", "fun": lambda z, i=i, e=end, d=ahead: d @ (z.reshape(-1, 2)[i] - e)})

    def length(z):
        steps = np.diff(np.vstack([ends[:1], z.reshape(-1, 2), ends[1:]]), axis=0)
        return np.sqrt((steps**2).sum(axis=1) + 1e-10).sum()

    found = minimize(length, corridor.warm.vertices[1:-1].ravel(), method="SLSQP", constraints=limits)
    assert found.success
    return found.fun


@pytest.mark.parametrize("seed", [5, 6, *(pytest.param(s, marks=pytest.mark.proof) for s in range(10, 25))])
def test_no_path_through_a_corridor_is_shorter(seed):
    _, problem, _ = random_question(seed)
    problem = hpop.Problem(problem.world, problem.model, problem.start, problem.goal, ["length", "turns"])
    try:
        warm = problem.solve("lattice", step=0.5).trajectories
    except hpop.errors.QueryError:  # the start or the goal is blocked
        return
    if not warm:
        return
    found = WeightedSumCorridor(warm_start=list(warm)).solve(problem)
    through, _ = corridors([Polyline.of(trajectory, problem) for trajectory in warm], problem)
    assert len(found.trajectories)
    for planned, origin in zip(found.planned, found.provenance, strict=True):
        corridor = through[origin["corridor"]]
        if not corridor.is_fixed:
            assert planned[0] <= least_length(corridor) * (1 + 1e-3)
