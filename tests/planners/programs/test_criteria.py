"""Criteria that nonlinear programs accept: checked before planning, and refused by name."""

from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import Exposure, Length, Turns
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.models import DifferentialDrive
from hpop.planners import Lattice
from hpop.planners.programs.nlp import is_counted, minimised, smooth_indices
from hpop.problems.problem import Problem
from hpop.world import World

ROBOT = DifferentialDrive(radius=0.25)
OPEN = World.from_polygons([shapely.box(2.9, 1.2, 3.3, 3.0)], extent=shapely.box(0, 0, 6, 5))


def problem(*criteria):
    return Problem(OPEN, ROBOT, (1, 2, 0), (5, 2, None), list(criteria))


@hpop.criterion("with_if", group="C", unit="m", aggregate="sum")
@dataclass(frozen=True)
class WithIf:
    """Decides on values, which symbols do not have."""

    def cost(self, m):
        return np.array([length if length > 0.1 else 0.0 for length in m.base.length])


@hpop.criterion("one_for_all", group="C", unit="m", aggregate="sum")
@dataclass(frozen=True)
class OneForAll:
    """Gives one number for many motions."""

    def cost(self, m):
        return m.base.length[:1]


@hpop.criterion("mean_with_if", group="C", unit="1", aggregate="time-mean")
@dataclass(frozen=True)
class MeanWithIf:
    """Time-mean of the criterion WithIf."""

    def cost(self, m):
        return WithIf().cost(m)


@pytest.mark.parametrize("planner", ["epsilon-constraint", "smoothing"])
@pytest.mark.parametrize("criterion", [WithIf(), OneForAll(), MeanWithIf()])
def test_what_does_not_work_on_symbols_is_refused_before_anything_is_planned(planner, criterion, monkeypatch):
    monkeypatch.setattr(Lattice, "stages", None)
    name = type(criterion).__name__
    said = f"(?s)'{criterion.name}.*on CasADi symbols.*`hpop check .*:{name}`"
    with pytest.raises(UnsupportedCriterion, match=said) as told:
        problem(criterion, "length").solve(planner)
    assert "\n" not in str(told.value)


def test_a_smooth_criterion_is_needed_and_a_count_must_be_settled():
    assert smooth_indices([Turns(), Length(), Exposure()], problem("length"), "p") == (1, 2)
    with pytest.raises(
        UnsupportedCriterion, match=r"p needs a smooth criterion to minimise, got .* without a gradient: turns"
    ):
        smooth_indices([Turns()], problem("length"), "p")
    unsettled = problem("orientation_retention", "length").criteria
    assert not is_counted(unsettled[0], problem("length"))
    with pytest.raises(UnsupportedCriterion, match="'orientation_retention' has no gradient"):
        smooth_indices(unsettled, problem("length"), "p")


@pytest.mark.parametrize("name", ["turns", "time"])
def test_what_is_minimised_is_a_smooth_cost(name):
    assert minimised("exposure", [Turns(), Length(), Exposure()]) == 2
    with pytest.raises(OptionError, match=f"got '{name}'. The smooth criteria here are length, exposure"):
        minimised(name, [Turns(), Length(), Exposure()])
