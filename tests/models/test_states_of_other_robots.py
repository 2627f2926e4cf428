"""Start and goal of a robot with states beside x, y and yaw: checked, written, verified and drawn by its space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.base import registry
from hpop.errors import ModelError, QueryError, ScenarioError
from hpop.motions import States, StateSpace
from hpop.planners.base import Candidates
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.scenario import load_scenario
from hpop.view.marks import end_poses

WORLD = hpop.World.from_polygons([], extent=shapely.box(0, 0, 6, 4))


@dataclass(frozen=True)
class Headed(hpop.DifferentialDrive):
    """A base with a head that pans between end stops; nothing moves it here."""

    @property
    def name(self) -> str:
        return "headed"

    @cached_property
    def space(self) -> StateSpace:
        plane = super().space
        return StateSpace(
            (*plane.names, "pan"),
            (*plane.units, "rad"),
            (*plane.low, -2.0),
            (*plane.high, 2.0),
            (*plane.weights, 0.2),
            plane.turning,
        )


ROBOT = Headed(radius=0.2)


def problem(start: object = (1, 1, 0, 0.5), goal: object = (5, 1, None, 0.5)) -> Problem:
    return Problem(WORLD, ROBOT, start, goal, ["length", "turns"])  # type: ignore[arg-type]


def straight(pan: float) -> hpop.Trajectory:
    """Return a move from start to goal, the head panned."""
    columns = {"x": [1.0, 5.0], "y": [1.0, 1.0], "yaw": [0.0, 0.0], "pan": [pan, pan]}
    return hpop.Trajectory(ROBOT, States(**{name: np.array(column) for name, column in columns.items()}), ("move",))


def front_of(asked: Problem, trajectory: hpop.Trajectory) -> hpop.Front:
    costs = np.array([list(asked.evaluate(trajectory).values())])
    return asked.front(
        Candidates(asked.criteria, (trajectory,), costs, 0 * costs, hpop.Status.COMPLETE, "as given", ({},))
    )


@pytest.mark.parametrize(
    ("start", "goal", "said"),
    [
        ((1, 1, 0), (5, 1, 0, 0), "the start must be given as (x m, y m, yaw rad, pan rad), got (1, 1, 0)"),
        ((1, 1, 0, 2.5), (5, 1, 0, 0), "the pan of the start must be an angle in rad from -2 to 2, got 2.5"),
        ((1, 1, 0, 0), (5, 1, 0, -90), "the pan of the goal must be in radians, within two turns of 0, got -90"),
        ((1, 1, 0, None), (5, 1, 0, 0), "the start needs a pan in rad; only the goal's may be free (None)"),
        ((1, 1, 0, 0), {"x": 5, "y": 1, "yaw": 0, "tilt": 0}, "it lacks pan and names 'tilt', which is no state"),
    ],
)
def test_a_state_is_checked_by_the_robots_own_columns(start: object, goal: object, said: str) -> None:
    with pytest.raises(QueryError) as error:
        problem(start, goal)
    assert said in str(error.value)


def test_what_ends_with_another_pan_is_told() -> None:
    asked = problem()
    assert verify(asked, front_of(asked, straight(0.5))) == []
    faults = verify(asked, front_of(asked, straight(0.6)))
    assert faults == ["trajectory 0 does not begin at the start", "trajectory 0 does not end with the goal's pan"]


def test_poses_in_the_plane_are_no_trajectory_of_it() -> None:
    with pytest.raises(ModelError, match=r"which are \(x m, y m, yaw rad, pan rad\); use Trajectory.through"):
        hpop.Trajectory.from_poses(ROBOT, [(1, 1, 0), (5, 1, 0)])


def test_a_trajectory_through_states_that_nothing_leads_to_is_refused() -> None:
    pans = np.array([0.5, 0.5, 0.9])
    states = States(x=np.array([1.0, 3.0, 5.0]), y=np.ones(3), yaw=np.zeros(3), pan=pans)
    assert hpop.Trajectory.through(ROBOT, states.take([0, 1])).kinds == ("move",)
    with pytest.raises(ModelError, match=r"cannot move from state 1 to state 2: pan would be off by -0\.4"):
        hpop.Trajectory.through(ROBOT, states)


def test_a_pan_that_is_free_may_be_any_but_a_stop_is_no_whole_turn() -> None:
    free = problem(goal=(5, 1, 0, None))
    assert free.target.reached(ROBOT, straight(0.5).states).tolist() == [False, True]
    beyond = States(x=np.array([5.0]), y=np.array([1.0]), yaw=np.array([2 * math.pi]), pan=np.array([2 * math.pi]))
    assert free.target.reached(ROBOT, beyond).all()
    assert not problem(goal=(5, 1, 0, 0)).target.reached(ROBOT, beyond).any()


def test_its_ends_are_drawn_where_the_base_is() -> None:
    start, goals = end_poses(problem())
    assert start == (1.0, 1.0, 0.0)
    assert goals == ((5.0, 1.0, None),)


def test_its_scenario_is_checked_by_the_same_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry.models, "_types", {**registry.models, "headed": Headed})
    text = """\
world: {polygons: {extent: [[0, 0], [6, 0], [6, 4], [0, 4]]}}
model: headed
start: [1.0, 1.0, 0, 30 deg]
goal: {x: 5.0, y: 1.0, yaw: any, pan: any}
criteria: [length]
"""
    (tmp_path / "room.yaml").write_text(text)
    asked = load_scenario(tmp_path / "room.yaml").problem
    assert asked.start == pytest.approx((1, 1, 0, math.pi / 6))
    assert asked.goal == (5.0, 1.0, None, None)
    assert Problem.from_description(asked.describe()).goal == asked.goal
    (tmp_path / "room.yaml").write_text(text.replace("30 deg", "130 deg"))
    with pytest.raises(QueryError, match=r"line 3, start\.3: a pan must be an angle in rad from -2 to 2, got 2\.268"):
        load_scenario(tmp_path / "room.yaml")
    (tmp_path / "room.yaml").write_text(text.replace(", 30 deg", ""))
    with pytest.raises(ScenarioError, match=r"line 3, start: expected \[x, y, yaw, pan\], numbers in m, m, rad"):
        load_scenario(tmp_path / "room.yaml")
