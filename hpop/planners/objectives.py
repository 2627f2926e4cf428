"""Convert the criteria of a problem to costs that a graph search can minimise: sums, or maxima, over edges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray
from hpop.criteria.base import Criterion, Group, index_of_role
from hpop.criteria.costs import motion_costs, stand_in_of
from hpop.errors import OptionError, UnsupportedCriterion
from hpop.motions import Motions

if TYPE_CHECKING:
    pass


WHOLE = 1e-6  # of a quantum: rounding error allowed before a cost is rounded up
SECOND = 1.0  # s: duration of a motion in place for which this error is allowed


@dataclass(frozen=True)
class Integral:
    """Criterion that replaces a time-mean in a graph search: its integral over time.

    The integral is a sum over the edges of a path; the mean is not.
    """

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
        """Integral over time (M,) of the averaged quantity, for each motion."""
        return self.mean.cost(m)


def integral_of(mean: Criterion) -> Criterion:
    """Return the additive criterion that a search minimises instead of a time-mean.

    This is the sum that the time-mean declares in ``integral``, with the quantum that the user set for it. If it
    declares none, it is the integral of the mean over time.
    """
    return stand_in_of(mean) or cast(Criterion, Integral(mean))


@dataclass(frozen=True)
class Objectives:
    """Criteria of a problem, grouped by how a graph search treats them.

    optimised  criteria that the search minimises: sums and maxima over edges, with an integral for each time-mean
    means      time-means, which are only reported for the trajectories found
    filters    criteria with memory, which do not add up over edges: they are evaluated on the trajectories found, and
               count as costs of the front
    notes      for the user: one line for each criterion that is not minimised
    """

    optimised: tuple[Criterion, ...]
    means: tuple[Criterion, ...]
    filters: tuple[Criterion, ...]
    notes: tuple[str, ...]

    def with_notes(self, notes: tuple[str, ...]) -> Objectives:
        """Return a copy with more notes for the user."""
        return replace(self, notes=(*self.notes, *notes)) if notes else self

    @property
    def names(self) -> str:
        """Names of the optimised criteria, as text."""
        return ", ".join(criterion.name for criterion in self.optimised)

    def at_most(self, max_turns: int | None) -> list[int | None]:
        """Return the upper bounds of the costs for a search: ``max_turns`` for the turns, None for every other cost.

        Returns [] if ``max_turns`` is None. Raises OptionError if the number of turns is not among the costs.
        """
        if max_turns is None:
            return []
        turns = index_of_role("turns", self.optimised)
        if turns is None:
            raise OptionError(
                f"max_turns needs the criterion 'turns', but the search minimises {self.names}; add 'turns' to the "
                "criteria, or leave max_turns out"
            )
        return [max_turns if j == turns else None for j in range(len(self.optimised))]

    @property
    def certificate(self) -> str:
        """Return the part of a planner's certificate that says what holds for criteria it did not minimise.

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
    """Return the costs that a graph search minimises, and which criteria are time-means and which have memory.

    Instead of a time-mean, its integral over time is minimised; the mean itself is only reported.

    The criterion of missed stops is minimised, although it has memory: in the graph of a tour, edges that skip stops
    carry its cost.

    Raises UnsupportedCriterion if no criterion is left to minimise, or if one cost would be minimised twice.
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
            f"{planner_name} needs at least one criterion that adds up along edges, got only criteria with memory "
            f"(aggregate 'trajectory'): {', '.join(c.name for c in filters)}. Add one, such as 'length'."
        )
    names = [criterion.name for criterion in optimised]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise UnsupportedCriterion(
            f"{planner_name} would minimise {', '.join(repeated)} twice, with different parameters: once as one of the "
            "criteria, and once instead of a time-mean. Give both the same parameters, or leave one out."
        )
    return Objectives(tuple(optimised), tuple(means), tuple(filters), tuple(notes))


def quantised(costs: FloatArray, criterion: Criterion, noise: FloatArray | float = WHOLE) -> IntArray:
    """Return the costs (M,) of edges as whole numbers of the criterion's quantum, rounded up.

    The search replaces two turns at one position by a single turn, if that costs no more. Rounding up keeps this
    comparison valid, but rounding to the nearest number would not: 0.4 + 0.4 would become 0, and 0.8 would become 1. A
    cost that exceeds a whole number by at most ``noise``, in quanta, is not rounded up.

    Raises OptionError if a cost is too many quanta; sums that overflow raise GraphError when the graph is made.
    """
    largest = float(costs.max(initial=0.0)) / criterion.quantum
    if largest > 2**52:
        raise OptionError(
            f"an edge costs {costs.max()} {criterion.unit} in {criterion.name!r}, more than 2^52 times its quantum "
            f"{criterion.quantum}; give the problem a larger quantum in quanta"
        )
    return np.ceil(costs / criterion.quantum - noise).astype(np.int64)


def rounding_noise(motions: Motions) -> FloatArray | float:
    """Return the noise (M,) that :func:`quantised` ignores in the costs of motions.

    For motions in place it is proportional to the duration, as most of their costs are at a position. An equal noise
    for all turns would make two turns cost 0 and the turn that replaces them 1, if their costs were 0.8, 0.8 and 1.6
    times this noise.
    """
    return WHOLE if {"x", "y"} & motions.law.varies else WHOLE * motions.duration / SECOND


def motion_quanta(motions: Motions, criteria: Sequence[Criterion]) -> IntArray:
    """Return the costs (M, k) of motions, in quanta."""
    noise = rounding_noise(motions)
    return np.stack([quantised(motion_costs(criterion, motions), criterion, noise) for criterion in criteria], axis=1)
