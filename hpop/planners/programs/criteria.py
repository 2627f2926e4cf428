"""Check of the criteria for a nonlinear program: it accepts smooth criteria, and counts of moves and turns."""

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
    """Return the indices of the smooth criteria (those with a gradient), and refuse criteria that programs cannot use.

    Raises UnsupportedCriterion for a criterion that has no gradient and does not just count moves and turns, for one
    whose formula fails on CasADi symbols, and if no criterion is smooth.
    """
    indices = tuple(j for j, criterion in enumerate(criteria) if criterion.smooth)
    for criterion in criteria:
        if not criterion.smooth and not is_counted(criterion, problem):
            raise UnsupportedCriterion(
                f"{planner} accepts smooth criteria, and criteria that only count moves and turns; "
                f"{criterion.name!r} has no gradient and is no such count. Leave it out, or use planner 'lattice'."
            )
    if not indices:
        raise UnsupportedCriterion(
            f"{planner} needs a smooth criterion to minimise, got only criteria without a gradient: "
            f"{', '.join(c.name for c in criteria)}. Add a smooth one, such as 'length'."
        )
    with ONE_PROGRAM:  # symbols are built here as well
        _try_on_symbols([criteria[j] for j in indices], problem)
    return indices


def _try_on_symbols(criteria: Sequence[Criterion], problem: Problem) -> None:
    """Evaluate the criteria on CasADi symbols; raise UnsupportedCriterion if one works on numbers only."""
    for motions in _some_motions(problem, 2):
        symbols = SymbolicMotions.of(motions).motions
        for criterion in criteria:
            on_symbols(criterion, symbols)


def minimised(name: str, criteria: Sequence[Criterion]) -> int:
    """Return the index of the criterion called ``name``, which a planner is to minimise.

    Raises OptionError if no criterion has this name, or if it has no gradient.
    """
    names = [criterion.name for criterion in criteria]
    smooth = [criterion.name for criterion in criteria if criterion.smooth]
    if name not in smooth:
        raise OptionError(
            f"minimise must be the name of a smooth criterion, got {shown(name)}.{did_you_mean(name, smooth)} "
            f"The smooth criteria here are {', '.join(smooth) or 'none'}"
        )
    return names.index(name)


def on_symbols(criterion: Criterion, motions: Motions) -> Any:
    """Return the costs (M,) of M symbolic motions as a CasADi vector.

    Raises UnsupportedCriterion if the criterion's ``cost`` fails on symbols.
    """
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
            f"criterion {criterion.name!r} must work on CasADi symbols, which nonlinear programs need, but failed: "
            f"{why}. In its `cost`, use NumPy functions of whole columns and no 'if' on values (check it with "
            f"`{check_command(criterion)}`), or use planner 'lattice'."
        ) from error
    return column


def is_counted(criterion: Criterion, problem: Problem) -> bool:
    """Return whether a criterion is a count: all moves cost the same, and so do all turns of more than three degrees.

    This is tested on 200 random motions of each kind, all over the map. The final check of the candidates finds any
    exceptions that this test misses.
    """
    if criterion.aggregate != "sum":
        return False
    return all(np.ptp(motion_costs(criterion, motions)) <= 1e-12 for motions in _some_motions(problem, 200))


def _some_motions(problem: Problem, count: int) -> tuple[Motions, Motions]:
    """Return ``count`` random moves, and as many random turns of more than three degrees, all over the map."""
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
