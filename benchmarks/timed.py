"""Benchmark of exact fronts among people who move, on a clock: hpop's search beside plain label setting.

    python benchmarks/timed.py [--museum small large] [--tick 0.125 0.05] [--plain small] [--out FILE] [--picture FILE]

Museums are those of timed_worlds.py, drawn with all tracks into a PNG. Each museum and clock is measured in a process
of its own, kernels compiled before, in processor seconds of all threads. ``first_s`` is when the search had points,
``answer_s`` when the planner had a front, tables and all, of ``answer`` points; ``ratio`` what plain label setting
(plain_timed.py, with a goal front of 9 supported points or none) took over hpop's exact search. ``search_mb`` are the
arrays of the search, ``process_mb`` the largest size of the process until then, the building of the graph included.
Fails where fronts differ, or where eps leaves a vector uncovered.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import timed_worlds
from plain_timed import PlainFront, plain_front

from hpop.base.arrays import IntArray
from hpop.problems.solving import front
from hpop.runtime.limits import Progress
from hpop.search.timed import TimedPaths, timed_paths

EPS = 0.05
SEEDS = 9  # weights of the goal front that the plain label setting begins with
TARGETS = {  # processor seconds, megabytes, and by how much the plain one is slower
    ("small", 0.05): {"exact_s": 2.0, "eps_s": 0.5, "search_mb": 400.0, "ratio": 20.0},
    ("large", 0.05): {"exact_s": 20.0, "answer_s": 1.0},
}


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--museum", choices=list(timed_worlds.MUSEUMS), nargs="+", default=list(timed_worlds.MUSEUMS))
    parser.add_argument("--tick", type=float, nargs="+", default=[0.125, 0.05], help="s")
    parser.add_argument("--plain", choices=list(timed_worlds.MUSEUMS), nargs="*", default=["small"], help="minutes")
    parser.add_argument("--out", type=Path, default=Path("out/bench/timed.json"), help="JSON file")
    parser.add_argument("--picture", type=Path, default=Path("out/bench/timed.png"))
    arguments = parser.parse_args()
    rows, drawn = [], {}
    for name in arguments.museum:
        for tick in arguments.tick:
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
                row, ways = process.submit(measured, name, tick, name in arguments.plain).result()
            print(json.dumps(row), flush=True)
            rows.append(row)
            drawn[name] = timed_worlds.MUSEUMS[name](), ways
    for file in (arguments.out, arguments.picture):
        file.parent.mkdir(parents=True, exist_ok=True)
    arguments.out.write_text(json.dumps(rows, indent=1) + "\n")
    timed_worlds.picture(drawn).savefig(arguments.picture, dpi=110, bbox_inches="tight")
    print(f"written to {arguments.out} and {arguments.picture}")
    if faults := [f"{row['museum']} at {row['tick']:g} s: {fault}" for row in rows for fault in row["faults"]]:
        sys.exit("\n".join(faults))


def measured(name: str, tick: float, plain: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the figures of one museum and clock, and the paths that its picture shows."""
    warm = timed_worlds.small().query(0.5)
    for eps in (0.0, EPS):
        timed_paths(*warm, eps=eps)
    answered(timed_worlds.small(), 0.5)
    answer, answer_s = answered(timed_worlds.MUSEUMS[name](), tick)
    museum = timed_worlds.MUSEUMS[name]()
    began = time.process_time()
    query = museum.query(tick)
    graph, built = query.graph, time.process_time() - began
    exact, seconds, first = searched(query)
    row: dict[str, Any] = {
        "museum": name,
        "tick": tick,
        "states": graph.graph.nodes,
        "arcs": graph.graph.arcs,
        "timed_arcs": int(graph.timed.size),
        "ticks": graph.horizon,
        "build_s": built,
        "answer": answer,
        "answer_s": answer_s,
        "exact_s": seconds,
        "first_s": first,
        "bounds_s": exact.stats.seconds_bounds,
        **counts(exact),
        "search_mb": exact.stats.peak_memory / 2**20,
        "process_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 if sys.platform == "darwin" else 1024),
    }
    near, row["eps_s"], _ = searched(query, eps=EPS)
    row |= {f"eps_{key}": value for key, value in counts(near).items()}
    faults = []
    if not covers(near.costs, exact.costs, EPS):
        faults.append(f"eps {EPS:g} does not cover the exact front")
    for seeds in (SEEDS, 0) if plain else ():
        plain_front(*warm, seeds=1, most=200_000)
        began = time.process_time()
        found = plain_front(*query, seeds=seeds)
        row["plain_unseeded" if seeds == 0 else "plain"] = part = described(found, time.process_time() - began)
        print(f"{name} at {tick:g} s: hpop {seconds:.1f} s; plain, {seeds} seeds: {json.dumps(part)}", flush=True)
        if found.complete and found.costs.tolist() != exact.costs.tolist():
            faults.append(f"plain label setting with {seeds} seeds found {len(found.costs)} vectors, hpop {len(exact)}")
    if plain:
        row["ratio"] = row["plain"]["seconds"] / seconds
        row["labels_ratio"] = row["plain"]["labels_generated"] / max(1, row["labels_generated"])
    targets = TARGETS.get((name, tick), {})
    row["missed"] = {key: most for key, most in targets.items() if key in row and (row[key] < most) == (key == "ratio")}
    row["faults"] = faults
    best = timed_worlds.best(exact)
    return row, {way: (exact.costs[i].tolist(), *museum.way(exact.steps(i), tick)) for way, i in best.items()}


def answered(museum: timed_worlds.Museum, tick: float) -> tuple[int, float]:
    """Points of the first front that the lattice planner answers with, and after how many processor seconds."""
    began = time.process_time()
    first = next(iter(museum.planner(tick).stages(museum.problem)))
    return len(front(museum.problem, first)), time.process_time() - began


def searched(query: timed_worlds.Query, **options: Any) -> tuple[TimedPaths, float, float]:
    """Return the result of a search, its processor seconds, and the seconds until the first point."""
    began, first = time.process_time(), np.inf

    def watch(progress: Progress) -> None:
        nonlocal first
        if progress.front:
            first = min(first, time.process_time() - began)

    paths = timed_paths(*query, progress=watch, **options)
    seconds = time.process_time() - began
    return paths, seconds, min(float(first), seconds)


def counts(paths: TimedPaths) -> dict[str, Any]:
    """Return the counts of a search."""
    return {
        "status": str(paths.status),
        "front": len(paths),
        "labels_generated": paths.stats.labels_generated,
        "labels_expanded": paths.stats.labels_expanded,
    }


def described(found: PlainFront, seconds: float) -> dict[str, Any]:
    """Describe the result of the plain label setting; ``at_least`` says that it ran out of labels."""
    return {
        "seconds": seconds,
        "complete": found.complete,
        "front": len(found.costs),
        "labels_generated": found.made,
        "labels_expanded": found.expanded,
        "mb": found.nbytes / 2**20,
    }


def covers(found: IntArray, exact: IntArray, eps: float) -> bool:
    """Return True if each exact vector has one in the front that is at most (1 + eps) times as large."""
    most = np.floor(exact * (1 + eps) + 1e-6)
    return bool((found[None] <= most[:, None]).all(axis=2).any(axis=1).all())


if __name__ == "__main__":
    main()
