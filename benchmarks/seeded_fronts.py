"""Fronts made by a seed, as large as a page must bear: any number of rows and criteria in a hall with pillars."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import shapely

import hpop
from hpop.base.arrays import FloatArray

# As in hpop's criteria: a name, unit, class and step.
CRITERIA = (
    ("length", "m", "P", 1e-6),
    ("turns", "1", "C", 1.0),
    ("rotation", "rad", "C", 1e-6),
    ("obstruction", "1", "P", 1e-6),
    ("exposure", "s", "R", 1e-6),
    ("clearance", "m", "R", 1e-6),
    ("social_force", "s", "O", 1e-6),
    ("proximity", "s", "O", 1e-6),
)
WIDTH, DEPTH = 24, 14  # m
DISTINCT = 400  # trajectories; rows beyond share them


def hall() -> hpop.World:
    """Return a hall with two rows of pillars and a wall."""
    pillars = [shapely.box(x, y, x + 1, y + 1) for x in range(4, 22, 4) for y in (3.5, 9.5)]
    return hpop.World.from_polygons([*pillars, shapely.box(9, 6.2, 15, 6.6)], extent=shapely.box(0, 0, WIDTH, DEPTH))


def problem(k: int = 5) -> hpop.Problem:
    """From one end of the hall to the other; ``k`` criteria as a front has them, two of them real."""
    return hpop.Problem(
        world=hall(),
        model=hpop.DifferentialDrive(),
        start=(1, 7, 0),
        goal=(23, 7, 0),
        criteria=["length", "turns"][: max(min(k, 2), 1)],
    )


def trajectory(rng: np.random.Generator, model: hpop.DifferentialDrive) -> hpop.Trajectory:
    """Along aisles: places of a coarse grid, so that many trajectories share straight runs."""
    between = [(float(x), float(rng.choice([2, 5, 7.6, 12]))) for x in (3, 7, 11, 15, 19)]
    places = [(1.0, 7.0), *between, (23.0, 7.0)]
    ahead = [float(np.arctan2(b[1] - a[1], b[0] - a[0])) for a, b in pairwise(places)]
    poses = [(*place, yaw) for place, yaw in zip(places[1:], [*ahead[1:], 0.0], strict=True)]
    return hpop.Trajectory.from_poses(model, [(*places[0], 0.0), *poses])


def costs_of(rng: np.random.Generator, n: int, k: int) -> FloatArray:
    """Costs (about n, k), mutually non-dominated but for ties: beneath a concave surface; turns are whole."""
    away = np.abs(rng.normal(size=(n, k)))
    costs = np.asarray(20.0 - 10.0 * away / np.linalg.norm(away, axis=1)[:, None], dtype=np.float64)
    if k > 2:
        costs[:, 1] = np.round(costs[:, 1])
    return costs


def front(n: int, k: int = 5, seed: int = 0, *, of: hpop.Problem | None = None) -> hpop.Front:
    """Return a front of ``n`` rows, or of at most one where k = 1, with the duration reported beside."""
    rng = np.random.default_rng(seed)
    of = of or problem(k)
    made = [trajectory(rng, of.model) for _ in range(min(n, DISTINCT))]
    names, units, groups, quanta = zip(*(CRITERIA[i % len(CRITERIA)] for i in range(k)), strict=True)
    names = tuple(name if i < len(CRITERIA) else f"{name}_{i}" for i, name in enumerate(names))
    tried = n + n // 3  # whole turns leave some dominated
    costs = costs_of(rng, tried, k)
    found = hpop.Front.of(
        costs,
        [made[i % len(made)] for i in range(tried)],
        names=names,
        units=units,
        groups=groups,
        quanta=quanta,
        reported=30.0 + 5.0 * rng.random((tried, 1)),
        reported_names=["duration"],
        reported_units=["s"],
        status="complete",
        certificate=f"exact: no other trajectory of this hall is better in one of {k} criteria and worse in none",
    )
    if len(found) <= n:
        return found
    kept = np.zeros(len(found), dtype=np.bool_)
    kept[rng.permutation(len(found))[:n]] = True
    return replace(found[kept], certificate=found.certificate)
