"""Pictures all round: each pixel shows what stands in its direction."""

import math
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from PIL import Image

import hpop
from hpop.errors import OptionError, OutputError, QueryError
from hpop.view import render_360, save_360
from hpop.view.ride.panorama import Panorama
from hpop.view.ride.rows import arctangent
from hpop.view.ride.scene import ViewScene
from hpop.world import Track
from hpop.world.content.content import Landmark, Person
from tests.view.ride.oracle import angles, seen

ROUND = shapely.Point(6, 3).buffer(1.5, 4).difference(shapely.box(5.6, 2.6, 6.4, 3.4))
ROOM = hpop.World.from_polygons(
    [
        shapely.box(0, 0, 10, 0.2),
        shapely.box(9.8, 0.2, 10, 6),
        (ROUND, (0.0, 0.8)),
        (shapely.box(3, 4, 4, 5), (0.7, 0.8)),  # a table top: one sees below it
        (shapely.box(3.2, 4.2, 3.6, 4.6), (0.8, 1.5)),  # on it
        (shapely.box(1, 1, 2, 5), (2.0, 2.3)),  # over the head
        (shapely.Polygon([(7, 4), (8.5, 4.5), (7.2, 5.5)]), (0.0, 1.7)),
    ],
    extent=shapely.box(0, 0, 10, 6),
)
PLACES = [(2.5, 2.0, 1.2), (4.8, 5.2, 1.2), (8.6, 1.4, 0.5), (1.5, 3.0, 1.9), (6.0, 3.0, 1.2), (3.4, 4.4, 2.6)]


def problem_of(world: hpop.World) -> hpop.Problem:
    return hpop.Problem(world, hpop.DifferentialDrive(camera_height=1.2), (2.5, 2, 0), (4.5, 2, 0), ["length"])


def drawn(world: hpop.World, width: int) -> Panorama:
    return Panorama(ViewScene.of(problem_of(world)), width)


@pytest.fixture(scope="module")
def goes() -> hpop.Trajectory:
    return hpop.Trajectory.from_poses(hpop.DifferentialDrive(camera_height=1.2), [(2.5, 2, 0), (4.5, 2, 1)])


@pytest.mark.parametrize("width", [256, pytest.param(1024, marks=pytest.mark.proof)])
def test_the_horizon_is_what_a_ray_cast_meets(width):
    world = hpop.World.from_geojson(Path("examples/museum.geojson"))
    picture, rng, shares = drawn(world, width), np.random.default_rng(4), []
    free = world.extent.difference(world.solid(0.0, 5.0)).buffer(-0.3)
    while len(shares) < 12:
        x, y, yaw = rng.uniform((0, 0, -3), (30, 20, 3))
        if not free.contains(shapely.Point(x, y)):
            continue
        numbers = picture.numbers(np.array([x, y, 1.2]), yaw, 0.0)
        row, columns = width // 4 - 1, np.arange(width)
        bearings, elevations = angles(width, np.full(width, row), columns, yaw)
        shares.append(np.mean(numbers[row] == seen(world, (x, y, 1.2), bearings, elevations)))
    assert min(shares) >= 0.995


@pytest.mark.parametrize("place", PLACES)
def test_each_pixel_shows_the_prism_that_its_line_of_sight_meets_first(place):
    width, rng = 512, np.random.default_rng(1)
    numbers = drawn(ROOM, width).numbers(np.array(place), 0.3, 0.0)
    rows, columns = rng.integers(0, width // 2, 600), rng.integers(0, width, 600)
    expected = seen(ROOM, place, *angles(width, rows, columns, 0.3))
    assert len(set(expected)) >= 4  # much is to be seen
    assert np.mean(numbers[rows, columns] == expected) >= 0.995


@pytest.mark.seeds(4, of=100)
def test_so_does_each_pixel_of_any_world(seed):
    """Prisms through and over each other, with holes, round or along the axes, seen from beside, above and below."""
    rng, prisms = np.random.default_rng(seed), []
    for k in range(8):
        x, y, a, b = (float(value) for value in rng.integers((0, 0, 1, 1), (16, 16, 6, 6)) / 2)
        corners = shapely.MultiPoint(rng.uniform(0, 8, (5, 2)))
        outline = (shapely.box(x, y, x + a, y + b), shapely.Point(x, y).buffer(a, 3), corners.convex_hull)[k % 3]
        if k % 4 == 3:
            outline = outline.difference(outline.centroid.buffer(0.2, 2))
        low = float(rng.choice([0.0, 0.5, 1.0, 2.0])) + 0.013 * k  # no two in one plane, where either may be seen
        prisms.append((outline, (low, low + float(rng.choice([0.1, 0.6, 1.0, 3.0])) + 0.0037 * k)))
    world = hpop.World.from_polygons(prisms, extent=shapely.box(-3, -3, 13, 13))
    place = tuple(float(value) for value in (*rng.integers(-4, 22, 2) / 2, rng.choice([0.3, 1.2, 1.7, 2.7])))
    at = shapely.Point(place[:2])
    if any(o.polygon.distance(at) < 0.02 and o.z_min - 0.02 < place[2] < o.z_max + 0.02 for o in world.obstacles):
        return  # within what is solid
    yaw = float(rng.choice([0.0, math.pi / 2, 0.3]))
    rows, columns = rng.integers(0, 128, 300), rng.integers(0, 256, 300)
    numbers = drawn(world, 256).numbers(np.array(place), yaw, 0.0)
    assert np.mean(numbers[rows, columns] == seen(world, place, *angles(256, rows, columns, yaw))) >= 0.98


def test_cells_are_seen_as_their_outlines_are():
    rng = np.random.default_rng(5)
    occupied = rng.random((30, 40)) < 0.06
    world = hpop.World.from_cells(occupied, 0.3, origin=(-2.0, 1.0, 0.4), height=(0.0, 1.5), outside_is_obstacle=False)
    outlines = hpop.World.from_polygons([(part, (0.0, 1.5)) for part in shapely.get_parts(world.solid())])
    rows, columns = rng.integers(100, 200, 600), rng.integers(0, 512, 600)
    for place in ((-5.0, -3.0, 1.2), (3.0, 6.0, 1.2), (2.0, 8.0, 2.2)):
        if world.solid().distance(shapely.Point(place[:2])) < 0.02 and place[2] < 1.5:
            continue
        numbers = drawn(world, 512).numbers(np.array(place), 0.0, 0.0)
        assert np.unique(numbers).tolist() == [0, 1]
        expected = seen(outlines, place, *angles(512, rows, columns, 0.0)) > 0
        assert 0.02 < expected.mean() < 0.95
        assert np.mean((numbers[rows, columns] > 0) == expected) >= 0.99


@pytest.mark.proof
@pytest.mark.parametrize("name", ["nav2_depot/depot.yaml", "aws_bookstore/map.yaml", "pal_office/map.yaml"])
def test_the_horizon_of_a_robot_s_map_is_what_a_ray_cast_meets(shared_data, name):
    folder, _, file = name.partition("/")
    world = hpop.World.from_ros_map(shared_data(folder) / file)
    outlines = hpop.World.from_polygons([*shapely.get_parts(world.solid())])
    picture, rng, shares = drawn(world, 1024), np.random.default_rng(4), []
    free, (x0, y0, x1, y1) = world.free_space().region.buffer(-0.3), world.bounds
    columns = np.arange(0, 1024, 4)
    bearings, elevations = angles(1024, np.full(256, 255), columns, 0.5)
    while len(shares) < 12:
        x, y = rng.uniform((x0, y0), (x1, y1))
        if free.contains(shapely.Point(x, y)):
            numbers = picture.numbers(np.array([x, y, 1.2]), 0.5, 0.0)[255, columns]
            met = seen(outlines, (x, y, 1.2), bearings, elevations) > 0
            shares.append(np.mean((numbers == picture.scene.cells.number) == met))
    assert min(shares) >= 0.995


def test_a_wall_covers_the_rows_between_the_arctangents_of_its_heights():
    wall = hpop.World.from_polygons([(shapely.box(4, -50, 5, 50), (0.3, 2.2))])
    column = drawn(wall, 4096).numbers(np.array([0.0, 0.0, 1.2]), 0.0, 0.0)[:, 2048]
    rows = np.flatnonzero(column == 1)
    upper, lower = (math.degrees(math.atan((z - 1.2) / 4.0)) for z in (2.2, 0.3))
    per_row = 180 / 2048
    assert 90 - rows[0] * per_row == pytest.approx(upper, abs=per_row)
    assert 90 - (rows[-1] + 1) * per_row == pytest.approx(lower, abs=per_row)
    assert (np.diff(rows) == 1).all()


def test_a_person_with_a_track_is_drawn_while_there_and_looks_where_the_steps_lead():
    track = Track.through([(1, 4, 1), (3, 4, 3), (5, 4, 3)])
    picture = drawn(ROOM.with_content(people=[Person.along(track, yaw=1.0)]), 256)
    place, (figure,) = np.array([2.0, 2.0, 1.2]), picture.scene.figures
    there = [bool((picture.numbers(place, 0.0, t) == figure.number).any()) for t in (0.5, 2.0, 4.5, 5.5)]
    assert there == [False, True, True, False]
    assert figure.person.way()[:, 3].tolist() == [math.pi / 2] * 4
    assert figure.description()["there"] == [1.0, 5.0]


@pytest.mark.parametrize("columns", [1, 17, 64, -3])
def test_a_turn_by_whole_columns_shifts_the_picture_by_them_and_changes_no_byte(columns):
    picture, place = drawn(ROOM, 128), np.array(PLACES[0])
    before = picture.draw(place, 0.7, 0.0)
    after = picture.draw(place, 0.7 + columns * 2 * math.pi / 128, 0.0)
    np.testing.assert_array_equal(after, np.roll(before, columns, axis=1))  # to the left: all moves to the right


def test_the_same_bytes_whoever_draws_and_beside_whatever():
    place, turns = np.array(PLACES[1]), np.linspace(0, 3, 6)
    alone = [drawn(ROOM, 128).draw(place, turn, 0.0).tobytes() for turn in turns]
    shared = drawn(ROOM, 128)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda turn: shared.draw(place, turn, 0.0).tobytes(), turns)) == alone


def test_a_person_is_where_they_have_walked_as_wide_and_as_tall_as_they_are():
    walker = Person(4.0, 0.8, velocity=(0.0, 0.2), radius=0.3)
    picture = drawn(ROOM.with_content(people=[Person(2, 4), walker]), 2048)
    place = np.array([2.0, 2.0, 1.2])
    numbers = picture.numbers(place, 0.0, 6.0)  # now at (4, 2), straight ahead
    number = picture.scene.figures[1].number
    columns = np.flatnonzero((numbers == number).any(axis=0))
    assert (columns[0] + columns[-1] + 1) / 2 == pytest.approx(1024, abs=1)
    assert (columns[-1] + 1 - columns[0]) * 360 / 2048 == pytest.approx(2 * math.degrees(math.asin(0.3 / 2)), abs=0.4)
    rows = np.flatnonzero((numbers == number).any(axis=1))
    assert 90 - rows[0] * 180 / 1024 == pytest.approx(math.degrees(math.atan((1.73 - 1.2) / 2)), abs=0.4)
    assert 90 - (rows[-1] + 1) * 180 / 1024 == pytest.approx(math.degrees(math.atan(-1.2 / (2 - 0.55 * 0.3))), abs=0.4)


def test_a_person_shows_their_face_to_whom_they_look_at():
    world = ROOM.with_content(people=[Person(5.0, 2.0, yaw=math.pi), Person(-1.0, 2.0, yaw=math.pi)])
    picture = drawn(world, 512).draw(np.array([2.0, 2.0, 1.2]), 0.0, 0.0).astype(int)
    row = round(128 - math.atan((1.6 - 1.2) / 3) * 256 / math.pi)
    face, back = picture[row, 256], picture[row, 0]
    assert face.sum() > back.sum() + 100  # skin is lighter than hair


def test_a_landmark_s_name_reads_from_left_to_right_and_from_its_front_only():
    mark = Landmark(5.0, 2.0, z=1.2, facing=math.pi, name="L")
    picture = drawn(hpop.World.from_polygons([], extent=shapely.box(0, 0, 9, 4)).with_content(landmarks=[mark]), 2048)
    place = np.array([4.0, 2.0, 1.2])
    numbers, colours = picture.numbers(place, 0.0, 0.0), picture.draw(place, 0.0, 0.0).astype(int).sum(axis=2)
    rows, columns = np.nonzero(numbers == picture.scene.plates[0].number)
    assert (columns.min() + columns.max() + 1) / 2 == pytest.approx(1024, abs=1)
    assert np.ptp(columns) * 360 / 2048 == pytest.approx(2 * math.degrees(math.atan(0.4)), abs=0.3)
    inner = colours[rows.min() + 30 : rows.max() - 30, columns.min() + 30 : columns.max() - 30] < 300  # ink
    across = np.flatnonzero(inner.any(axis=0))
    stroke = inner[:, across[0] : across[-1] + 1].sum(axis=0)
    assert stroke[: len(stroke) // 4].mean() > 2 * stroke[len(stroke) // 2 :].mean()  # an L's upright is on its left
    behind = picture.draw(np.array([6.0, 2.0, 1.2]), math.pi, 0.0).astype(int).sum(axis=2)
    assert np.ptp(behind[rows.min() + 10 : rows.max() - 10, columns.min() + 10 : columns.max() - 10]) == 0  # blank


@pytest.mark.parametrize("turn", [0.0, 0.3, 2.0])
def test_a_landmark_in_the_face_of_a_wall_is_seen_whole(turn):
    def turned(x, y):
        return x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn)

    wall = shapely.Polygon([turned(*corner) for corner in ((5, -5), (5.3, -5), (5.3, 5), (5, 5))])
    mark = Landmark(*turned(5.0, 0.3), z=1.5, facing=math.pi + turn, name="hung")
    world = hpop.World.from_polygons([wall], extent=shapely.box(-9, -9, 9, 9))
    alone = hpop.World.from_polygons([], extent=shapely.box(-9, -9, 9, 9))
    one, other = (drawn(it.with_content(landmarks=[mark]), 512) for it in (world, alone))
    assert not any("landmark" in note for note in one.scene.notes)
    for place in (turned(2.0, 0.0), turned(3.9, -1.1)):
        at = np.array([*place, 1.2])
        with_wall = one.numbers(at, 0.0, 0.0) == one.scene.plates[0].number
        np.testing.assert_array_equal(with_wall, other.numbers(at, 0.0, 0.0) == 1)
        assert with_wall.sum() > 200


def test_a_landmark_without_a_front_turns_to_the_camera():
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 9, 4)).with_content(landmarks=[Landmark(5, 2)])
    picture = drawn(world, 512)
    for x, y, yaw in ((3.0, 2.0, 0.0), (5.0, 0.0, math.pi / 2), (5.0, 4.0, -math.pi / 2)):
        columns = np.flatnonzero((picture.numbers(np.array([x, y, 1.2]), yaw, 0.0) == 1).any(axis=0))
        assert (columns[-1] + 1 - columns[0]) * 360 / 512 == pytest.approx(2 * math.degrees(math.atan(0.2)), abs=1.0)


@pytest.mark.parametrize("turn", [(0.4, 0.0), (-1.2, 0.0), (0.3, 0.5)])
def test_a_tilted_camera_sees_in_each_direction_what_a_level_one_sees(turn):
    picture, place, rng = drawn(ROOM, 512), np.array(PLACES[0]), np.random.default_rng(2)
    pitch, roll = turn
    ahead = np.array([math.cos(pitch), 0.0, math.sin(pitch)])
    left = np.array([0.0, math.cos(roll), 0.0]) + math.sin(roll) * np.cross(ahead, [0.0, 1.0, 0.0])
    axes = np.stack([ahead, left, np.cross(ahead, left)], axis=1)
    level, tilted = picture.draw(place, 0.0, 0.0).astype(float), picture.draw_turned(place, axes, 0.0).astype(float)
    rows, columns = rng.integers(2, 254, 4000), rng.integers(0, 512, 4000)
    bearing, elevation = angles(512, rows, columns, 0.0)
    away = np.cos(elevation)
    looks = np.stack([away * np.cos(bearing), away * np.sin(bearing), np.sin(elevation)]).T @ axes.T
    u = 256 - np.arctan2(looks[:, 1], looks[:, 0]) * 256 / math.pi
    v = 128 - np.arcsin(looks[:, 2]) * 256 / math.pi
    other = level[np.clip(v.astype(int), 0, 255), u.astype(int) % 512]
    apart = np.abs(tilted[rows, columns] - other).max(axis=1)
    assert np.mean(apart <= 12) > 0.9  # the rest lies at edges
    assert np.median(apart) <= 2


def test_the_picture_of_a_time_is_what_its_camera_sees(goes):
    problem = problem_of(ROOM)
    run = goes.execution()
    picture = render_360(problem, goes, 1.5, width=128)
    assert (picture.shape, picture.dtype) == ((64, 128, 3), np.uint8)
    at = run.at(np.array([1.5]))
    expected = drawn(ROOM, 128).draw(np.array([at.x[0], at.y[0], 1.2]), float(at.yaw[0]), 1.5)
    np.testing.assert_array_equal(picture, expected)


def test_a_pan_tilt_head_looks_where_it_is_turned():
    head = hpop.PanTilt(hpop.DifferentialDrive(camera_height=1.2))
    start = {"x": 2.5, "y": 2.0, "yaw": 0.0, "pan": 0.0, "tilt": 0.0}
    problem = hpop.Problem(ROOM, head, start, {**start, "pan": 1.0, "tilt": -0.5}, ["length"])
    ends = hpop.motions.States(**{name: np.array([start[name], problem.goal[i]]) for i, name in enumerate(start)})
    goes = hpop.Trajectory.through(head, ends)
    level = drawn(ROOM, 256).draw(np.array([2.5, 2.0, 1.2]), 1.0, 0.0).astype(int)
    tilted = render_360(problem, goes, goes.execution().duration, width=256).astype(int)
    # The middle looks half a radian down, where the level picture shows the floor so much lower.
    assert np.abs(tilted[64, 128] - level[round(64 + 0.5 * 128 / math.pi), 128]).max() <= 16


def test_a_floor_at_a_distance_does_not_shimmer():
    picture = drawn(hpop.World.from_polygons([], extent=shapely.box(-100, -100, 100, 100)), 512)
    frames = [picture.draw(np.array([0.03 * k, 0.01 * k, 1.2]), 0.0, 0.0).astype(float) for k in range(6)]
    far = slice(128, 140)  # beyond 8 m
    steps = np.abs(np.diff([frame[far] for frame in frames], axis=0))
    assert steps.mean() < 1.0
    assert np.quantile(steps, 0.999) < 12.0


@pytest.mark.parametrize("x", [-50.0, -2.4142, -1.0, -0.3, 0.0, 1e-9, 0.41421356, 0.7, 2.5, 1e6])
def test_the_arctangent_is_the_arctangent(x):
    assert arctangent(x) == pytest.approx(math.atan(x), abs=1e-9)


def test_a_png_says_that_it_is_all_round(goes, tmp_path):
    path = save_360(problem_of(ROOM), goes, 0.0, tmp_path / "new" / "start.png", width=64)
    with Image.open(path) as image:
        np.testing.assert_array_equal(np.asarray(image), render_360(problem_of(ROOM), goes, 0.0, width=64))
        told = image.info["XML:com.adobe.xmp"]
    (description,) = ElementTree.fromstring(told[told.index("<x:") : told.index("<?xpacket end")]).iter(
        "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description"
    )
    space = "{http://ns.google.com/photos/1.0/panorama/}"
    assert description.get(f"{space}ProjectionType") == "equirectangular"
    assert description.get(f"{space}FullPanoWidthPixels") == "64"


def test_what_cannot_be_drawn_is_told(goes, tmp_path):
    problem = problem_of(ROOM)
    with pytest.raises(OptionError, match="multiple of 4, got 130; 128 is one"):
        render_360(problem, goes, 0.0, width=130)
    with pytest.raises(OptionError, match="t must be a time of the executed trajectory"):
        render_360(problem, goes, goes.execution().duration + 1.0)
    with pytest.raises(QueryError, match="expected a trajectory"):
        render_360(problem, None, 0.0)
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        save_360(problem, goes, 0.0, tmp_path / "file" / "start.png", width=64)
