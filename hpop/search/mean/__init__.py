"""Exact search if one cost is a mean, the ratio of two sums (:mod:`.capped_mean`), and its limits on the duration.

The limits are given directly, or derived from bounds on other sums. Every arc that takes time must raise some bounded
sum; the arc is assigned to the first such sum. Let rate_j be the largest ratio of an arc's duration to its cost in sum
j, over the arcs assigned to j. Then the remaining duration of a walk is at most the sum over j of rate_j times the
unused part of bound j. For example, bounds on both the length and the number of turns limit the duration, if moves have
a length and turns are counted. Neither bound alone does, as turning in place adds no length, and moving adds no turns.

A bound on the duration itself is the special case of rate 1, with all arcs assigned to the duration.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.lazy import homes_of, on_first_use
from hpop.base.options import whole
from hpop.base.text import shown
from hpop.errors import GraphError, OptionError
from hpop.search.graph import Graph
from hpop.search.machinery import ANYTHING
from hpop.search.networks import MAX_SUM

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.mean import kernel as kernel
    from hpop.search.mean import search as search

MOST_BOUND = 2**63 - 1
MAX_PRODUCT = 2**62  # means are compared by products of an integral and a duration
MARGIN = 1e-12  # relative increase of rates, far more than the rounding errors of sums of their products
TIME, INTEGRAL, OTHERS = range(3)  # columns of the search: the duration, the integral, then the other costs


@dataclass(frozen=True, eq=False)
class MeanLimits:
    """Limits on walks, with costs in the order of the search: duration, integral, other costs.

    most   (k,)  largest cost of a walk, ANYTHING for no limit; the duration always has a limit
    rates  (k,)  for each bounded sum: largest ratio of an arc's duration to its cost in this sum, over the arcs
                 assigned to it; 0 if no arc is assigned. If the duration has a cap, 1 for it and 0 for all other costs
    """

    most: IntArray
    rates: FloatArray

    @classmethod
    def of(cls, graph: Graph, columns: tuple[int, ...], cap: Any, at_most: Sequence[Any]) -> Self:
        """Return the limits that follow from the options of a query.

        columns  columns of the graph's costs, in the order of the search
        cap      upper bound of the duration, or None
        at_most  for each cost of the graph a bound, or None for no bound; None for the integral and the duration

        Raises OptionError for invalid options. Raises GraphError if ``cap`` is None and the bounds do not limit the
        duration on this graph, or if sums or means of its costs could overflow.
        """
        if cap is not None:
            cap = whole("cap", cap, 0, MOST_BOUND, "a whole number of the duration's quanta,")
        bounds = [None if b is None else whole("at_most", b, 0, MOST_BOUND) for b in at_most] or [None] * graph.criteria
        if len(bounds) != graph.criteria or any(bounds[j] is not None for j in columns[:OTHERS]):
            raise OptionError(
                f"at_most must be a whole number or None for each of {graph.criteria} costs, and None for the integral "
                f"and the duration (use cap for the duration), got {shown(at_most)}"
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
        """Upper bound on the duration of walks, in quanta."""
        return int(self.most[TIME])


def _rates(graph: Graph, columns: tuple[int, ...], most: IntArray) -> FloatArray:
    """Return the rates (k,) of :class:`MeanLimits`, for which each arc is assigned to the first bounded sum it raises.

    columns  columns of the graph's costs, in the order of the search
    most     (k,)  largest cost of a walk, in this order; ANYTHING for no limit

    Raises GraphError for an arc that takes time but raises no bounded sum.
    """
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
            f"the duration must be limited, but arc {graph.arc[unpaid][0]} takes time and raises no sum that at_most "
            "bounds, so walks could repeat it without end; give cap, or bound a sum that this arc raises"
        )
    return rates


def _refuse_overflow(graph: Graph, columns: tuple[int, ...], cap: int) -> None:
    """Raise GraphError if sums or products of walks within the cap could overflow 64-bit integers.

    It is also raised for an arc without duration that adds to the integral. `columns` are the columns of the graph's
    costs in the order of the search, and `cap` is the longest duration of a walk.
    """
    time, total = graph.costs[:, columns[TIME]], graph.costs[:, columns[INTEGRAL]]
    lasts = time > 0
    free = np.flatnonzero(~lasts & (total > 0))
    if free.size:
        raise GraphError(
            f"arc {graph.arc[free[0]]} takes no time but adds {total[free[0]]} to the integral, so the mean could be "
            "infinite; give the arc a duration, or use a finer quantum of the duration"
        )
    rate = float(np.max(total[lasts] / time[lasts], initial=1.0))
    largest = int(Fraction(1.01 * rate) * cap**2)  # of an integral and a duration under the cap
    if largest > MAX_PRODUCT:
        raise GraphError(
            f"products of integral and duration, by which means are compared, must stay below {MAX_PRODUCT}, but could "
            f"reach {largest}; use a coarser quantum of cost {columns[TIME]} or {columns[INTEGRAL]}, or smaller limits"
        )
    # A useful walk has no loop without duration.
    shortest = int(time[lasts].min()) if lasts.any() else cap + 1
    arcs = (cap // shortest + 1) * (1 if lasts.all() else graph.nodes)
    for j in columns[OTHERS:]:
        worst = int(graph.largest[j])
        if graph.aggregates[j] == "sum" and worst * arcs > MAX_SUM:
            raise GraphError(
                f"cost {j} of a walk must stay below {MAX_SUM}, but could reach {worst * arcs} within the cap; use a "
                "coarser quantum, or a smaller cap"
            )


__getattr__ = on_first_use(__name__, homes_of(__name__))
