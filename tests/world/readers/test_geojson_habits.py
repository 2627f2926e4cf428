"""GeoJSON as GIS and OpenStreetMap tools write it: crs, rooms with shared walls, tags as text, lines, other formats."""

import json
import math
import sys

import numpy as np
import pytest
import shapely
from geographiclib.geodesic import Geodesic

from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World
from hpop.world.readers import geojson_content
from hpop.world.readers import placement as systems

CORNER = (9.18, 48.78)
RADIUS = 6378137.0


def square(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def feature(*coordinates, kind="Polygon", **properties):
    return {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": list(coordinates)}}


def write(folder, *features, name="plan.geojson", **members):
    path = folder / name
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **members}))
    return path


def in_degrees(metres):
    """Corners (n, 2), m east and north of `CORNER`, as longitude and latitude, by GeographicLib."""
    found = [
        Geodesic.WGS84.Direct(CORNER[1], CORNER[0], math.degrees(math.atan2(x, y)), math.hypot(x, y)) for x, y in metres
    ]
    return [[end["lon2"], end["lat2"]] for end in found]


def in_web_mercator(metres):
    """Convert metres to EPSG:3857, by its two formulas (OGP Guidance Note 7-2, 3.2.1.2)."""
    return [
        [RADIUS * math.radians(lon), RADIUS * math.asinh(math.tan(math.radians(lat)))]
        for lon, lat in in_degrees(metres)
    ]


def named_crs(name):
    return {"type": "name", "properties": {"name": name}}


HALL, CASE = square(0, 0, 20, 12), square(4, 3, 5, 4)

# The crs that a file declares


@pytest.mark.parametrize(
    "name", ["urn:ogc:def:crs:EPSG::3857", "EPSG:3857", "http://www.opengis.net/def/crs/EPSG/0/3857"]
)
def test_a_plan_in_web_mercator_is_as_large_as_on_the_earth(tmp_path, name):
    rings = [feature(in_web_mercator(ring)) for ring in (HALL, CASE)]
    world = World.from_geojson(write(tmp_path, *rings, crs=named_crs(name)), polygons="outline")
    assert world.bounds == pytest.approx((0, 0, 20, 12), abs=0.01)
    assert world.obstacles[0].polygon.bounds == pytest.approx((4, 3, 5, 4), abs=0.01)
    assert "its coordinates are in EPSG:3857, put on a plane" in world.notes[0]
    again = World.from_description(world.describe())
    assert again.bounds == world.bounds
    assert again.notes == world.notes


def test_a_plan_in_feet_is_read_in_metres(tmp_path):
    """EPSG:2263, New York Long Island, US survey feet; a foot is 1200 / 3937 m and its scale 1.000004 at the least."""
    x, y, foot = 989_800.0, 212_520.0, 1200 / 3937
    ring = (np.array(square(0, 0, 20, 12)) / foot + (x, y)).tolist()
    world = World.from_geojson(write(tmp_path, feature(ring), crs=named_crs("urn:ogc:def:crs:EPSG::2263")))
    corners = shapely.get_coordinates(world.obstacles[0].polygon)
    assert sorted(np.hypot(*np.diff(corners, axis=0).T)) == pytest.approx([12, 12, 20, 20], rel=2e-4)


def test_the_option_crs_stands_for_what_the_file_does_not_say(tmp_path):
    path = write(tmp_path, feature(in_web_mercator(HALL)))
    assert World.from_geojson(path, crs="EPSG:3857").bounds == pytest.approx((0, 0, 20, 12), abs=0.01)
    stretched = World.from_geojson(path)
    assert stretched.bounds[2] - stretched.bounds[0] == pytest.approx(20 / math.cos(math.radians(48.78)), rel=0.005)
    assert "are those of a projection, and are read as metres" in stretched.notes[0]
    assert not [note for note in World.from_geojson(path, units="m").notes if "projection" in note]
    with pytest.raises(MapError, match="leave out scale and units"):
        World.from_geojson(path, crs="EPSG:3857", scale=0.66)


def test_scale_and_units_come_before_the_crs_of_the_file(tmp_path):
    path = write(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    scale = math.cos(math.radians(CORNER[1]))
    x0, _, x1, _ = World.from_geojson(path, scale=scale).bounds
    assert x1 - x0 == pytest.approx(20, rel=0.005)
    x0, _, x1, _ = World.from_geojson(path, units="m").bounds
    assert x1 - x0 == pytest.approx(20 / scale, rel=0.005)


def test_an_origin_beside_a_crs_is_in_the_units_of_the_file(tmp_path):
    (origin,) = in_web_mercator([(4, 3)])
    path = write(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    assert World.from_geojson(path, origin=origin).bounds == pytest.approx((-4, -3, 16, 9), abs=0.01)


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "OGC:CRS84"])
def test_a_crs_of_degrees_is_degrees_where_the_coordinates_are(tmp_path, name):
    path = write(tmp_path, feature(in_degrees(HALL)), crs=named_crs(name))
    assert World.from_geojson(path).bounds == pytest.approx((0, 0, 20, 12), abs=0.01)
    drawn = World.from_geojson(write(tmp_path, feature(HALL), crs=named_crs(name)))  # in a project of EPSG:4326
    assert drawn.bounds == (0, 0, 20, 12)
    assert "says degrees, but it spans 20 x 12 at (0, 0), so it is read as metres" in drawn.notes[0]
    assert not [note for note in World.from_geojson(path.parent / path.name, units="m").notes if "says degrees" in note]


@pytest.mark.parametrize(
    ("crs", "message"),
    [
        (named_crs("urn:ogc:def:crs:EPSG::999999"), "pyproj knows no crs EPSG:999999. Save the file in CRS84"),
        (named_crs("EPSG:2263; drop table"), "a crs is named by its code, such as EPSG:3857"),
        ({"type": "link", "properties": {"href": "http://example.com/crs/42"}}, "a crs is named by its code"),
        ("a" * 100_000, "a crs is named by its code"),
        (named_crs("EPSG:32632"), r"\(9e\+19, 0\) is no place in EPSG:32632"),
    ],
)
def test_a_crs_that_cannot_be_read_is_refused_with_the_way_out(tmp_path, crs, message):
    ring = square(0, 0, 9e19, 1) if "9e" in message else HALL
    with pytest.raises(MapError, match=message if "9e" not in message else "at most|no place"):
        World.from_geojson(write(tmp_path, feature(ring), crs=crs))


def test_without_pyproj_a_crs_is_refused_with_the_scale_that_makes_metres(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    path = write(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    with pytest.raises(MapError, match=r"pip install 'hpop\[plans\]'. .* or give scale: 0.659"):  # cos(48.78 deg)
        World.from_geojson(path)
    assert World.from_geojson(write(tmp_path, feature(in_degrees(HALL)), crs=named_crs("EPSG:4326")))


def test_files_beside_a_plan_may_be_of_another_crs(tmp_path):
    write(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"), name="hall.geojson")
    (same, other) = in_web_mercator([(12, 5)])[0], in_degrees([(12, 5)])[0]
    write(tmp_path, feature(*same, kind="Point", name="Sue"), name="same.geojson")
    write(tmp_path, feature(*other, kind="Point", name="Ben"), name="other.geojson")
    plan = {"path": "hall.geojson", "polygons": "outline", "landmarks": ["same.geojson", "other.geojson"]}
    asked = {"world": {"geojson": plan}, "start": [5, 5, 0], "goal": [8, 5, 0], "criteria": ["length"]}
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    sue, ben = load_scenario(tmp_path / "scenario.yaml").problem.world.content.landmarks
    assert (sue.x, sue.y, ben.x, ben.y) == pytest.approx((12, 5, 12, 5), abs=0.01)


def test_old_ways_to_name_a_crs_are_known():
    assert systems.declared({"type": "EPSG", "properties": {"code": 3857}}) == "EPSG:3857"
    assert systems.declared(named_crs("urn:ogc:def:crs:EPSG:6.6:4326")) == systems.DEGREES
    assert systems.declared(named_crs("EPSG:900913")) == "EPSG:3857"
    assert (
        systems.declared({"type": "link", "properties": {"href": "http://x.org/gml/srs/epsg.xml#25832"}})
        == "EPSG:25832"
    )


# Rooms that share walls: R0 and R1 side by side, a corridor R2 along both

ROOMS = [
    feature(square(0, 0, 5, 6), indoor="room", level="0", name="R0"),
    feature(square(5, 0, 10, 6), indoor="room", level="0", name="R1"),
    feature(square(0, 6, 10, 8), indoor="corridor", level="0", name="R2"),
]
DOOR = feature(2.5, 6, kind="Point", door="yes", level="0", width="1 m")


def clear(world, *points):
    return world.clearance(*np.array(points, dtype=float).T).tolist()


def test_rooms_have_walls_where_they_touch_and_doors_open_them(tmp_path):
    """A wall 0.2 m thick along x = 5 and y = 6, with an opening of 1 m about (2.5, 6)."""
    world = World.from_geojson(write(tmp_path, *ROOMS, DOOR), polygons="rooms", wall_width=0.2)
    assert clear(world, (5, 3), (4.95, 3), (5.05, 3), (7.5, 6)) == [0, 0, 0, 0]
    assert clear(world, (4, 3), (7.5, 7)) == pytest.approx([0.9, 0.9])
    (open_width,) = clear(world, (2.5, 6))
    assert open_width == pytest.approx(0.5, abs=0.015)  # half of the door's width, to its jambs
    assert world.extent.geom_type == "MultiPolygon"  # R1 is closed
    assert len(world.extent.geoms) == 2
    assert "3 rooms with walls 0.2 m thick and 1 door." in world.notes[0]


def test_rooms_without_doors_are_closed_and_told_so(tmp_path):
    world = World.from_geojson(write(tmp_path, *ROOMS), polygons="rooms")
    assert len(world.extent.geoms) == 3
    assert "3 rooms with walls 0.1 m thick and 0 doors. Points with a property door open walls." in world.notes[0]
    assert clear(world, (5, 3), (4.94, 3)) == pytest.approx([0, 0.01])


def test_corridors_and_areas_go_over_into_each_other(tmp_path):
    parts = [feature(square(x, 0, x + 5, 4), indoor=kind) for x, kind in ((0, "corridor"), (5, "area"))]
    world = World.from_geojson(write(tmp_path, *parts), polygons="rooms")
    assert clear(world, (5, 2)) == [2]


def test_doors_that_are_lines_open_as_far_as_they_go_and_doors_beside_walls_are_told(tmp_path):
    line = feature([5, 2], [5, 3.2], kind="LineString", indoor="door")
    stray = feature(2, 2, kind="Point", door="hinged", name="stray")
    shut = feature(2.5, 6, kind="Point", door="no")
    world = World.from_geojson(write(tmp_path, *ROOMS, line, stray, shut), polygons="rooms", wall_width=0.2)
    assert clear(world, (5, 2.6)) == pytest.approx([0.6])
    assert clear(world, (5, 1.9), (5, 3.3), (2.5, 6)) == [0, 0, 0]
    assert [note for note in world.notes if "feature 4 'stray': a door that is at no wall, left out" in note]
    assert [note for note in world.notes if "feature 5: a 'Point', not a polygon or line, left out" in note]


def test_walls_that_are_lines_are_opened_by_doors(tmp_path):
    wall = feature([0, 3], [5, 3], kind="LineString", indoor="wall")
    door = feature(2, 3, kind="Point", door="yes")
    world = World.from_geojson(write(tmp_path, ROOMS[0], wall, door), polygons="rooms")
    assert clear(world, (4, 3), (2, 3)) == pytest.approx([0, 0.45], abs=0.01)
    assert [note for note in world.notes if "a door without width, 0.9 m wide" in note]


def test_walls_and_columns_that_are_polygons_are_solid_and_doors_that_are_polygons_open(tmp_path):
    """As indoor maps have them by the property indoor or type: a column in R0, a thick wall through R1 with a door."""
    column = feature(square(1, 1, 2, 2), indoor="column")
    wall = feature(square(5, 3, 10, 3.4), type="wall")
    door = feature(square(7, 3, 8, 3.4), type="door")
    world = World.from_geojson(write(tmp_path, *ROOMS, column, wall, door), polygons="rooms")
    assert clear(world, (1.5, 1.5), (6, 3.2), (9, 3.2)) == [0, 0, 0]
    assert clear(world, (7.5, 3.2)) == pytest.approx([0.5])
    with pytest.raises(MapError, match="its polygons are walls or columns"):
        World.from_geojson(write(tmp_path, column, wall), polygons="rooms")


def test_rooms_that_touch_are_told_to_be_one_free_space(tmp_path):
    path = write(tmp_path, *ROOMS)
    world = World.from_geojson(path, polygons="free")
    assert clear(world, (5, 3)) == [3]
    assert "such as features 0 'R0' and 1 'R1', are one free space without a wall between them" in world.notes[0]
    apart = [feature(square(0, 0, 4, 4)), feature(square(4, 4, 8, 8))]  # they share a corner
    assert World.from_geojson(write(tmp_path, *apart), polygons="free").notes == ()


def test_shared_walls_are_found_in_degrees_at_corners_in_the_middle_of_another_room(tmp_path):
    rings = [square(0, 0, 10, 6), square(3, 6, 7, 9)]
    turn = np.array([[math.cos(0.3), math.sin(0.3)], [-math.sin(0.3), math.cos(0.3)]])
    parts = [feature(in_degrees(np.array(ring) @ turn)) for ring in rings]
    assert "are one free space" in World.from_geojson(write(tmp_path, *parts), polygons="free").notes[-1]


# Features chosen by their properties


def test_features_are_chosen_by_type_and_level(tmp_path):
    floors = [
        feature(square(0, 0, 5, 5), indoor="room", level="0"),
        feature(square(6, 0, 9, 5), indoor="room", level=1),
        feature(square(10, 0, 12, 5), indoor="room", level="0;1"),
        feature(square(13, 0, 15, 5), indoor="column", level="0-2"),
        feature(square(16, 0, 18, 5)),
    ]
    path = write(tmp_path, *floors)

    def left(where):
        return [obstacle.polygon.bounds[0] for obstacle in World.from_geojson(path, where=where).obstacles]

    assert left({"level": "0"}) == left({"level": 0}) == left({"level": 0.0}) == [0, 10, 13]
    assert left({"level": 1, "indoor": "room"}) == [6, 10]
    assert left({"indoor": ["column", "wall"]}) == [13]
    assert left({"level": 2}) == [13]
    world = World.from_geojson(path, where={"level": 0, "indoor": "room"})
    assert "2 of 5 features are read, those with level: 0, indoor: 'room'" in world.notes[0]
    assert len(World.from_description(world.describe()).obstacles) == 2
    (told,) = [note for note in World.from_geojson(path).notes if "several values of level" in note]
    assert "0, 1, 2" in told
    assert "where: {level: 0}" in told


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"indor": "room"}, "no feature has a property 'indor'. Did you mean 'indoor'"),
        ({"indoor": "hall"}, "no feature has indoor: 'hall'. Its values there: 'room, corridor'"),
        ({"indoor": "room", "name": "R2"}, "no feature has all of indoor: 'room', name: 'R2'"),
        ("indoor", "where must name properties"),
        ({"indoor": {"is": "room"}}, "where must name properties"),
        ({"indoor": []}, "where must name properties"),
    ],
)
def test_a_choice_that_leaves_nothing_says_what_there_is(tmp_path, where, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(write(tmp_path, *ROOMS), where=where)


def test_doors_are_chosen_by_their_level_alone(tmp_path):
    upstairs = {**DOOR, "properties": {"door": "yes", "level": "1"}}
    path = write(tmp_path, *ROOMS, DOOR, upstairs)
    world = World.from_geojson(path, polygons="rooms", where={"indoor": ["room", "corridor"], "level": 0})
    assert [note for note in world.notes if "and 1 door." in note]


def test_a_scenario_chooses_features(tmp_path):
    write(tmp_path, *ROOMS)
    world = {"geojson": {"path": "plan.geojson", "polygons": "free", "where": {"name": ["R0", "R2"], "level": 0}}}
    asked = {"world": world, "start": [1, 1, 0], "goal": [4, 4, 0], "criteria": ["length"]}
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    assert load_scenario(tmp_path / "scenario.yaml").problem.world.extent.area == 5 * 6 + 10 * 2


def test_rooms_of_one_multipolygon_keep_the_wall_they_share(tmp_path):
    both = feature([square(0, 0, 5, 6)], [square(5, 0, 10, 6)], kind="MultiPolygon", indoor="room", name="R")
    door = feature(5, 3, kind="Point", door="yes", width="1 m")
    world = World.from_geojson(write(tmp_path, both, door), polygons="rooms", wall_width=0.2)
    apart = World.from_geojson(write(tmp_path, *ROOMS[:2], door, name="two.geojson"), polygons="rooms", wall_width=0.2)
    assert world.extent.equals(apart.extent)
    assert clear(world, (5, 1), (5, 3)) == pytest.approx([0, 0.5], abs=0.015)
    assert "2 rooms with walls 0.2 m thick and 1 door." in " ".join(world.notes)
    assert "feature 0 'R': its polygons touch or overlap, so each is a room of its own." in world.notes[0]
    assert "mended" not in " ".join(world.notes)
    bow = feature([[[0, 0], [5, 6], [5, 0], [0, 6], [0, 0]]], [square(5, 0, 10, 6)], kind="MultiPolygon", indoor="room")
    mended = World.from_geojson(write(tmp_path, bow), polygons="rooms")
    assert "3 rooms" in " ".join(mended.notes)
    assert "no valid polygon (Self-intersection), mended" in " ".join(mended.notes)


# JSON-FG


@pytest.mark.parametrize(
    "system",
    [
        "http://www.opengis.net/def/crs/EPSG/0/3857",
        "[EPSG:3857]",
        {"type": "Reference", "href": "http://www.opengis.net/def/crs/EPSG/0/3857", "epoch": 2016.47},
        ["http://www.opengis.net/def/crs/EPSG/0/3857", "http://www.opengis.net/def/crs/EPSG/0/5703"],
    ],
)
def test_geometries_in_the_coordinates_of_json_fg_are_as_large_as_on_the_earth(tmp_path, system):
    pytest.importorskip("pyproj")
    world = World.from_geojson(write(tmp_path, feature(in_web_mercator(HALL)), coordRefSys=system), polygons="free")
    assert world.extent.area == pytest.approx(240, rel=1e-4)
    assert "its coordinates are in EPSG:3857" in world.notes[0]


def test_geometries_of_json_fg_are_degrees_and_its_places_are_told(tmp_path):
    system = "http://www.opengis.net/def/crs/EPSG/0/25832"
    place = {"type": "Polygon", "coordinates": [square(513000, 5403000, 513020, 5403012)]}
    degrees = {**feature(in_degrees(HALL)), "place": place}
    world = World.from_geojson(write(tmp_path, degrees, coordRefSys=system), polygons="free")
    assert world.extent.area == pytest.approx(240, rel=1e-4)
    assert f"its members place (JSON-FG), in '{system}', are not read" in world.notes[0]
    without = {**degrees, "place": None}
    assert "place" not in " ".join(World.from_geojson(write(tmp_path, without, coordRefSys=system)).notes)
    with pytest.raises(MapError, match=r"are not read.*no geometry but a place of JSON-FG, left out"):
        World.from_geojson(write(tmp_path, {**degrees, "geometry": None}, coordRefSys=system))


# Heights as tags


@pytest.mark.parametrize(
    ("properties", "heights"),
    [
        ({"height": "3"}, (0, 3)),
        ({"height": "12 ft"}, (0, 3.6576)),
        ({"height": "3 m"}, (0, 3)),
        ({"height": "250cm"}, (0, 2.5)),
        ({"height": "6'11\""}, (0, 2.1082)),
        ({"height": "3", "min_height": "2.5"}, (2.5, 3)),
        ({"min_height": 1}, (1, math.inf)),
    ],
)
def test_heights_as_openstreetmap_writes_them_are_metres(tmp_path, properties, heights):
    world = World.from_geojson(write(tmp_path, feature(HALL), feature(CASE, **properties)), polygons="outline")
    assert world.obstacles[0].heights == pytest.approx(heights)
    assert world.notes == ()


@pytest.mark.parametrize(
    ("properties", "heights", "note"),
    [
        ({"est_height": "3"}, (0, 3), "est_height is read as its height"),
        ({"est_height": 3, "min_height": 1}, (1, 3), "est_height is read as its height"),
        ({"est_height": "tall"}, (-math.inf, math.inf), "est_height 'tall', which is no height above 0 in m"),
        ({"building:levels": "2"}, (-math.inf, math.inf), "are numbers of floors, not read; give height in m"),
        ({"building:levels": 2, "building:min_level": 1, "est_height": 6}, (0, 6), "are numbers of floors, not read"),
    ],
)
def test_estimated_heights_are_read_and_numbers_of_floors_are_told(tmp_path, properties, heights, note):
    world = World.from_geojson(write(tmp_path, feature(HALL), feature(CASE, **properties)), polygons="outline")
    assert world.obstacles[0].heights == heights
    assert note in " ".join(world.notes)


def test_a_height_comes_before_an_estimate(tmp_path):
    case = feature(CASE, **{"height": 3, "est_height": 5, "building:levels": 1})
    world = World.from_geojson(write(tmp_path, feature(HALL), case), polygons="outline")
    assert (world.obstacles[0].heights, world.notes) == ((0, 3), ())


@pytest.mark.parametrize("height", [0, "0", -9999, "high", "3 storeys", "", True, {"a": 1}, "9" * 100, 1e300])
def test_a_height_that_is_none_is_the_whole_one_and_told(tmp_path, height):
    world = World.from_geojson(write(tmp_path, feature(CASE, height=height, name="case")))
    assert world.obstacles[0].heights == (-math.inf, math.inf)
    assert "feature 0 'case': height " in world.notes[0]
    assert "so of the whole height" in world.notes[0]


# Geometries as GIS writes them


@pytest.mark.parametrize(
    "ring",
    [
        [[5, 3], [5, 4, 2.5], [4, 4], [4, 3, 2.5], [5, 3]],
        [[5, 3, 1], [5, 4, 1], [4, 4, 1], [4, 3, 1], [5, 3, 2]],  # closed in the plane alone
        [[5, 3, 1, 9], [5, 4, 1, 9], [4, 4, 1, 9], [4, 3, 1, 9], [5, 3, 1, 9]],
    ],
)
def test_numbers_beyond_the_second_of_a_position_are_left_out_and_told(tmp_path, ring):
    world = World.from_geojson(write(tmp_path, feature(HALL), feature(ring)), polygons="outline")
    assert world.obstacles[0].polygon.area == 1
    assert world.notes == (
        f"{tmp_path / 'plan.geojson'}: feature 1: positions of more than two numbers, of which only the first two are "
        "read.",
    )


def test_rings_that_are_open_empty_or_have_no_area_are_mended_or_left_out_and_told(tmp_path):
    path = write(
        tmp_path,
        feature(CASE[:4], name="open"),
        feature([[9, 9], [9, 9], [9, 9], [9, 9]], name="dot"),
        feature([[7, 7], [8, 8], [9, 9], [7, 7]], name="line"),
        feature(square(10, 3, 12, 5), [[11, 4], [11, 4]], name="hole"),
        feature([*CASE[:3], CASE[2], *CASE[3:]], name="twice"),
        feature([], name="empty"),
    )
    world = World.from_geojson(path)
    assert [o.polygon.area for o in world.obstacles] == [1, 4, 1]
    assert world.notes == (
        f"{path}: feature 0 'open': a ring that is not closed, closed.",
        f"{path}: 2 features (1 'dot', 3 'hole'): a ring of fewer than 3 different points, left out.",
        f"{path}: feature 1 'dot': an empty Polygon, left out.",
        f"{path}: feature 2 'line': no valid polygon (Self-intersection), mended.",
        f"{path}: feature 2 'line': a polygon without area, left out.",
        f"{path}: feature 5 'empty': an empty Polygon, left out.",
    ) or [note for note in world.notes if "'line': a polygon without area, left out" in note]


def test_collections_are_read_part_by_part(tmp_path):
    inner = {
        "type": "GeometryCollection",
        "geometries": [feature([square(8, 0, 9, 1)], kind="MultiPolygon")["geometry"]],
    }
    parts = [feature(CASE)["geometry"], feature(1, 1, kind="Point")["geometry"], inner, None]
    one = {
        "type": "Feature",
        "properties": {"height": "2"},
        "geometry": {"type": "GeometryCollection", "geometries": parts},
    }
    world = World.from_geojson(write(tmp_path, one))
    assert [(o.polygon.area, o.heights) for o in world.obstacles] == [(1, (0, 2)), (1, (0, 2))]
    assert "a 'Point', not a polygon, left out" in world.notes[0]
    assert "no geometry, left out" in world.notes[1]


def test_marks_line_ends_and_large_ids_are_read(tmp_path):
    path = tmp_path / "plan.geojson"
    text = json.dumps({"type": "FeatureCollection", "features": [{**feature(CASE), "id": 10**30}]}, indent=1)
    path.write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert World.from_geojson(path).obstacles[0].name == str(10**30)
    path.write_text(text, encoding="utf-16")
    with pytest.raises(MapError, match="It is UTF-16"):
        World.from_geojson(path)


# Several texts, and other formats


@pytest.mark.parametrize("begin", ["", "\x1e", "\n"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\n\n"])
def test_features_one_a_line_are_read(tmp_path, begin, end):
    path = tmp_path / "plan.geojsonl"
    lines = [feature(HALL), *(feature(square(x, 3, x + 1, 4)) for x in (3, 6, 9, 12))]
    path.write_text("".join(begin + json.dumps(line) + end for line in lines), newline="")
    world = World.from_file(path, polygons="outline")
    assert (world.bounds, len(world.obstacles)) == ((0, 0, 20, 12), 4)
    assert world.notes == (f"{path}: 5 texts of JSON, read as one collection.",)


def test_a_text_that_is_none_among_several_is_told_with_its_number(tmp_path):
    path = tmp_path / "plan.geojson"
    path.write_text(json.dumps(feature(HALL)) + "\n" + json.dumps(feature(CASE))[:-9])
    with pytest.raises(MapError, match=r"text 2 of it is not JSON: .*line 2"):
        World.from_geojson(path)
    path.write_text(json.dumps(feature(HALL)) + "\n3\n")
    with pytest.raises(MapError, match="in each of its texts; got 3"):
        World.from_geojson(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'{"type": "Topology", "objects": {}, "arcs": []}', "It is TopoJSON: convert it, such as by mapshaper"),
        (b'{"version": 0.6, "elements": []}', "as Overpass gives it: convert it by osmtogeojson"),
        (b'{"geometryType": "esriGeometryPolygon", "features": []}', "It is Esri's JSON: convert it"),
        (b'<?xml version="1.0"?>\n<osm version="0.6"></osm>', "OpenStreetMap's XML: convert it by osmtogeojson"),
        (b"<kml></kml>", "It seems to be KML: convert it, such as by ogr2ogr"),
        (b"<!DOCTYPE html><p>", "a web page: download the file itself"),
        (b"PK\x03\x04\x00", "no GeoJSON but a zip archive, of a Shapefile perhaps"),
        (b"SQLite format 3\x00", "a GeoPackage .*ogr2ogr -f GeoJSON"),
        (b"\x00\x00\x27\x0a\x00", "a Shapefile: convert it"),
        (b"\x1f\x8b\x08\x00", "compressed by gzip"),
    ],
)
def test_other_formats_are_named_with_the_way_to_convert_them(tmp_path, content, message):
    path = tmp_path / "plan.geojson"
    path.write_bytes(content)
    with pytest.raises(MapError, match=message):
        World.from_geojson(path)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plan.shp", "ogr2ogr -f GeoJSON"),
        ("plan.gpkg", "ogr2ogr"),
        ("plan.osm", "osmtogeojson"),
        ("plan.dwg", "save it as DXF"),
        ("plan.svg", "save it as PDF"),
        ("plan.tif", "save it as PNG"),
    ],
)
def test_files_of_other_formats_are_named_by_their_ending(tmp_path, name, message):
    (tmp_path / name).touch()
    with pytest.raises(MapError, match=message):
        World.from_file(tmp_path / name)


# Heights and positions that nobody can read


@pytest.mark.parametrize(
    ("given", "note"),
    [
        ({"height": 99999999}, "height 99999999, which is no height above 0"),
        ({"height": "12", "min_height": -5e6}, "height '12', min_height -5000000.0, which is no height above 0"),
        ({"HEIGHT": 3}, "HEIGHT 3 is not read: name it height"),
        ({"Min_Height": 1, "height": 3}, "Min_Height 1 is not read: name it min_height"),
    ],
)
def test_heights_beyond_all_bounds_and_in_other_letter_case_are_told(tmp_path, given, note):
    world = World.from_geojson(write(tmp_path, feature(square(1, 1, 2, 2), **given)), units="m")
    assert any(f"feature 0: {note}" in said for said in world.notes)


def test_positions_whose_third_number_is_null_have_two(tmp_path):
    ring = [[1, 1, 0], [2, 1, None], [2, 2], [1, 2, None], [1, 1, 0]]
    world = World.from_geojson(write(tmp_path, feature(ring)), units="m")
    assert world.obstacles[0].polygon.area == 1.0
    assert "of which only the first two are read" in world.notes[0]


# Rules of zones as text


@pytest.mark.parametrize(("closed", "count"), [("yes", 1), ("1", 1), ("true", 1), ("no", 0), ("0", 0), (0, 0)])
def test_closed_as_text_makes_a_zone(tmp_path, closed, count):
    content, notes = geojson_content.read(zones=write(tmp_path, feature(CASE, closed=closed)))
    assert (len(content.zones), notes) == (count, ())


def test_a_rule_that_says_nothing_is_told_and_numbers_as_text_are_numbers(tmp_path):
    path = write(tmp_path, feature(CASE, closed="perhaps"), feature(CASE, limit="0.5", name="slow"))
    content, notes = geojson_content.read(zones=path)
    assert content.zones[0].limit == 0.5
    assert (
        "feature 0: no rule (kind speed or keep-out, limit, or closed); its closed is 'perhaps', left out" in notes[0]
    )
    flows = write(tmp_path, feature([0, 0], [9, 0], kind="LineString", width="200 cm"))
    assert geojson_content.read(flows=flows)[0].zones[0].area.bounds == (0, -1, 9, 1)
