"""Goals: a state, whose angles may be free, or any of several; in Python, in a scenario, in a saved front."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import HpopError, QueryError, ScenarioError
from hpop.goals import GoalSet
from hpop.motions import Model, States
from hpop.planners.base import Candidates
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.trajectories.trajectory import Trajectory

WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 6, 4))
ROBOT = hpop.DifferentialDrive(radius=0.2)
SEVERAL = [(5.0, 1.0, None), (1.0, 3.0, 0.0), (5.0, 3.0, math.pi)]


def problem(goal: Any = SEVERAL, start: Any = (1, 1, 0)) -> Problem:
    return Problem(WORLD, ROBOT, start, goal, ["turns", "length"])


def path(asked: Problem, *poses: tuple[float, float, float]) -> Trajectory:
    return Trajectory.from_poses(asked.model, [(1.0, 1.0, 0.0), *poses])


def test_a_state_by_name_is_the_tuple_that_it_is_in_order() -> None:
    asked = problem(goal={"yaw": None, "y": 1, "x": 5}, start={"x": 1, "y": 1, "yaw": 0})
    assert (asked.start, asked.goal) == ((1.0, 1.0, 0.0), (5.0, 1.0, None))
    assert asked.describe()["goal"] == [5.0, 1.0, None]


@pytest.mark.parametrize("goal", [SEVERAL, GoalSet(tuple(SEVERAL)), [dict(zip("xy", p[:2], strict=True)) | {"yaw": p[2]}
                                                                    for p in SEVERAL]])  # fmt: skip
def test_several_states_are_a_set(goal: object) -> None:
    asked = problem(goal)
    assert asked.goal == GoalSet(tuple(SEVERAL))
    assert asked.goals == tuple(SEVERAL)
    assert problem(asked.describe()["goal"]).goal == asked.goal
    assert "to any of 3 in" in repr(asked)


def test_a_set_of_one_is_that_state() -> None:
    assert problem([(5, 1, 0), (5, 1, 0)]).goal == (5.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("goal", "said"),
    [
        ([], "a goal must be (x m, y m, yaw rad), or a list of such states, got []"),
        ([(5, 1, 0), (5, 1)], "the goal 1 must be given as (x m, y m, yaw rad), got (5, 1)"),
        ([(5, 1, 90), (5, 1, 0)], "the yaw of the goal 0 must be in radians, within two turns of 0, got 90"),
        (
            {"x": 5, "y": 1, "jaw": 0},
            "it lacks yaw and names 'jaw', which is no state of the model. Did you mean 'yaw'",
        ),
        (GoalSet(()), "a goal must be (x m, y m, yaw rad), or a list"),
        (5, "the goal must be given as (x m, y m, yaw rad), got 5"),
    ],
)
def test_what_is_no_goal_is_refused(goal: object, said: str) -> None:
    with pytest.raises(QueryError) as error:
        problem(goal)
    assert said in str(error.value)


def test_states_of_a_set_reach_it_and_those_beside_do_not() -> None:
    asked = problem()
    drawn = asked.target.states(asked, np.random.default_rng(0), 20)
    assert drawn.size == 20
    assert asked.target.reached(ROBOT, drawn).all()
    assert len(set(drawn.yaw.tolist())) == 20  # what is free is drawn, the two that are whole come once
    beside = States(**{**drawn.__dict__, "y": drawn.y + 1e-3})
    assert not asked.target.reached(ROBOT, beside).any()
    exact = problem(SEVERAL[1:])
    assert exact.target.states(exact, np.random.default_rng(0), 20).size == 2


def test_a_whole_turn_more_is_the_same_goal() -> None:
    turned = ROBOT.space.state((5, 3, -math.pi))
    assert problem().target.reached(ROBOT, turned).all()


# Fronts of sets


def test_a_front_to_a_set_verifies_whichever_is_reached_and_not_where_none_is() -> None:
    asked = problem()
    ends = [path(asked, pose) for pose in ((1.0, 3.0, 0.0), (5.0, 3.0, -math.pi))]
    ends += [path(asked, (1.0, 3.0, 1.0)), path(asked, (4.0, 3.5, 0.0))]
    faults = [verify(asked, front_of(asked, one)) for one in ends]
    assert [any("the goal" in fault for fault in found) for found in faults] == [False, False, True, True]
    assert "trajectory 0 does not end with the goal's heading" in faults[2]


def front_of(asked: Problem, trajectory: Trajectory) -> Front:
    costs = np.array([list(asked.evaluate(trajectory).values())])
    candidates = Candidates(asked.criteria, (trajectory,), costs, costs * 0, hpop.Status.COMPLETE, "as given", ({},))
    return asked.front(candidates)


def test_a_front_to_a_set_is_saved_and_loaded_with_its_problem(tmp_path: Path) -> None:
    front = problem().solve("lattice", step=1.0)
    front.save(tmp_path / "front.json")
    loaded = Front.load(tmp_path / "front.json")
    again = Problem.from_description(loaded.problem)
    assert again.goals == tuple(SEVERAL)
    assert verify(again, loaded) == []


class Corner:
    """A goal of one's own: anywhere in a corner of the room."""

    def states(self, problem: Problem, rng: np.random.Generator, count: int) -> States:
        return problem.model.space.bounded(x=(5.0, 5.5), y=(0.5, 1.0)).sample(rng, count)

    def reached(self, model: Model, states: States) -> Any:
        return (states.x >= 5.0) & (states.y <= 1.0)

    def describe(self) -> Any:
        return {"corner": [5.0, 1.0]}


def test_a_goal_of_ones_own_is_believed_by_who_checks_and_refused_by_who_cannot_serve_it() -> None:
    asked = problem(Corner())
    there, short = (path(asked, (1.0, 3.0, 0.0), (x, 3.0, 0.0), (x, 1.0, 0.0)) for x in (5.2, 4.0))
    assert verify(asked, front_of(asked, there)) == []
    assert verify(asked, front_of(asked, short)) == ["trajectory 0 does not end at the goal"]
    with pytest.raises(QueryError, match="needs a goal that is a state, or a list of states"):
        asked.solve("lattice")


# Scenarios

ROOM = """\
world:
  polygons:
    extent: [[0, 0], [6, 0], [6, 4], [0, 4]]
start: {x: 1.0, y: 1.0, yaw: 90 deg}
goal:
  - [5.0, 1.0, any]
  - {yaw: 180 deg, x: 5.0, y: 3.0}
criteria: [turns, length]
"""


def loaded(folder: Path, *changes: tuple[str, str]) -> Problem:
    text = ROOM
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "room.yaml").write_text(text)
    return load_scenario(folder / "room.yaml").problem


def test_a_scenario_names_states_by_column_and_lists_goals(tmp_path: Path) -> None:
    asked = loaded(tmp_path)
    assert asked.start == pytest.approx((1.0, 1.0, math.pi / 2))
    assert asked.goals == ((5.0, 1.0, None), (5.0, 3.0, math.pi))


@pytest.mark.parametrize(
    ("change", "kind", "said"),
    [
        (("yaw: 90 deg", "jaw: 90 deg"), ScenarioError, "line 4, start: expected [x, y, yaw], numbers in m, m and "
         "rad (or a yaw such as 90 deg), got {'x': 1.0, 'y': 1.0, 'jaw': '90 deg'}; it lacks yaw and names 'jaw'"),
        (("yaw: 90 deg", "yaw: any"), ScenarioError, "line 4, start.yaw: the yaw at the start must be in rad"),
        (("yaw: 90 deg", "yaw: 90"), QueryError, "line 4, start.yaw: a yaw must be in radians"),
        (("[5.0, 1.0, any]", "[5.0, 1.0, norh]"), ScenarioError, "line 6, goal.0.2: a yaw is a number in rad, or text "
         "such as '90 deg', or 'any'; got 'norh'"),
        (("[5.0, 1.0, any]", "[5.0, 1.0]"), ScenarioError, "line 6, goal.0: expected [x, y, yaw], numbers in m, m and "
         "rad (or a yaw such as 90 deg, or any), got [5.0, 1.0]"),
        (("x: 5.0, y: 3.0", "x: 5.0e+9, y: 3.0"), QueryError, "line 7, goal.1.x: x of the goal must be a position"),
    ],
)  # fmt: skip
def test_a_fault_in_a_state_is_said_with_its_line(
    tmp_path: Path, change: tuple[str, str], kind: type[HpopError], said: str
) -> None:
    with pytest.raises(kind) as error:
        loaded(tmp_path, change)
    assert said in str(error.value)


def test_angles_are_looked_at_where_the_model_is_wrong(tmp_path: Path) -> None:
    wrong = ("criteria:", "model: {differential_drive: {radius: no}}\ncriteria:")
    with pytest.raises(ScenarioError) as error:
        loaded(tmp_path, wrong, ("[5.0, 1.0, any]", "[5.0, 1.0, norh]"))
    lines = [line.split(": ")[0].split(", ", 1)[1] for line in str(error.value).splitlines()]
    assert lines == ["line 6, goal.0.2", "line 8, model.differential_drive.radius"]


def test_the_same_problem_asked_from_elsewhere_keeps_its_goals() -> None:
    asked = problem()
    assert replace(asked, start=(1, 2, 0)).goals == asked.goals
    assert asked.at({"x": 1, "y": 2, "yaw": 0}, 1.0).start == (1.0, 2.0, 0.0)


@pytest.mark.parametrize("goal", [np.array(3.0), np.zeros(2), [], "3", [[1, 2], [1, 2, 3]]], ids=str)
def test_what_is_no_goal_is_refused_whatever_array_it_is(goal: Any) -> None:
    with pytest.raises(QueryError, match="goal"):
        problem(goal=goal)
