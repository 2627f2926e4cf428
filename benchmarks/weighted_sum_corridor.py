"""Benchmark of weighted sums in corridors: seconds a weight, and what they add to the lattice's front.

``python benchmarks/weighted_sum_corridor.py --out out/bench/weighted_sum_corridor.json``

Length and clearance are weighted, 50 weights in every corridor; turns are settled by the corridor. ``over_rebuilt``
divides the seconds of a weight by those of a program that is built and compiled for that weight alone. Seconds of a
whole run hold the warm starts; counts and shares depend on no machine.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

import hpop
from hpop.frontier import hypervolume
from hpop.planners import Lattice, WeightedSumCorridor
from hpop.planners.programs.corridor.corridor import corridors
from hpop.planners.programs.corridor.program import CorridorProgram
from hpop.planners.programs.polyline import Polyline
from hpop.runtime.sweep import processes

ROOT = Path(__file__).parents[1]
CRITERIA = ["length", "turns", "clearance"]
AGREE = 1e-3  # relative: no worse
REBUILT = 5  # corridors whose programs are also built for each weight


def coverage(problem: hpop.Problem, step: float, weights: int, workers: int) -> dict[str, Any]:
    """Measure how far the corridors improve each point of the lattice's front, and the hypervolume."""
    lattice = problem.solve(Lattice(step=step))
    planner = WeightedSumCorridor(step=step, divisions=weights - 1)
    planner.solve(problem)  # imports and caches
    began = time.perf_counter()
    candidates = planner.solve(problem)
    alone = time.perf_counter() - began
    with processes(workers) as pool:
        planner.solve(problem, executor=pool)
        began = time.perf_counter()
        again = planner.solve(problem, executor=pool)
        together = time.perf_counter() - began
    if again.provenance != candidates.provenance:
        raise AssertionError("workers change the result")
    front = problem.front(candidates)
    joined = lattice | front
    slack = AGREE * np.maximum(lattice.costs, 1e-3)
    pairs = list(zip(lattice.costs, slack, strict=True))
    no_worse = np.array([(front.costs <= row + s).all(axis=1) for row, s in pairs])
    better = np.array([(front.costs < row - s).any(axis=1) for row, s in pairs])
    low, high = joined.costs.min(axis=0), np.maximum(lattice.costs, 1e-9).max(axis=0) * 1.01
    volumes = [hypervolume((f.costs - low) / (high - low), np.ones(len(low))) for f in (lattice, front, joined)]
    stats = dict(candidates.stats)
    return {
        "step": step,
        "lattice_points": len(lattice),
        "corridors": stats["corridors"],
        "weights_solved": stats["weights_solved"],
        "failed": stats["failed"],
        "dropped": stats["dropped"],
        "candidates": len(candidates.trajectories),
        "front_points": len(front),
        "joined_points": len(joined),
        "lattice_points_no_worse": float(no_worse.any(axis=1).mean()),
        "lattice_points_improved": float((no_worse & better).any(axis=1).mean()),
        "hypervolume_over_lattice": volumes[1] / volumes[0],
        "hypervolume_joined_over_lattice": volumes[2] / volumes[0],
        "ms_a_weight": 1e3 * stats["seconds_per_weight"],
        "ms_a_build": 1e3 * stats["build_seconds"] / stats["corridors"],
        "over_rebuilt": stats["seconds_per_weight"] / rebuilt(problem, lattice, weights),
        "seconds": alone,
        f"seconds_{workers}_workers": together,
        "speed_up": alone / together,
    }


def rebuilt(problem: hpop.Problem, lattice: hpop.Front, weights: int) -> float:
    """Seconds a weight where the program is built and compiled anew for each, in the first few corridors."""
    polylines = [Polyline.of(trajectory, problem) for trajectory in lattice.trajectories]
    free = [corridor for corridor in corridors(polylines, problem)[0] if not corridor.is_fixed][:REBUILT]
    criteria = tuple(c for c in problem.criteria if c.convex is not None)
    began = time.perf_counter()
    for corridor in free:
        for i in range(0, weights, 10):
            program = CorridorProgram(corridor, criteria, problem.world, problem.model, ("CLARABEL",))
            program.solve(np.array([1.0, 1.0 + i]))
    return (time.perf_counter() - began) / (len(free) * len(range(0, weights, 10)))


def main() -> None:
    """Run both maps and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("out/bench/weighted_sum_corridor.json"))
    parser.add_argument("--step", type=float, default=0.5)
    parser.add_argument("--weights", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data")))
    options = parser.parse_args()
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    museum = hpop.World.from_geojson(ROOT / "examples" / "museum.geojson")
    problems = {"museum": hpop.Problem(museum, robot, (2, 10, 0), (28, 10, 0), CRITERIA)}
    office = options.data / "pal_office" / "map.yaml"
    if office.exists():
        world = hpop.World.from_ros_map(office)
        problems["pal_office"] = hpop.Problem(world, robot, (6, -8, np.pi / 2), (-10, 1, None), CRITERIA)
    result = {}
    for name, problem in problems.items():
        result[name] = coverage(problem, options.step, options.weights, options.workers)
        print(name, json.dumps(result[name], indent=1), flush=True)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
