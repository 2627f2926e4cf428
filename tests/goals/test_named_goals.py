"""Goals by name: in Python, in descriptions and scenarios, mixed with states; what is none is refused with the form."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import HpopError, HpopWarning, QueryError, ScenarioError, UnknownName
from hpop.goals import AnyOf, CameraAt, GoalSet, LookAt, Region, ToolAt, goal
from hpop.problems.problem import Problem
from hpop.scenario import load_scenario

WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 6, 4))
HEAD = hpop.PanTilt()
CAN, OTHER = LookAt((4.0, 3.0, 1.5), (0.5, 1.5)), LookAt((1.0, 3.5, 1.0), (0.5, 1.5), roll=0.0)
STATE = (5.0, 1.0, None, 0.0, 0.0)
FAR = LookAt((40.0, 3.0, 1.5), (0.5, 1.5))


def problem(goal: Any) -> Problem:
    return Problem(WORLD, HEAD, (1, 1, 0, 0, 0), goal, ["turns", "length"])


@pytest.mark.parametrize(
    "goal",
    [
        CAN,
        OTHER,
        CameraAt((4, 3, 1.2), yaw_pitch_roll=(1, 0.2, 0)),
        CameraAt((4, 3, 1.2), direction=(1, 0, 0), angle_tolerance=0.1),
        ToolAt((4, 3, 0), position_tolerance=0.02, body="base"),
        AnyOf((CAN, OTHER)),
        AnyOf((GoalSet((STATE, (1.0, 3.0, 0.0, 0.0, 0.0))), CAN)),
    ],
)
def test_a_goal_is_the_same_after_it_was_described_in_json(goal: Any) -> None:
    asked = problem(goal)
    again = Problem.from_description(json.loads(json.dumps(asked.describe())))
    assert again.goal == asked.goal == goal


def test_goals_by_name_and_states_may_be_listed_together() -> None:
    listed = [{"look_at": {"target": [4, 3, 1.5], "distance": [0.5, 1.5]}}, STATE, OTHER]
    assert problem(listed).goal == AnyOf((GoalSet((STATE,)), CAN, OTHER))
    assert problem(listed[:1]).goal == CAN
    assert "to look_at (4, 3, 1.5) from 0.5 to 1.5 m in <World" in repr(problem(listed[0]))


def test_any_of_several_goals_has_states_of_each_and_is_reached_by_whoever_reaches_one() -> None:
    asked = problem([CAN, OTHER, STATE])
    states = asked.target.states(asked, np.random.default_rng(0), 30)
    reached = np.stack([member.reached(HEAD, states) for member in (GoalSet((STATE,)), CAN, OTHER)])
    assert (reached.sum(axis=1) >= [10, 10, 10]).all()
    assert reached.any(axis=0).all()
    assert asked.target.reached(HEAD, states).all()
    assert not asked.target.reached(HEAD, HEAD.space.state(asked.start)).any()


def test_one_of_several_that_is_out_of_reach_is_left_out_with_a_warning_and_all_are_refused() -> None:
    asked = problem([CAN, FAR])
    with pytest.warns(HpopWarning, match=r"left out: the goal look_at \(40, 3, 1.5\) .* cannot be reached"):
        states = asked.target.states(asked, np.random.default_rng(0), 10)
    assert CAN.reached(HEAD, states).all()
    with pytest.raises(QueryError, match=r"look_at \(40, .*\n.*look_at \(40, "):
        problem([FAR, FAR]).target.states(asked, np.random.default_rng(0), 10)


@pytest.mark.usefixtures("registered_as_before")
def test_a_goal_of_ones_own_is_a_short_class_with_a_name() -> None:
    @goal("own_height")
    class Height(ToolAt):
        """A tool at a height."""

        lengths = np.array([True])

        def coordinates(self, pose: Any) -> Any:
            return (pose.z - self.position[2],)

        def rates(self, pose: Any, twist: Any) -> Any:
            return (twist.velocity[2],)

    asked = problem({"own_height": {"position": (0, 0, HEAD.base.camera_height), "body": "camera"}})
    assert asked.target.states(asked, np.random.default_rng(0), 7).size == 7
    assert isinstance(asked.target, Region)


@pytest.mark.parametrize(
    ("given", "kind", "said"),
    [
        ({"lok_at": {}}, UnknownName, r"unknown goal 'lok_at'\. Did you mean 'look_at'\? Known: anywhere, camera_at, "),
        ({"look_at": {"target": (1, 2, 3)}}, QueryError, "goal 'look_at' also needs distance; its parameters"),
        ({"look_at": [1, 2, 3]}, QueryError, "the parameters of goal 'look_at' must be given by name"),
        ({"look_at": {"goal": (1, 2, 3)}}, QueryError, "has no parameter 'goal'. It has target, distance, roll"),
        ([CAN, 3.0], QueryError, "the goal must be given as .*x m, y m"),
        ([CAN, (1, 2)], QueryError, "the goal 1 must be given as .x m, y m, yaw rad, pan rad, tilt rad., got .1, 2."),
        ({"tool_at": {"position": (4, 3, 0)}}, QueryError, r"the goal tool_at \(4, 3, 0\) needs a model with tool"),
    ],
)  # fmt: skip
def test_what_names_no_goal_is_refused(given: Any, kind: type[HpopError], said: str) -> None:
    with pytest.raises(kind, match=said):
        problem(given)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: LookAt((1, 2), (0.1, 1)), r"target must be \(x, y, z\) in m, got \(1, 2\)"),
        (lambda: LookAt("abc", (0.1, 1)), r"target must be \(x, y, z\) in m, got 'abc'"),
        (lambda: LookAt((1, 2, math.nan), (0.1, 1)), r"target must be \(x, y, z\) in m, each from .*, got nan"),
        (lambda: LookAt((1, 2, 3), 0.5), r"distance must be \(least, greatest\) distance in m, got 0.5"),
        (lambda: LookAt((1, 2, 3), (0.5, 0.1)), r"distance must be .*, the least first, got \(0.5, 0.1\)"),
        (lambda: LookAt((1, 2, 3), (0.0, 0.1)), "distance must be .* from 1e-06 to 1,000,000, got 0"),
        (lambda: LookAt((1, 2, 3), (0.1, 1), roll=90), r"roll must be in radians, .* write math.radians\(90\)"),
        (lambda: LookAt((1, 2, 3), (0.1, 1), angle_tolerance=5), "angle_tolerance must be an angle in rad from"),
        (lambda: LookAt((1, 2, 3), (0.1, 1), angle_tolerance=0), "angle_tolerance must be an angle in rad from 1e-06"),
        (lambda: CameraAt((1, 2, True)), "position must be"),
        (lambda: CameraAt((1, 2, 3), (0, 0, 0), (1, 0, 0)), "camera_at takes yaw_pitch_roll, direction or neither"),
        (lambda: CameraAt((1, 2, 3), yaw_pitch_roll=(0, 0)), r"yaw_pitch_roll must be \(yaw, pitch, roll\) in rad"),
        (lambda: CameraAt((1, 2, 3), yaw_pitch_roll=(90, 0, 0)), "yaw_pitch_roll must be in radians"),
        (lambda: CameraAt((1, 2, 3), direction=(0, 0, 0)), "direction must be .*, a vector of any length but 0, got"),
        (lambda: CameraAt((1, 2, 3), position_tolerance=-1), "position_tolerance must be a length in m"),
        (lambda: ToolAt((1, 2, 3), body=""), "body must be the name of a body of the model, such as 'tool', got ''"),
        (lambda: goal("mine")(int), "goal 'mine' must be a dataclass with the methods of hpop.goals.Goal"),
    ],
)  # fmt: skip
def test_a_goal_that_makes_no_sense_is_refused_with_its_form(make: Any, said: str) -> None:
    with pytest.raises(QueryError, match=said):
        make()


# Scenarios

ROOM = """\
world:
  polygons:
    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]
model: pan_tilt
start: [1, 1, 0, 0, 0]
goal:
  look_at: {target: [4, 3, 1.5], distance: [0.5, 1.5], roll: 90 deg}
criteria: [turns, length]
planner: roadmap
"""


def loaded(folder: Path, old: str = "", new: str = "") -> Problem:
    assert old in ROOM
    (folder / "room.yaml").write_text(ROOM.replace(old, new) if old else ROOM)
    return load_scenario(folder / "room.yaml").problem


def test_a_scenario_names_a_goal_with_angles_in_degrees(tmp_path: Path) -> None:
    assert loaded(tmp_path).goal == LookAt((4, 3, 1.5), (0.5, 1.5), roll=math.pi / 2)


def test_a_scenario_lists_goals_of_which_any_will_do(tmp_path: Path) -> None:
    several = (
        "  - camera_at: {position: [4, 3, 1.2], yaw_pitch_roll: [90 deg, 0, 0]}\n  - [5, 1, any, 0, 0]\n  - look_at:"
    )
    assert loaded(tmp_path, "  look_at:", several).goal == AnyOf(
        (
            GoalSet((STATE,)),
            CameraAt((4, 3, 1.2), yaw_pitch_roll=(math.pi / 2, 0, 0)),
            LookAt((4, 3, 1.5), (0.5, 1.5), roll=math.pi / 2),
        )
    )


@pytest.mark.parametrize(
    ("old", "new", "kind", "said"),
    [
        ("look_at", "lok_at", UnknownName, "line 7, goal.lok_at: unknown goal 'lok_at'. Did you mean 'look_at'?"),
        ("distance", "distanse", ScenarioError, "line 7, goal.look_at.distanse: no such key; did you mean 'distance'?"),
        ("[0.5, 1.5]", "[1.5, 0.5]", QueryError, "line 7, goal.look_at: distance must be (least, greatest) distance"),
        ("[0.5, 1.5]", "near", ScenarioError, "goal.look_at.distance: expected a list of 2 numbers, got 'near'"),
        ("90 deg", "90 degrees", ScenarioError, "line 7, goal.look_at.roll: expected a number"),
        ("{target: [4, 3, 1.5], distance: [0.5, 1.5], roll: 90 deg}", "[4, 3, 1.5]", ScenarioError,
         "line 7, goal.look_at: expected the parameters of this goal by name, got [4, 3, 1.5]"),
        ("{target: [4, 3, 1.5], distance: [0.5, 1.5], roll: 90 deg}", "", ScenarioError, "this key is missing; add it"),
        ("\n  look_at: {target: [4, 3, 1.5], distance: [0.5, 1.5], roll: 90 deg}", " look_at", ScenarioError,
         "this key is missing; add it"),
        ("look_at: {target: [4, 3, 1.5], distance: [0.5, 1.5], roll: 90 deg}", "tool_at: {position: [1, 2, 3]}",
         QueryError, "line 7, goal.tool_at: this goal requires tool, which the model does not have"),
    ],
)  # fmt: skip
def test_a_fault_in_a_goal_is_said_with_its_line(
    tmp_path: Path, old: str, new: str, kind: type[HpopError], said: str
) -> None:
    with pytest.raises(kind) as error:
        loaded(tmp_path, old, new)
    assert said in str(error.value)
