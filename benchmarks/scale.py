"""Benchmark of large floors: figures beside what was asked of them, and their ratio (at most 1 where it is reached).

    python benchmarks/scale.py [--queries 6] [--step 0.1] [--out FILE]

The map of `many_queries.py --large` (100 x 100 m, step 0.25 m) for a disc and a rectangle: the first answer, the first
front, and further queries from one end of the map to the other. Then a museum of 100 x 100 m with a step of 0.1 m:
exposure, turns and length within 1 %. Seconds are processor time of all threads, kernels loaded; each row is measured
in a process of its own, which gives its peak memory. Counts do not depend on the machine.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any

import many_queries
import museums

import hpop
from hpop.search import pareto_paths

SIDE, SEED, EPS = 400, 0, 0.01  # of the museum, in cells of 0.25 m; the precision
ASKED = {  # seconds and megabytes
    "disc": {"first_answer_s": 1.0, "first_front_s": 3.0, "further_s": 0.3, "memory_mb": 1000},
    "rectangle": {"over_disc": 1.5},
    "fine": {"first_answer_s": 10.0, "seconds": 60.0, "memory_mb": 3000},
}
CORNERS = ((0.3, 0.225), (-0.3, 0.225), (-0.3, -0.225), (0.3, -0.225))
ROBOTS: dict[str, dict[str, Any]] = {"disc": {"radius": 0.3}, "rectangle": {"footprint": CORNERS}}


def large_map(shape: str, queries: int) -> dict[str, Any]:
    """Measure a robot on the map of 100 x 100 m with a step of 0.25 m."""
    taken = many_queries.measure_large(hpop.DifferentialDrive(speed=0.8, **ROBOTS[shape]), queries)
    figures = {"first_answer_s": taken["early_s"], "first_front_s": taken["first_s"], "memory_mb": taken["peak_mb"]}
    return figures | {"further_s": median(taken["far_s"])}


def fine_museum(step: float) -> dict[str, Any]:
    """Measure the museum with a fine step: first answer, and the front within the precision."""
    planner = {"lattice": {"step": step, "eps": EPS}}
    search: Any = sys.modules[pareto_paths.__module__]
    large, search.LARGE = search.LARGE, 0  # load the kernels on a small museum
    for _ in museum(60).fronts([planner], stage=lambda _: None):
        pass
    search.LARGE = large
    problem, begun, by_clock, first = museum(SIDE), process_time(), perf_counter(), list[float]()
    front = [*problem.fronts([planner], stage=lambda _: first.append(process_time() - begun))][-1]
    return {
        "first_answer_s": round(first[0], 2),
        "seconds": round(process_time() - begun, 1),
        "by_clock_s": round(perf_counter() - by_clock, 1),
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "points": len(front),
        "status": front.status,
        **{name: front.runs[-1][name] for name in ("states", "edges", "labels_generated", "labels_expanded", "gap")},
    }


def museum(side: int) -> hpop.Problem:
    """Return the problem of a museum with so many cells a side."""
    museums.SIZES["floor"] = (side, SEED)
    return museums.problem("floor")


def main() -> None:
    """Measure, print, and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--queries", type=int, default=6)
    parser.add_argument("--step", type=float, default=0.1, help="m, of the museum")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    tasks = {shape: (large_map, shape, options.queries) for shape in ROBOTS} | {"fine": (fine_museum, options.step)}
    rows = dict[str, dict[str, Any]]()
    for name, (measure, *arguments) in tasks.items():
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            row = process.submit(measure, *arguments).result()
        if name == "rectangle":
            row["over_disc"] = round(row["first_front_s"] / rows["disc"]["first_front_s"], 2)
        row["over_asked"] = {key: round(row[key] / asked, 2) for key, asked in ASKED[name].items()}
        rows[name] = row
        print(json.dumps({name: row}), flush=True)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
