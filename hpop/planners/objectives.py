"""Costs that a graph search adds up along edges, from the criteria of a problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.criteria.base import Criterion, Group, index_of_role
from hpop.criteria.costs import stand_in_of
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.motions import Motions

if TYPE_CHECKING:
    pass


WHOLE = 1e-6  # of a quantum: rounding error allowed before a cost is rounded up


@dataclass(frozen=True)
class Integral:
    """The time integral of a time-mean criterion, which adds up along edges as the mean does not."""

    mean: Criterion

    @property
    def name(self) -> str:
        return f"{self.mean.name} integral"

    @property
    def group(self) -> Group:
        return self.mean.group

    @property
    def unit(self) -> str:
        return "s" if self.mean.unit == "1" else f"{self.mean.unit} s"

    @property
    def aggregate(self) -> str:
        return "sum"

    @property
    def requires(self) -> tuple[str, ...]:
        return self.mean.requires

    @property
    def smooth(self) -> bool:
        return self.mean.smooth

    @property
    def quantum(self) -> float:
        return self.mean.quantum

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the mean's rate."""
        return self.mean.cost(m)


def integral_of(mean: Criterion) -> Criterion:
    """Return the additive criterion that replaces a time-mean: the one that it names, or its time integral."""
    return stand_in_of(mean) or cast(Criterion, Integral(mean))


@dataclass(frozen=True)
class Objectives:
    """Criteria of a problem, split by how a planner with costs of edges treats them.

    optimised  criteria that add up or take the worst edge; the integral replaces each time-mean
    means      time-means, which are only reported
    filters    criteria with memory, which are evaluated on the trajectories found and filter these
    notes      one line for each criterion that is not optimised
    """

    optimised: tuple[Criterion, ...]
    means: tuple[Criterion, ...]
    filters: tuple[Criterion, ...]
    notes: tuple[str, ...]

    def with_notes(self, notes: tuple[str, ...]) -> Objectives:
        """Return these objectives with more notes."""
        return replace(self, notes=(*self.notes, *notes)) if notes else self

    @property
    def names(self) -> str:
        """Names of the optimised criteria, as text."""
        return ", ".join(criterion.name for criterion in self.optimised)

    def at_most(self, max_turns: int | None) -> list[int | None]:
        """Return an upper bound or None for each cost, or [] if turns are not bounded.

        Raises OptionError if turns are bounded but not a cost.
        """
        if max_turns is None:
            return []
        turns = index_of_role("turns", self.optimised)
        if turns is None:
            raise OptionError(
                f"max_turns bounds the cost 'turns', but the costs that are searched for are {self.names}; list it "
                "among the criteria, or leave max_turns out"
            )
        return [max_turns if j == turns else None for j in range(len(self.optimised))]

    @property
    def certificate(self) -> str:
        """Return the claim for criteria that were not optimised.

        A trajectory that is optimal in the integral need not be optimal in the mean. If the duration is minimised too,
        it is: a trajectory better in the mean and no worse in the other costs would also be better in the integral.
        """
        parts = []
        if self.means:
            timed = index_of_role("duration", self.optimised) is not None
            optimal = "; each trajectory is optimal for it as well, since the duration is minimised too" * timed
            parts.append(f"; {', '.join(mean.name for mean in self.means)} reported, not optimised{optimal}")
        if self.filters:
            names = ", ".join(c.name for c in self.filters)
            parts.append(f"; {names} evaluated on these trajectories, not searched for: others may be better in them")
        return "".join(parts)


def edge_objectives(criteria: Sequence[Criterion], planner_name: str) -> Objectives:
    """Split criteria into costs that add up along edges, time-means, and criteria with memory.

    Missed stops add up along the edges of the layers of a tour.

    Raises UnsupportedCriterion when nothing is left to optimise, or one cost would be minimised twice.
    """
    optimised: list[Criterion] = []
    means, filters, notes = [], [], []
    for criterion in criteria:
        if criterion.aggregate == "trajectory" and criterion.role != "stops_missed":
            filters.append(criterion)
            notes.append(
                f"{criterion.name} has memory and does not add up: it is evaluated on the trajectories that are "
                "optimal in the other criteria"
            )
            continue
        stand_in = criterion
        if criterion.aggregate == "time-mean":
            stand_in = integral_of(criterion)
            means.append(criterion)
            notes.append(
                f"{criterion.name} is a mean and does not add up: the search minimises {stand_in.name} "
                f"(its integral, {stand_in.unit}); {criterion.name} is reported for every trajectory"
            )
        if stand_in not in optimised:
            optimised.append(stand_in)
    if not optimised:
        raise UnsupportedCriterion(
            f"{planner_name} needs a criterion that adds up along edges beside those with memory (aggregate "
            f"'trajectory'): {', '.join(c.name for c in filters)}. Add one, such as 'length'."
        )
    names = [criterion.name for criterion in optimised]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise UnsupportedCriterion(
            f"{planner_name} would minimise {', '.join(repeated)} twice, with different parameters: once as asked for, "
            "once in the place of a mean. Give both the same parameters, or leave one out."
        )
    return Objectives(tuple(optimised), tuple(means), tuple(filters), tuple(notes))


def quantised(costs: FloatArray, criterion: Criterion) -> IntArray:
    """Return costs (M,) of edges as counts of the criterion's quantum, rounded up.

    The search merges two turns at a position into one, if this costs no more. Rounding up keeps that property; rounding
    to the nearest would not: 0.4 + 0.4 would become 0, but 0.8 would become 1. If sums overflow, the graph raises
    GraphError later.
    """
    largest = float(costs.max(initial=0.0)) / criterion.quantum
    if largest > 2**52:
        raise OptionError(
            f"an edge costs {costs.max()} {criterion.unit} in {criterion.name!r}, too many quanta of "
            f"{criterion.quantum}; declare a coarser quantum"
        )
    return np.ceil(costs / criterion.quantum - WHOLE).astype(np.int64)
