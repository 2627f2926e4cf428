"""Files of arms as they may come from anybody: what is wrong with them is refused by name, with the way out."""

from __future__ import annotations

import os

import numpy as np
import pytest

from hpop.errors import ModelError, QueryError
from hpop.models import SerialArm
from tests.models.serial_arm.arms import CRANE, HERE, arm6, crane


def made(folder, text=CRANE, **parameters):
    path = folder / "arm.urdf"
    path.write_text(text)
    return SerialArm.from_urdf(path, **{"tip": "eye", "acceleration": 2.0} | parameters)


LIFT_LIMIT = '<limit lower="-0.2" upper="0.7" velocity="0.5" effort="9"/>'
ENTITY = '<!DOCTYPE robot [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]>'
WRONG = {
    "a type of joint that is none": ('type="prismatic"', 'type="helical"', "must be one of fixed, revolute"),
    "a joint between root and tip that floats": ('"lift" type="prismatic"', '"lift" type="floating"', "lift.*floating"),
    "a joint without limits": (
        LIFT_LIMIT,
        "",
        "'lift' must have limits with lower below upper, got none; add <limit lower",
    ),
    "a revolute joint whose limits leave nothing": (
        'lower="-1.5" upper="2"',
        "",
        "'tilt' must have limits .* got lower 0",
    ),
    "a joint without a speed": (
        ' upper="0.7" velocity="0.5"',
        ' upper="0.7"',
        "'lift' must have a largest speed",
    ),
    "a joint that mimics another": (
        LIFT_LIMIT,
        LIFT_LIMIT + '<mimic joint="out"/>',
        "'lift'.*mimics 'out'.*in fixed, as {lift: 0.0}",
    ),
    "an axis of no direction": ('xyz="0 0.6 0.8"', 'xyz="0 0 0"', "axis of joint 'lift' must not have length 0"),
    "a number that is none": ('lower="-0.2"', 'lower="low"', "lower limit of joint 'lift' must be a number"),
    "a number that is not finite": ('xyz="0.1 -0.2 0.5"', 'xyz="0 nan 0"', "xyz of joint 'lift' must be 3 numbers"),
    "a link that is not there": (
        '<parent link="mast"/>',
        '<parent link="post"/>',
        "must join two links of the file, but 'post' is none",
    ),
    "two links of one name": (
        '<link name="eye"/>',
        '<link name="eye"/><link name="eye"/>',
        "links must have different names, but two are called",
    ),
    "a circle beside the root": (
        '<parent link="rail"/>',
        '<parent link="eye"/>',
        "must be joined to the root 'rail', but 5 are not, .* form a circle, 'mast' > 'boom' > 'jib' > 'eye' > 'mast'",
    ),
    "a capsule": ("<sphere", "<capsule", "link 'jib' must be a box, cylinder, sphere or mesh, got <capsule>"),
    "a sphere of no size": ('<sphere radius="0.03"/>', '<sphere radius="0"/>', "radius of .* must be above 0 m"),
    "a document type": ("<robot", ENTITY + "<robot", "document type or entities"),
    "macros": ("<link name=", '<xacro:include filename="x"/><link name=', "xacro arm.urdf > arm.urdf"),
    "no XML": ("</robot>", "", "must be XML"),
    "another root": ("robot", "gazebo", "must be <robot>"),
}


@pytest.mark.parametrize(("old", "new", "said"), WRONG.values(), ids=WRONG)
def test_a_urdf_with_a_mistake_is_refused_with_what_is_wrong(tmp_path, old, new, said):
    assert old in CRANE
    with pytest.raises(ModelError, match=said):
        made(tmp_path, CRANE.replace(old, new, -1 if old == "robot" else 1))


def test_links_in_a_circle_are_called_so(tmp_path):
    ends = (("a", "b"), ("b", "c"), ("c", "a"))
    links = "".join(f'<link name="{parent}"/>' for parent, _ in ends)
    joints = "".join(
        f'<joint name="{a}{b}" type="fixed"><parent link="{a}"/><child link="{b}"/></joint>' for a, b in ends
    )
    circle = "the joints form a circle, 'a' > 'b' > 'c' > 'a'; remove"
    with pytest.raises(ModelError, match=circle):
        made(tmp_path, f"<robot>{links}{joints}</robot>")


def test_a_urdf_without_the_tip_is_refused_with_its_links(tmp_path):
    with pytest.raises(ModelError, match=r"one of its links, got 'eyes'\. Did you mean 'eye'\? Its links are 'rail', "):
        made(tmp_path, tip="eyes")
    with pytest.raises(ModelError, match="joint between the root 'rail' and the tip 'rail' must move"):
        made(tmp_path, tip="rail")


def test_an_acceleration_of_a_joint_that_is_not_there_is_refused_by_its_name(tmp_path):
    given = {"lift": 1.0, "swing": 1.0, "out": 1.0, "tilt": 1.0}
    assert made(tmp_path, acceleration={**given, "wick": 1.0}).chain.acceleration.tolist() == [1.0] * 4
    with pytest.raises(
        ModelError, match=r"acceleration must name joints of this file, got 'tlit'; .* Did you mean 'tilt'\?"
    ):
        made(tmp_path, acceleration={**given, "tlit": 1.0})


@pytest.mark.parametrize("given", [0, -1.0, float("inf"), "fast", {"lift": 1.0}, {"lift": "fast"}])
def test_accelerations_are_positive_numbers_one_for_all_or_one_for_each_joint(tmp_path, given):
    with pytest.raises(ModelError, match="acceleration"):
        made(tmp_path, acceleration=given)


def test_what_is_missing_is_named(tmp_path):
    with pytest.raises(
        ModelError, match="model 'serial_arm' also needs tip, acceleration; its parameters are urdf, tip, acc"
    ):
        SerialArm.from_urdf(HERE / "arm6.urdf")
    with pytest.raises(ModelError, match=r"has no parameter 'accelerations'\. Did you mean 'acceleration'\?"):
        SerialArm.from_urdf(HERE / "arm6.urdf", tip="tool", accelerations=6.0)
    with pytest.raises(ModelError, match=r"the URDF '.*lost.urdf' cannot be opened.*check the path"):
        SerialArm.from_urdf(tmp_path / "lost.urdf", tip="eye", acceleration=1.0)
    with pytest.raises(ModelError, match=r"arm7\.urdf' cannot be opened: .* Did you mean '.*arm6\.urdf'\?"):
        SerialArm.from_urdf(HERE / "arm7.urdf", tip="eye", acceleration=1.0)
    with pytest.raises(ModelError, match=r"the SRDF '.*lost.srdf' cannot be opened"):
        crane(tmp_path, srdf=tmp_path / "lost.srdf")


def test_a_fifo_and_what_nests_too_deep_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.urdf")
    with pytest.raises(ModelError, match="FIFO"):
        SerialArm.from_urdf(tmp_path / "pipe.urdf", tip="eye", acceleration=1.0)
    with pytest.raises(ModelError, match="nested at most 50 deep"):
        made(tmp_path, "<robot>" + "<a>" * 60 + "</a>" * 60 + "</robot>")


# Joints that stand


def test_a_joint_beside_the_chain_stands_at_the_limit_nearest_to_zero_or_where_it_is_told(tmp_path):
    """The wick turns the lamp about y; its limits begin at 0.2."""
    text = CRANE.replace('<link name="lamp"/>', LAMP)
    for fixed, angle in (({}, 0.2), ({"wick": 0.9}, 0.9)):
        (lamp,) = (part for part in made(tmp_path, text, fixed=fixed).parts if part.link == "lamp")
        assert lamp.frame == 3
        np.testing.assert_allclose(lamp.solid.pose[:3, 0], [np.cos(angle), 0, -np.sin(angle)], atol=1e-12)


LAMP = '<link name="lamp"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>'


def test_a_joint_of_the_chain_that_is_fixed_moves_no_more(tmp_path):
    free, fixed = made(tmp_path), made(tmp_path, fixed={"out": 0.1})
    assert fixed.space.names == ("lift", "swing", "tilt")
    rows = {"lift": 0.3, "swing": 1.0, "tilt": -0.4}
    poses = [arm.pose("tool", arm.space.state(rows | extra)) for arm, extra in ((free, {"out": 0.1}), (fixed, {}))]
    np.testing.assert_allclose([p.x[0] for p in poses[:1]], [poses[1].x[0]], atol=1e-12)
    np.testing.assert_allclose([p.z[0] for p in poses[:1]], [poses[1].z[0]], atol=1e-12)
    with pytest.raises(ModelError, match=r"got 'outer'; its joints are 'lift', .*Did you mean 'out'"):
        made(tmp_path, fixed={"outer": 0.1})


def test_a_finger_that_mimics_a_standing_one_stands_as_far_out(tmp_path):
    follower = (
        '<link name="wing"><collision><geometry><sphere radius="0.02"/></geometry></collision></link>'
        '<joint name="flap" type="prismatic"><parent link="jib"/><child link="wing"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" velocity="1"/><mimic joint="wick" multiplier="2" offset="0.1"/></joint></robot>'
    )
    arm = made(tmp_path, CRANE.replace("</robot>", follower), fixed={"wick": 0.3})
    (wing,) = (part for part in arm.parts if part.link == "wing")
    assert wing.solid.pose[2, 3] == pytest.approx(0.7)


# SRDF


def test_group_states_and_pairs_that_never_touch_come_from_the_srdf():
    arm = arm6()
    assert set(arm.space.named) == {"home", "ready", "upright"}
    assert {("base", "upper_arm"), ("elbow", "wrist"), ("base", "shoulder"), ("camera", "hand")} <= arm.apart


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<disable_collisions link1="base"/>', "needs a link2"),
        ('<group_state name="home" group="arm"><joint name="a" value="x"/></group_state>', "value of joint 'a'"),
        ('<group_state group="arm"/>', "needs a name"),
    ],
)
def test_an_srdf_with_a_mistake_is_refused(tmp_path, text, said):
    path = tmp_path / "arm.srdf"
    path.write_text(f'<robot name="arm">{text}</robot>')
    with pytest.raises(ModelError, match=said):
        arm6(srdf=path)


def test_links_of_an_srdf_that_the_urdf_does_not_have_are_named_in_a_note(tmp_path):
    assert arm6().notes == ()
    path = tmp_path / "arm.srdf"
    pairs = '<disable_collisions link1="base" link2="thumb"/><disable_collisions link1="camera" link2="finger"/>'
    path.write_text(f'<robot name="arm">{pairs}</robot>')
    assert ["'finger', 'thumb', which the URDF does not have" in note for note in arm6(srdf=path).notes] == [True]


def test_a_named_state_beyond_a_limit_is_refused_when_it_is_asked_for(tmp_path):
    """MoveIt's SRDF of the Panda has one: that is no reason to refuse the arm."""
    path = tmp_path / "arm.srdf"
    path.write_text((HERE / "arm6.srdf").read_text().replace('value="-1.2"', 'value="-2.2"'))
    with pytest.raises(QueryError, match=r"shoulder_to_upper_arm of the start must be .*, got -2.2"):
        arm6(srdf=path).space.state("home", what="start")


@pytest.mark.parametrize(
    ("soft", "low", "high"),
    [
        ('soft_lower_limit="-1.2" soft_upper_limit="1.9"', -1.2, 1.9),
        ('soft_lower_limit="-3" soft_upper_limit="1.9"', -1.5, 1.9),  # the tighter of both
        ('soft_upper_limit="1.9"', -1.5, 1.9),  # one that is left out sets none
        ("", -1.5, 2.0),
    ],
)
def test_soft_limits_count_where_they_are_tighter(tmp_path, soft, low, high):
    """As moveit_core's robot_model.cpp, jointBoundsFromURDF."""
    controller = f'<safety_controller k_position="100" k_velocity="40" {soft}/>'
    tilt = '<limit lower="-1.5" upper="2" velocity="2" effort="9"/>'
    arm = made(tmp_path, CRANE.replace(tilt, tilt + controller))
    assert (arm.space.low[-1], arm.space.high[-1]) == (low, high)
    assert arm.notes == ()
    turning = CRANE.replace('<limit velocity="1.5"', f'{controller}<limit velocity="1.5"')
    assert made(tmp_path, turning).space.turning == frozenset({"swing"})  # of a continuous joint they say nothing


def test_soft_limits_that_leave_no_room_are_left_out_and_told(tmp_path):
    controller = '<safety_controller k_velocity="40" soft_lower_limit="0" soft_upper_limit="0"/>'
    arm = made(tmp_path, CRANE.replace('<limit lower="-1.5"', controller + '<limit lower="-1.5"'))
    assert (arm.space.low[-1], arm.space.high[-1]) == (-1.5, 2.0)
    assert arm.notes == ("the soft limits of joint 'tilt' exclude all values within its limits, and are ignored",)


def test_soft_limits_are_those_of_the_panda(shared_data):
    """Within the limits of its maker, beyond which it stops: 2.8973 rad of the first joint, not 2.9671."""
    arm = SerialArm.from_urdf(shared_data("mbm_panda") / "panda_spherized.urdf", tip="panda_link8", acceleration=3.0)
    assert arm.space.low[0] == -2.8973
    assert arm.space.high[0] == 2.8973


def test_an_srdf_in_xacro_is_refused_as_a_urdf_in_xacro_is(tmp_path):
    srdf = tmp_path / "arm.srdf.xacro"
    srdf.write_text('<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="r"><xacro:states/></robot>')
    with pytest.raises(ModelError, match=r"it is xacro; expand it: xacro arm.srdf.xacro > arm.srdf"):
        made(tmp_path, srdf=srdf)


def test_a_joint_that_an_srdf_calls_passive_is_told(tmp_path):
    srdf = tmp_path / "arm.srdf"
    srdf.write_text('<robot name="crane"><passive_joint name="tilt"/><passive_joint name="wick"/></robot>')
    (note,) = made(tmp_path, srdf=srdf).notes
    assert "no motor drives the joints 'tilt' (passive_joint)" in note
    assert made(tmp_path, srdf=srdf, fixed={"tilt": 0.0}).notes == ()
    srdf.write_text('<robot name="crane"><passive_joint name="tilt_joint"/><passive_joint name="wik"/></robot>')
    (note,) = made(tmp_path, srdf=srdf).notes
    assert note.startswith("the SRDF calls passive the joints 'tilt_joint', 'wik', which the URDF does not have")
    assert "Did you mean 'wick'?" in note
