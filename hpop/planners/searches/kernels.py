"""Compile the code (kernels) of the planners' exact searches in background processes, beside the planning."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

from hpop.criteria.base import index_of_role
from hpop.planners.base import Planner
from hpop.planners.objectives import edge_objectives
from hpop.search.machinery.beside import Onset, compiling_beside
from hpop.search.pareto_paths import main_kernels

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


def kernels_beside(planners: Sequence[Planner], problem: Problem) -> AbstractContextManager[Onset | None]:
    """Return a context in which background processes compile the code (kernels) that the planners' exact searches need.

    Kernels that are cached are not compiled again. Compiling begins after the first early result if the first planner
    yields one, else at once. The value of the context is the :class:`.Onset`, which says when, or None if no planner
    needs kernels.
    """
    searching = [planner for planner in planners if planner.needs_kernels]
    if not searching:
        return nullcontext()
    criteria = edge_objectives(problem.criteria, searching[0].name).optimised
    turns = index_of_role("turns", criteria)
    onset = Onset.AFTER_FIRST if planners[0].answers_in_stages else Onset.AT_ONCE
    aggregates = ["max" if criterion.aggregate == "max" else "sum" for criterion in criteria]
    return compiling_beside(aggregates, -1 if turns is None else turns, onset, main_kernels)
