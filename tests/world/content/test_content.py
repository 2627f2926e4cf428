"""People, conversations, landmarks and zones: what is refused, what blocks the way, what survives saving."""

from __future__ import annotations

import json
import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import shapely

from hpop.errors import MapError
from hpop.world import World
from hpop.world.content.content import Content, Landmark, Person, Zone

HALL = shapely.box(0, 0, 10, 8)
SQUARE = shapely.box(6, 6, 7, 7)
PATH = shapely.LineString([(1, 7), (5, 7.1)])
NUMBERS = [math.nan, math.inf, "1", None, True, [1.0], 1j, 10**400]


def furnished(world: World) -> World:
    return world.with_content(
        people=[Person(2.0, 2.0, 0.1, name="Ada"), Person(3.0, 2.0, 3.0), Person(8.0, 1.0, velocity=(-0.3, 0.1 + 0.2))],
        groups=[(0, 1)],
        landmarks=[Landmark(5.0, 5.0, facing=-1.0, weight=2.0, name="Sue"), Landmark(1 / 3, 7.0)],
        zones=[
            Zone("speed", SQUARE, limit=0.4, name="school class"),
            Zone("keep-out", shapely.box(8, 6, 9, 7) | shapely.box(8, 4, 9, 5)),
            Zone("one-way", PATH.buffer(0.5), path=PATH),
        ],
    )


def plain(content: Content) -> dict:
    return json.loads(json.dumps(content.describe()))


@pytest.fixture
def hall() -> World:
    return furnished(World.from_polygons([], extent=HALL))


@pytest.mark.parametrize("field", ["x", "y", "yaw", "radius"])
@pytest.mark.parametrize("wrong", NUMBERS)
def test_a_person_is_given_by_finite_numbers(field, wrong):
    if field == "yaw" and wrong is None:
        return  # it is left out
    with pytest.raises(MapError, match=f"person 'Ada': {field} must be a"):
        Person(**{"x": 0.0, "y": 0.0, "name": "Ada", field: wrong})


@pytest.mark.parametrize("velocity", [3, (1,), (1, 2, 3), (1, math.nan), ("1", 2), None, "12", {"x": 1, "y": 2}])
def test_a_velocity_is_two_finite_numbers(velocity):
    with pytest.raises(MapError, match="velocity"):
        Person(0.0, 0.0, velocity=velocity)


@pytest.mark.parametrize("degrees", [90, -180.0, 12.6])
def test_a_direction_in_degrees_is_refused(degrees):
    for make in (lambda: Person(0, 0, yaw=degrees), lambda: Landmark(0, 0, facing=degrees)):
        with pytest.raises(MapError, match=r"in radians, within two turns of 0, got .* write math\.radians\("):
            make()


@pytest.mark.parametrize("radius", [0, -0.1])
def test_a_person_has_a_body(radius):
    with pytest.raises(MapError, match="radius above"):
        Person(0.0, 0.0, radius=radius)


@pytest.mark.parametrize("field", ["x", "y", "z", "weight"])
@pytest.mark.parametrize("wrong", NUMBERS)
def test_a_landmark_is_given_by_finite_numbers(field, wrong):
    with pytest.raises(MapError, match=f"landmark 'Sue': {field} must be a"):
        Landmark(**{"x": 0.0, "y": 0.0, "name": "Sue", field: wrong})


@pytest.mark.parametrize("facing", [value for value in NUMBERS if value is not None])
def test_a_facing_is_a_direction_or_none(facing):
    assert Landmark(0.0, 0.0).facing is None
    with pytest.raises(MapError, match="facing must be a"):
        Landmark(0.0, 0.0, facing=facing)


@pytest.mark.parametrize("weight", [0, -1.0])
def test_a_landmark_has_a_weight(weight):
    with pytest.raises(MapError, match="weight above"):
        Landmark(0.0, 0.0, weight=weight)


@pytest.mark.parametrize("thing", [Person, Landmark])
def test_a_name_is_text(thing):
    with pytest.raises(MapError, match="name must be text; got 3"):
        thing(0.0, 0.0, name=3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kind": "slow"}, "speed, keep-out, one-way; got 'slow'"),
        ({"kind": ["speed"]}, "speed, keep-out, one-way"),
        ({"area": [[0, 0], [1, 0], [1, 1]]}, "needs a polygon"),
        ({"area": shapely.Point(1, 1)}, "needs a polygon"),
        ({"area": shapely.Polygon()}, "needs a polygon"),
        ({"area": shapely.Polygon([(0, 0), (1, 0), (math.inf, 1)])}, "finite"),
        ({"area": shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])}, "no valid polygon .Self-intersection"),
        ({"limit": 0.0}, "limit above"),
        ({"limit": -1}, "limit above"),
        ({"limit": None}, "limit must be a number"),
        ({"limit": math.nan}, "limit must be a number"),
        ({"path": PATH}, "a path, which only a one-way zone has"),
        ({"kind": "keep-out"}, "a limit, 0.5, which only a speed zone has"),
        ({"kind": "one-way", "limit": None}, "needs a path"),
        ({"kind": "one-way", "limit": None, "path": shapely.LineString()}, "needs a path"),
        ({"kind": "one-way", "limit": None, "path": shapely.LineString([(1, 1), (1, 1)])}, "needs a path"),
        ({"kind": "one-way", "limit": None, "path": shapely.LineString([(1, 1), (1, math.inf)])}, "finite coordinates"),
        ({"kind": "one-way", "limit": None, "path": [(1, 1), (2, 2)]}, "needs a path"),
        ({"name": None}, "name must be text"),
    ],
)
def test_a_zone_has_an_area_and_what_its_kind_needs(given, message):
    with pytest.raises(MapError, match=message):
        Zone(**{"kind": "speed", "area": SQUARE, "limit": 0.5, **given})


@pytest.mark.parametrize("group", [(0,), (), (0, 0), (0, 2), (-1, 0), (0, "1"), (0, 1.0), (True, 0), (0, [1]), "01"])
def test_a_group_is_two_or_more_people_who_are_there(group):
    two = (Person(0.0, 0.0), Person(1.0, 0.0))
    with pytest.raises(MapError, match="a group must name two or more different people by indices 0 to 1"):
        Content(people=two, groups=(group,))


@pytest.mark.parametrize("name", ["people", "groups", "landmarks", "zones"])
@pytest.mark.parametrize("wrong", [3, None, [3]])
def test_content_is_made_of_what_it_says(name, wrong):
    with pytest.raises(MapError, match=f"{name} must be a list"):
        Content(**{name: wrong})
    with pytest.raises(MapError, match=f"{name} must be a list"):
        World.from_polygons([], extent=HALL).with_content(**{name: wrong})


def test_a_person_walks_on_in_a_straight_line():
    x, y = Person(1.0, 2.0, velocity=(0.5, -1.0)).at(np.array([0.0, 2.0, -1.0]))
    assert x.tolist() == [1.0, 2.0, 0.5]
    assert y.tolist() == [2.0, 0.0, 3.0]


def test_people_who_stand_block_the_robot_and_those_who_walk_do_not(hall):
    x, y = np.array([2.0, 2.0, 8.0]), np.array([2.0, 3.25, 1.0])
    # At Ada; 1.25 m off her centre, 1 m off her body; at the one who walks, where only the wall is near.
    assert hall.clearance(x, y) == pytest.approx([0.0, 1.0, 1.0], abs=2e-3)
    assert not hall.segments_free(1.0, 2.0, 4.0, 2.0, 0.0)
    assert hall.segments_free(7.0, 1.0, 9.0, 1.0, 0.5)


def test_keep_out_zones_close_an_area_and_the_other_zones_do_not(hall):
    in_keep_out, in_speed, in_one_way = hall.clearance(np.array([8.5, 6.5, 3.0]), np.array([4.5, 6.5, 7.05]))
    assert in_keep_out == 0.0
    assert min(in_speed, in_one_way) > 0.5


def test_nothing_in_the_content_hides_anything_from_the_camera(hall):
    field = hall.obstruction_field(1.0)
    assert np.all(field(np.array([2.0, 8.0, 8.5, 5.0]), np.array([2.0, 2.0, 4.5, 5.0])) == 0.0)


def test_contents_names_what_criteria_may_require(hall):
    assert hall.contents == {
        "keep_out",
        "people",
        "moving people",
        "groups",
        "landmarks",
        "speed zones",
        "one-way zones",
    }
    bare = World.from_polygons([], extent=HALL)
    assert bare.contents == frozenset()
    assert bare.with_content(people=[Person(1.0, 1.0)]).contents == {"people"}
    assert bare.with_content(zones=[Zone("keep-out", SQUARE)]).contents == {"keep_out"}


def test_a_world_keeps_its_content_through_its_description(hall):
    again = World.from_description(json.loads(json.dumps(hall.describe())))
    assert again.content.people == hall.content.people
    assert again.content.landmarks == hall.content.landmarks
    assert again.content.groups == ((0, 1),)
    for old, new in zip(hall.content.zones, again.content.zones, strict=True):
        assert (old.kind, old.limit, old.name) == (new.kind, new.limit, new.name)
        assert shapely.equals_identical(old.area, new.area)
        assert old.path == new.path
    assert again.describe() == hall.describe()


def test_keep_out_zones_alone_are_described_too():
    world = World.from_polygons([], extent=HALL).with_content(zones=[Zone("keep-out", SQUARE)])
    assert World.from_description(world.describe()).clearance(np.array([6.5]), np.array([6.5]))[0] == 0.0


def test_numbers_of_numpy_are_described_as_plain_ones():
    content = Content(
        people=(Person(np.int64(1), np.float32(0.5), velocity=np.array([1, 2])),),
        landmarks=(Landmark(np.float64(0.1), 2, facing=np.int32(1)),),
        zones=(Zone("speed", SQUARE, limit=np.float64(0.3)),),
    )
    again = Content.build(plain(content))
    assert again.people == content.people
    assert again.landmarks == content.landmarks
    assert again.zones[0].limit == 0.3


def test_a_world_read_from_a_file_keeps_its_file_and_its_content(tmp_path):
    path = tmp_path / "map.map"
    path.write_text("type octile\nheight 8\nwidth 10\nmap\n" + "..........\n" * 8)
    world = furnished(World.from_movingai(path))
    description = json.loads(json.dumps(world.describe()))
    assert description["kind"] == "movingai"
    again = World.from_description(description)
    assert again.content.people == world.content.people
    assert again.describe() == world.describe()


@pytest.mark.parametrize(
    "change",
    [
        {"people": 3},
        {"people": [{"x": 1}]},
        {"people": [{"x": 1, "y": "2"}]},
        {"people": [{"x": 1, "y": 2, "age": 3}]},
        {"groups": [[0, 7]]},
        {"groups": 3},
        {"landmarks": [[1, 2]]},
        {"zones": [{"kind": "keep-out"}]},
        {"zones": [{"kind": "keep-out", "area": {"type": "Polygon", "coordinates": [[[0, 0]]]}, "path": None}]},
        {"zones": [{"kind": "keep-out", "area": {"type": "Point", "coordinates": [0, 0]}, "path": None}]},
        {"zones": [{"kind": "keep-out", "area": 3, "path": None}]},
    ],
)
def test_malformed_descriptions_are_refused(hall, change):
    description = json.loads(json.dumps(hall.describe()))
    description["content"].update(change)
    with pytest.raises(MapError):
        World.from_description(description)


def test_a_world_is_pickled_with_its_content(hall):
    hall.clearance(np.array([1.0]), np.array([1.0]))
    again = pickle.loads(pickle.dumps(hall))
    assert plain(again.content) == plain(hall.content)
    points = np.linspace(0.5, 9.5, 19), np.full(19, 2.4)
    np.testing.assert_array_equal(again.clearance(*points), hall.clearance(*points))


def test_new_content_replaces_the_old_and_leaves_the_first_world_alone(hall):
    empty = hall.with_content()
    assert empty.contents == frozenset()
    assert empty.clearance(np.array([2.0]), np.array([2.0]))[0] == 2.0
    assert len(hall.content.people) == 3


def test_the_content_in_the_docs_is_what_it_says():
    text = (Path(__file__).parents[3] / "docs" / "content.md").read_text()
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "with_content" in block)
    names = {"world": World.from_polygons([], extent=HALL)}
    exec(compile(block, "docs/content.md", "exec"), names)
    assert names["world"].contents == {
        "people",
        "moving people",
        "groups",
        "landmarks",
        "speed zones",
        "one-way zones",
        "keep_out",
    }
