"""Twists are the derivatives of poses, and what a body does is their integral: for every law of every view."""

from dataclasses import replace

import numpy as np
import pytest

import hpop
from hpop.criteria.costs import motion_costs, trajectory_costs
from hpop.models.driven import driven
from hpop.motions import Body, States, integrated
from hpop.testing import random_motions, random_world
from hpop.trajectories.trajectory import Trajectory

MOMENT = 1e-6  # s, for differences
FIXED = hpop.DifferentialDrive(camera_offset=(0.2, -0.1))
UNWOUND = hpop.ViewModel(FIXED, "unwound", 0.7)
POSES = [(2.0, 2.0, 0.3), (4.0, 2.0, 1.0), (5.0, 4.0, -2.0), (3.0, 6.0, 3.0)]


def executed(model):
    return [
        Trajectory.from_poses(model, POSES).execution(),
        driven(model, (3.0, 3.0, 0.4), [(1, 0.5, 1), (0, -2, 0.8), (0.3, 1, 0.7), (-1, -0.4, 0.5)]),
    ]


def stacked(vector, size):
    """Three columns, or numbers in their place, as an array (3, N)."""
    return np.stack([np.broadcast_to(column, (size,)) for column in vector])


def rotation_between(before, after, size):
    """Rotation vectors (3, N) that take the axes of one pose to those of another, for small angles."""
    axes = [[stacked(axis, size) for axis in (p.ahead, p.left, p.up)] for p in (before, after)]
    return 0.5 * sum(np.cross(a, b, axis=0) for a, b in zip(*axes, strict=True))


@pytest.mark.parametrize("model", [FIXED, UNWOUND], ids=["fixed", "unwound"])
@pytest.mark.parametrize("body", ["base", "camera"])
def test_a_twist_is_how_fast_a_pose_changes(model, body):
    for trajectory in executed(model):
        times, size = np.random.default_rng(1).uniform(0.01, trajectory.duration - 0.01, 60), 60
        around = [times - MOMENT, times + MOMENT]
        rates, changes = trajectory.rates(times)
        twist = model.twist(body, trajectory.at(times), rates)
        before, after = (model.pose(body, trajectory.at(moments)) for moments in around)
        moved = np.stack([after.x - before.x, after.y - before.y, after.z - before.z])
        np.testing.assert_allclose(stacked(twist.velocity, size), moved / (2 * MOMENT), atol=1e-5)
        turned = rotation_between(before, after, size)
        np.testing.assert_allclose(stacked(twist.rotation, size), turned / (2 * MOMENT), atol=1e-5)

        rate = model.twist_rate(body, trajectory.at(times), rates, changes)
        begin, end = (model.twist(body, trajectory.at(moments), trajectory.rates(moments)[0]) for moments in around)
        for part in ("velocity", "rotation"):
            found, *ends = (stacked(getattr(one, part), size) for one in (rate, begin, end))
            np.testing.assert_allclose(found, (ends[1] - ends[0]) / (2 * MOMENT), atol=1e-3)


@pytest.mark.parametrize("model", [FIXED, UNWOUND], ids=["fixed", "unwound"])
@pytest.mark.parametrize("kind", ["move", "turn", "drive"])
def test_closed_forms_are_the_integrals_of_twists(model, kind):
    rng = np.random.default_rng(2)
    motions = random_motions(rng, random_world(rng), model, kind, 40)
    for name in ("base", "camera"):
        closed, summed = model.body(name, motions), integrated(name, motions)
        for column, error in {"length": 2e-4, "turned": 1e-3, "rotation": 1e-9}.items():  # |ω| has a kink
            np.testing.assert_allclose(getattr(closed, column), getattr(summed, column), atol=error, err_msg=column)
        assert not (closed.stays and summed.length.any())
        assert not (closed.steady and np.asarray(summed.turned).any())


def test_a_view_that_is_turned_back_as_the_base_turns_does_not_rotate():
    """Every criterion about the camera's rotation is 0, and so is motion sickness from turning."""
    rng = np.random.default_rng(3)
    world, model = random_world(rng), hpop.ViewModel(yaw=0.7)
    names = ["rotation", "rotation_time", "angular_acceleration", "turns", "orientation_retention"]
    for kind in ("turn", "drive"):
        motions = random_motions(rng, world, model, kind, 20)
        for name in names:
            assert not motion_costs(hpop.criteria.make_criterion(name), motions).any(), name
        assert motions.base.turned.all()
        np.testing.assert_array_equal(motions.camera.start.yaw, 0.7)
    in_place = Trajectory.from_poses(model, [(2.0, 2.0, 0.0), (2.0, 2.0, 2.0)])
    still = ["sickness", "msdv", "net_winding", "net_misalignment", "optic_flow", "peak_optic_flow", "jerk"]
    costs = trajectory_costs([hpop.criteria.make_criterion(name) for name in still], [in_place], world)
    np.testing.assert_allclose(costs, 0.0, atol=1e-9)
    turning = Trajectory.from_poses(hpop.DifferentialDrive(), [(2.0, 2.0, 0.0), (2.0, 2.0, 2.0)])
    flow = hpop.criteria.make_criterion("optic_flow")
    assert trajectory_costs([flow], [turning], world)[0, 0] == pytest.approx(2.0)


def test_a_model_of_no_closed_forms_costs_the_same():
    """`integrated` serves any model whose twists are right; every criterion of the camera then agrees."""

    class Plain(hpop.DifferentialDrive):
        def body(self, name: str, motions: hpop.Motions) -> Body:
            return integrated(name, motions)

    rng = np.random.default_rng(4)
    world = random_world(rng)
    for kind in ("move", "turn"):
        closed = random_motions(np.random.default_rng(5), world, FIXED, kind, 30)
        plain = replace(closed, model=Plain(camera_offset=FIXED.camera_offset))
        for name in ("rotation", "length", "rotation_time", "turns", "optic_flow", "angular_acceleration", "exposure"):
            criterion = hpop.criteria.make_criterion(name)
            np.testing.assert_allclose(motion_costs(criterion, plain), motion_costs(criterion, closed), atol=1e-6)


def test_a_view_that_no_camera_has_is_refused():
    with pytest.raises(hpop.errors.ModelError, match="turning must be one of fixed, level, unwound, got 'free'"):
        hpop.ViewModel(turning="free")


def test_axes_are_those_of_the_angles():
    states = States(x=np.zeros(3), y=np.zeros(3), yaw=np.array([0.0, 1.0, -2.0]))
    for model, yaw in ((FIXED, states.yaw), (UNWOUND, np.full(3, 0.7))):
        pose = model.pose("camera", states)
        np.testing.assert_allclose(np.arctan2(pose.ahead[1], pose.ahead[0]), yaw)
        np.testing.assert_allclose(pose.ahead[0] * pose.left[1] - pose.ahead[1] * pose.left[0], pose.up[2])
