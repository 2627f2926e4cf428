"""The lattice planner's treatment of criteria: its claims, and the options and criteria that it refuses."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
import shapely

from hpop.criteria import Exposure, Length, Obstruction
from hpop.errors import CriterionError, OptionError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.planners.graph_planners import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.problems.problem import Problem
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))


def solve(problem, **options):
    return Lattice(**options).solve(problem)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"step": 0}, "step"),
        ({"step": math.nan}, "step"),
        ({"step": "a"}, "step"),
        ({"headings": 5}, "headings"),
        ({"time_limit": 0}, "time_limit"),
        ({"max_labels": -1}, "max_labels"),
        ({"max_memory": 0}, "max_memory"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(OptionError, match=message):
        Lattice(**options)


def test_a_step_that_makes_too_many_states_is_refused_before_anything_is_built():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), ["length"])
    with pytest.raises(OptionError, match="take a larger step"):
        solve(problem, step=1e-3)


@dataclass(frozen=True)
class Fatigue:
    """A criterion with memory, not registered."""

    name: ClassVar[str] = "fatigue"
    group: ClassVar[str] = "C"
    unit: ClassVar[str] = "1"
    aggregate: ClassVar[str] = "trajectory"
    requires: ClassVar[tuple[str, ...]] = ()
    smooth: ClassVar[bool] = False
    quantum: ClassVar[float] = 1.0

    def cost(self, m):
        return np.cumsum(m.base.turned)


@dataclass(frozen=True)
class Negative(Fatigue):
    """A cost below zero."""

    name: ClassVar[str] = "bonus"
    aggregate: ClassVar[str] = "sum"

    def cost(self, m):
        return -m.base.length


def test_criteria_with_memory_alone_are_refused_by_name():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), [Fatigue()])
    with pytest.raises(UnsupportedCriterion, match=r"with memory .*: fatigue\."):
        solve(problem, step=0.5)


def test_a_negative_cost_is_refused_by_name():
    problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), ["length", Negative()])
    with pytest.raises(CriterionError, match="'bonus' must cost a finite number >= 0"):
        solve(problem, step=0.5)


def test_a_mean_is_represented_by_its_integral_and_two_of_one_name_are_refused():
    both = edge_objectives([Obstruction(1.5), Exposure(1.5), Length()], "lattice")
    assert both.optimised == (Exposure(1.5), Length())
    with pytest.raises(UnsupportedCriterion, match="exposure twice"):
        edge_objectives([Obstruction(1.5), Exposure(2.0)], "lattice")


def test_the_certificate_claims_optimal_means_only_when_duration_is_minimised():
    def certificate(*criteria):
        problem = Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), list(criteria))
        return solve(problem, step=0.5).certificate

    plain = certificate("turns", "length")
    assert plain == (
        "lattice: exact on the lattice of step 0.5 m, 8 headings, no corner cutting, for (turns, length); "
        "paths off this graph may be better; edge costs rounded to their quanta"
    )
    without = certificate("obstruction", "turns", "length")
    assert "no corner cutting, for (exposure, turns, length)" in without
    assert without.endswith("; obstruction reported, not optimised")
    timed = certificate("obstruction", "turns", "duration")
    assert "each trajectory is optimal for it as well, since the duration is minimised too" in timed


def test_seven_costs_are_one_too_many():
    names = ["exposure", "turns", "length", "rotation", "duration", "clearance", Negative()]
    with pytest.raises(OptionError, match="at most 6 costs, got 7"):
        solve(Problem(OPEN, ROBOT, (1.0, 2.0, 0.0), (5.0, 2.0, 0.0), names), step=0.5)
