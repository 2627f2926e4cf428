"""An integral frees its memory: millions of motions are integrated between two garbage collections."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import shapely

import hpop
from hpop.base.arrays import Column
from hpop.motions.bodies import Instants
from hpop.world import Person, World


def test_moments_are_freed_as_soon_as_their_rate_is_known() -> None:
    extent = shapely.box(0, 0, 10, 10)
    world = World.from_polygons([], extent=extent).with_content(people=[Person(1, 1, velocity=(1, 0))])
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (1, 5, 0), (9, 5, 0), ["length"])
    trajectory = hpop.Trajectory.from_poses(problem.model, [(1, 5, 0), (9, 5, 0)])
    made: list[weakref.ref[Instants]] = []

    def rate(s: Instants) -> Column:
        made.append(weakref.ref(s))
        x, y, *_ = s.twist("camera").velocity
        return s.t + s.camera.x + np.hypot(x, y) + s.twist_rate("camera").velocity[0]

    gc.disable()
    try:
        for _, motions in trajectory.batches(problem.world):
            motions.integrate(rate)
            motions.worst(rate)
        assert made
        assert all(moment() is None for moment in made)
    finally:
        gc.enable()
