"""GeoJSON as GIS programs write it: coordinate systems, positions of many numbers, open rings, and other formats."""

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
from hpop.world.readers import placement as systems
from tests.worlds import feature, geojson_file, square

CORNER = (9.18, 48.78)
RADIUS = 6378137.0
HALL, CASE = square(0, 0, 20, 12), square(4, 3, 5, 4)


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


# The crs that a file declares


@pytest.mark.parametrize(
    "name", ["urn:ogc:def:crs:EPSG::3857", "EPSG:3857", "http://www.opengis.net/def/crs/EPSG/0/3857"]
)
def test_a_plan_in_web_mercator_is_as_large_as_on_the_earth(tmp_path, name):
    rings = [feature(in_web_mercator(ring)) for ring in (HALL, CASE)]
    world = World.from_geojson(geojson_file(tmp_path, *rings, crs=named_crs(name)), polygons="outline")
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
    world = World.from_geojson(geojson_file(tmp_path, feature(ring), crs=named_crs("urn:ogc:def:crs:EPSG::2263")))
    corners = shapely.get_coordinates(world.obstacles[0].polygon)
    assert sorted(np.hypot(*np.diff(corners, axis=0).T)) == pytest.approx([12, 12, 20, 20], rel=2e-4)


def test_the_option_crs_stands_for_what_the_file_does_not_say(tmp_path):
    path = geojson_file(tmp_path, feature(in_web_mercator(HALL)))
    assert World.from_geojson(path, crs="EPSG:3857").bounds == pytest.approx((0, 0, 20, 12), abs=0.01)
    stretched = World.from_geojson(path)
    assert stretched.bounds[2] - stretched.bounds[0] == pytest.approx(20 / math.cos(math.radians(48.78)), rel=0.005)
    assert "are those of a projection, and are read as metres" in stretched.notes[0]
    assert not [note for note in World.from_geojson(path, units="m").notes if "projection" in note]
    with pytest.raises(MapError, match="leave out scale and units"):
        World.from_geojson(path, crs="EPSG:3857", scale=0.66)


def test_scale_and_units_come_before_the_crs_of_the_file(tmp_path):
    path = geojson_file(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    scale = math.cos(math.radians(CORNER[1]))
    x0, _, x1, _ = World.from_geojson(path, scale=scale).bounds
    assert x1 - x0 == pytest.approx(20, rel=0.005)
    x0, _, x1, _ = World.from_geojson(path, units="m").bounds
    assert x1 - x0 == pytest.approx(20 / scale, rel=0.005)


def test_an_origin_beside_a_crs_is_in_the_units_of_the_file(tmp_path):
    (origin,) = in_web_mercator([(4, 3)])
    path = geojson_file(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    assert World.from_geojson(path, origin=origin).bounds == pytest.approx((-4, -3, 16, 9), abs=0.01)


@pytest.mark.parametrize("name", ["urn:ogc:def:crs:OGC:1.3:CRS84", "EPSG:4326", "OGC:CRS84"])
def test_a_crs_of_degrees_is_degrees_where_the_coordinates_are(tmp_path, name):
    path = geojson_file(tmp_path, feature(in_degrees(HALL)), crs=named_crs(name))
    assert World.from_geojson(path).bounds == pytest.approx((0, 0, 20, 12), abs=0.01)
    drawn = World.from_geojson(geojson_file(tmp_path, feature(HALL), crs=named_crs(name)))  # in a project of EPSG:4326
    assert drawn.bounds == (0, 0, 20, 12)
    assert "says degrees, but it spans 20 x 12 at (0, 0), so it is read as metres" in drawn.notes[0]
    assert not [note for note in World.from_geojson(path.parent / path.name, units="m").notes if "says degrees" in note]


@pytest.mark.parametrize(
    ("crs", "message"),
    [
        (named_crs("urn:ogc:def:crs:EPSG::999999"), "pyproj knows no crs EPSG:999999. Save the file in CRS84"),
        (named_crs("EPSG:2263; drop table"), "a crs must be named by its code, such as EPSG:3857"),
        ({"type": "link", "properties": {"href": "http://example.com/crs/42"}}, "a crs must be named by its code"),
        ("a" * 100_000, "a crs must be named by its code"),
        (named_crs("EPSG:32632"), r"\(9e\+19, 0\) is no place in EPSG:32632"),
    ],
)
def test_a_crs_that_cannot_be_read_is_refused_with_the_way_out(tmp_path, crs, message):
    ring = square(0, 0, 9e19, 1) if "9e" in message else HALL
    with pytest.raises(MapError, match=message if "9e" not in message else "at most|no valid position"):
        World.from_geojson(geojson_file(tmp_path, feature(ring), crs=crs))


def test_without_pyproj_a_crs_is_refused_with_the_scale_that_makes_metres(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    path = geojson_file(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"))
    with pytest.raises(MapError, match=r"pip install 'hpop\[plans\]'. .* or give scale: 0.659"):  # cos(48.78 deg)
        World.from_geojson(path)
    assert World.from_geojson(geojson_file(tmp_path, feature(in_degrees(HALL)), crs=named_crs("EPSG:4326")))


def test_files_beside_a_plan_may_be_of_another_crs(tmp_path):
    geojson_file(tmp_path, feature(in_web_mercator(HALL)), crs=named_crs("EPSG:3857"), name="hall.geojson")
    (same, other) = in_web_mercator([(12, 5)])[0], in_degrees([(12, 5)])[0]
    geojson_file(tmp_path, feature(*same, kind="Point", name="Sue"), name="same.geojson")
    geojson_file(tmp_path, feature(*other, kind="Point", name="Ben"), name="other.geojson")
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


def test_shared_walls_are_found_in_degrees_at_corners_in_the_middle_of_another_room(tmp_path):
    rings = [square(0, 0, 10, 6), square(3, 6, 7, 9)]
    turn = np.array([[math.cos(0.3), math.sin(0.3)], [-math.sin(0.3), math.cos(0.3)]])
    parts = [feature(in_degrees(np.array(ring) @ turn)) for ring in rings]
    assert "are one free space" in World.from_geojson(geojson_file(tmp_path, *parts), polygons="free").notes[-1]


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
    world = World.from_geojson(
        geojson_file(tmp_path, feature(in_web_mercator(HALL)), coordRefSys=system), polygons="free"
    )
    assert world.extent.area == pytest.approx(240, rel=1e-4)
    assert "its coordinates are in EPSG:3857" in world.notes[0]


def test_geometries_of_json_fg_are_degrees_and_its_places_are_told(tmp_path):
    system = "http://www.opengis.net/def/crs/EPSG/0/25832"
    place = {"type": "Polygon", "coordinates": [square(513000, 5403000, 513020, 5403012)]}
    degrees = {**feature(in_degrees(HALL)), "place": place}
    world = World.from_geojson(geojson_file(tmp_path, degrees, coordRefSys=system), polygons="free")
    assert world.extent.area == pytest.approx(240, rel=1e-4)
    assert f"its members place (JSON-FG), in '{system}', are not read" in world.notes[0]
    without = {**degrees, "place": None}
    assert "place" not in " ".join(World.from_geojson(geojson_file(tmp_path, without, coordRefSys=system)).notes)
    with pytest.raises(MapError, match=r"are not read.*no geometry but a place of JSON-FG, left out"):
        World.from_geojson(geojson_file(tmp_path, {**degrees, "geometry": None}, coordRefSys=system))


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
    world = World.from_geojson(geojson_file(tmp_path, feature(HALL), feature(ring)), polygons="outline")
    assert world.obstacles[0].polygon.area == 1
    assert world.notes == (
        f"{tmp_path / 'plan.geojson'}: feature 1: positions of more than two numbers, of which only the first two are "
        "read.",
    )


def test_rings_that_are_open_empty_or_have_no_area_are_mended_or_left_out_and_told(tmp_path):
    path = geojson_file(
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
    world = World.from_geojson(geojson_file(tmp_path, one))
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


def test_positions_whose_third_number_is_null_have_two(tmp_path):
    ring = [[1, 1, 0], [2, 1, None], [2, 2], [1, 2, None], [1, 1, 0]]
    world = World.from_geojson(geojson_file(tmp_path, feature(ring)), units="m")
    assert world.obstacles[0].polygon.area == 1.0
    assert "of which only the first two are read" in world.notes[0]


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
        ("arm.urdf", "it is a robot, not a map: write a scenario as in docs/arm.md"),
        ("plan.svg", "save it as PDF"),
        ("plan.tif", "save it as PNG"),
    ],
)
def test_files_of_other_formats_are_named_by_their_ending(tmp_path, name, message):
    (tmp_path / name).touch()
    with pytest.raises(MapError, match=message):
        World.from_file(tmp_path / name)
