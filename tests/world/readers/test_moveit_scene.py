"""Planning scenes of MoveIt: all primitives of the benchmark's, forms of messages, and all that is refused by name."""

import copy
import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

import hpop
from hpop.errors import MapError
from hpop.problems.problem import Problem
from hpop.scenario import load_scenario
from hpop.world import Box, Cylinder, Hull, Sphere, World
from hpop.world.bodies import LinkRules

CUBE = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]
FACES = [(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6), (0, 1, 4), (1, 5, 4), (2, 6, 3), (3, 6, 7), (0, 4, 2), (2, 4, 6)]
FACES += [(1, 3, 5), (3, 7, 5)]
SCENE = {
    "name": "kitchen",
    "robot_state": {"joint_state": {"name": ["a"], "position": [0]}, "attached_collision_objects": []},
    "world": {
        "octomap": {"header": {"frame_id": "world"}, "octomap": {"data": []}},
        "collision_objects": [
            {
                "id": "table",
                "header": {"frame_id": "world"},
                "primitives": [{"type": "box", "dimensions": [2, 1, 0.1]}, {"type": 3, "dimensions": [0.7, 0.05]}],
                "primitive_poses": [
                    {"position": [0, 0, 0.75], "orientation": [0, 0, 0, 1]},
                    {"position": {"x": 0, "y": 0, "z": 0.35}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 0}},
                ],
                "pose": {"position": [3, 2, 0], "orientation": [0, 0, math.sin(0.4), math.cos(0.4)]},
            },
            {
                "id": "ball",
                "header": {"frame_id": "world"},
                "primitives": [{"type": "sphere", "dimensions": [0.2]}],
                "pose": {"position": [1, 1, 1]},
                "operation": 0,
            },
            {
                "id": "block",
                "header": {"frame_id": "world"},
                "meshes": [{"vertices": CUBE, "triangles": [{"vertex_indices": list(face)} for face in FACES]}],
                "mesh_poses": [{"position": [-1, 0, 0]}],
            },
        ],
    },
}


def written(folder: Path, scene: object) -> Path:
    path = folder / "scene.yaml"
    path.write_text(scene if isinstance(scene, str) else yaml.safe_dump(scene))
    return path


def changed(*place, to):
    """Return the scene with one entry replaced."""
    scene = copy.deepcopy(SCENE)
    inside = scene
    for key in place[:-1]:
        inside = inside[key]
    if to is None:
        del inside[place[-1]]
    else:
        inside[place[-1]] = to
    return scene


CUP = {
    "id": "cup",
    "header": {"frame_id": "hand"},
    "primitives": [{"type": "cylinder", "dimensions": [0.12, 0.03]}, {"type": "box", "dimensions": [0.02, 0.04, 0.03]}],
    "primitive_poses": [{"position": [0, 0, 0.06]}, {"position": [0, 0.04, 0.05]}],
    "pose": {"position": [0.01, 0.02, 0.08], "orientation": [0.1, -0.2, 0.3, 0.9]},
}


def held(**attached):
    """Return the scene with an object attached to a hand."""
    given = {"link_name": "hand", "touch_links": ["finger"], **attached}
    return changed("robot_state", "attached_collision_objects", to=[given])


def test_objects_attached_to_a_link_are_rules_for_arms_with_this_link(tmp_path):
    """The poses are products of SciPy's rotations; MoveIt gives them in the frame of the link."""
    scene = held(object=CUP) | {
        "allowed_collision_matrix": {"entry_names": ["cup", "table"], "entry_values": [[False, True], [True, False]]}
    }
    world = World.from_moveit_scene(written(tmp_path, scene))
    first, second = world.link_rules.attached
    turned = Rotation.from_quat([0.1, -0.2, 0.3, 0.9])
    for each, within in ((first, [0, 0, 0.06]), (second, [0, 0.04, 0.05])):
        np.testing.assert_allclose(each["position"], np.add([0.01, 0.02, 0.08], turned.apply(within)), atol=1e-12)
        np.testing.assert_allclose(Rotation.from_euler("xyz", each["rpy"]).as_matrix(), turned.as_matrix(), atol=1e-12)
        assert (each["link"], each["touches"]) == ("hand", ["finger"])
    assert (first["name"], first["cylinder"]) == ("cup 1", {"radius": 0.03, "length": 0.12})
    assert (second["name"], second["box"]) == ("cup 2", [0.02, 0.04, 0.03])
    assert world.link_rules.may_touch("cup 2", "table")
    assert not world.link_rules.may_touch("cup 2", "ball")
    assert any("attaches objects to links" in note and "'cup 1' on 'hand'" in note for note in world.notes)
    assert World.from_description(world.describe()).link_rules == world.link_rules
    assert not [solid for solid in world.bodies if "cup" in solid.name]
    rules = world.link_rules.describe()
    for broken in ("cup", {"name": "cup"}, {"name": 3, "link": "hand"}):
        with pytest.raises(MapError, match="attached to a link must be a mapping with name and link"):
            LinkRules.build(rules | {"attached": [broken]})


def test_all_40_scenes_of_the_benchmark_are_read_as_an_independent_reading_has_them(shared_data):
    scenes = sorted(shared_data("mbm_panda").glob("problems/*/scene*.yaml"))
    assert len(scenes) == 40
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    for path in scenes:
        world = World.from_moveit_scene(path)
        expected = [
            (thing["id"], shape, pose)
            for thing in yaml.load(path.read_text(), Loader=loader)["world"]["collision_objects"]
            for shape, pose in zip(thing["primitives"], thing["primitive_poses"], strict=True)
        ]
        assert len(expected) == (7 if "bookshelf" in str(path) else 12)
        assert [solid.name for solid in world.bodies] == [name for name, _, _ in expected]
        for solid, (_, shape, pose) in zip(world.bodies, expected, strict=True):
            size = shape["dimensions"]
            assert solid.shape == (Box(tuple(size)) if shape["type"] == "box" else Cylinder(size[1], size[0]))
            np.testing.assert_array_equal(solid.pose[:3, 3], pose["position"])
            turned = Rotation.from_quat(pose["orientation"]).as_matrix()
            np.testing.assert_allclose(solid.pose[:3, :3], turned, atol=1e-12)
        unread = [note.split(".yaml': ")[1].partition(" is not read")[0] for note in world.notes]
        assert unread == ["robot_state"]
        matrix = yaml.load(path.read_text(), Loader=loader)["allowed_collision_matrix"]
        names = matrix["entry_names"]
        assert world.link_rules.pairs == {
            (min(a, b), max(a, b)): matrix["entry_values"][i][j]
            for i, a in enumerate(names)
            for j, b in enumerate(names)
            if i != j
        }
        x0, y0, x1, y1 = world.bounds
        assert x0 < 0 < x1
        assert y0 < 0 < y1


def test_shapes_are_placed_in_their_object_and_named_by_it(tmp_path):
    table, leg, ball, block = World.from_moveit_scene(written(tmp_path, SCENE)).bodies
    assert [solid.name for solid in (table, leg, ball, block)] == ["table", "table", "ball", "block"]
    assert (table.shape, leg.shape, ball.shape) == (Box((2.0, 1.0, 0.1)), Cylinder(0.05, 0.7), Sphere(0.2))
    np.testing.assert_allclose(table.pose[:3, 3], (3, 2, 0.75))
    np.testing.assert_allclose(leg.pose[:3, 3], (3, 2, 0.35))
    np.testing.assert_allclose(table.pose[:2, 0], (math.cos(0.8), math.sin(0.8)))
    np.testing.assert_allclose(ball.pose[:3, 3], (1, 1, 1))
    assert isinstance(block.shape, Hull)
    np.testing.assert_allclose(block.bounds, [(-1, 0, 0), (0, 1, 1)])


def test_a_scene_is_described_by_its_file_and_refused_when_that_has_changed(tmp_path):
    path = written(tmp_path, SCENE)
    world = World.from_moveit_scene(path)
    described = world.describe()
    assert described["kind"] == "moveit_scene"
    assert len(described["sha256"][0]) == 64
    assert [s.describe() for s in World.from_description(described).bodies] == [s.describe() for s in world.bodies]
    written(tmp_path, changed("name", to="bathroom"))
    with pytest.raises(MapError, match="has changed since the result that refers to it"):
        World.from_description(described)


def test_a_scenario_reads_a_scene_beside_it_and_plans_in_it(tmp_path):
    written(tmp_path, SCENE)
    (tmp_path / "plan.yaml").write_text(
        "world: {moveit_scene: {path: scene.yaml}}\nmodel: {differential_drive: {radius: 0.2}}\n"
        "start: [0.5, 2.5, 0]\ngoal: [4.5, 0.2, any]\ncriteria: [turns, length]\nplanner: {lattice: {step: 0.5}}\n"
    )
    problem = load_scenario(tmp_path / "plan.yaml").problem
    front = problem.solve("lattice", step=0.5)
    assert front.costs.size
    front.save(tmp_path / "front.json")
    again = Problem.from_description(hpop.Front.load(tmp_path / "front.json").problem)
    assert [solid.name for solid in again.world.bodies] == ["table", "table", "ball", "block"]
    assert again.world.notes == problem.world.notes != ()


OBJECTS = ("world", "collision_objects")
TABLE, BALL, BLOCK = ((*OBJECTS, i) for i in range(3))


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        ("", "is empty"),
        ("3", r"must be a yaml mapping; got 3"),
        ("world: {}", r"must be a planning scene, with world: \{collision_objects"),
        ("world: {collision_objects: []}", r"no collision object with a shape.*\{extent: "),
        ("world: &a {collision_objects: *a}", "aliases are not read"),
        ("a: " + "[" * 50, "more than 20 deep"),
        (changed(*OBJECTS, to=3), "collision_objects must be a list; got 3"),
        (changed(*OBJECTS, to=[3]), "collision_objects 0 must be a yaml mapping; got 3"),
        (changed(*BALL, "id", to=None), "collision_objects 1: id must be the name of an object; got None"),
        (changed(*BALL, "id", to="table"), "object 'table' is there twice, the second time as entry 1 .from 0."),
        (
            changed(*BALL, "primitives", 0, "type", to="cone"),
            "object 'ball': primitives 0: type .*one of box, .*'cone'",
        ),
        (changed(*BALL, "primitives", 0, "type", to=4), "object 'ball': primitives 0: type must be one of"),
        (changed(*BALL, "primitives", 0, "type", to=True), "object 'ball': primitives 0: type must be one of"),
        (
            changed(*BALL, "primitives", 0, "dimensions", to=[1, 2]),
            r"must be \[radius\] in m, of a sphere; got \[1, 2\]",
        ),
        (changed(*TABLE, "primitives", 1, "dimensions", to=[1]), r"must be \[height, radius\] in m, of a cylinder"),
        (changed(*BALL, "primitives", 0, "dimensions", to=[-1]), "dimensions: a sphere's radius must be a length"),
        (changed(*BALL, "primitives", 0, "dimensions", to=["1e-3"]), "YAML reads 1e-3 as text"),
        (changed(*TABLE, "primitive_poses", 1, to=None), "object 'table' has 2 primitive shapes and 1 primitive_poses"),
        (changed(*BALL, "pose", "position", to=[1, 2]), r"'ball': pose: position must be \[x, y, z\]; got \[1, 2\]"),
        (changed(*BALL, "pose", "position", to=[1, 2, math.nan]), "'ball': pose: position must be a number"),
        (
            changed(*BALL, "pose", "orientation", to=[0, 0, 0, 1e-9]),
            "'ball': pose: a quaternion .* a length from 1e-06",
        ),
        (changed(*BALL, "pose", to="here"), "'ball': pose must be a yaml mapping"),
        (changed(*BALL, "header", "frame_id", to=3), "frame_id must be the name of a frame; got 3"),
        (changed(*BALL, "operation", to=1), "'ball': operation must be 0 .add., unless"),
        (changed(*BALL, "planes", to=[{"coef": [0, 0, 1, 0]}]), "'ball': planes are infinite, and are not read"),
        (
            changed(*BLOCK, "meshes", 0, to={"resource": "package://a/b.dae"}),
            "'block': meshes 0: resource .* no mesh file is read",
        ),
        (changed(*BLOCK, "meshes", 0, "vertices", 7, to=[0.2, 0.2, 0.2]), "'block': meshes 0 is not convex"),
        (changed(*BLOCK, "meshes", 0, "triangles", to=[]), "'block': meshes 0: a hull needs 4 to 100,000 points"),
        (
            changed(*BLOCK, "meshes", 0, "triangles", 3, to=None),
            "'block': meshes 0 is not convex, or .* no closed and consistently oriented surface",
        ),
        (
            changed(*BLOCK, "meshes", 0, "triangles", 3, to=[1, 2, 8]),
            "must be the index of a vertex from 0 to 7, got 8",
        ),
        (changed(*BLOCK, "meshes", 0, "triangles", 3, to=[1, 2]), "triangles 3 must be the indices of three vertices"),
        (changed("world", "octomap", "octomap", "data", to=[1]), "octomap has cells, which are not read"),
        (
            changed("robot_state", "attached_collision_objects", to=[{"link_name": "hand"}]),
            "attached_collision_objects 0: object must be a yaml mapping",
        ),
        (held(object={"id": "cup"}), "object must be an attached object with its shapes"),
        (held(object=CUP | {"operation": 1}), "operation must be 0 .add.: to change what a robot holds"),
        (held(object=CUP | {"header": {"frame_id": "world"}}), "must be the frame of the link that carries .* 'hand'"),
        (
            held(object=CUP | {"id": "table"}),
            "'table' is attached to the link 'hand', and is a collision object",
        ),
        (held(object=CUP, link_name=""), "link_name must be the name of a link"),
        (held(object=CUP, touch_links=[3]), "touch_links 0 must be the name of a link"),
    ],
)
def test_what_is_not_read_is_refused_with_the_object_and_what_was_expected(tmp_path, scene, message):
    with pytest.raises(MapError, match=message):
        World.from_moveit_scene(written(tmp_path, scene))


def echoed(scene):
    """Return a message as ros2 topic echo prints it: a byte as a character, --- after it."""
    for thing in scene["world"]["collision_objects"]:
        if isinstance(thing.get("operation"), int):
            thing["operation"] = chr(thing["operation"])
    return yaml.safe_dump(json.loads(json.dumps(scene))) + "---\n"  # nothing twice, so that there are no aliases


def names_and_places(path):
    world = World.from_moveit_scene(path)
    return {solid.name: tuple(solid.pose[:3, 3].round(9).tolist()) for solid in world.bodies}, world.notes


def test_a_scene_is_read_as_ros_2_prints_it(tmp_path):
    text = echoed(copy.deepcopy(SCENE))
    assert 'operation: "\\0"' in text
    expected = World.from_moveit_scene(written(tmp_path, SCENE)).bodies
    found = World.from_moveit_scene(written(tmp_path, text)).bodies
    assert [solid.describe() for solid in found] == [solid.describe() for solid in expected]


def test_changes_after_a_scene_are_applied(tmp_path):
    at = {"position": [0, 0, 0]}
    box = {"primitives": [{"type": 1, "dimensions": [1, 1, 1]}], "pose": {"position": [5, 0, 0]}}
    changes = [
        {"id": "ball", "operation": 3, "pose": {"position": [2, 2, 2]}, "header": {"frame_id": "world"}},
        {"id": "block", "operation": 1},
        {"id": "box", "operation": 0, "header": {"frame_id": "world"}, **box},
        {"id": "box", "operation": 2, "header": {"frame_id": "world"}, **box | {"pose": at}},
    ]
    text = echoed(copy.deepcopy(SCENE)) + echoed({"is_diff": True, "world": {"collision_objects": changes}})
    world = World.from_moveit_scene(written(tmp_path, text))
    places = [(solid.name, tuple(solid.pose[:3, 3].round(9).tolist())) for solid in world.bodies]
    assert places[2:] == [("ball", (2, 2, 2)), ("box", (5, 0, 0)), ("box", (0, 0, 0))]
    assert "has 2 messages; the last whole scene and the changes after it are read" in " ".join(world.notes)
    again = echoed({"world": {"collision_objects": changes[2:3]}})
    assert list(names_and_places(written(tmp_path, text + again))[0]) == ["box"]
    lamp = echoed({"is_diff": True, "world": {"collision_objects": [{"id": "lamp", "operation": 1}]}})
    with pytest.raises(MapError, match="object 'lamp' is to be removed, moved or extended, but no such object exists"):
        World.from_moveit_scene(written(tmp_path, text + lamp))


def test_objects_in_a_frame_that_is_fixed_in_another_are_placed_there(tmp_path):
    turned = {
        "translation": {"x": 1, "y": 0, "z": 0},
        "rotation": {"x": 0, "y": 0, "z": math.sqrt(0.5), "w": math.sqrt(0.5)},
    }
    scene = changed(*BALL, "header", "frame_id", to="cell")
    scene["fixed_frame_transforms"] = [{"header": {"frame_id": "world"}, "child_frame_id": "cell", "transform": turned}]
    places, _ = names_and_places(written(tmp_path, scene))
    assert places["ball"] == (0, 1, 1)  # (1, 1, 1) turned a quarter to the left, then 1 m ahead
    assert places["block"] == (-1, 0, 0) or places["table"] == (3, 2, 0.35)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"link_padding": [{"link_name": "a", "padding": 0.02}, {"link_name": "b", "padding": 0.0}]},
         "pads 1 link by up to 0.02 m (link_padding): an arm with links of these names keeps this distance"),
        ({"link_scale": [{"link_name": "a", "scale": 1.1}]}, "scales 1 link by 1.1 to 1.1 (link_scale)"),
        ({"link_scale": [{"link_name": "a", "scale": 1.0}]}, ""),
        ({"allowed_collision_matrix": {"entry_names": ["a"], "entry_values": [[False]]}}, ""),
        ({"object_colors": [{"id": "ball"}]}, "has 1 colour of objects, which are not read"),
        ({"link_paddings": []}, "it has 'link_paddings', which is not read. Did you mean 'link_padding'?"),
    ],
)  # fmt: skip
def test_what_a_scene_says_beside_its_objects_is_noted(tmp_path, changes, said):
    before, after = (World.from_moveit_scene(written(tmp_path, SCENE | more)).notes for more in ({}, changes))
    assert len(after) == len(before) + bool(said)
    assert said in " ".join(after)


def test_a_misspelt_key_of_an_object_is_noted(tmp_path):
    scene = changed(*BALL, "poze", to={"position": [0, 0, 0]})
    assert "its objects have 'poze', which is not read. Did you mean 'pose'?" in " ".join(
        names_and_places(written(tmp_path, scene))[1]
    )


@pytest.mark.parametrize(
    ("place", "cut", "message"),
    [
        ((*BLOCK, "meshes", 0, "vertices"), [*CUBE, "..."], "vertices is cut short .* ros2 topic echo --full-length"),
        ((*BLOCK, "meshes", 0, "triangles"), "...", "triangles is cut short"),
        ((*BLOCK, "meshes"), "<sequence type: shape_msgs/msg/Mesh, length: 1>", "meshes is left out, .* --no-arr does"),
    ],
)
def test_a_message_that_was_not_printed_whole_is_refused(tmp_path, place, cut, message):
    with pytest.raises(MapError, match=message):
        World.from_moveit_scene(written(tmp_path, changed(*place, to=cut)))
