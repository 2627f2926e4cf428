"""Benchmark of the exact lattice search: counts that no machine changes, and ratios beside seconds.

    python benchmarks/lattice.py --out FILE            museums of growing size, made here, and real maps; a JSON file
    python benchmarks/lattice.py --instance FOLDER     a graph in binary files; one JSON line, and FOLDER/front_hpop.txt

An instance folder holds indptr.bin (int64), heads.bin (int32), costs.bin (int32, edges x 3: phi, turns, length) and
meta.txt (width height start goal). Every museum and map is searched exactly and with two relative precisions, each in
a process of its own; the ratio is the search's time, bounds included, over one scipy Dijkstra's on the same graph.
Fails when a search needs over 20 % more labels than label_counts.json says. Maps that are absent are skipped.
"""

from __future__ import annotations

import argparse
import json
import resource
import statistics
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import label_counts
import maps
import museums
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from hpop.criteria import make_criterion
from hpop.planners import Lattice
from hpop.search import Graph, ParetoPaths, pareto_paths

COSTS = ("exposure", "turns", "length")
CASES = [*((name, museums.CELL) for name in museums.SIZES if name != "m300")]  # and the step, m
CASES += [("aws_bookstore", 0.25), ("pal_office", 0.25), ("nav2_depot", 0.25), ("field_museum", 0.5)]
LARGE = [("m300", museums.CELL), ("field_museum", 0.25)]
PRECISIONS = (0.1, 0.01, 0.0)  # eps; the least memory first, as the peak of a process never falls
RUNS = 3
PATIENCE = 20.0  # s, after which an instance is not run again


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instance", type=Path, help="folder of one instance")
    parser.add_argument("--out", type=Path, default=Path("out/bench/lattice.json"), help="JSON file of the museums")
    parser.add_argument("--large", action="store_true", help="also m300 and the Field Museum at 0.25 m: minutes")
    parser.add_argument("--write-counts", action="store_true", help="take these counts of labels for reference")
    arguments = parser.parse_args()
    if arguments.instance:
        warm_up()
        print(json.dumps(instance(arguments.instance)))
        return
    rows = ladder(CASES + LARGE * arguments.large)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"runs": RUNS, "instances": rows}, indent=1) + "\n")
    print(f"written to {arguments.out}")
    if arguments.write_counts:
        label_counts.write(rows)
    elif worse := label_counts.regressions(rows, label_counts.read()):
        sys.exit("\n".join([*worse, "Find out why; if it has to be, --write-counts takes the new counts."]))


def warm_up() -> None:
    """Compile or load every kernel, so that what follows is measured and not the compiler."""
    rng = np.random.default_rng(0)
    tails, heads = rng.integers(0, 50, size=(2, 400))
    costs = rng.integers(0, 5, size=(400, 3)).astype(np.int64)
    pareto_paths(Graph.from_arcs(50, tails, heads, costs), 0, 49)
    problem, planner = museums.problem("m100"), Lattice(step=museums.CELL)  # long enough for bounds by turns
    lattice = planner.lattice(problem)
    space, start, goals = planner.ends(lattice, problem)
    graph = space.graph([make_criterion(name) for name in COSTS])
    free_turns = np.where(graph.costs[:, [1]] > 0, [0, 1, 0], graph.costs)  # all alike: other kernels than by angle
    for costs in (graph.costs, free_turns):
        pareto_paths(Graph.from_csr(graph.indptr, graph.heads, costs), start, goals)


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
    """Return the counts of a search, and the memory of this process."""
    return {
        "front": len(paths.costs),
        "labels_generated": paths.stats.labels_generated,
        "labels_expanded": paths.stats.labels_expanded,
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 if sys.platform == "darwin" else 1024),
    }


def ladder(cases: list[tuple[str, float]]) -> list[dict[str, Any]]:
    """Rows of all instances that are there, each measured in a fresh process."""
    rows = []
    for name, step in cases:
        if name in maps.FOLDERS and (reason := maps.missing(name)):
            print(f"{name} skipped: {reason}")
            continue
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            found = process.submit(measured, name, step).result()
        for row in found:
            print(json.dumps(row), flush=True)
        rows += found
    return rows


def measured(name: str, step: float) -> list[dict[str, Any]]:
    """Build and search one museum or map several times: a row of medians for each precision."""
    warm_up()
    planner = Lattice(step=step)
    criteria = [make_criterion(c) for c in COSTS]
    builds: list[float] = []
    trees: list[float] = []
    first: dict[float, dict[str, Any]] = {}
    seconds: dict[float, list[tuple[float, float, float]]] = {eps: [] for eps in PRECISIONS}
    end = time.perf_counter() + PATIENCE
    while len(builds) < RUNS and (not builds or time.perf_counter() < end):
        problem = (maps if name in maps.FOLDERS else museums).problem(name)  # no field from the run before
        began = time.perf_counter()
        lattice = planner.lattice(problem)
        space, start, goals = planner.ends(lattice, problem)
        graph = space.graph(criteria)
        builds.append(time.perf_counter() - began)
        trees.append(scipy_dijkstra(graph, start))
        for eps in PRECISIONS:
            began, worked = time.perf_counter(), time.process_time()
            paths = pareto_paths(graph, start, goals, eps=eps)
            spent = (time.perf_counter() - began, paths.stats.seconds_bounds, time.process_time() - worked)
            seconds[eps].append(spent)
            first.setdefault(eps, {**counts(paths), "search_mb": paths.stats.peak_memory / 2**20})
    rows = []
    for eps in PRECISIONS[::-1]:
        search, bounds, cpu = (statistics.median(column) for column in zip(*seconds[eps], strict=True))
        rows.append(
            {
                "instance": name,
                "step": step,
                "eps": eps,
                "states": lattice.size,
                "edges": graph.arcs,
                **first[eps],
                "runs": len(builds),
                "build_s": statistics.median(builds),
                "search_s": search,
                "bounds_s": bounds,
                "cpu_s": cpu,
                "search_over_dijkstra": statistics.median(s[0] / t for s, t in zip(seconds[eps], trees, strict=True)),
            }
        )
    return rows


def scipy_dijkstra(graph: Graph, start: int) -> float:
    """Seconds of one shortest-path tree by scipy on the same graph; this lattice has no parallel arcs."""
    length = graph.cost(2) + 1.0  # scipy drops explicit zeros
    matrix = csr_array((length, graph.heads, graph.indptr), shape=(graph.nodes, graph.nodes))
    began = time.perf_counter()
    dijkstra(matrix, indices=start)
    return time.perf_counter() - began


if __name__ == "__main__":
    main()
