"""Benchmark of the choice of method on graphs that are no lattices, and of the fixed work of a small query.

    python benchmarks/general.py [--out FILE] [--only NAME ...] [--queries N]

Every query is searched by "general", by "staircase" if the graph has three costs and one of them is small, and by
"auto". The fronts must be equal, and of the published size where the data have one. Seconds are processor time of all
threads, bounds included, kernels loaded; `auto_over_best` is the time of "auto" over that of the better method.

Graphs are made here by seed. NetMaker and Philadelphia are read from `general_graphs` in the folder of public data
(HPOP_DATA), in the format of DIMACS: a line `p sp nodes arcs`, then a line `a tail head cost [cost ...]` for each arc,
with the ends and front sizes in a CSV file; Pulido's grids as in `graph.py`. Data that are not there are skipped.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
from collections.abc import Iterator
from pathlib import Path
from time import process_time
from typing import Any, NamedTuple

import graph as plain
import numpy as np

from hpop.errors import GraphError, OptionError
from hpop.runtime.limits import Budget
from hpop.search import Graph, pareto_paths

DATA = Path(os.environ.get("HPOP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data"))
PUBLISHED = ("netmaker_79134", "philadelphia")
ROAD_NODES, ROAD_ARCS = 33_113, 75_379  # as many as Sydney's network has
REPEATS = 7  # of a small query; the least time counts


class Query(NamedTuple):
    """Query of a graph, with the published size of its front, or 0."""

    source: int
    target: int
    front: int = 0


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/general.json"), help="JSON file")
    parser.add_argument("--only", nargs="+", default=[], help="names of sets")
    parser.add_argument("--queries", type=int, default=1000, help="at most so many of each set")
    arguments = parser.parse_args()
    rows = []
    for name, make in sets().items():
        if arguments.only and name not in arguments.only:
            continue
        rows.append(row(name, *make(), arguments.queries))
        print(json.dumps(rows[-1]), flush=True)
    small = {} if arguments.only else small_query()
    print(json.dumps(small))
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps({"instances": rows, "small_query": small}, indent=1) + "\n")


def sets() -> dict[str, Any]:
    """Return functions that make the graph and the queries of each set, by name."""
    made: dict[str, Any] = {
        "netmaker-like": lambda: netmaker(2_000, 12_000, 0),
        "roads": lambda: roads(0, 4),
        "roads, arcs counted": lambda: roads(1, 4, counted=True),
        "random grid 50": lambda: _with_query(*plain.random_grid(50, 3)),
        "cells with headings": lambda: headings(40, 0),
    }
    for name in PUBLISHED:
        if (DATA / "general_graphs" / f"{name}.gr").is_file():
            made[name] = lambda name=name: published(DATA / "general_graphs", name)
    if (DATA / "pulido_grids").is_dir():
        for grid in (0, 1):
            made[f"pulido grid {grid}"] = lambda grid=grid: _gathered(plain.pulido(grid, 3))
    return made


def row(name: str, graph: Graph, queries: list[Query], most: int) -> dict[str, Any]:
    """Return counts and processor seconds of each method, summed over queries; raises ValueError for unequal fronts."""
    methods = ["general", "staircase", "auto"] if _takes_staircases(graph, queries[:most]) else ["general", "auto"]
    seconds, labels = dict.fromkeys(methods, 0.0), dict.fromkeys(methods, 0)
    memory, used, sizes = dict.fromkeys(methods, 0), set(), []
    for source, target, front in queries[:most]:
        costs = None
        for method in methods:
            if not labels[method]:
                pareto_paths(graph, source, target, method=method)  # loads kernels
            begin = process_time()
            paths = pareto_paths(graph, source, target, method=method)
            seconds[method] += process_time() - begin
            labels[method] += paths.stats.labels_generated
            memory[method] = max(memory[method], paths.stats.peak_memory)
            if (front and len(paths) != front) or (costs is not None and not np.array_equal(costs, paths.costs)):
                raise ValueError(f"{name}: front from {source} to {target} by {method} is wrong")
            costs = paths.costs
        used.add(paths.stats.method)
        sizes.append(len(paths))
    best = min(seconds[method] for method in methods[:-1])
    size = {"instance": name, "queries": len(sizes), "nodes": graph.nodes, "arcs": graph.arcs}
    chosen = {"methods_of_auto": sorted(used), "auto_over_best": seconds["auto"] / best}
    counts = {"labels_generated": labels, "peak_memory": memory, "seconds": seconds}
    return {**size, "front": sum(sizes), "largest_front": max(sizes), **chosen, **counts}


def _takes_staircases(graph: Graph, queries: list[Query]) -> bool:
    """Return whether "staircase" takes all queries: one of three costs must be small."""
    try:
        for source, target, _ in queries:
            pareto_paths(graph, source, target, method="staircase", budget=Budget(max_labels=1))
    except OptionError:
        return False
    return graph.criteria == 3


def small_query() -> dict[str, float]:
    """Return the milliseconds of processor time of the first and of later queries between near nodes of a road network.

    Later queries have other ends; each is repeated on a graph that has answered another query before.
    """
    graph, queries = roads(2, 6, hops=25)
    first, later = [], []
    for i, query in enumerate(queries):
        fresh = [Graph.from_csr(graph.indptr, graph.heads, graph.costs) for _ in range(REPEATS)]
        times = []
        for each in fresh:
            times.append([_milliseconds(each, query), _milliseconds(each, queries[i - 1])])
        least = np.min(times, axis=0)
        first.append(least[0])
        later.append(least[1])
    return {
        "nodes": graph.nodes,
        "arcs": graph.arcs,
        "first_query_ms": float(np.median(first)),
        "later_query_ms": float(np.median(later)),
    }


def _milliseconds(graph: Graph, query: Query) -> float:
    begin = process_time()
    pareto_paths(graph, query.source, query.target)
    return 1e3 * (process_time() - begin)


def _with_query(graph: Graph, source: int, target: int) -> tuple[Graph, list[Query]]:
    return graph, [Query(source, target)]


def _gathered(queries: Iterator[plain.Query]) -> tuple[Graph, list[Query]]:
    listed = list(queries)
    return listed[0][0], [Query(source, target) for _, source, target in listed]


def published(folder: Path, name: str) -> tuple[Graph, list[Query]]:
    """Return a graph in the format of DIMACS with its queries and front sizes."""
    with (folder / f"{name}_fronts.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return read_dimacs(folder / f"{name}.gr"), [
        Query(int(r["source"]), int(r["target"]), int(r["front_size"])) for r in rows
    ]


def read_dimacs(file: Path) -> Graph:
    """Read a graph from lines `p sp nodes arcs` and `a tail head cost [cost ...]`, nodes from 0; raises GraphError."""
    nodes, rows = 0, []
    with file.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            try:
                if words[:2] == ["p", "sp"]:
                    nodes = int(words[2])
                elif words[:1] == ["a"]:
                    rows.append([int(word) for word in words[1:]])
            except (ValueError, IndexError):
                raise GraphError(f"{file}, line {number}: expected integers, got {line.strip()!r}") from None
    if not nodes or not rows or len({len(r) for r in rows}) != 1:
        raise GraphError(f"{file}: expected a line `p sp nodes arcs`, then arcs with one number of costs")
    table = np.array(rows, np.int64)
    return Graph.from_arcs(nodes, table[:, 0], table[:, 1], table[:, 2:])


def netmaker(nodes: int, arcs: int, seed: int) -> tuple[Graph, list[Query]]:
    """Return a graph by the recipe of NetMaker: a cycle through all nodes, and arcs between nodes near on it.

    Each arc has one cost from each of the ranges 1-333, 334-666 and 667-1000, in random order (Skriver and Andersen
    2000; Raith and Ehrgott 2009).
    """
    rng = np.random.default_rng(seed)
    cycle = rng.permutation(nodes)
    begin = np.concatenate([np.arange(nodes), rng.integers(0, nodes, arcs - nodes)])
    step = np.concatenate([np.ones(nodes, int), rng.integers(2, 50, arcs - nodes)])
    costs = rng.permuted(rng.integers([1, 334, 667], [334, 667, 1001], (arcs, 3)), axis=1)
    graph = Graph.from_arcs(nodes, cycle[begin], cycle[(begin + step) % nodes], costs)
    return graph, [Query(*rng.integers(0, nodes, 2).tolist()) for _ in range(6)]


def roads(seed: int, queries: int, *, counted: bool = False, hops: int = 40) -> tuple[Graph, list[Query]]:
    """Return a grid of streets without some of them: length, time at one of four speeds, and a cost of traffic.

    counted  whether the third cost is the number of arcs
    hops     blocks between source and target, each way
    """
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(ROAD_NODES)))
    node = np.arange(side * side).reshape(side, side)
    first = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel()])
    second = np.concatenate([node[:, 1:].ravel(), node[1:].ravel()])
    open_streets = np.sort(rng.permutation(len(first))[: ROAD_ARCS // 2])
    first, second = first[open_streets], second[open_streets]
    length = rng.integers(500, 2000, len(first))
    time = length * 60 // rng.choice([30, 50, 50, 60], len(first))
    third = np.ones(len(first), int) if counted else 1 + length // rng.choice([2, 3, 4], len(first))
    costs = np.stack([length, time, third], axis=1)
    ends = (np.concatenate([first, second]), np.concatenate([second, first]))
    graph = Graph.from_arcs(side * side, *ends, np.concatenate([costs, costs]))
    corners = rng.integers(0, side - hops, (queries, 2)) @ np.array([side, 1])
    return graph, [Query(int(a), int(a) + hops * (side + 1)) for a in corners]


def headings(side: int, seed: int) -> tuple[Graph, list[Query]]:
    """Return cells with four headings, whose turns form groups; the costs are length, turns and a price of cells."""
    rng = np.random.default_rng(seed)
    cell = np.arange(side * side).reshape(side, side)
    price = rng.integers(1000, 9000, side * side)
    moves = [
        (cell[:, :-1], cell[:, 1:]),
        (cell[:, 1:], cell[:, :-1]),
        (cell[:-1], cell[1:]),
        (cell[1:], cell[:-1]),
    ]
    tails = [a.ravel() * 4 + i for i, (a, _) in enumerate(moves)]
    heads = [b.ravel() * 4 + i for i, (_, b) in enumerate(moves)]
    costs = [np.c_[np.full(b.size, 1000), np.zeros(b.size, int), price[b.ravel()]] for _, b in moves]
    here, there = np.nonzero(~np.eye(4, dtype=bool))
    tails.append((cell.reshape(-1, 1) * 4 + here).ravel())
    heads.append((cell.reshape(-1, 1) * 4 + there).ravel())
    costs.append(np.tile([0, 1, 0], (side * side * len(here), 1)))
    graph = Graph.from_arcs(4 * side * side, np.concatenate(tails), np.concatenate(heads), np.concatenate(costs))
    return graph, [Query(0, 4 * side * side - 1)]


if __name__ == "__main__":
    main()
