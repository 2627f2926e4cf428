"""Program of a background process that compiles kernels: the search of a tiny graph, with the types of a real one.

Its parts are "search" (queue and dominance), "bounds" and "weights" (of first answers). Kernels of earlier parts run as
plain Python, since the planning process compiles them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from hpop.runtime import garbage
from hpop.runtime.status import Budget
from hpop.search.graph import Graph
from hpop.search.machinery.beside import kernel_name
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.kernels import is_ready, make_ready
from hpop.search.machinery.slices import Clock, Search
from hpop.search.machinery.turns import Groups
from hpop.search.supported.supported_paths import SupportedRun

SIDE, HEADINGS = 3, 8  # of the lattice
FAR = 2000  # least cost of a move, so that only turns are a small integer cost
NICENESS = 5


class _Rehearsal(Clock):
    """Clock that compiles kernels and prints their names, or runs kernels as plain Python.

    compiles  whether kernels are compiled
    """

    def __init__(self) -> None:
        super().__init__(Budget(), None)
        self.compiles = False

    def prepare(self, compiled: Any, *arguments: Any) -> None:
        if self.compiles and not is_ready(compiled, *arguments):
            print(kernel_name(compiled), flush=True)  # noqa: T201
            make_ready(compiled, *arguments)
            print(flush=True)  # noqa: T201

    def call(self, compiled: Any, *arguments: Any) -> Any:
        self.prepare(compiled, *arguments)
        return (compiled if self.compiles else compiled.py_func)(*arguments)

    def call_all(self, compiled: Any, calls: Sequence[tuple[Any, ...]]) -> list[Any]:
        return [self.call(compiled, *arguments) for arguments in calls]


def rehearse(part: str, aggregates: Sequence[str], turns: int) -> None:
    """Search a tiny lattice, and compile the kernels of one part: "search", "bounds" or "weights".

    turns  column of the cost that counts turns, or -1
    """
    graph, target = lattice(aggregates, turns), np.array([SIDE * SIDE * HEADINGS - 1])
    clock = _Rehearsal()
    groups = Groups.of(graph, clock)
    if part != "search":
        clock.compiles = True
    if part == "bounds":
        lower_bounds(graph, 0, target, clock, groups)
        return
    if part == "weights":
        if "max" not in aggregates:
            SupportedRun(graph, 0, clock).go(target, None, None)
        return
    h = np.zeros((graph.criteria, graph.nodes), np.int64)
    search: Search
    if turns >= 0 and graph.criteria == 3:
        from hpop.search.staircase.search import Staircase

        moving = [j for j in range(3) if j != turns]
        search = Staircase(graph, 0, target, h, (moving[0], turns, moving[1]), groups, clock, width=1)
    else:
        from hpop.search.general.search import General

        search = General(graph, 0, target, h, tuple(range(graph.criteria)), groups, clock)
    clock.compiles = True
    search.run(clock)
    search.paths(search.results()[1], clock)


def lattice(aggregates: Sequence[str], turns: int) -> Graph:
    """Return a small lattice of positions and headings with random costs; column ``turns`` counts turns."""
    rng = np.random.default_rng(0)
    positions = np.arange(SIDE * SIDE)[:, None] * HEADINGS
    a, b = np.nonzero(~np.eye(HEADINGS, dtype=bool))
    step = np.arange(SIDE * SIDE - 1)[:, None] * HEADINGS + np.arange(HEADINGS)
    tails = np.concatenate([(positions + a).ravel(), step.ravel()])
    heads = np.concatenate([(positions + b).ravel(), step.ravel() + HEADINGS])
    is_turn = tails // HEADINGS == heads // HEADINGS
    costs = np.where(is_turn[:, None], FAR, rng.integers(FAR, 2 * FAR, (len(tails), len(aggregates))))
    if turns >= 0:
        costs[:, turns] = is_turn
    return Graph.from_arcs(SIDE * SIDE * HEADINGS, tails, heads, costs, aggregates=aggregates)


def main() -> None:
    """Compile the parts named on the command line, for the costs that it describes."""
    if os.cpu_count() == 1 and hasattr(os, "nice"):  # with more processors a search waits for it
        os.nice(NICENESS)
    garbage.collect_rarely()
    parts, turns, *aggregates = sys.argv[1:]
    for part in parts.split(","):
        rehearse(part, aggregates, int(turns))
