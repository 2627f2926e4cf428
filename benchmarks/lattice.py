"""Benchmark of the exact lattice search: counts that no machine changes, and ratios beside seconds.

    python benchmarks/lattice.py --out FILE            museums of growing size, made here; a JSON file
    python benchmarks/lattice.py --instance FOLDER     a graph in binary files; one JSON line, and FOLDER/front_hpop.txt

An instance folder holds indptr.bin (int64), heads.bin (int32), costs.bin (int32, edges x 3: phi, turns, length) and
meta.txt (width height start goal). A museum's ratio is the search's time over one scipy Dijkstra's on its graph.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import museums
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from hpop.criteria import make_criterion
from hpop.planners import Lattice
from hpop.planners.search import Graph, ParetoPaths, pareto_paths

RUNS = 3


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instance", type=Path, help="folder of one instance")
    parser.add_argument("--out", type=Path, default=Path("out/bench/lattice.json"), help="JSON file of the museums")
    arguments = parser.parse_args()
    warm_up()
    if arguments.instance:
        print(json.dumps(instance(arguments.instance)))
        return
    rows = [museum(name) for name in museums.SIZES]
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"runs": RUNS, "instances": rows}, indent=1) + "\n")
    print(f"written to {arguments.out}")


def warm_up() -> None:
    """Compile or load every kernel, so that what follows is measured and not the compiler."""
    rng = np.random.default_rng(0)
    tails, heads = rng.integers(0, 50, size=(2, 400))
    costs = rng.integers(0, 5, size=(400, 3)).astype(np.int64)
    pareto_paths(Graph.from_arcs(50, tails, heads, costs), 0, 49)
    museums.problem("m60").solve(Lattice(step=1.0))


def instance(folder: Path) -> dict[str, Any]:
    """Search one instance folder, and write its front, `phi turns length` a line."""
    began = time.perf_counter()
    indptr = np.fromfile(folder / "indptr.bin", dtype=np.int64)
    heads = np.fromfile(folder / "heads.bin", dtype=np.int32)
    costs = np.fromfile(folder / "costs.bin", dtype=np.int32).reshape(heads.size, -1)
    _, _, start, goal = map(int, (folder / "meta.txt").read_text().split())
    graph = Graph.from_csr(indptr, heads, costs)
    built = time.perf_counter()
    paths = pareto_paths(graph, start, goal)
    searched = time.perf_counter()
    (folder / "front_hpop.txt").write_text("".join(f"{a} {b} {c}\n" for a, b, c in paths.costs.tolist()))
    return {"build_s": built - began, "search_s": searched - built, **counts(paths)}


def counts(paths: ParetoPaths) -> dict[str, Any]:
    """What a search found and did, and the memory of this process."""
    return {
        "front": len(paths.costs),
        "labels_generated": paths.stats.labels_generated,
        "labels_expanded": paths.stats.labels_expanded,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 if sys.platform == "darwin" else 1024),
    }


def museum(name: str) -> dict[str, Any]:
    """Build and search one museum several times; medians."""
    problem = museums.problem(name)
    planner = Lattice(step=museums.CELL)
    criteria = [make_criterion(c) for c in ("exposure", "turns", "length")]
    builds, searches, trees = [], [], []
    for _ in range(RUNS):
        fresh = museums.problem(name)  # no field, no border from the run before
        began = time.perf_counter()
        lattice = planner.lattice(fresh)
        graph = lattice.graph(criteria)
        builds.append(time.perf_counter() - began)
        start, goals, _ = planner.ends(lattice, problem)
        began = time.perf_counter()
        paths = pareto_paths(graph, start, goals)
        searches.append(time.perf_counter() - began)
        trees.append(scipy_dijkstra(graph, start))
    row = {
        "name": name,
        "states": lattice.size,
        "edges": int(graph.heads.size),
        **counts(paths),
        "build_s": statistics.median(builds),
        "search_s": statistics.median(searches),
        "search_over_dijkstra": statistics.median(s / t for s, t in zip(searches, trees, strict=True)),
    }
    print(json.dumps(row))
    return row


def scipy_dijkstra(graph: Graph, start: int) -> float:
    """Seconds of one shortest-path tree by scipy on the same graph; this lattice has no parallel arcs."""
    length = graph.costs[:, 2] + 1.0  # scipy drops explicit zeros
    matrix = csr_array((length, graph.heads, graph.indptr), shape=(graph.nodes, graph.nodes))
    began = time.perf_counter()
    dijkstra(matrix, indices=start)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
