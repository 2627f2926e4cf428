"""Lazy search: whether an arc is free of collisions is checked only if a path of a front uses the arc.

Each round searches the graph as if all arcs were free that are not known to be blocked. Then arcs of the paths found
are checked, until each path is known to be free or blocked. Blocked arcs are removed, and the next round begins, until
all paths of a front are free. That front is the front of the graph without any blocked arc: only blocked arcs were
removed, and removing more of them could not improve a front that keeps all its paths. Lazy roadmaps (Bohlin and Kavraki
2000, doi 10.1109/ROBOT.2000.844107) do the same for one shortest path.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, distinct
from hpop.frontier import is_nondominated
from hpop.runtime.limits import Budget, Progress, ProgressCallback, Status
from hpop.search.graph import Graph
from hpop.search.machinery import proven_gap
from hpop.search.machinery.checkpoint import Arrays, Keeper, invalid_checkpoint
from hpop.search.queries import ParetoPaths

# One blocked arc suffices to reject a path, so one arc of each path is checked at a time, until one is blocked. The arc
# is chosen whose end nodes have the largest share of blocked arcs so far: an edge selector as in LazySP (Dellin and
# Srinivasa 2016, arXiv 1603.03490), for many paths at once.


UNKNOWN, FREE, BLOCKED = range(3)
AT_ONCE = 1024  # largest number of arcs checked between two looks at the clock

Free = Callable[[IntArray], BoolArray]
"""Function that takes indices (N,) of arcs in the graph, and returns True for each arc that is free."""


class ArcStates:
    """Table that knows which arcs of a graph are free, blocked or not checked yet, and checks arcs on demand.

    state  (m,)  UNKNOWN, FREE or BLOCKED
    """

    def __init__(self, graph: Graph, free: Free) -> None:
        """Begin with all arcs unchecked. ``free`` is the function that checks arcs, each at most once."""
        self.graph, self.free = graph, free
        self.state = np.zeros(graph.arcs, np.uint8)
        self._known = np.zeros(graph.nodes, np.int64)  # checked arcs that leave or enter each node
        self._blocked = self._known.copy()  # blocked arcs among them

    @property
    def blocked(self) -> BoolArray:
        """True for each arc (m,) that is known to be blocked."""
        return np.asarray(self.state == BLOCKED)

    def record(self, arcs: IntArray, free: BoolArray) -> None:
        """Record the results ``free`` (N,) of checking some arcs (N,)."""
        self.state[arcs] = np.where(free, FREE, BLOCKED)
        for ends in self._ends(arcs):
            np.add.at(self._known, ends, 1)
            np.add.at(self._blocked, ends, ~free)

    def settle(self, arcs: IntArray, lengths: IntArray, late: Callable[[], bool]) -> bool:
        """Check arcs until each path is known to be free or blocked; return False if the time limit comes earlier.

        Parameters
        ----------
        arcs : (N,) arcs of all paths, path after path
        lengths : (n,) number of arcs of each path
        late : returns whether the time limit has passed; called every AT_ONCE arcs
        """
        checked = 0
        while (batch := self._arcs_to_check(arcs, lengths)[:AT_ONCE]).size:
            if checked >= AT_ONCE and late():
                return False
            self.record(batch, self.free(batch))
            checked += batch.size
        return True

    def are_free(self, arcs: IntArray, lengths: IntArray) -> BoolArray:
        """Return True for each path (n,) whose arcs are all known to be free; arguments as in :meth:`settle`."""
        return ~_have_marked(self.state[arcs] != FREE, lengths)

    def _arcs_to_check(self, arcs: IntArray, lengths: IntArray) -> IntArray:
        """Return the arcs to check next: for each undecided path, the unchecked arc most likely to be blocked."""
        path = np.repeat(np.arange(lengths.size), lengths)
        unchecked = (self.state[arcs] == UNKNOWN) & ~_have_marked(self.state[arcs] == BLOCKED, lengths)[path]
        arcs, path = arcs[unchecked], path[unchecked]
        arcs = arcs[np.lexsort((-self._risk(arcs), path))]
        return distinct(arcs[np.unique(path, return_index=True)[1]])

    def _risk(self, arcs: IntArray) -> FloatArray:
        """Return a score (N,) that is higher for arcs that are more likely to be blocked.

        It is the sum of two shares, one for the tail and one for the head: (b + 1/2) / (n + 1), if b of the n checked
        arcs at the node are blocked.
        """
        tails, heads = ((self._blocked[ends] + 0.5) / (self._known[ends] + 1.0) for ends in self._ends(arcs))
        return np.asarray(tails + heads)

    def _ends(self, arcs: IntArray) -> tuple[IntArray, IntArray]:
        """Return the tails and heads (N,) of arcs."""
        tails = np.searchsorted(self.graph.indptr, arcs, side="right") - 1
        return tails, self.graph.heads[arcs].astype(np.int64)


def _have_marked(marked: BoolArray, lengths: IntArray) -> BoolArray:
    """Return True for each path (n,) with a marked arc; ``marked`` (N,) has the marks of all arcs, path after path."""
    path = np.repeat(np.arange(lengths.size), lengths)
    return np.asarray(np.bincount(path, marked, minlength=lengths.size) > 0)


LEAST = 1e-9  # s: least remaining time limit, as a limit must be positive
ROUNDS, GENERATED, EXPANDED, COUNTS = range(4)
SAVED = ("arcs_free", "arcs_blocked", "arcs_left_out", "rounds")  # names of arrays in a checkpoint


class LazyRun:
    """Run of a lazy search: rounds of searching, checking arcs and removing blocked arcs."""

    def __init__(
        self,
        graph: Graph,
        free: Free,
        search: Callable[[Graph, Budget], ParetoPaths],
        budget: Budget,
        progress: ProgressCallback | None,
        keeper: Keeper | None,
        tolerance: IntArray,
    ) -> None:
        """Start a new run, or resume from the keeper's checkpoint.

        Parameters
        ----------
        free : function that checks arcs, called at most once for each arc
        search : returns the front of a graph (the graph of a round), within the budget that remains
        tolerance : (k,) absolute tolerance of the search in each cost
        """
        self.graph, self.search, self.tolerance = graph, search, tolerance
        self.budget, self.progress, self.keeper = budget, progress, keeper
        self.states = ArcStates(graph, self._with_progress(free))
        self.removed = np.zeros(graph.arcs, np.bool_)  # arcs removed from the searched graph
        self.counts = np.zeros(COUNTS, np.int64)
        self.before = self.counts.copy()  # counts of the finished rounds
        self.bounds_seconds = self.compiled = 0.0
        self.peak = 0
        self.began = perf_counter()
        self.paths: ParetoPaths | None = None  # front of the last round
        self.cover: ParetoPaths | None = None  # front of the last round with a complete search
        if keeper is not None:
            if keeper.saved is not None:
                self._resume(keeper.saved.arrays, keeper.path)
            keeper.begin(self._arrays())

    def go(self) -> ParetoPaths:
        """Run rounds until all paths of a front are free, or a limit or Ctrl-C comes; return the free paths.

        Ctrl-C before the first search has returned any front raises KeyboardInterrupt.
        """
        try:
            status = self._search_until_free()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        if self.paths is None:
            raise KeyboardInterrupt
        if status.is_final:
            return self._with_statistics(self.paths)
        self._close_blocked_arcs(self.paths)
        if self.keeper is not None:
            self.keeper.save()
        return self._free_part(self.paths, status)

    def _search_until_free(self) -> Status:
        while True:
            paths = self.paths = self._search_unblocked()
            settled = self.states.settle(paths.all_arcs, paths.lengths, self._is_late)
            if not paths.status.is_final or self._are_free(paths).all():
                return paths.status
            if not settled:
                return Status.TIME_LIMIT
            self._close_blocked_arcs(paths)
            if self.keeper is not None:
                self.keeper.save_if_due()

    def _close_blocked_arcs(self, paths: ParetoPaths) -> None:
        """Update the checkpoint; if this round's search was complete, remove the blocked arcs from the next round."""
        is_complete = paths.status.is_final
        if is_complete:
            self.cover, self.removed, self.before = paths, self.states.blocked, self.counts.copy()
        if self.keeper is not None:
            self.keeper.begin(self._arrays()) if is_complete else self.keeper.update_extra(self._arrays())

    # A round

    def _search_unblocked(self) -> ParetoPaths:
        """Search the graph without the removed arcs; return its front, with arcs numbered as in the whole graph."""
        limit, most = self.budget.time_limit, self.budget.max_labels
        part = self.graph.without(self.removed)
        size = part.costs.nbytes + part.heads.nbytes + part.arc.nbytes + part.indptr.nbytes + self.states.state.nbytes
        room = self.budget.max_memory
        left = replace(
            self.budget,
            max_memory=None if room is None else max(1, room - size),
            time_limit=None if limit is None else max(LEAST, limit - self._seconds()),
            max_labels=None if most is None else max(1, most - int(self.before[GENERATED])),
        )
        paths = self.search(part, left).on(self.graph)
        stats = paths.stats
        self.compiled += stats.seconds_compiled
        self.bounds_seconds += stats.seconds_bounds
        self.peak = max(self.peak, size + stats.peak_memory)
        self.counts = self.before + np.array([1, stats.labels_generated, stats.labels_expanded])
        return paths

    def _seconds(self) -> float:
        """Return the seconds since the search began, without the time for compiling."""
        return perf_counter() - self.began - self.compiled

    def _is_late(self) -> bool:
        """Return whether the time limit has passed."""
        limit = self.budget.time_limit
        return limit is not None and self._seconds() >= limit

    def _with_progress(self, free: Free) -> Free:
        """Return a function that does the same as ``free``, and reports progress before each call."""

        def check(arcs: IntArray) -> BoolArray:
            if self.progress is not None:
                state = self.states.state
                checked = np.count_nonzero(state)
                detail = f"edges of front {self.counts[ROUNDS]}: {checked:,} of {state.size:,} checked"
                self.progress(Progress("checking", seconds=self._seconds(), detail=detail))
            return free(arcs)

        return check

    def _are_free(self, paths: ParetoPaths) -> BoolArray:
        """Return True for each path (n,) that is known to be free."""
        return self.states.are_free(paths.all_arcs, paths.lengths)

    # The result

    def _with_statistics(self, paths: ParetoPaths) -> ParetoPaths:
        """Return the paths, with statistics that sum over all rounds, and with the blocked arcs."""
        rounds, generated, expanded = self.counts.tolist()
        stats = replace(
            paths.stats,
            labels_generated=generated,
            labels_expanded=expanded,
            peak_memory=self.peak,
            seconds_bounds=self.bounds_seconds,
            seconds_search=self._seconds() - self.bounds_seconds,
            seconds_compiled=self.compiled,
            arcs_checked=int(np.count_nonzero(self.states.state)),
            arcs_blocked=int(np.count_nonzero(self.states.blocked)),
            rounds=rounds,
        )
        return replace(paths, stats=stats, blocked=np.flatnonzero(self.states.blocked))

    def _free_part(self, paths: ParetoPaths, status: Status) -> ParetoPaths:
        """Return the free paths known when a limit stopped the search, with the gap to missing paths.

        They are the free paths of the stopped round and of the last round with a complete search. The front of that
        round covers every missing vector within its own gap. So the total gap follows from comparing the free paths
        with the paths of that front that are not known to be free.
        """
        cover = paths if self.cover is None else self.cover
        merged = paths if cover is paths else paths.and_those_of(cover)
        rows = np.flatnonzero(self._are_free(merged))
        rows = rows[np.lexsort(merged.costs[rows].T[::-1])]
        rows = rows[is_nondominated(merged.costs[rows].astype(np.float64))] if rows.size else rows
        free = merged.select(merged.costs, rows)
        front, lost = (
            np.maximum(costs - self.tolerance, 0) for costs in (free.costs, cover.costs[~self._are_free(cover)])
        )
        gap = (1 + cover.gap) * (1 + proven_gap(front, lost)) - 1
        return self._with_statistics(replace(free, status=status, gap=gap))

    # A checkpoint

    def _arrays(self) -> Arrays:
        """Return the states of the arcs as arrays to save in a checkpoint, with a checksum."""
        states = (np.flatnonzero(self.states.state == state) for state in (FREE, BLOCKED))
        saved = dict(zip(SAVED, (*states, np.flatnonzero(self.removed), self.before), strict=True))
        return {**saved, "known": _checksum(list(saved.values()))}

    def _resume(self, arrays: Arrays, path: Path) -> None:
        """Restore the states of the arcs from a checkpoint; raise CheckpointError if they are invalid."""
        if any(name not in arrays or arrays[name].ndim != 1 for name in (*SAVED, "known")):
            raise invalid_checkpoint(path, "it lacks the states of the arcs")
        free, blocked, removed, rounds = saved = [arrays[name] for name in SAVED]
        if _checksum(saved).tolist() != arrays["known"].tolist() or len(rounds) != COUNTS or (rounds < 0).any():
            raise invalid_checkpoint(path, "the states of its arcs do not match their checksum")
        for indices in (free, blocked, removed):
            if (np.diff(indices) <= 0).any() or not (
                0 <= indices.min(initial=0) <= indices.max(initial=0) < self.graph.arcs
            ):
                raise invalid_checkpoint(path, "it names arcs that this graph does not have")
        self.states.record(blocked, np.zeros(blocked.size, np.bool_))
        if self.states.state[free].any() or (self.states.state[removed] != BLOCKED).any():
            raise invalid_checkpoint(path, "an arc in it is both free and blocked, or removed without being blocked")
        self.states.record(free, np.ones(free.size, np.bool_))
        self.removed[removed] = True
        self.before = rounds


def _checksum(arrays: list[IntArray]) -> IntArray:
    """Return a checksum (1,) of some arrays, to detect damage of a checkpoint."""
    checksum = hashlib.blake2b(digest_size=7)
    for array in arrays:
        checksum.update(len(array).to_bytes(8, "little") + array.tobytes())
    return np.array([int.from_bytes(checksum.digest(), "little")])
