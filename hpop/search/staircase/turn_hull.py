"""Joint lower bounds of two costs: the least weighted remaining cost with at most m turns, for several weights.

A lane is one of LANES weight vectors w. H_m(v) is the least w.c of all paths with at most m turns and costs c from node
v to a target; a layer has H_m of all nodes and lanes, for one m. So the remaining costs of a label (partial path) lie
above several lines. If known solutions cover all vectors above these lines, the label is pruned
(:mod:`.staircase.labels`). The bounds of :func:`.costs_by_turns` are those for a single cost. Here all lanes are swept
at once in the same way, layer after layer:

H_m(v) = min(H_{m-1}(v), w.c + H_m(next node of v), min over turns to u of (w.turn + H_{m-1}(u))). The last layer, for
any number of turns, repeats this until there is no change.

A sweep takes the plain arcs (arcs that are no turns) in chain order, that of :class:`.staircase.tables.ArcChains`: a
chain is a straight run of plain arcs, and each arc comes after the next arc of its chain.

Weighted costs are rounded down to 31 bits, and sums stop at FAR. A layer stores H_m(v) - w.h(v), the excess over the
weighted least remaining costs h of each cost alone, in units of 1 / 2^15 of a whole path, up to twice a whole path: 16
bits. All rounding is down, so the results are lower bounds. (Memory access takes most of the time: a layer of m300 has
6 million numbers.)
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.runtime.interrupts import interrupts_held
from hpop.search.machinery.slices import Clock
from hpop.search.machinery.turns import OFFSET, SIZE, TURNS, Groups
from hpop.search.staircase.tables import FIRST, GROUP, H_FIRST, H_REST, HEAD, REST, chain_order

LANES = 8  # number of weight vectors: 32 bytes, one vector register
MOST_LAYERS = 64
FEWEST_LAYERS = 16  # with fewer layers, bounds are too weak
ROOM = 2**32  # bytes for the layers
SPREAD = 20.0  # largest ratio of the two weights, in units of typical costs
UNIT = 2**27  # about the cost of a whole path; FAR is eight times as much
FAR = 2**30
STEP_BITS, MOST_STEPS = 12, 2**16 - 1
DOWN, UP = 1 - 2.0**-40, 1 + 2.0**-40  # factors beyond the rounding of a product and a sum of floats

IntLanes = NDArray[np.int32]
Steps = NDArray[np.uint16]


class HullBounds(NamedTuple):
    """Joint bounds and the corners of the uncovered region, as arguments of the search's kernel.

    Some solutions are known before the search reaches their first cost. The staircase of the solutions ignores this
    cost, so each of them enters it only when the search has reached its first cost.

    layers, weights  fields of :class:`TurnHull`
    corners, last    fields ``values`` and ``last`` of :class:`.UncoveredCorners`
    ahead            (n, 3)      least estimate that each such solution covers, by rising first cost
    reached          (1,)        number of these solutions that have entered the staircase
    scratch          (2, LANES)  scratch memory
    """

    layers: Steps
    weights: FloatArray
    corners: IntLanes
    last: IntArray
    ahead: IntArray
    reached: IntArray
    scratch: IntLanes


@dataclass(frozen=True, eq=False)
class TurnHull:
    """Joint bounds of the two costs besides turns: the least weighted remaining costs of all nodes, for LANES weights.

    weights  (LANES, 2)         weights of the two costs; each of the first two rows weighs one cost alone
    layers   (m, nodes, LANES)  the bounds for at most 0, 1, ... turns, the last for any number; stored as the excess
                                over the weighted sum of the least remaining costs, in units of 2^STEP_BITS
    moved    (m - 1, arcs)      for each layer but the last and each plain arc (no turn): bit k is set if the arc
                                lowered the bound of its tail for weight vector k; arcs are sorted along chains
                                (:class:`.ArcChains`)
    step     (arcs,)            position of each plain arc in this order
    """

    weights: FloatArray
    layers: Steps
    moved: NDArray[np.uint8]
    step: IntArray

    def nodes_on_best_paths(
        self,
        groups: Groups,
        columns: tuple[int, int],
        nodes: NDArray[Any],
        start: IntArray,
        arcs: NDArray[Any],
        source: int,
        clock: Clock,
    ) -> IntArray:
        """Return the nodes that the best paths from a source pass, for all weights and numbers of turns.

        groups              groups of nodes joined by turns
        columns             columns of the two costs besides turns
        nodes, start, arcs  tables of the staircase search
        source              node in the numbering of the groups
        """
        uniform = bool(groups.alike[list(columns)].all())
        turns = np.ascontiguousarray(groups.dearest.T) if uniform else groups.turns
        passed = np.zeros(len(nodes), np.uint8)
        tables = (
            nodes,
            start,
            arcs,
            self.step,
            groups.rows,
            uniform,
            turns[columns[0]],
            turns[columns[1]],
            self.weights,
        )
        clock.call(mark_paths, self.layers[:-1], self.moved, *tables, source, passed)
        return np.flatnonzero(passed)


def directions(typical: tuple[int, int]) -> FloatArray:
    """Return the weights (LANES, 2) of two costs: each cost alone, then mixtures with logarithmically spaced ratios.

    typical  values of the two costs for a whole path, by which weights are scaled
    """
    first, rest = (UNIT / max(1, t) for t in typical)
    mixtures = [(first / (1 + r), rest * r / (1 + r)) for r in np.geomspace(1 / SPREAD, SPREAD, LANES - 2)]
    return np.array([(first, 0.0), (0.0, rest), *mixtures])


def turn_hull(
    groups: Groups,
    columns: tuple[int, int],
    weights: FloatArray,
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    is_target: NDArray[np.uint8],
    is_enough: Callable[[IntLanes], bool],
    room: int,
    clock: Clock,
) -> TurnHull | None:
    """Compute joint bounds, layer after layer.

    groups              groups of nodes joined by turns
    columns             columns of the first and the rest cost
    weights             (LANES, 2), of :func:`directions`
    nodes, start, arcs  tables of the staircase search
    is_target           (n,)  mask of nodes
    is_enough           takes the weighted remaining costs (n, LANES) of the newest layer; returns True if no further
                        layers are needed
    room                bytes for the layers

    Returns None if plain arcs form no chains, if there is room for too few layers, or if a limit is passed.
    """
    uniform = bool(groups.alike[list(columns)].all())
    turns = groups.dearest.T if uniform else groups.turns
    room -= 4 * LANES * (3 * len(nodes) + len(arcs) + turns.shape[1])  # while the layers are swept
    most = min(MOST_LAYERS, min(room, ROOM) // (len(nodes) * (2 * LANES + 1)))
    chains = chain_order(start, arcs, clock) if most >= FEWEST_LAYERS else None
    if chains is None:
        return None
    order, indices, _ = chains
    onward = arcs[indices, HEAD].astype(np.int64)
    move = _weighted_costs(arcs[indices, FIRST], arcs[indices, REST], weights, clock)
    turn = _weighted_costs(turns[columns[0]], turns[columns[1]], weights, clock)
    layers = np.empty((most, len(nodes), LANES), np.uint16)
    moved = np.zeros((most, len(indices)), np.uint8)
    scratch = np.empty(LANES, np.int32)
    before = np.where(is_target[:, None], np.int32(0), np.int32(FAR)).repeat(LANES, axis=1)
    now = before.copy()
    first = chains.begin(0)
    clock.call(sweep_moves, now, order[first:], onward[first:], move[first:], moved[0, first:])
    least = np.empty_like(now)
    clock.call(write_weighted_least, nodes, weights, least)
    clock.prepare(write_excess, now, least, layers[0])
    last = 1
    with ThreadPoolExecutor(1) as thread:  # stores a layer while the next one is swept
        with interrupts_held():
            stored = thread.submit(write_excess, now, least, layers[0])
        while last < most - 1 and not is_enough(now):
            before, now = now, before
            clock.call(sweep_turns, before, now, groups.rows, uniform, turn, scratch)
            first = chains.begin(last)
            sweep_moves(now, order[first:], onward[first:], move[first:], moved[last, first:])
            with interrupts_held():
                stored.result()
                stored = thread.submit(write_excess, now, least, layers[last])
            last += 1
            if clock.exceeded(0, 0, record=False) is not None:
                return None
    better = True
    while better:
        better = sweep_turns(now, now, groups.rows, uniform, turn, scratch)
        better |= sweep_moves(now, order, onward, move, moved[last])
        if clock.exceeded(0, 0, record=False) is not None:
            return None
    write_excess(now, least, layers[last])
    step = np.empty(len(indices), np.int64)
    step[indices] = np.arange(len(indices))
    return TurnHull(weights, layers[: last + 1], moved[:last], step)


def _weighted_costs(first: NDArray[Any], rest: NDArray[Any], weights: FloatArray, clock: Clock) -> IntLanes:
    out = np.empty((len(first), LANES), np.int32)
    clock.call(write_weighted_costs, np.ascontiguousarray(first), np.ascontiguousarray(rest), weights, out)
    return out


@lean
def write_weighted_costs(first: NDArray[Any], rest: NDArray[Any], weights: FloatArray, out: IntLanes) -> None:
    """Write the weighted sums of costs `first` (m,) and `rest` (m,) to `out` (m, LANES), rounded down.

    weights  (LANES, 2)  weights of the two costs
    """
    for a in range(len(first)):
        for k in range(LANES):
            out[a, k] = np.int32(min(FAR - 1.0, (weights[k, 0] * first[a] + weights[k, 1] * rest[a]) * DOWN))


@lean
def write_weighted_least(nodes: NDArray[Any], weights: FloatArray, out: IntLanes) -> None:
    """Write the weighted sum of two least remaining costs of each node to `out` (n, LANES), rounded up.

    nodes    (n, 4)      table of nodes of the staircase search; the two costs are its columns H_FIRST and H_REST
    weights  (LANES, 2)  weights of the two costs
    """
    for v in range(np.uint64(len(nodes))):
        for k in range(LANES):
            least = weights[k, 0] * nodes[v, H_FIRST] + weights[k, 1] * nodes[v, H_REST]
            out[v, k] = np.int32(min(float(FAR), np.ceil(least * UP)))


@lean
def write_excess(now: IntLanes, least: IntLanes, steps: Steps) -> None:
    """Encode a layer: write the excess of `now` over `least` to `steps` (n, LANES), in 16-bit units, rounded down.

    now    (n, LANES)  weighted remaining costs
    least  (n, LANES)  weighted sums of the least remaining costs
    """
    for v in range(np.uint64(len(now))):
        for k in range(LANES):
            more = max(np.int32(0), np.int32(now[v, k] - least[v, k]))
            steps[v, k] = np.uint16(min(np.int32(MOST_STEPS), np.int32(more >> STEP_BITS)))


@lean
def sweep_moves(now: IntLanes, order: IntArray, onward: IntArray, move: IntLanes, moved: NDArray[np.uint8]) -> bool:
    """Lower weighted remaining costs `now` (n, LANES) by plain arcs along chains; return whether any became lower.

    order, onward  (m,)  tails and heads of the plain arcs, sorted along chains (:class:`.ArcChains`)
    move           (m, LANES)  weighted costs of these arcs
    moved          (m,)  output: bit k is set if the arc lowered the cost of its tail for weight vector k
    """
    better = np.uint8(0)
    for i in range(np.uint64(len(order))):
        v, u = np.uint64(order[i]), np.uint64(onward[i])
        bits = np.uint8(0)
        for k in range(LANES):
            cost = np.int32(now[u, k] + move[i, k])
            bits |= np.uint8(1 << k) if cost < now[v, k] else np.uint8(0)
            now[v, k] = min(now[v, k], cost)
        moved[i] = bits
        better |= bits
    return bool(better > 0)


@lean
def sweep_turns(
    before: IntLanes, now: IntLanes, groups: IntArray, uniform: bool, turn: IntLanes, least: IntLanes
) -> bool:
    """Write to `now` (n, LANES) the weighted remaining costs `before`, lowered by paths that begin with a turn.

    Returns whether any became lower. Earlier values of `now` are ignored.

    before   (n, LANES)  remaining costs of each node, also after the turn; may be `now` itself
    groups   (g, 3)      rows of groups, see :class:`.Groups`
    uniform  whether all turns of a group cost the same
    turn     (t, LANES)  weighted costs of turns: one per group if `uniform`, else one per pair of nodes
    least    (LANES,)    scratch
    """
    better = False
    for g in range(np.uint64(len(groups))):
        begin, size = np.uint64(groups[g, OFFSET]), np.uint64(groups[g, SIZE])
        end = begin + size
        if uniform:
            for k in range(LANES):
                least[k] = before[begin, k]
            for u in range(begin, end):
                for k in range(LANES):
                    least[k] = min(least[k], before[u, k])
            for k in range(LANES):
                least[k] += turn[g, k]
            for u in range(begin, end):
                for k in range(LANES):
                    better |= least[k] < before[u, k]
                    now[u, k] = min(before[u, k], least[k])
            continue
        at = np.uint64(groups[g, TURNS])
        for u in range(begin, end):
            for k in range(LANES):
                least[k] = before[u, k]
            for v in range(begin, end):
                if v != u:
                    for k in range(LANES):
                        least[k] = min(least[k], np.int32(before[v, k] + turn[at + v - begin, k]))
            at += size
            for k in range(LANES):
                better |= least[k] < before[u, k]
                now[u, k] = least[k]
    return better


@kernel
def mark_paths(
    layers: Steps,
    moved: NDArray[np.uint8],
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    step: IntArray,
    groups: IntArray,
    uniform: bool,
    turn_first: IntArray,
    turn_rest: IntArray,
    weights: FloatArray,
    source: int,
    passed: NDArray[np.uint8],
) -> None:
    """Follow a best path from the source for each lane and number of turns, and mark its nodes in `passed` (n,).

    Paths are best within the rounding of a layer's values.

    layers, moved, step, weights  fields of :class:`TurnHull`, layers without the last one
    nodes, start, arcs            tables of the staircase search
    groups                        (g, 3)  rows of groups, see :class:`.Groups`
    uniform                       whether all turns of a group cost the same
    turn_first, turn_rest         (t,)  costs of turns: one per group if `uniform`, else one per pair of nodes
    source                        node in the numbering of the groups
    passed                        output: 1 for the nodes on these paths; the caller sets it to 0
    """
    for layer in range(len(layers)):
        for k in range(LANES):
            m, v = layer, np.int64(source)
            if layers[m, v, k] == MOST_STEPS:
                continue
            passed[v] = 1
            while True:
                best, onward = np.int64(-1), v
                for a in range(start[v], start[v + 1]):  # the last arc that improved is the best
                    if (moved[m, step[a]] >> k) & 1 and step[a] > best:
                        best, onward = step[a], np.int64(arcs[a, HEAD])
                if best >= 0:
                    v = onward
                    passed[v] = 1
                    continue
                m -= 1
                if m < 0:  # a target
                    break
                group = np.int64(nodes[v, GROUP])
                group = max(group, ~group)
                begin, size = groups[group, OFFSET], groups[group, SIZE]
                least, to = np.inf, np.int64(v)
                for u in np.arange(begin, begin + size):
                    cost = weights[k, 0] * nodes[u, H_FIRST] + weights[k, 1] * nodes[u, H_REST]
                    cost += np.int64(layers[m, u, k]) << STEP_BITS
                    if u != v:
                        t = group if uniform else groups[group, TURNS] + (v - begin) * size + u - begin
                        cost += np.int64(
                            min(FAR - 1.0, (weights[k, 0] * turn_first[t] + weights[k, 1] * turn_rest[t]) * DOWN)
                        )
                    if cost < least:
                        least, to = cost, u
                v = to
                passed[v] = 1
