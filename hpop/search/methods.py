"""Which search is set up for a question: the method, and the order of the costs. Kernels are imported when needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray, distinct
from hpop.errors import OptionError
from hpop.search.graph import Graph
from hpop.search.machinery.approximation import EXACT, Precision

if TYPE_CHECKING:
    from hpop.search.machinery.slices import Clock, Search
    from hpop.search.machinery.turns import Groups

SMALL = 1024  # an index cost is small if some good path stays below it (others may dawdle where turns are free)
SAMPLE = 10_000  # arcs that tell how many values a cost takes


@dataclass(frozen=True, eq=False)
class Question:
    """Which paths are asked for.

    targets    (t,)  numbers of nodes
    precision  how near to every non-dominated vector a returned one must be
    at_most    (k,)  bounds on the costs, or none
    """

    graph: Graph
    source: int
    targets: IntArray
    precision: Precision = EXACT
    at_most: tuple[int, ...] = ()

    def search(
        self, method: str, order: tuple[int, ...], h: IntArray, groups: Groups, clock: Clock, *, jointly: bool
    ) -> Search:
        """Set up the search by a method, with the costs in the order of :func:`chosen_order`; may raise TooWide.

        h        (k, n)  bounds
        groups   of the order's index, or none, where the method is "staircase"
        jointly  whether it may take joint bounds
        """
        ends = self.graph, self.source, self.targets
        if method == "staircase":
            from hpop.search.staircase.search import Staircase

            three = (order[0], order[1], order[2] if len(order) > 2 else -1)
            return Staircase(*ends, h, three, groups, clock, self.precision, self.at_most, jointly=jointly)
        from hpop.search.general.search import General

        return General(*ends, h, order, groups, clock, self.precision, self.at_most)


def chosen_method(graph: Graph, method: str, samples: IntArray) -> tuple[str, int]:
    """The method that "auto" stands for, and the column of the smallest small-integer cost, -1 if there is none."""
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
        method = "staircase" if index >= 0 and graph.criteria == 3 else "general"
    return method, index


def chosen_order(
    graph: Graph, method: str, index: int, samples: IntArray, least: IntArray, groups: Groups
) -> tuple[int, ...]:
    """The order of the costs: of the method "staircase" its index is the second.

    method, index   of :func:`chosen_method`
    samples, least  costs (k, k) of the paths least in each cost, and these (k,)
    """
    by_spread = _by_spread(samples, least)
    if method != "staircase":
        return _free_first(graph, by_spread, groups)
    others = [j for j in by_spread if j != index]
    others.sort(key=lambda j: _is_raised(graph, j, index, groups))  # free turns first
    return (others[0], index, *others[1:])


def _is_raised(graph: Graph, j: int, index: int, groups: Groups) -> bool:
    """Whether any turn, an arc with a positive index, raises cost j."""
    if groups.column == index:
        return bool(groups.dearest[:, j].any())
    turns = graph.costs[:, index] > 0
    return bool(graph.costs[:, j].max(where=turns, initial=0))


def _by_spread(samples: IntArray, least: IntArray) -> list[int]:
    """Order the costs: first the one that grows least, in proportion, on the way that is best in another cost.

    Found by measurement: on museum lattices it puts the length first, which took 0.6 of the time of starting
    with the exposure, and the turns never, which took five times as long.
    """
    ratios = (samples + 1.0) / (least + 1.0)  # (k, k)  row i: the way best in i
    np.fill_diagonal(ratios, np.inf)
    return [int(j) for j in np.argsort(ratios.min(axis=0), kind="stable")]


def _free_first(graph: Graph, by_spread: list[int], groups: Groups) -> tuple[int, ...]:
    """Where turns make groups, begin with a cost that they do not raise: then they are taken at once.

    If there are several, with the sum that takes most values: it drops out of the sets of vectors, which are the
    smaller the fewer values the others take. Proximity before the length took 0.6 to 1.2 of the time, and less memory.
    """
    free = [j for j in by_spread if groups.column >= 0 and not groups.dearest[:, j].any()]
    some = graph.costs[:SAMPLE]
    free.sort(key=lambda j: (graph.aggregates[j] == "max", -len(distinct(some[:, j]))))
    return (*free, *(j for j in by_spread if j not in free))
