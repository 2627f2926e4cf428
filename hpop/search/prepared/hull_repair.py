"""Repair of joint bounds after arcs were closed: only bounds that change are computed again.

A hull of joint bounds (:mod:`.staircase.turn_hull`) has a layer for each number of turns. The layer holds the least
weighted remaining costs of each node, for LANES weight vectors (lanes), and the arcs that the best paths take. Plain
arcs are arcs that are no turns; they are in chain order, each after the next arc of its straight run (chain). When an
arc is closed, only nodes with a best path through it are affected. Layer after layer, these nodes are marked, and their
values are computed again from repaired ones: from the layer with one turn less, and from the next nodes of paths. The
results are always lower bounds, and none decreases. Old values are stored. When arcs are opened again, the old values
are restored, and arcs that are still closed are processed again. A repair may stop after any layer, and continue later.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.slices import DeadlineClock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.staircase.turn_hull import DOWN, FAR, LANES, MOST_STEPS, STEP_BITS, UP, IntLanes, Steps, TurnHull

ALL = np.uint8(2**LANES - 1)
LAYER, LAST = 120e-9, 600e-9  # s for each node of a layer, and of the last one, which allows any number of turns
Places = NDArray[np.int32]


class HullTables(NamedTuple):
    """Tables from which kernels repair a hull: nodes in the order of groups, plain arcs in chain order.

    Chain order is that of :class:`.staircase.tables.ArcChains`: each arc comes after the next arc of its straight run.

    tails, heads           (m,)    nodes of each plain arc
    first, rest            (m,)    first and rest cost of each plain arc
    least                  (2, n)  least remaining first and rest cost of each node when the hull was computed
    groups, alike                  ``rows`` of :class:`.Groups`; whether all turns within each group cost the same
    group                  (n,)    group of each node
    turn_first, turn_rest          first and rest cost of turns, one per group if alike, else one per pair of nodes
    weights                (LANES, 2)  weights of the two costs
    is_target              (n,)    mask of nodes
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
    """A hull of joint bounds (:mod:`.staircase.turn_hull`) that can be repaired for closed arcs and restored.

    arcs          (m,)  indices in the graph of the plain arcs, in chain order
    closed        (m,)  plain arcs that are closed in the repaired layers
    turns_closed  (g,)  groups with closed turns in the repaired layers
    """

    def __init__(
        self,
        hull: TurnHull,
        groups: Groups,
        costs: IntArray,
        columns: tuple[int, int],
        least: IntArray,
        is_target: BoolArray,
    ) -> None:
        """Build the tables for repairs of ``hull``.

        costs      (m, k)  costs of the graph's arcs
        columns            columns of the first and the third cost of the search
        least      (k, n)  least remaining costs with which the hull was computed
        is_target  (n,)    mask of the graph's nodes
        """
        self.hull, self.columns = hull, columns
        reaching = np.flatnonzero(least[columns[0], groups.nodes[groups.heads]] < UNREACHABLE)  # as a search lists them
        plain_arcs = np.empty_like(reaching)  # of plain arcs, sorted along chains
        plain_arcs[hull.step] = reaching
        self.arcs = groups.origin[plain_arcs].astype(np.int64)
        tails = np.repeat(np.arange(len(groups.nodes)), np.diff(groups.start))
        alike = bool(groups.alike[list(columns)].all())
        turns = np.ascontiguousarray(groups.dearest.T) if alike else groups.turns
        self.tables = HullTables(
            tails[plain_arcs],
            groups.heads[plain_arcs].astype(np.int64),
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
        self.turns_closed = np.zeros(len(groups.rows), np.bool_)
        self.old_steps: list[tuple[int, Places, Steps]] = []  # layer, nodes, their old steps
        self.bits: list[tuple[int, Places, NDArray[np.uint8]]] = []  # layer, arcs, old masks of their lanes
        self.new = self.closed  # newly closed arcs of an unfinished repair
        self.layer = 0  # next layer to repair
        self.marks: NDArray[np.uint8] | None = None  # marked lanes of the previous layer; None after a complete repair

    def arrays(self) -> list[np.ndarray[Any, Any]]:
        """Return all arrays that this object owns, without views of other arrays, to count their bytes."""
        arrays: list[Any] = [*self.tables, self.arcs, self.closed, self.turns_closed, self.new, self.marks]
        arrays += [part for each in (*self.old_steps, *self.bits) for part in each]
        return [array for array in arrays if isinstance(array, np.ndarray) and array.base is None]

    def is_up_to_date(self, closed: BoolArray, turns_closed: BoolArray) -> bool:
        """Return whether all layers are repaired for the closed arcs of the graph, a mask ``closed`` of all its arcs.

        ``turns_closed`` (g,) marks groups with closed turns. A newly closed turn needs no repair; one that opens does.
        """
        same = (self.closed == closed[self.arcs]).all() and not (self.turns_closed & ~turns_closed).any()
        return self.marks is None and bool(same)

    def close(self, closed: BoolArray, turns_closed: BoolArray, clock: DeadlineClock) -> bool:
        """Repair the hull for closed arcs, layer after layer; return False if time runs out, else True.

        ``closed`` is a mask of all arcs of the graph, and ``turns_closed`` (g,) marks groups with closed turns.
        Repaired values may depend on these turns, so old values are restored when the turns open. Layers that are not
        repaired yet are for a graph with fewer closed arcs, so they are lower bounds too. The next call continues with
        them.
        """
        now = closed[self.arcs]
        if (
            (self.closed & ~now).any()
            or (self.turns_closed & ~turns_closed).any()
            or (self.marks is not None and (self.closed != now).any())
        ):
            self._restore()
        new = now & ~self.closed
        if self.marks is None and not new.any():
            return True
        self.turns_closed |= turns_closed
        if self.marks is None:
            self.layer, self.marks, self.new = 0, np.zeros(self.hull.layers.shape[1], np.uint8), new
        self.closed = now
        while self.layer < len(self.hull.layers):
            if not self._repair_layer(self.layer, self.marks, clock):
                return False
            self.layer += 1
        self.marks = None
        return True

    def _restore(self) -> None:
        """Restore the joint bounds to their values with all arcs open."""
        for layer, nodes, steps in reversed(self.old_steps):
            self.hull.layers[layer, nodes] = steps
        for layer, arcs, bits in reversed(self.bits):
            self.hull.moved[layer, arcs] = bits
        self.old_steps, self.bits, self.marks = [], [], None
        self.closed, self.turns_closed = np.zeros_like(self.closed), np.zeros_like(self.turns_closed)

    def _repair_layer(self, m: int, before: NDArray[np.uint8], clock: DeadlineClock) -> bool:
        """Repair layer m; return False without a repair if the remaining time does not suffice.

        before  (n,)  for each node, the lanes (weight vectors) that changed in the previous layer, as bits
        """
        layers, tables = self.hull.layers, self.tables
        last = m == len(layers) - 1
        moved = np.zeros(len(self.new), np.uint8) if last else self.hull.moved[m]
        marks = before if last else np.zeros_like(before)
        if not last:
            clock.call(mark_affected_lanes, tables, moved, self.new, before, marks)
        nodes = np.flatnonzero(marks).astype(np.int32)
        if clock.remaining < (LAST if last else LAYER) * nodes.size:
            return False
        if nodes.size:
            arcs = np.flatnonzero(marks[tables.tails]).astype(np.int32)
            self.old_steps.append((m, nodes, layers[m, nodes]))
            if not last:
                self.bits.append((m, arcs, moved[arcs]))
            now = np.empty((len(before), LANES), np.int32)
            room = np.empty((1 + int(tables.groups[:, SIZE].max()), LANES), np.int32)
            fresh = np.ones((2, len(before)), np.uint8)
            clock.call(
                recompute_layer, tables, layers, m, last, moved, self.closed, marks, nodes, arcs, now, room, fresh
            )
        self.marks = marks
        return True


@lean
def mark_affected_lanes(
    tables: HullTables, moved: NDArray[np.uint8], new: BoolArray, before: NDArray[np.uint8], marks: NDArray[np.uint8]
) -> None:
    """Mark for each node the lanes (weight vectors) in which its best path in a layer uses a closed arc, as bits.

    moved   (m,)  for each arc, the lanes in which paths of this layer take it, as bits
    new     (m,)  newly closed arcs
    before  (n,)  marks of the previous layer, with one turn less
    marks   (n,)  output; 0 before the call
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
def write_remaining_costs(tables: HullTables, steps: Steps, v: int, rest: IntLanes, row: int) -> None:
    """Decode the weighted remaining costs of node v from a layer, and write them to `rest[row]` (LANES,).

    steps  (n, LANES)  the layer: excess over the least remaining costs, in 16-bit units
                       (:func:`.turn_hull.write_excess`)
    """
    first, last = np.float64(tables.least[0, v]), np.float64(tables.least[1, v])
    for k in range(LANES):
        least = (tables.weights[k, 0] * first + tables.weights[k, 1] * last) * DOWN - 2.0
        least = min(float(FAR), max(0.0, least))
        rest[row, k] = min(np.int32(FAR), np.int32(np.int32(least) + (np.int32(steps[v, k]) << np.int32(STEP_BITS))))


@lean
def improve_by_turns(
    tables: HullTables,
    steps: Steps,
    marks: NDArray[np.uint8],
    within: bool,
    now: IntLanes,
    nodes: Places,
    came: NDArray[np.uint8],
    turned: NDArray[np.uint8],
    rests: IntLanes,
    least: IntLanes,
) -> None:
    """Lower the weighted remaining costs `now` (n, LANES) of marked nodes by paths that begin with a turn.

    The value of the node itself in the layer `steps`, without another turn, counts as well.

    steps    (n, LANES)  layer in which paths continue after the turn, encoded
    marks    (n,)  not 0 for nodes that are under repair
    within   whether this is the layer under repair; the values of marked nodes are then in `now`
    nodes    the marked nodes
    came     (n,)  nodes that a plain arc improved; only their groups are processed; 0 after the call
    turned   (n,)  set to 1 for nodes that a turn improves
    rests    (g, LANES), least (1, LANES)  scratch; g is the number of nodes of the largest group
    """
    weights = tables.weights
    told, stays = np.int64(-1), False
    for v in nodes:
        g = np.int64(tables.group[v])
        begin, size = tables.groups[g, OFFSET], tables.groups[g, SIZE]
        if g != told:
            told, stays = g, True
            for i in range(size):
                stays &= came[begin + i] == 0
            for i in range(0 if stays else size):
                if within and marks[begin + i]:
                    for k in range(LANES):
                        rests[i, k] = now[begin + i, k]
                else:
                    write_remaining_costs(tables, steps, begin + i, rests, i)
        if stays:
            continue
        at = g if tables.alike else tables.groups[g, TURNS] + (v - begin) * size
        for k in range(LANES):
            least[0, k] = min(now[v, k], rests[v - begin, k])
        for i in range(size):
            if i == v - begin:
                continue
            t = at if tables.alike else at + i
            first, rest = np.float64(tables.turn_first[t]), np.float64(tables.turn_rest[t])
            for k in range(LANES):
                turn = np.int32(min(FAR - 1.0, (weights[k, 0] * first + weights[k, 1] * rest) * DOWN))
                least[0, k] = min(least[0, k], np.int32(rests[i, k] + turn))
        better = False
        for k in range(LANES):
            better |= least[0, k] < now[v, k]
            now[v, k] = least[0, k]
            if within:
                rests[v - begin, k] = least[0, k]
        if better:
            turned[v] = 1
    came[:] = 0


@lean
def improve_by_moves(
    tables: HullTables,
    steps: Steps,
    marks: NDArray[np.uint8],
    closed: BoolArray,
    moved: NDArray[np.uint8],
    arcs: Places,
    now: IntLanes,
    came: NDArray[np.uint8],
    turned: NDArray[np.uint8],
    rests: IntLanes,
) -> bool:
    """Lower the weighted remaining costs `now` (n, LANES) of marked nodes by paths that begin with a plain arc.

    A plain arc is no turn; the path continues from its head with the value of that node. A column of `now` (a lane)
    belongs to one weight vector. Returns whether any value improved.

    steps, marks, rests  as in :func:`improve_by_turns`
    arcs    (a,)  plain arcs from marked nodes; skipped if in `closed` (m,), or with a head not in `came` or `turned`
    moved   (m,)  for each arc, bits of lanes; those that it improved are added
    came    (n,)  nodes that plain arcs improved; old entries stay, and nodes that this call improves are added
    turned  (n,)  nodes that turns improved; 0 after the call
    """
    weights = tables.weights
    better = np.uint8(0)
    for i in arcs:
        v, u = tables.tails[i], tables.heads[i]
        if closed[i] or not (turned[u] or came[u]):
            continue
        if marks[u]:
            for k in range(LANES):
                rests[0, k] = now[u, k]
        else:
            write_remaining_costs(tables, steps, u, rests, 0)
        first, rest = np.float64(tables.first[i]), np.float64(tables.rest[i])
        bits = np.uint8(0)
        for k in range(LANES):
            move = np.int32(min(FAR - 1.0, (weights[k, 0] * first + weights[k, 1] * rest) * DOWN))
            far = np.int32(rests[0, k] + move)
            bits |= np.uint8(1 << k) if far < now[v, k] else np.uint8(0)
            now[v, k] = min(now[v, k], far)
        moved[i] |= bits
        if bits:
            came[v] = 1
            better |= bits
    turned[:] = 0
    return bool(better > 0)


@lean
def recompute_layer(
    tables: HullTables,
    layers: Steps,
    m: int,
    last: bool,
    moved: NDArray[np.uint8],
    closed: BoolArray,
    marks: NDArray[np.uint8],
    nodes: Places,
    arcs: Places,
    now: IntLanes,
    room: IntLanes,
    fresh: NDArray[np.uint8],
) -> None:
    """Recompute layer m at the marked nodes, from values that are valid; the last layer allows any number of turns.

    Stored values only rise.

    layers       all layers of the hull, of which layer m is changed; `last` is True for the last one
    moved, closed, marks         as in :func:`improve_by_moves`; `moved` of `arcs` is written anew
    nodes, arcs  (a,), (b,)      marked nodes, and the arcs that leave them
    now          (n, LANES)      scratch
    room         (1 + g, LANES)  scratch, g is the number of nodes of the largest group
    fresh        (2, n)          1 before the call
    """
    least, rests, came, turned = room[:1], room[1:], fresh[0], fresh[1]
    for i in arcs:
        moved[i] = 0
    if last:  # the layer before is no less, and near
        for v in nodes:
            write_remaining_costs(tables, layers[m - 1], v, now, v)
    else:
        for v in nodes:
            for k in range(LANES):
                now[v, k] = 0 if tables.is_target[v] else FAR
        if m > 0:
            improve_by_turns(tables, layers[m - 1], marks, False, now, nodes, came, turned, rests, least)
        improve_by_moves(tables, layers[m], marks, closed, moved, arcs, now, came, turned, rests)
    better = last
    while better:
        improve_by_turns(tables, layers[m], marks, True, now, nodes, came, turned, rests, least)
        better = improve_by_moves(tables, layers[m], marks, closed, moved, arcs, now, came, turned, rests)
    weights = tables.weights
    for v in nodes:
        first, rest = np.float64(tables.least[0, v]), np.float64(tables.least[1, v])
        for k in range(LANES):
            whole = np.int32(min(float(FAR), np.ceil((weights[k, 0] * first + weights[k, 1] * rest) * UP)))
            more = max(np.int32(0), np.int32(now[v, k] - whole)) >> np.int32(STEP_BITS)
            layers[m, v, k] = max(layers[m, v, k], np.uint16(min(np.int32(MOST_STEPS), more)))
