"""Benchmark of exact means: a museum's lattice with a cap on duration or length, against the additive search.

    python benchmarks/mean.py [--museum m60] [--detours 1.1 1.2 1.3] [--turns 6 8 10] [--out FILE]

The length is capped at 1.2 times the least, with at most so many turns. Costs are obstruction as a mean, turns and
length; the additive search on the same lattice has exposure in its place. Seconds hold bounds and both searches of the
mean, not the building of the graph; kernels are compiled before. Counts depend on no machine. ``new`` are the points
that the additive front does not have.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from pathlib import Path
from typing import Any

import museums

import hpop
from hpop.planners import Lattice
from hpop.planners.objectives import edge_objectives
from hpop.planners.searches.people_and_mean import DURATION, INTEGRAL, OTHERS, mean_objectives
from hpop.search import MeanPaths, capped_mean_paths, pareto_paths

RUNS = 3
LENGTH_DETOUR = 1.2
LENGTH = OTHERS + 1  # column of the graph
TARGET = 10.0  # s, for m60 and a detour of 1.3


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--museum", choices=list(museums.SIZES), default="m60")
    parser.add_argument("--detours", type=float, nargs="+", default=[1.1, 1.2, 1.3])
    parser.add_argument("--turns", type=int, nargs="*", default=[6, 8, 10])
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    arguments = parser.parse_args()
    result = measured(arguments.museum, arguments.detours, arguments.turns)
    print(json.dumps(result, indent=1))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(result, indent=1) + "\n")


def measured(name: str, detours: list[float], turns: list[int]) -> dict[str, Any]:
    """Both searches of a museum, each run several times; medians."""
    asked = museums.problem(name)
    criteria = ["obstruction", "turns", "length"]
    problem = hpop.Problem(asked.world, asked.model, asked.start, asked.goal, criteria)
    planner = Lattice(step=museums.CELL)
    lattice = planner.lattice(problem)
    space, start, goals = planner.ends(lattice, problem)
    additive = space.graph(edge_objectives(problem.criteria, "benchmark").optimised)
    graph = space.graph(mean_objectives(problem.criteria, "benchmark").optimised)
    durations = pareto_paths(graph, start, goals)
    least = int(durations.costs[:, DURATION].min())
    farthest = int(LENGTH_DETOUR * durations.costs[:, LENGTH].min())
    limits: dict[str, dict[str, Any]] = {f"detour {detour:g}": {"cap": int(detour * least)} for detour in detours}
    limits |= {f"length, {count} turns": {"at_most": [None, None, count, farthest]} for count in turns}
    seconds = []
    for _ in range(RUNS):
        began = time.perf_counter()
        sums = pareto_paths(additive, start, goals)
        seconds.append(time.perf_counter() - began - sums.stats.seconds_compiled)
    row: dict[str, Any] = {
        "museum": name,
        "states": graph.nodes,
        "edges": graph.arcs,
        "additive": {
            "front": len(sums),
            "labels_generated": sums.stats.labels_generated,
            "seconds": statistics.median(seconds),
        },
    }
    known = durations.costs.tolist()
    for words, limit in limits.items():
        taken = []
        for _ in range(RUNS):
            began = time.perf_counter()
            paths = capped_mean_paths(graph, start, goals, integral=INTEGRAL, duration=DURATION, **limit)
            taken.append(time.perf_counter() - began - paths.stats.seconds_compiled)
        row[words] = described(paths, known, statistics.median(taken), statistics.median(seconds))
    if name == "m60" and 1.3 in detours:
        row["seconds_over_target"] = row["detour 1.3"]["seconds"] / TARGET
    return row


def described(paths: MeanPaths, known: list[list[int]], seconds: float, additive: float) -> dict[str, Any]:
    """Return the counts and ratios of one cap."""
    additive_points = {(row[INTEGRAL] / row[DURATION], *row[OTHERS:]) for row in known}
    points = [(float(paths.mean(i)), *paths.costs[i, OTHERS:].tolist()) for i in range(len(paths))]
    return {
        "front": len(paths),
        "new": sum(point not in additive_points for point in points),
        "means": [float(paths.means.min()), float(paths.means.max())],
        "labels_generated": paths.stats.labels_generated,
        "labels_expanded": paths.stats.labels_expanded,
        "peak_mb": paths.stats.peak_memory / 2**20,
        "seconds": seconds,
        "over_additive": seconds / additive,
        "labels_a_second": paths.stats.labels_generated / seconds,
    }


if __name__ == "__main__":
    main()
