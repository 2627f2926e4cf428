"""The search "staircase": exact and fast if one of two or three costs is a small integer (:mod:`.staircase.search`).

It tabulates costs by the values of one of them, the index cost: a sum of small integers, such as the number of turns.
Here is the choice between this method and the method "general", and of the order in which a search compares costs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray, distinct
from hpop.base.lazy import homes_of, on_first_use
from hpop.errors import OptionError
from hpop.search.graph import Graph

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.machinery.turns import Groups
    from hpop.search.staircase import kernel as kernel
    from hpop.search.staircase import search as search
    from hpop.search.staircase import tables as tables


SMALL = 1024  # a cost can be the index of staircases if it stays below this on some good path
SAMPLE = 10_000  # number of arcs in which the distinct values of a cost are counted
LARGEST_TABLE = 6_000_000  # nodes times index values: with more, "staircase" is slower than "general" (measured)


def choose_method(graph: Graph, method: str, samples: IntArray, groups: Groups) -> tuple[str, int]:
    """Return the method of a search, and the column of its index cost, -1 if there is none.

    The index cost is the cost by whose values staircases are tabulated: a sum of small integers, such as the number of
    turns. Of several such costs it is the one with the smallest total on any path of `samples`. It is returned for the
    method "general" as well.

    method   "auto", "staircase" or "general", as the caller of the search gave it
    samples  (k, k)  row j: all costs of the path that is least in cost j, of :func:`.lower_bounds`
    groups   groups of nodes that are joined by turns (:mod:`.machinery.turns`)

    The method "auto" becomes "staircase" if there are three costs, and if arcs with an index cost are turns in groups
    of nodes or the table is small; else "general".

    Raises OptionError if the method is "staircase" and the graph does not fit.
    """
    reach = samples.min(axis=0) if len(samples) else np.zeros(graph.criteria, np.int64)
    fit = [j for j in range(graph.criteria) if graph.aggregates[j] == "sum" and reach[j] < SMALL]
    fit = [j for j in fit if graph.largest[j] < SMALL]
    if method == "staircase":
        if graph.criteria not in (2, 3):
            raise OptionError(f"method 'staircase' needs 2 or 3 costs, got {graph.criteria}; use method 'general'")
        if not fit:
            raise OptionError(
                "method 'staircase' needs a cost that is a sum of small integers (a path total below "
                f"{SMALL}), and this graph has none; use method 'general'"
            )
    index = min(fit, key=lambda j: int(reach[j])) if fit else -1
    if method == "auto":
        is_small = len(samples) > 0 and graph.nodes * (1 + int(samples[:, index].max())) <= LARGEST_TABLE
        fits = index >= 0 and (groups.column == index or is_small)
        method = "staircase" if fits and graph.criteria == 3 else "general"
    return method, index


def choose_order(
    graph: Graph, method: str, index: int, samples: IntArray, least: IntArray, groups: Groups
) -> tuple[int, ...]:
    """Return the columns of the costs in the order in which the search compares them.

    The order affects only the speed. For "staircase" the index cost is the second.

    method, index  result of :func:`choose_method`
    samples        (k, k)  row j: all costs of the path that is least in cost j
    least          (k,)    least value of each cost on any path
    groups         groups of nodes that are joined by turns (:mod:`.machinery.turns`)
    """
    by_spread = _by_spread(samples, least)
    if method != "staircase":
        return _with_turn_free_first(graph, by_spread, groups)
    remaining = [j for j in by_spread if j != index]
    remaining.sort(key=lambda j: _is_raised(graph, j, index, groups))  # costs that turns do not raise come first
    return (remaining[0], index, *remaining[1:])


def _is_raised(graph: Graph, j: int, index: int, groups: Groups) -> bool:
    """Return whether any turn (an arc with a positive cost in column `index`) has a positive cost in column j.

    If turns form groups, only turns within groups count.
    """
    if groups.column == index:
        return bool(groups.dearest[:, j].any())
    costs = graph.distinct_costs
    return bool(costs[:, j].max(where=costs[:, index] > 0, initial=0))


def _by_spread(samples: IntArray, least: IntArray) -> list[int]:
    """Return the columns of the costs by their closeness to the minimum on a path that is least in another cost.

    Closest first. Each cost is judged by the ratio to its minimum, on the one of these paths where it is smallest.

    samples  (k, k)  row i: all costs of the path that is least in cost i
    least    (k,)    least value of each cost on any path

    This order was found by measurement. On museum lattices the length comes first; the search then takes 0.6 of the
    time of a search with the exposure first. Turns never come first, as the search would take five times as long.
    """
    ratios = (samples + 1.0) / (least + 1.0)  # (k, k)  row i: the path best in i
    np.fill_diagonal(ratios, np.inf)
    return [int(j) for j in np.argsort(ratios.min(axis=0), kind="stable")]


def _with_turn_free_first(graph: Graph, by_spread: list[int], groups: Groups) -> tuple[int, ...]:
    """Return an order of costs that begins with those that turns do not raise, as dominance tests within groups need.

    `by_spread` has the columns in the order of :func:`_by_spread`, which the other costs keep. Of several costs that
    turns do not raise, the sum with most distinct values comes first. The first cost need not be stored in the sets of
    vectors, and these sets are smaller if the other costs have few values. Proximity before length took 0.6 to 1.2 of
    the time of the reverse order, and less memory.
    """
    free = [j for j in by_spread if groups.column >= 0 and not groups.dearest[:, j].any()]
    _, sample = graph.ends_and_costs(np.arange(min(SAMPLE, graph.arcs)))
    free.sort(key=lambda j: (graph.aggregates[j] == "max", -len(distinct(sample[:, j]))))
    return (*free, *(j for j in by_spread if j not in free))


__getattr__ = on_first_use(__name__, homes_of(__name__))
