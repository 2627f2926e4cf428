"""Clearance, free segments, trees and grids of edges: against brute-force distances."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon

from hpop.errors import OptionError
from hpop.world import World
from hpop.world.geometry.planar import LEAF, EdgeGrid, EdgeTree, FreeSpace


def a_world(seed, raster=False):
    rng = np.random.default_rng(seed)
    if raster:
        return World.from_cells(rng.random((9, 13)) < 0.2, 0.4, origin=(1.0, -2.0, 0.5))
    shapes = [
        shapely.convex_hull(shapely.multipoints(rng.uniform(0, 10, 2) + rng.normal(size=(5, 2)))) for _ in range(6)
    ]
    zone = shapely.box(7, 7, 9, 11)
    return World.from_polygons(shapes, extent=shapely.box(0, 0, 10, 10), keep_out=zone)


def squares(raster):
    """Each occupied cell as a polygon."""
    rows, columns = np.nonzero(raster.cells)
    corners = [raster.to_world(columns + i, rows + j) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return shapely.polygons(np.array(corners).transpose(2, 0, 1)).tolist()


def brute_clearance(world, x, y):
    """Distance to the nearest of all that is closed, one by one: no overlay of polygons is trusted."""
    closed = [Polygon(shapely.box(-50, -50, 50, 50).exterior, [world.extent.exterior])]
    closed += [obstacle.polygon for obstacle in world.obstacles] + (
        [] if world.raster is None else squares(world.raster)
    )
    closed += [] if world.keep_out.is_empty else [world.keep_out]
    return shapely.distance(np.array(closed)[:, None], shapely.points(x, y)).min(axis=0)


def random_points(world, n, seed):
    x0, y0, x1, y1 = world.bounds
    return np.random.default_rng(seed).uniform((x0 - 1, y0 - 1), (x1 + 1, y1 + 1), (n, 2)).T


@given(seed=st.integers(0, 1000), raster=st.booleans())
@example(seed=999, raster=True)  # GEOS once lost six of its cells
@settings(max_examples=settings.default.max_examples // 2)
def test_clearance_is_the_distance_to_all_that_is_closed(seed, raster):
    world = a_world(seed, raster)
    x, y = random_points(world, 200, seed)
    assert world.clearance(x, y) == pytest.approx(brute_clearance(world, x, y), abs=1e-9)


@given(seed=st.integers(0, 1000), raster=st.booleans(), margin=st.sampled_from([0.0, 0.05, 0.3, 1.0]))
def test_segments_are_free_where_shapely_says_so(seed, raster, margin):
    world = a_world(seed, raster)
    a, b = random_points(world, 200, seed), random_points(world, 200, seed + 1)
    b = np.where(np.arange(200) % 3 == 0, b, a + 0.2 * (b - a))
    segments = shapely.linestrings(np.stack([a.T, b.T], axis=1))
    region = world.free_space().region
    distance = shapely.distance(region.boundary, segments)
    expected = shapely.covers(region, segments) & (distance >= margin)
    sure = np.abs(distance - margin) > 1e-7
    got = world.segments_free(*a, *b, margin)
    assert (got[sure] == expected[sure]).all()


@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 80), marks=pytest.mark.proof)])
@pytest.mark.parametrize("far", [0.0, 3e3, 5e6])
@pytest.mark.parametrize("as_polygons", [False, True])
def test_turned_cells_that_touch_are_all_taken_from_the_free_space(far, as_polygons, seeds):
    for seed in seeds:
        rng = np.random.default_rng(seed)
        cells = rng.random(rng.integers(3, 14, 2)) < rng.uniform(0.05, 0.6)
        world = World.from_cells(cells, 0.4, origin=(far + 1, -far, rng.uniform(-3, 3)))
        free = 0.16 * (cells.size - cells.sum())
        if as_polygons:
            world = World.from_polygons(squares(world.raster), extent=world.extent)
        assert world.free_space().region.area == pytest.approx(free, abs=0.01)


def test_a_segment_that_just_keeps_its_margin_is_free():
    world = World.from_polygons([shapely.box(0, 2, 10, 3)], extent=shapely.box(0, 0, 10, 3))
    args = np.array([1.0]), np.array([1.0]), np.array([9.0]), np.array([1.0])
    assert world.segments_free(*args, 1.0).tolist() == [True]
    assert world.segments_free(*args, 1.0 + 1e-8).tolist() == [False]


def test_a_segment_along_a_wall_is_free_without_a_margin_but_not_through_it():
    world = World.from_polygons([shapely.box(4, 0, 6, 2)], extent=shapely.box(0, 0, 10, 5))
    x0, y0, x1, y1 = np.array([[1, 2, 9, 2], [1, 1, 9, 1], [1, 0, 3, 0], [1, 1, 1, 1], [5, 1, 5, 1]]).T
    assert world.segments_free(x0, y0, x1, y1, 0.0).tolist() == [True, False, True, True, False]


def test_a_segment_that_jumps_over_a_thin_wall_is_not_free():
    world = World.from_polygons([shapely.box(5, -1, 5.001, 11)], extent=shapely.box(0, 0, 10, 10))
    assert world.segments_free(1.0, 5.0, 9.0, 5.0, 0.0).tolist() == [False]
    assert world.segments_free(1.0, 5.0, 9.0, 5.0, 0.1).tolist() == [False]


def test_hulls_are_free_only_inside_the_region():
    world = World.from_polygons([shapely.box(4, 4, 6, 6)], extent=shapely.box(0, 0, 10, 10))
    shapes = np.array(
        [
            shapely.box(1, 1, 2, 2),
            shapely.box(4.5, 4.5, 5.5, 5.5),
            shapely.box(3, 3, 7, 7),
            shapely.box(20, 20, 21, 21),
        ]
    )
    assert world.free_space().shapes_free(shapes, 0.2).tolist() == [True, False, False, False]
    assert world.free_space().shapes_free(shapes, 0.0).tolist() == [True, False, False, False]
    assert world.free_space().shapes_free(shapes[:1], 1.1).tolist() == [False]


def test_nan_positions_have_nan_clearance_and_are_not_free():
    world = a_world(1)
    nan = np.array([np.nan])
    assert np.isnan(world.clearance(nan, nan)).all()
    assert not world.segments_free(nan, nan, nan, nan, 0.1).any()


def test_a_world_that_is_all_blocked_has_no_clearance_anywhere():
    world = World.from_polygons([shapely.box(-1, -1, 2, 2)], extent=shapely.box(0, 0, 1, 1))
    assert world.clearance(np.array([0.5, 5.0]), np.array([0.5, 5.0])).tolist() == [0.0, 0.0]
    assert world.segments_free(0.2, 0.2, 0.8, 0.8, 0.0).tolist() == [False]
    assert (world.clearance_field().values <= 0).all()


def test_rooms_that_touch_in_a_corner_are_not_connected():
    cells = np.array([[1, 0], [0, 1]], dtype=bool)
    world = World.from_cells(cells, 1.0)
    assert world.clearance(np.array([1.0, 0.5]), np.array([1.0, 1.5])).tolist() == [0.0, 0.5]
    assert world.segments_free(0.5, 1.5, 1.5, 0.5, 0.01).tolist() == [False]


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.8, 1.0])
def test_the_outlines_of_cells_are_those_of_their_union_simplified(share):
    """Point for point; as the squares one by one make it, with another program of GEOS."""
    rng = np.random.default_rng(7)
    for shape in ((1, 9), (12, 1), (13, 17), (30, 30)):
        cells = rng.random(shape) < share
        cells[0, 0] = True
        made = World.from_cells(cells, 1.0).solid()
        rows, columns = np.nonzero(cells)
        expected = shapely.coverage_union_all(shapely.box(columns, rows, columns + 1, rows + 1)).simplify(0.0)
        assert made.is_valid
        assert made.normalize().equals_exact(expected.normalize(), 0.0)


def test_solid_squares_have_exactly_the_area_of_their_cells():
    cells = np.random.default_rng(2).random((30, 40)) < 0.4
    world = World.from_cells(cells, 0.5, origin=(3, 4, 1.0))
    assert world.solid().is_valid
    assert world.solid().area == pytest.approx(cells.sum() * 0.25, rel=1e-12)


def test_heights_choose_what_blocks():
    table = shapely.box(1, 1, 2, 2)
    lamp = shapely.box(3, 1, 4, 2)
    world = World.from_polygons([(table, (0, 0.8)), (lamp, (2.0, 2.5))], extent=shapely.box(0, 0, 5, 5))
    assert world.solid(0, 1).equals(table)
    assert world.solid(0.8, 2.0).is_empty
    assert world.solid().area == 2
    on = np.array([1.5, 3.5]), np.array([1.5, 1.5])
    assert (world.clearance(*on, z=(0, 1)) > 0).tolist() == [False, True]
    assert (world.clearance(*on, z=(1, 3)) > 0).tolist() == [True, False]


def test_the_blueprint_extent_may_have_any_shape():
    el = Polygon([(0, 0), (4, 0), (4, 1), (1, 1), (1, 4), (0, 4)])
    world = World.from_polygons([], extent=el)
    assert world.clearance(np.array([0.5, 2.0]), np.array([0.5, 2.0])).tolist() == [0.5, 0.0]


@pytest.mark.parametrize("margin", [-0.1, float("nan")])
def test_a_margin_must_be_a_distance(margin):
    with pytest.raises(OptionError, match="margin"):
        a_world(0).segments_free(1, 1, 2, 2, margin)


def test_a_height_range_must_be_ordered():
    with pytest.raises(OptionError, match="z_min"):
        a_world(0).clearance(np.zeros(1), np.zeros(1), z=(2, 1))


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.proof)])
def test_clearance_on_a_real_building_agrees_with_brute_force(shared_data, count):
    world = World.from_ros_map(shared_data("pal_office") / "map.yaml")
    x, y = random_points(world, count, 9)
    assert world.clearance(x, y) == pytest.approx(brute_clearance(world, x, y), abs=1e-9)


def test_several_threads_may_ask_one_free_space():
    """GEOS keeps state in a prepared geometry while it is asked; two threads that shared one corrupted memory."""
    rng = np.random.default_rng(0)
    corners = np.stack(np.meshgrid(*[np.arange(50.0)] * 2), -1).reshape(-1, 2) + rng.uniform(0.2, 0.4, (2500, 2))
    boxes = shapely.box(*corners.T, *(corners + 0.3).T)
    space = FreeSpace(shapely.difference(shapely.box(-1, -1, 51, 51), shapely.union_all(boxes)))
    places = rng.uniform(0, 50, (8000, 2))
    shapes = shapely.box(*places.T, *(places + np.array([0.4, 0.2])).T)
    with ThreadPoolExecutor(4) as threads:
        found = np.concatenate([*threads.map(lambda part: space.shapes_free(part, 0.0), np.split(shapes, 8))])
    blocked = shapely.STRtree(boxes).query(shapes, predicate="intersects")[0]
    expected = np.ones(len(shapes), dtype=bool)
    expected[blocked] = False
    assert (found == expected).all()


def brute(edges, x, y):
    p, q = edges[:, :2], edges[:, 2:]
    d = q - p
    length2 = np.maximum((d**2).sum(axis=1), 1e-300)
    w = np.stack([x, y], axis=1)[:, None] - p
    t = np.clip((w * d).sum(axis=2) / length2, 0, 1)
    return np.linalg.norm(w - t[..., None] * d, axis=2).min(axis=1)


@given(seed=st.integers(0, 10_000), count=st.sampled_from([1, 2, 7, 60]), scale=st.sampled_from([0.01, 1, 30]))
def test_distances_are_those_of_the_nearest_edge(seed, count, scale):
    rng = np.random.default_rng(seed)
    starts = rng.uniform(-5, 5, (count, 2))
    edges = np.concatenate([starts, starts + rng.normal(scale=scale, size=(count, 2))], axis=1)
    x, y = rng.uniform(-30, 30, (2, 100))
    assert EdgeTree.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-9)


@pytest.mark.parametrize(
    "edges",
    [
        [[0, 0, 0, 10]],
        [[0, 0, 10, 0], [0, 5, 10, 5]],
        [[3, 3, 3, 3]],
        [[0, 0, 100, 100], [0, 0.5, 0.1, 0.5], [0, 0.6, 0.1, 0.6], [0, 0.7, 0.1, 0.7]],
        [[-9753627.2, 5140874.3, -9753626.2, 5140874.3], [-9753620.0, 5140880.0, -9753620.0, 5140890.0]],
    ],
)
def test_flat_degenerate_long_and_far_away_edges(edges):
    edges = np.array(edges, dtype=float)
    rng = np.random.default_rng(1)
    x, y = edges[0, 0] + rng.uniform(-20, 120, 200), edges[0, 1] + rng.uniform(-20, 120, 200)
    assert EdgeTree.build(edges).distance(x, y) == pytest.approx(brute(edges, x, y), abs=1e-8)


def test_points_on_edges_and_corners_are_at_no_distance():
    lines = np.arange(11.0)
    zero, ten = np.zeros(11), np.full(11, 10.0)
    edges = np.concatenate([np.stack([lines, zero, lines, ten], axis=1), np.stack([zero, lines, ten, lines], axis=1)])
    x, y = (c.ravel() for c in np.meshgrid(lines, lines))
    assert EdgeTree.build(edges).distance(x, y).tolist() == [0.0] * 121
    assert EdgeTree.build(edges).distance(x + 0.5, y + 0.25)[0] == 0.25


def circle(count, radius=10.0):
    angle = np.linspace(0.0, 2 * np.pi, count + 1)
    points = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([points[:-1], points[1:]], axis=1)


def test_inside_an_outline_of_very_many_points_distances_are_those_to_the_circle():
    x, y = (c.ravel() for c in np.meshgrid(np.linspace(-7, 7, 40), np.linspace(-7, 7, 40)))
    found = EdgeTree.build(circle(100_000)).distance(x, y)
    assert found == pytest.approx(10.0 - np.hypot(x, y), abs=1e-7)


def visited(tree, x, y):
    """Boxes that a search for the nearest edge of each point has to look into: no farther than that edge."""
    low, high = tree.boxes[:, :2], tree.boxes[:, 2:]
    reach = tree.distance(x, y)
    for point, most in zip(np.stack([x, y], axis=1), reach, strict=True):
        away = np.maximum(np.maximum(low - point, point - high), 0.0)
        yield np.count_nonzero((away**2).sum(axis=1) <= most**2)


def test_the_work_of_a_point_grows_with_the_square_root_of_the_edges_at_the_most():
    """In a circle, the worst of outlines, nearly all edges are nearly as near. 32 times the edges: 6 times the work."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-7, 7, (2, 200))
    few, many = (np.mean([*visited(EdgeTree.build(circle(count)), x, y)]) for count in (2**12, 2**17))
    assert few > 10
    assert many < 7 * few


def test_every_edge_is_within_its_leaf_and_every_box_within_the_one_above():
    rng = np.random.default_rng(1)
    starts = rng.uniform(-5, 5, (77, 2)) + 1e7
    edges = np.concatenate([starts, starts + rng.normal(size=(77, 2))], axis=1)
    tree = EdgeTree.build(edges)
    assert set(tree.members.ravel()) == set(range(77))
    assert tree.members.shape[1] == LEAF
    above = (np.arange(1, len(tree.boxes)) - 1) // 2
    assert (tree.boxes[above, :2] <= tree.boxes[1:, :2]).all()
    assert (tree.boxes[above, 2:] >= tree.boxes[1:, 2:]).all()


@pytest.mark.parametrize("count", [1, 2, 9, 200])
def test_edges_in_a_row_have_no_more_buckets_than_they_are(count):
    """Else a ray goes through thousands of empty ones."""
    ends = np.linspace(0.0, 10.0, count + 1)
    for flat in (0.0, 1e-3):
        edges = np.stack([ends[:-1], 0.0 * ends[1:], ends[1:], flat + 0.0 * ends[1:]], axis=1)
        assert EdgeGrid.build(edges).start.size <= count + 2
        assert EdgeGrid.build(edges[:, [1, 0, 3, 2]]).start.size <= count + 2
