"""A small world with three ways round its obstacles, and the front of hand-made trajectories through it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest
import shapely
from matplotlib import rcParams

import hpop
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_costs

WAYS = {
    "straight": [(1, 1), (9, 1)],
    "bent": [(1, 1), (3, 0.5), (7, 0.5), (9, 1)],
    "wide": [(1, 1), (1, 6), (9, 6), (9, 1)],
    "wider": [(1, 1), (1, 7), (9, 7), (9, 1)],
    "slant": [(1, 1), (2.5, 6), (7.5, 6), (9, 1)],
}


def through(model: hpop.DifferentialDrive, points: Sequence[tuple[float, float]]) -> hpop.Trajectory:
    """From heading 0 through the points, straight from one to the next, to heading 0."""
    ahead = [float(np.arctan2(b[1] - a[1], b[0] - a[0])) for a, b in pairwise(points)]
    return hpop.Trajectory.from_poses(
        model, [(*points[0], 0.0), *((x, y, yaw) for (x, y), yaw in zip(points[1:], [*ahead[1:], 0.0], strict=True))]
    )


@pytest.fixture(scope="session")
def world() -> hpop.World:
    wall, table, beam = shapely.box(4, 1.5, 6, 4.5), shapely.box(2, 3, 3, 4), shapely.box(7, 5, 8, 6)
    return hpop.World.from_polygons(
        [wall, (table, (0.0, 0.8)), (beam, (2.0, 2.5))],
        extent=shapely.box(0, 0, 10, 8),
        keep_out=shapely.box(0, 7.5, 2, 8),
    )


@pytest.fixture(scope="session")
def trajectory() -> hpop.Trajectory:
    """Round the wall, with a turn at each corner and at both ends."""
    return hpop.Trajectory.from_poses(hpop.DifferentialDrive(), [(1, 1, 0), (1, 6, 0), (9, 6, 0), (9, 1, 0)])


MakeProblem = Callable[..., hpop.Problem]
MakeFront = Callable[..., hpop.Front]


@pytest.fixture(scope="session")
def make_problem(world: hpop.World) -> MakeProblem:
    def make(criteria: Sequence[str] = ("turns", "length"), **changes: object) -> hpop.Problem:
        options = {"world": world, "model": hpop.DifferentialDrive(), "start": (1, 1, 0), "goal": (9, 1, 0)}
        return hpop.Problem(**{**options, "criteria": list(criteria), **changes})  # type: ignore[arg-type]

    return make


@pytest.fixture(scope="session")
def make_front() -> MakeFront:
    """Front of a problem's hand-made trajectories; all of them, if ``costs`` are given for them."""

    def make(problem: hpop.Problem, costs: np.ndarray | None = None, status: str = "complete") -> hpop.Front:
        ways = [through(problem.model, points) for points in WAYS.values()]
        if costs is not None:
            ways = [ways[i % len(ways)] for i in range(len(costs))]
        mean = [make_criterion("obstruction")]
        return hpop.Front.of(
            trajectory_costs(problem.criteria, ways, problem.world) if costs is None else costs,
            ways,
            names=[c.name for c in problem.criteria],
            units=[c.unit for c in problem.criteria],
            quanta=[c.quantum for c in problem.criteria],
            reported=trajectory_costs(mean, ways, problem.world),
            reported_names=["obstruction"],
            reported_units=["1"],
            status=status,
            certificate="made by hand",
        )

    return make


@pytest.fixture(autouse=True)
def _style_is_left_alone():
    before = dict(rcParams)
    yield
    assert dict(rcParams) == before
