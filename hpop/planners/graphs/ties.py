"""Ties broken by turns: of paths with equal costs a search keeps one with the fewest, also where no cost counts them.

Else ties would be broken by spinning as well as by not. The first summed cost becomes cost * TIE_TURNS + turns, in a
copy of the graph's costs that counts as memory of the graph.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hpop.errors import GraphError
from hpop.planners.graphs.arcs import blocks
from hpop.planners.spending import Spending
from hpop.search import Graph

TIE_TURNS = 2**18  # more turns than any path makes
COPIED = "costs were copied, to break ties by turns"


def tie_broken(graph: Graph, turned: NDArray[np.int8], spending: Spending) -> Graph | None:
    """The graph with turns, (m,) in each arc, as a last tie-break; None where a cost charges for every turn.

    Raises Exhausted where a limit of the spending is passed.
    """
    columns = summed(graph)
    if not columns or not turned.any() or any(_charges(graph, j, turned) for j in columns):
        return None
    spending.check(COPIED, graph.costs.nbytes)
    costs, first = graph.costs.copy(), columns[0]
    for part in blocks(graph.arcs):
        costs[part, first] *= TIE_TURNS
        costs[part, first] += turned[part]
    costs.setflags(write=False)  # so that they are not copied again
    try:
        broken = replace(graph, costs=costs)
    except GraphError:  # sums would overflow: the graph is too large for a tie-break
        return None
    spending.hold(costs.nbytes, COPIED)
    return broken


def summed(graph: Graph) -> list[int]:
    """Columns of the costs that add up."""
    return [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum"]


def _charges(graph: Graph, column: int, turned: NDArray[np.int8]) -> bool:
    """Whether a cost charges for every arc that turns."""
    return all((graph.costs[part, column][turned[part] > 0] > 0).all() for part in blocks(graph.arcs))
