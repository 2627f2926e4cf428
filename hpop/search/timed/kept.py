"""Solutions in a file, with which a search begins again: of each its arcs, and the ticks at which they are left for.

What they cost follows from the graph: it is reckoned anew, arc by arc and hold by hold, and what is no path of this
graph on its clock is refused. So whatever the numbers of a file are, what a search returns is true; and as solutions
only spare it labels that they cover, nothing can be missing because of a file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import IntArray
from hpop.search.machinery.checkpoint import CheckpointSpec, Keeper, Saved, not_kept
from hpop.search.machinery.slices import Clock
from hpop.search.timed.bounds import Seed
from hpop.search.timed.graph import TimedGraph
from hpop.search.timed.tables import Tables
from hpop.search.timed.walks import cost_of_walk

if TYPE_CHECKING:
    from pathlib import Path

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

    def seeds(self, tables: Tables, source: int, targets: IntArray, clock: Clock) -> list[Seed]:
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
        self, tables: Tables, source: int, targets: IntArray, arcs: IntArray, leaves: IntArray, clock: Clock, path: Path
    ) -> Seed:
        total = np.zeros(self.graph.graph.criteria, np.int64)
        end = clock.call(cost_of_walk, tables, source, 0, arcs, leaves, total)
        late = self.graph.arrive_by is not None and leaves[-1] + self.graph.durations[arcs[-1]] > self.graph.arrive_by
        if end not in targets or late:
            raise not_kept(path, "a solution is none")
        return Seed(total, arcs.copy(), leaves.copy())

    def keep(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Save, if it is time."""
        if self.keeper is not None:
            self.keeper.made = lambda: self._saved(solutions())
            self.keeper.keep()

    def save(self, solutions: Callable[[], Sequence[Seed]]) -> None:
        """Write what there is."""
        if self.keeper is not None:
            self.keeper.made = lambda: self._saved(solutions())
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
