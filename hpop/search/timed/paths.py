"""What a search on a clock finds: cost vectors, each with its steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import IntArray
from hpop.runtime.status import Status
from hpop.search.queries import SearchStats
from hpop.search.timed.graph import TimedGraph

HOLD = -1


class Steps(NamedTuple):
    """A path, arcs and holds one after the other.

    nodes       (s + 1,)  source and target included; a hold has its node twice
    arcs        (s,)      of each, as the caller gave them (`graph.arc`), -1 for a hold
    departures  (s + 1,)  ticks at which each step begins; the last is the arrival
    """

    nodes: IntArray
    arcs: IntArray
    departures: IntArray


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class TimedPaths:
    """A front and its paths.

    costs   (n, k)  int64  rows in lexicographic order
    status  COMPLETE, NO_PATH, or what stopped the search
    stats   what the search did
    gap     every missing vector is covered by one of these within the factor 1 + gap, beside the tolerance asked for
    asked   what is claimed beside completeness, in words: tolerance and bounds, if there were any
    begin   tick at which the source is left, or held at
    """

    costs: IntArray
    status: Status
    stats: SearchStats
    _graph: TimedGraph
    _source: int
    _paths: tuple[tuple[IntArray, IntArray], ...]
    gap: float = field(default=0.0, kw_only=True)
    asked: str = field(default="", kw_only=True)
    begin: int = field(default=0, kw_only=True)

    def __len__(self) -> int:
        return len(self.costs)

    @property
    def places(self) -> tuple[tuple[IntArray, IntArray], ...]:
        """Of each path the places of its arcs in the graph, and the ticks at which they are left for."""
        return self._paths

    def steps(self, i: int) -> Steps:
        """The arcs and holds of path i."""
        arcs, leaves = self._paths[i]  # the arcs without holds, and when each is left for
        source = np.array([self._source], np.int64)
        ends = leaves + self._graph.durations[arcs]
        ready = np.append(self.begin, ends[:-1])[: len(arcs)]
        held = np.flatnonzero(leaves > ready)
        arrival = ends[-1:] if len(arcs) else np.array([self.begin], np.int64)
        nodes = np.concatenate([source, self._graph.graph.heads[arcs].astype(np.int64)])
        return Steps(
            np.insert(nodes, held, nodes[held]),
            np.insert(self._graph.graph.arc[arcs].astype(np.int64), held, HOLD),
            np.append(np.insert(leaves, held, ready[held]), arrival),
        )

    def arrival(self, i: int) -> int:
        """The tick at which path i arrives."""
        return int(self.steps(i).departures[-1])

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self):,} of {self.costs.shape[1]} costs; {self.status}>"
