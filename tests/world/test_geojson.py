"""GeoJSON floor plans: a real museum, meanings of polygons, notes, and broken files."""

import json
import math

import numpy as np
import pytest
import shapely

from hpop.errors import MapError
from hpop.world import World

MUSEUM = {"scale": 0.7447, "origin": (-9753627.0, 5140874.0)}  # metres from EPSG:3857, see SOURCE.txt


def square(x0, y0, x1, y1):
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]


def feature(*rings, kind="Polygon", **properties):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": list(rings)},
    }


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
    assert world.notes == (f"{path}: 9 features (0 to 8): no properties, so of the whole height.",)


def test_the_museum_areas_are_free_space(shared_data):
    world = World.from_geojson(shared_data("field_museum_main") / "main_level_areas.geojson", polygons="free", **MUSEUM)
    outline = World.from_geojson(
        shared_data("field_museum_main") / "main_level_outline.geojson", polygons="outline", **MUSEUM
    )
    assert not world.obstacles
    assert world.extent.intersection(outline.extent).area > 0.95 * world.extent.area


def test_a_layer_without_polygons_says_what_it_holds(shared_data):
    with pytest.raises(MapError, match=r"9 features \(0 to .*\): a 'Point', not a polygon"):
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
        f"{path}: feature 2: no properties, so of the whole height.",
        f"{path}: feature 3: a 'LineString', not a polygon, left out.",
        f"{path}: feature 4: no valid polygon (Self-intersection), mended.",
        f"{path}: feature 5: an empty Polygon, left out.",
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
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}', "make no Polygon"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [NaN, 1], [0, 0]]]}', "finite"),
        ('{"type": "Polygon", "coordinates": [[["a", 0], [1, 0], [1, 1], [0, 0]]]}', "make no Polygon"),
        ('{"type": "Polygon", "coordinates": {"a": 1}}', "make no Polygon"),
        ('{"type": "Polygon"}', "make no Polygon"),
    ],
)
def test_broken_files_are_refused(tmp_path, text, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(write(tmp_path, text=text))


@pytest.mark.parametrize("height", ["3 m", [1], [2, 1], -1, 0, True, {"a": 1}])
def test_wrong_heights_name_their_feature(tmp_path, height):
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
