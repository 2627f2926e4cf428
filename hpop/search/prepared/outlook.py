"""What is known of the rest of the way from every node, before anybody asks: bounds by turns, and joint ones.

Both cost more than a small search, and neither depends on its source. They are made while all arcs are open, and are
true whatever is closed then: fewer ways are no better. The exact search takes bounds by turns (:mod:`.turn_bounds`),
the one within a precision joint bounds (:mod:`.turn_hull`). The latter tell by how much the rest of a way exceeds its
least costs, one by one: so they belong to the bounds with which they were made.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.search.graph import Graph
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import Groups
from hpop.search.methods import Question
from hpop.search.staircase.search import Staircase
from hpop.search.staircase.tables import H_FIRST, H_REST, TooWide
from hpop.search.staircase.turn_bounds import costs_by_turns
from hpop.search.staircase.turn_hull import IntLanes, TurnHull, directions, turn_hull

ROOM = 200 * 2**20  # bytes for joint bounds, scratch included
NEAR, FEW = 1.025, 0.02  # so many more turns help no more than so, from all but so few of the nodes


@dataclass(frozen=True, eq=False)
class Outlook:
    """Bounds of the rest of the way, of the order of costs in which the search takes them.

    h       (k, n)       least costs, one by one, while all arcs are open
    layers  (n, LAYERS)  least rest with at most so many turns, the nodes in the order of the groups; None for none
    hull                 joint bounds; None for none
    """

    h: IntArray
    layers: NDArray[Any] | None = None
    hull: TurnHull | None = None

    @classmethod
    def of(
        cls,
        graph: Graph,
        source: int,
        targets: IntArray,
        order: tuple[int, ...],
        h: IntArray,
        groups: Groups,
        clock: Clock,
    ) -> Self:
        """The bounds of a staircase search whose turns make groups and count by ones, from a source as far as any."""
        first, index, rest = order
        sums = [graph.aggregates[j] == "sum" for j in (first, rest)]
        if groups.column != index or groups.step != 1 or not sums[1]:
            return cls(h)
        try:
            search = Question(graph, source, targets).search("staircase", order, h, groups, clock, jointly=False)
        except TooWide:
            return cls(h)
        assert isinstance(search, Staircase)
        tables = search.nodes, search.start, search.arcs
        layers = costs_by_turns(groups, rest, *tables, search.is_target, clock)
        if not sums[0]:
            return cls(h, layers)
        weights = directions((int(search.nodes[:, H_FIRST].max()), int(search.nodes[:, H_REST].max())))
        near = search.nodes[:, [H_FIRST, H_REST]] * weights[[0, 1], [0, 1]] * NEAR
        near[h[0, groups.nodes] >= UNREACHABLE] = np.inf

        def is_enough(now: IntLanes) -> bool:
            return bool((now[:, :2] > near).any(axis=1).mean() <= FEW)

        hull = turn_hull(groups, (first, rest), weights, *tables, search.is_target, is_enough, ROOM, clock)
        return cls(h, layers, hull)
