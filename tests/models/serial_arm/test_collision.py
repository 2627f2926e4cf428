"""Collisions of an arm with the world, itself and the limits of its joints; its distance from the world."""

from dataclasses import replace

import fcl
import numpy as np
import pytest
import shapely

from hpop.base.registry import with_optional_members
from hpop.errors import ModelError
from hpop.models.differential_drive import DifferentialDrive
from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.models.serial_arm.collision import KEPT, always_touching
from hpop.models.serial_arm.model import SerialArm
from hpop.motions import MODEL_DEFAULTS
from hpop.world import World
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere, pose_at
from tests.models.serial_arm.cluttered import Cluttered, cluttered


def planar(*, lengths=(0.5, 0.5), solids=(), turning=False) -> Cluttered:
    """Links as bars in a row along x at 0, that turn about z in one plane."""
    count = len(lengths)
    starts = np.array([pose_at((x, 0.0, 0.0)) for x in (0.0, *lengths[:-1])])
    chain = Chain(
        names=tuple(f"q{k}" for k in range(count)),
        sliding=np.zeros(count, bool),
        turning=np.full(count, turning),
        axes=np.tile([0.0, 0.0, 1.0], (count, 1)),
        origins=starts,
        low=np.full(count, -2.3),
        high=np.full(count, 2.3),
        speed=np.ones(count),
        acceleration=np.ones(count),
    )
    parts = [
        ArmPart(f"bar{k}", k + 1, Solid(Box((length - 0.06, 0.02, 0.02)), pose_at((length / 2, 0.0, 0.0))))
        for k, length in enumerate(lengths)
    ]
    parts.append(ArmPart("base", 0, Solid(Cylinder(0.02, 0.5), pose_at((0.0, 0.0, -0.26)))))
    far = Solid(Sphere(0.1), pose_at((50.0, 0.0, 0.0)), "far away")
    return Cluttered(chain, tuple(parts), World.from_solids([*solids, far]), frozenset())


CAN = Solid(Cylinder(0.05, 0.2), pose_at((0.9, 0.0, 0.0)), "can")


def test_why_blocked_names_the_link_and_the_obstacle():
    arm = planar(solids=[CAN])
    state = arm.states([[0.0, 0.0]])
    for asked in (arm.collision, arm.judge):
        assert not asked.states_free(state)[0]
        assert "the link 'bar1'" in asked.why_blocked(state)
        assert "the obstacle 'can'" in asked.why_blocked(state)
    free = arm.states([[1.5, 0.0]])
    assert [asked.why_blocked(free) for asked in (arm.collision, arm.judge)] == ["", ""]


def test_why_blocked_names_two_links():
    """Three bars as a triangle: the last one comes back to the first."""
    arm = planar(lengths=(0.5, 0.5, 0.5))
    state = arm.states([[0.0, 2.2, 2.2]])
    for asked in (arm.collision, arm.judge):
        assert "the link 'bar0'" in asked.why_blocked(state)
        assert "the link 'bar2'" in asked.why_blocked(state)
    apart = replace(arm, apart=frozenset({("bar0", "bar2")}))
    assert apart.collision.states_free(state)[0]
    assert apart.judge.states_free(state)[0]


def test_why_blocked_names_the_joint_beyond_its_limits():
    arm = planar()
    state = arm.states([[0.0, 2.31]])
    assert "joint 'q1' is at 2.31 rad, beyond its limits of -2.3 to 2.3 rad" in arm.collision.why_blocked(state)
    assert "joint 'q1'" in arm.judge.why_blocked(state)
    turns = planar(turning=True)
    assert turns.collision.states_free(state)[0]
    assert turns.judge.states_free(state)[0]


def test_motions_that_end_beyond_a_limit_are_blocked():
    arm = planar()
    motions = arm.motions([[0.0, 0.0], [0.0, 0.0]], [[0.0, 2.31], [0.0, 2.29]])
    assert arm.collision.motions_free(motions).tolist() == [False, True]
    assert arm.judge.motions_free(motions).tolist() == [False, True]


def test_a_state_with_a_joint_left_free_is_not_free():
    arm = planar()
    assert not arm.collision.states_free(arm.states([[0.0, np.nan]]))[0]


def test_what_stands_where_the_base_stands_is_no_collision():
    arm = planar(solids=[Solid(Box((1.0, 1.0, 0.1)), pose_at((0.0, 0.0, -0.55)), "table")])
    state = arm.states([[0.0, 0.0]])
    assert arm.collision.states_free(state)[0]
    assert arm.judge.states_free(state)[0]


def test_clearance_is_the_distance_of_the_hand_to_the_can():
    arm = planar(solids=[CAN])
    rows = np.array([[np.pi / 2, 0.0], [0.0, 0.0], [0.1, 0.0]])
    clearance = arm.collision.clearance(arm.states(rows))
    assert clearance[1] == 0.0
    assert clearance[0] == pytest.approx(np.hypot(0.89, 0.03) - 0.05, abs=3e-6)


def distances(judge, pairs, rows):
    """Least distance (N,), m, of pairs of the judge's objects by python-fcl; 0 where they touch."""
    frames, least = judge._frames(rows), np.full(len(rows), np.inf)
    for i in range(len(rows)):
        for a, part in enumerate(judge.parts):
            pose = frames[part.frame][i] @ part.solid.pose
            judge._objects[a].setTransform(fcl.Transform(pose[:3, :3], pose[:3, 3]))
        for a, b in pairs:
            one, other = judge._objects[a], judge._objects[b]
            least[i] = min(least[i], fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult()))
    return np.maximum(least, 0.0)


@pytest.mark.seeds(2, of=40)
def test_clearance_is_what_python_fcl_finds_and_no_more(seed):
    arm, rng = cluttered(seed), np.random.default_rng(seed)
    rows = rng.uniform(arm.chain.low, arm.chain.high, (20, len(arm.chain)))
    outer = [(a, b) for a, b in arm.judge._pairs if b >= len(arm.parts)]
    found = distances(arm.judge, outer, rows)
    assert arm.collision.clearance(arm.states(rows)) == pytest.approx(found, rel=3e-3, abs=1e-5)


def test_clearance_is_that_of_what_is_out_of_reach_too():
    arm = planar()
    assert arm.collision.clearance(arm.states([[0.0, 0.0]]))[0] == pytest.approx(50.0 - 0.1 - 0.97, abs=1e-4)
    nothing = replace(arm, world=World.from_solids([], extent=shapely.box(-1, -1, 1, 1)))
    assert nothing.collision.clearance(arm.states([[0.0, 0.0]])).tolist() == [np.inf]


@pytest.mark.seeds(2, of=40)
def test_states_are_free_where_python_fcl_finds_half_a_millimetre(seed):
    arm, rng = cluttered(seed), np.random.default_rng(seed)
    rows = rng.uniform(arm.chain.low, arm.chain.high, (60, len(arm.chain)))
    free = arm.collision.states_free(arm.states(rows))
    least = distances(arm.judge, arm.judge._pairs, rows)
    assert (least[free] >= KEPT - 1e-5).all()
    assert (least[~free] <= KEPT + 1e-5).all()
    assert arm.judge.states_free(arm.states(rows)).tolist() == (least > 0).tolist()


def test_links_that_always_touch_are_found_and_others_are_not():
    """Bars without gaps: 0 and 1 share their joint, and 0 stands on the base; 0 and 2 meet now and then."""
    arm = planar(lengths=(0.5, 0.5, 0.5))
    long = tuple(
        ArmPart(part.link, part.frame, Solid(Box((0.5, 0.02, 0.02)), part.solid.pose)) if part.frame else part
        for part in arm.parts
    )
    assert always_touching(arm.chain, long, frozenset()) == {("bar0", "bar1"), ("bar0", "base"), ("bar1", "bar2")}
    assert always_touching(arm.chain, long, frozenset({("bar0", "bar1"), ("bar0", "base")})) == {("bar1", "bar2")}


@pytest.mark.seeds(1, of=10)
def test_the_judge_says_what_python_fcl_says_at_every_step_of_1_mm(seed):
    arm, rng = cluttered(seed, joints=4, solids=20), np.random.default_rng(seed)
    by_coal, judge, rows = (
        replace(arm.judge, library="coal"),
        arm.judge,
        rng.uniform(arm.chain.low, arm.chain.high, (20, 4)),
    )
    motions = arm.motions(rows[:-1], rows[:-1] + 0.1 * (rows[1:] - rows[:-1]))
    found = judge.motions_free(motions)
    assert by_coal.motions_free(motions).tolist() == found.tolist()
    for i in range(len(motions)):
        steps = judge._steps_along(motions, i)
        assert steps.moved.max(initial=0.0) <= 1e-3
        touching = False
        for a, b in judge._pairs:
            one, other = judge._objects[a], judge._objects[b]
            for step in range(len(steps.rows)):
                for body, thing in ((a, one), (b, other)):
                    if body < len(arm.parts):
                        pose = steps.poses[body, step]
                        thing.setTransform(fcl.Transform(pose[:, :3], pose[:, 3]))
                if fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
                    touching = True
                    break
            if touching:
                break
        assert found[i] != touching


def test_coal_finds_the_contacts_of_balls_and_boxes_by_closed_forms():
    """A ball in the hand at known distances from a box and a ball, with and without padding and allowed contacts."""
    arm = planar(solids=[CAN, Solid(Box((0.2, 0.2, 0.2)), pose_at((0.0, 1.2, 0.0)), "box")])
    ball = ArmPart("hand", 2, Solid(Sphere(0.05), pose_at((0.55, 0.0, 0.0))))
    arm = replace(arm, parts=(*arm.parts, ball))
    angles = np.linspace(1.35, 1.8, 91)
    x, y = 1.05 * np.cos(angles), 1.05 * np.sin(angles)
    off = np.hypot(np.maximum(np.abs(x) - 0.1, 0.0), np.maximum(np.abs(y - 1.2) - 0.1, 0.0))
    states = arm.states(np.column_stack([angles, np.zeros(91)]))
    for padding in (0.0, 0.004):
        padded = replace(arm, parts=(*arm.parts[:-1], replace(ball, padding=padding)))
        judge = replace(padded.judge, library="coal")
        assert judge.states_free(states).tolist() == (off > 0.05 + padding).tolist()
    assert "the link 'hand' touches the obstacle 'box'" in judge.why_blocked(states.take([45]))
    with pytest.raises(ModelError, match="the library of a judge must be one of fcl, coal, got 'bullet'"):
        replace(arm.judge, library="bullet")


def test_only_arms_are_judged_by_coal():
    with pytest.raises(ModelError, match="only arms are judged by 'coal', but the model is a differential_drive"):
        with_optional_members(DifferentialDrive(), MODEL_DEFAULTS).judge_by("coal", planar().world)


def test_hulls_of_many_corners_are_links_too():
    rng = np.random.default_rng(0)
    arm = planar(solids=[CAN])
    points = rng.normal(size=(200, 3))
    round_ = Hull(0.04 * points / np.linalg.norm(points, axis=1)[:, None])
    arm = replace(arm, parts=(*arm.parts, ArmPart("hand", 2, Solid(round_, pose_at((0.5, 0.0, 0.1))))))
    rows = np.array([[np.pi / 2, 0.0]])
    assert arm.collision.clearance(arm.states(rows))[0] == pytest.approx(np.hypot(0.89, 0.03) - 0.05, abs=3e-6)


STUBBY = """<robot name="stubby">
  <link name="base"/>
  <link name="one"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="two"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="three"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="four"><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="a" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="b" type="revolute"><parent link="one"/><child link="two"/><origin xyz="0.05 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="c" type="revolute"><parent link="two"/><child link="three"/><origin xyz="0.05 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
  <joint name="d" type="revolute"><parent link="three"/><child link="four"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>
"""


def test_an_arm_without_an_srdf_says_which_links_always_touch(tmp_path):
    """Balls of 10 cm, 5 cm apart: one and three always touch though no joint joins them; four is 30 cm farther."""
    (tmp_path / "stubby.urdf").write_text(STUBBY)
    arm = SerialArm.from_urdf(tmp_path / "stubby.urdf", tip="four", acceleration=1.0)
    assert arm.always_touching == {("one", "three")}
    assert len(arm.notes) == 1
    assert "'one' and 'three'" in arm.notes[0]
    world = World.from_solids([Solid(Sphere(0.1), pose_at((5.0, 0.0, 0.0)))])
    assert arm.collision(world).why_blocked(arm.space.state((0.0, 0.0, 0.0, 0.0))) == ""
    (tmp_path / "stubby.srdf").write_text('<robot name="stubby"/>')
    told = SerialArm.from_urdf(tmp_path / "stubby.urdf", tip="four", acceleration=1.0, srdf=tmp_path / "stubby.srdf")
    assert told.notes == ()
    assert "'three'" in told.collision(world).why_blocked(arm.space.state((0.0, 0.0, 0.0, 0.0)))
