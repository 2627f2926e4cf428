"""Benchmark of weighted sums: sweeps on a museum's lattice, on one core and with worker processes.

    python benchmarks/weighted_sum.py [--museum m160] [--weights 50] [--workers 2] [--out FILE]

Two sweeps: weights drawn at random (uniform on the simplex, fixed seed), and the adaptive one, which finds all extreme
supported points. The run without workers is kept on one core. Seconds hold bounds, reduction and shipping, not the
building of the graph nor the start of workers; `over_dijkstra` divides them by one scipy shortest-path tree on the same
graph. Counts depend on no machine.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import museums
import numpy as np
from lattice import scipy_dijkstra

from hpop.planners import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.runtime.sweep import processes
from hpop.search import Graph, SupportedPaths, supported_paths

RUNS = 3


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--museum", choices=list(museums.SIZES), default="m160")
    parser.add_argument("--weights", type=int, default=50, help="random weights of the first sweep")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    arguments = parser.parse_args()
    result = measured(arguments.museum, arguments.weights, arguments.workers)
    print(json.dumps(result, indent=1))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(result, indent=1) + "\n")


def measured(name: str, count: int, workers: int) -> dict[str, Any]:
    """Both sweeps of a museum, each with and without workers."""
    problem = museums.problem(name)
    planner = Lattice(step=museums.CELL)
    lattice = planner.lattice(problem)
    space, start, goals = planner.ends(lattice, problem)
    graph = space.graph(edge_objectives(problem.criteria, "benchmark").optimised)
    tree = min(scipy_dijkstra(graph, start) for _ in range(RUNS))
    weights = np.random.default_rng(0).dirichlet([1.0] * graph.criteria, size=count).tolist()
    sweeps: dict[str, dict[str, Any]] = {f"{count} weights": {"weights": weights}, "adaptive": {}}
    row: dict[str, Any] = {"museum": name, "states": graph.nodes, "edges": graph.arcs, "dijkstra_s": tree}
    with processes(workers) as pool:
        warm_up(pool, workers)
        for sweep, options in sweeps.items():
            with one_core():
                one, alone = best(graph, start, goals, None, options)
            many, there = best(graph, start, goals, pool, options)
            if (alone.costs != there.costs).any() or there.notes:
                raise AssertionError(f"workers change the result: {there.notes}")
            row[sweep] = {
                "weights_solved": alone.solved,
                "points": len(alone),
                "one_core_s": one,
                "workers": workers,
                "workers_s": many,
                "speed_up": one / many,
                "over_dijkstra": one / tree,
                "weight_over_dijkstra": one / tree / alone.solved,
            }
    return row


def warm_up(pool: Executor, workers: int) -> None:
    """Load the kernels here and in every worker, so that what follows is measured and not the compiler."""
    costs = np.random.default_rng(0).integers(1, 1000, size=(500, 3))
    graph = Graph.from_arcs(2, [0] * 500, [1] * 500, costs)
    for executor in (None, *[pool] * (2 * workers)):
        supported_paths(graph, 0, 1, divisions=40, executor=executor)


@contextmanager
def one_core() -> Iterator[None]:
    """Keep this process on one core: the bounds would take all of them, with workers and without."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def best(
    graph: Graph, start: int, goals: list[int], executor: Executor | None, options: dict[str, Any]
) -> tuple[float, SupportedPaths]:
    """Least seconds of some runs, and what the last one found."""
    seconds = []
    for _ in range(RUNS):
        began = time.perf_counter()
        found = supported_paths(graph, start, goals, executor=executor, **options)
        seconds.append(time.perf_counter() - began)
    return min(seconds), found


if __name__ == "__main__":
    main()
