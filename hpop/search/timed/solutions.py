"""Solutions of a search on a clock: what they cover, the corners that they leave, and the file that keeps them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.approximation import ANYTHING
from hpop.search.machinery.checkpoint import CheckpointSpec, Keeper, Saved, not_kept
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
    """Solutions, and what counts as one.

    costs, reach  (s, k)  of solutions; the least estimates that they cover
    values        (s,)    as of labels; leaves (s,) the tick at which the last arc is left for
    most          (k,)    what no solution may exceed
    arrive_by     the latest tick of an arrival
    is_target     (n,)
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
    """Whether a solution covers an estimate, or it exceeds what it may."""
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
def solve(goal: SolutionSet, counters: IntArray, g: IntArray, value: int, leaves: int) -> None:
    """Enter a solution, and leave out those that it dominates."""
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


# What they cost follows from the graph: it is reckoned anew, arc by arc and hold by hold, and what is no path of this
# graph on its clock is refused. So whatever the numbers of a file are, what a search returns is true; and as solutions
# only spare it labels that they cover, nothing can be missing because of a file.


METHOD = "timed"
SIZES, ARCS, LEAVES = "sizes", "arcs", "leaves"


class KeptSolutions:
    """The checkpoint of one question, or none."""

    def __init__(self, graph: TimedGraph, checkpoint: CheckpointSpec | None, *question: Any) -> None:
        """Read the file, if it is there; raises CheckpointError where it is not of this question, or not writable."""
        self.graph = graph
        self.keeper = None
        if checkpoint is not None:
            tables = [table for pair in sorted(graph.costs.items()) for table in pair]
            standing = [table for pair in sorted(graph.standing.items()) for table in pair]
            clock = (graph.durations, graph.horizon, graph.timed, *tables, graph.blocked, graph.place, graph.stays)
            rest = (*standing, graph.rate, graph.cut, graph.hold, graph.arrive_by)
            self.keeper = Keeper.of(checkpoint, graph.graph, METHOD, *clock, *rest, *question)

    def seeds(self, tables: TimedTables, source: int, targets: IntArray, clock: Clock) -> list[Seed]:
        """The solutions in the file; raises CheckpointError where they are none."""
        if self.keeper is None or self.keeper.saved is None:
            return []
        path, arrays = self.keeper.path, self.keeper.saved.arrays
        self.keeper.saved = None
        if sorted(arrays) != sorted((SIZES, ARCS, LEAVES)) or any(a.ndim != 1 for a in arrays.values()):
            raise not_kept(path, "its arrays are other ones")
        sizes, arcs, leaves = arrays[SIZES], arrays[ARCS], arrays[LEAVES]
        count, most = len(arcs), self.graph.graph.nodes + self.graph.horizon  # arcs of a path, as costs allow for
        if len(leaves) != count or ((sizes < 1) | (sizes > min(count, most))).any() or int(sizes.sum()) != count:
            raise not_kept(path, "its paths are none")
        ends = np.cumsum(sizes)
        return [
            self._replayed(tables, source, targets, arcs[end - size : end], leaves[end - size : end], clock, path)
            for size, end in zip(sizes.tolist(), ends.tolist(), strict=True)
        ]

    def _replayed(
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
            raise not_kept(path, "a solution is none")
        return Seed(total, arcs.copy(), leaves.copy())

    def keep(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Save, if it is time."""
        if self.keeper is not None:
            self.keeper.snapshot = lambda: self._saved(solutions())
            self.keeper.keep()

    def save(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Write what there is."""
        if self.keeper is not None:
            self.keeper.snapshot = lambda: self._saved(solutions())
            self.keeper.save()

    def _saved(self, solutions: Sequence[Seed]) -> Saved:
        assert self.keeper is not None
        none = np.zeros(0, np.int64)
        arrays = {
            SIZES: np.array([len(seed.arcs) for seed in solutions], np.int64),
            ARCS: np.concatenate([none, *(seed.arcs for seed in solutions)]),
            LEAVES: np.concatenate([none, *(seed.leaves for seed in solutions)]),
        }
        return Saved(METHOD, self.keeper.question, arrays)


# What no solution covers is nowhere larger than one of finitely many corners, the local upper bounds of the solutions:
# with each new solution z, a corner u > z makes way for u with u_j = z_j - 1, one for each j, and those that lie within
# others are left out (Klamroth, Lacour and Vanderpooten, "On the representation of the search region in multi-objective
# optimization", EJOR 2015). A label with estimate f and costs g may become something uncovered only if for one corner c
# f <= c, and w.g + H_w <= w.c for all weights of the joint bounds (:mod:`.joint`), where w.c is infinite if c is in any
# cost that w weighs. Labels are weighed rounded down and corners rounded up, so rounding never prunes.


NEVER = 2**31 - 1  # more than any weighed label
MOST_CORNERS = 4096  # of more, one would have to look at too many


def cut_corners(corners: IntArray, covered: IntArray) -> IntArray:
    """The corners (c, k) that are left when a solution covers all from `covered` (k,) on.

    >>> cut_corners(np.array([[9, 9]]), np.array([4, 6])).tolist()
    [[3, 9], [9, 5]]
    """
    hit = (covered <= corners).all(axis=1)
    if not hit.any():
        return corners
    old, kept = corners[hit], corners[~hit]
    k = corners.shape[1]
    new = np.repeat(old, k, axis=0)
    new[np.arange(len(new)), np.tile(np.arange(k), len(old))] = np.tile(covered - 1, len(old))
    new = np.unique(new[(new >= 0).all(axis=1)], axis=0)
    within = np.array([(one <= kept).all(axis=1).any() or (one <= new).all(axis=1).sum() > 1 for one in new], np.bool_)
    return np.concatenate([kept, new[~within]])


def weighed_corners(corners: IntArray, weights: FloatArray) -> NDArray[np.int32]:
    """Weigh corners (c, k) by the weights (b, LANES, k) of joint bounds: (c, b, LANES)."""
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
    """Whether a label in a state, of that row, with costs g and estimate f (k,) may become what no solution covers.

    hint (1,) is the corner that the last one got into; weighed (b, LANES) is room.
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
