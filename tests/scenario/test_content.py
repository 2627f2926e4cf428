"""People, groups, landmarks and zones of scenario files: what they build, and how their faults are said."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from hpop.errors import HpopError, MapError, ScenarioError
from hpop.scenario import load_scenario
from hpop.world import World

HALL = """\
world:
  polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}
start: [1.0, 1.0, 0]
goal: [8.0, 1.0, any]
criteria: [turns, length]
people:
  - {x: 4.0, y: 5.0, yaw: 90 deg, name: Ada}
  - {x: 5.0, y: 5.0, yaw: -1.5, radius: 0.3}
  - {x: 2.0, y: 4.0, velocity: [-0.8, 0], name: Bo}
groups: [[Ada, 1]]
landmarks:
  - {x: 8.5, y: 3.0, z: 1.6, facing: -90 deg, weight: 2, name: door}
  - {x: 1.0, y: 5.0}
zones:
  - {kind: speed, area: [[3, 3], [6, 3], [6, 6]], limit: 0.5, name: class}
  - {kind: keep-out, area: [[6, 4], [7, 4], [7, 5]]}
  - {kind: one-way, area: [[3, 1], [6, 1], [6, 2], [3, 2]], path: [[3, 1.5], [6, 1.5]]}
"""


def hall(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the hall with some of its text replaced."""
    text = HALL
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "hall.yaml"
    path.write_text(text)
    return path


def fault(path: Path, kind: type[HpopError] = ScenarioError) -> str:
    with pytest.raises(HpopError) as error:
        load_scenario(path)
    assert type(error.value) is kind
    return str(error.value).removeprefix(f"{path}, ")


def geojson(folder: Path, file: str, kind: str, *coordinates: list, **properties: object) -> None:
    features = [
        {"type": "Feature", "properties": properties, "geometry": {"type": kind, "coordinates": given}}
        for given in coordinates
    ]
    (folder / file).write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def test_a_scenario_furnishes_its_world_as_it_says(tmp_path):
    content = load_scenario(hall(tmp_path)).problem.world.content
    ada, friend, walker = content.people
    assert (ada.x, ada.y, ada.yaw, ada.name, ada.radius, ada.velocity) == (4.0, 5.0, math.pi / 2, "Ada", 0.25, (0, 0))
    assert (friend.yaw, friend.radius, friend.name) == (-1.5, 0.3, "")
    assert (walker.velocity, walker.yaw) == ((-0.8, 0.0), math.pi)  # looks where he goes
    assert content.groups == ((0, 1),)
    door, other = content.landmarks
    assert (door.x, door.y, door.z, door.facing, door.weight, door.name) == (8.5, 3.0, 1.6, -math.pi / 2, 2.0, "door")
    assert (other.z, other.facing, other.weight) == (1.5, None, 1.0)
    speed, closed, way = content.zones
    assert (speed.kind, speed.limit, speed.name) == ("speed", 0.5, "class")
    assert closed.area.equals(shapely.Polygon([(6, 4), (7, 4), (7, 5)]))
    assert list(way.path.coords) == [(3, 1.5), (6, 1.5)]


def test_what_the_world_of_a_scenario_has_criteria_may_require(tmp_path):
    world = load_scenario(hall(tmp_path)).problem.world
    assert world.contents == {
        "keep_out",
        "people",
        "moving people",
        "groups",
        "landmarks",
        "speed zones",
        "one-way zones",
    }


def test_a_scenario_without_content_has_none(tmp_path):
    path = tmp_path / "bare.yaml"
    path.write_text(HALL[: HALL.index("people:")])
    assert load_scenario(path).problem.world.contents == frozenset()


def test_the_world_of_a_scenario_survives_its_description(tmp_path):
    world = load_scenario(hall(tmp_path)).problem.world
    again = World.from_description(json.loads(json.dumps(world.describe())))
    assert again.describe() == world.describe()
    assert again.content.people == world.content.people


@pytest.mark.parametrize(
    ("change", "line", "place", "says"),
    [
        (("yaw: 90 deg", "yaw: north"), 7, "people.0.yaw", "a yaw is a number in rad, or text such as '90 deg'; got"),
        (("radius: 0.3", "radius: 0"), 8, "people.1.radius", "greater than 0, got 0"),
        (("x: 2.0,", "x: two,"), 9, "people.2.x", "expected a number, got 'two'"),
        (("x: 2.0, ", ""), 9, "people.2.x", "this key is missing"),
        (("velocity:", "velocty:"), 9, "people.2.velocty", "did you mean 'velocity'?"),
        (
            ("velocity: [-0.8, 0]", "velocity: [1]"),
            9,
            "people.2.velocity",
            "expected a velocity [x, y] in m/s, got [1]",
        ),
        (("velocity: [-0.8, 0]", "velocity: [.inf, 0]"), 9, "people.2.velocity", "got [inf, 0]"),
        (("name: Bo", "name: 3"), 9, "people.2.name", "expected text, got 3"),
        (("[[Ada, 1]]", "[[Ada, 7]]"), 10, "groups.0.1", "a person's index or name, got 7; indices are 0 to 2"),
        (("[[Ada, 1]]", "[[Adda, 1]]"), 10, "groups.0.0", "got 'Adda'; indices are 0 to 2, names are Ada, Bo"),
        (("[[Ada, 1]]", "[[Ada]]"), 10, "groups.0", "expected at least 2 entries, got 1"),
        (("[[Ada, 1]]", "[[Ada, 1.5]]"), 10, "groups.0.1", "expected a whole number or text, got 1.5"),
        (("[[Ada, 1]]", "Ada"), 10, "groups", "expected a list, got 'Ada'"),
        (("name: Bo", "name: Ada"), 10, "groups.0.0", "2 people are called 'Ada'"),
        (("facing: -90 deg", "facing: west"), 12, "landmarks.0.facing", "a direction is a number in rad"),
        (("weight: 2", "weight: -2"), 12, "landmarks.0.weight", "greater than 0, got -2"),
        (("{x: 1.0, y: 5.0}", "[1.0, 5.0]"), 13, "landmarks.1", "expected keys with values"),
        (("kind: speed", "kind: slow"), 15, "zones.0.kind", "'speed', 'keep-out' or 'one-way', got 'slow'"),
        (("[[3, 3], [6, 3], [6, 6]]", "[[3, 3], [6, 3]]"), 15, "zones.0.area", "at least 3 entries, got 2"),
        (("limit: 0.5", "limit: fast"), 15, "zones.0.limit", "expected a number, got 'fast'"),
        (("[3, 1.5], [6, 1.5]", "[3, 1.5]"), 17, "zones.2.path", "at least 2 entries, got 1"),
    ],
)
def test_a_fault_is_said_with_line_key_and_what_was_expected(tmp_path, change, line, place, says):
    text = fault(hall(tmp_path, change))
    assert text.startswith(f"line {line}, {place}: ")
    assert says in text


@pytest.mark.parametrize(
    ("change", "line", "place", "says"),
    [
        (("[[Ada, 1]]", "[[Ada, 0]]"), 10, "groups", "two or more different people"),
        (
            (", limit: 0.5", ""),
            15,
            "zones.0",
            "speed zone 'class': limit must be a number",
        ),
        (("kind: keep-out", "kind: one-way"), 16, "zones.1", "a one-way zone needs a path"),
        (("[6, 4], [7, 4], [7, 5]", "[6, 4], [7, 5], [7, 4], [6, 5]"), 16, "zones.1", "no valid polygon"),
        (("[3, 1.5], [6, 1.5]", "[3, 1.5], [3, 1.5]"), 17, "zones.2", "needs a path, a line with a length"),
        (("kind: one-way", "kind: keep-out"), 17, "zones.2", "a path, which only a one-way zone has"),
    ],
)
def test_what_the_world_refuses_is_said_at_its_place(tmp_path, change, line, place, says):
    text = fault(hall(tmp_path, change), MapError)
    assert text.startswith(f"line {line}, {place}: ")
    assert says in text


def test_all_faults_are_said_at_once_in_the_order_of_the_file(tmp_path):
    path = hall(tmp_path, ("radius: 0.3", "radius: 0"), ("[[Ada, 1]]", "[[Ada, 7]]"), ("kind: speed", "kind: slow"))
    lines = fault(path).split("\n")
    assert [line.rsplit("line ", 1)[1].split(",")[0] for line in lines] == ["8", "10", "15"]


def test_a_criterion_that_requires_people_is_refused_where_there_are_none(tmp_path):
    path = tmp_path / "bare.yaml"
    path.write_text(HALL[: HALL.index("people:")].replace("[turns, length]", "[turns, length, personal_space]"))
    with pytest.raises(HpopError, match="requires people"):
        load_scenario(path)


def test_a_geojson_world_takes_landmarks_flows_and_zones_from_its_files(tmp_path):
    ring = [[0, 0], [20, 0], [20, 20], [0, 20], [0, 0]]
    geojson(tmp_path, "plan.geojson", "Polygon", [ring])
    geojson(tmp_path, "labels.geojson", "Point", [2, 4], name="bird")
    geojson(tmp_path, "more.geojson", "Point", [6, 8])
    geojson(tmp_path, "flows.geojson", "LineString", [[0, 16], [20, 16]], [[0, 18], [0, 18]])
    geojson(tmp_path, "zones.geojson", "Polygon", [[[14, 2], [16, 2], [16, 4], [14, 2]]], closed=1)
    section = (
        "{path: plan.geojson, polygons: free, scale: 0.5, landmarks: [labels.geojson, more.geojson], "
        "flows: flows.geojson, flow_width: 2, zones: zones.geojson}"
    )
    plan = ("polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}", f"geojson: {section}")
    world = load_scenario(hall(tmp_path, plan)).problem.world
    assert [(mark.name, mark.x, mark.y) for mark in world.content.landmarks] == [
        ("bird", 1.0, 2.0),
        ("", 3.0, 4.0),
        ("door", 8.5, 3.0),
        ("", 1.0, 5.0),
    ]
    way, closed, *own = world.content.zones
    assert way.area.equals(shapely.box(0, 7, 10, 9))
    assert closed.area.area == pytest.approx(0.5)
    assert len(own) == 3
    assert world.clearance(np.array([7.9]), np.array([1.1]))[0] == 0.0
    assert [note.split(": ", 1)[1] for note in world.notes] == ["feature 1: a line without length, left out."]
    again = World.from_description(json.loads(json.dumps(world.describe())))
    assert again.describe() == world.describe()


def test_a_missing_content_file_is_said_at_its_world(tmp_path):
    geojson(tmp_path, "plan.geojson", "Polygon", [[[0, 0], [20, 0], [20, 20], [0, 0]]])
    plan = (
        "polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}",
        "geojson: {path: plan.geojson, landmarks: no.geojson}",
    )
    text = fault(hall(tmp_path, plan), MapError)
    assert text.startswith("line 2, world.geojson: ")
    assert "no.geojson' cannot be opened" in text


def test_files_of_content_are_paths(tmp_path):
    plan = ("polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}", "geojson: {path: plan.geojson, flows: [3]}")
    assert fault(hall(tmp_path, plan)).startswith(
        "line 2, world.geojson.flows.0: expected text or keys with values, got 3"
    )


PLAN = "polygons: {extent: [[0, 0], [9, 0], [9, 6], [0, 6]]}"


def test_a_scenario_chooses_zones_of_a_file_by_their_properties(tmp_path):
    geojson(tmp_path, "plan.geojson", "Polygon", [[[0, 0], [20, 0], [20, 20], [0, 20], [0, 0]]])
    square = [[[14, 2], [16, 2], [16, 4], [14, 2]]]
    geojson(tmp_path, "zones.geojson", "Polygon", square, square, closed=1, level=2)
    zones = "{path: zones.geojson, where: {level: [1, 2]}}"
    section = f"{{path: plan.geojson, polygons: free, scale: 0.5, zones: {zones}}}"
    world = load_scenario(hall(tmp_path, (PLAN, f"geojson: {section}"))).problem.world
    assert len(world.content.zones) == 2 + 3
    (note,) = world.notes
    assert note.endswith("zones.geojson: 2 of 2 features are read, those with level: [1, 2].")
    text = fault(hall(tmp_path, (PLAN, f"geojson: {section.replace('[1, 2]', '7')}")), MapError)
    assert text.startswith("line 2, world.geojson: ")
    assert "no feature has level: 7. Values in the file: '2'" in text


@pytest.mark.parametrize(
    ("zones", "place", "says"),
    [
        ("{path: z.geojson, were: {level: 1}}", "world.geojson.zones.were", "did you mean 'where'"),
        ("[{where: {level: 1}}]", "world.geojson.zones.0.path", "this key is missing"),
        ("{path: 3}", "world.geojson.zones.path", "expected text, got 3"),
    ],
)
def test_a_file_of_content_that_is_no_path_and_has_none_is_told_at_its_key(tmp_path, zones, place, says):
    text = fault(hall(tmp_path, (PLAN, f"geojson: {{path: plan.geojson, zones: {zones}}}")))
    assert text.startswith(f"line 2, {place}: ")
    assert says in text


def test_a_name_cannot_begin_a_line_of_the_message(tmp_path):
    text = fault(hall(tmp_path, ("name: Bo", 'name: "Bo\\nline 1: forged"'), ("[[Ada, 1]]", "[[Adda, 1]]")))
    assert r"names are Ada, Bo\nline 1: forged" in text
    assert "\n" not in text
