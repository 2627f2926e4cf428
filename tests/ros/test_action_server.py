"""The planner as ComputePathToPose, over a websocket to a bridge that was written from rosbridge's document."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import hpop
from hpop.errors import OptionError, QueryError
from hpop.planners.graph_planners import Lattice
from hpop.ros import GoalPlanner, Interface, PlanarPose, plain, planar_pose, pose_message, trajectory_of
from hpop.ros.protocol import ErrorCode
from tests.export.given import robots
from tests.ros.bridge import ABORTED, CANCELED, SUCCEEDED, fake_bridge
from tests.ros.conftest import running

ACTION, OPTIONS, POSE = "/hpop/compute_path_to_pose", "/hpop/options", "/amcl_pose"
START, GOAL = (1.0, 1.0, 0.0), (7.0, 5.0, 0.0)


def asked(start=START, goal=GOAL, planner_id="", **more):
    poses = {"start": pose_message(*start), "goal": pose_message(*goal)}
    return {**poses, "planner_id": planner_id, "use_start": True, **more}


def told(bridge, goal):
    """Return the published message about the front of a goal."""

    def found():
        return next(
            (one for one in (json.loads(each.data) for _, each in bridge.published) if one["goal"] == goal.id), 0
        )

    return bridge.until(found)


def ends(result):
    """Return the first and last pose of a path."""
    return [planar_pose(plain(result.path.poses[i])) for i in (0, -1)]


@pytest.mark.parametrize(
    ("planner_id", "name"),
    [("", "knee"), ("knee", "knee"), ("fewest turns", "turns"), ("least_length", "length"), ("turns", "turns")],
)
def test_a_goal_is_answered_with_the_path_that_is_chosen(served, room, planning, planner_id, name):
    """The path itself has the turns and the length of the trajectory that was asked for."""
    front = hpop.Problem(room.world, room.model, START, GOAL, room.criteria).solve(planning.planners)
    point = front.knee() if name == "knee" else front.best(name)
    goal = served.ended(served.send_goal(ACTION, asked(planner_id=planner_id)))
    assert (goal.status, goal.result.error_code, goal.result.error_msg) == (SUCCEEDED, 0, "")
    assert goal.feedback >= 1
    for pose, (x, y, yaw) in zip(ends(goal.result), (START, GOAL), strict=True):
        assert pose == pytest.approx((x, y, yaw, "map"))
    driven = trajectory_of(plain(goal.result.path), room.model)
    assert room.evaluate(driven) == pytest.approx(point.costs)
    stamps = {(one.header.stamp.sec, one.header.stamp.nanosec) for one in goal.result.path.poses}
    assert stamps == {(0, 0)}  # by which tf2 means the newest transform
    took = goal.result.planning_time.sec + 1e-9 * goal.result.planning_time.nanosec
    assert 0 < took < 100


def test_the_front_is_told_beside(served, room, planning):
    front = hpop.Problem(room.world, room.model, START, GOAL, room.criteria).solve(planning.planners)
    goal = served.send_goal(ACTION, asked(planner_id="fewest turns"))
    options = told(served, goal)
    assert {topic for topic, _ in served.published} == {OPTIONS}
    assert options["names"] == ["turns", "length"]
    assert options["units"] == ["1", "m"]
    np.testing.assert_allclose(options["costs"], front.costs)
    assert options["rows"] == list(range(len(front)))
    assert options["points"] == len(front) > 1
    assert options["named"] == {name: point.index for name, point in front.named().items()}
    assert options["chosen"] == options["named"]["least turns"]
    assert (options["status"], options["certificate"]) == (front.status, front.certificate)
    by_row = served.ended(served.send_goal(ACTION, asked(planner_id=str(options["named"]["least length"]))))
    by_name = served.ended(served.send_goal(ACTION, asked(planner_id="least length")))
    assert plain(by_row.result.path) == plain(by_name.result.path)


def test_without_use_start_it_begins_where_the_robot_is(served):
    unknown = served.ended(served.send_goal(ACTION, asked(use_start=False)))
    assert (unknown.status, unknown.result.error_code) == (ABORTED, ErrorCode.TF_ERROR)
    assert "no pose of the robot in map has come from /amcl_pose" in unknown.result.error_msg
    for place in ((2.0, 3.0, 0.0), (1.5, 1.0, math.pi / 2)):
        pose = pose_message(*place)
        served.tell(POSE, {"header": pose["header"], "pose": {"pose": pose["pose"], "covariance": [0.0] * 36}})
        goal = served.ended(served.send_goal(ACTION, asked(use_start=False)))
        assert goal.status == SUCCEEDED
        assert ends(goal.result)[0] == pytest.approx((*place, "map"))


@pytest.mark.parametrize(
    ("changes", "code", "why"),
    [
        (
            {"planner_id": "GridBased"},
            201,
            "planner_id must be one of knee, least turns, least length or a row number, got 'GridBased'",
        ),
        ({"planner_id": "9999"}, 201, "no row 9999"),
        ({"goal": pose_message(7, 5, 0, frame_id="odom")}, 202, "the goal must be in the frame map"),
        ({"goal": pose_message(7, 5, 0, frame_id="")}, 202, "the goal must be in the frame map"),
        ({"start": pose_message(-1, 5, 0)}, 203, "the start (-1, 5) is off the map"),
        ({"goal": pose_message(7, 9, 0)}, 204, "the goal (7, 9) is off the map"),
        ({"start": pose_message(4, 1, 0)}, 205, "the start is blocked: "),
        ({"goal": pose_message(3.7, 1, 0)}, 206, "the goal is blocked: "),
        ({"goal": pose_message(7, 1, 0)}, 208, "no path: obstacles separate start and goal"),
        ({"goal": {"pose": {}}}, 200, "position of the goal must be a message with fields, got None"),
        ({"start": [1, 2, 3]}, 200, "the start must be a message with fields"),
        ({"planner_id": 3}, 201, "planner_id must be a short text, got 3"),
    ],
)
def test_what_cannot_be_planned_says_why_by_its_code(served, changes, code, why):
    goal = served.ended(served.send_goal(ACTION, asked() | changes))
    assert (goal.status, goal.result.error_code) == (ABORTED, code), goal.result.error_msg
    assert why in goal.result.error_msg
    assert goal.result.path.poses == []
    assert served.log == []


def test_time_that_is_over_has_a_code_of_its_own(room, bridge, said):
    planning = GoalPlanner(room, [Lattice(step=0.5, time_limit=1e-9)], Interface())
    with running(planning, bridge.url, said):
        goal = bridge.ended(bridge.send_goal(ACTION, asked()))
    assert (goal.status, goal.result.error_code) == (ABORTED, ErrorCode.TIMEOUT)


def test_a_planner_that_fails_fails_one_goal(room, planning, bridge, said, caplog):
    class Broken(GoalPlanner):
        def answer(self, goal, robot, progress=None):
            if goal["planner_id"]:
                raise ZeroDivisionError("\x1b[2J")
            return planning.answer(goal, robot, progress)

    with running(Broken(room, planning.planners, Interface()), bridge.url, said):
        goal = bridge.ended(bridge.send_goal(ACTION, asked(planner_id="knee")))
        assert (goal.status, goal.result.error_code) == (ABORTED, ErrorCode.UNKNOWN)
        assert goal.result.error_msg == "planning failed (ZeroDivisionError: \\x1b[2J)"
        assert bridge.ended(bridge.send_goal(ACTION, asked())).status == SUCCEEDED
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.parametrize("distribution", ["humble", "iron"])
def test_a_result_has_the_fields_of_the_distribution(room, planning, said, distribution):
    known = Interface(distribution=distribution)
    with fake_bridge(distribution) as bridge, running(GoalPlanner(room, planning.planners, known), bridge.url, said):
        assert bridge.ended(bridge.send_goal(ACTION, asked())).status == SUCCEEDED
        assert bridge.ended(bridge.send_goal(ACTION, asked(planner_id="GridBased"))).status == ABORTED
        assert bridge.log == []
    with fake_bridge("humble") as bridge, running(planning, bridge.url, said):
        bridge.send_goal(ACTION, asked())  # of which a bridge says nothing to the client that sent the result
        assert "has no field ['error_code', 'error_msg']" in bridge.until(lambda: bridge.log)[0]


def test_names_are_those_that_were_asked_for(room, planning, said, bridge):
    known = Interface("/plan/way", "kilted", "hall", "/odom", "nav_msgs/msg/Odometry", "/ways", "fewest turns")
    with running(GoalPlanner(room, planning.planners, known), bridge.url, said):
        client = bridge.offered("/plan/way")
        assert list(client.topics) == ["/ways"]
        assert client.heard["/odom"]["queue_length"] == 1
        pose = pose_message(2, 3, 0, frame_id="hall")
        bridge.tell("/odom", {"header": pose["header"], "pose": {"pose": pose["pose"]}, "child_frame_id": "base"})
        poses = {"goal": pose_message(*GOAL, frame_id="hall"), "start": {}, "planner_id": "", "use_start": False}
        goal = bridge.ended(bridge.send_goal("/plan/way", poses))
        assert [pose.frame for pose in ends(goal.result)] == ["hall", "hall"]
        assert told(bridge, goal)["chosen"] == told(bridge, goal)["named"]["least turns"]


@pytest.mark.parametrize(
    "changes",
    [
        {"action": "compute path"}, {"action": ""}, {"action": "/a//b"}, {"pose_topic": "/pose/"}, {"choice": ""},
        {"distribution": "noetic"}, {"frame_id": "/map"}, {"frame_id": "m\x1b"},
        {"pose_type": "tf2_msgs/msg/TFMessage"},
    ],
)  # fmt: skip
def test_names_that_are_none_are_refused(changes):
    with pytest.raises(OptionError, match=next(iter(changes))):
        Interface(**changes)


def test_a_robot_without_a_base_is_refused(room):
    arm = robots()["serial arm"].model
    lifted = replace(room, model=arm, start=(0.1,) * 6, goal=(0.2,) * 6, criteria=["duration"])
    with pytest.raises(OptionError, match="a path needs a base with the states x, y and yaw"):
        GoalPlanner(lifted, [], Interface())


def test_what_a_pose_does_not_say_is_as_the_problem_has_it(room):
    """A pan-tilt head begins and ends with its own angles."""
    model = hpop.PanTilt(base=hpop.DifferentialDrive(radius=0.2))
    problem = hpop.Problem(room.world, model, (1, 1, 0, 0.5, 0), (7, 5, None, -0.5, 0.1), ["length"])
    planning = GoalPlanner(problem, [{"roadmap": {"samples": 60, "seed": 1}}], Interface())
    states = planning.solved(PlanarPose(*START, "map"), PlanarPose(*GOAL, "map")).knee().trajectory.states
    found = [(states.x[i], states.y[i], states.yaw[i], states.pan[i], states.tilt[i]) for i in (0, -1)]
    assert found == [pytest.approx((*START, 0.5, 0)), pytest.approx((*GOAL, -0.5, 0.1))]


# Accepted first, given up, replaced


def test_a_goal_is_accepted_before_it_is_planned_and_canceled_at_once(gate, bridge, said):
    with running(gate, bridge.url, said):
        goal = bridge.send_goal(ACTION, asked())
        bridge.until(lambda: goal.feedback)
        assert gate.entered.wait(60)
        bridge.cancel(goal)
        assert bridge.ended(goal).status == CANCELED
        assert gate.left.wait(60)  # by what its progress raised
        gate.open.set()
        assert bridge.ended(bridge.send_goal(ACTION, asked())).status == SUCCEEDED
        assert bridge.log == []


def test_a_newer_goal_takes_the_place_of_those_before(gate, bridge, said):
    with running(gate, bridge.url, said):
        goals = [bridge.send_goal(ACTION, asked())]
        assert gate.entered.wait(60)
        goals += [bridge.send_goal(ACTION, asked(planner_id="length")) for _ in range(3)]
        for goal in goals[:-1]:
            assert bridge.ended(goal).status == ABORTED
            assert goal.result.error_msg == "a newer goal took its place"
        gate.open.set()
        assert bridge.ended(goals[-1]).status == SUCCEEDED
        assert bridge.log == []


def test_a_goal_that_waits_can_be_canceled(gate, bridge, said):
    with running(gate, bridge.url, said):
        bridge.send_goal(ACTION, asked())
        assert gate.entered.wait(60)
        waits = bridge.send_goal(ACTION, asked())
        bridge.cancel(waits)
        assert bridge.ended(waits).status == CANCELED


# The problem at hand


def test_the_rehearsal_tells_mistakes_before_a_robot_waits(room):
    blocked = hpop.Problem(room.world, room.model, (4, 1, 0), GOAL, room.criteria)
    with pytest.raises(QueryError, match="start"):
        GoalPlanner(blocked, [Lattice(step=0.5)], Interface()).rehearsed()
