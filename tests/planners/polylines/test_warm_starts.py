"""Warm starts of planners: another planner, with shared or own options; a front; trajectories."""

import dataclasses

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError
from hpop.planners import RRT, EpsilonConstraint, Lattice, Roadmap, Smoothing, WeightedSumCorridor
from hpop.planners.programs.warm_starts import warm_planner
from hpop.runtime.limits import Status

STARTING = [EpsilonConstraint, Smoothing, WeightedSumCorridor]
SHARED = {"step": 0.5, "headings": 16}
PILLAR = hpop.World.from_polygons([shapely.box(2, 1, 3, 2)], extent=shapely.box(0, 0, 5, 4))
PROBLEM = hpop.Problem(PILLAR, hpop.DifferentialDrive(radius=0.2), (1, 1.5, 0), (4, 1.5, 0), ["turns", "length"])


def starting(spec):
    return warm_planner(EpsilonConstraint(**SHARED, warm_start=spec), time_limit=7.0)


@pytest.fixture(scope="module")
def front():
    return PROBLEM.solve("lattice", step=0.5)


@pytest.mark.parametrize("planner", STARTING)
def test_planners_start_from_the_lattice_with_the_options_that_they_share(planner):
    assert warm_planner(planner(**SHARED), time_limit=7.0) == Lattice(**SHARED, time_limit=7.0)
    assert warm_planner(planner(warm_start={"lattice": {"step": 1.0}})) == Lattice(step=1.0)


def test_a_planner_that_is_named_shares_the_options_that_it_has():
    assert starting("lattice") == Lattice(**SHARED, time_limit=7.0)
    assert starting("roadmap") == Roadmap(time_limit=7.0)


def test_one_with_options_of_its_own_shares_the_time_limit_alone():
    assert starting({"lattice": {"step": 1.0}}) == Lattice(step=1.0, time_limit=7.0)
    assert starting({"rrt": None}) == RRT(time_limit=7.0)


def test_its_own_time_limit_counts():
    assert starting({"lattice": {"time_limit": 9.0}}) == Lattice(time_limit=9.0)


@pytest.mark.cases("WeightedSumCorridor")
@pytest.mark.parametrize("planner", STARTING)
def test_a_front_that_is_known_serves_as_well_as_the_planner_that_found_it(planner, front, tmp_path):
    front.save(tmp_path / "front.json")
    known = hpop.Front.load(tmp_path / "front.json")
    planned, given = (planner(step=0.5, warm_start=spec).solve(PROBLEM) for spec in ("lattice", known))
    assert planned.stats["warm_starts"] == len(front) > 1
    assert planned.trajectories
    np.testing.assert_array_equal(given.planned, planned.planned)
    assert (given.provenance, given.status) == (planned.provenance, Status.COMPLETE)


def test_trajectories_that_are_given_are_all_taken_and_their_ends_put_where_the_problem_has_them(front):
    longest = front.trajectories[int(np.argmax(front.costs[:, front.names.index("length")]))]
    later = PROBLEM.at((1.0, 1.2, 0.0), 0.0)
    candidates = Smoothing(warm_start=[longest, longest]).solve(later)
    assert candidates.stats["warm_starts"] == 2
    assert all(t.states.y[0] == 1.2 for t in candidates.trajectories)


def test_trajectories_of_another_model_are_refused(front):
    wide = dataclasses.replace(PROBLEM, model=hpop.DifferentialDrive(radius=0.3))
    with pytest.raises(OptionError, match="of another model"):
        Smoothing(warm_start=front).solve(wide)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (3, "warm_start must be the name of a planner, .*a front, or a list of trajectories, got 3"),
        (["lattice"], "warm_start must be the name of a planner"),
        ([], "at least one trajectory, got none"),
        ({}, "one planner with its options"),
        ({"lattice": {}, "rrt": {}}, "one planner with its options"),
        ({"lattice": 5}, r"options of 'lattice' as \{option: value\}, got 5"),
        ({"lattice": [1]}, r"as \{option: value\}"),
        ({"lattice": {"stp": 1.0}}, "no option 'stp'"),
    ],
)
@pytest.mark.parametrize("planner", STARTING)
def test_what_is_no_warm_start_says_what_to_do(planner, spec, message):
    with pytest.raises(OptionError, match=message):
        planner(warm_start=spec)


def test_where_half_of_the_time_gives_no_warm_start_the_rest_is_spent_on_them_too(monkeypatch):
    limits, stages, whole = [], Lattice.stages, Lattice(step=0.5).solve(PROBLEM)

    def late_at_first(planner, problem, progress=None):
        limits.append(planner.time_limit)
        late = dataclasses.replace(whole.subset(()), status=Status.TIME_LIMIT)
        return iter([late]) if len(limits) == 1 else stages(planner, problem, progress)

    monkeypatch.setattr(Lattice, "stages", late_at_first)
    found = Smoothing(step=1.0, time_limit=10_000.0).solve(PROBLEM)
    assert limits[0] <= 0.5 * 9_000.0 < limits[1] <= 9_000.0
    assert found.trajectories
