"""Names in an arm's files that match nothing are noted, or refused with the nearest name where they are used."""

from __future__ import annotations

import pytest

import hpop
from hpop.errors import HpopError, ModelError, QueryError
from hpop.goals import AnyOf, GoalSet, LookAt
from hpop.scenario import load_scenario
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import CRANE, HERE, arm6, crane

FAR = World.from_solids([Solid(Box((0.1, 0.1, 0.1)), pose_at((5.0, 0.0, 0.0)), "far")])
CAN = LookAt((0.7, 0.25, 0.43), (0.15, 0.3))


@pytest.fixture
def srdf(tmp_path):
    """Return the example's SRDF, with some text replaced, once."""

    def written(old="", new=""):
        text = (HERE / "arm6.srdf").read_text()
        assert old in text
        path = tmp_path / "arm.srdf"
        path.write_text(text.replace(old, new, 1))
        return path

    return written


def test_a_state_with_a_misspelt_joint_is_noted_and_refused_by_what_it_lacks(srdf):
    arm = arm6(srdf=srdf("wrist_to_hand", "wrist_to_hend"))
    (note,) = arm.notes
    assert "values for the joints 'wrist_to_hend', which the URDF does not have" in note
    assert "Did you mean 'wrist_to_hand'?" in note
    with pytest.raises(
        QueryError, match=r"'home', but no state has this name: this state of the SRDF has no value for wrist_to_hand\."
    ):
        arm.space.state("home", what="start")


def test_a_state_of_an_unknown_group_is_noted(srdf):
    (note,) = arm6(srdf=srdf('name="home" group="arm"', 'name="home" group="amr"')).notes
    assert "'home' of the SRDF belongs to the group 'amr'" in note
    assert "Did you mean 'arm'?" in note


def test_pairs_of_links_that_are_not_there_are_noted_with_what_was_meant(srdf):
    (note,) = arm6(srdf=srdf('link2="wrist"', 'link2="wirst"')).notes
    assert "'wirst', which the URDF does not have: is it the SRDF of another robot? Did you mean 'wrist'?" in note


def test_joints_by_which_a_robot_stands_in_the_world_are_no_strangers(srdf):
    virtual = '<virtual_joint name="floor" type="planar" parent_frame="world" child_link="base"/>'
    state = '<group_state name="there" group="arm"><joint name="floor" value="1"/></group_state>'
    assert arm6(srdf=srdf("</robot>", f"{virtual}{state}</robot>")).notes == ()


def test_urdf_and_srdf_are_not_taken_for_each_other():
    with pytest.raises(ModelError, match=r"SRDF '.*arm6.urdf': it must be an SRDF .* it is a URDF"):
        arm6(srdf=HERE / "arm6.urdf")
    with pytest.raises(ModelError, match=r"URDF '.*arm6.srdf': .* it is an SRDF; give the URDF"):
        hpop.SerialArm.from_urdf(HERE / "arm6.srdf", tip="tool", acceleration=1.0)


def test_a_robot_without_links_is_called_so(tmp_path):
    (tmp_path / "arm.urdf").write_text("<robot name='a'/>")
    with pytest.raises(ModelError, match="it has no <link>; give the URDF"):
        hpop.SerialArm.from_urdf(tmp_path / "arm.urdf", tip="tool", acceleration=1.0)


@pytest.mark.parametrize("goal", ["home", ["home", "ready"], ["home", CAN]], ids=str)
def test_a_name_without_an_srdf_says_where_names_come_from(goal):
    arm = arm6(srdf=None)
    zeros = [0.0] * len(arm.joints)
    with pytest.raises(
        QueryError, match=r"'home', but no state has this name: states get their names from an SRDF.*as srdf"
    ):
        hpop.Problem(FAR, arm, "home", zeros, ["duration"])
    with pytest.raises(QueryError, match="as srdf"):
        hpop.Problem(FAR, arm, zeros, goal, ["duration"])


@pytest.mark.parametrize(
    ("start", "goal", "place"),
    [("home", "[0, 0, 0, 0, 0, 0]", "start"), ("[0, 0, 0, 0, 0, 0]", "[home, ready]", "goal.0")],
)
def test_a_scenario_says_it_where_the_name_stands(tmp_path, start, goal, place):
    (tmp_path / "arm.yaml").write_text(
        f"world: {{solids: {{obstacles: [{{sphere: 0.1, position: [5, 0, 0]}}]}}}}\n"
        f"model: {{serial_arm: {{urdf: {HERE / 'arm6.urdf'}, tip: tool, acceleration: 6.0}}}}\n"
        f"start: {start}\ngoal: {goal}\ncriteria: [duration]\nplanner: roadmap\n"
    )
    with pytest.raises(
        QueryError, match=rf"arm.yaml, line \d, {place}: .*'home', but no state has this name: .*as srdf"
    ):
        load_scenario(tmp_path / "arm.yaml")


FORM = r"numbers in rad \(or .*\), or the name of one \(home, ready, upright\)"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("start: home", "start: [0, 0, 0]", rf"line 3, start: expected \[.*\], {FORM}, got .*; 3 values for 6 states"),
        (
            "tip: tool",
            "tip: tool, camera: [0, 0, 0.1]",
            r"line 2, .*arm.camera: expected 6 entries, got \[0, 0, 0.1\]$",
        ),
        (
            "tip: tool",
            "tip: tool, field_of_view: [60, 45]",
            r"field_of_view .* in rad, .* got 60.0; degrees are written as '60 deg'",
        ),
        ("planner: roadmap", "quanta: {}", "planner.*: no planner is given, and the default is lattice: lattice needs"),
    ],
    ids=["values that lack", "a pose without angles", "degrees without their name", "no planner"],
)
def test_what_is_wrong_with_an_arm_in_a_scenario_is_said_in_its_words(tmp_path, old, new, said):
    text = (
        "world: {solids: {obstacles: [{sphere: 0.1, position: [5, 0, 0]}]}}\n"
        f"model: {{serial_arm: {{urdf: {HERE}/arm6.urdf, srdf: {HERE}/arm6.srdf, tip: tool, acceleration: 6.0}}}}\n"
        "start: home\ngoal: ready\ncriteria: [duration]\nplanner: roadmap\n"
    )
    assert old in text
    (tmp_path / "arm.yaml").write_text(text.replace(old, new))
    with pytest.raises(HpopError, match=said):
        load_scenario(tmp_path / "arm.yaml")


def test_a_goal_in_space_none_of_whose_states_is_free_says_what_to_do():
    wall = World.from_solids([Solid(Box((0.5, 0.5, 0.5)), pose_at(CAN.target), "block")])
    problem = hpop.Problem(wall, arm6(), "home", LookAt(CAN.target, (0.05, 0.1)), ["duration"])
    with pytest.raises(
        QueryError, match=r"Move the goal, or make it larger\. .*'block', .*\. Choose other joint values\.$"
    ):
        problem.solve("roadmap", samples=10)


@pytest.mark.parametrize(
    "goal",
    [
        AnyOf("ready", CAN),
        AnyOf(["ready", CAN]),
        ["ready", CAN],
        ["ready", {"look_at": {"target": CAN.target, "distance": CAN.distance}}],
    ],
    ids=["any of", "any of a list", "list", "list with a name"],
)
def test_named_states_and_goals_of_other_kinds_are_listed_together(goal):
    arm = arm6()
    problem = hpop.Problem(FAR, arm, "home", goal, ["duration"])
    assert problem.goal == AnyOf(GoalSet((arm.space.named["ready"],)), CAN)


def test_a_goal_of_several_that_is_no_state_is_refused_by_its_place():
    with pytest.raises(QueryError, match=r"the goal 0 is 'read', but no state has this name. Did you mean 'ready'\?"):
        hpop.Problem(FAR, arm6(), "home", AnyOf("read", CAN), ["duration"])


# Links that nothing is known to touch


def seen(name: str) -> str:
    return f'<link name="{name}"><visual><geometry><sphere radius="0.1"/></geometry></visual></link>'


def test_links_that_are_seen_but_have_nothing_that_collides_are_noted(tmp_path):
    assert crane(tmp_path).notes == ()  # its rail and eye are frames: nothing is drawn there
    path = tmp_path / "seen.urdf"
    path.write_text(CRANE.replace('<link name="eye"/>', seen("eye")).replace('<link name="lamp"/>', seen("lamp")))
    (note,) = hpop.SerialArm.from_urdf(path, tip="eye", acceleration=2.0).notes
    assert note.startswith("the links 'eye', 'lamp' have <visual> but no <collision> geometry")


def test_an_arm_without_anything_that_collides_is_noted(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text(CRANE.replace("<collision>", "<visual>").replace("</collision>", "</visual>"))
    (note,) = hpop.SerialArm.from_urdf(path, tip="eye", acceleration=2.0).notes
    assert "no link of the URDF has <collision> geometry" in note
