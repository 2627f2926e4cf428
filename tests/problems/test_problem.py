"""Problems: what is refused, what is described, and what the fronts of several planners hold."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.comfort.motion import Length
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.performance.surroundings import Exposure, Obstruction
from hpop.errors import CriterionError, HpopError, MapError, ModelError, OptionError, QueryError, UnknownName
from hpop.planners.base import Candidates
from hpop.problems import solving
from hpop.problems.problem import Problem
from hpop.runtime.limits import Progress, ProgressCallback, Status
from hpop.trajectories.trajectory import Trajectory

WORLD = hpop.World.from_polygons([(shapely.box(2, 0, 3, 2), (0.0, 1.0))], extent=shapely.box(0, 0, 5, 4))
ROBOT = hpop.DifferentialDrive(radius=0.2)


def problem(**changes: object) -> Problem:
    given = {"world": WORLD, "model": ROBOT, "start": (1, 1, 0), "goal": (4, 1, 0), "criteria": ["turns", "length"]}
    return Problem(**(given | changes))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Fixed:
    """A planner that proposes given trajectories at planned costs that are off by as much as it is told."""

    poses: tuple[tuple[tuple[float, float, float], ...], ...]
    off: float = 0.0
    tolerance: float = 0.0
    status: Status = Status.COMPLETE
    name: str = "fixed"

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        trajectories = tuple(Trajectory.from_poses(problem.model, list(poses)) for poses in self.poses)
        costs = trajectory_costs(problem.criteria, trajectories, problem.world)
        return Candidates(
            objectives=problem.criteria,
            trajectories=trajectories,
            planned=costs + self.off,
            tolerance=np.full(costs.shape, self.tolerance),
            status=self.status,
            certificate="as given",
            provenance=tuple({"i": i} for i in range(len(trajectories))),
            stats={"planner": "fixed"},
        )


@dataclass(frozen=True)
class Fails:
    error: BaseException
    name: str = "fails"

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        raise self.error


OVER = ((1.0, 1.0, 0.0), (1.0, 3.0, 0.0), (4.0, 3.0, 0.0), (4.0, 1.0, 0.0))
LONGER = ((1.0, 1.0, 0.0), (1.0, 3.5, 0.0), (4.0, 3.5, 0.0), (4.0, 1.0, 0.0))


# What is asked


@pytest.mark.parametrize(
    ("changes", "kind", "said"),
    [
        ({"criteria": []}, CriterionError, "criteria must be a list"),
        ({"criteria": "turns"}, CriterionError, "criteria must be a list"),
        ({"criteria": {"turns": {}}}, CriterionError, "criteria must be a list"),
        ({"criteria": ["turns", "length", "turns"]}, CriterionError, "turns more than once"),
        ({"criteria": ["turnz"]}, UnknownName, "Did you mean 'turns'?"),
        ({"criteria": [Length]}, CriterionError, "instance"),
        ({"criteria": [{"turns": {"most": 3}}]}, CriterionError, "'most'"),
        ({"criteria": [Obstruction(1.0), Exposure(2.0)]}, CriterionError, "give both equal parameters"),
        ({"start": (1, 1, None)}, QueryError, "only the goal's may be free"),
        ({"start": (1, 1)}, QueryError, "(x m, y m, yaw rad)"),
        (
            {"start": "abc"},
            QueryError,
            "the start is 'abc', but no state has this name. Give it as (x m, y m, yaw rad); this model",
        ),
        ({"goal": (1, np.nan, 0)}, QueryError, "y of the goal must be a position in m"),
        ({"goal": (np.inf, 1, None)}, QueryError, "x of the goal must be a position in m"),
        (
            {"start": (1, 1, 90)},
            QueryError,
            "in radians, within two turns of 0, got 90; for degrees write math.radians(90)",
        ),
        ({"goal": (4, 1, -180.0)}, QueryError, "yaw of the goal must be in radians"),
        ({"criteria": 3}, CriterionError, "criteria must be a list"),
        ({"criteria": [{"obstruction": {"radius": "x"}}]}, CriterionError, "radius must be a length in m"),
        ({"world": "x"}, MapError, "such as hpop.World.from_geojson(path), got 'x'"),
        ({"model": "x"}, ModelError, "such as hpop.DifferentialDrive(radius=0.3), got 'x'"),
        ({"model": hpop.DifferentialDrive}, ModelError, "got <class"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, object], kind: type[HpopError], said: str) -> None:
    with pytest.raises(kind) as error:
        problem(**changes)
    assert said in str(error.value)


def test_a_mean_and_its_own_integral_may_both_be_asked_for() -> None:
    asked = problem(criteria=[Obstruction(1.5), Exposure(1.5), "length"])
    front = asked.solve(step=0.5)
    assert front.names == ("exposure", "length")
    assert front.reported_names == ("obstruction",)


def test_what_a_criterion_requires_must_be_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Length, "requires", ("people",))
    with pytest.raises(CriterionError, match="requires people"):
        problem()


@pytest.mark.parametrize("wrong", [3, None, "path", [(1, 1, 0)]])
def test_only_trajectories_have_costs(wrong: object) -> None:
    for use in (problem().evaluate, problem().trace):
        with pytest.raises(QueryError, match=r"expected a trajectory, such as front\.knee\(\)\.trajectory"):
            use(wrong)  # type: ignore[arg-type]


def test_a_heading_within_two_turns_is_in_radians() -> None:
    assert problem(start=(1, 1, 4 * np.pi), goal=(4, 1, -4 * np.pi)).goal[2] == -4 * np.pi


def test_a_problem_is_told_in_one_line() -> None:
    told = repr(problem(goal=(4, 1, None), criteria=["turns", "length"]))
    assert told.startswith("<Problem: turns, length of DifferentialDrive from (1, 1, 0) to (4, 1, any) in <World: ")
    assert told.count("\n") == 0
    assert len(told) < 250


# Descriptions


def test_a_description_is_json_and_builds_the_same_problem() -> None:
    asked = problem(goal=(4, 1, None), criteria=[Obstruction(1.5), "length"])
    again = Problem.from_description(json.loads(json.dumps(asked.describe())))
    assert again.describe() == asked.describe()
    assert again.criteria == asked.criteria
    assert (again.start, again.goal, again.model) == (asked.start, asked.goal, asked.model)
    path = Trajectory.from_poses(ROBOT, list(OVER))
    assert again.evaluate(path) == asked.evaluate(path)


@pytest.mark.parametrize("part", ["world", "model", "start", "goal", "criteria"])
@pytest.mark.parametrize("wrong", [None, 5, "x", [], {}, {"x": 1}, [None], {"turns": None}])
def test_any_part_of_a_description_may_be_wrong(part: str, wrong: object) -> None:
    with pytest.raises(HpopError):
        Problem.from_description(problem().describe() | {part: wrong})


@pytest.mark.parametrize("nothing", [{}, None, [], "x", {"world": {}}])
def test_what_is_no_description_is_refused(nothing: object) -> None:
    with pytest.raises(QueryError, match="must be a mapping with world, model, start, goal, criteria, got"):
        Problem.from_description(nothing)  # type: ignore[arg-type]


def test_a_world_without_a_kind_is_a_map_error() -> None:
    with pytest.raises(MapError, match="kind"):
        Problem.from_description(problem().describe() | {"world": {"kind": "dream"}})


# Costs


def test_costs_of_a_path_worked_out_by_hand() -> None:
    """Up 2 m, across 3 m, down 2 m: four turns (left, right, right, left), 7 m."""
    assert problem().evaluate(Trajectory.from_poses(ROBOT, list(OVER))) == pytest.approx({"turns": 4.0, "length": 7.0})


def test_a_front_keeps_what_is_not_dominated_and_says_who_found_it() -> None:
    front = problem().solve(Fixed((LONGER, OVER)))
    assert front.costs.tolist() == [[4.0, 7.0]]
    assert front.provenance == ({"i": 1},)
    assert front.certificate == "as given"
    (run,) = front.runs
    assert run["planner"] == "fixed"
    assert run["notes"] == [
        "none of your criteria is about performance or the robot (energy, wear) or people nearby (hpop explain group)"
    ]


@pytest.mark.parametrize(("off", "tolerance", "valid"), [(0.0, 0.0, True), (0.01, 0.02, True), (0.01, 0.005, False)])
def test_planned_costs_beyond_their_tolerance_void_the_certificate(off: float, tolerance: float, valid: bool) -> None:
    front = problem().solve(Fixed((OVER,), off=off, tolerance=tolerance))
    assert front.certificate.startswith("NOT VALID") is not valid
    assert front.costs.tolist() == [[4.0, 7.0]]  # re-evaluated, whatever was planned


# Several planners


@pytest.mark.parametrize("none", [[], ()])
def test_no_planner_is_refused(none: list[str]) -> None:
    with pytest.raises(OptionError, match="at least one planner"):
        problem().solve(none)


@pytest.mark.parametrize(
    ("planner", "options", "kind"),
    [
        ("latice", {}, UnknownName),
        ("lattice", {"stp": 1}, OptionError),
        (hpop.Lattice, {}, OptionError),
        (5, {}, OptionError),
        (Fixed(()), {"step": 1}, OptionError),
        ({"latice": {}}, {}, UnknownName),
        ({"lattice": {"stp": 1}}, {}, OptionError),
        ({"lattice": 1}, {}, OptionError),
        ({"lattice": {"step": 1}}, {"step": 1}, OptionError),
        ({"lattice": {}, "roadmap": {}}, {}, OptionError),
        ({}, {}, OptionError),
        (["lattice", {"smoothing": {"stp": 1}}], {}, OptionError),
    ],
)
def test_a_wrong_planner_is_refused(planner: object, options: dict[str, object], kind: type[HpopError]) -> None:
    with pytest.raises(kind):
        problem().solve(planner, **options)  # type: ignore[arg-type]


def test_planners_are_given_as_in_a_scenario() -> None:
    made = problem().solve([{"lattice": {"step": 1.0, "headings": 4}}, {"lattice": None}])
    first, second = made.certificate.split(" | ")
    assert "of step 0.25 m, 8 headings" in first
    assert "of step 1 m, 4 headings" in second
    alone = problem().solve({"lattice": {"step": 0.5}})
    assert np.array_equal(alone.costs, problem().solve("lattice", step=0.5).costs)


def test_the_front_grows_from_planner_to_planner() -> None:
    fronts = list(problem().fronts([Fixed((LONGER,)), Fixed((OVER,))]))
    assert [front.costs.tolist() for front in fronts] == [[[4.0, 8.0]], [[4.0, 7.0]]]
    assert len(fronts[-1].runs) == 1  # both runs report the same


def test_after_an_interruption_no_other_planner_runs() -> None:
    never = Fails(AssertionError("ran"))
    front = problem().solve([Fixed((OVER,), status=Status.INTERRUPTED), never])
    assert (len(front), front.status) == (1, "interrupted")
    front = problem().solve([Fixed((OVER,)), Fails(KeyboardInterrupt()), never])
    assert (len(front), front.status) == (1, "complete | interrupted")
    with pytest.raises(KeyboardInterrupt):
        problem().solve([Fails(KeyboardInterrupt()), never])


def test_ctrl_c_after_the_search_does_not_lose_what_it_found(monkeypatch: pytest.MonkeyPatch) -> None:
    made, calls = solving.front, []

    def interrupted_once(asked: Problem, candidates: Candidates, progress: object = None) -> hpop.Front:
        calls.append(candidates)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return made(asked, candidates)

    monkeypatch.setattr(solving, "front", interrupted_once)
    front = problem().solve(Fixed((OVER,)))
    assert (len(front), front.status) == (1, "interrupted")


def test_progress_is_told_by_the_planner_and_before_the_evaluation() -> None:
    stages: list[str] = []

    def note(progress: Progress) -> None:
        stages.append(progress.stage)

    problem().solve(Fixed((OVER,)), progress=note)
    assert stages == ["evaluation"]


def test_no_candidates_are_an_empty_front() -> None:
    front = problem().solve(replace(Fixed(()), status=Status.NO_PATH))
    assert len(front) == 0
    assert front.status == Status.NO_PATH


def test_a_mean_itself_and_its_integral_are_refused_before_anything_is_planned() -> None:
    asked = problem(criteria=["obstruction", "duration"])
    never = Fails(AssertionError("ran"))
    with pytest.raises(OptionError, match="their fronts cannot be joined"):
        asked.solve([never, hpop.planners.Lattice(step=0.5, max_detour=1.2)])


@pytest.mark.parametrize("value", [True, "5", [5], -1, float("nan")])
@pytest.mark.parametrize("name", ["time_limit", "max_labels", "max_memory"])
def test_limits_that_are_no_positive_numbers_are_refused(name: str, value: object) -> None:
    with pytest.raises(OptionError, match=f"{name} must be a positive number"):
        problem().solve("lattice", step=0.5, **{name: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("headings", [5, "8", [8], True])
def test_headings_that_are_none_are_refused(headings: object) -> None:
    with pytest.raises(OptionError, match="headings must be one of"):
        problem().solve("lattice", step=0.5, headings=headings)  # type: ignore[arg-type]


def test_of_many_trajectories_the_evaluation_says_how_far_it_is():
    said = []
    front = problem().solve("lattice", step=0.5, progress=lambda p: said.append(p) if p.stage == "evaluation" else None)
    assert len(front) > 1
    details = [p.detail for p in said]
    assert all(any(name in detail for detail in details) for name in front.names)
    assert any(re.search(r"\d of \d+ motions", detail) for detail in details)
