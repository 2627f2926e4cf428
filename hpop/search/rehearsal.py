"""Program of a background process that compiles kernels by searching a tiny graph, with the types of a real search.

A process compiles the kernels of one or more parts: "search" (queue and dominance), "bounds" (lower bounds) and
"weights" (weighted sums, for a first result). Kernels that a part needs from other parts run as plain Python, since
other processes compile them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from hpop.runtime import interrupts
from hpop.runtime.limits import Budget
from hpop.search.general.search import General
from hpop.search.graph import Graph
from hpop.search.machinery.beside import kernel_name
from hpop.search.machinery.bounds import lower_bounds
from hpop.search.machinery.kernels import is_ready, make_ready
from hpop.search.machinery.slices import Clock, Search
from hpop.search.machinery.turns import Groups
from hpop.search.staircase.search import Staircase
from hpop.search.supported.supported_paths import SupportedRun

SIDE, HEADINGS = 3, 8  # positions along each side of the lattice, and headings
FAR = 2000  # least cost of a move, so that only the number of turns is a small integer cost
NICENESS = 5  # added to the process's niceness, so that it yields to a search


class _Rehearsal(Clock):
    """Clock through which the tiny search calls its kernels: it compiles and names them, or runs them as Python.

    The name of a kernel is printed before it is compiled, and an empty line after that.

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
    """Compile the kernels of one part ("search", "bounds" or "weights") by searching a tiny lattice.

    aggregates  "sum" or "max" for each cost
    turns       column of the cost that counts turns, or -1
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
        moving = [j for j in range(3) if j != turns]
        search = Staircase(graph, 0, target, h, (moving[0], turns, moving[1]), groups, clock, width=1)
    else:
        search = General(graph, 0, target, h, tuple(range(graph.criteria)), groups, clock)
    clock.compiles = True
    search.run(clock)
    search.paths(search.results()[1], clock)


def lattice(aggregates: Sequence[str], turns: int) -> Graph:
    """Return the graph of a small lattice of positions and headings, with random costs; cost ``turns`` counts turns."""
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
    """Compile the kernels of the parts named on the command line, for the kinds of costs that it lists."""
    if os.cpu_count() == 1 and hasattr(os, "nice"):  # with more processors the search waits, so no yielding
        os.nice(NICENESS)
    interrupts.collect_rarely()
    parts, turns, *aggregates = sys.argv[1:]
    for part in parts.split(","):
        rehearse(part, aggregates, int(turns))
