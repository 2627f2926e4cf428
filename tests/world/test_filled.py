"""The share of a ball that bodies fill, read from a grid: that of the cap, and whoever asks for it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hpop.world import World
from hpop.world.fields import obstruction as module
from hpop.world.fields.obstruction import Filled, filled
from hpop.world.geometry.rays_in_space import Surfaces
from hpop.world.geometry.solids import Box, Cylinder, Solid, Sphere, pose_at

SOME = Surfaces.of(
    [
        Solid(Box((0.4, 3.0, 2.0)), pose_at((1.0, 0.2, 0.1))),
        Solid(Cylinder(0.3, 1.2), pose_at((-0.5, 0.7, 0.2))),
        Solid(Sphere(0.4), pose_at((0.1, -0.6, 0.8))),
    ]
)
PLACES = np.random.default_rng(2).uniform(-1.5, 1.5, (40, 3))


@given(st.integers(0, 1000), st.floats(-1.2, 1.2), st.floats(0.1, 3.0))
def test_beside_a_wall_it_is_that_of_the_cap(seed, off, radius):
    """(1 - u)² (2 + u) / 4 of a ball whose centre is u radii before a wall, whichever way that stands."""
    rng, wall = np.random.default_rng(seed), np.eye(4)
    wall[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    normal = wall[:3, 0].copy()
    wall[:3, 3] = 50.0 * radius * normal
    place = (-off * radius) * normal + wall[:3, 1:3] @ rng.uniform(-radius, radius, 2)
    share = Filled(Surfaces.of([Solid(Box(tuple(radius * np.array([100.0, 999.0, 999.0]))), wall)]), radius)(
        place[None]
    )
    u = min(1.0, max(-1.0, off))
    assert share[0] == pytest.approx((1 - u) ** 2 * (2 + u) / 4, abs=4e-3)


@pytest.mark.parametrize("radius", [0.2, 1.0])
def test_it_is_what_many_rays_find(radius):
    np.testing.assert_allclose(Filled(SOME, radius)(PLACES), SOME.filled(PLACES, radius, 20_000), atol=5e-3)


def test_a_place_has_one_share_whoever_asks_and_whatever_is_forgotten(monkeypatch):
    """Bit for bit: costs of edges and of trajectories are of different batches."""
    together = Filled(SOME, 0.5)(PLACES)
    alone = Filled(SOME, 0.5)
    assert [float(alone(place[None])[0]) for place in PLACES[::-1]] == together[::-1].tolist()
    monkeypatch.setattr(module, "MOST", 200)
    forgets = Filled(SOME, 0.5)
    assert [float(forgets(place[None])[0]) for place in PLACES] == together.tolist()
    assert forgets.nbytes <= 200 * 16 < alone.nbytes


def test_it_is_kept_with_the_ground():
    world = World.from_solids([Solid(Sphere(0.5), np.eye(4), "ball")])
    assert filled(world, 1.0) is filled(world, 1.0)
    assert filled(world, 1.0) is not filled(world, 2.0)


def test_nothing_is_filled_where_nothing_is():
    assert Filled(Surfaces.of([]), 1.0)(PLACES).tolist() == [0.0] * len(PLACES)
    assert Filled(SOME, 0.1)(np.array([[1e9, 0.0, 0.0], [0.0, -1e12, 0.0]])).tolist() == [0.0, 0.0]
