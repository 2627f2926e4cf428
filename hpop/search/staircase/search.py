"""Exact search if one cost is a small integer, such as the number of turns: a dominance test is one look-up.

Accepts: two or three costs, one of them (the index, a sum) small along good paths; the others are sums or maxima.

Guarantees: every non-dominated cost vector once, each with one path of this cost.

A label is a partial path with costs g, and f = g + h is its estimate, with lower bounds h of the remaining costs (for a
maximum f = g, which includes h). Labels leave the queue in lexicographic order of f. So labels closed before at a node
have no larger first cost, and the dominance test ignores this cost (Pulido, Mandow, Perez de la Cruz, "Dimensionality
reduction in multiobjective shortest path search", 2015). Let n be the index cost, a small integer, and d the remaining
one, the rest cost. Each node has a table best[n], its staircase: the least d of labels closed there with an index cost
of at most n. A label is dominated if and only if best[n] <= d. One more staircase, of the solutions, prunes labels that
cannot lead to better solutions. Both tests are made when a label is generated and again when it is expanded ("lazy", as
in BOA*, Hernandez et al. 2023).

If the arcs that raise the index form groups of nodes (turns in place, see :mod:`.machinery.turns`), labels are
generated only where other arcs arrive, and one shared staircase for each group represents turns from any of its nodes.
The staircases of a group are stored side by side, in one cache line. After many expansions, the search adds bounds for
each number of remaining turns (:mod:`.staircase.tables`). If a limit stops the search, these bounds also prove its gap
(:mod:`.staircase.gap`).

A search within a precision uses joint bounds of the first and the rest cost instead (:mod:`.turn_hull`). The best paths
of these bounds pass few nodes. The front of the paths through these nodes alone is found soon, and is near the whole
front. A part of it, which covers it within a share of the precision, becomes the first solutions. Then only labels
remain that the bounds cannot prove to be covered (:mod:`.staircase.labels`): often thousands instead of millions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.frontier import is_nondominated
from hpop.search.graph import Graph
from hpop.search.machinery import ANYTHING, EXACT, Precision, proven_gap
from hpop.search.machinery.bounds import UNREACHABLE
from hpop.search.machinery.labels import Nodes, Unsound, check_solutions, enter_in_batches
from hpop.search.machinery.slices import (
    BUCKETS,
    CHUNKS,
    HEAP,
    INT32_LIMIT,
    KEYS,
    N_EXPANDED,
    N_FRONT,
    N_ROWS,
    ROWS,
    Clock,
)
from hpop.search.machinery.turns import OFFSET, SIZE, Groups
from hpop.search.staircase.buckets import JointSearch
from hpop.search.staircase.gap import gap_by_joint_bounds, gap_by_turns
from hpop.search.staircase.kernel import advance
from hpop.search.staircase.labels import checksum_of_stairs, enter_all, enter_goal, retrace
from hpop.search.staircase.tables import (
    ARC_COLUMNS,
    BELOW,
    DEAREST,
    GROUP_COLUMNS,
    LAYERS,
    NODE_COLUMNS,
    REST,
    TooWide,
    copy_to_double_width,
    costs_by_turns,
    fill_tables,
    trace_paths,
)

STEPS = 64  # number of arcs per path for which there is room at first
INDEX_BITS = 14
KEY_BITS = 62
BUCKET_BITS = 15  # bits of buckets for the first cost of a whole path, or of a long arc
LONG = 4  # number of expanded labels per node after which a search uses bounds by turns
SOON = 0.1  # number of expanded labels per node after which it uses joint bounds


class Staircase(JointSearch):
    """Search of one query on one graph, by the kernel :func:`.staircase.kernel.advance`.

    order  columns of the first cost, the index cost (a small integer, such as the number of turns) and the rest cost;
           the last is -1 if there are two costs
    """

    order: tuple[int, int, int]

    def __init__(
        self,
        graph: Graph,
        source: int,
        targets: IntArray,
        h: IntArray,
        order: tuple[int, int, int],
        groups: Groups,
        clock: Clock,
        precision: Precision = EXACT,
        at_most: Sequence[int] = (),
        width: int = 16,
        jointly: bool = True,
    ) -> None:
        """Set up the tables of a query; raise TooWide if its costs do not fit them.

        targets  (t,)    nodes
        h        (k, n)  lower bounds of the remaining costs
        groups           groups of nodes joined by turns, arcs that raise the index cost; or single nodes
        at_most  (k,)    upper bounds on the costs of a path, or ()
        width            number of steps of a staircase at first
        jointly          whether joint bounds may be used; checkpoints do not store them
        """
        self.precision, self.tolerance = precision, precision.of(order)
        worst = [j >= 0 and graph.aggregates[j] == "max" for j in order]
        self.jointly = jointly and not precision.is_exact and groups.step == 1 and order[2] >= 0 and not any(worst)
        self.graph, self.order, self.groups, self.at_most = graph, order, groups, tuple(at_most)
        reached = h[0] < UNREACHABLE
        most = [int(graph.largest[j]) if j >= 0 else 0 for j in order]
        farthest = [int(h[j].max(where=reached, initial=0)) if j >= 0 else 0 for j in order]
        self.rise = np.array([2 * c + b for c, b in zip(most, farthest, strict=True)], np.int64)
        f = [int(h[j, source]) if j >= 0 else 0 for j in order]
        self.dtype: type[Any] = np.int32 if 4 * (max(f) + int(self.rise.max())) < INT32_LIMIT else np.int64
        priced = [j for j in (order[0], order[2]) if j >= 0]
        shared = groups.step > 0 and not groups.dearest[:, order[0]].any()
        self.turn = (groups.step, shared, bool(groups.alike[priced].all()), worst[0], worst[2])
        self.source = int(groups.new_number[source])
        self.start = np.empty(graph.nodes + 1, np.int64)
        self.is_target = np.zeros(graph.nodes, np.uint8)
        self.is_target[self.groups.new_number[targets]] = 1
        self.nodes = np.empty((graph.nodes, NODE_COLUMNS), self.dtype)
        self.group_table = np.empty((len(groups.rows), GROUP_COLUMNS), self.dtype)
        m = len(groups.heads)
        self.arcs = np.empty((m, ARC_COLUMNS), self.dtype)
        self.heads, self.origin = np.empty(m, np.int32), np.empty(m, np.int32)
        costs, rows = groups.costs_of_arcs(graph)
        plain = (groups.nodes, groups.rows, groups.dearest, groups.start, groups.heads, rows)
        tables = (self.is_target, self.nodes, self.group_table, self.start, self.arcs, self.heads, self.origin)
        m = clock.call(fill_tables, costs, np.array(order, np.int64), h, plain, *tables)
        self.arcs, self.heads, self.origin = self.arcs[:m], self.heads[:m], groups.origin[self.origin[:m]]
        self._make_goal_staircase(width)
        self.share = np.full((len(self.groups.rows), self.width), self._empty_steps(1)[0])
        self.stairs = self._empty_steps(1 << 14)
        self.layers = np.zeros((1, 0), self.dtype)
        self.has_tried_bounds = False
        sizes = self.groups.rows[:, SIZE]
        degrees = np.diff(self.start[np.append(self.groups.rows[:, OFFSET], graph.nodes)])
        super().__init__(3, int((degrees + sizes).max()))
        self.fresh = np.zeros((self.fan, 3), np.int64)
        self._make_packed_queue(f)

    def close(self, arcs: BoolArray, groups: BoolArray) -> None:
        """Close arcs before a search: the marked arcs (m,) of the graph, and all turns of the marked groups (g,).

        Closed arcs get a larger rest cost (the third in ``order``) than any solution, so that every dominance test
        rejects paths with them. If turns of a group differ in cost, the caller must also have raised the costs of
        closed turns in ``self.groups``.
        """
        self.closed_arcs = arcs
        infinite = self._empty_steps(1)[0]
        self.arcs[arcs[self.origin], REST] = infinite
        self.group_table[groups, DEAREST] = infinite

    def _upper_bounds(self) -> list[int]:
        """Return the upper bounds on the three costs of solutions, in the order of the search."""
        return [self.at_most[j] if self.at_most and j >= 0 else ANYTHING for j in self.order]

    def _make_goal_staircase(self, width: int) -> None:
        """Set up the staircase of the solutions; at first it represents the upper bounds on their costs."""
        first, index, rest = self._upper_bounds()
        self.most, self.width = first, width
        while index < 1 << INDEX_BITS and self.width < index + 2:
            self.width *= 2
        self.goal = self._empty_steps(self.width)
        self.goal[:] = min(rest + 1, int(self.goal[0]))
        self.goal[index + 1 :] = 0

    def _make_packed_queue(self, f: list[int]) -> None:
        """Set up the queue with one partial path at the source, of estimate f (3,); raise TooWide if keys overflow."""
        self.root = np.array(f, np.int64)
        shift = max(0, max(f[0], int(self.rise[0])).bit_length() - BUCKET_BITS)
        bits = KEY_BITS - INDEX_BITS - shift
        origin = f[0] >> shift
        limit = INT32_LIMIT if self.dtype is np.int32 else (1 << bits) - 1
        if max(f[1] + self.rise[1], 0) >> INDEX_BITS or f[2] + int(self.rise[2]) > limit:
            raise TooWide
        self._make_queue(f, np.array([shift, bits, bits + INDEX_BITS, origin, limit], np.int64))

    def _empty_steps(self, size: int) -> NDArray[Any]:
        return np.full(size, min(np.iinfo(self.dtype).max, int(UNREACHABLE)), self.dtype)

    def advance(self, clock: Clock, work: int) -> int:
        """Run the kernel for ``work`` elementary steps, and return its code.

        Once the search has expanded many labels for each node, better lower bounds are computed before.
        """
        if not self.has_tried_bounds and self.counters[N_EXPANDED] > (SOON if self.jointly else LONG) * len(self.nodes):
            self._add_bounds(clock)
        if self.hull and self.corners_size < self.counters[N_FRONT]:
            self._update_corners(self.hull, clock)
        code: int = clock.call(
            advance,
            self.counters,
            work,
            self.fan,
            self.rise,
            self.packing,
            self._tables(),
            self.turn,
            self.stairs,
            self.share,
            self.goal,
            self.width,
            self.layers,
            tuple(self.hull) if self.hull else None,
            self.queue,
            (self.tops, self.below, self.entries),
            (self.keys, self.values),
            self.closed,
            self.front,
            self.solutions,
            self.fresh,
            float(self.precision.eps),
            self.tolerance,
            self.most,
        )
        return code

    def _tables(self) -> tuple[Any, ...]:
        """Return the tables of the graph that kernels take as the argument ``graph``."""
        groups = self.groups
        tables = (self.nodes, self.start, self.arcs, self.heads, self.group_table)
        return (*tables, groups.rows, groups.dearest, groups.turns, self.source, self.order[0], self.order[2])

    def _add_bounds(self, clock: Clock) -> None:
        """Compute joint bounds or else bounds for each number of remaining turns, if graph and memory allow them."""
        self.has_tried_bounds = True
        if not (self.jointly and self._compute_joint_bounds(clock)):
            self._compute_turn_bounds(clock)

    def _compute_turn_bounds(self, clock: Clock, count: int = LAYERS) -> None:
        """Compute ``count`` bounds, for 0, 1, ... and any remaining turns; use them if graph and memory allow them."""
        limit, size = clock.budget.max_memory, count * len(self.nodes) * self.nodes.itemsize
        if limit is not None and self.memory() + 2 * size > limit:
            return
        if self.turn[0] != 1 or self.turn[4]:  # a turn must raise the index by 1, and the rest cost must be a sum
            return
        tables = (self.nodes, self.start, self.arcs, self.is_target)
        layers = costs_by_turns(self.groups, self.order[2], *tables, clock, count)
        if layers is not None:
            self.take_turn_bounds(layers)

    def closer_gap(self, front: IntArray, gap: float, estimates: IntArray, least: IntArray, clock: Clock) -> float:
        """Return a gap of a front (n, 3) to missing vectors, at most ``gap``, which is proven already.

        Call this only when the search has stopped: without joint bounds, missing bounds by turns are computed, unless
        known paths show that no smaller gap is true.

        estimates  (m, 3)  those of open labels, see :meth:`estimates`; all columns are in the order of the search
        least      (p, 3)  costs of known paths that the front need not have
        """
        if not len(front) or self.order[2] < 0 or (true := proven_gap(front, least)) >= gap:
            return gap
        tables = (np.concatenate(self.open_labels()), estimates, self.heads, self.source, self.nodes, self.most)
        if self.hull:
            return gap_by_joint_bounds(front, self.with_corners, tables, max(true, self.precision.eps), gap, clock)
        if not self.layers.size and not self.has_tried_bounds:
            self._compute_turn_bounds(clock, min(LAYERS, int(front[:, 1].max()) + 2))  # more turns differ little
            clock.peak = max(clock.peak, self.memory())
        if not self.layers.size:
            return gap
        vectors = front.astype(np.float64)
        return float(clock.call(gap_by_turns, vectors, *tables, self.layers, self.goal, gap, np.empty(3)))

    def take_turn_bounds(self, layers: NDArray[Any]) -> None:
        """Use bounds (n, m) for each number of remaining turns from now on, see :func:`.costs_by_turns`."""
        self.has_tried_bounds = True
        self.layers = layers
        self._lengthen_goal()

    def _search_on(
        self, part: Graph, source: int, targets: IntArray, h: IntArray, groups: Groups, clock: Clock, near: Precision
    ) -> Staircase:
        """Return a search, not yet run, on a part of the graph, with the precision ``near`` and no joint bounds."""
        return Staircase(part, source, targets, h, self.order, groups, clock, near, self.at_most, jointly=False)

    def _lengthen_goal(self) -> None:
        more = self.width + self.layers.shape[1] - len(self.goal)
        self.goal = np.concatenate([self.goal, np.repeat(self.goal[-1:], more)])

    def arrays(self) -> list[NDArray[Any]]:
        """Return the tables of the graph, the staircases and the queue, so that their bytes are counted."""
        groups = self.groups
        tables = [self.nodes, self.group_table, self.start, self.arcs, self.heads, self.origin, self.is_target]
        grouped = [groups.nodes, groups.new_number, groups.rows, groups.dearest, groups.turns, groups.start]
        queue: list[NDArray[Any]] = [self.tops, self.below, self.entries, self.keys, self.values, self.fresh]
        return [*tables, *grouped, *(self.hull or ()), self.stairs, self.share, self.goal, self.layers, *queue]

    def growth(self, code: int) -> tuple[int, Callable[[], None]]:
        """Return how many bytes more are needed, and a function that grows the staircases, costs or queue.

        ``code`` is the return value of a kernel that ran out of room; it names the array.
        """
        if code == HEAP:
            return self.keys.nbytes + self.values.nbytes, self._grow_heap
        if code == CHUNKS:
            return self.below.nbytes + self.entries.nbytes, self._grow_chunks
        if code == BUCKETS:
            return self.tops.nbytes, self._grow_buckets
        if code == KEYS:
            return self.stairs.nbytes + self.arcs.nbytes + self.nodes.nbytes, self._widen_costs
        if len(self.stairs) > BELOW // 2:  # larger indices would exceed the mask of the kernels
            raise TooWide
        return self.stairs.nbytes, self._grow_rows if code == ROWS else self._grow_width

    def _widen_costs(self) -> None:
        """Store costs in 64 bits from now on; raise TooWide if they have 64 bits already."""
        if self.dtype is np.int64:
            raise TooWide
        old = np.iinfo(self.dtype).max
        self.dtype = np.int64
        self.packing[-1] = (1 << int(self.packing[1])) - 1
        for name in ("nodes", "group_table", "arcs", "stairs", "share", "goal", "layers"):
            array = getattr(self, name).astype(np.int64)
            array[array == old] = UNREACHABLE
            setattr(self, name, array)
        self.goal = np.minimum(self.goal, self._upper_bounds()[2] + 1)  # which may not have fit 32 bits

    def _grow_rows(self) -> None:
        size = len(self.stairs)
        self.stairs.resize(2 * size, refcheck=False)
        self.stairs[size:] = self._empty_steps(1)[0]

    def _grow_width(self) -> None:
        old = self.stairs
        self.stairs = self._empty_steps(2 * len(old))
        self.counters[N_ROWS] = copy_to_double_width(old, self.stairs, self.group_table, self.width)
        self.share = np.concatenate([self.share, np.repeat(self.share[:, -1:], self.width, axis=1)], axis=1)
        self.width *= 2
        self._lengthen_goal()

    def weight_of_sets(self, clock: Clock) -> int:
        """Return a checksum of the steps of all staircases."""
        empty = int(self._empty_steps(1)[0])
        return int(clock.call(checksum_of_stairs, self.stairs, self.group_table, self.width, empty))

    def retrace(self, values: IntArray, closed: int, at: Nodes, clock: Clock) -> tuple[int, NDArray[Any]]:
        """Find last nodes of a checkpoint's labels, and bounds of whole paths' costs, see :meth:`.Search.retrace`."""
        f = np.zeros((len(values), 3), np.int64)
        tails = np.repeat(np.arange(len(self.nodes), dtype=np.int32), np.diff(self.start))
        most = np.array([ANYTHING, (1 << INDEX_BITS) - 1, self.packing[-1]])
        return clock.call(retrace, values, closed, self.root, self._tables(), self.turn, tails, most, at, f), f

    def widen(self) -> bool:
        """Store costs in 64 bits from now on; return False if they have 64 bits already."""
        narrow = self.dtype is np.int32
        if narrow:
            self._widen_costs()
        return narrow

    def enter(self, nodes: Nodes, closed: NDArray[Any], ends: Nodes, solved: NDArray[Any], clock: Clock) -> None:
        """Fill the staircases of nodes and solutions from saved partial paths, see :meth:`.Search.enter`."""
        check_solutions(self.is_target, nodes, ends, solved[:, :1], self.most)
        while closed[:, 1].max(initial=0) >= self.width:
            self._grow_width()

        def enter(begin: int) -> int:
            tables = (self._tables(), self.turn, self.stairs, self.share, self.width)
            return int(clock.call(enter_all, nodes, closed, begin, self.counters, *tables))

        enter_in_batches(len(nodes), enter, self._grow_rows)
        if clock.call(enter_goal, self.goal, solved, float(self.precision.eps), self.tolerance) < 0:
            raise Unsound("a saved solution is covered by one before it")

    def results(self) -> tuple[IntArray, IntArray, int, int, int]:
        """Return the results of :meth:`.Search.results`, without dominated vectors.

        Some of the first solutions, which come with the joint bounds, may be dominated by later ones.
        """
        front, labels, generated, expanded, waiting = super().results()
        if self.hull_paths:
            best = is_nondominated(front.astype(np.float64))
            front, labels = front[best], labels[best]
        return front, labels, generated, expanded, waiting

    def paths(self, labels: IntArray, clock: Clock) -> list[IntArray]:
        """Return the path of each solution label, as indices of arcs in the graph, from the source on."""
        graph, groups = self.graph, self.groups
        arcs = (*graph.rows_of_turns(self.order[1]), self.start, self.heads, self.origin)
        arrays = (*arcs, groups.nodes, self.closed, self.source, np.maximum(labels, 0))
        ends, steps = np.empty(len(labels), np.int64), np.empty(STEPS * len(labels), np.int64)
        size = clock.call(trace_paths, *arrays, ends, steps)
        if size > len(steps):
            steps = np.empty(size, np.int64)
            clock.call(trace_paths, *arrays, ends, steps)
        hull_paths = [part[::-1] for part in np.split(steps[:size], ends)[:-1]]
        return [
            self.hull_paths[-1 - label] if label < 0 else path for label, path in zip(labels, hull_paths, strict=True)
        ]
