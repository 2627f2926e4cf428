"""Time the exact search on a graph in a text file: one line an arc, `tail head cost [cost ...]`, integers.

usage: python benchmarks/graph.py --arcs FILE --source S --target T [--method auto] [--time-limit SECONDS]
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from time import perf_counter

import numpy as np

from hpop.planners.search import Graph, pareto_paths
from hpop.status import Budget


def read_arcs(file: str) -> Graph:
    """Nodes are numbered from 0 to the largest number in the file; lines that begin with # are skipped."""
    table = np.loadtxt(file, dtype=np.int64, ndmin=2)
    return Graph.from_arcs(int(table[:, :2].max()) + 1, table[:, 0], table[:, 1], table[:, 2:])


def main() -> None:
    """Search once, print one line of JSON."""
    parser = argparse.ArgumentParser(description="Time the exact search on a graph in a text file.")
    parser.add_argument("--arcs", required=True, help="text file, a line `tail head cost [cost ...]` an arc")
    parser.add_argument("--source", type=int, required=True)
    parser.add_argument("--target", type=int, required=True, nargs="+")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--time-limit", type=float, help="seconds")
    options = parser.parse_args()
    begin = perf_counter()
    graph = read_arcs(options.arcs)
    seconds_read = perf_counter() - begin
    budget = Budget(time_limit=options.time_limit)
    paths = pareto_paths(graph, options.source, options.target, budget=budget, method=options.method)
    result = {"nodes": graph.nodes, "arcs": graph.arcs, "status": str(paths.status), "front": len(paths)}
    print(json.dumps({**result, "seconds_read": seconds_read, **asdict(paths.stats)}))


if __name__ == "__main__":
    main()
