"""A planner that needs what a model does not have is refused by name before anything runs."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
import shapely

import hpop
from hpop.base.registry import planners
from hpop.errors import ModelError, UnsupportedModel
from hpop.planners.base import UNDECLARED, make_planner

HALL = hpop.World.from_polygons([], extent=shapely.box(0, 0, 4, 4))


@dataclass(frozen=True)
class Cart(hpop.DifferentialDrive):
    """A robot that says of itself no more than is given."""

    has: tuple[str, ...] = ("base", "camera", "plane", "turn-move", "rigid")

    @property
    def provides(self) -> frozenset[str]:
        return frozenset(self.has)


def problem(model: hpop.DifferentialDrive) -> hpop.Problem:
    return hpop.Problem(HALL, model, (1, 1, 0), (3, 3, None), ["length"])


@dataclass(frozen=True)
class Undeclared:
    """A planner that says nothing of its needs."""

    name = "undeclared"

    def solve(self, problem: hpop.Problem, progress: object = None) -> object:
        return hpop.planners.Lattice(step=1.0).solve(problem)


@dataclass(frozen=True)
class Undemanding(Undeclared):
    """One that serves any model."""

    name = "undemanding"
    needs = frozenset[str]()


def test_the_message_says_what_the_model_lacks_and_which_planners_can() -> None:
    with pytest.raises(UnsupportedModel, match=r"smoothing needs a model with wheels, which .* does not provide") as no:
        problem(Cart()).solve("smoothing")
    said = str(no.value)
    able = said[said.index("Planners that can use this model:") :]
    assert all(name in able for name in ("lattice", "roadmap", "any-angle", "epsilon-constraint"))
    assert "smoothing" not in able
    assert "rrt" not in able
    assert no.value.exit_code == ModelError.exit_code


def test_the_roadmap_can_plan_for_any_model() -> None:
    with pytest.raises(UnsupportedModel, match="needs a model with plane, turn-move, which") as no:
        problem(Cart(has=("base",))).solve("lattice")
    assert str(no.value).endswith("Planners that can use this model: exact, roadmap.")


def test_weighted_sums_for_a_model_of_no_lattice_name_the_roadmap_that_they_can_search() -> None:
    base = problem(Cart(has=("base",)))
    with pytest.raises(UnsupportedModel, match=r"on another graph: \{weighted-sum: \{on: roadmap\}\}\. Planners that"):
        base.solve("weighted-sum")
    assert make_planner({"weighted-sum": {"on": "roadmap"}}).needs <= base.model.provides


def test_a_planner_late_in_the_list_is_refused_before_the_first_runs() -> None:
    reports: list[object] = []
    with pytest.raises(UnsupportedModel):
        problem(Cart()).solve(["lattice", "rrt"], progress=reports.append)
    assert reports == []


def test_a_planner_that_says_nothing_is_taken_to_need_what_every_robot_had() -> None:
    assert make_planner(Undeclared()).needs == UNDECLARED <= hpop.DifferentialDrive().provides
    assert len(problem(hpop.DifferentialDrive()).solve(Undeclared())) == 1
    with pytest.raises(UnsupportedModel, match=r"set needs = frozenset\(\) in its class"):
        problem(Cart()).solve(Undeclared())
    assert len(problem(Cart()).solve(Undemanding())) == 1


@pytest.mark.parametrize(
    "planner", [{"lattice": {"step": 1.0}}, {"roadmap": {"samples": 5}}, {"any-angle": {"step": 1.0}}]
)
def test_what_has_no_wheels_but_turns_and_moves_is_planned_for(planner: dict[str, dict[str, float]]) -> None:
    assert len(problem(Cart()).solve(planner)) == 1


def test_every_planner_of_the_house_says_what_it_needs() -> None:
    known = hpop.DifferentialDrive().provides | {"camera", "tool", "joints", "spline"}  # a robot on wheels, an arm
    for cls in planners.values():
        if cls.__module__.startswith("hpop."):
            assert cls.needs is not UNDECLARED
            assert cls.needs <= known


@pytest.mark.parametrize("planner", ["any-angle", "epsilon-constraint", "rrt", "smoothing", "weighted-sum-corridor"])
def test_no_planner_loses_a_state_that_it_does_not_know(planner: str) -> None:
    headed = Cart(has=("base", "camera", "plane", "turn-move", "heading", "wheels"))
    with pytest.raises(UnsupportedModel, match="needs a model with rigid, which"):
        problem(headed).solve(planner)
