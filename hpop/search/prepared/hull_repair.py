"""Joint bounds that are made right again where arcs are closed, and nowhere else.

A layer of a hull (:mod:`.staircase.turn_hull`) has the least weighted rests with so many turns. Where an arc is closed,
only nodes whose best way takes it may have to go farther; which arcs these ways take is kept with the layers. So layer
after layer these nodes are marked, and their rests are made anew from what is right already: the layer of one turn
less, and the rests of nodes ahead. Whatever is marked, what is made is a lower bound, and none becomes less. What it
was before is kept: where arcs are opened again, it comes back, and what is still closed is looked at anew.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.compiled import lean
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.staircase.turn_hull import DOWN, FAR, LANES, MOST_STEPS, STEP_BITS, UP, IntLanes, Steps, TurnHull

ALL = np.uint8(2**LANES - 1)


class Hulled(NamedTuple):
    """What a hull was made of, as kernels read it; nodes and plain arcs (m,) are in the order of the groups and chains.

    tails, heads     (m,)
    first, rest      (m,)  costs, of the first and the rest cost
    least            (2, n)  least rests of these costs when the hull was made
    groups, alike    of :class:`.Groups`; group (n,) of each node
    turn_first, turn_rest  costs of turns: of groups where alike, else of pairs
    weights          (LANES, 2)
    is_target        (n,)
    """

    tails: IntArray
    heads: IntArray
    first: IntArray
    rest: IntArray
    least: IntArray
    groups: IntArray
    group: NDArray[np.int32]
    alike: bool
    turn_first: IntArray
    turn_rest: IntArray
    weights: FloatArray
    is_target: BoolArray


class HullRepair:
    """A hull, and which arcs are closed of it."""

    def __init__(
        self,
        hull: TurnHull,
        groups: Groups,
        costs: IntArray,
        columns: tuple[int, int],
        least: IntArray,
        is_target: BoolArray,
    ) -> None:
        """Of a graph with costs (m, k); columns are of its first and its rest cost, least (k, n) its least rests."""
        self.hull, self.columns = hull, columns
        places = np.empty(len(hull.step), np.int64)  # of plain arcs, in the order of the chains
        places[hull.step] = np.arange(len(hull.step))
        self.arcs = groups.origin[places].astype(np.int64)
        tails = np.repeat(np.arange(len(groups.nodes)), np.diff(groups.start))
        alike = bool(groups.alike[list(columns)].all())
        turns = np.ascontiguousarray(groups.dearest.T) if alike else groups.turns
        self.tables = Hulled(
            tails[places],
            groups.heads[places].astype(np.int64),
            costs[self.arcs, columns[0]],
            costs[self.arcs, columns[1]],
            np.ascontiguousarray(least[list(columns)][:, groups.nodes]),
            groups.rows,
            np.repeat(np.arange(len(groups.rows), dtype=np.int32), groups.rows[:, SIZE]),
            alike,
            turns[columns[0]],
            turns[columns[1]],
            hull.weights,
            is_target[groups.nodes],
        )
        self.closed = np.zeros(len(self.arcs), np.bool_)
        self.kept: list[tuple[int, IntArray, Steps]] = []  # layer, nodes, their steps before
        self.bits: list[tuple[int, IntArray, NDArray[np.uint8]]] = []  # layer, arcs, which lanes take them

    @property
    def memory(self) -> int:
        """Bytes of all that is kept."""
        kept = [*self.tables, self.arcs, self.closed, *(part for each in (*self.kept, *self.bits) for part in each)]
        return sum(array.nbytes for array in kept if isinstance(array, np.ndarray))

    def close(self, closed: BoolArray, clock: Clock) -> None:
        """Make the hull that of the graph without some arcs (m,)."""
        now = closed[self.arcs]
        if (self.closed & ~now).any():
            self._restore()
        new = now & ~self.closed
        if new.any():
            self._remake(new, now, clock)
        self.closed = now

    def _restore(self) -> None:
        """The hull as it was made."""
        for layer, nodes, steps in reversed(self.kept):
            self.hull.layers[layer, nodes] = steps
        for layer, arcs, bits in reversed(self.bits):
            self.hull.moved[layer, arcs] = bits
        self.kept, self.bits = [], []
        self.closed = np.zeros(len(self.closed), np.bool_)

    def _remake(self, new: BoolArray, closed: BoolArray, clock: Clock) -> None:
        """Layer after layer, with some arcs closed that are new."""
        layers, tables = self.hull.layers, self.tables
        before = np.zeros(layers.shape[1], np.uint8)
        now = np.empty((layers.shape[1], LANES), np.int32)
        for m in range(len(layers)):
            last = m == len(layers) - 1
            moved = np.zeros(len(new), np.uint8) if last else self.hull.moved[m]
            marks = before if last else np.zeros_like(before)
            if not last:
                clock.call(mark, tables, moved, new, before, marks)
            nodes = np.flatnonzero(marks)
            if nodes.size:
                arcs = np.flatnonzero(marks[tables.tails])
                self.kept.append((m, nodes, layers[m, nodes]))
                if not last:
                    self.bits.append((m, arcs, moved[arcs]))
                clock.call(remake, tables, layers, m, last, moved, closed, marks, nodes, arcs, now)
            before = marks


@lean
def mark(
    tables: Hulled, moved: NDArray[np.uint8], new: BoolArray, before: NDArray[np.uint8], marks: NDArray[np.uint8]
) -> None:
    """Mark the lanes (n,) in which best ways take closed arcs; `before` those with a turn less; `marks` are 0 before.

    moved  (m,)  in which lanes this layer is better by each arc than the one before
    """
    for g in range(len(tables.groups)):
        begin = tables.groups[g, OFFSET]
        bits = np.uint8(0)
        for u in range(begin, begin + tables.groups[g, SIZE]):
            bits |= before[u]
        if bits:
            for u in range(begin, begin + tables.groups[g, SIZE]):
                marks[u] = bits
    for i in range(len(moved)):  # not by a turn, but by an arc
        marks[tables.tails[i]] &= ~moved[i]
    for i in range(len(moved)):
        hit = ALL if new[i] else marks[tables.heads[i]]
        marks[tables.tails[i]] |= hit & moved[i]


@lean
def weighed(weights: FloatArray, k: int, first: int, rest: int) -> int:
    """What two costs weigh, rounded down."""
    return int(min(FAR - 1.0, (weights[k, 0] * first + weights[k, 1] * rest) * DOWN))


@lean
def rest_of(tables: Hulled, steps: Steps, v: int, k: int) -> int:
    """The weighted rest of the way from a node in a layer; no more than it was before it was rounded."""
    first, rest = tables.least[0, v], tables.least[1, v]
    least = (tables.weights[k, 0] * first + tables.weights[k, 1] * rest) * DOWN - 2.0
    return int(min(float(FAR), max(0.0, least) + (np.int64(steps[v, k]) << STEP_BITS)))


@lean
def turn_from(
    tables: Hulled, steps: Steps, marks: NDArray[np.uint8], within: bool, now: IntLanes, nodes: IntArray
) -> bool:
    """Stay or turn, from the steps of a layer; `within` it, from what is already made anew of it. Whether it helped."""
    better = False
    for v in nodes:
        g = np.int64(tables.group[v])
        begin, size = tables.groups[g, OFFSET], tables.groups[g, SIZE]
        for u in range(begin, begin + size):
            if u == v and within:
                continue
            t = g if tables.alike else tables.groups[g, TURNS] + (v - begin) * size + u - begin
            for k in range(LANES):
                rest = np.int64(now[u, k]) if within and marks[u] else rest_of(tables, steps, u, k)
                if u != v:
                    rest += weighed(tables.weights, k, tables.turn_first[t], tables.turn_rest[t])
                if rest < now[v, k]:
                    now[v, k] = rest
                    better = True
    return better


@lean
def move_on(
    tables: Hulled,
    steps: Steps,
    marks: NDArray[np.uint8],
    closed: BoolArray,
    moved: NDArray[np.uint8],
    arcs: IntArray,
    now: IntLanes,
) -> bool:
    """Move straight on by open arcs, of which (a,) begin at nodes that are marked; tells whether it helped."""
    better = False
    for i in arcs:
        if closed[i]:
            continue
        v, u = tables.tails[i], tables.heads[i]
        bits = np.uint8(0)
        for k in range(LANES):
            rest = np.int64(now[u, k]) if marks[u] else rest_of(tables, steps, u, k)
            rest += weighed(tables.weights, k, tables.first[i], tables.rest[i])
            if rest < now[v, k]:
                now[v, k] = rest
                bits |= np.uint8(1 << k)
        moved[i] = bits
        if bits:
            better = True
    return better


@lean
def remake(
    tables: Hulled,
    layers: Steps,
    m: int,
    last: bool,
    moved: NDArray[np.uint8],
    closed: BoolArray,
    marks: NDArray[np.uint8],
    nodes: IntArray,
    arcs: IntArray,
    now: IntLanes,
) -> None:
    """Make a layer anew at the nodes (a,) that are marked, from which arcs (b,) lead; the last has any number of turns.

    now  (n, LANES)  room
    """
    for i in arcs:
        moved[i] = 0
    for v in nodes:
        for k in range(LANES):
            now[v, k] = 0 if tables.is_target[v] else FAR
    if m > 0:
        turn_from(tables, layers[m - 1], marks, False, now, nodes)
    move_on(tables, layers[m], marks, closed, moved, arcs, now)
    better = last
    while better:
        better = turn_from(tables, layers[m], marks, True, now, nodes)
        better |= move_on(tables, layers[m], marks, closed, moved, arcs, now)
    for v in nodes:
        first, rest = tables.least[0, v], tables.least[1, v]
        for k in range(LANES):
            least = min(float(FAR), np.ceil((tables.weights[k, 0] * first + tables.weights[k, 1] * rest) * UP))
            more = max(np.int64(0), np.int64(now[v, k]) - np.int64(least)) >> STEP_BITS
            layers[m, v, k] = max(layers[m, v, k], np.uint16(min(more, np.int64(MOST_STEPS))))
