"""Plans to goals in space: a head looks at something, a base does; saved, verified, drawn; or refused by name."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.cli.explain import print_goals
from hpop.cli.report import print_front
from hpop.errors import QueryError
from hpop.goals import LookAt
from hpop.planners.graph_planners import WeightedSum
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.view.marks import targets_of

WORLD = hpop.World.from_polygons([shapely.box(2, 0, 3, 2)], extent=shapely.box(0, 0, 6, 4))
LOOK = LookAt((5.0, 1.0, 1.5), (0.5, 1.5))


def problem(model: Any = None, goal: Any = LOOK) -> Problem:
    start = (1, 1, 0, 0, 0) if model is None else (1, 1, 0)
    return Problem(WORLD, model or hpop.PanTilt(), start, goal, ["turns", "length"])


@pytest.fixture(scope="module")
def front() -> Front:
    return problem().solve("roadmap", samples=60)


def test_every_trajectory_ends_where_the_camera_looks_at_the_target(front: Front) -> None:
    assert len(front) >= 2
    for trajectory in front.trajectories:
        pose = trajectory.model.pose("camera", trajectory.states.take([-1]))
        offset = np.array(LOOK.target) - [float(pose.x[0]), float(pose.y[0]), float(pose.z[0])]
        ahead = np.array([float(part[0]) for part in pose.ahead])
        assert 0.5 - 1e-6 <= np.linalg.norm(offset) <= 1.5 + 1e-6
        assert ahead @ offset / np.linalg.norm(offset) >= np.cos(1.01 * LOOK.angle_tolerance)


def test_the_certificate_says_how_many_states_of_the_goal_were_sought_found_and_free(front: Front) -> None:
    assert " free states of the goal (100 found, 100 sought), for (turns, length)" in front.certificate


def test_a_printed_front_names_what_it_is_a_front_to(front: Front, capsys: pytest.CaptureFixture[str]) -> None:
    print_front(problem(), front)
    assert "goal: look_at (5, 1, 1.5) from 0.5 to 1.5 m" in capsys.readouterr().out
    print_goals()
    listed = " ".join(capsys.readouterr().out.split())
    assert "look_at target=..., distance=..., roll=None, angle_tolerance=" in listed
    assert "Goal of a camera that looks at a target from within a band of distances." in listed


def test_the_goal_in_the_docs_is_planned_to() -> None:
    text = (Path(__file__).parents[2] / "docs/states.md").read_text()
    (block,) = (block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "LookAt(" in block)
    names: dict[str, Any] = {}
    exec(compile(block, "docs/states.md", "exec"), names)
    assert len(names["front"]) >= 1


def test_a_saved_front_is_verified_and_one_that_ends_elsewhere_is_not(front: Front, tmp_path: Path) -> None:
    front.save(tmp_path / "front.json")
    saved = Front.load(tmp_path / "front.json")
    again = Problem.from_description(saved.problem or {})
    assert again.goal == LOOK
    assert verify(again, saved) == []
    faults = verify(problem(goal=LookAt((5.0, 3.0, 1.5), (0.5, 1.5))), saved)
    assert "trajectory 0 does not end at the goal" in faults


def test_pictures_have_a_ring_round_what_is_looked_at() -> None:
    np.testing.assert_array_equal(targets_of(problem()), [LOOK.target])
    assert len(targets_of(problem(goal=[LOOK, LookAt((1, 3, 1), (0.5, 1)), (5, 3, None, 0, 0)]))) == 2


def test_a_base_that_looks_ahead_alone_looks_at_what_is_as_high_as_its_camera() -> None:
    asked = problem(hpop.DifferentialDrive(radius=0.2, camera_height=1.2), LookAt((5.0, 1.0, 1.2), (0.5, 1.0)))
    found = asked.solve("roadmap", samples=40)
    assert len(found) >= 1
    assert verify(asked, found) == []


def test_weighted_sums_take_the_goal_where_their_graph_does() -> None:
    found = problem().solve("weighted-sum", on={"roadmap": {"samples": 60}})
    assert len(found) >= 1
    assert verify(problem(), found) == []


@pytest.mark.parametrize("planner", ["lattice", "weighted-sum"])
def test_planners_of_plain_states_refuse_it_and_name_those_that_take_it(planner: str) -> None:
    with pytest.raises(
        QueryError, match=r"needs a goal that is a state, .*look_at .*planners that accept any goal: exact, roadmap"
    ):
        problem().solve(planner)
    assert not WeightedSum().any_goal


def test_a_goal_where_nothing_is_free_is_refused_with_what_is_in_the_way() -> None:
    with pytest.raises(QueryError, match=r"not usable: all of 100 states drawn from it .*: .*obstacle"):
        problem(goal={"camera_at": {"position": (2.5, 1.0, 1.2)}}).solve("roadmap", samples=10)
