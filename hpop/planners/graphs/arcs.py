"""Arcs of a graph of states: order and costs, computed in blocks; chains of motions as arcs; ties broken by turns."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import GraphError, ModelError
from hpop.motions import Motions, States
from hpop.planners.graphs.trajectory_graph import Stretches
from hpop.planners.objectives import quantised
from hpop.planners.spending import Spending
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.planners.graphs.trajectory_graph import TrajectoryGraph

# The only arrays as large as the arcs are those that stay: heads, kinds, and a column of small integers for each cost.


Counts: TypeAlias = NDArray[np.unsignedinteger[Any]]
MOVE = 0  # the kind of moves; all others are made in place
BLOCK = 1 << 16  # arcs of one block: their columns stay in the processor's cache, and every core gets some blocks


class Arcs(NamedTuple):
    """Arcs sorted by tail; at each state, motions in place come before moves.

    start  (n + 1,)  the arcs that leave state u are start[u] : start[u + 1]
    heads  (m,)      int32
    kinds  (m,)      uint8, index of the kind of each arc's motion in the kinds of the graph; 0 is a move
    """

    start: IntArray
    heads: NDArray[np.int32]
    kinds: NDArray[np.uint8]

    @classmethod
    def sorted(cls, size: int, edges: Sequence[tuple[IntArray, IntArray]]) -> Arcs:
        """Return the arcs of edges, given as tails and heads of each kind (moves first), between ``size`` states."""
        kinds = [*range(1, len(edges)), MOVE]
        tails, heads = (np.concatenate([edges[kind][side] for kind in kinds]) for side in (0, 1))
        order = np.argsort(tails, kind="stable")
        start = np.zeros(size + 1, np.int64)
        np.cumsum(np.bincount(tails, minlength=size), out=start[1:])
        of_kind = np.repeat(np.array(kinds, np.uint8), [edges[kind][0].size for kind in kinds])
        return cls(start, heads[order].astype(np.int32), of_kind[order]).frozen()

    def frozen(self) -> Arcs:
        """Make the arrays read-only, so that a search graph need not copy them; return the arcs."""
        for array in self:
            array.setflags(write=False)
        return self

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.start.nbytes + self.heads.nbytes + self.kinds.nbytes

    def ends(self, part: slice) -> tuple[IntArray, IntArray]:
        """Return tails and heads of a range of arcs."""
        first = int(np.searchsorted(self.start, part.start, side="right")) - 1
        last = int(np.searchsorted(self.start, part.stop, side="left"))
        bounds = np.clip(self.start[first : last + 1], part.start, part.stop)
        return np.repeat(np.arange(first, last), bounds[1:] - bounds[:-1]), self.heads[part].astype(np.int64)

    def of(self, kind: int) -> tuple[IntArray, IntArray]:
        """Return tails and heads of all arcs of one kind."""
        own = self.kinds == kind
        tails = np.repeat(np.arange(self.start.size - 1), np.diff(self.start))
        return tails[own], self.heads[own].astype(np.int64)


def blocks(size: int, each: int = 1) -> Iterator[slice]:
    """Yield consecutive ranges of ``size`` items with bounded work; an item is as much work as ``each`` arcs."""
    step = max(1, BLOCK // each)
    return (slice(begin, min(begin + step, size)) for begin in range(0, size, step))


class Quanta:
    """Column of costs in quanta, stored in the smallest unsigned integers that hold them."""

    def __init__(self, size: int) -> None:
        self.counts: Counts = np.zeros(size, np.uint16)

    def write(self, part: slice, counts: IntArray) -> None:
        """Write the costs of a range of arcs."""
        needed = np.min_scalar_type(int(counts.max(initial=0)))
        if needed.itemsize > self.counts.itemsize:
            self.counts = self.counts.astype(needed)
        self.counts[part] = counts


def table(columns: list[Counts], size: int) -> IntArray:
    """Return k columns (m,) of costs as one read-only table (m, k)."""
    costs = np.empty((size, len(columns)), np.int64)
    for part in blocks(size):
        for j, column in enumerate(columns):
            costs[part, j] = column[part]
    costs.setflags(write=False)
    return costs


# Without a tie-break, paths that turn needlessly could be returned. The first summed cost becomes cost * TIE_TURNS +
# turns, in a copy of the graph's costs that counts as memory of the graph.


TIE_TURNS = 2**18  # more turns than any path makes
COPIED = "costs were copied, to break ties by turns"


def graph_with_tie_break(graph: Graph, turned: NDArray[np.int8], spending: Spending) -> Graph | None:
    """Return the graph with the number of turns as a tie-break in its first summed cost.

    turned  (m,)  number of turns in each arc

    Returns None if no tie-break is needed, since a cost charges for every turn. Raises Exhausted at a limit.
    """
    columns = summed_columns(graph)
    if not columns or not turned.any() or any(_charges_every_turn(graph, j, turned) for j in columns):
        return None
    spending.check(COPIED, graph.costs.nbytes)
    costs, first = graph.costs.copy(), columns[0]
    for part in blocks(graph.arcs):
        costs[part, first] *= TIE_TURNS
        costs[part, first] += turned[part]
    costs.setflags(write=False)  # so that the graph does not copy them
    try:
        broken = replace(graph, costs=costs)
    except GraphError:  # sums would overflow: the graph is too large for a tie-break
        return None
    spending.hold(costs.nbytes, COPIED)
    return broken


def summed_columns(graph: Graph) -> list[int]:
    """Return the columns of the costs that are sums."""
    return [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum"]


def _charges_every_turn(graph: Graph, column: int, turned: NDArray[np.int8]) -> bool:
    """Return whether a cost charges for every arc that turns."""
    return not any(((graph.costs[part, column] == 0) & (turned[part] > 0)).any() for part in blocks(graph.arcs))


# Each motion of a chain is costed and checked for collisions; costs are added up, or the worst is taken, and rounded
# once for the chain. A leg that a chain does not need has no motion.


NODES = 2**31  # more than a graph has
REACHED = 1e-6  # m or rad: largest difference of a chain's end from the state that it should reach


@dataclass(frozen=True, eq=False)
class MotionChains:
    """Chains (C,) of motions between nodes: each is a sequence of legs of the same kinds, some of them absent.

    graph         graph with the model and world for collision checks
    tails, heads  (C,)  nodes
    kinds         kind of motion of each leg
    corners       states (C,) before the first leg and after each leg
    present       mask (C,) for each leg: False if the leg is absent
    """

    graph: TrajectoryGraph
    tails: IntArray
    heads: IntArray
    kinds: tuple[str, ...]
    corners: tuple[States, ...]
    present: tuple[BoolArray, ...]

    @classmethod
    def connecting(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> MotionChains:
        """Return the chains from states a (C,) to b (C,), free or not; a NaN in b stands for any value."""
        kinds, corners, present = zip(*graph.model.connect(a, b), strict=True)
        if unknown := set(kinds) - graph.model.laws.keys():
            raise ModelError(f"connect leads by {sorted(unknown)}; this model has the laws {sorted(graph.model.laws)}")
        return cls(graph, tails, heads, kinds, (a, *corners), present)

    @classmethod
    def between(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> MotionChains:
        """Return only those chains from states a (C,) to b (C,) that are free of collisions and reach b."""
        chains = cls.connecting(graph, tails, heads, a, b)
        return chains.take(np.flatnonzero(chains.free() & chains.reach(b)))

    @classmethod
    def all_of(cls, parts: Sequence[MotionChains]) -> MotionChains:
        """Return the chains of several parts, concatenated."""
        corners = [
            States(**{name: np.concatenate([getattr(s, name) for s in states]) for name in states[0].names})
            for states in zip(*(part.corners for part in parts), strict=True)
        ]
        return cls(
            parts[0].graph,
            np.concatenate([part.tails for part in parts]),
            np.concatenate([part.heads for part in parts]),
            parts[0].kinds,
            tuple(corners),
            tuple(np.concatenate(columns) for columns in zip(*(part.present for part in parts), strict=True)),
        )

    def take(self, rows: IntArray) -> MotionChains:
        """Return some of the chains, by rows."""
        return MotionChains(
            self.graph,
            self.tails[rows],
            self.heads[rows],
            self.kinds,
            tuple(states.take(rows) for states in self.corners),
            tuple(present[rows] for present in self.present),
        )

    def rows(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the rows (N,) of the chains between nodes; such chains must exist."""
        keys, wanted = self.tails * NODES + self.heads, tails * NODES + heads
        ranked = np.argsort(keys, kind="stable")
        return ranked[np.searchsorted(keys[ranked], wanted)]

    def count(self, kinds: Sequence[str]) -> IntArray:
        """Return the number of motions of the given kinds in each chain, (C,)."""
        number = np.zeros(self.tails.size, np.int64)
        for kind, present in zip(self.kinds, self.present, strict=True):
            number += present & (kind in kinds)
        return number

    def motions(self) -> Iterator[tuple[IntArray, Motions]]:
        """Yield, leg by leg, the rows of the chains that have this leg, and its motions."""
        graph = self.graph
        for i, kind in enumerate(self.kinds):
            rows = np.flatnonzero(self.present[i])
            start, end = (self.corners[j].take(rows) for j in (i, i + 1))
            yield rows, Motions(graph.world, graph.model, graph.model.laws[kind], start, end)

    def free(self) -> BoolArray:
        """Mark the chains (C,) that are free of collisions all along."""
        free = self.graph.collision.states_free(self.corners[0])
        for rows, motions in self.motions():
            free[rows] &= self.graph.collision.motions_free(motions)
        return free

    def reach(self, states: States) -> BoolArray:
        """Mark the chains (C,) that end in states (C,); coordinates that are NaN match any value."""
        off = self.graph.model.space.differences(states, self.corners[-1]).values()
        return np.asarray(~np.any([np.abs(column) > REACHED for column in off], axis=0))

    def costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (C, k) of the chains in quanta, rounded once per chain."""
        costs = np.zeros((self.tails.size, len(criteria)))
        for rows, motions in self.motions():
            for j, criterion in enumerate(criteria):
                paid = motion_costs(criterion, motions)
                worst = criterion.aggregate == "max"
                costs[rows, j] = np.maximum(costs[rows, j], paid) if worst else costs[rows, j] + paid
        return np.stack([quantised(costs[:, j], criterion) for j, criterion in enumerate(criteria)], axis=1)

    def stretches(self, sizes: IntArray) -> Stretches:
        """Join consecutive chains to n parts of trajectories, which are not yet checked.

        sizes  (n,)  number of chains of each part; a chain begins where the previous one ends, up to whole turns
        """
        some = sizes > 0
        first = (np.cumsum(sizes) - sizes)[some]
        kept = np.stack([np.zeros(self.tails.size, dtype=np.bool_), *self.present], axis=1)
        kept[first, 0] = True
        space, columns = self.graph.model.space, dict[str, np.ndarray]()
        for name in space.names:
            column = np.stack([getattr(corner, name) for corner in self.corners], axis=1)
            if name in space.turning:
                turns = np.zeros(self.tails.size)
                turns[1:] = np.round((column[:-1, -1] - column[1:, 0]) / (2 * np.pi))
                turns[first] = 0.0
                turns = np.cumsum(turns)
                turns -= np.repeat(turns[first], sizes[some])
                column[turns != 0.0] += 2 * np.pi * turns[turns != 0.0, None]
            columns[name] = column[kept]
        numbers = [self.graph.kinds.index(kind) for kind in self.kinds]
        kinds = np.broadcast_to([0, *numbers], kept.shape)[kept]
        owner = np.repeat(np.arange(sizes.size), sizes)
        lengths = np.bincount(owner, kept.sum(axis=1), minlength=sizes.size).astype(np.int64)
        return Stretches(States(**columns), kinds, lengths)
