"""Lines of sight and isovists: against lines cut by shapely, closed forms, Monte Carlo and each other."""

import tracemalloc
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
import pytest
import shapely
from shapely import affinity

from hpop.errors import OptionError
from hpop.motions.symbolic import lift
from hpop.world import Ground, World
from hpop.world.content.content import Landmark
from hpop.world.sight.bearings import bearing
from hpop.world.sight.visibility import (
    _grid,
    landmark_field,
    landmarks_unseen,
    line_of_sight,
    openness,
    openness_field,
    sees,
)

HALL = shapely.box(0, 0, 12, 8)


@dataclass
class Camera:
    x: Any
    y: Any
    z: Any = 1.2
    yaw: Any = 0.0


def hidden(prisms, landmark, x, y, z):
    """Return True if a prism holds a part of the line from landmark to camera, by cutting the line at its heights."""
    for polygon, (bottom, top) in prisms:
        low, high = 0.0, 1.0
        if z == landmark.z:
            if not bottom < z < top:
                continue
        else:
            low, high = np.clip(
                sorted(((bottom - landmark.z) / (z - landmark.z), (top - landmark.z) / (z - landmark.z))), 0, 1
            )
        ends = [(landmark.x + t * (x - landmark.x), landmark.y + t * (y - landmark.y)) for t in (low, high)]
        if high > low and shapely.intersection(shapely.LineString(ends), polygon).length > 1e-9:
            return True
    return False


def random_prisms(rng, count=14):
    prisms = []
    for _ in range(count):
        x, y, a, b = rng.uniform((1, 1, 0.1, 0.1), (11, 7, 1.2, 1.2))
        bottom = rng.choice([0.0, rng.uniform(0.5, 1.5)])
        box = affinity.rotate(shapely.box(x, y, x + a, y + b), rng.uniform(0, 90))
        prisms.append((box, (bottom, bottom + rng.uniform(0.3, 1.5))))
    return prisms


def samples(field, world):
    """Return samples that are not cut by the border of a shadow, with their places."""
    xs, ys, _ = _grid(world)
    rows, columns = np.nonzero((field.values == 0) | (field.values > 1 - 1e-12))
    return xs[columns], ys[rows], field.values[rows, columns]


@pytest.mark.cases("0.4-0", "0.4-2", "1.2-1", "1.2-3", "2.3-5")
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("height", [0.4, 1.2, 2.3])
def test_lines_of_sight_are_those_that_no_prism_cuts(seed, height):
    rng = np.random.default_rng(seed)
    prisms = random_prisms(rng)
    world = World.from_polygons(prisms, extent=HALL)
    landmark = Landmark(0.53, 0.47, z=height)  # in a free corner
    x, y, sight = samples(line_of_sight(world, landmark, 1.2), world)
    assert 0.1 < sight.mean() < 0.999
    for i in rng.integers(0, x.size, 250):
        assert hidden(prisms, landmark, x[i], y[i], 1.2) == (sight[i] == 0), (x[i], y[i])


@pytest.mark.parametrize("heights", [(0.0, 2.0), (0.0, 1.0), (1.4, 3.0)])
def test_cells_of_a_turned_map_hide_like_their_squares(heights):
    rng = np.random.default_rng(4)
    cells = rng.random((20, 30)) < 0.12
    cells[:3, :3] = False
    world = World.from_cells(cells, 0.25, origin=(2.0, -1.0, 0.4), height=heights, outside_is_obstacle=False)
    squares = []
    for row, column in zip(*np.nonzero(cells), strict=True):
        corners = [(column + i, row + j) for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        squares.append((shapely.Polygon([world.raster.to_world(u, v) for u, v in corners]), heights))
    x, y = world.raster.to_world(1.5, 1.5)
    landmark = Landmark(float(x), float(y), z=1.7)
    x, y, sight = samples(line_of_sight(world, landmark, 1.2), world)
    for i in rng.integers(0, x.size, 200):
        assert hidden(squares, landmark, x[i], y[i], 1.2) == (sight[i] == 0), (x[i], y[i])


def test_a_wall_of_many_pieces_has_a_shadow_without_gaps():
    pieces = [(shapely.box(4, 0.1 * i, 4.01, 0.1 * (i + 1)), (0.0, 3.0)) for i in range(80)]
    world = World.from_polygons(pieces, extent=HALL)
    for place in [(1.0, 4.0), (0.35, 2.1), (3.999, 4.0)]:
        x, _, sight = samples(line_of_sight(world, Landmark(*place), 1.2), world)
        inside = (x > 4.15) & (x < 11.9)
        rows = (_ > 0.3) & (_ < 7.7)
        assert (sight[inside & rows] == 0).all()
        assert (sight[x < 3.9] == 1).all()


def test_what_contains_a_landmark_does_not_hide_it():
    case = (shapely.box(5, 3, 6, 4), (0.0, 2.0))
    other = (shapely.box(8, 3, 8.5, 4), (0.0, 2.0))
    sight = line_of_sight(World.from_polygons([case, other], extent=HALL), Landmark(5.5, 3.5, z=1.5), 1.2)
    assert sight([2.0, 5.5, 7.5, 10.0], [3.5, 7.0, 3.5, 3.5]) == pytest.approx([1, 1, 1, 0])


def test_a_hollow_container_hides_where_the_line_enters_it_again():
    # A landmark in the foot of a U: its arms stand in the way, its foot does not.
    u = shapely.Polygon([(3, 2), (9, 2), (9, 6), (8, 6), (8, 3), (4, 3), (4, 6), (3, 6)])
    sight = line_of_sight(World.from_polygons([u], extent=HALL), Landmark(6, 2.5), 1.2)
    assert sight([6.0, 6.0, 11.0, 1.0], [5.0, 0.5, 5.0, 5.0]) == pytest.approx([1, 1, 0, 0])


def test_a_pedestal_hides_what_stands_on_it_from_below_only():
    pedestal = (shapely.box(5.5, 3.5, 6.5, 4.5), (0.0, 1.0))
    world = World.from_polygons([pedestal], extent=HALL)
    # From z = 0.5 the line to z = 1.5 is above the pedestal beyond its border from 1 m off on.
    low = line_of_sight(world, Landmark(6, 4, z=1.5), 0.5)
    assert low([6.8, 7.3], [4.0, 4.0]) == pytest.approx([0, 1], abs=1e-12)
    assert line_of_sight(world, Landmark(6, 4, z=1.5), 1.2)([6.8, 7.3], [4.0, 4.0]) == pytest.approx([1, 1])


def test_a_low_wall_hides_a_low_landmark_where_similar_triangles_say():
    # Landmark 0.5 m, wall 1 m high and 2 m off, camera 1.5 m: the line is 1 m high half way.
    world = World.from_polygons([(shapely.box(3, 0, 3.01, 8), (0.0, 1.0))], extent=HALL)
    sight = line_of_sight(world, Landmark(1, 4, z=0.5), 1.5)
    assert sight([3.5, 4.7, 5.3, 8.0], [4.0] * 4) == pytest.approx([1, 1, 0, 0])


def test_what_is_above_or_below_both_ends_hides_nothing():
    prisms = [(shapely.box(3, 0, 4, 8), (0.0, 0.7)), (shapely.box(6, 0, 7, 8), (2.0, 3.0))]
    sight = line_of_sight(World.from_polygons(prisms, extent=HALL), Landmark(1, 4, z=1.5), 1.2)
    assert sight(np.linspace(0, 12, 50), np.linspace(0, 8, 50)) == pytest.approx(1.0)


def test_outside_hides_only_where_it_is_obstacle():
    corner = shapely.Polygon([(0, 0), (12, 0), (12, 3), (3, 3), (3, 8), (0, 8)])
    far_apart = ([10.0], [1.5])
    for outside, seen in ((False, 1.0), (True, 0.0)):
        world = World(Ground(extent=corner, outside_is_obstacle=outside))
        assert line_of_sight(world, Landmark(1.5, 7), 1.2)(*far_apart) == pytest.approx(seen)
        assert line_of_sight(world, Landmark(1.5, 7), 1.2)([1.5], [1.5]) == pytest.approx(1.0)


def test_the_quality_of_a_view_is_angle_times_distance():
    world = World.from_polygons([], extent=HALL).with_content(
        landmarks=[Landmark(2, 4, z=1.2, facing=0.0), Landmark(2, 4, z=1.2)]
    )
    x, y = np.array([4.0, 5.0, 1.0, 8.0]), np.array([4.0, 7.0, 4.0, 4.0])
    distance = np.hypot(x - 2, y - 4)
    fade = np.clip((7 - distance) / (7 - 3), 0, 1)
    assert landmark_field(world, 1, 1.2, 3.0, 7.0)(x, y) == pytest.approx(fade, abs=1e-3)
    cosine = np.maximum((x - 2) / distance, 0)
    assert landmark_field(world, 0, 1.2, 3.0, 7.0)(x, y) == pytest.approx(fade * cosine, abs=1e-3)


def museum(seed=3):
    rng = np.random.default_rng(seed)
    marks = [
        Landmark(*rng.uniform((1, 1), (11, 7)), facing=facing, weight=weight)
        for facing, weight in zip([None, 0.3, -2.0, 1.7], [1.0, 3.0, 0.5, 2.0], strict=True)
    ]
    return World.from_polygons(random_prisms(rng, 6), extent=HALL).with_content(landmarks=marks)


def cameras(rng, count):
    x, y = rng.uniform((0.5, 0.5), (11.5, 7.5), (count, 2)).T
    return Camera(x, y, np.full(count, 1.2), rng.uniform(-9, 9, count))


@pytest.mark.parametrize("fov", [0.6, np.pi, 5.0, 2 * np.pi])
def test_landmarks_in_the_angle_of_view_count_by_weight(fov):
    world = museum()
    camera = cameras(np.random.default_rng(0), 300)
    expected = np.zeros(300)
    for i, mark in enumerate(world.content.landmarks):
        away = np.arctan2(mark.y - camera.y, mark.x - camera.x) - camera.yaw
        inside = np.cos(away) >= np.cos(fov / 2)
        expected += mark.weight / 6.5 * inside * landmark_field(world, i, 1.2, 3.0, 9.0)(camera.x, camera.y)
    assert landmarks_unseen(world, camera, near=3.0, far=9.0, fov=fov) == pytest.approx(1 - expected, abs=1e-12)


@pytest.mark.parametrize("fov", [1.5, 2 * np.pi])
def test_symbols_see_what_numbers_see_off_the_edge_of_the_view(fov):
    world = museum()
    camera = cameras(np.random.default_rng(1), 200)
    edge = [np.abs(np.abs(bearing(camera, mark.x, mark.y)) - fov / 2) for mark in world.content.landmarks]
    clear = np.min(edge, axis=0) > 0.03
    camera = Camera(camera.x[clear], camera.y[clear], 1.2, camera.yaw[clear])
    vector = casadi.MX.sym("v", 3 * camera.x.size)
    x, y, yaw = (lift(part, camera.x.size) for part in casadi.vertsplit(vector, camera.x.size))
    symbolic = casadi.MX(landmarks_unseen(world, Camera(x, y, 1.2, yaw), near=3.0, far=9.0, fov=fov))
    value = casadi.Function("f", [vector], [symbolic])(np.concatenate([camera.x, camera.y, camera.yaw]))
    expected = landmarks_unseen(world, camera, near=3.0, far=9.0, fov=fov)
    assert np.array(value).ravel() == pytest.approx(expected, abs=1e-9)


def test_bearings_are_to_the_left_and_have_a_gradient_at_the_landmark():
    camera = Camera(np.array([0.0, 0.0, 1.0]), np.zeros(3), 1.2, np.array([0.0, np.pi / 2, 0.3]))
    assert bearing(camera, 1.0, 0.0) == pytest.approx([0.0, -np.pi / 2, 0.0])
    vector = casadi.MX.sym("v", 2)
    x, y = (lift(part, 1) for part in casadi.vertsplit(vector, 1))
    slope = casadi.jacobian(casadi.MX(bearing(Camera(x, y, 1.2, 0.3 + 0.0 * x), 1.0, 2.0)), vector)
    assert np.isfinite(np.array(casadi.Function("f", [vector], [slope])([1.0, 2.0]))).all()


def test_a_landmark_is_seen_from_the_front_within_reach_on_a_free_line():
    world = World.from_polygons([shapely.box(6, 5, 6.2, 8)], extent=HALL)
    camera = Camera(np.array([4.0, 1.0, 11.0, 8.0]), np.array([6.0, 6.0, 1.0, 6.0]), np.full(4, 1.5))
    seen = [sees(world, camera, Landmark(2, 6, facing=facing), far=8.0).tolist() for facing in (0.0, None)]
    assert seen == [[True, False, False, False], [True, True, False, False]]


def test_each_camera_height_has_its_own_field():
    world = World.from_polygons([(shapely.box(5, 0, 6, 8), (0.0, 1.0))], extent=HALL)
    world = world.with_content(landmarks=[Landmark(1, 4, z=0.8)])
    heights = np.array([0.5, 1.5, 0.5, 3.0])
    camera = Camera(np.full(4, 7.0), np.full(4, 4.0), heights)
    for ask in (lambda c: landmarks_unseen(world, c, near=3.0, far=20.0), lambda c: openness(world, c, 2.0)):
        apart = [ask(Camera(np.array([7.0]), np.array([4.0]), z))[0] for z in heights]
        assert ask(camera) == pytest.approx(apart)
        assert len(set(apart)) > 1
    many = Camera(np.zeros(17), np.zeros(17), np.arange(17.0))
    with pytest.raises(OptionError, match="17 distinct heights"):
        openness(world, many, 2.0)


def test_heights_that_are_variables_are_refused():
    z = lift(casadi.MX.sym("z", 1), 1)
    with pytest.raises(OptionError, match="heights as numbers"):
        openness(museum(), Camera(np.zeros(1), np.zeros(1), z), 2.0)


def test_fields_are_made_once_a_world():
    world = museum()
    assert openness_field(world, 1.2, 3.0) is openness_field(world, 1.2, 3.0)
    mark = world.content.landmarks[0]
    assert line_of_sight(world, mark, 1.2) is line_of_sight(world, mark, 1.2)
    assert landmark_field(world, 0, 1.2, 3.0, 9.0) is landmark_field(world, 0, 1.2, 3.0, 9.0)


# Isovists


def test_an_empty_room_is_all_open():
    world = World.from_polygons([], extent=HALL)
    assert (openness_field(world, 1.2, 5.0).values == 1.0).all()


@pytest.mark.parametrize("d", [0.35, 1.0, 1.7])
def test_a_wall_cuts_a_circular_segment_off_the_isovist(d):
    world = World.from_polygons([shapely.box(6, -20, 7, 28)], extent=shapely.box(0, -6, 12, 14))
    r = 2.0
    segment = r * r * np.arccos(d / r) - d * np.sqrt(r * r - d * d)
    assert openness_field(world, 1.2, r)([6.0 - d], [4.0])[0] == pytest.approx(1 - segment / (np.pi * r * r), abs=1e-3)


def test_a_square_room_is_seen_as_a_square():
    walls = shapely.box(-1, -1, 9, 9).difference(shapely.box(0, 0, 8, 8))
    world = World.from_polygons([walls])
    field = openness_field(world, 1.2, 12.0)
    assert field([4.0, 1.0, 6.3], [4.0, 1.5, 2.0]) == pytest.approx(64 / (np.pi * 144), abs=2e-4)
    # Where the disc does not cover the corners: 4 (8 right triangles and 8 sectors in all).
    r = 5.0
    flat = np.arccos(4 / r)
    area = 8 * (0.5 * 4 * 4 * np.tan(flat) + 0.5 * r * r * (np.pi / 4 - flat))
    assert openness_field(world, 1.2, r)([4.0], [4.0])[0] == pytest.approx(area / (np.pi * r * r), abs=1e-3)


def test_the_outside_closes_a_room_where_it_is_obstacle():
    world = World.from_cells(np.zeros((32, 32), dtype=bool), 0.25)
    assert openness_field(world, 1.2, 12.0)([4.0], [4.0])[0] == pytest.approx(64 / (np.pi * 144), abs=2e-4)


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(3))
def test_isovists_agree_with_monte_carlo(seed):
    rng = np.random.default_rng(seed)
    prisms = random_prisms(rng, 20)
    world = World.from_polygons(prisms, extent=HALL)
    r, z = 3.0, 1.2
    solid = shapely.union_all([polygon for polygon, (bottom, top) in prisms if bottom < z < top])
    shapely.prepare(solid)
    xs, ys, _ = _grid(world)
    field = openness_field(world, z, r)
    for _ in range(6):
        row, column = rng.integers(5, ys.size - 5), rng.integers(5, xs.size - 5)
        centre = np.array([xs[column], ys[row]])
        if solid.buffer(0.01).contains(shapely.Point(centre)):
            continue
        angle, radius = rng.uniform(0, 2 * np.pi, 20_000), r * np.sqrt(rng.random(20_000))
        ends = centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        lines = shapely.linestrings(np.stack([np.broadcast_to(centre, ends.shape), ends], axis=1))
        share = 1 - shapely.intersects(solid, lines).mean()
        assert field.values[row, column] == pytest.approx(share, abs=0.02)  # > 5 standard errors


def test_within_an_obstacle_nothing_is_open_and_touching_it_half_is():
    world = World.from_polygons([shapely.box(4, 0, 8, 8)], extent=HALL)
    values = openness_field(world, 1.2, 2.0)
    xs, ys, _ = _grid(world)
    row = int(np.argmin(np.abs(ys - 4.0)))
    assert values.values[row, np.argmin(np.abs(xs - 6.0))] == 0.0
    assert values.values[row, np.argmin(np.abs(xs - 4.0))] == pytest.approx(0.5, abs=0.01)
    assert values.values[row, np.argmin(np.abs(xs - 1.5))] == 1.0


def test_what_does_not_reach_the_camera_closes_nothing():
    prisms = [(shapely.box(3, 0, 4, 8), (0.0, 1.0)), (shapely.box(8, 0, 9, 8), (2.0, 3.0))]
    world = World.from_polygons(prisms, extent=HALL)
    assert (openness_field(world, 1.2, 5.0).values == 1.0).all()
    assert openness_field(world, 0.5, 5.0).values.min() < 0.6


@pytest.mark.parametrize("radius", [0.0, -1.0, np.inf, np.nan])
def test_a_radius_must_be_a_length(radius):
    with pytest.raises(OptionError, match="radius"):
        openness_field(museum(), 1.2, radius)


@pytest.mark.cases(1)
@pytest.mark.parametrize("seed", range(2))
def test_among_obstacles_a_move_sees_as_much_as_exact_lines_and_isovists(seed):
    """Fields blur the borders of shadows, but neither way: along a move it evens out."""
    rng = np.random.default_rng(seed)
    corners, sizes = rng.uniform((1, 1), (11, 9), (25, 2)), rng.uniform(0.3, 1.2, (25, 2))
    boxes = [shapely.box(*corner, *(corner + size)) for corner, size in zip(corners, sizes, strict=True)]
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, 12, 10))
    solid = world.solid()
    shapely.prepare(solid)
    lit, isovists = [], []
    for begin, end in rng.uniform((0, 0), (12, 10), (12, 2, 2)):
        x, y = (begin + np.linspace(0, 1, 300)[:, None] * (end - begin)).T
        outside = ~shapely.contains_xy(solid, x, y)
        x, y = x[outside], y[outside]
        mark = Landmark(*(float(v) for v in rng.uniform((0, 0), (12, 10))))
        if world.clearance(np.array([mark.x]), np.array([mark.y]))[0] < 0.1 or x.size < 100:
            continue
        lines = shapely.linestrings(np.stack([np.stack([x, y], 1), np.tile([mark.x, mark.y], (x.size, 1))], 1))
        lit.append((line_of_sight(world, mark, 1.2)(x, y).mean(), (~shapely.intersects(solid, lines)).mean()))
        isovists.append(
            (openness_field(world, 1.2, 4.0)(x, y).mean(), np.mean([*exact_shares(solid, x[::25], y[::25], 4.0)]))
        )
    seen, exact = np.array(lit).T
    assert np.abs(seen - exact).max() < 0.05
    assert abs((seen - exact).mean()) < 0.01
    share, expected = np.array(isovists).T
    assert share == pytest.approx(expected, rel=0.08)


def exact_shares(solid, x, y, radius):
    """Open share of discs by shapely's rays."""
    angles = 2 * np.pi * (np.arange(180) + 0.5) / 180
    ahead = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for px, py in zip(x, y, strict=True):
        rays = shapely.linestrings([[(px, py), (px + radius * c, py + radius * s)] for c, s in ahead])
        hits = shapely.intersection(rays, shapely.boundary(solid))
        apart = np.where(shapely.is_empty(hits), radius, shapely.distance(shapely.Point(px, py), hits))
        yield float(np.mean(apart**2)) / radius**2


@pytest.mark.parametrize("count", [100, pytest.param(1000, marks=pytest.mark.proof)])
def test_hundreds_of_landmarks_take_little_more_memory_than_one(count):
    """Each is looked at within its distance, not over the whole map."""
    hall = World.from_polygons([shapely.box(20, 10, 21, 20)], extent=shapely.box(0, 0, 60, 40))
    places = np.random.default_rng(0).uniform((1, 1), (59, 39), (count, 2))
    world = hall.with_content(landmarks=[Landmark(x, y) for x, y in places.tolist()])
    camera = Camera(np.array([30.0]), np.array([20.0]), np.array([1.2]), np.array([0.0]))
    tracemalloc.start()
    landmarks_unseen(world, camera, near=1.0, far=3.0)
    landmarks_unseen(world, camera, near=1.0, far=3.0, fov=1.5)
    taken = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert taken < 0.2e6 * count  # a field of the whole map takes 2 MB, two hundred 400 MB, and as much padded
