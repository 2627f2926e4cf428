"""GeoJSON floor plans: a real museum, meanings of polygons, notes, and broken files."""

import json
import math

import numpy as np
import pytest
import shapely
from click.testing import CliRunner
from geographiclib.geodesic import Geodesic

from hpop.cli import main
from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World
from hpop.world.readers import geojson_content
from tests.worlds import feature, square

MUSEUM = {"scale": 0.7447, "origin": (-9753627.0, 5140874.0)}  # metres from EPSG:3857, see SOURCE.txt


def write(folder, *features, text=None):
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}) if text is None else text)
    return path


def test_the_museum_outline_is_a_building_with_eight_columns(shared_data):
    path = shared_data("field_museum_main") / "main_level_outline.geojson"
    world = World.from_geojson(path, polygons="outline", **MUSEUM)
    assert len(world.obstacles) == 8
    # The columns are round, 2.24 m across: area pi d^2 / 4.
    assert [o.polygon.area for o in world.obstacles] == pytest.approx([3.95] * 8, abs=0.01)
    x0, y0, x1, y1 = world.bounds
    assert (x1 - x0, y1 - y0) == pytest.approx((285.95 * 0.7447, 180.73 * 0.7447), abs=0.1)
    assert world.outside_is_obstacle
    assert world.notes == (f"{path}: 9 features (0 to 8): no properties, so of unlimited height.",)


def test_the_museum_areas_are_free_space(shared_data):
    world = World.from_geojson(shared_data("field_museum_main") / "main_level_areas.geojson", polygons="free", **MUSEUM)
    outline = World.from_geojson(
        shared_data("field_museum_main") / "main_level_outline.geojson", polygons="outline", **MUSEUM
    )
    assert not world.obstacles
    assert world.extent.intersection(outline.extent).area > 0.95 * world.extent.area


def test_a_layer_without_polygons_says_what_it_holds(shared_data):
    with pytest.raises(MapError, match=r"9 features \(0 'birds', 1 'africa', .*\): a 'Point', not a polygon"):
        World.from_geojson(shared_data("field_museum_main") / "main_level_labels.geojson")


def test_polygons_are_obstacles_with_heights(tmp_path):
    path = write(
        tmp_path,
        feature(square(0, 0, 1, 1)),
        feature(square(2, 0, 3, 1), height=1.2),
        feature(square(4, 0, 5, 1), height=[0.5, 2]),
        feature([square(6, 0, 7, 1)], [square(8, 0, 9, 1)], kind="MultiPolygon", height=None),
    )
    world = World.from_geojson(path)
    full = (-math.inf, math.inf)
    assert [o.heights for o in world.obstacles] == [full, (0, 1.2), (0.5, 2), full, full]
    assert world.notes == ()
    assert world.bounds == (0, 0, 9, 1)


def test_holes_stay_open(tmp_path):
    world = World.from_geojson(write(tmp_path, feature(square(0, 0, 4, 4), square(1, 1, 3, 3))))
    assert world.clearance(np.array([2.0]), np.array([2.0]))[0] == 1.0


def test_origin_and_scale_place_the_plan(tmp_path):
    world = World.from_geojson(write(tmp_path, feature(square(100, 200, 104, 202))), scale=0.5, origin=(100, 200))
    assert world.bounds == (0, 0, 2, 1)


def test_free_polygons_are_where_the_robot_may_be(tmp_path):
    path = write(tmp_path, feature(square(0, 0, 4, 4)), feature(square(4, 1, 8, 3)))
    world = World.from_geojson(path, polygons="free")
    assert world.clearance(np.array([4.0, 6.0, 6.0]), np.array([2.0, 2.0, 3.5])).tolist() == [1.0, 1.0, 0.0]
    assert world.obstruction_field(0.5)(6.0, 2.95) == pytest.approx(0.425, abs=0.01)  # beside a wall


def test_what_is_left_out_or_mended_is_told(tmp_path):
    path = write(
        tmp_path,
        feature(square(0, 0, 1, 1)),
        {"type": "Feature", "properties": {}, "geometry": None},
        {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [square(2, 0, 3, 1)]}},
        feature([0, 0], [1, 1], kind="LineString"),
        feature([[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]),
        feature(kind="Polygon"),
    )
    world = World.from_geojson(path)
    assert len(world.obstacles) == 4  # the bow tie became two triangles
    assert world.notes == (
        f"{path}: feature 1: no geometry, left out.",
        f"{path}: feature 2: no properties, so of unlimited height.",
        f"{path}: feature 3: a 'LineString', not a polygon, left out.",
        f"{path}: feature 4: no valid polygon (Self-intersection), mended.",
        f"{path}: feature 5: an empty Polygon, left out.",
        f"{path}: wall_width: 0.1 makes walls of its lines, 0.1 m thick.",
    )


def test_a_single_feature_and_a_bare_polygon_are_read(tmp_path):
    one = feature(square(0, 0, 1, 1))
    for data in (one, one["geometry"]):
        assert len(World.from_geojson(write(tmp_path, text=json.dumps(data))).obstacles) == 1


def test_a_third_coordinate_is_ignored(tmp_path):
    ring = [[x, y, 7.0] for x, y in square(0, 0, 1, 1)]
    world = World.from_geojson(write(tmp_path, feature(ring)))
    assert not shapely.has_z(world.obstacles[0].polygon)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[" * 100_000, "not JSON"),
        ("3", "must hold a GeoJSON .*; got 3"),
        ('{"type": "Topology"}', "must hold a GeoJSON .*; got type 'Topology'"),
        ('{"type": "FeatureCollection", "features": 3}', "list of features"),
        ('{"type": "FeatureCollection", "features": [3]}', "feature 0 must be an object"),
        ('{"type": "FeatureCollection", "features": []}', "no polygon"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}', "a ring of fewer than 3 different points"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [NaN, 1], [0, 0]]]}', "finite"),
        ('{"type": "Polygon", "coordinates": [[["a", 0], [1, 0], [1, 1], [0, 0]]]}', "make no Polygon"),
        ('{"type": "Polygon", "coordinates": {"a": 1}}', "make no Polygon"),
        ('{"type": "Polygon"}', "make no Polygon"),
    ],
)
def test_broken_files_are_refused(tmp_path, text, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(write(tmp_path, text=text))


@pytest.mark.parametrize("height", [[1], [2, 1], ["a", 1], [0, 1e9]])
def test_wrong_pairs_of_heights_name_their_feature(tmp_path, height):
    with pytest.raises(MapError, match="feature 0: property height"):
        World.from_geojson(write(tmp_path, feature(square(0, 0, 1, 1), height=height)))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"scale": 0}, "scale"),
        ({"scale": "1"}, "scale"),
        ({"origin": (1,)}, "origin"),
        ({"origin": (0, math.nan)}, "origin"),
        ({"polygons": "walls"}, "obstacles, free, outline"),
    ],
)
def test_wrong_options_are_refused(tmp_path, options, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(write(tmp_path, feature(square(0, 0, 1, 1))), **options)


def test_missing_empty_and_binary_files_are_refused(tmp_path):
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "binary").write_bytes(b"\x80\x81")
    for name in ("empty", "binary", "none", "."):
        with pytest.raises(MapError):
            World.from_geojson(tmp_path / name)


# Degrees: RFC 7946, what geojson.io and QGIS write


def in_degrees(origin, metres):
    """Corners (n, 2), m east and north of a point, as longitude and latitude: along geodesics, by GeographicLib."""
    corners = []
    for east, north in metres:
        found = Geodesic.WGS84.Direct(
            origin[1], origin[0], math.degrees(math.atan2(east, north)), math.hypot(east, north)
        )
        corners.append([found["lon2"], found["lat2"]])
    return corners


def length_on_earth(a, b):
    return Geodesic.WGS84.Inverse(a[1], a[0], b[1], b[0])["s12"]


@pytest.mark.parametrize("seed", range(20))
def test_lengths_of_a_building_in_degrees_are_those_of_a_geodesic_library(tmp_path, seed):
    rng = np.random.default_rng(seed)
    place = (rng.uniform(-179, 179), rng.uniform(-89, 89))
    along, across, turned = rng.uniform(5, 1500), rng.uniform(5, 1500), rng.uniform(0, math.tau)
    turn = np.array([[math.cos(turned), math.sin(turned)], [-math.sin(turned), math.cos(turned)]])
    ring = in_degrees(place, np.array(square(0, 0, along, across)) @ turn)
    assert np.ptp(np.array(ring), axis=0).max() < 0.1 or abs(place[1]) > 80
    world = World.from_geojson(write(tmp_path, feature([*ring[:4], ring[0]])), units="deg")
    corners = shapely.get_coordinates(world.obstacles[0].polygon)
    for i in range(4):
        expected = length_on_earth(ring[i], ring[(i + 1) % 4])
        assert math.dist(corners[i], corners[i + 1]) == pytest.approx(expected, rel=1e-4)
    assert abs(length_on_earth(ring[0], ring[2]) - math.dist(corners[0], corners[2])) < 1e-4 * math.hypot(along, across)


def test_degrees_are_recognised_and_told_with_the_way_out(tmp_path):
    ring = in_degrees((-87.6166, 41.8662), square(0, 0, 60, 30))
    path = write(tmp_path, feature(ring), feature(ring[0], ring[2], kind="LineString"))
    world = World.from_geojson(path, wall_width=0.2, polygons="outline")
    x0, y0, x1, y1 = world.bounds
    assert (x0, y0, x1, y1) == pytest.approx((0, 0, 60, 30), abs=0.01)
    assert world.obstacles[0].polygon.area == pytest.approx(0.2 * (math.hypot(60, 30) + 0.2), rel=1e-3)
    assert "degrees" in world.notes[0]
    assert "longitude -87.616" in world.notes[0]
    assert "units: m" in world.notes[0]
    again = World.from_description(world.describe())
    assert again.bounds == world.bounds
    as_metres = World.from_geojson(path, units="m")
    assert max(as_metres.bounds[2] - as_metres.bounds[0], 0.001) < 0.1


def test_the_origin_of_degrees_is_a_point_on_the_earth(tmp_path):
    ring = in_degrees((7.6, 51.9), square(10, 20, 60, 50))
    world = World.from_geojson(write(tmp_path, feature(ring)), origin=(7.6, 51.9))
    assert world.bounds == pytest.approx((10, 20, 60, 50), abs=0.01)


def test_a_plan_in_metres_or_other_units_of_a_plane_is_left_as_it_is(tmp_path):
    assert World.from_geojson(write(tmp_path, feature(square(0, 0, 30, 20)))).bounds == (0, 0, 30, 20)
    kilometres = write(tmp_path, feature(square(0, 0, 0.05, 0.03)))
    assert World.from_geojson(kilometres, scale=1000).bounds == pytest.approx((0, 0, 50, 30))


@pytest.mark.parametrize(
    ("features", "options", "message"),
    [
        ([feature(square(0, 0, 30, 20)), feature(square(7.6, 51.9, 7.6004, 51.9003), name="hall")], {},
         r"feature 1 'hall' spans 0.0004 x 0.0003 at \(7.6, 51.9\), as degrees do, and the others 30 x 51.9"),
        ([feature(square(0, 0, 1, 1)), feature(square(-9.7e6, 5.1e6, -9.6e6, 5.2e6), name="hall")], {"units": "deg"},
         r"feature 1 'hall': \(-9.7e\+06, 5.1e\+06\) is no longitude and latitude"),
        ([feature(square(7.6, 51.9, 7.61, 51.91)), feature(square(7.9, 51.9, 7.905, 51.905))], {}, "units: m or deg"),
        ([feature(square(7.6, 51.9, 7.61, 51.91))], {"scale": 0.5, "units": "deg"}, "leave out scale"),
        ([feature(square(7.6, 51.9, 7.61, 51.91))], {"origin": (0, 0)}, "more than 1 degree"),
        ([feature(square(0, 0, 30, 20))], {"units": "feet"}, "m, deg"),
    ],
)  # fmt: skip
def test_degrees_mixed_with_metres_are_refused(tmp_path, features, options, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(write(tmp_path, *features), **options)


def test_zones_in_degrees_of_a_plan_in_metres_are_refused(tmp_path):
    zones = write(tmp_path, feature(square(7.6, 51.9, 7.6004, 51.9003), name="quiet", limit=0.5))
    with pytest.raises(MapError, match=r"feature 0 'quiet' .* as degrees do, but the plan is in metres"):
        geojson_content.read(zones=zones)


def test_what_stands_beside_a_plan_in_degrees_is_placed_as_it_is(tmp_path):
    (house,) = [in_degrees((7.6, 51.9), square(0, 0, 30, 20))]
    ((x, y),) = in_degrees((7.6, 51.9), [(12, 5)])
    write(tmp_path, feature(house)).rename(tmp_path / "house.geojson")
    write(tmp_path, feature(x, y, kind="Point", name="Sue")).rename(tmp_path / "labels.geojson")
    plan = {"path": "house.geojson", "polygons": "outline", "landmarks": "labels.geojson"}
    asked = {"world": {"geojson": plan}, "start": [5, 5, 0], "goal": [8, 5, 0], "criteria": ["length"]}
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    (sue,) = load_scenario(tmp_path / "scenario.yaml").problem.world.content.landmarks
    assert (sue.name, sue.x, sue.y) == ("Sue", pytest.approx(12, abs=0.001), pytest.approx(5, abs=0.001))
    write(tmp_path, feature(12.0, 95.0, kind="Point", name="Sue")).rename(tmp_path / "labels.geojson")
    with pytest.raises(MapError, match=r"feature 0 'Sue': \(12, 95\) is no longitude and latitude"):
        load_scenario(tmp_path / "scenario.yaml")


# Lines, outlines, names


def test_lines_are_walls_of_a_width(tmp_path):
    room = [*square(0, 0, 6, 4)[:4], [0, 1.5]]  # a door between (0, 1.5) and (0, 0)
    path = write(tmp_path, feature(*room, kind="LineString", height=2.5))
    world = World.from_geojson(path, wall_width=0.2)
    assert world.bounds == pytest.approx((-0.1, -0.1, 6.1, 4.1))  # corners are closed, and ends reach as far
    x, y = np.array([3.0, 0.0, 6.05, 6.0]), np.array([2.0, 0.75, 4.05, 2.0])
    assert world.clearance(x, y) == pytest.approx([1.9, 0.1, 0.0, 0.0])  # the door is the walls' border away
    assert world.obstacles[0].heights == (0, 2.5)
    with pytest.raises(MapError, match=r"has no polygon .* wall_width: 0.1 makes walls of its lines"):
        World.from_geojson(path)
    with pytest.raises(MapError, match="has no polygon"):
        World.from_geojson(path, wall_width=0.2, polygons="outline")


@pytest.mark.parametrize("width", [0, -1, "0.1", math.nan, True])
def test_a_wrong_width_of_walls_is_refused(tmp_path, width):
    with pytest.raises(MapError, match="wall_width"):
        World.from_geojson(write(tmp_path, feature(square(0, 0, 1, 1))), wall_width=width)


def test_an_outline_that_contains_everything_is_told_with_the_way_out(tmp_path):
    house, case = feature(square(0, 0, 9, 7), name="House"), feature(square(2, 2, 3, 3))
    wall = feature([0, 5], [4, 5], kind="LineString")
    closed = World.from_geojson(write(tmp_path, case, house, wall), wall_width=0.2)
    assert [
        note for note in closed.notes if "feature 1 'House' contains all else" in note and "polygons: outline" in note
    ]
    assert World.from_geojson(write(tmp_path, case, house, wall), polygons="outline").extent.area == 63
    ring = feature(square(0, 0, 9, 7), square(1, 1, 8, 6), name="Wall")
    assert not World.from_geojson(write(tmp_path, case, ring)).notes  # a wall has room within


def test_what_is_noted_of_features_names_them(tmp_path):
    points = [feature(0, 0, kind="Point", name=name) for name in ("door", "desk")]
    path = write(tmp_path, feature(square(0, 0, 1, 1), square(0.2, 0.2, 0.8, 0.8)), *points)
    assert World.from_geojson(path).notes == (
        f"{path}: 2 features (1 'door', 2 'desk'): a 'Point', not a polygon, left out.",
    )
    with pytest.raises(MapError, match="feature 0 'stairs': property height"):
        World.from_geojson(write(tmp_path, feature(square(0, 0, 1, 1), name="stairs", height=[2, 1])))


def test_a_start_that_is_not_free_names_the_obstacle_and_tells_the_notes_of_the_map(tmp_path):
    write(tmp_path, feature(square(0, 0, 9, 7), name="House"), feature(square(2, 2, 3, 3)))
    asked = {
        "world": {"geojson": {"path": "plan.geojson"}},
        "start": [5, 5, 0],
        "goal": [8, 5, 0],
        "criteria": ["length"],
    }
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    result = CliRunner().invoke(main, ["plan", str(tmp_path / "scenario.yaml"), "--out", str(tmp_path / "out")])
    assert result.exit_code == 5
    refused, note = result.output.splitlines()[-2:]
    assert "it is inside the obstacle 'House'" in refused
    assert note.startswith("note: ")
    assert "polygons: outline" in note
