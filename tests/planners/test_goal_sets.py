"""Sets of goals: what is found to any of several is what is best of what is found to each; who cannot says who can."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.frontier import is_nondominated
from hpop.planners import Lattice
from hpop.planners import searches as exact_search
from hpop.planners.graphs import lattice as lattice_planner
from hpop.planners.spending import Spending
from hpop.problems.problem import Problem
from hpop.problems.verify import verify

WORLD = hpop.World.from_polygons([shapely.box(2.0, 1.0, 3.0, 4.0)], extent=shapely.box(0, 0, 5, 4))
ROBOT = hpop.DifferentialDrive(radius=0.2, camera_height=0.6, camera_offset=(0.1, 0.0))
CRITERIA = ["length", "turns", "rotation"]
ON = [(4.0, 3.0, math.pi / 2), (1.0, 2.0, None), (4.0, 0.5, -math.pi / 2)]  # states of the lattice of step 0.5
OFF = [(3.87, 2.91, 0.3), (1.13, 2.2, None), (3.61, 0.57, -2.1)]


def problem(goal: Any, criteria: list[str] = CRITERIA) -> Problem:
    return Problem(WORLD, ROBOT, (1.0, 0.5, 0.0), goal, criteria)


def best_of_each(goals: list[Any], planner: str, **options: Any) -> list[list[float]]:
    costs = np.concatenate([problem(goal).solve(planner, **options).costs for goal in goals])
    return sorted(np.unique(costs[is_nondominated(costs)], axis=0).tolist())


@pytest.mark.parametrize("goals", [ON, OFF, [ON[0], OFF[2]], [(1.2, 0.6, None), OFF[0]], [ON[0], (*ON[0][:2], 0.0)]])
def test_the_front_of_a_set_is_the_best_of_the_fronts_of_its_members(goals: list[Any]) -> None:
    front = problem(goals).solve("lattice", step=0.5)
    assert sorted(front.costs.tolist()) == best_of_each(goals, "lattice", step=0.5)
    assert verify(problem(goals), front) == []


def test_members_that_are_blocked_are_left_out_unless_all_are() -> None:
    blocked, free = (2.5, 2.0, 0.0), OFF[0]
    for planner in ({"lattice": {"step": 0.5}}, {"roadmap": {"samples": 30}}):
        front = problem([blocked, free]).solve(planner)
        assert len(front)
        (note,) = [note for note in front.notes if "left out" in note]
        assert note.startswith("(2.5, 2, 0), one of several goals, is left out: ")
        assert verify(problem(free), front) == []
        with pytest.raises(QueryError) as error:
            problem([blocked, (2.6, 2.0, 0.0)]).solve(planner)
        assert "the goal 0 (2.500, 2.000) is not usable" in str(error.value)
        assert "the goal 1 (2.600, 2.000) is not usable" in str(error.value)


def test_the_certificate_says_to_how_many_positions_each_member_is_joined() -> None:
    front = problem(OFF).solve("lattice", step=0.5)
    assert all(f"the goal {i} joined to " in front.certificate for i in range(3))
    assert set(front.provenance[0]["joined"]) == {"goal 0", "goal 1", "goal 2"}


@pytest.mark.parametrize(
    "planner", [{"weighted-sum": {"step": 0.5}}, {"roadmap": {"samples": 40}}, {"any-angle": {"step": 1.0}}]
)
def test_planners_on_graphs_reach_any_of_a_set_and_none_beside(planner: dict[str, Any]) -> None:
    near, far = (1.5, 3.0, math.pi / 2), (4.0, 3.0, None)
    for goals in ([near, far], [far, near]):
        front = problem(goals).solve(planner)
        assert verify(problem(goals), front) == []
        shortest = front.trajectories[int(np.argmin(front.costs[:, 0]))]
        assert shortest.states.x[-1] == pytest.approx(near[0])


def test_two_members_at_one_place_are_one_position_of_a_roadmap() -> None:
    goals = [(4.0, 3.0, 0.0), (4.0, 3.0, math.pi)]
    either = problem(goals).solve("roadmap", samples=40)
    each = best_of_each(goals, "roadmap", samples=40)
    assert sorted(either.costs.tolist()) == each


def test_no_path_to_any_member_says_what_separates() -> None:
    walled = hpop.World.from_polygons([shapely.box(2, 0, 2.5, 4)], extent=shapely.box(0, 0, 5, 4))
    asked = Problem(walled, ROBOT, (1, 1, 0), [(4, 1, 0), (4, 3, None)], ["length"])
    front = asked.solve("roadmap", samples=40)
    assert front.status == "no path"
    assert "unconnected parts; the part with the start has" in " ".join(front.runs[0]["notes"])


@pytest.mark.parametrize("planner", ["epsilon-constraint", "smoothing", "weighted-sum-corridor", "rrt"])
def test_a_planner_that_takes_one_goal_says_who_takes_a_set(planner: str) -> None:
    with pytest.raises(QueryError) as error:
        problem(ON, ["length"]).solve(["lattice", planner])
    assert str(error.value).startswith(f"{planner} needs a single goal, got a list of 3; planners that accept a list: ")
    assert "any-angle, exact, lattice, roadmap, weighted-sum" in str(error.value)


def test_stages_on_a_part_of_the_lattice_end_at_a_member_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lattice_planner, "MOST_FIRST", 20)
    monkeypatch.setattr(Spending, "share", lambda spending, seconds: spending.left())  # no stage ends by the clock
    monkeypatch.setattr(exact_search, "_quick_exact_answer", lambda *asked: None)
    asked = problem(OFF)
    *before, last = Lattice(step=0.25).stages(asked)
    assert before
    for candidates in before:
        assert verify(asked, asked.front(candidates)) == []
    assert np.array_equal(asked.front(last).costs, asked.front(Lattice(step=0.25).solve(asked)).costs)
