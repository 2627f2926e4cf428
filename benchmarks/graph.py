"""Benchmark of the exact search on any graph: counts that no machine changes, beside seconds.

    python benchmarks/graph.py --arcs FILE --source S --target T [T ...]    a graph in a text file; one JSON line
    python benchmarks/graph.py [--out FILE]                                 graphs with two to six costs; a JSON file

A text file has a line `tail head cost [cost ...]` for each arc, all integers, nodes numbered from 0; what follows a #
is a comment. The graphs of the second use are random grids, made here, and, where they are, the queries on the grids of
Pulido, Mandow and Perez de la Cruz; all are searched by the general method. Ratios are to the bounds of the same run,
one backward Dijkstra a cost. Seconds hold no compiling.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hpop.errors import GraphError, HpopError
from hpop.runtime.limits import Budget
from hpop.search import Graph, ParetoPaths, pareto_paths
from hpop.search.graph import MAX_COSTS
from hpop.search.networks import MAX_INDEX, MAX_SUM

GRIDS = {2: 200, 3: 50, 4: 28, 5: 19, 6: 14}  # nodes a side of the random grid with so many costs
PULIDO = Path(os.environ.get("HPOP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "pulido_grids"
SIDE = 100  # of Pulido's grids
Query = tuple[Graph, int, int]


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arcs", type=Path, help="text file, a line `tail head cost [cost ...]` an arc")
    parser.add_argument("--source", type=int, help="node")
    parser.add_argument("--target", type=int, nargs="+", help="node, or several")
    parser.add_argument("--method", default="auto", help="auto, staircase or general")
    parser.add_argument("--time-limit", type=float, help="s")
    parser.add_argument("--max-memory", type=int, help="bytes")
    parser.add_argument("--out", type=Path, default=Path("out/bench/graph.json"), help="JSON file of the second use")
    arguments = parser.parse_args()
    if arguments.arcs is None:
        write(arguments.out)
    elif arguments.source is None or arguments.target is None:
        parser.error("--arcs needs --source and --target")
    else:
        try:
            budget = Budget(time_limit=arguments.time_limit, max_memory=arguments.max_memory)
            graph = read_arcs(arguments.arcs)
            paths = pareto_paths(graph, arguments.source, arguments.target, budget=budget, method=arguments.method)
        except (HpopError, OSError, UnicodeDecodeError) as error:
            parser.error(str(error))
        print(json.dumps(told(graph, paths)))


def read_arcs(file: Path) -> Graph:
    """Read a graph; raises GraphError with the line that is wrong."""
    rows: list[list[int]] = []
    with file.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            words = line.partition("#")[0].split()
            if words:
                rows.append(_numbers(words, len(rows[0]) if rows else None, f"{file}, line {number}"))
    if not rows:
        raise GraphError(f"{file} holds no arcs; a line `tail head cost [cost ...]` is expected for each")
    table = np.array(rows, np.int64)
    return Graph.from_arcs(int(table[:, :2].max()) + 1, table[:, 0], table[:, 1], table[:, 2:])


def _numbers(words: list[str], expected: int | None, where: str) -> list[int]:
    try:
        row = [int(word) for word in words]
    except ValueError:
        raise GraphError(
            f"{where}: `tail head cost [cost ...]` must be integers, got {' '.join(words)!r}; quantise costs first"
        ) from None
    if not 1 <= len(row) - 2 <= MAX_COSTS:
        raise GraphError(f"{where}: tail, head and 1 to {MAX_COSTS} costs are expected, got {len(row)} numbers")
    if expected is not None and len(row) != expected:
        raise GraphError(f"{where}: {expected - 2} costs are expected, as in the first arc, got {len(row) - 2}")
    if not all(0 <= node < MAX_INDEX for node in row[:2]):
        raise GraphError(f"{where}: nodes must be numbers from 0 to {MAX_INDEX - 1}, got {row[0]} and {row[1]}")
    if not all(0 <= cost <= MAX_SUM for cost in row[2:]):
        raise GraphError(f"{where}: costs must be from 0 to {MAX_SUM}, got {' '.join(words[2:])}")
    return row


def told(graph: Graph, paths: ParetoPaths) -> dict[str, Any]:
    """Return the size of a graph and the result of a search in it."""
    sizes = {"nodes": graph.nodes, "arcs": graph.arcs, "costs": graph.criteria}
    stats = asdict(paths.stats)
    return {**sizes, "status": str(paths.status), "front": len(paths), "seconds": seconds(paths), **stats}


def seconds(paths: ParetoPaths) -> float:
    """Bounds and search together, s."""
    return paths.stats.seconds_bounds + paths.stats.seconds_search


def write(file: Path) -> None:
    """Search the graphs made here and Pulido's."""
    rows = [row(f"random grid {side} x {side}", [random_grid(side, k)]) for k, side in GRIDS.items()]
    if PULIDO.is_dir():
        rows += [row(f"Pulido, Grid{grid}", pulido(grid, k)) for k in (2, 3) for grid in (0, 1)]
    else:
        print(f"Pulido's grids skipped: no folder {PULIDO}; set HPOP_DATA to where the public data are")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps({"instances": rows}, indent=1) + "\n")
    print(f"written to {file}")


def row(name: str, queries: Iterable[Query]) -> dict[str, Any]:
    """Sum over queries; each is searched once before it is measured, so that kernels are loaded."""
    done = []
    for graph, source, target in queries:
        pareto_paths(graph, source, target, method="general", budget=Budget(max_labels=1))
        done.append((graph, pareto_paths(graph, source, target, method="general")))
    every = [paths for _, paths in done]
    search = sum(paths.stats.seconds_search for paths in every)
    generated = sum(paths.stats.labels_generated for paths in every)
    found = {
        "instance": name,
        "queries": len(done),
        "nodes": done[0][0].nodes,
        "arcs": done[0][0].arcs,
        "costs": done[0][0].criteria,
        "front": sum(len(paths) for paths in every),
        "labels_generated": generated,
        "labels_expanded": sum(paths.stats.labels_expanded for paths in every),
        "peak_memory": max(paths.stats.peak_memory for paths in every),
        "seconds": sum(map(seconds, every)),
        "microseconds_a_label": 1e6 * search / max(1, generated),
        "search_over_bounds": search / sum(paths.stats.seconds_bounds for paths in every),
    }
    print(json.dumps(found), flush=True)
    return found


def random_grid(side: int, criteria: int) -> Query:
    """Neighbours joined both ways at costs 1 to 10, from corner to corner."""
    rng = np.random.default_rng(criteria)
    node = np.arange(side * side).reshape(side, side)
    first = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    second = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    costs = rng.integers(1, 11, (2 * len(first), criteria))
    ends = (np.concatenate([first, second]), np.concatenate([second, first]))
    return Graph.from_arcs(side * side, *ends, costs), 0, side * side - 1


def pulido(grid: int, criteria: int) -> Iterator[Query]:
    """Yield the fifteen queries on a grid, with its first costs; each arc of the file is used in both directions."""
    lines = (PULIDO / "grids" / f"Grid{grid}.txt").read_text().splitlines()
    table = np.array([line.split()[1:] for line in lines if line.startswith("a ")], np.int64)
    first, second = table[:, [0, 2]].T * SIDE + table[:, [1, 3]].T
    costs = np.tile(table[:, 4 : 4 + criteria], (2, 1))
    ends = (np.concatenate([first, second]), np.concatenate([second, first]))
    graph = Graph.from_arcs(SIDE * SIDE, *ends, costs)
    for line in (PULIDO / "queries" / "queries2.txt").read_text().splitlines()[3:]:
        if line.strip():
            _, a, b, c, d = map(int, line.split())
            yield graph, a * SIDE + b, c * SIDE + d


if __name__ == "__main__":
    main()
