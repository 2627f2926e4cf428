"""Solutions of a search on a time-dependent graph: coverage, corners of the uncovered region, checkpoint file.

A label is a partial path; its estimate f (k,) has lower bounds of the costs of all solutions that begin with it. A tick
is the unit of time of the search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery import ANYTHING
from hpop.search.machinery.checkpoint import CheckpointSpec, Keeper, Saved, invalid_checkpoint
from hpop.search.machinery.kernels import least_covered
from hpop.search.machinery.slices import N_FRONT, Clock
from hpop.search.timed.best_paths import path_cost
from hpop.search.timed.bounds import Seed
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.joint import DOWN, FAR, LANES, UP, JointTables
from hpop.search.timed.tables import TimedTables

if TYPE_CHECKING:
    from pathlib import Path


class SolutionSet(NamedTuple):
    """Solutions so far, and what further solutions must satisfy.

    costs      (s, k)  costs of solutions
    reach      (s, k)  costs that each solution covers: by the precision, no path that costs at least these is needed
    values     (s,)    labels (paths) of solutions: parent and last arc; negative for solutions known before the search
    leaves     (s,)    tick of departure by the last arc
    most       (k,)    upper bounds on the costs of solutions
    arrive_by  latest tick of an arrival
    is_target  (n,)    mask of nodes
    eps, tolerance     precision of the front: relative, and (k,) absolute in quanta
    """

    costs: IntArray
    reach: IntArray
    values: IntArray
    leaves: IntArray
    most: IntArray
    arrive_by: int
    is_target: NDArray[np.uint8]
    eps: float
    tolerance: IntArray


@lean
def is_covered(goal: SolutionSet, count: int, f: IntArray) -> bool:
    """Return whether an estimate f (k,) is of no use: one of `count` solutions covers it, or it exceeds a bound.

    goal  solutions so far, with the bounds
    f     lower bounds of the costs of all solutions that begin with a label (partial path)
    """
    k = len(f)
    for j in range(k):
        if f[j] > goal.most[j]:
            return True
    for i in range(count - 1, -1, -1):
        covers = True
        for j in range(k):
            covers &= goal.reach[i, j] <= f[j]
        if covers:
            return True
    return False


@lean
def insert_solution(goal: SolutionSet, counters: IntArray, g: IntArray, value: int, leaves: int) -> None:
    """Add a solution, and remove solutions that it dominates.

    goal      solutions so far, changed in place; `counters` at N_FRONT has their number
    g         (k,)  costs of the new solution
    value     its path, as a label: parent and last arc; negative for a solution known before the search
    leaves    tick of departure by its last arc
    """
    k = len(g)
    kept = 0
    for i in range(counters[N_FRONT]):
        dominated = True
        for j in range(k):
            dominated &= g[j] <= goal.costs[i, j]
        if dominated:
            continue
        if kept < i:
            for j in range(k):
                goal.costs[kept, j] = goal.costs[i, j]
                goal.reach[kept, j] = goal.reach[i, j]
            goal.values[kept] = goal.values[i]
            goal.leaves[kept] = goal.leaves[i]
        kept += 1
    for j in range(k):
        goal.costs[kept, j] = g[j]
        goal.reach[kept, j] = least_covered(g[j], goal.eps, goal.tolerance[j])
    goal.values[kept] = value
    goal.leaves[kept] = leaves
    counters[N_FRONT] = kept + 1


# Costs of solutions in a file are computed again from the graph, arc by arc and hold by hold, and entries that are no
# path of the time-dependent graph are refused. So results are correct whatever the file contains. They are complete as
# well, since solutions only prune labels that they cover.


METHOD = "timed"
SIZES, ARCS, LEAVES = "sizes", "arcs", "leaves"


class StoredSolutions:
    """Checkpoint file of one query, which stores its solutions; it does nothing if the query has no checkpoint."""

    def __init__(self, graph: TimedGraph, checkpoint: CheckpointSpec | None, *question: Any) -> None:
        """Read the file if it exists; raise CheckpointError if it belongs to another query or is not writable.

        ``question`` has all arguments beside the graph that identify the query.
        """
        self.graph = graph
        self.keeper = None
        if checkpoint is not None:
            tables = [table for pair in sorted(graph.costs.items()) for table in pair]
            standing = [table for pair in sorted(graph.standing.items()) for table in pair]
            arcs = graph.durations, graph.horizon, graph.timed, graph.rows
            clock = (*arcs, *tables, graph.blocked, graph.place, graph.stays)
            rest = (*standing, graph.rate, graph.cut, graph.hold, graph.arrive_by)
            self.keeper = Keeper.of(checkpoint, graph.graph, METHOD, *clock, *rest, *question)

    def seeds(self, tables: TimedTables, source: int, targets: IntArray, clock: Clock) -> list[Seed]:
        """Return the solutions in the file, checked on the graph; raise CheckpointError for invalid ones."""
        if self.keeper is None or self.keeper.saved is None:
            return []
        path, arrays = self.keeper.path, self.keeper.saved.arrays
        self.keeper.saved = None
        if sorted(arrays) != sorted((SIZES, ARCS, LEAVES)) or any(a.ndim != 1 for a in arrays.values()):
            raise invalid_checkpoint(path, "its arrays have other names or shapes")
        sizes, arcs, leaves = arrays[SIZES], arrays[ARCS], arrays[LEAVES]
        count, most = len(arcs), self.graph.graph.nodes + self.graph.horizon  # arcs of a path, as costs allow for
        if len(leaves) != count or ((sizes < 1) | (sizes > min(count, most))).any() or int(sizes.sum()) != count:
            raise invalid_checkpoint(path, "its paths are invalid")
        ends = np.cumsum(sizes)
        return [
            self._checked_solution(
                tables, source, targets, arcs[end - size : end], leaves[end - size : end], clock, path
            )
            for size, end in zip(sizes.tolist(), ends.tolist(), strict=True)
        ]

    def _checked_solution(
        self,
        tables: TimedTables,
        source: int,
        targets: IntArray,
        arcs: IntArray,
        leaves: IntArray,
        clock: Clock,
        path: Path,
    ) -> Seed:
        total = np.zeros(self.graph.graph.criteria, np.int64)
        end = clock.call(path_cost, tables, source, 0, arcs, leaves, total)
        late = self.graph.arrive_by is not None and leaves[-1] + self.graph.durations[arcs[-1]] > self.graph.arrive_by
        if end not in targets or late:
            raise invalid_checkpoint(path, "a solution is invalid")
        return Seed(total, arcs.copy(), leaves.copy())

    def save_if_due(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Write the solutions to the file if the interval between two writes has passed."""
        if self.keeper is not None:
            self.keeper.snapshot = lambda: self._checkpoint_content(solutions())
            self.keeper.save_if_due()

    def save(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Write the solutions to the file now."""
        if self.keeper is not None:
            self.keeper.snapshot = lambda: self._checkpoint_content(solutions())
            self.keeper.save()

    def _checkpoint_content(self, solutions: Sequence[Seed]) -> Saved:
        assert self.keeper is not None
        none = np.zeros(0, np.int64)
        arrays = {
            SIZES: np.array([len(seed.arcs) for seed in solutions], np.int64),
            ARCS: np.concatenate([none, *(seed.arcs for seed in solutions)]),
            LEAVES: np.concatenate([none, *(seed.leaves for seed in solutions)]),
        }
        return Saved(METHOD, self.keeper.question, arrays)


# Every vector that no solution covers lies below one of finitely many corners, the local upper bounds of the solutions.
# With each new solution z, a corner u > z is replaced by copies of u with u_j = z_j - 1, one for each j, and corners
# below other corners are removed (Klamroth, Lacour and Vanderpooten, "On the representation of the search region in
# multi-objective optimization", EJOR 2015). A label with estimate f and costs g can lead to an uncovered solution only
# if there is a corner c with f <= c, and with w.g + H_w <= w.c for all weights w of the joint bounds H_w
# (:mod:`.joint`). Here w.c is infinite if c is infinite in any cost that w weighs. Labels are rounded down and corners
# up, so rounding never prunes a label wrongly.


NEVER = 2**31 - 1  # larger than the weighted sum of any label
MOST_CORNERS = 4096  # more corners would take too long to compare


def cut_corners(corners: IntArray, covered: IntArray) -> IntArray:
    """Return the corners (c, k) of the uncovered region after a new solution, which covers vectors >= `covered` (k,).

    >>> cut_corners(np.array([[9, 9]]), np.array([4, 6])).tolist()
    [[3, 9], [9, 5]]
    """
    hit = (covered <= corners).all(axis=1)
    if not hit.any():
        return corners
    old, others = corners[hit], corners[~hit]
    k = corners.shape[1]
    new = np.repeat(old, k, axis=0)
    new[np.arange(len(new)), np.tile(np.arange(k), len(old))] = np.tile(covered - 1, len(old))
    new = np.unique(new[(new >= 0).all(axis=1)], axis=0)
    within = np.array(
        [(row <= others).all(axis=1).any() or (row <= new).all(axis=1).sum() > 1 for row in new], np.bool_
    )
    return np.concatenate([others, new[~within]])


def weighed_corners(corners: IntArray, weights: FloatArray) -> NDArray[np.int32]:
    """Return the weighted sums (c, b, LANES) of corners (c, k) for b tables of weights (b, LANES, k), rounded up.

    Corners bound the region of costs that no solution covers. The joint bounds of a partial path are compared with
    these sums.
    """
    weighed = np.zeros((len(corners), *weights.shape[:2]))
    for j in range(corners.shape[1]):
        limit = corners[:, j, None, None]
        weighed += np.where((limit < ANYTHING) | (weights[:, :, j] == 0), weights[:, :, j] * limit, np.inf)
    return np.minimum(weighed * UP + 1, NEVER).astype(np.int32)


@lean
def may_improve(
    joint: JointTables,
    corners: IntArray,
    lanes: NDArray[np.int32],
    row: int,
    g: IntArray,
    f: IntArray,
    hint: IntArray,
    weighed: NDArray[np.int32],
) -> bool:
    """Return False if joint bounds prove that solutions cover every path that begins with a label (partial path).

    joint           joint bounds (:mod:`.joint`): b tables with LANES weights each
    corners, lanes  see :class:`.PruningBounds`
    row             row of the label's node and tick in the joint bounds
    g, f            (k,)  costs of the label, and lower bounds of the costs of all paths that begin with it
    hint            (1,)  index of the corner that let the last label pass; it is tried first, and updated
    weighed         (b, LANES)  scratch
    """
    k = len(g)
    tables = len(joint.rows)
    for b in range(tables):
        for lane in range(LANES):
            total = 0.0
            for j in range(k):
                total += joint.weights[b, lane, j] * g[j]
            weighed[b, lane] = np.int32(min(FAR - 1.0, total * DOWN)) + joint.rows[b, row, lane]
    for i in range(-1, len(corners)):
        c = i
        if i < 0:
            c = hint[0]
            if c >= len(corners):
                continue
        inside = True
        for j in range(k):
            inside &= f[j] <= corners[c, j]
        if not inside:
            continue
        for b in range(tables):
            for lane in range(LANES):
                inside &= weighed[b, lane] <= lanes[c, b, lane]
            if not inside:
                break
        if inside:
            hint[0] = c
            return True
    return False
