"""Obstruction in closed form, on cells and by rays: against published values, Monte Carlo and each other."""

from __future__ import annotations

import math
import tracemalloc

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shapely.geometry import Polygon

from hpop.world import Obstacle, Raster, World
from hpop.world.fields import obstruction
from hpop.world.fields import obstruction as module
from hpop.world.fields.obstruction import RasterBalls, SolidBalls, disjoint_prisms, filled, polygon_obstruction
from hpop.world.geometry.rays_in_space import Surfaces
from hpop.world.geometry.solids import Box, Cylinder, Solid, Sphere, pose_at


def one(obstacles, radius=2.0, x=0.0, y=0.0, z=0.0):
    return float(polygon_obstruction(obstacles, x, y, z, radius)[0])


def monte_carlo(obstacles, radius, centre, samples=200_000, seed=0):
    """Share of random points of the ball inside any obstacle."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(samples, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = centre + radius * rng.random((samples, 1)) ** (1 / 3) * directions
    inside = np.zeros(samples, dtype=bool)
    for o in obstacles:
        level = (points[:, 2] > o.z_min) & (points[:, 2] < o.z_max)
        inside |= level & shapely.contains_xy(o.polygon, points[:, 0], points[:, 1])
    return inside.mean()


@pytest.mark.parametrize("d", [0.0, 0.3, 1.0, 1.9, 2.0, 2.5])
def test_a_half_space_takes_the_volume_of_a_spherical_cap(d):
    r = 2.0
    expected = (r - d) ** 2 * (2 * r + d) / (4 * r**3) if d < r else 0.0
    assert one([Obstacle(shapely.box(d, -30, 30, 30))]) == pytest.approx(expected, abs=1e-12)


def test_the_published_half_space_and_corridor_values():
    walls = [Obstacle(shapely.box(1, -9, 9, 9)), Obstacle(shapely.box(-9, -9, -1, 9))]
    assert one(walls[:1]) == pytest.approx(0.15625, abs=1e-12)
    assert one(walls) == pytest.approx(0.3125, abs=1e-12)


def test_the_published_triangle_value():
    assert one([Obstacle(Polygon([(0.3, 0.4), (1.7, -0.2), (1.1, 1.5)]))]) == pytest.approx(0.092505, abs=5e-7)


@pytest.mark.parametrize(("low", "high"), [(0.5, math.inf), (-0.5, 0.5), (-1.5, 1.0), (1.2, 1.7)])
def test_a_layer_round_the_camera_takes_the_volume_of_a_spherical_segment(low, high):
    # Volume of a ball between two heights: pi (r^2 z - z^3 / 3).
    r = 2.0
    a, b = (min(max(v, -r), r) for v in (low, high))
    expected = (r * r * (b - a) - (b**3 - a**3) / 3) * 3 / (4 * r**3)
    assert one([Obstacle(shapely.box(-9, -9, 9, 9), low, high)]) == pytest.approx(expected, abs=1e-12)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=settings.default.max_examples // 4)
def test_random_prisms_agree_with_monte_carlo(seed):
    rng = np.random.default_rng(seed)
    prisms = []
    for _ in range(5):
        outline = shapely.convex_hull(shapely.multipoints(rng.normal(scale=1.2, size=(5, 2))))
        z_min = rng.uniform(-2, 1)
        prisms.append(Obstacle(outline, z_min, z_min + rng.uniform(0.2, 2)))
    centre = rng.normal(scale=0.3, size=3)
    expected = monte_carlo(prisms, 1.5, centre, seed=seed)
    assert one(prisms, 1.5, *centre) == pytest.approx(expected, abs=0.006)  # > 5 standard errors


def test_holes_are_free_and_overlaps_count_once():
    ring = Polygon(shapely.box(-5, -5, 5, 5).exterior, [shapely.box(-1, -1, 1, 1).exterior])
    plug = Obstacle(shapely.box(-1.5, -1.5, 1.5, 1.5))
    assert 0 < one([Obstacle(ring)]) < 1
    assert one([Obstacle(ring), plug]) == pytest.approx(1.0, abs=1e-12)


def test_overlapping_prisms_become_disjoint_ones_of_the_same_volume():
    a = Obstacle(shapely.box(0, 0, 2, 2), 0.0, 2.0)
    b = Obstacle(shapely.box(1, 0, 3, 2), 1.0, 3.0)
    geometries, heights = disjoint_prisms([a, b])
    volume = sum(g.area * (top - bottom) for g, (bottom, top) in zip(geometries, heights, strict=True))
    assert volume == pytest.approx(8 + 8 - 2)


def test_far_parts_of_a_large_polygon_and_other_tiles_change_nothing():
    long_wall = Obstacle(shapely.box(1, -500, 500, 500))
    x = np.array([0.0, 3.7, -60.0])
    expected = [one([Obstacle(shapely.box(1, v - 3, 9, v + 3))], x=u, y=v) for u, v in zip(x, x, strict=True)]
    assert polygon_obstruction([long_wall], x, x, 0.0, 2.0) == pytest.approx(expected, abs=1e-12)


def test_no_obstacles_and_no_points_are_fine():
    assert polygon_obstruction([], np.zeros(3), np.zeros(3), 0.0, 1.0).tolist() == [0, 0, 0]
    assert polygon_obstruction([Obstacle(shapely.box(0, 0, 1, 1))], [], [], [], 1.0).size == 0


def values_of(raster, radius, camera_z, outside_is_obstacle):
    balls = RasterBalls(raster, radius, camera_z, outside_is_obstacle)
    assert max(balls.shape) <= balls.side  # one tile is the whole map
    return balls.values(*(slice(0, size) for size in balls.shape))


@pytest.mark.parametrize("resolution", [0.05, 0.25, 1.0])
def test_cells_agree_with_the_polygons_of_their_squares_at_any_resolution(resolution):
    rng = np.random.default_rng(3)
    shape = (12, 17)
    raster = Raster(rng.random(shape) < 0.3, resolution, (1.0, -2.0, 0.7), 0.1, 1.4)
    radius = 3.3 * resolution
    squares = [Obstacle(part, 0.1, 1.4) for part in shapely.get_parts(raster.solid())]
    x, y = raster.to_world(*(c.ravel() + 0.5 for c in np.meshgrid(np.arange(17), np.arange(12))))
    expected = polygon_obstruction(squares, x, y, 0.9, radius).reshape(shape)
    assert values_of(raster, radius, 0.9, False) == pytest.approx(expected, abs=1e-9)


def test_the_outside_of_an_image_is_obstacle_or_not_as_asked():
    empty = Raster(np.zeros((9, 9), dtype=bool), 0.5)
    assert values_of(empty, 1.0, 0.0, False).max() == 0.0
    phi = values_of(empty, 1.0, 0.0, True)
    assert phi[4, 4] == 0.0
    d = 0.25
    assert phi[4, 0] == pytest.approx((1 - d) ** 2 * (2 + d) / 4, abs=1e-9)


def test_raster_values_are_exactly_zero_or_one_where_they_should_be():
    cells = np.zeros((40, 80), dtype=bool)
    cells[:, 40:] = True
    phi = values_of(Raster(cells, 0.1), 0.5, 0.0, False)
    assert (phi[10:30, :34] == 0.0).all()
    assert phi[20, 60] == pytest.approx(1.0, abs=1e-12)
    assert ((phi >= 0) & (phi <= 1)).all()


def test_chains_of_touching_polygons_are_one_prism_each_in_whatever_order_they_come():
    boxes = [Obstacle(shapely.box(i, 3 * j, i + 1, 3 * j + 1)) for j in range(3) for i in range(40)]
    order = np.random.default_rng(0).permutation(len(boxes))
    geometries, _ = disjoint_prisms([boxes[i] for i in order])
    assert sorted(g.bounds for g in geometries) == [(0.0, y, 40.0, y + 1.0) for y in (0.0, 3.0, 6.0)]


def test_thousands_of_overlapping_polygons_are_grouped_without_a_table_of_all_pairs():
    boxes = [shapely.box(x, 0, x + 3, 1) for x in np.linspace(0, 1, 1500)] + [shapely.box(9, 0, 10, 1)]
    tracemalloc.start()
    groups = obstruction._groups(boxes)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert [group.tolist() for group in groups] == [list(range(1500)), [1500]]
    assert taken < 25e6  # all pairs are 36 MB


def test_chains_of_touching_polygons_are_one_group_whatever_their_order():
    rng = np.random.default_rng(0)
    starts = np.array([*range(900), *range(1000, 1400)])
    order = rng.permutation(starts.size)
    groups = obstruction._groups([shapely.box(x, 0, x + 1, 1) for x in starts[order].tolist()])
    assert sorted(sorted(starts[order[group]].tolist()) for group in groups) == [
        list(range(900)),
        list(range(1000, 1400)),
    ]


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
    share = SolidBalls(Surfaces.of([Solid(Box(tuple(radius * np.array([100.0, 999.0, 999.0]))), wall)]), radius)(
        place[None]
    )
    u = min(1.0, max(-1.0, off))
    assert share[0] == pytest.approx((1 - u) ** 2 * (2 + u) / 4, abs=4e-3)


@pytest.mark.parametrize("radius", [0.2, 1.0])
def test_it_is_what_many_rays_find(radius):
    np.testing.assert_allclose(SolidBalls(SOME, radius)(PLACES), SOME.filled(PLACES, radius, 20_000), atol=5e-3)


def test_a_place_has_one_share_whoever_asks_and_whatever_is_forgotten(monkeypatch):
    """Bit for bit: costs of edges and of trajectories are of different batches."""
    together = SolidBalls(SOME, 0.5)(PLACES)
    alone = SolidBalls(SOME, 0.5)
    assert [float(alone(place[None])[0]) for place in PLACES[::-1]] == together[::-1].tolist()
    monkeypatch.setattr(module, "MOST", 200)
    forgets = SolidBalls(SOME, 0.5)
    assert [float(forgets(place[None])[0]) for place in PLACES] == together.tolist()
    assert forgets.nbytes <= 200 * 16 < alone.nbytes


def test_it_is_kept_with_the_ground():
    world = World.from_solids([Solid(Sphere(0.5), np.eye(4), "ball")])
    assert filled(world, 1.0) is filled(world, 1.0)
    assert filled(world, 1.0) is not filled(world, 2.0)


def test_nothing_is_filled_where_nothing_is():
    assert SolidBalls(Surfaces.of([]), 1.0)(PLACES).tolist() == [0.0] * len(PLACES)
    assert SolidBalls(SOME, 0.1)(np.array([[1e9, 0.0, 0.0], [0.0, -1e12, 0.0]])).tolist() == [0.0, 0.0]
