"""Targets that must be visible, by an oracle's own rays; joints within tolerances."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import hpop
from hpop.errors import QueryError
from hpop.goals import JointsAt, LookAt
from hpop.motions import States
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.world import Box, Solid, World, pose_at
from tests.models.serial_arm.arms import HERE, arm6, crane

CAN = (0.7, 0.25, 0.43)
BOARD = ((0.65, 0.0, 0.36), (0.3, 1.0, 0.02))
WORLD = World.from_solids([Solid(Box(BOARD[1]), pose_at(BOARD[0]), "board"), Solid(Box((0.05,) * 3), pose_at(CAN))])
START = (-0.27, 0.74, 1.73, 0.87, -0.05, -0.82)


def problem(goal, world=WORLD, start=START):
    return hpop.Problem(world, arm6(), start, goal, ["duration", "rotation"])


def hidden_by_the_board(states: States) -> np.ndarray:
    """Share (N,) of 300 points of the target's ball, seen from the camera, that lie behind the board (slabs)."""
    pose = arm6().pose("camera", states)
    around = np.random.default_rng(0).standard_normal((300, 3))
    points = np.array(CAN) + 0.05 * around / np.linalg.norm(around, axis=1)[:, None]
    low, high = np.array(BOARD[0]) - 0.5 * np.array(BOARD[1]), np.array(BOARD[0]) + 0.5 * np.array(BOARD[1])
    shares = []
    for camera in np.stack([pose.x, pose.y, pose.z], axis=1):
        facing = points[(points - CAN) @ (camera - CAN) > 0]
        near, far = (low - camera) / (facing - camera), (high - camera) / (facing - camera)
        entry, leave = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
        shares.append(((entry < leave) & (leave > 0) & (entry < 1)).mean())
    return np.array(shares)


def test_a_target_that_must_be_visible_is_not_looked_at_through_a_board():
    plain, seen = (LookAt(CAN, (0.15, 0.3), visible=visible) for visible in (False, True))
    some = hidden_by_the_board(plain.states(problem(plain), 1, 40))
    assert (some > 0.9).sum() >= 5  # the board is in the way
    drawn = seen.states(problem(seen), 1, 40)
    assert drawn.size == 40
    free = arm6().collision(WORLD).states_free(drawn)  # a camera within the board sees out of it
    assert free.sum() > 10
    assert hidden_by_the_board(drawn.take(np.flatnonzero(free))).max() < 0.65
    assert plain.describe() == {
        "look_at": {"target": list(CAN), "distance": [0.15, 0.3], "angle_tolerance": 0.017453292519943295}
    }


def test_fronts_end_where_the_target_is_seen_and_are_noted_where_this_is_not_required():
    plain, seen = (LookAt(CAN, (0.15, 0.3), visible=visible) for visible in (False, True))
    front = problem(plain).solve("roadmap", samples=100)
    assert any("require visible: true" in note for note in front.notes)
    hidden = [np.array([getattr(t.states, name)[-1:] for name in arm6().joints]) for t in front.trajectories]
    ends = [States(**dict(zip(arm6().joints, each, strict=True))) for each in hidden]
    (behind,) = [t for t, end in zip(front.trajectories, ends, strict=True) if hidden_by_the_board(end)[0] > 0.9][:1]
    required = problem(seen).solve("roadmap", samples=100)
    for trajectory in required.trajectories:
        assert hidden_by_the_board(trajectory.states.take([-1]))[0] < 0.65
    assert not verify(problem(seen), required)
    assert not any("hides the target" in note for note in required.notes)
    at_board = tuple(float(getattr(behind.states, name)[-1]) for name in arm6().joints)
    from_there = problem(seen, start=at_board).solve("roadmap", samples=100)  # looks at the target, through the board
    assert all(len(trajectory) for trajectory in from_there.trajectories)
    faults = verify(problem(seen), front)
    assert any("does not end at the goal" in fault for fault in faults)
    again = hpop.Problem.from_description(required.problem)
    assert again.target == seen


def test_a_target_that_nothing_sees_is_refused():
    walls = [Solid(Box((0.3, 0.3, 0.01)), pose_at((0.7, 0.25, 0.43 + z)), "lid") for z in (-0.06, 0.06)]
    walls += [Solid(Box((0.01, 0.3, 0.13)), pose_at((0.7 + x, 0.25, 0.43))) for x in (-0.06, 0.06)]
    walls += [Solid(Box((0.3, 0.01, 0.13)), pose_at((0.7, 0.25 + y, 0.43))) for y in (-0.06, 0.06)]
    goal = LookAt(CAN, (0.15, 0.3), visible=True)
    with pytest.raises(
        QueryError, match=r"hide its target in all of \d+ states; move the target, give other distances"
    ):
        goal.states(problem(goal, World.from_solids(walls)), 1, 10)


def test_joints_within_tolerances_are_reached_and_no_others(tmp_path):
    names = arm6().joints
    goal = JointsAt({names[0]: 0.5, names[3]: -0.2}, {names[0]: 0.1, names[3]: 0.0})
    drawn = goal.states(problem(goal), 3, 50)
    assert drawn.size == 50
    assert (getattr(drawn, names[0])[0], getattr(drawn, names[3])[0]) == (0.5, -0.2)
    assert np.abs(getattr(drawn, names[0]) - 0.5).max() <= 0.1 < np.ptp(getattr(drawn, names[0]))
    assert goal.reached(arm6(), drawn).all()
    moved = States(**drawn.__dict__ | {names[3]: drawn.__dict__[names[3]] + 0.001})
    assert not goal.reached(arm6(), moved).any()
    front = problem(goal).solve("roadmap", samples=60)
    assert len(front)
    assert not verify(problem(goal), front)
    assert hpop.Problem.from_description(front.problem).target == goal
    turning = crane(tmp_path)  # a whole turn is no difference
    swung = JointsAt({"swing": 3.1}, 0.1)
    states = States(**{name: np.zeros(2) for name in turning.joints} | {"swing": np.array([-3.1, -2.9])})
    assert swung.reached(turning, states).tolist() == [True, False]


@pytest.mark.parametrize(
    ("values", "tolerance", "said"),
    [
        ({}, 0.1, "values must map joints to values"),
        ({"elbow": 0.5}, 0.1, "values must name joints of the robot, got 'elbow'"),
        ({"base_to_shoulder": 9.0}, 0.1, "base_to_shoulder is limited to .*; give a value between these, or a larger"),
        ({"base_to_shoulder": 0.5}, -1.0, "tolerance must be rad or m"),
        ({"base_to_shoulder": 0.5}, {"elbow": 1.0}, "or name each joint of values"),
    ],
)
def test_joints_that_cannot_be_are_refused(values, tolerance, said):
    with pytest.raises(QueryError, match=said):
        problem(JointsAt(values, tolerance))


def test_a_scenario_names_the_line_of_a_joint_that_does_not_exist(tmp_path):
    scenario = yaml.safe_load((HERE.parent / "arm_shelf.yaml").read_text())
    scenario["model"]["serial_arm"] |= {"urdf": str(HERE / "arm6.urdf"), "srdf": str(HERE / "arm6.srdf")}
    scenario["goal"] = [{"joints_at": {"values": {"base_to_shoulder": 0.3}}}, {"joints_at": {"values": {"elbow": 0.3}}}]
    text = yaml.safe_dump(scenario)
    (tmp_path / "arm.yaml").write_text(text)
    line = next(i for i, each in enumerate(text.splitlines(), 1) if "elbow: 0.3" in each)
    with pytest.raises(QueryError, match=r"goal\.1\.joints_at: values must name joints .*, got 'elbow'") as refused:
        load_scenario(tmp_path / "arm.yaml")
    assert abs(int(str(refused.value).split(", line ")[1].split(",")[0]) - line) <= 2
