"""Joint lower bounds: the least weighted rest of the way with at most m turns, for several weights of two costs.

The front of what is left of the way lies above its supporting lines; so does whatever a label still becomes. Where all
of that is covered by solutions known, the label need not be followed (:mod:`.corners`). The bounds of
:mod:`.turn_bounds` are its two axes; here are LANES directions at once, swept in the same way:
H_m(v) = min(H_{m-1}(v), w.c + H_m(next of v), min over turns to u of (w.turn + H_{m-1}(u))), and the last layer, with
any number of turns, repeats that until nothing changes.

Weighted costs are rounded down to 31 bits, and sums stop at FAR. Kept is what the rest of a way costs more than its
least costs do, one by one, in steps of 1 / 2^15 of a whole way, at most twice one: 16 bits. All this makes less of the
truth, which is still a lower bound. (Memory is most of the time: a layer of m300 has 6 million numbers.)
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

LANES = 8  # 32 bytes: one vector register
MOST_LAYERS = 64
FEWEST_LAYERS = 16  # fewer bound too little
ROOM = 2**32  # bytes that the layers may take
SPREAD = 20.0  # the steepest direction, in units of what the costs are like
UNIT = 2**27  # what a whole way costs, about; so FAR is eight times as much
FAR = 2**30
STEP_BITS, MOST_STEPS = 12, 2**16 - 1
DOWN, UP = 1 - 2.0**-40, 1 + 2.0**-40  # more than the rounding of a product and a sum of floats

IntLanes = NDArray[np.int32]
Steps = NDArray[np.uint16]


class JointBounds(NamedTuple):
    """Joint bounds, and the corners of what is left uncovered, in the order in which the kernel takes them.

    layers, weights  of the hull, see :class:`TurnHull`
    corners, last    weighted corners and the last of each number of turns, see :class:`.Corners`
    ahead            (n, 3)      least estimates that solutions known beforehand cover, the first cost rising
    reached          (1,)        how many of these the search has come to
    scratch          (2, LANES)  room for the kernel
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
    """Bounds of the rest of the way from every node.

    weights  (LANES, 2)           of the first and the rest cost; the first two are of one cost alone
    layers   (m, nodes, LANES)    steps by which the least weighted rest with at most 0, 1, ... turns, in the last layer
                                  with any number, exceeds the weighted least rests
    moved    (m, arcs)             by which arcs a layer is better than the one before, a bit a lane
    step     (arcs,)               the place of each arc in that order
    """

    weights: FloatArray
    layers: Steps
    moved: NDArray[np.uint8]
    step: IntArray

    def passed(
        self,
        groups: Groups,
        columns: tuple[int, int],
        nodes: NDArray[Any],
        start: IntArray,
        arcs: NDArray[Any],
        source: int,
        clock: Clock,
    ) -> IntArray:
        """Nodes that the best ways from a source pass, for some direction and number of turns."""
        alike = bool(groups.alike[list(columns)].all())
        turns = np.ascontiguousarray(groups.dearest.T) if alike else groups.turns
        passed = np.zeros(len(nodes), np.uint8)
        tables = (nodes, start, arcs, self.step, groups.rows, alike, turns[columns[0]], turns[columns[1]], self.weights)
        clock.call(mark_ways, self.layers[:-1], self.moved, *tables, source, passed)
        return np.flatnonzero(passed)


def directions(typical: tuple[int, int]) -> FloatArray:
    """Weights (LANES, 2): each cost alone, then mixtures, evenly in the logarithm of their proportion."""
    one, two = (UNIT / max(1, t) for t in typical)
    mixtures = [(one / (1 + r), two * r / (1 + r)) for r in np.geomspace(1 / SPREAD, SPREAD, LANES - 2)]
    return np.array([(one, 0.0), (0.0, two), *mixtures])


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
    """Sweep layer after layer, until the weighted rests (n, LANES) of so many turns are near enough to the least.

    The tables are the staircase search's; the columns are of its first and its rest cost. None where plain arcs are not
    chains, where so few layers have room (bytes) that they bound little, or when the time is up.
    """
    alike = bool(groups.alike[list(columns)].all())
    turns = groups.dearest.T if alike else groups.turns
    room -= 4 * LANES * (3 * len(nodes) + len(arcs) + turns.shape[1])  # while the layers are swept
    most = min(MOST_LAYERS, min(room, ROOM) // (len(nodes) * (2 * LANES + 1)))
    chains = chain_order(start, arcs, clock) if most >= FEWEST_LAYERS else None
    if chains is None:
        return None
    order, places, _ = chains
    onward = arcs[places, HEAD].astype(np.int64)
    move = _priced(arcs[places, FIRST], arcs[places, REST], weights, clock)
    turn = _priced(turns[columns[0]], turns[columns[1]], weights, clock)
    layers = np.empty((most, len(nodes), LANES), np.uint16)
    moved = np.zeros((most, len(places)), np.uint8)
    scratch = np.empty(LANES, np.int32)
    before = np.where(is_target[:, None], np.int32(0), np.int32(FAR)).repeat(LANES, axis=1)
    now = before.copy()
    first = chains.begin(0)
    clock.call(sweep_moves, now, order[first:], onward[first:], move[first:], moved[0, first:])
    least = np.empty_like(now)
    clock.call(price_least, nodes, weights, least)
    clock.prepare(keep, now, least, layers[0])
    last = 1
    with ThreadPoolExecutor(1) as beside:  # a layer is kept while the next one is swept
        with interrupts_held():
            kept = beside.submit(keep, now, least, layers[0])
        while last < most - 1 and not is_enough(now):
            before, now = now, before
            clock.call(sweep_turns, before, now, groups.rows, alike, turn, scratch)
            first = chains.begin(last)
            sweep_moves(now, order[first:], onward[first:], move[first:], moved[last, first:])
            with interrupts_held():
                kept.result()
                kept = beside.submit(keep, now, least, layers[last])
            last += 1
            if clock.exceeded(0, 0, record=False) is not None:
                return None
    better = True
    while better:
        better = sweep_turns(now, now, groups.rows, alike, turn, scratch)
        better |= sweep_moves(now, order, onward, move, moved[last])
        if clock.exceeded(0, 0, record=False) is not None:
            return None
    keep(now, least, layers[last])
    step = np.empty(len(places), np.int64)
    step[places] = np.arange(len(places))
    return TurnHull(weights, layers[: last + 1], moved[:last], step)


def _priced(first: NDArray[Any], rest: NDArray[Any], weights: FloatArray, clock: Clock) -> IntLanes:
    out = np.empty((len(first), LANES), np.int32)
    clock.call(price, np.ascontiguousarray(first), np.ascontiguousarray(rest), weights, out)
    return out


@lean
def price(first: NDArray[Any], rest: NDArray[Any], weights: FloatArray, out: IntLanes) -> None:
    """Weigh costs (m,) and (m,) into `out` (m, LANES), rounded down."""
    for a in range(len(first)):
        for k in range(LANES):
            out[a, k] = np.int32(min(FAR - 1.0, (weights[k, 0] * first[a] + weights[k, 1] * rest[a]) * DOWN))


@lean
def price_least(nodes: NDArray[Any], weights: FloatArray, out: IntLanes) -> None:
    """Weigh the least rests of nodes into `out` (n, LANES), rounded up."""
    for v in range(np.uint64(len(nodes))):
        for k in range(LANES):
            least = weights[k, 0] * nodes[v, H_FIRST] + weights[k, 1] * nodes[v, H_REST]
            out[v, k] = np.int32(min(float(FAR), np.ceil(least * UP)))


@lean
def keep(now: IntLanes, least: IntLanes, steps: Steps) -> None:
    """Write the steps (n, LANES) by which weighted rests exceed the weighted least rests."""
    for v in range(np.uint64(len(now))):
        for k in range(LANES):
            more = max(np.int32(0), np.int32(now[v, k] - least[v, k]))
            steps[v, k] = np.uint16(min(np.int32(MOST_STEPS), np.int32(more >> STEP_BITS)))


@lean
def sweep_moves(now: IntLanes, order: IntArray, onward: IntArray, move: IntLanes, moved: NDArray[np.uint8]) -> bool:
    """Move straight on, along whole chains; tells whether that was better anywhere, and by which arcs, a bit a lane."""
    better = np.uint8(0)
    for i in range(np.uint64(len(order))):
        v, u = np.uint64(order[i]), np.uint64(onward[i])
        bits = np.uint8(0)
        for k in range(LANES):
            rest = np.int32(now[u, k] + move[i, k])
            bits |= np.uint8(1 << k) if rest < now[v, k] else np.uint8(0)
            now[v, k] = min(now[v, k], rest)
        moved[i] = bits
        better |= bits
    return bool(better > 0)


@lean
def sweep_turns(
    before: IntLanes, now: IntLanes, groups: IntArray, alike: bool, turn: IntLanes, least: IntLanes
) -> bool:
    """Stay or turn, from what is `before`, which may be `now` itself; tells whether turns were better anywhere."""
    better = False
    for g in range(np.uint64(len(groups))):
        begin, size = np.uint64(groups[g, OFFSET]), np.uint64(groups[g, SIZE])
        end = begin + size
        if alike:
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
def mark_ways(
    layers: Steps,
    moved: NDArray[np.uint8],
    nodes: NDArray[Any],
    start: IntArray,
    arcs: NDArray[Any],
    step: IntArray,
    groups: IntArray,
    alike: bool,
    turn_first: IntArray,
    turn_rest: IntArray,
    weights: FloatArray,
    source: int,
    passed: NDArray[np.uint8],
) -> None:
    """Mark the nodes on a best way from the source, to the nearest step, for each direction and number of turns."""
    for layer in range(len(layers)):
        for k in range(LANES):
            m, v = layer, np.int64(source)
            if layers[m, v, k] == MOST_STEPS:
                continue
            passed[v] = 1
            while True:
                best, onward = np.int64(-1), v
                for a in range(start[v], start[v + 1]):  # the last arc that was better is the best
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
                    rest = weights[k, 0] * nodes[u, H_FIRST] + weights[k, 1] * nodes[u, H_REST]
                    rest += np.int64(layers[m, u, k]) << STEP_BITS
                    if u != v:
                        t = group if alike else groups[group, TURNS] + (v - begin) * size + u - begin
                        rest += np.int64(
                            min(FAR - 1.0, (weights[k, 0] * turn_first[t] + weights[k, 1] * turn_rest[t]) * DOWN)
                        )
                    if rest < least:
                        least, to = rest, u
                v = to
                passed[v] = 1
