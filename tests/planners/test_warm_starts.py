"""The planner of the warm starts: options that are shared, and options of its own."""

import pytest

from hpop.errors import OptionError
from hpop.planners import RRT, EpsilonConstraint, Lattice, Roadmap, Smoothing, WeightedSumCorridor
from hpop.planners.warm_starts import warm_planner, warm_planner_of

SHARED = {"step": 0.5, "headings": 16, "time_limit": 7.0}


@pytest.mark.parametrize("starting", [EpsilonConstraint, Smoothing, WeightedSumCorridor])
def test_planners_start_from_the_lattice_with_the_options_that_they_share(starting):
    assert warm_planner_of(starting(step=0.5, headings=16), time_limit=7.0) == Lattice(**SHARED)
    assert warm_planner_of(starting(warm_start={"lattice": {"step": 1.0}})) == Lattice(step=1.0)


def test_a_planner_that_is_named_shares_the_options_that_it_has():
    assert warm_planner("lattice", **SHARED) == Lattice(**SHARED)
    assert warm_planner("roadmap", **SHARED) == Roadmap(time_limit=7.0)


def test_one_with_options_of_its_own_shares_the_time_limit_alone():
    assert warm_planner({"lattice": {"step": 1.0}}, **SHARED) == Lattice(step=1.0, time_limit=7.0)
    assert warm_planner({"rrt": None}, **SHARED) == RRT(time_limit=7.0)


def test_its_own_time_limit_counts():
    assert warm_planner({"lattice": {"time_limit": 9.0}}, **SHARED) == Lattice(time_limit=9.0)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (3, "warm_start is the name of a planner"),
        ({}, "one planner with its options"),
        ({"lattice": {}, "rrt": {}}, "one planner with its options"),
        ({"lattice": 5}, "options of 'lattice' by their names, got 5"),
        ({"lattice": [1]}, "by their names"),
        ({"lattice": {"stp": 1.0}}, "no option 'stp'"),
    ],
)
def test_what_is_no_planner_says_what_to_do(spec, message):
    with pytest.raises(OptionError, match=message):
        warm_planner(spec, **SHARED)
