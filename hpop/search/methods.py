"""Which search is set up for a question: the method, and the order of the costs. Kernels are imported when needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.arrays import IntArray, distinct
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
        self,
        method: str,
        index: int,
        h: IntArray,
        samples: IntArray,
        groups: Groups,
        clock: Clock,
        *,
        jointly: bool,
    ) -> tuple[Search, str, tuple[int, ...]]:
        """Set up the search, and say which method it is, and its order of the costs.

        method, index  of :func:`chosen_method`
        h, samples     bounds (k, n), and the costs (k, k) of the paths least in each cost
        jointly        whether it may take joint bounds
        """
        by_spread = _by_spread(samples, h[:, self.source])
        if method == "staircase":
            from hpop.search.machinery.turns import Groups
            from hpop.search.staircase.search import Staircase
            from hpop.search.staircase.tables import TooWide

            others = [j for j in by_spread if j != index]
            others.sort(key=lambda j: self._is_raised(j, index, groups))  # free turns first
            three = (others[0], index, others[1] if len(others) > 1 else -1)
            turns = groups if groups.column == index else Groups.none(self.graph, clock)
            ends = self.graph, self.source, self.targets
            try:
                staircase = Staircase(*ends, h, three, turns, clock, self.precision, self.at_most, jointly=jointly)
                return staircase, method, (others[0], index, *others[1:])
            except TooWide:
                groups = turns
        from hpop.search.general.search import General

        order = _free_first(self.graph, by_spread, groups)
        ends = self.graph, self.source, self.targets
        return General(*ends, h, order, groups, clock, self.precision, self.at_most), "general", order

    def _is_raised(self, j: int, index: int, groups: Groups) -> bool:
        """Whether any turn, an arc with a positive index, raises cost j."""
        if groups.column == index:
            return bool(groups.dearest[:, j].any())
        turns = self.graph.costs[:, index] > 0
        return bool(self.graph.costs[:, j].max(where=turns, initial=0))


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
