"""Criteria that nonlinear programs accept: those that work on symbols, and counts of moves and turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.text import shown
from hpop.criteria.base import Criterion, check_command
from hpop.criteria.costs import motion_costs
from hpop.errors import OptionError, UnsupportedCriterion, did_you_mean
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.planners.programs.nlp import SparseWorld, vector
from hpop.planners.programs.outcome import ONE_PROGRAM
from hpop.runtime.limits import LimitPassed

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


def smooth_indices(criteria: Sequence[Criterion], problem: Problem, planner: str) -> tuple[int, ...]:
    """Return the indices of the criteria with a gradient, and check all criteria before planning.

    Raises UnsupportedCriterion for a criterion that has no gradient and is no count of moves and turns, for one that
    does not work on symbols, and if no criterion has a gradient.
    """
    indices = tuple(j for j, criterion in enumerate(criteria) if criterion.smooth)
    for criterion in criteria:
        if not criterion.smooth and not is_counted(criterion, problem):
            raise UnsupportedCriterion(
                f"{planner} needs smooth criteria, or counts that the number of moves and turns settles; "
                f"{criterion.name!r} has no gradient and depends on where the motions are. Leave it out, or use "
                "planner 'lattice'."
            )
    if not indices:
        raise UnsupportedCriterion(
            f"{planner} needs a smooth criterion to minimise; {', '.join(c.name for c in criteria)} have no gradient. "
            "Add one, such as 'length'."
        )
    with ONE_PROGRAM:  # symbols are built here as well
        _try_on_symbols([criteria[j] for j in indices], problem)
    return indices


def _try_on_symbols(criteria: Sequence[Criterion], problem: Problem) -> None:
    """Raise UnsupportedCriterion for a criterion that works on numbers but not on symbols."""
    for motions in _some_motions(problem, 2):
        symbols = SymbolicMotions.of(motions).motions
        for criterion in criteria:
            on_symbols(criterion, symbols)


def minimised(name: str, criteria: Sequence[Criterion]) -> int:
    """Return the index of the cost to minimise; raises OptionError where it is missing or has no gradient."""
    names = [criterion.name for criterion in criteria]
    smooth = [criterion.name for criterion in criteria if criterion.smooth]
    if name not in smooth:
        raise OptionError(
            f"minimise names {shown(name)}, which is no smooth cost.{did_you_mean(name, smooth)} "
            f"These are {', '.join(smooth) or 'none'}"
        )
    return names.index(name)


def on_symbols(criterion: Criterion, motions: Motions) -> Any:
    """Return costs (M,) of symbolic motions as a CasADi vector; UnsupportedCriterion if ``cost`` fails on symbols."""
    try:
        column = vector(criterion.cost(motions), len(motions))
        if column.numel() != len(motions):
            raise ValueError(f"{column.numel()} costs for {len(motions)} motions")
    except LimitPassed:
        raise
    except UnsupportedCriterion as error:
        raise UnsupportedCriterion(f"criterion {criterion.name!r} cannot be used here: {error}") from None
    except Exception as error:  # a user's criterion on CasADi's symbols may raise anything
        why = (str(error).strip() or type(error).__name__).splitlines()[-1].rstrip(".")
        raise UnsupportedCriterion(
            f"criterion {criterion.name!r} does not work on symbols, as a nonlinear program needs: {why}. See "
            f"`{check_command(criterion)}`; use NumPy functions of whole columns and no 'if' on values, or planner "
            "'lattice'."
        ) from error
    return column


def is_counted(criterion: Criterion, problem: Problem) -> bool:
    """Return whether all moves cost alike, and all turns of more than three degrees, as for a count.

    This is tested with 200 motions all over the map. An exception that they miss shows when candidates are judged.
    """
    if criterion.aggregate != "sum":
        return False
    return all(np.ptp(motion_costs(criterion, motions)) <= 1e-12 for motions in _some_motions(problem, 200))


def _some_motions(problem: Problem, count: int) -> tuple[Motions, Motions]:
    """Return moves, and turns of more than three degrees, all over the map."""
    rng = np.random.default_rng(0)
    x_min, y_min, x_max, y_max = problem.world.bounds
    x, y = rng.uniform((x_min, y_min), (x_max, y_max), size=(count, 2)).T
    yaw, length = rng.uniform(-np.pi, np.pi, count), rng.uniform(0.01, 5.0, count)
    angle = rng.uniform(math.radians(3.0), np.pi, count) * rng.choice([-1.0, 1.0], count)
    start = States(x=x, y=y, yaw=yaw)
    ahead = States(x=x + length * np.cos(yaw), y=y + length * np.sin(yaw), yaw=yaw)
    turned = States(x=x, y=y, yaw=yaw + angle)
    world, model = problem.world.stand_in(SparseWorld), problem.model
    return (
        Motions(world, model, model.laws["move"], start, ahead),
        Motions(world, model, model.laws["turn"], start, turned),
    )
