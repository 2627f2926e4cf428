"""Landmarks, flows and zones from GeoJSON: a real museum, rules of features, notes, and broken files."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely

from hpop.errors import MapError
from hpop.world import World
from hpop.world.readers.geojson_content import read

MUSEUM = {"scale": 0.7447, "origin": (-9753627.0, 5140874.0)}  # metres from EPSG:3857, see SOURCE.txt
RING = [[0, 0], [4, 0], [4, 2], [0, 2], [0, 0]]
MISSING = object()


def feature(kind, coordinates, properties=MISSING, **members):
    given = {} if properties is MISSING else {"properties": properties}
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, **given, **members}


def write(folder, *features, name="content.geojson"):
    path = folder / name
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def test_the_museums_labels_are_landmarks_and_the_one_without_a_place_is_told(shared_data):
    content, notes = read(landmarks=shared_data("field_museum_main") / "main_level_labels.geojson", **MUSEUM)
    names = [landmark.name for landmark in content.landmarks]
    assert len(names) == 9
    assert {"birds", "africa", "animals", "americas"} < set(names)
    birds = content.landmarks[names.index("birds")]
    # By hand from the file: -9753555.605853485 and 5141014.957947677 less the origin, times the scale.
    assert (birds.x, birds.y) == pytest.approx((71.394146515 * 0.7447, 140.957947677 * 0.7447))
    assert [note.split("geojson: ")[1] for note in notes] == ["feature 8 'messages_wilderness': no geometry, left out."]


def test_the_museums_pictograms_and_amenities_have_names(shared_data):
    folder = shared_data("field_museum_main")
    paths = [folder / f"main_level_{layer}.geojson" for layer in ("pictograms", "amenities")]
    content, notes = read(landmarks=paths, **MUSEUM)
    names = [landmark.name for landmark in content.landmarks]
    assert len(names) == 9 + 15
    assert {"Máximo the Titanosaur", "elephant", "restroom", "elevator"} < set(names)
    assert notes == ()


def test_the_museums_flows_are_one_way_zones_as_wide_as_asked(shared_data):
    content, notes = read(flows=shared_data("field_museum_main") / "main_level_flows.geojson", width=2.0, **MUSEUM)
    assert len(content.zones) == 9
    assert {zone.kind for zone in content.zones} == {"one-way"}
    birds = next(zone for zone in content.zones if shapely.get_num_points(zone.path) == 2)
    assert birds.area.area == pytest.approx(2.0 * birds.path.length)
    assert birds.path.coords[0][0] > birds.path.coords[-1][0]  # it leads west, as it is drawn
    assert notes == ()


def test_the_museums_closed_areas_are_keep_out_zones_inside_the_building(shared_data):
    folder = shared_data("field_museum_main")
    content, notes = read(zones=folder / "main_level_areas.geojson", **MUSEUM)
    # The file says closed: 0 of open areas, and 1 or 2 of the others.
    data = json.loads((folder / "main_level_areas.geojson").read_text())
    closed = [item for item in data["features"] if item["properties"]["closed"]]
    assert len(content.zones) == len(closed) > 0
    assert {zone.kind for zone in content.zones} == {"keep-out"}
    assert "Founders Room" in {zone.name for zone in content.zones}
    assert notes == ()
    building = World.from_geojson(folder / "main_level_outline.geojson", polygons="outline", **MUSEUM).extent
    room = next(zone.area for zone in content.zones if zone.name == "Founders Room")
    assert room.intersection(building).area > 0.9 * room.area


def test_a_museum_with_all_its_content_survives_saving_though_its_content_files_change(shared_data, tmp_path):
    folder = shared_data("field_museum_main")
    files = {}
    for layer in ("labels", "flows", "areas"):
        files[layer] = tmp_path / f"{layer}.geojson"
        files[layer].write_bytes((folder / f"main_level_{layer}.geojson").read_bytes())
    content, _ = read(landmarks=files["labels"], flows=files["flows"], zones=files["areas"], **MUSEUM)
    outline = World.from_geojson(folder / "main_level_outline.geojson", polygons="outline", **MUSEUM)
    world = outline.with_content(landmarks=content.landmarks, zones=content.zones)
    description = json.loads(json.dumps(world.describe()))
    for path in files.values():
        path.unlink()
    again = World.from_description(description)
    assert again.content.landmarks == content.landmarks
    for old, new in zip(content.zones, again.content.zones, strict=True):
        assert shapely.equals_identical(old.area, new.area)
        assert (old.kind, old.path, old.name) == (new.kind, new.path, new.name)
    assert again.contents == world.contents >= {"landmarks", "one-way zones"}


@pytest.mark.parametrize(
    ("properties", "members", "name"),
    [
        ({"name": "Sue", "label": "T. rex"}, {"id": 7}, "Sue"),
        ({"name": "", "label": "T.\nrex"}, {"id": 7}, "T. rex"),
        ({"name": None, "title": "Hall"}, {}, "Hall"),
        ({"type": "statue"}, {"id": 7}, "7"),
        ({"type": "statue", "id": "sue"}, {}, "sue"),
        ({"type": "statue"}, {}, "statue"),
        ({"name": ["Sue"]}, {}, ""),
        ({}, {}, ""),
    ],
)
def test_a_landmarks_name_is_the_first_that_is_there(tmp_path, properties, members, name):
    content, _ = read(landmarks=write(tmp_path, feature("Point", [1, 2], properties, **members)))
    assert content.landmarks[0].name == name


def test_a_landmarks_properties_are_read_and_its_place_is_scaled(tmp_path):
    path = write(
        tmp_path,
        feature("Point", [13, 24, 99], {"z": 2.5, "facing": -1, "weight": 3}),
        feature("MultiPoint", [[10, 20], [12, 20]], {"z": None}),
    )
    content, _ = read(landmarks=path, scale=0.5, origin=(10, 20))
    first, *others = content.landmarks
    assert (first.x, first.y, first.z, first.facing, first.weight) == (1.5, 2.0, 2.5, -1.0, 3.0)
    assert [(other.x, other.y, other.z, other.facing, other.weight) for other in others] == [
        (0.0, 0.0, 1.5, None, 1.0),
        (1.0, 0.0, 1.5, None, 1.0),
    ]


def test_a_flow_ends_where_its_line_ends_and_may_have_its_own_width(tmp_path):
    path = write(
        tmp_path, feature("LineString", [[0, 0], [10, 0]], {"width": 4}), feature("LineString", [[0, 9], [8, 9]], {})
    )
    wide, usual = read(flows=path, scale=0.5, width=1.0)[0].zones
    assert wide.area.equals(shapely.box(0, -2, 5, 2))  # metres, whatever the scale
    assert usual.area.equals(shapely.box(0, 4, 4, 5))
    assert list(wide.path.coords) == [(0, 0), (5, 0)]


@pytest.mark.parametrize(
    ("properties", "kind"),
    [
        ({"limit": 0.5}, "speed"),
        ({"kind": "speed", "limit": 0.5, "closed": 1}, "speed"),
        ({"closed": True}, "keep-out"),
        ({"closed": 2}, "keep-out"),
        ({"kind": "keep-out", "closed": 0}, "keep-out"),
    ],
)
def test_a_polygon_with_a_rule_is_a_zone(tmp_path, properties, kind):
    (zone,) = read(zones=write(tmp_path, feature("Polygon", [RING], {**properties, "name": "here"})))[0].zones
    assert (zone.kind, zone.name, zone.limit) == (kind, "here", 0.5 if kind == "speed" else None)
    assert zone.area.equals(shapely.box(0, 0, 4, 2))


def test_what_is_left_out_is_told_and_never_fatal(tmp_path):
    path = write(
        tmp_path,
        feature("Polygon", [RING], {"closed": 1}),
        feature("Polygon", [RING]),
        feature("Polygon", [RING], {"kind": "exhibition"}),
        feature("Polygon", [RING], {"closed": 0}),
        {"type": "Feature", "properties": {"closed": 1}},
        {"type": "Feature", "properties": {"closed": 1}, "geometry": None},
        feature("Point", [1, 1], {}),
        feature("Polygon", [[[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]]], {"closed": 1}),
        feature("Polygon", [], {"closed": 1}),
    )
    content, notes = read(zones=path)
    assert len(content.zones) == 3  # the bow tie became two triangles
    rule = "no rule (kind speed or keep-out, limit, or closed)"
    assert [note.removeprefix(f"{path}: ") for note in notes] == [
        "feature 1: no properties.",
        f"feature 1: {rule}, left out.",
        f"feature 2: {rule}; its kind is 'exhibition', left out.",
        "2 features (4 to 5): no geometry, left out.",
        "feature 6: a 'Point', not a polygon, left out.",
        "feature 7: no valid polygon (Self-intersection), mended.",
        "feature 8: an empty Polygon, left out.",
    ]


def test_a_landmark_without_properties_is_there_without_a_name(tmp_path):
    content, notes = read(landmarks=write(tmp_path, feature("Point", [1, 2])))
    assert [(landmark.x, landmark.y, landmark.name) for landmark in content.landmarks] == [(1.0, 2.0, "")]
    assert notes == (f"{tmp_path / 'content.geojson'}: feature 0: no properties.",)


def test_a_flow_without_length_is_told(tmp_path):
    path = write(tmp_path, feature("MultiLineString", [[[0, 0], [0, 0]], [[0, 0], [1, 0]]], {}))
    content, notes = read(flows=path)
    assert len(content.zones) == 1
    assert "line without length" in notes[0]


def test_a_bare_geometry_is_read(tmp_path):
    path = tmp_path / "point.geojson"
    path.write_text('{"type": "Point", "coordinates": [1, 2]}')
    assert len(read(landmarks=str(path))[0].landmarks) == 1


@pytest.mark.parametrize(
    ("role", "what", "message"),
    [
        ("landmarks", feature("Point", [0, 0], {"z": "high"}), "feature 0: a landmark: z must be a number"),
        (
            "landmarks",
            feature("Point", [0, 0], {"name": "Sue", "weight": 0}),
            "feature 0 'Sue': landmark 'Sue' needs a weight",
        ),
        ("landmarks", feature("Point", [0, 0], {"facing": "north"}), "feature 0: a landmark: facing must be"),
        ("landmarks", feature("Point", [0, math.nan], {}), "feature 0: its coordinates must be finite"),
        ("landmarks", feature("Point", ["a", 0], {}), "feature 0: its coordinates make no Point"),
        ("landmarks", feature("Polygon", [RING], {}), "has no point. .*feature 0: a 'Polygon', not a point"),
        ("flows", feature("LineString", [[0, 0], [1, 0]], {"width": -1}), "feature 0: property width"),
        ("flows", feature("Point", [0, 0], {}), "has no line"),
        ("zones", feature("Polygon", [RING], {"kind": "speed"}), "feature 0: a speed zone: limit must be a number"),
        ("zones", feature("Polygon", [RING], {"limit": -1}), "feature 0: a speed zone needs a limit above"),
        ("zones", feature("LineString", [[0, 0], [1, 0]], {}), "has no polygon"),
    ],
)
def test_what_makes_no_sense_names_file_and_feature(tmp_path, role, what, message):
    path = write(tmp_path, what)
    with pytest.raises(MapError, match=message) as error:
        read(**{role: path})
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    "options", [{"scale": 0}, {"origin": (1,)}, {"width": 0}, {"width": math.nan}, {"width": "3 m"}]
)
def test_wrong_options_are_refused(options):
    with pytest.raises(MapError, match=next(iter(options))):
        read(**options)


def test_missing_and_broken_files_are_refused(tmp_path):
    (tmp_path / "broken").write_text("{")
    for name in ("none", "broken", "."):
        with pytest.raises(MapError):
            read(landmarks=tmp_path / name)


def test_nothing_asked_is_nothing_read():
    content, notes = read()
    assert content.present == frozenset()
    assert notes == ()


def test_a_closed_area_blocks_the_robot(tmp_path):
    path = write(tmp_path, feature("Polygon", [RING], {"closed": 1}))
    world = World.from_polygons([], extent=shapely.box(-5, -5, 9, 7))
    zones = read(zones=path)[0].zones
    assert world.with_content(zones=zones).clearance(np.array([2.0, 6.0]), np.array([1.0, 1.0])).tolist() == [0.0, 2.0]


FLOORS = {"landmarks": ("Point", [1, 1]), "flows": ("LineString", [[0, 0], [4, 0]]), "zones": ("Polygon", [RING])}


def floors(folder, role):
    """Write a file whose features are on the levels 0, 1, 0 to 2, and none."""
    kind, coordinates = FLOORS[role]
    given = [{"level": 0}, {"level": "1"}, {"level": "0-2"}, {}]
    features = [feature(kind, coordinates, {"name": f"n{i}", "limit": 1, **own}) for i, own in enumerate(given)]
    return write(folder, *features, name=f"{role}.geojson")


@pytest.mark.parametrize("role", FLOORS)
def test_where_chooses_the_features_of_content_that_are_read_and_a_note_says_how_many(tmp_path, role):
    path = floors(tmp_path, role)
    content, notes = read(**{role: {"path": path, "where": {"level": [0]}}})
    assert [one.name for one in content.landmarks + content.zones] == ["n0", "n2"]
    assert notes == (f"{path}: 2 of 4 features are read, those with level: [0].",)


@pytest.mark.parametrize("role", FLOORS)
def test_content_of_several_floors_that_is_read_as_one_is_noted(tmp_path, role):
    content, (note,) = read(**{role: floors(tmp_path, role)})
    assert len(content.landmarks + content.zones) == 4
    assert "several values of level ('0, 1, 2'), all read as one floor. where: {level: 0} chooses" in note


def test_each_file_of_content_is_chosen_from_by_itself(tmp_path):
    other = write(tmp_path, feature("Point", [2, 2], {"name": "door"}), name="other.geojson")
    files = [other, {"path": str(floors(tmp_path, "landmarks")), "where": {"level": 1}}]
    assert [one.name for one in read(landmarks=files)[0].landmarks] == ["door", "n1", "n2"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"path": "zones.geojson", "where": {"levle": 0}}, "no feature has a property 'levle'.*Did you mean 'level'"),
        ({"path": "zones.geojson", "where": {"level": 7}}, "no feature has level: 7. Values in the file: '0, 1, 2'"),
        ({"path": "zones.geojson", "where": "level"}, "where must name properties, each with a value"),
        ({"path": "zones.geojson", "were": {"level": 0}}, "must be a path, or a mapping with path and where"),
        ({"where": {"level": 0}}, "must be a path, or a mapping with path and where"),
    ],
)
def test_a_choice_of_content_that_makes_no_sense_is_refused(tmp_path, monkeypatch, given, said):
    monkeypatch.chdir(tmp_path)
    floors(tmp_path, "zones")
    with pytest.raises(MapError, match=said):
        read(zones=given)
