"""Lazy search: whether an arc is free is asked only where a path that was found takes it.

Search the graph as if all arcs were free, ask about those on the paths found until each path is known to be free or
blocked (:mod:`.asked_arcs`), leave out what is blocked, and search again, until all paths of a front are free. That
front is the one of the free part of the graph: what was left out is blocked, and to remove what was not asked about
cannot improve a front whose paths all stay. Lazy roadmaps (Bohlin and Kavraki 2000, doi 10.1109/ROBOT.2000.844107) do
so for one shortest path.
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
from hpop.runtime.status import Budget, Progress, ProgressCallback, Status
from hpop.search.graph import Graph
from hpop.search.machinery.approximation import proven_gap
from hpop.search.machinery.checkpoint import Arrays, Keeper, not_kept
from hpop.search.queries import ParetoPaths

# A path with a blocked arc is of no use whatever its others are, so of each path one arc is asked about at a time,
# until one is blocked: first about the one whose ends have had the largest shares of blocked arcs. Such a choice is an
# edge selector of LazySP (Dellin and Srinivasa 2016, arXiv 1603.03490), here for many paths at once.


UNKNOWN, FREE, BLOCKED = range(3)
AT_ONCE = 1024  # most arcs asked about between two looks at the clock

Free = Callable[[IntArray], BoolArray]
"""Which of some arcs (N,), by their places in the graph, are free."""


class AskedArcs:
    """What is known of the arcs of a graph.

    state  (m,)  UNKNOWN, FREE or BLOCKED
    """

    def __init__(self, graph: Graph, free: Free) -> None:
        """Nothing is known yet; ``free`` is asked about each arc at most once."""
        self.graph, self.free = graph, free
        self.state = np.zeros(graph.arcs, np.uint8)
        self._known = np.zeros(graph.nodes, np.int64)  # arcs that are known, of those that leave or enter each node
        self._blocked = self._known.copy()  # and those of them that are blocked

    @property
    def blocked(self) -> BoolArray:
        """Which arcs (m,) are known to be blocked."""
        return np.asarray(self.state == BLOCKED)

    def know(self, arcs: IntArray, free: BoolArray) -> None:
        """Note of arcs (N,), of which nothing is known yet, which are free."""
        self.state[arcs] = np.where(free, FREE, BLOCKED)
        for ends in self._ends(arcs):
            np.add.at(self._known, ends, 1)
            np.add.at(self._blocked, ends, ~free)

    def settle(self, arcs: IntArray, lengths: IntArray, late: Callable[[], bool]) -> bool:
        """Ask until each path is free all along, or an arc of it is blocked; False where it was late before.

        Parameters
        ----------
        arcs : (N,) of all paths, one path after another
        lengths : (n,) of the paths
        late : is asked after each AT_ONCE arcs
        """
        asked = 0
        while (some := self._next(arcs, lengths)[:AT_ONCE]).size:
            if asked >= AT_ONCE and late():
                return False
            self.know(some, self.free(some))
            asked += some.size
        return True

    def are_free(self, arcs: IntArray, lengths: IntArray) -> BoolArray:
        """Which paths (n,) are known to be free all along; arcs and lengths as in :meth:`settle`."""
        return ~_some(self.state[arcs] != FREE, lengths)

    def _next(self, arcs: IntArray, lengths: IntArray) -> IntArray:
        """Of each path that may be free, the arc of which nothing is known that is blocked most likely."""
        path = np.repeat(np.arange(lengths.size), lengths)
        doubtful = (self.state[arcs] == UNKNOWN) & ~_some(self.state[arcs] == BLOCKED, lengths)[path]
        arcs, path = arcs[doubtful], path[doubtful]
        arcs = arcs[np.lexsort((-self._risk(arcs), path))]
        return distinct(arcs[np.unique(path, return_index=True)[1]])

    def _risk(self, arcs: IntArray) -> FloatArray:
        """The shares of blocked arcs at the ends (N,) of arcs, added up; half where nothing is known."""
        tails, heads = ((self._blocked[ends] + 0.5) / (self._known[ends] + 1.0) for ends in self._ends(arcs))
        return np.asarray(tails + heads)

    def _ends(self, arcs: IntArray) -> tuple[IntArray, IntArray]:
        """Tails and heads (N,) of arcs."""
        tails = np.searchsorted(self.graph.indptr, arcs, side="right") - 1
        return tails, self.graph.heads[arcs].astype(np.int64)


def _some(marked: BoolArray, lengths: IntArray) -> BoolArray:
    """Which paths (n,) have an arc that is marked (N,)."""
    path = np.repeat(np.arange(lengths.size), lengths)
    return np.asarray(np.bincount(path, marked, minlength=lengths.size) > 0)


LEAST = 1e-9  # s: a budget that is left is positive
ROUNDS, GENERATED, EXPANDED, COUNTS = range(4)
KEPT = ("arcs_free", "arcs_blocked", "arcs_left_out", "rounds")  # in a checkpoint


class LazyRun:
    """One query on a graph of which some arcs may be blocked."""

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
        """Begin, or go on from what the keeper has.

        Parameters
        ----------
        free : is asked about each arc at most once
        search : finds the paths of a part of the graph, with what is left of the budget
        tolerance : (k,) of the search
        """
        self.graph, self.search, self.tolerance = graph, search, tolerance
        self.budget, self.progress, self.keeper = budget, progress, keeper
        self.asked = AskedArcs(graph, self._reported(free))
        self.left_out = np.zeros(graph.arcs, np.bool_)  # without which the graph is searched
        self.counts = np.zeros(COUNTS, np.int64)
        self.before = self.counts.copy()  # those of the rounds that ended
        self.bounds_seconds = self.compiled = 0.0
        self.peak = 0
        self.began = perf_counter()
        self.paths: ParetoPaths | None = None  # of the last round
        self.cover: ParetoPaths | None = None  # of the last round whose search ended by itself
        if keeper is not None:
            if keeper.saved is not None:
                self._resume(keeper.saved.arrays, keeper.path)
            keeper.begin(self._arrays())

    def go(self) -> ParetoPaths:
        """Search, ask, leave out, until a front is free, or a limit is passed."""
        try:
            status = self._until_free()
        except KeyboardInterrupt:
            status = Status.INTERRUPTED
        if self.paths is None:
            raise KeyboardInterrupt
        if status.is_final:
            return self._counted(self.paths)
        self._note(self.paths)
        if self.keeper is not None:
            self.keeper.save()
        return self._stopped(self.paths, status)

    def _until_free(self) -> Status:
        while True:
            paths = self.paths = self._searched()
            settled = self.asked.settle(paths.all_arcs, paths.lengths, self._late)
            if not paths.status.is_final or self._rows(paths).all():
                return paths.status
            if not settled:
                return Status.TIME_LIMIT
            self._note(paths)
            if self.keeper is not None:
                self.keeper.keep()

    def _note(self, paths: ParetoPaths) -> None:
        """What was learnt of the arcs of these paths: the next search begins with it, or the one that was stopped."""
        ended = paths.status.is_final
        if ended:
            self.cover, self.left_out, self.before = paths, self.asked.blocked, self.counts.copy()
        if self.keeper is not None:
            self.keeper.begin(self._arrays()) if ended else self.keeper.amend(self._arrays())

    # A round

    def _searched(self) -> ParetoPaths:
        """The paths of the graph without what is known to be blocked, their arcs as places in the whole graph."""
        limit, most = self.budget.time_limit, self.budget.max_labels
        part = self.graph.without(self.left_out)
        size = part.costs.nbytes + part.heads.nbytes + part.arc.nbytes + part.indptr.nbytes + self.asked.state.nbytes
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
        """Seconds since the search began, without compiling."""
        return perf_counter() - self.began - self.compiled

    def _late(self) -> bool:
        """Whether the limit of time is passed."""
        limit = self.budget.time_limit
        return limit is not None and self._seconds() >= limit

    def _reported(self, free: Free) -> Free:
        """The same question, which reports how far asking is."""

        def asked(arcs: IntArray) -> BoolArray:
            if self.progress is not None:
                state = self.asked.state
                known = np.count_nonzero(state)
                detail = f"edges of front {self.counts[ROUNDS]}: {known:,} of {state.size:,} looked at"
                self.progress(Progress("checking", seconds=self._seconds(), detail=detail))
            return free(arcs)

        return asked

    def _rows(self, paths: ParetoPaths) -> BoolArray:
        """Which paths (n,) are known to be free all along."""
        return self.asked.are_free(paths.all_arcs, paths.lengths)

    # What is answered

    def _counted(self, paths: ParetoPaths) -> ParetoPaths:
        """The same with the counts of all rounds."""
        rounds, generated, expanded = self.counts.tolist()
        stats = replace(
            paths.stats,
            labels_generated=generated,
            labels_expanded=expanded,
            peak_memory=self.peak,
            seconds_bounds=self.bounds_seconds,
            seconds_search=self._seconds() - self.bounds_seconds,
            seconds_compiled=self.compiled,
            arcs_checked=int(np.count_nonzero(self.asked.state)),
            arcs_blocked=int(np.count_nonzero(self.asked.blocked)),
            rounds=rounds,
        )
        return replace(paths, stats=stats, blocked=np.flatnonzero(self.asked.blocked))

    def _stopped(self, paths: ParetoPaths, status: Status) -> ParetoPaths:
        """What is known to be free of these paths and of the last front, and how much better others may be.

        Whatever is missing, some vector of a front that was searched to its end is nowhere larger, or of one that was
        not, within its gap: so it is enough to compare those that are kept with those that are not.
        """
        cover = paths if self.cover is None else self.cover
        several = paths if cover is paths else paths.and_those_of(cover)
        rows = np.flatnonzero(self._rows(several))
        rows = rows[np.lexsort(several.costs[rows].T[::-1])]
        rows = rows[is_nondominated(several.costs[rows].astype(np.float64))] if rows.size else rows
        kept = several.select(several.costs, rows)
        front, lost = (np.maximum(costs - self.tolerance, 0) for costs in (kept.costs, cover.costs[~self._rows(cover)]))
        gap = (1 + cover.gap) * (1 + proven_gap(front, lost)) - 1
        return self._counted(replace(kept, status=status, gap=gap))

    # A checkpoint

    def _arrays(self) -> Arrays:
        """What is kept beside the search's own, with evidence that none of it is another."""
        states = (np.flatnonzero(self.asked.state == state) for state in (FREE, BLOCKED))
        known = dict(zip(KEPT, (*states, np.flatnonzero(self.left_out), self.before), strict=True))
        return {**known, "known": _evidence(list(known.values()))}

    def _resume(self, arrays: Arrays, path: Path) -> None:
        """Take what was known; raises CheckpointError where that cannot be."""
        if any(name not in arrays or arrays[name].ndim != 1 for name in (*KEPT, "known")):
            raise not_kept(path, "it lacks what is known of the arcs")
        free, blocked, left_out, rounds = known = [arrays[name] for name in KEPT]
        if _evidence(known).tolist() != arrays["known"].tolist() or len(rounds) != COUNTS or (rounds < 0).any():
            raise not_kept(path, "what it knows of the arcs is not what was known")
        for places in (free, blocked, left_out):
            if (np.diff(places) <= 0).any() or places.min(initial=0) < 0 or places.max(initial=-1) >= self.graph.arcs:
                raise not_kept(path, "it names other arcs than this graph has")
        self.asked.know(blocked, np.zeros(blocked.size, np.bool_))
        if self.asked.state[free].any() or (self.asked.state[left_out] != BLOCKED).any():
            raise not_kept(path, "an arc cannot be free and blocked")
        self.asked.know(free, np.ones(free.size, np.bool_))
        self.left_out[left_out] = True
        self.before = rounds


def _evidence(arrays: list[IntArray]) -> IntArray:
    """A number (1,) that tells arrays from others."""
    checksum = hashlib.blake2b(digest_size=7)
    for array in arrays:
        checksum.update(len(array).to_bytes(8, "little") + array.tobytes())
    return np.array([int.from_bytes(checksum.digest(), "little")])
