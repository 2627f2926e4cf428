"""Fronts of any size, made by a seed: trajectories through the museum that share few of their motions."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np

import hpop
from hpop.motions import States

CRITERIA = ("exposure", "turns", "length", "rotation", "clearance")
UNITS = ("s", "1", "m", "rad", "m")


@cache
def seeded(n: int, seed: int = 7) -> tuple[hpop.Problem, hpop.Front]:
    """Return n mutually non-dominated cost vectors, with paths of 5 to 12 runs in steps of about 0.25 m."""
    rng = np.random.default_rng(seed)
    model = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    world = hpop.World.from_geojson(hpop.examples.path("museum.geojson"))
    problem = hpop.Problem(world, model, (2, 10, 0), (28, 10, 0), CRITERIA)
    away = np.abs(rng.normal(size=(n, len(CRITERIA))))
    costs = 20.0 - 10.0 * away / np.linalg.norm(away, axis=1)[:, None]  # concave, so that all are non-dominated
    front = hpop.Front.of(
        costs,
        [_way(model, rng) for _ in range(n)],
        names=CRITERIA,
        units=UNITS,
        quanta=[1e-6] * len(CRITERIA),
        groups="PCCCR",
        reported=0.7 * costs[:, :1],
        reported_names=["obstruction"],
        reported_units=["1"],
        certificate=f"made by the seed {seed}",
        problem=problem.describe(),
    )
    assert len(front) == n
    return problem, front


def _way(model: hpop.DifferentialDrive, rng: np.random.Generator) -> hpop.Trajectory:
    """From left to right over places of a grid of 0.25 m, straight from each to the next."""
    x = 0.25 * np.sort(rng.choice(np.arange(9, 112), size=rng.integers(4, 12), replace=False))
    y = 0.25 * rng.integers(2, 78, size=x.size)
    places = [(2.0, 10.0), *zip(x.tolist(), y.tolist(), strict=True), (28.0, 10.0)]
    columns, kinds, yaw = [(2.0, 10.0, 0.0)], list[str](), 0.0
    for (x0, y0), (x1, y1) in pairwise(places):
        heading = float(np.arctan2(y1 - y0, x1 - x0))
        if heading != yaw:
            columns.append((x0, y0, heading))
            kinds.append("turn")
            yaw = heading
        steps = max(1, round(np.hypot(x1 - x0, y1 - y0) / 0.25))
        columns += [(x0 + (x1 - x0) * i / steps, y0 + (y1 - y0) * i / steps, yaw) for i in range(1, steps + 1)]
        kinds += ["move"] * steps
    table = np.array(columns).T
    return hpop.Trajectory(model, States(x=table[0], y=table[1], yaw=table[2]), tuple(kinds))
