"""The limits on walks with a minimised mean: on the duration itself, or on other sums that make it finite.

Let every arc that takes time raise some bounded sum, and assign the arc to the first such sum. Let rate_j be the
largest ratio of an arc's duration to its cost in sum j, over the arcs assigned to j. Then the remaining duration of a
walk is at most the sum over j of rate_j times the remainder of bound j. So bounds on both the length and the number of
turns make the duration finite, if moves have a length and turns are counted. Neither bound alone does: turning in place
adds no length, and moving no turns.

A bound on the duration is the special case of rate 1, with all arcs assigned to the duration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Self

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.errors import GraphError, OptionError
from hpop.search.graph import MAX_SUM, Graph
from hpop.search.machinery.approximation import ANYTHING

MOST_BOUND = 2**63 - 1
MAX_PRODUCT = 2**62  # means are compared by products of an integral and a duration
MARGIN = 1e-12  # relative increase of rates, far more than the rounding errors of sums of their products
TIME, INTEGRAL, OTHERS = range(3)  # columns of the search: the duration, the integral, then the other costs


@dataclass(frozen=True, eq=False)
class MeanLimits:
    """Limits on walks, with costs in the order of the search: duration, integral, other costs.

    most   (k,)  largest cost of a walk, ANYTHING for no limit; the duration always has a limit
    rates  (k,)  largest duration of an arc per count of the bounded sum to which the arc is assigned; 0 if no arc is
    """

    most: IntArray
    rates: FloatArray

    @classmethod
    def of(cls, graph: Graph, columns: tuple[int, ...], cap: Any, at_most: Sequence[Any]) -> Self:
        """Return the limits that follow from a cap on the duration, or None, and from bounds on the costs.

        columns  of the graph's costs, in the order of the search
        at_most  one bound or None per cost of the graph

        Raises OptionError for invalid limits, GraphError if no limit makes the duration finite, or if sums or means
        could overflow.
        """
        if cap is not None:
            cap = whole("cap", cap, 0, MOST_BOUND, "a whole number of the duration's quanta,")
        bounds = [None if b is None else whole("at_most", b, 0, MOST_BOUND) for b in at_most] or [None] * graph.criteria
        if len(bounds) != graph.criteria or any(bounds[j] is not None for j in columns[:OTHERS]):
            raise OptionError(
                f"at_most is a whole number or None for each of {graph.criteria} costs, None for the integral and the "
                f"duration, which cap bounds; got {shown(at_most)}"
            )
        most = np.array([ANYTHING if b is None else min(b, ANYTHING) for b in (bounds[j] for j in columns)], np.int64)
        rates = np.zeros(len(columns))
        if cap is None:
            rates[:] = _rates(graph, columns, most)
            longest = float(rates @ most)
        else:
            rates[TIME] = 1.0
            longest = cap
        most[TIME] = min(longest, ANYTHING)
        _refuse_overflow(graph, columns, int(most[TIME]))
        return cls(most, rates)

    @property
    def cap(self) -> int:
        """Bound on the duration of walks."""
        return int(self.most[TIME])


def _rates(graph: Graph, columns: tuple[int, ...], most: IntArray) -> FloatArray:
    """Return, for each bounded sum (k,), the largest duration per count over the arcs assigned to it."""
    time = graph.costs[:, columns[TIME]]
    unpaid = time > 0
    rates = np.zeros(len(columns))
    for i, j in enumerate(columns):
        if most[i] < ANYTHING and graph.aggregates[j] == "sum":
            pays = unpaid & (graph.costs[:, j] > 0)
            rates[i] = (1 + MARGIN) * (time[pays] / graph.costs[pays, j]).max(initial=0.0)
            unpaid &= ~pays
    if unpaid.any():
        raise GraphError(
            f"arc {graph.arc[unpaid][0]} takes time but raises no sum that at_most bounds: walks may last for ever, "
            "and their mean fall; give cap, or bound such a sum"
        )
    return rates


def _refuse_overflow(graph: Graph, columns: tuple[int, ...], cap: int) -> None:
    """Raise GraphError if sums or products under the cap could overflow, or an arc without duration has an integral."""
    time, total = graph.costs[:, columns[TIME]], graph.costs[:, columns[INTEGRAL]]
    lasts = time > 0
    free = np.flatnonzero(~lasts & (total > 0))
    if free.size:
        raise GraphError(
            f"arc {graph.arc[free[0]]} takes no time but adds {total[free[0]]} to the integral, so the mean has no "
            "bound; give it a duration, or a finer quantum of the duration"
        )
    rate = float(np.max(total[lasts] / time[lasts], initial=1.0))
    largest = int(Fraction(1.01 * rate) * cap**2)  # of an integral and a duration under the cap
    if largest > MAX_PRODUCT:
        raise GraphError(
            f"means could overflow: they are compared by products of up to {largest}, the limit is "
            f"{MAX_PRODUCT}; use a coarser quantum of cost {columns[TIME]} or {columns[INTEGRAL]}, or smaller limits"
        )
    # A useful walk has no loop without duration.
    shortest = int(time[lasts].min()) if lasts.any() else cap + 1
    arcs = (cap // shortest + 1) * (1 if lasts.all() else graph.nodes)
    for j in columns[OTHERS:]:
        worst = int(graph.largest[j])
        if graph.aggregates[j] == "sum" and worst * arcs > MAX_SUM:
            raise GraphError(
                f"cost {j} could overflow: a walk under the cap may cost up to {worst * arcs}, the limit is {MAX_SUM}; "
                "use a coarser quantum, or a smaller cap"
            )
