"""Kinematics of arms agree with pinocchio, and what bodies do with finite differences of their poses."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hpop.criteria import make_criterion, motion_costs
from hpop.models import SerialArm
from hpop.motions import Motions, States, integrated
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing.worlds import random_world
from tests.models.serial_arm.arms import IN_HAND, arm6, crane

WORLD = random_world(np.random.default_rng(0))


@pytest.fixture(scope="module")
def arms(shared_data, tmp_path_factory):
    """By name: the Panda of MotionBenchMaker without its meshes, which are not there; the example's arm; a crane."""
    folder = tmp_path_factory.mktemp("arms")

    def panda():
        text = (shared_data("mbm_panda") / "panda.urdf").read_text()
        bare = folder / "panda.urdf"
        bare.write_text(re.sub(r"<collision>.*?</collision>", "", text, flags=re.DOTALL))
        return SerialArm.from_urdf(bare, tip="panda_hand", acceleration=5.0, camera=IN_HAND)

    made = {"panda": panda, "arm6": arm6, "crane": lambda: crane(folder)}
    return cache(lambda name: made[name]())


def drawn(arm, rng, size):
    rows = rng.uniform(arm.chain.low, arm.chain.high, (size, len(arm.chain)))
    return States(**dict(zip(arm.chain.names, rows.T, strict=True)))


def reaches(arm, rng, size, share=1.0):
    start, other = drawn(arm, rng, size), drawn(arm, rng, size)
    end = States(**{n: getattr(start, n) + share * (getattr(other, n) - getattr(start, n)) for n in start.names})
    return Motions(WORLD, arm, arm.laws["reach"], start, end)


def columns(vector, size):
    return np.stack([np.broadcast_to(column, (size,)) for column in vector], axis=1)


# Against pinocchio


@pytest.mark.parametrize("name", ["panda", "arm6", "crane"])
def test_poses_twists_and_their_rates_are_pinocchio_s_within_1e_9(arms, name):
    pin = pytest.importorskip("pinocchio")
    arm, size, rng = arms(name), 1000, np.random.default_rng(1)
    states = drawn(arm, rng, size)
    rates, changes = (
        States(**dict(zip(arm.chain.names, rng.normal(size=(len(arm.chain), size)), strict=True))) for _ in range(2)
    )
    pose, twist = arm.pose("tool", states), arm.twist("tool", states, rates)
    twist_rate = arm.twist_rate("tool", states, rates, changes)
    found = [columns((pose.x, pose.y, pose.z), size)]
    found += [columns(axis, size) for axis in (pose.ahead, pose.left, pose.up)]
    found += [columns(part, size) for both in (twist, twist_rate) for part in (both.velocity, both.rotation)]
    model = pin.buildModelFromUrdf(arm.urdf)
    data, frame = model.createData(), model.getFrameId(arm.tip)
    places = [model.joints[model.getJointId(joint)] for joint in arm.chain.names]
    expected = []
    for i in range(size):
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        for joint, place in zip(arm.chain.names, places, strict=True):
            value = getattr(states, joint)[i]
            q[place.idx_q : place.idx_q + place.nq] = value if place.nq == 1 else (np.cos(value), np.sin(value))
            v[place.idx_v], a[place.idx_v] = getattr(rates, joint)[i], getattr(changes, joint)[i]
        pin.forwardKinematics(model, data, q, v, a)
        placement = pin.updateFramePlacement(model, data, frame)
        aligned = pin.LOCAL_WORLD_ALIGNED
        moves = pin.getFrameVelocity(model, data, frame, aligned)
        speeds_up = pin.getFrameClassicalAcceleration(model, data, frame, aligned)
        vectors = [placement.translation, *placement.rotation.T]
        vectors += [moves.linear, moves.angular, speeds_up.linear, speeds_up.angular]
        expected.append(np.stack(vectors))
    np.testing.assert_allclose(np.stack(found, axis=1), np.array(expected), atol=1e-9, rtol=1e-9)


# What bodies do


@pytest.mark.parametrize("body", ["camera", "tool"])
@pytest.mark.parametrize("name", ["panda", "arm6", "crane"])
def test_length_and_rotation_are_what_poses_add_up_to_along_a_reach(arms, name, body):
    """∫|v| and ∫|ω| against the chords and angles between 2,000 poses; reaches of a third of the joints' ranges."""
    arm, size, steps = arms(name), 20, 2000
    motions = reaches(arm, np.random.default_rng(2), size, 1 / 3)
    done = arm.body(body, motions)
    for i in range(size):
        ends = [motions.start.take(slice(i, i + 1)), motions.end.take(slice(i, i + 1))]
        shares = np.linspace(0.0, 1.0, steps + 1)
        names = arm.chain.names
        along = States(**{n: getattr(ends[0], n) + shares * (getattr(ends[1], n) - getattr(ends[0], n)) for n in names})
        pose = arm.pose(body, along)
        places = columns((pose.x, pose.y, pose.z), steps + 1)
        axes = np.stack([columns(axis, steps + 1) for axis in (pose.ahead, pose.left, pose.up)], axis=1)
        turns = 0.5 * np.cross(axes[:-1], axes[1:]).sum(axis=1)  # small rotations, as vectors
        length = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
        assert done.length[i] == pytest.approx(length, rel=1e-3, abs=1e-6)
        assert done.turned[i] == pytest.approx(np.linalg.norm(turns, axis=1).sum(), rel=1e-3, abs=1e-6)
        assert done.rotation[i] == pytest.approx(turns[:, 2].sum(), rel=1e-3, abs=2e-3)


def test_bodies_by_the_way_alone_are_their_twists_integrated_over_time(arms):
    """Two quadratures: over the share done, and over the time of each phase."""
    arm = arms("arm6")
    motions = reaches(arm, np.random.default_rng(3), 200, 1 / 3)
    done, summed = arm.body("camera", motions), integrated("camera", motions)
    np.testing.assert_allclose(done.length, summed.length, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(done.turned, summed.turned, rtol=1e-3, atol=1e-5)


@pytest.mark.parametrize("name", ["panda", "crane"])
def test_no_body_moves_or_turns_farther_than_the_extent_says(arms, name):
    arm = arms(name)
    motions = reaches(arm, np.random.default_rng(4), 300)
    farthest, turned = arm.extent(motions)
    for body in ("camera", "tool"):
        done = arm.body(body, motions)
        assert (done.length <= farthest * 1.03).all()  # the adaptive rule may err by so much
        assert (done.turned <= turned * 1.03).all()


# One code for numbers and symbols


@pytest.mark.cases("rotation", "duration")
@pytest.mark.parametrize("criterion", ["duration", "rotation", "camera_length", "look_at"])
def test_a_reach_costs_the_same_in_numbers_and_on_symbols(arms, criterion):
    pytest.importorskip("casadi")
    arm = arms("arm6")
    made = make_criterion({"look_at": {"look_at": {"target": [0.6, 0.1, 0.5]}}}.get(criterion, criterion))
    motions = replace(reaches(arm, np.random.default_rng(5), 5), panels=3, t0=np.zeros(5))
    symbols = SymbolicMotions.of(motions)
    value, jacobian = symbols.values_and_jacobian(made.cost(symbols.motions))
    np.testing.assert_allclose(value, motion_costs(made, motions), rtol=1e-6, atol=1e-9)
    assert np.isfinite(jacobian).all()


# Frames of reference


def test_turning_the_base_together_with_the_world_changes_no_cost(arms):
    """A quarter turn and a shift of the base: what does not depend on where things are stays as it is."""
    here, there = arms("arm6"), arm6(base=(3.0, -1.0, 0.4, 0.0, 0.0, 2.2))
    rng = np.random.default_rng(6)
    motions = reaches(here, rng, 100)
    moved = Motions(WORLD, there, there.laws["reach"], motions.start, motions.end)
    for name in ("duration", "rotation", "camera_length"):
        costs = [motion_costs(make_criterion(name), m) for m in (motions, moved)]
        np.testing.assert_allclose(*costs, rtol=1e-9, atol=1e-12)
    turn = np.array([[np.cos(2.2), -np.sin(2.2), 0.0], [np.sin(2.2), np.cos(2.2), 0.0], [0.0, 0.0, 1.0]])
    poses = [arm.pose("camera", motions.end) for arm in (here, there)]
    places = [columns((pose.x, pose.y, pose.z), 100) for pose in poses]
    np.testing.assert_allclose(places[1], places[0] @ turn.T + [3.0, -1.0, 0.4], atol=1e-12)


# The camera in the hand


def test_the_camera_looks_along_the_fingers_level_where_the_hand_reaches_ahead(arms):
    arm = arms("arm6")
    pose = arm.pose("camera", arm.space.state("ready"))
    assert [float(part[0]) for part in columns(pose.ahead, 1).T] == pytest.approx([1, 0, 0], abs=1e-12)
    assert [float(part[0]) for part in columns(pose.up, 1).T] == pytest.approx([0, 0, 1], abs=1e-12)
    assert [float(angle[0]) for angle in (pose.yaw, pose.pitch, pose.roll)] == pytest.approx([0, 0, 0], abs=1e-12)


def test_roll_is_positive_where_the_camera_leans_to_its_right(arms):
    arm = arms("arm6")
    leaning = arm.space.by_name("ready", "state") | {"wrist_to_hand": 0.3}
    pose = arm.pose("camera", arm.space.state(leaning))
    assert float(pose.left[2][0]) == pytest.approx(np.sin(float(pose.roll[0])))
    assert abs(float(pose.roll[0])) == pytest.approx(0.3)


@pytest.mark.parametrize("name", ["arm6", "crane"])
@pytest.mark.parametrize("body", ["camera", "tool"])
def test_poses_of_very_many_states_are_those_of_each(arms, name, body):
    states = drawn(arms(name), np.random.default_rng(9), 40_003)
    many, few = arms(name).pose(body, states), arms(name).pose(body, states.take(slice(39_000, None)))
    for column in ("x", "y", "z", "yaw", "pitch", "roll"):
        np.testing.assert_array_equal(getattr(many, column)[39_000:], getattr(few, column))
    for axis in ("ahead", "left", "up"):
        np.testing.assert_array_equal(columns(getattr(many, axis), 40_003)[39_000:], columns(getattr(few, axis), 1_003))


@pytest.mark.parametrize("name", ["arm6", "crane"])
def test_bodies_in_many_states_are_where_they_are_in_each(arms, name):
    """Joints of both kinds: turning and sliding."""
    model = arms(name)
    states = drawn(model, np.random.default_rng(5), 300)
    for number in (0, 7, 299):
        for (shape, poses), (alone, pose) in zip(
            model.bodies(states), model.bodies(states.take([number])), strict=True
        ):
            assert shape is alone
            np.testing.assert_allclose(poses[number], pose[0], atol=1e-12)
