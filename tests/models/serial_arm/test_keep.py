"""Orientation kept along motions: the proof against brute force, plans against pinocchio's frames, and refusals."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import ModelError, QueryError
from hpop.goals import JointsAt, LookAt, ToolAt
from hpop.models.serial_arm.keep import SLACK
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.models.serial_arm.laws import rate_of
from hpop.motions import Motions, States
from hpop.problems.verify import verify
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import HERE, arm6, crane

FAR = World.from_solids([Solid(Box((0.1, 0.1, 0.1)), pose_at((9, 9, 9)), "far")])
POST = World.from_solids([Solid(Box((0.1, 0.1, 0.9)), pose_at((0.55, 0, 0.45)), "post")])
CUP = {"body": "tool", "axis": (-1, 0, 0), "angle": (0, "25 deg")}
LEVEL = {"body": "camera", "axis": (0, 2, 0), "direction": (0, 0, 1), "angle": (radians(75), radians(105))}
START, GOAL = (-0.9, 0.6, 1.2, 0, pi / 2 - 1.8, 0), (0.9, 0.3, 1.0, 0, pi / 2 - 1.3, 0)


def angles(arm, states: States) -> np.ndarray:
    """Angle (N,), rad, that the arm shall keep, from the body's axes."""
    kept = arm.kept
    pose = arm.pose(kept.of, states)
    axes = [
        np.stack(np.broadcast_arrays(*axis, np.zeros(states.size))[:3], 1) for axis in (pose.ahead, pose.left, pose.up)
    ]
    axis = sum(part * each for part, each in zip(kept.axis, axes, strict=True))
    return np.arccos(np.clip(axis @ np.array(kept.direction), -1, 1))


@pytest.mark.parametrize("kind", ["reach", "spline"])
@pytest.mark.parametrize(
    "keep", [CUP, LEVEL, {"body": "tool", "axis": (1, 2, 3), "direction": (1, 0, -1), "angle": (0.4, pi)}]
)
@pytest.mark.parametrize("make", [lambda folder, keep: arm6(keep=keep), lambda folder, keep: crane(folder, keep=keep)])
def test_what_is_proved_is_kept_and_what_is_refused_is_not(make, keep, kind, tmp_path):
    """Random motions: the extremes of 120 samples decide, but for the slack and the steps between."""
    arm, rng, count = make(tmp_path, keep), np.random.default_rng(5), 1500
    start = arm.space.sample(rng, count)
    columns = {n: np.clip(c + 0.5 * rng.standard_normal(c.size), -3, 3) for n, c in start.__dict__.items()}
    begin, end = dict(start.__dict__), dict(columns)
    if kind == "spline":
        for side in (begin, end):
            side |= {rate_of(name): rng.standard_normal(count) for name in arm.joints}
        begin["clock"], end["clock"] = np.zeros(count), rng.uniform(0.2, 1.0, count)
    motions = Motions(FAR, arm, arm.laws[kind], States(**begin), States(**end))
    proved = arm.kept.kept_along(Kinematics(arm.chain), motions.law, motions.start, motions.end)
    low, high = arm.kept.angle
    each, share = np.repeat(np.arange(count), 120), np.tile(np.linspace(0, 1, 120), count)
    first, last = motions.start.take(each), motions.end.take(each)
    at = States(**{name: motions.law.interpolate(name, first, last, share) for name in arm.joints})
    angle = angles(arm, at)
    beyond = np.maximum(low - angle if low else -np.inf, angle - high if high < pi else -np.inf)
    off = beyond.reshape(count, 120).max(axis=1)  # how far beyond the bounds
    assert 0 < proved.sum() < count
    assert off[proved].max() <= 1e-9
    assert off[~proved].min() >= -2 * SLACK - 0.01  # the sampled extreme may be a step short


@pytest.mark.parametrize("keep", [CUP, pytest.param(LEVEL, marks=pytest.mark.proof)])
def test_plans_keep_it_all_along_by_the_frames_of_pinocchio(keep):
    pin = pytest.importorskip("pinocchio")
    arm = arm6(keep=keep)
    problem = hpop.Problem(POST, arm, START, GOAL, ["duration", "rotation"])
    front = problem.solve("roadmap", samples=150)
    assert len(front)
    assert not verify(problem, front)
    assert f"on which {arm.kept}, proved all along each motion that was checked" in front.certificate
    assert str(arm.kept) in " ".join(front.notes)
    model = pin.buildModelFromUrdf(str(HERE / "arm6.urdf"))
    data, tool = model.createData(), model.getFrameId("tool")
    mount = arm.chain.mounts[arm.kept.of].pose
    from_tool = np.linalg.inv(arm.chain.mounts["tool"].pose) @ mount
    worst = []
    for trajectory in front.trajectories:
        states = trajectory.at(np.linspace(0, trajectory.duration, 300))
        for row in np.stack([getattr(states, name) for name in arm.joints], axis=1):
            q = pin.neutral(model)
            for name, value in zip(arm.joints, row, strict=True):
                q[model.joints[model.getJointId(name)].idx_q] = value
            pin.framesForwardKinematics(model, data, q)
            axis = data.oMf[tool].rotation @ from_tool[:3, :3] @ arm.kept.axis
            worst.append(np.arccos(np.clip(axis @ arm.kept.direction, -1, 1)))
    assert arm.kept.angle[0] - 1e-9 <= min(worst)
    assert max(worst) <= arm.kept.angle[1] + 1e-9
    again = hpop.Problem.from_description(front.problem)
    assert again.model == arm
    free = hpop.Problem(POST, arm6(), START, GOAL, ["duration", "rotation"]).solve("roadmap", samples=150)
    assert len(verify(problem, free)) >= 1  # the judge sees that these do not keep it
    assert any("does not keep its orientation" in fault for fault in verify(problem, free))


@pytest.mark.proof
def test_splines_keep_it_too():
    arm = arm6(keep=CUP)
    problem = hpop.Problem(POST, arm, START, GOAL, ["duration", "rotation"])
    front = problem.solve("spline", warm_start={"roadmap": {"samples": 60}})
    assert any("spline" in trajectory.kinds for trajectory in front.trajectories)
    for trajectory in front.trajectories:
        states = trajectory.at(np.linspace(0, trajectory.duration, 2000))
        assert angles(arm, states).max() <= radians(25) + 1e-9
    assert "proved all along" in front.certificate


def test_joints_that_cannot_change_the_angle_do_not_count():
    """The first axis is vertical, the last is the tool's z axis: neither changes that axis' angle to the vertical."""
    vertical = arm6(keep={"body": "tool", "axis": (0, 0, 1), "angle": (0, 1)})
    assert vertical.kept.turning(vertical.chain).tolist() == [False, True, True, True, True, False]
    sideways = arm6(keep={"body": "tool", "axis": (1, 0, 0), "direction": (1, 0, 0), "angle": (0, 1)})
    assert sideways.kept.turning(sideways.chain).all()


def test_a_start_that_does_not_keep_it_is_refused_and_says_why():
    with pytest.raises(
        QueryError, match=r"keep asks that the axis .* keeps 0 to 25 degrees .*, but here it has 90 degrees"
    ):
        hpop.Problem(POST, arm6(keep=CUP), (0,) * 6, GOAL, ["duration"]).solve("roadmap", samples=10)


@pytest.mark.parametrize(
    ("keep", "said"),
    [
        ({"axis": (0, 0, 1)}, "keep must be a mapping with body, axis, angle and"),
        (CUP | {"body": "hand"}, "body of keep must be tool or camera, got 'hand'"),
        (CUP | {"axis": (0, 0, 0)}, "a vector of any length but 0"),
        (CUP | {"angle": (0, 20)}, "angle of keep must be .*from 0 to pi"),
        (CUP | {"angle": (0.5, 0.2)}, "at least 0.01 apart"),
        (CUP | {"angle": 0.5}, "angle of keep must be"),
    ],
)
def test_what_cannot_be_kept_is_refused(keep, said):
    with pytest.raises(ModelError, match=said):
        arm6(keep=keep)


@pytest.mark.proof
def test_an_arm_on_a_base_keeps_it_while_it_drives_and_reaches():
    """The folded arm holds the cup upright as well; the frames are those of the URDF, turned by the base's heading."""
    upright = {"body": "tool", "axis": (-1, 0, 0), "angle": (0, radians(25))}
    folded = (0, -1.0, 2.5, 0, pi / 2 - 1.5, 0)
    robot = hpop.MobileArm(arm6(keep=upright, base=(0, 0, 0.3, 0, 0, 0)), folded=folded)
    world = World.from_polygons([], extent=shapely.box(-3, -3, 3, 3))
    goal = ToolAt((1.2, 0.6, 0.8))
    problem = hpop.Problem(world, robot, (-1, 0, 0, *folded), goal, ["duration", "rotation"])
    front = problem.solve("roadmap", samples=80, trees=3)
    assert len(front)
    assert verify(problem, front) == []
    assert "proved all along each motion that was checked" in front.certificate
    for trajectory in front.trajectories:
        states = trajectory.at(np.linspace(0, trajectory.duration, 500))
        pose = robot.pose("tool", states)
        assert np.arccos(np.clip(-np.broadcast_to(pose.ahead[2], 500), -1, 1)).max() <= radians(25) + 1e-9
    free = hpop.MobileArm(arm6(base=(0, 0, 0.3, 0, 0, 0)), folded=folded)
    turned = ToolAt((1.2, 0.6, 0.8), direction=(1, 0, 0))
    other = hpop.Problem(world, free, (-1, 0, 0, *folded), turned, ["duration", "rotation"])
    loose = other.solve("roadmap", samples=80, trees=3)
    assert any("does not keep its orientation" in fault for fault in verify(problem, loose))


def test_keeping_arms_on_bases_that_cannot_are_refused():
    with pytest.raises(ModelError, match="direction of keep must be vertical"):
        hpop.MobileArm(arm6(keep=CUP | {"direction": (1, 0, 0)}))
    with pytest.raises(ModelError, match="the folded arm must keep its orientation as well"):
        hpop.MobileArm(arm6(keep=CUP), folded="upright")


@pytest.mark.parametrize(
    "goal",
    [
        ToolAt((0.5, 0.3, 0.5)),
        LookAt((0.9, 0.2, 0.5), distance=(0.2, 0.4)),
        JointsAt({"base_to_shoulder": 0.5}, tolerance=0.1),
    ],
    ids=["tool_at", "look_at", "joints_at"],
)
def test_goal_states_are_drawn_inside_the_bounds(goal):
    """Without the bounds, at most 40 of 100 goal states keep an orientation within 5 degrees."""
    narrow = {"body": "camera", "axis": (0, 1, 0), "angle": (radians(85), radians(95))}
    arms = arm6(keep=narrow), arm6()
    shares = []
    for arm in arms:
        problem = hpop.Problem(FAR, arm, (0, 0.5, 0.5, 0, 0, 0), goal, ["duration"])
        states = problem.target.states(problem, np.random.default_rng(3), 100)
        assert goal.reached(arm, states).all()
        shares.append(np.mean(np.abs(angles(arms[0], states) - pi / 2) <= radians(5)))
    assert shares[0] >= 0.9
    assert shares[1] <= 0.4


def test_scaled_velocities_are_never_exceeded_and_reached():
    full, slow = arm6(), arm6(velocity_scaling=0.25)
    problem = hpop.Problem(FAR, slow, (0, 0.5, 0.5, 0, 0, 0), (2.0, 0.6, 0.5, 0, 0, 0), ["duration"])
    front = problem.solve("roadmap", samples=20)
    trajectory = front.best("duration").trajectory
    rates = trajectory.rates(np.linspace(0, trajectory.duration, 1000))[0]
    share = np.max([np.abs(getattr(rates, n)) / v for n, v in zip(slow.joints, full.chain.speed, strict=True)])
    assert share == pytest.approx(0.25)
    assert hpop.Problem.from_description(front.problem).model == slow != full
    with pytest.raises(ModelError, match=r"velocity_scaling must be a share of the speeds from 0\.001 to 1, got 1\.5"):
        arm6(velocity_scaling=1.5)
