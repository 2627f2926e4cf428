"""Distances to what a camera sees: closed forms beside walls, shapely rays among random obstacles, cells, heights."""

import math
from functools import partial

import casadi
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hpop.errors import OptionError
from hpop.motions.symbolic import lift
from hpop.world import World
from hpop.world.sight.bearings import MARGIN, REACH, ViewAngles, as_seen, bearings

ANGLES = 2 * np.pi * np.arange(16) / 16


def by_shapely(solid, x, y, angle):
    """Distance along a ray to a solid, at most REACH."""
    ray = shapely.LineString([(x, y), (x + REACH * math.cos(angle), y + REACH * math.sin(angle))])
    hit = shapely.intersection(ray, shapely.boundary(solid))
    return REACH if hit.is_empty else shapely.distance(shapely.Point(x, y), hit)


def numbers(column, **inputs):
    """Return the values of a column of symbols."""
    symbols = [casadi.MX.sym(name, len(value)) for name, value in inputs.items()]
    function = casadi.Function("f", symbols, [casadi.MX(column(*(lift(s, s.numel()) for s in symbols)))])
    return np.array(function(*inputs.values())).ravel()


def test_beside_a_wall_the_distance_is_that_of_the_oblique_ray_exactly():
    world = World.from_polygons([shapely.box(-50, 2, 50, 3)], extent=shapely.box(-10, -3, 10, 3))
    x, y = np.array([0.0, 1.234, -2.0]), np.array([0.0, 1.377, -0.51])
    around = bearings(world, 1.2)
    for b, angle in enumerate(ANGLES):
        expected = (2 - y) / math.sin(angle) if 1e-9 < angle < np.pi - 1e-9 else np.full(3, REACH)
        assert around.distance(b, x, y) == pytest.approx(np.minimum(expected, REACH), abs=1e-9)


def test_in_a_corridor_the_mean_flow_is_a_quarter_of_both_inverse_distances():
    walls = [shapely.box(-50, 1, 50, 2), shapely.box(-50, -2, 50, -1)]
    world = World.from_polygons(walls, extent=shapely.box(-10, -2, 10, 2))
    x, y, still = np.array([0.0, 3.3]), np.array([0.0, 0.37]), np.zeros(2)
    for count in (8, 16, 24):
        around = bearings(world, 1.2, count)
        mean = around.mean_flow(x, y, (1.3 + still, still, 0.0), (0.0, 0.0, still), 0.1)
        # d = w / |sin| on either side, so the flow is v sin² / w, and the mean of sin² over evenly spaced angles 1/2.
        assert mean == pytest.approx(1.3 * 0.25 * (1 / (1 - y) + 1 / (1 + y)), rel=1e-9)
        peak = around.peak_flow(x, y, (1.3 + still, still, 0.0), (0.0, 0.0, still), 0.1)
        assert peak == pytest.approx(1.3 / (1 - np.abs(y)), rel=1e-9)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=settings.default.max_examples // 3)
def test_at_the_nodes_of_its_grid_it_is_what_shapely_finds_along_the_ray(seed):
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, 8, size=(6, 1, 2))
    solids = [shapely.convex_hull(shapely.MultiPoint(c + rng.normal(size=(5, 2)))) for c in corners]
    world = World.from_polygons(solids, extent=shapely.box(0, 0, 8, 6))
    around, union = bearings(world, 1.0), shapely.union_all(solids)
    rows, columns = (n - 4 for n in around.distances.shape[:2])
    for i, j in zip(rng.integers(0, rows, 40), rng.integers(0, columns, 40), strict=True):
        x, y = around.origin[0] + j * around.spacing, around.origin[1] + i * around.spacing
        expected = [0.0 if union.contains(shapely.Point(x, y)) else by_shapely(union, x, y, a) for a in ANGLES]
        assert around.distances[i + 2, j + 2] == pytest.approx(expected, abs=1e-7)


def test_cells_and_the_outside_of_an_image_are_surfaces():
    cells = np.zeros((40, 60), dtype=bool)
    cells[10:30, 40] = True
    world = World.from_cells(cells, 0.1)  # 6 m x 4 m, the outside is obstacle
    x, y = np.array([2.0]), np.array([2.0])
    around = bearings(world, 1.0)
    assert [float(around.distance(b, x, y)[0]) for b in (0, 4, 8, 12)] == pytest.approx([2.0, 2.0, 2.0, 2.0], abs=1e-9)
    seen = as_seen(world, (0, 2)).clearance(np.array([2.0, 3.5, 9.0]), np.array([0.3, 2.0, 2.0]), z=(0, 2))
    assert seen == pytest.approx([0.3, 0.5, 0.0])


def test_above_the_cells_of_a_map_the_outside_is_open_too():
    world = World.from_cells(np.zeros((40, 40), dtype=bool), 0.1, height=(0.0, 1.0))
    x, y = np.array([2.0]), np.array([2.0])
    assert [float(bearings(world, z).distance(0, x, y)[0]) for z in (0.5, 1.5)] == pytest.approx([2.0, REACH])
    assert as_seen(world, (1.2, 1.8)).clearance(x, y, z=(1.2, 1.8)) == pytest.approx([2.0 + MARGIN])


def test_what_is_not_at_the_heights_is_not_seen():
    table, lamp = (shapely.box(4, 0, 6, 4), (0.0, 0.8)), (shapely.box(2, 0, 3, 4), (2.0, 2.5))
    world = World.from_polygons([table, lamp], extent=shapely.box(0, 0, 10, 4))
    x, y = np.array([1.0]), np.array([2.0])
    seen = [float(bearings(world, z).distance(0, x, y)[0]) for z in (0.4, 1.2, 2.2)]
    assert seen == pytest.approx([3.0, REACH, 1.0])
    assert [float(as_seen(world, h).clearance(x, y, z=h)[0]) for h in ((0.7, 1.7), (1.2, 2.2))] == [3, 1]
    assert as_seen(world, (0.9, 1.9)).clearance(x, y, z=(0.9, 1.9)) == pytest.approx([1 + MARGIN])


def test_keep_out_zones_and_open_borders_are_not_seen():
    zone = shapely.box(4, 0, 6, 4)
    world = World.from_polygons([], extent=shapely.box(0, 0, 10, 4), keep_out=zone)
    x, y = np.array([1.0, 5.0]), np.array([2.0, 2.0])
    assert (as_seen(world, (0, 2)).clearance(x, y, z=(0, 2)) > MARGIN).all()
    assert bearings(world, 1.0).distance(0, x, y) == pytest.approx([REACH, REACH])


def test_inside_an_obstacle_the_distance_is_zero_and_the_flow_that_of_the_nearest_allowed():
    world = World.from_polygons([shapely.box(2, 2, 6, 6)], extent=shapely.box(0, 0, 8, 8))
    x = y = np.array([4.0])
    assert as_seen(world, (0, 1)).clearance(x, y, z=(0, 1)) == [0.0]
    around = bearings(world, 1.0)
    assert around.peak_flow(x, y, (np.array([1.0]), 0.0, 0.0), (0.0, 0.0, 0.0), 0.25) == pytest.approx([4.0])


def test_rotation_flows_alike_at_any_depth_and_adds_to_translation():
    world = World.from_polygons([shapely.box(-50, 1, 50, 2)], extent=shapely.box(-5, -2, 5, 2))
    x, y, zero, one = np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1)
    around = bearings(world, 1.0)
    assert around.mean_flow(x, y, (zero, zero, 0.0), (0.0, 0.0, -0.8 * one), 0.1) == pytest.approx([0.8])
    # The wall on the left streams to the rear (its bearing grows by v/d); a turn to the left makes all bearings shrink.
    assert around.peak_flow(x, y, (one, zero, 0.0), (0.0, 0.0, -0.5 * one), 0.1) == pytest.approx([1.5])


def among_boxes(seed):
    """Return a hall with 70 small boxes, and straight moves in it that stay 0.3 m off them: ends and direction."""
    rng = np.random.default_rng(seed)
    boxes = []
    for _ in range(70):
        (x, y), (a, b) = rng.uniform((1, 1), (15, 11)), rng.uniform(0.08, 0.3, 2)
        boxes.append(shapely.affinity.rotate(shapely.box(x - a, y - b, x + a, y + b), rng.uniform(0, 90)))
    hall = shapely.Polygon(shapely.box(-1, -1, 17, 13).exterior, [shapely.box(0, 0, 16, 12).exterior])
    world = World.from_polygons([*boxes, hall], extent=shapely.box(0, 0, 16, 12))
    begin, angle, length = (
        rng.uniform((0.5, 0.5), (15.5, 11.5), (300, 2)),
        rng.uniform(-3, 3, 300),
        rng.uniform(1, 4, 300),
    )
    ahead = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    free = world.segments_free(*begin.T, *(begin + length[:, None] * ahead).T, 0.3)
    return world, begin[free][:8], ahead[free][:8], length[free][:8]


def by_lines(solid, x, y):
    """Distances (M, 16) along ANGLES to a solid, at most REACH: by determinants."""
    ends = [np.diff(shapely.get_coordinates(ring), axis=0) for ring in rings(solid)]
    starts = [shapely.get_coordinates(ring)[:-1] for ring in rings(solid)]
    (px, py), (dx, dy) = np.concatenate(starts).T, np.concatenate(ends).T  # (E,)
    found = np.full((x.size, ANGLES.size), REACH)
    for b, angle in enumerate(ANGLES):
        cos, sin = math.cos(angle), math.sin(angle)
        wx, wy, det = px - x[:, None], py - y[:, None], cos * dy - sin * dx  # (M, E)
        with np.errstate(divide="ignore", invalid="ignore"):
            along, share = (wx * dy - wy * dx) / det, (wx * sin - wy * cos) / det
        hit = (along >= 0) & (share >= 0) & (share <= 1)
        found[:, b] = np.minimum(np.where(hit, along, np.inf).min(axis=1), REACH)
    return found


def rings(solid):
    return [ring for polygon in shapely.get_parts(solid) for ring in (polygon.exterior, *polygon.interiors)]


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(3))
def test_among_obstacles_the_flow_along_a_move_is_that_of_exact_rays(seed):
    world, *moves = among_boxes(seed)
    around, still = bearings(world, 1.0), np.zeros(160)
    errors = []
    for begin, ahead, length in zip(*moves, strict=True):
        x, y = (begin + np.linspace(0, length, 160)[:, None] * ahead).T
        across = np.abs(ahead[0] * around.directions[:, 1] - ahead[1] * around.directions[:, 0])
        exact = (across / np.maximum(by_lines(world.solid(), x, y), 0.3)).mean()
        flow = around.mean_flow(x, y, (ahead[0] + still, ahead[1] + still, 0.0), (0.0, 0.0, still), 0.3).mean()
        errors.append(flow / exact - 1)
    assert abs(np.mean(errors)) < 0.012
    assert np.max(np.abs(errors)) < 0.03


@pytest.mark.cases("mean_flow-None", "mean_flow-1.9", "peak_flow-None", "peak_flow-6.0")
@pytest.mark.parametrize("view", [None, 0.1, 1.9, 6.0])
@pytest.mark.parametrize("flow", ["mean_flow", "peak_flow"])
def test_symbols_get_the_same_flow_as_numbers(flow, view):
    boxes = [shapely.box(1, 1, 2, 3), shapely.box(5, 2, 6, 5)]
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, 8, 6))
    rng = np.random.default_rng(5)
    columns = {"x": rng.uniform(-1, 9, 50), "y": rng.uniform(-1, 7, 50)}
    columns |= {name: rng.normal(size=50) for name in ("vx", "vy", "vz", "wx", "wy", "wz")}
    columns["yaw"] = rng.integers(0, 16, 50) * np.pi / 8 + 0.17  # no edge of the view within 0.02 rad of a sector's
    around = bearings(world, 1.0)

    def evaluate(tilts, x, y, vx, vy, vz, wx, wy, wz, yaw):
        seen = None if view is None else ViewAngles(yaw, view)
        velocity, rotation = (vx, vy, vz if tilts else 0.0), ((wx, wy, wz) if tilts else (0.0, 0.0, wz))
        return getattr(around, flow)(x, y, velocity, rotation, 0.3, seen)

    for tilts in (False, True):
        symbolic = numbers(partial(evaluate, tilts), **columns)
        assert symbolic == pytest.approx(evaluate(tilts, **columns), rel=1e-9)


def by_differences(point, velocity, rotation, moment=1e-6):
    """Angular speed at which the direction of a point changes in the frame of a camera at the origin."""
    angle = np.linalg.norm(rotation) * moment
    back = Rotation.from_rotvec(-np.asarray(rotation) * moment).as_matrix() if angle else np.eye(3)
    before, after = point, back @ (np.asarray(point) - np.asarray(velocity) * moment)
    cross = np.cross(before, after) / (np.linalg.norm(before) * np.linalg.norm(after))
    return np.linalg.norm(cross) / moment


def test_the_flow_is_how_fast_directions_change_on_a_sphere_however_the_camera_moves_and_turns():
    walls = [shapely.box(-50, 1, 50, 2), shapely.box(-50, -2, 50, -1)]
    around = bearings(World.from_polygons(walls, extent=shapely.box(-10, -2, 10, 2)), 1.2)
    x, y = np.zeros(1), np.full(1, 0.4)
    rng = np.random.default_rng(2)
    for twist in rng.normal(size=(20, 6)):
        velocity, rotation = (tuple(part.reshape(3, 1)) for part in (twist[:3], twist[3:]))
        expected = []
        for b, angle in enumerate(ANGLES):
            direction = np.array([math.cos(angle), math.sin(angle), 0.0])
            expected.append(by_differences(float(around.distance(b, x, y)[0]) * direction, twist[:3], twist[3:]))
        assert around.mean_flow(x, y, velocity, rotation, 0.1) == pytest.approx([np.mean(expected)], rel=1e-5)
        assert around.peak_flow(x, y, velocity, rotation, 0.1) == pytest.approx([np.max(expected)], rel=1e-5)


def test_bearings_in_view_count_by_the_share_of_their_sectors():
    world = World.from_polygons([shapely.box(-50, 1, 50, 2)], extent=shapely.box(-5, -2, 5, 2))
    around, sector = bearings(world, 1.0), 2 * np.pi / 16
    place, tilt = (np.zeros(1), np.zeros(1)), ((0.0, 0.0, 0.0), (np.ones(1), 0.0, 0.0))
    flow = np.abs(np.sin(ANGLES))  # of a tilt by 1 rad/s about the x axis
    for yaw, width, shares in (
        (0.0, sector, {0: 1}),
        (0.0, 3 * sector, {15: 1, 0: 1, 1: 1}),
        (0.25 * sector, 3 * sector, {15: 0.75, 0: 1, 1: 1, 2: 0.25}),
        (4.5 * sector, 0.1, {4: 1, 5: 1}),
        (2 * np.pi + 4 * sector, 0.1, {4: 1}),
        (-np.pi, 2 * sector, {7: 0.5, 8: 1, 9: 0.5}),
    ):
        seen = ViewAngles(np.array([yaw]), width)
        expected = sum(share * flow[b] for b, share in shares.items()) / sum(shares.values())
        assert around.mean_flow(*place, *tilt, 0.1, seen) == pytest.approx([expected])
        assert around.peak_flow(*place, *tilt, 0.1, seen) == pytest.approx([max(flow[b] for b in shares)])


def test_not_a_number_stays_not_a_number():
    world = World.from_polygons([shapely.box(2, 2, 6, 4)], extent=shapely.box(0, 0, 8, 6))
    nothing, one = np.array([math.nan]), np.ones(1)
    assert np.isnan(bearings(world, 1.0).mean_flow(nothing, one, (one, one, 0.0), (0.0, 0.0, one), 0.1)).all()


def test_distances_are_computed_once_a_world():
    world = World.from_polygons([shapely.box(2, 2, 6, 4)], extent=shapely.box(0, 0, 8, 6))
    assert bearings(world, 1.0) is bearings(world, 1.4)
    assert bearings(world, 1.0) is not bearings(world, 1.0, 8)
    assert as_seen(world, (0, 1)) is as_seen(world, (0, 2))


@pytest.mark.parametrize(("z", "count"), [(math.nan, 16), (1.0, 3), (math.inf, 16)])
def test_a_height_is_finite_and_bearings_are_several(z, count):
    world = World.from_polygons([], extent=shapely.box(0, 0, 8, 6))
    with pytest.raises(OptionError, match=r"the (height|number) of bearings must be"):
        bearings(world, z, count)
