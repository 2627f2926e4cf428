"""Objects in the hand are parts of the arm: they collide as a link of the URDF does that has their shape."""

import json
from dataclasses import replace

import numpy as np
import pytest

from hpop.errors import ModelError
from hpop.models import MobileArm, SerialArm
from hpop.problems.problem import Problem
from hpop.scenario import load_scenario
from hpop.world import Box, Solid, World, pose_at
from hpop.world.bodies import LinkRules
from tests.models.serial_arm.arms import CRANE, HERE, arm6, crane

BAR = {"name": "bar", "link": "jib", "box": (0.02, 0.02, 0.5), "position": (0.1, 0.0, -0.3), "rpy": (0.1, 0.0, 0.0)}
LINK = (
    '<link name="bar"><collision><geometry><box size="0.02 0.02 0.5"/></geometry></collision></link><joint name="held" '
    'type="fixed"><parent link="jib"/><child link="bar"/><origin xyz="0.1 0 -0.3" rpy="0.1 0 0"/></joint></robot>'
)
BLOCKS = [
    Solid(Box((0.3, 0.3, 0.3)), pose_at((0.7 * np.cos(a), 0.7 * np.sin(a) - 0.2, 0.7)), f"block{a}") for a in range(5)
]


def rows_of(arm, count=400, seed=1):
    rows = np.random.default_rng(seed).uniform(arm.chain.low, arm.chain.high, (count, len(arm.chain)))
    return arm.space.state(tuple(rows[0])).__class__(**dict(zip(arm.joints, rows.T, strict=True)))


def test_a_held_object_collides_as_a_link_of_the_urdf_does(tmp_path):
    (tmp_path / "link.urdf").write_text(CRANE.replace("</robot>", LINK))
    as_link = SerialArm.from_urdf(tmp_path / "link.urdf", tip="eye", acceleration=2.0)
    held, world = crane(tmp_path, attached=[BAR]), World.from_solids(BLOCKS)
    states = rows_of(held)
    free = held.collision(world).states_free(states)
    assert free.tolist() == as_link.collision(world).states_free(states).tolist()
    assert free.tolist() != crane(tmp_path).collision(world).states_free(states).tolist()
    assert held.judge(world).states_free(states.take(np.arange(40))).tolist() == free[:40].tolist()
    blocked = states.take(np.flatnonzero(~free & crane(tmp_path).collision(world).states_free(states))[:1])
    assert "'bar'" in held.collision(world).why_blocked(blocked)


def test_what_an_object_may_touch_is_not_tested(tmp_path):
    world = World.from_solids(BLOCKS)
    names = [solid.name for solid in BLOCKS]
    free = crane(tmp_path)
    touching = crane(tmp_path, attached=[BAR | {"touches": [*names, "mast", "boom"]}])
    states = rows_of(free)
    for judged in ("collision", "judge"):
        some = states.take(np.arange(400 if judged == "collision" else 30))
        expected = getattr(free, judged)(world).states_free(some)
        assert getattr(touching, judged)(world).states_free(some).tolist() == expected.tolist()


def test_an_arm_is_described_with_what_it_holds_and_lets_go(tmp_path):
    empty = crane(tmp_path)
    held = empty.holding(BAR, {"name": "ball", "link": "eye", "sphere": 0.1})
    assert [part.link for part in held.parts[len(empty.parts) :]] == ["bar", "ball"]
    again = SerialArm(**json.loads(json.dumps(held.describe()["serial_arm"])))
    assert again == held != empty
    assert json.dumps(again.describe()) == json.dumps(held.describe())
    assert held.holding() == empty
    assert "attached" not in empty.describe()["serial_arm"]


def test_what_is_held_hides_the_view(tmp_path):
    arm = arm6().holding({"name": "board", "link": "tool", "box": (0.5, 0.5, 0.01)})
    assert len(arm.bodies(arm.space.state("home"))) == len(arm6().bodies(arm6().space.state("home"))) + 1


def test_a_scenario_names_what_is_held(tmp_path):
    (tmp_path / "plan.yaml").write_text(
        "world: {solids: {obstacles: [{box: [0.1, 0.1, 0.1], position: [3, 0, 0]}]}}\nmodel:\n  serial_arm:\n"
        f"    urdf: {HERE / 'arm6.urdf'}\n    srdf: {HERE / 'arm6.srdf'}\n    tip: tool\n    acceleration: 6.0\n"
        "    attached: [{name: can, link: tool, cylinder: {radius: 0.03, length: 0.1}, rpy: [90 deg, 0, 0]}]\n"
        "start: home\ngoal: ready\ncriteria: [duration]\nplanner: roadmap\n"
    )
    arm = load_scenario(tmp_path / "plan.yaml").problem.model
    assert arm.parts[-1].link == "can"
    assert arm.attached[0]["rpy"][0] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("attached", "said"),
    [
        (3, "attached must be a list of objects such as"),
        ([3], "attached must be a list .*; got 3"),
        ([BAR | {"sphere": 1}], "with one of box, cylinder, sphere and hull"),
        ([BAR | {"box": None}], "with one of box, cylinder, sphere and hull"),
        ([BAR | {"link": ""}], "attached must be a list"),
        ([BAR | {"touch": []}], "got the key 'touch'. Did you mean 'touches'"),
        ([BAR | {"touches": "mast"}], "attached must be a list"),
        ([BAR | {"touches": [3]}], "touches must be a list of names"),
        ([BAR, BAR], "different names, but two are called 'bar'"),
        ([BAR | {"box": (1, 2)}], "the attached object 'bar': a box's size must be 3 numbers"),
        ([BAR | {"rpy": (90, 0, 0)}], "the attached object 'bar': each of roll, pitch and yaw"),
        ([BAR | {"box": None, "cylinder": {"radius": 1}}], "the attached object 'bar': .*length"),
        ([BAR | {"link": "jip"}], "must be on a link of this file, got 'jip'; .* mean 'jib'"),
        ([BAR | {"name": "mast"}], "a link of this file has the name .mast.*rename the object where it is attached"),
    ],
)
def test_an_object_that_cannot_be_held_is_refused(tmp_path, attached, said):
    with pytest.raises(ModelError, match=said):
        crane(tmp_path, attached=attached)


@pytest.mark.parametrize(("value", "is_within"), [(0.2, True), (1.0004, True), (0.1, False), (5.0, False)])
def test_a_joint_is_fixed_within_its_limits_only(tmp_path, value, is_within):
    if is_within:
        crane(tmp_path, fixed={"wick": value})
        return
    with pytest.raises(ModelError, match=r"joint 'wick' a value within its limits, 0.2 to 1 rad, got \d"):
        crane(tmp_path, fixed={"wick": value})


def test_what_a_scene_attaches_is_a_part_of_the_arm(tmp_path):
    """Planning, verification, bodies and saved problems treat it as an object of the arm's option ``attached``."""
    thing = {
        "id": "cup",
        "header": {"frame_id": "tool"},
        "primitives": [{"type": "box", "dimensions": [0.05, 0.3, 0.05]}],
        "pose": {"position": [0, 0, 0.05]},
    }
    places = [[0.5 * np.cos(i), 0.5 * np.sin(i), 0.5] for i in range(6)]
    blocks = [
        {"id": f"b{i}", "primitives": [{"type": "box", "dimensions": [0.2] * 3}], "pose": {"position": place}}
        for i, place in enumerate(places)
    ]
    attached = [{"link_name": "tool", "object": thing, "touch_links": ["hand"]}]
    scene = {"robot_state": {"attached_collision_objects": attached}, "world": {"collision_objects": blocks}}
    (tmp_path / "scene.yaml").write_text(json.dumps(scene))
    world, arm = World.from_moveit_scene(tmp_path / "scene.yaml"), arm6()
    spec = {"name": "cup", "link": "tool", "box": (0.05, 0.3, 0.05), "position": (0, 0, 0.05), "touches": ["hand"]}
    holding, empty = arm6(attached=[spec]), World.from_solids(world.bodies)
    states = rows_of(arm)
    expected = holding.collision(empty).states_free(states)
    assert arm.collision(world).states_free(states).tolist() == expected.tolist()
    assert arm.collision(empty).states_free(states).tolist() != expected.tolist()
    some = states.take(np.arange(40))
    assert arm.judge(world).states_free(some).tolist() == holding.judge(empty).states_free(some).tolist()
    problem = Problem(world, arm, "home", "ready", ["duration"])
    assert problem.model == holding
    assert len(problem.model.bodies(states)) == len(arm.bodies(states)) + 1
    again = Problem.from_description(json.loads(json.dumps(problem.describe())))
    assert again.model == holding
    robot = MobileArm(arm).with_scene(world)
    assert robot.arm == holding
    with pytest.raises(ModelError, match="the attached object 'cup' must be on a link of this file"):
        Problem(world, crane(tmp_path), (0, 0, 0, 0), (0.1, 0, 0, 0), ["duration"])


@pytest.mark.parametrize("based", [False, True])
def test_what_an_object_may_touch_must_exist(tmp_path, based):
    def problem(*touches, solids=BLOCKS):
        arm = crane(tmp_path, attached=[BAR | {"touches": touches}])
        model = MobileArm(arm, folded=(0.0, 0.0, 0.0, 0.0)) if based else arm
        return Problem(
            World.from_solids(solids),
            model,
            (0,) * len(model.space.names),
            (0.1,) * len(model.space.names),
            ["duration"],
        )

    problem("mast", "block0", "bar", *(["mobile base"] if based else []))
    with pytest.raises(ModelError, match=r"'bar' must be names of links, .* got 'blokc0'; .*'block0', .*'boom'.*Did"):
        problem("mast", "blokc0")
    with pytest.raises(ModelError, match="got 'block0'; there are 'bar', 'block1'"):
        problem("block0", solids=BLOCKS[1:])


def test_an_object_of_a_scene_may_touch_nothing_that_does_not_exist(tmp_path):
    arm = crane(tmp_path)
    rules = LinkRules(attached=({**BAR, "touches": ["boomm"]},))
    with pytest.raises(ModelError, match=r"got 'boomm'; .* Did you mean 'boom'"):
        Problem(replace(World.from_solids(BLOCKS), link_rules=rules), arm, (0,) * 4, (0.1,) * 4, ["duration"])
