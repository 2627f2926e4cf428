"""GeoJSON of indoor maps, as OpenStreetMap has them: rooms that share walls, doors, levels, and tags as text."""

import json
import math

import numpy as np
import pytest

from hpop.errors import MapError
from hpop.scenario import load_scenario
from hpop.world import World
from hpop.world.readers import geojson_content
from tests.worlds import feature, geojson_file, square

HALL, CASE = square(0, 0, 20, 12), square(4, 3, 5, 4)


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
    world = World.from_geojson(geojson_file(tmp_path, *ROOMS, DOOR), polygons="rooms", wall_width=0.2)
    assert clear(world, (5, 3), (4.95, 3), (5.05, 3), (7.5, 6)) == [0, 0, 0, 0]
    assert clear(world, (4, 3), (7.5, 7)) == pytest.approx([0.9, 0.9])
    (open_width,) = clear(world, (2.5, 6))
    assert open_width == pytest.approx(0.5, abs=0.015)  # half of the door's width, to its jambs
    assert world.extent.geom_type == "MultiPolygon"  # R1 is closed
    assert len(world.extent.geoms) == 2
    assert "3 rooms with walls 0.2 m thick and 1 door." in world.notes[0]


def test_rooms_without_doors_are_closed_and_told_so(tmp_path):
    world = World.from_geojson(geojson_file(tmp_path, *ROOMS), polygons="rooms")
    assert len(world.extent.geoms) == 3
    assert (
        "3 rooms with walls 0.1 m thick and 0 doors. For a door, add a point with a property door on a wall."
        in world.notes[0]
    )
    assert clear(world, (5, 3), (4.94, 3)) == pytest.approx([0, 0.01])


def test_corridors_and_areas_go_over_into_each_other(tmp_path):
    parts = [feature(square(x, 0, x + 5, 4), indoor=kind) for x, kind in ((0, "corridor"), (5, "area"))]
    world = World.from_geojson(geojson_file(tmp_path, *parts), polygons="rooms")
    assert clear(world, (5, 2)) == [2]


def test_doors_that_are_lines_open_as_far_as_they_go_and_doors_beside_walls_are_told(tmp_path):
    line = feature([5, 2], [5, 3.2], kind="LineString", indoor="door")
    stray = feature(2, 2, kind="Point", door="hinged", name="stray")
    shut = feature(2.5, 6, kind="Point", door="no")
    world = World.from_geojson(geojson_file(tmp_path, *ROOMS, line, stray, shut), polygons="rooms", wall_width=0.2)
    assert clear(world, (5, 2.6)) == pytest.approx([0.6])
    assert clear(world, (5, 1.9), (5, 3.3), (2.5, 6)) == [0, 0, 0]
    assert [note for note in world.notes if "feature 4 'stray': a door that is at no wall, left out" in note]
    assert [note for note in world.notes if "feature 5: a 'Point', not a polygon or line, left out" in note]


def test_walls_that_are_lines_are_opened_by_doors(tmp_path):
    wall = feature([0, 3], [5, 3], kind="LineString", indoor="wall")
    door = feature(2, 3, kind="Point", door="yes")
    world = World.from_geojson(geojson_file(tmp_path, ROOMS[0], wall, door), polygons="rooms")
    assert clear(world, (4, 3), (2, 3)) == pytest.approx([0, 0.45], abs=0.01)
    assert [note for note in world.notes if "a door without width, 0.9 m wide" in note]


def test_walls_and_columns_that_are_polygons_are_solid_and_doors_that_are_polygons_open(tmp_path):
    """As indoor maps have them by the property indoor or type: a column in R0, a thick wall through R1 with a door."""
    column = feature(square(1, 1, 2, 2), indoor="column")
    wall = feature(square(5, 3, 10, 3.4), type="wall")
    door = feature(square(7, 3, 8, 3.4), type="door")
    world = World.from_geojson(geojson_file(tmp_path, *ROOMS, column, wall, door), polygons="rooms")
    assert clear(world, (1.5, 1.5), (6, 3.2), (9, 3.2)) == [0, 0, 0]
    assert clear(world, (7.5, 3.2)) == pytest.approx([0.5])
    with pytest.raises(MapError, match="but all are walls or columns"):
        World.from_geojson(geojson_file(tmp_path, column, wall), polygons="rooms")


def test_rooms_that_touch_are_told_to_be_one_free_space(tmp_path):
    path = geojson_file(tmp_path, *ROOMS)
    world = World.from_geojson(path, polygons="free")
    assert clear(world, (5, 3)) == [3]
    assert "such as features 0 'R0' and 1 'R1', are one free space without a wall between them" in world.notes[0]
    apart = [feature(square(0, 0, 4, 4)), feature(square(4, 4, 8, 8))]  # they share a corner
    assert World.from_geojson(geojson_file(tmp_path, *apart), polygons="free").notes == ()


# Features chosen by their properties


def test_features_are_chosen_by_type_and_level(tmp_path):
    floors = [
        feature(square(0, 0, 5, 5), indoor="room", level="0"),
        feature(square(6, 0, 9, 5), indoor="room", level=1),
        feature(square(10, 0, 12, 5), indoor="room", level="0;1"),
        feature(square(13, 0, 15, 5), indoor="column", level="0-2"),
        feature(square(16, 0, 18, 5)),
    ]
    path = geojson_file(tmp_path, *floors)

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
        ({"indoor": "hall"}, "no feature has indoor: 'hall'. Values in the file: 'room, corridor'"),
        ({"indoor": "room", "name": "R2"}, "no feature has all of indoor: 'room', name: 'R2'"),
        ("indoor", "where must name properties"),
        ({"indoor": {"is": "room"}}, "where must name properties"),
        ({"indoor": []}, "where must name properties"),
    ],
)
def test_a_choice_that_leaves_nothing_says_what_there_is(tmp_path, where, message):
    with pytest.raises(MapError, match=message):
        World.from_geojson(geojson_file(tmp_path, *ROOMS), where=where)


def test_doors_are_chosen_by_their_level_alone(tmp_path):
    upstairs = {**DOOR, "properties": {"door": "yes", "level": "1"}}
    path = geojson_file(tmp_path, *ROOMS, DOOR, upstairs)
    world = World.from_geojson(path, polygons="rooms", where={"indoor": ["room", "corridor"], "level": 0})
    assert [note for note in world.notes if "and 1 door." in note]


def test_a_scenario_chooses_features(tmp_path):
    geojson_file(tmp_path, *ROOMS)
    world = {"geojson": {"path": "plan.geojson", "polygons": "free", "where": {"name": ["R0", "R2"], "level": 0}}}
    asked = {"world": world, "start": [1, 1, 0], "goal": [4, 4, 0], "criteria": ["length"]}
    (tmp_path / "scenario.yaml").write_text(json.dumps(asked))
    assert load_scenario(tmp_path / "scenario.yaml").problem.world.extent.area == 5 * 6 + 10 * 2


def test_rooms_of_one_multipolygon_keep_the_wall_they_share(tmp_path):
    both = feature([square(0, 0, 5, 6)], [square(5, 0, 10, 6)], kind="MultiPolygon", indoor="room", name="R")
    door = feature(5, 3, kind="Point", door="yes", width="1 m")
    world = World.from_geojson(geojson_file(tmp_path, both, door), polygons="rooms", wall_width=0.2)
    apart = World.from_geojson(
        geojson_file(tmp_path, *ROOMS[:2], door, name="two.geojson"), polygons="rooms", wall_width=0.2
    )
    assert world.extent.equals(apart.extent)
    assert clear(world, (5, 1), (5, 3)) == pytest.approx([0, 0.5], abs=0.015)
    assert "2 rooms with walls 0.2 m thick and 1 door." in " ".join(world.notes)
    assert "feature 0 'R': its polygons touch or overlap, so each is a room of its own." in world.notes[0]
    assert "mended" not in " ".join(world.notes)
    bow = feature([[[0, 0], [5, 6], [5, 0], [0, 6], [0, 0]]], [square(5, 0, 10, 6)], kind="MultiPolygon", indoor="room")
    mended = World.from_geojson(geojson_file(tmp_path, bow), polygons="rooms")
    assert "3 rooms" in " ".join(mended.notes)
    assert "no valid polygon (Self-intersection), mended" in " ".join(mended.notes)


# Heights as tags


@pytest.mark.parametrize(
    ("properties", "heights"),
    [
        ({"height": "3"}, (0, 3)),
        ({"height": "12 ft"}, (0, 3.6576)),
        ({"height": "2500 mm"}, (0, 2.5)),
        ({"height": "3 m"}, (0, 3)),
        ({"height": "250cm"}, (0, 2.5)),
        ({"height": "6'11\""}, (0, 2.1082)),
        ({"height": "3", "min_height": "2.5"}, (2.5, 3)),
        ({"min_height": 1}, (1, math.inf)),
    ],
)
def test_heights_as_openstreetmap_writes_them_are_metres(tmp_path, properties, heights):
    world = World.from_geojson(geojson_file(tmp_path, feature(HALL), feature(CASE, **properties)), polygons="outline")
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
    world = World.from_geojson(geojson_file(tmp_path, feature(HALL), feature(CASE, **properties)), polygons="outline")
    assert world.obstacles[0].heights == heights
    assert note in " ".join(world.notes)


def test_a_height_comes_before_an_estimate(tmp_path):
    case = feature(CASE, **{"height": 3, "est_height": 5, "building:levels": 1})
    world = World.from_geojson(geojson_file(tmp_path, feature(HALL), case), polygons="outline")
    assert (world.obstacles[0].heights, world.notes) == ((0, 3), ())


@pytest.mark.parametrize("height", [0, "0", -9999, "high", "3 storeys", "", True, {"a": 1}, "9" * 100, 1e300])
def test_a_height_that_is_none_is_the_whole_one_and_told(tmp_path, height):
    world = World.from_geojson(geojson_file(tmp_path, feature(CASE, height=height, name="case")))
    assert world.obstacles[0].heights == (-math.inf, math.inf)
    assert "feature 0 'case': height " in world.notes[0]
    assert "so of unlimited height" in world.notes[0]


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
    world = World.from_geojson(geojson_file(tmp_path, feature(square(1, 1, 2, 2), **given)), units="m")
    assert any(f"feature 0: {note}" in said for said in world.notes)


# Rules of zones as text


@pytest.mark.parametrize(("closed", "count"), [("yes", 1), ("1", 1), ("true", 1), ("no", 0), ("0", 0), (0, 0)])
def test_closed_as_text_makes_a_zone(tmp_path, closed, count):
    content, notes = geojson_content.read(zones=geojson_file(tmp_path, feature(CASE, closed=closed)))
    assert (len(content.zones), notes) == (count, ())


def test_a_rule_that_says_nothing_is_told_and_numbers_as_text_are_numbers(tmp_path):
    path = geojson_file(tmp_path, feature(CASE, closed="perhaps"), feature(CASE, limit="0.5", name="slow"))
    content, notes = geojson_content.read(zones=path)
    assert content.zones[0].limit == 0.5
    assert (
        "feature 0: no rule (kind speed or keep-out, limit, or closed); its closed is 'perhaps', left out" in notes[0]
    )
    flows = geojson_file(tmp_path, feature([0, 0], [9, 0], kind="LineString", width="200 cm"))
    assert geojson_content.read(flows=flows)[0].zones[0].area.bounds == (0, -1, 9, 1)
