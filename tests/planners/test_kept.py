"""A limit that ends planning early returns the results so far: a part's paths, or the warm starts."""

import time

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners import AnyAngle, EpsilonConstraint, Roadmap, Smoothing, WeightedSum, WeightedSumCorridor, spending
from hpop.problems.verify import verify
from hpop.runtime.limits import Status, Watch
from tests.watched import watched

WORLD = hpop.World.from_polygons([shapely.box(3, 0, 3.5, 3)], extent=shapely.box(0, 0, 8, 6))
ROUND = hpop.DifferentialDrive(radius=0.3)


def asked(*names):
    return hpop.Problem(WORLD, ROUND, (1.0, 1.0, 0.0), (7.0, 1.0, 0.0), names)


@pytest.fixture
def costed():
    with watched() as asked_for:
        yield asked_for


@pytest.fixture
def until(monkeypatch, costed):
    """Let time be up once so many edges have been costed."""
    real = time.perf_counter

    def set_most(edges):
        def clock():
            return real() + 1e6 * (sum(number for _, number in costed) > edges)

        monkeypatch.setattr(spending, "perf_counter", clock)
        monkeypatch.setattr(time, "perf_counter", clock)

    return set_most


@pytest.mark.cases(2)  # a roadmap has a test of its own below
@pytest.mark.parametrize(
    ("planner", "edges", "what"),
    [
        (WeightedSum(step=0.25, time_limit=1000.0), 3_000, "supported points of"),
        (AnyAngle(step=0.25, time_limit=1000.0), 3_000, "with the points of earlier stages"),
        (Roadmap(samples=100, time_limit=1000.0), 40, "the shortest path of the roadmap of 100 samples"),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_a_graph_that_is_not_costed_in_time_leaves_the_paths_of_a_part_of_it(
    planner, edges, what, until, costed, monkeypatch
):
    monkeypatch.setattr("hpop.planners.graphs.lattice.MOST_FIRST", 40)
    monkeypatch.setattr("hpop.planners.graphs.arcs.BLOCK", 1000)
    until(edges)
    front = asked("watched", "turns").solve(planner)
    whole = 768 * 8 * 8 if planner.name != "roadmap" else 100 * 26
    assert edges < sum(number for _, number in costed) < whole / 2  # the whole graph was not costed
    assert front.status == "time limit"
    assert len(front) > 0
    assert what in front.certificate
    assert "incomplete (time limit)" in front.certificate
    assert verify(asked("watched", "turns"), front) == []


def test_a_roadmap_that_is_not_costed_in_time_leaves_the_paths_of_one_of_fewer_samples(until, monkeypatch):
    monkeypatch.setattr("hpop.planners.graphs.roadmap.SMALLEST", 50)
    monkeypatch.setattr("hpop.planners.graphs.arcs.BLOCK", 1000)
    until(15_000)  # a roadmap of 50 samples has some 10,000 edges, one of 200 some 40,000
    front = asked("watched", "turns").solve(Roadmap(samples=200, neighbours=6, time_limit=1000.0))
    assert front.status == Status.TIME_LIMIT
    assert len(front) > 0
    assert "with the points of earlier stages (roadmap of 50 samples)" in front.certificate
    assert verify(asked("watched", "turns"), front) == []


@pytest.mark.parametrize("planner", [EpsilonConstraint, Smoothing, WeightedSumCorridor])
def test_programs_that_are_not_solved_in_time_leave_the_paths_they_would_have_started_from(planner, monkeypatch):
    problem = asked("length", "turns")
    lattice = problem.solve("lattice", step=0.5)
    monkeypatch.setattr(Watch, "is_late", lambda watch: True)
    front = problem.solve(planner(step=0.5, time_limit=1000.0))
    assert front.status == "time limit"
    np.testing.assert_array_equal(front.costs, lattice.costs)
    assert "its warm starts" in front.certificate
    assert any("had found no path by then; its warm starts are returned" in note for note in front.notes)


def test_warm_starts_that_break_a_bound_are_not_returned(monkeypatch):
    problem = asked("length", "turns")
    lengths = problem.solve("lattice", step=0.5).costs[:, 0]
    monkeypatch.setattr(Watch, "is_late", lambda watch: True)
    bound = {"length": float(lengths.min() + lengths.max()) / 2}
    front = problem.solve(EpsilonConstraint(step=0.5, time_limit=1000.0, epsilon=bound))
    assert 0 < len(front) < len(lengths)
    assert (front.costs[:, 0] <= bound["length"]).all()


def test_warm_starts_that_were_given_are_not_handed_back(monkeypatch):
    problem = asked("length", "turns")
    given = problem.solve("lattice", step=0.5)
    monkeypatch.setattr(Watch, "is_late", lambda watch: True)
    found = Smoothing(warm_start=given, time_limit=1000.0).solve(problem)
    assert (found.status, found.trajectories) == (Status.TIME_LIMIT, ())
