"""Arcs of graphs: how they are sorted and costed, arcs that are chains of several motions, and ties between paths."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import GraphError, ModelError
from hpop.motions import Motions, States, is_curve, laws_of
from hpop.planners.graphs.trajectory_graph import Stretches
from hpop.planners.objectives import quantised
from hpop.planners.spending import Spending
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.planners.graphs.trajectory_graph import TrajectoryGraph

# To save memory, only three things are stored for every arc: its head, its kind, and one small integer for each cost.


Counts: TypeAlias = NDArray[np.unsignedinteger[Any]]
MOVE = 0  # index of the kind of motion that changes the position; motions of all other kinds stay in place
BLOCK = 1 << 16  # arcs in a block: small enough for the processor's cache, and such that every core gets some blocks


class Arcs(NamedTuple):
    """All m arcs of a graph with n states, sorted by the state that they leave (tail).

    Of the arcs that leave a state, those that stay in place come first.

    start  (n + 1,)  the arcs that leave state u have the indices start[u] to start[u + 1] - 1
    heads  (m,)      int32, state to which each arc leads
    kinds  (m,)      uint8, kind of motion of each arc, as an index into the graph's ``kinds``; 0 is a move
    """

    start: IntArray
    heads: NDArray[np.int32]
    kinds: NDArray[np.uint8]

    @classmethod
    def sorted(cls, size: int, edges: Sequence[tuple[IntArray, IntArray]]) -> Arcs:
        """Return the arcs of a graph with ``size`` states, sorted.

        edges  for each kind of motion, moves first: the tails and the heads of its arcs
        """
        kinds = [*range(1, len(edges)), MOVE]
        tails, heads = (np.concatenate([edges[kind][side] for kind in kinds]) for side in (0, 1))
        order = np.argsort(tails, kind="stable")
        start = np.zeros(size + 1, np.int64)
        np.cumsum(np.bincount(tails, minlength=size), out=start[1:])
        of_kind = np.repeat(np.array(kinds, np.uint8), [edges[kind][0].size for kind in kinds])
        return cls(start, heads[order].astype(np.int32), of_kind[order]).frozen()

    def frozen(self) -> Arcs:
        """Make the arrays read-only, so that a search graph can use them without a copy; return the arcs."""
        for array in self:
            array.setflags(write=False)
        return self

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, in bytes."""
        return self.start.nbytes + self.heads.nbytes + self.kinds.nbytes

    def ends(self, part: slice) -> tuple[IntArray, IntArray]:
        """Return the tails and the heads of the arcs in a range of indices."""
        first = int(np.searchsorted(self.start, part.start, side="right")) - 1
        last = int(np.searchsorted(self.start, part.stop, side="left"))
        bounds = np.clip(self.start[first : last + 1], part.start, part.stop)
        return np.repeat(np.arange(first, last), bounds[1:] - bounds[:-1]), self.heads[part].astype(np.int64)

    def of(self, kind: int) -> tuple[IntArray, IntArray]:
        """Return the tails and the heads of all arcs of one kind, given by its index."""
        own = self.kinds == kind
        tails = np.repeat(np.arange(self.start.size - 1), np.diff(self.start))
        return tails[own], self.heads[own].astype(np.int64)


def blocks(size: int, each: int = 1) -> Iterator[slice]:
    """Divide ``size`` items into consecutive ranges of limited work; an item is as much work as ``each`` arcs."""
    step = max(1, BLOCK // each)
    return (slice(begin, min(begin + step, size)) for begin in range(0, size, step))


class Quanta:
    """Integer costs of all arcs by one criterion, stored in the smallest unsigned type that is large enough."""

    def __init__(self, size: int) -> None:
        self.counts: Counts = np.zeros(size, np.uint16)

    def write(self, part: slice, counts: IntArray) -> None:
        """Write the costs of a range of arcs; switch to a larger type if they do not fit."""
        needed = np.min_scalar_type(int(counts.max(initial=0)))
        if needed.itemsize > self.counts.itemsize:
            self.counts = self.counts.astype(needed)
        self.counts[part] = counts


def table(columns: list[Counts], size: int) -> IntArray:
    """Join k columns of costs into one read-only array (size, k), with a row for each of ``size`` arcs."""
    costs = np.empty((size, len(columns)), np.int64)
    for part in blocks(size):
        for j, column in enumerate(columns):
            costs[part, j] = column[part]
    costs.setflags(write=False)
    return costs


# Of paths with equal costs, a search may return one that turns needlessly. To avoid this, it runs on a copy of the
# graph, in which the first cost that is a sum is replaced by cost * TIE_TURNS + turns.


TIE_TURNS = 2**18  # more turns than any path makes
COPIED = "costs were copied, to prefer paths with fewer turns"


def graph_with_tie_break(graph: Graph, turned: NDArray[np.int8], spending: Spending) -> Graph | None:
    """Return a copy of a graph on which searches prefer, among paths with equal costs, those with fewer turns.

    The turns are added as the least significant part of the first cost that is a sum. Returns None if this is not
    needed, because no arc turns or some cost that is a sum is positive for every turn. Returns None also if it is not
    possible, because no cost is a sum or sums would overflow.

    turned  (m,)  number of turns in each arc
    spending  account to which the memory of the copy is charged

    Raises Exhausted if the memory limit is passed.
    """
    columns = summed_columns(graph)
    if not columns or not turned.any() or any(_charges_every_turn(graph, j, turned) for j in columns):
        return None
    spending.check(COPIED, graph.distinct_costs.nbytes)
    try:
        broken = _with_ties_broken(graph, turned, columns[0])
    except GraphError:  # sums would overflow: the graph is too large for a tie-break
        return None
    spending.hold(broken.distinct_costs.nbytes, COPIED)
    return broken


def _with_ties_broken(graph: Graph, turned: NDArray[np.int8], column: int) -> Graph:
    """Return a graph with cost * TIE_TURNS + turns in ``column``; if it has layers, they share these costs."""
    if graph.layers > 1:
        costs = graph.added.costs.copy()
        costs[:, column] = costs[:, column] * TIE_TURNS + turned[graph.added.places]
        tails = np.searchsorted(graph.indptr, graph.added.places, side="right") - 1
        arcs = tails, graph.added.heads.astype(np.int64), costs
        layer = _with_ties_broken(graph.layer, _turned_in_base(graph, turned), column)
        return copied(layer.extended(graph.nodes, *arcs, is_reused=True, layers=graph.layers), turns=graph.turns)
    costs = graph.costs.copy()
    for part in blocks(graph.arcs):
        costs[part, column] *= TIE_TURNS
        costs[part, column] += turned[part]
    costs.setflags(write=False)  # so that the graph does not copy them
    return replace(graph, costs=costs)


def _turned_in_base(graph: Graph, turned: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the numbers of turns in the arcs of the graph's base, which it repeats in its layers.

    turned  (m,)  numbers of turns in all arcs of the graph
    """
    return np.delete(turned, graph.added.places)[: (turned.size - graph.added.before.size) // graph.layers]


def summed_columns(graph: Graph) -> list[int]:
    """Return the columns of those costs of a graph that add up along a path (the others take the worst arc)."""
    return [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum"]


def _charges_every_turn(graph: Graph, column: int, turned: NDArray[np.int8]) -> bool:
    """Return whether the cost of a column is positive for every arc with a turn; ``turned`` (m,) counts turns."""
    if graph.base is None:
        return not any(((graph.cost(column, part) == 0) & (turned[part] > 0)).any() for part in blocks(graph.arcs))
    added, cache, name = graph.added, graph.base.cache, ("charges every turn", column)
    if name not in cache:
        cache[name] = _charges_every_turn(graph.base, column, _turned_in_base(graph, turned))
    charged: BoolArray = (added.costs[:, column] > 0) | (turned[added.places] == 0)
    return cache[name] and bool(charged.all())


# Chains of motions as single arcs. Every motion of a chain is checked for collisions and costed. The costs are added
# up, or the worst is taken, and the result is rounded once for each chain.


REACHED = 1e-6  # m or rad: largest difference of a chain's end from the state that it should reach


@dataclass(frozen=True, eq=False)
class MotionChains:
    """C chains of motions, each of which is one arc between two nodes of a graph.

    All chains have the same sequence of legs, such as turn, move, turn; a chain may skip some of them. Several chains
    may connect the same two nodes, if each has another choice of speed and turn rate.

    graph         graph with the model and world for collision checks
    tails, heads  (C,)  nodes at which each chain begins and ends
    kinds         kind of motion of each leg, such as ("turn", "move", "turn")
    corners       states (C,) before the first leg and after each leg
    present       for each leg a mask (C,): False for the chains that skip this leg
    choices       (C,)  number of each chain's choice of speed and turn rate; 0 for the fastest
    """

    graph: TrajectoryGraph
    tails: IntArray
    heads: IntArray
    kinds: tuple[str, ...]
    corners: tuple[States, ...]
    present: tuple[BoolArray, ...]
    choices: IntArray

    @classmethod
    def connecting(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> MotionChains:
        """Return the chains by which the model drives from states a (C,) to b (C,), not checked for collisions.

        A coordinate of b that is NaN may have any value at the end.

        tails, heads  (C,)  nodes of a and b
        """
        return graph.driven(cls._connecting(graph, tails, heads, a, b))

    @classmethod
    def _connecting(
        cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States
    ) -> MotionChains:
        """Return the chains of :meth:`connecting`, but without any changes of speed."""
        kinds, corners, present = zip(*graph.model.connect(a, b), strict=True)
        if unknown := set(kinds) - graph.model.laws.keys():
            raise ModelError(
                f"the model's method connect must use only kinds of motion that are in its laws, "
                f"{sorted(graph.model.laws)}, got {sorted(unknown)}; add these to the laws"
            )
        return cls(graph, tails, heads, kinds, (a, *corners), present, np.zeros(tails.size, np.int64))

    @classmethod
    def between(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> MotionChains:
        """Return the chains of :meth:`connecting` that are free of collisions and do reach b; leave out the others.

        They are returned in each choice of speed and turn rate that the graph has for chains.
        """
        chains = cls._connecting(graph, tails, heads, a, b)
        fastest = graph.driven(chains)
        return graph.in_choices(chains.take(np.flatnonzero(fastest.free() & fastest.reach(b))))

    @classmethod
    def all_of(cls, parts: Sequence[MotionChains]) -> MotionChains:
        """Concatenate several sets of chains with the same legs."""
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
            np.concatenate([part.choices for part in parts]),
        )

    def take(self, rows: IntArray) -> MotionChains:
        """Return the chains with the given indices."""
        return MotionChains(
            self.graph,
            self.tails[rows],
            self.heads[rows],
            self.kinds,
            tuple(states.take(rows) for states in self.corners),
            tuple(present[rows] for present in self.present),
            self.choices[rows],
        )

    def rows(self, tails: IntArray, heads: IntArray, choices: IntArray) -> IntArray:
        """Return the indices (N,) of the chains from ``tails`` (N,) to ``heads`` (N,) with these choices (N,).

        There must be such chains.
        """
        nodes = 1 + max(int(column.max(initial=0)) for column in (self.tails, self.heads))
        keys = (self.choices * nodes + self.tails) * nodes + self.heads
        ranked = np.argsort(keys, kind="stable")
        return ranked[np.searchsorted(keys[ranked], (choices * nodes + tails) * nodes + heads)]

    def count(self, kinds: Sequence[str]) -> IntArray:
        """Return the number (C,) of motions of the given kinds in each chain."""
        number = np.zeros(self.tails.size, np.int64)
        for kind, present in zip(self.kinds, self.present, strict=True):
            number += present & (kind in kinds)
        return number

    def motions(self) -> Iterator[tuple[IntArray, Motions]]:
        """Yield for each leg the indices of the chains that do not skip it, and their motions on this leg."""
        graph, laws = self.graph, laws_of(self.graph.model)
        for i, kind in enumerate(self.kinds):
            rows, turns = np.flatnonzero(self.present[i]), None
            start, end = (self.corners[j].take(rows) for j in (i, i + 1))
            if is_curve(laws[kind]):
                turns = self._ended_turns[0, i, rows], self._ended_turns[1, i, rows]
            yield rows, Motions(graph.world, graph.model, graph.model.laws[kind], start, end, turns=turns)

    @cached_property
    def _ended_turns(self) -> FloatArray:
        """Signed rotations (2, legs, C), rad, of the turns along curves that end in each motion, 0 for none.

        They are those of :attr:`Trajectory.turns` if no turn begins before a chain or goes on after it.
        """
        laws, size = laws_of(self.graph.model), self.tails.size
        ended = np.zeros((2, len(self.kinds), size))
        turning, leg, second_slot, stops = np.zeros(size), np.zeros(size, int), np.zeros(size, int), np.ones(size, bool)
        for i, kind in enumerate(self.kinds):
            rows, law = np.flatnonzero(self.present[i]), laws[kind]
            if not is_curve(law) or not rows.size:
                stops[rows] = True
                continue
            ends = self.corners[i].take(rows), self.corners[i + 1].take(rows)
            first, second = law.bends(*ends)
            new = rows[stops[rows] | (turning[rows] * first <= 0.0)]
            ended[second_slot[new], leg[new], new] = turning[new]
            turning[new] = 0.0
            turning[rows] += first
            two = second != 0.0
            ended[0, i, rows[two]] = turning[rows[two]]
            turning[rows[two]] = second[two]
            leg[rows], second_slot[rows], stops[rows] = i, two, law.ends_turn(*ends)
        ended[second_slot, leg, np.arange(size)] = turning
        return ended

    def free(self) -> BoolArray:
        """Return which chains (C,) are free of collisions from beginning to end."""
        free = self.graph.collision.states_free(self.corners[0])
        for rows, motions in self.motions():
            free[rows] &= self.graph.collision.motions_free(motions)
        return free

    def reach(self, states: States) -> BoolArray:
        """Return which chains (C,) end in the given states (C,); a NaN coordinate matches any value."""
        off = self.graph.model.space.differences(states, self.corners[-1]).values()
        return np.asarray(~np.any([np.abs(column) > REACHED for column in off], axis=0))

    def costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (C, k) of the chains in quanta of the criteria, rounded up once for each chain."""
        costs = np.zeros((self.tails.size, len(criteria)))
        for rows, motions in self.motions():
            for j, criterion in enumerate(criteria):
                paid = motion_costs(criterion, motions)
                worst = criterion.aggregate == "max"
                costs[rows, j] = np.maximum(costs[rows, j], paid) if worst else costs[rows, j] + paid
        return np.stack([quantised(costs[:, j], criterion) for j, criterion in enumerate(criteria)], axis=1)

    def stretches(self, sizes: IntArray) -> Stretches:
        """Join consecutive chains to n parts of trajectories, which are not yet checked for impossible motions.

        Within a part, each chain must begin where the previous one ends; angles may differ by whole turns, which are
        then added. The chains of part 0 come first, then those of part 1, and so on.

        sizes  (n,)  number of chains of each part
        """
        some = sizes > 0
        first = (np.cumsum(sizes) - sizes)[some]
        kept = np.stack([np.zeros(self.tails.size, dtype=np.bool_), *self.present], axis=1)
        kept[first, 0] = True
        space, columns = self.graph.model.space, dict[str, np.ndarray]()
        for name in dict.fromkeys((*space.names, *self.corners[0].names)):
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
