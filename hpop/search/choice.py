"""Choice of the method of a search, and of the order of its costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray, distinct
from hpop.errors import OptionError
from hpop.search.graph import Graph

if TYPE_CHECKING:
    from hpop.search.machinery.turns import Groups

SMALL = 1024  # an index cost is small if some good path stays below it
SAMPLE = 10_000  # arcs sampled to count the values of a cost
LARGEST_TABLE = 6_000_000  # steps of staircases beyond which they are slower than sets of vectors (measured)


def choose_method(graph: Graph, method: str, samples: IntArray, groups: Groups) -> tuple[str, int]:
    """Return the method, chosen if it is "auto", and the column of the index cost, or -1.

    The index cost is the summed cost of small integers that is smallest along the paths of `samples`.

    samples  (k, k)  costs of the least path of each cost, of :func:`.lower_bounds`

    "auto" is "staircase" if there are three costs, and turns of the index form groups or the table is small.

    Raises OptionError if the method is "staircase" and the graph does not fit.
    """
    reach = samples.min(axis=0) if len(samples) else np.zeros(graph.criteria, np.int64)
    fit = [j for j in range(graph.criteria) if graph.aggregates[j] == "sum" and reach[j] < SMALL]
    fit = [j for j in fit if graph.largest[j] < SMALL]
    if method == "staircase":
        if graph.criteria not in (2, 3):
            raise OptionError(f"method 'staircase' takes 2 or 3 costs, this graph has {graph.criteria}; use 'general'")
        if not fit:
            raise OptionError(
                "method 'staircase' needs a summed cost that is a small integer "
                f"(below {SMALL} along good paths), this graph has none; use 'general'"
            )
    index = min(fit, key=lambda j: int(reach[j])) if fit else -1
    if method == "auto":
        fits = index >= 0 and (groups.column == index or _is_table_small(graph, index, samples))
        method = "staircase" if fits and graph.criteria == 3 else "general"
    return method, index


def _is_table_small(graph: Graph, index: int, samples: IntArray) -> bool:
    """Return whether the staircases of all nodes have few steps: nodes times values of the index on the best paths."""
    return len(samples) > 0 and graph.nodes * (1 + int(samples[:, index].max())) <= LARGEST_TABLE


def choose_order(
    graph: Graph, method: str, index: int, samples: IntArray, least: IntArray, groups: Groups
) -> tuple[int, ...]:
    """Return the columns of the costs in the order of the search; for "staircase" the index cost is the second.

    method, index  result of :func:`choose_method`
    samples        (k, k)  costs of the least path of each cost, row by row
    least          (k,)    least value of each cost
    """
    by_spread = _by_spread(samples, least)
    if method != "staircase":
        return _with_turn_free_first(graph, by_spread, groups)
    remaining = [j for j in by_spread if j != index]
    remaining.sort(key=lambda j: _is_raised(graph, j, index, groups))  # costs that turns do not raise come first
    return (remaining[0], index, *remaining[1:])


def _is_raised(graph: Graph, j: int, index: int, groups: Groups) -> bool:
    """Return whether any turn, an arc with a positive index cost, raises cost j."""
    if groups.column == index:
        return bool(groups.dearest[:, j].any())
    turns = graph.costs[:, index] > 0
    return bool(graph.costs[:, j].max(where=turns, initial=0))


def _by_spread(samples: IntArray, least: IntArray) -> list[int]:
    """Return the columns of the costs, sorted by their least relative growth on the best path of another cost.

    This order was found by measurement. On museum lattices the length comes first; the search then takes 0.6 of the
    time of a search with the exposure first. Turns never come first, as the search would take five times as long.
    """
    ratios = (samples + 1.0) / (least + 1.0)  # (k, k)  row i: the path best in i
    np.fill_diagonal(ratios, np.inf)
    return [int(j) for j in np.argsort(ratios.min(axis=0), kind="stable")]


def _with_turn_free_first(graph: Graph, by_spread: list[int], groups: Groups) -> tuple[int, ...]:
    """Return an order that begins with the costs that no turn raises, so that turns are taken together.

    Of several such costs, the sum with most distinct values comes first. The first cost drops out of the sets of
    vectors, and these sets are smaller if the other costs have few values. Proximity before length took 0.6 to 1.2 of
    the time of the reverse order, and less memory.
    """
    free = [j for j in by_spread if groups.column >= 0 and not groups.dearest[:, j].any()]
    sample = graph.costs[:SAMPLE]
    free.sort(key=lambda j: (graph.aggregates[j] == "max", -len(distinct(sample[:, j]))))
    return (*free, *(j for j in by_spread if j not in free))
