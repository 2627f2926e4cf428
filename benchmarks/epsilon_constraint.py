"""Benchmark of polyline programs: do they converge, how long do they take, what do they add to the lattice's front.

``python benchmarks/epsilon_constraint.py --out out/bench/epsilon_constraint.json``

Five parts: single programs from warm starts of 4, 6, 8 and 12 segments; the polylines' front against the lattice's on
the museum and, where the data are there, on pal_office, without the lattice's points; the same for a worst moment, the
clearance, with and without turns; two workers against one.
``jobs slower`` says by how much a job took longer with workers than alone: on cores that others use too, the speed-up
is less by that.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from pathlib import Path
from typing import Any

import numpy as np
from museums import problem as museum_problem

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.frontier import hypervolume
from hpop.planners import EpsilonConstraint, Lattice
from hpop.planners.judgement import is_free
from hpop.planners.programs.epsilon_constraint.program import PolylineProgram
from hpop.planners.programs.polyline import Polyline
from hpop.runtime.sweep import processes

ROOT = Path(__file__).parents[1]
COUNTS = (4, 6, 8, 12)  # segments
CASES = 20
AGREE = 1e-3  # relative: no worse
WORKERS, RUNS = 2, 3


def warm_starts(base: hpop.Problem, seed: int = 0) -> dict[int, list[tuple[hpop.Problem, Polyline]]]:
    """Lattice paths of 4, 6, 8 and 12 segments between random places, at most two of a number from one pair."""
    rng = np.random.default_rng(seed)
    x_min, y_min, x_max, y_max = base.world.bounds
    found: dict[int, list[tuple[hpop.Problem, Polyline]]] = {count: [] for count in COUNTS}
    while any(len(cases) < CASES for cases in found.values()):
        x, y = rng.uniform((x_min, y_min), (x_max, y_max), size=(100, 2)).T
        x, y = (np.round(c[base.world.clearance(x, y) > 0.5] * 2) / 2 for c in (x, y))
        free = np.flatnonzero(base.world.clearance(x, y) > 0.4)
        pairs = [(i, j) for i in free for j in free if 8 < np.hypot(x[i] - x[j], y[i] - y[j]) < 25][:1]
        for i, j in pairs:
            one = hpop.Problem(base.world, base.model, (x[i], y[i], 0.0), (x[j], y[j], None), base.criteria)
            candidates = Lattice(step=0.5, time_limit=20.0).solve(one)
            paths = [Polyline.of(t, one) for t in candidates.trajectories]
            for count, cases in found.items():
                cases += [(one, p) for p in paths if len(p.lengths) == count][: min(2, CASES - len(cases))]
    return found


def convergence(base: hpop.Problem) -> dict[str, Any]:
    """Length minimised, exposure bounded by the warm start's: one solve from each, right after construction."""
    smooth = tuple(c for c in base.criteria if c.name in ("length", "exposure"))
    rows = {}
    for count, cases in warm_starts(base).items():
        build, solve, cpu, iterations, status, shorter, free = [], [], [], [], [], [], []
        for problem, polyline in cases:
            costs = trajectory_costs(smooth, [polyline.trajectory(problem.model)], problem.world)[0]
            program = PolylineProgram(problem, smooth, [c.name for c in smooth].index("length"), polyline.structure)
            began = time.perf_counter()
            program.build()
            build.append(time.perf_counter() - began)
            epsilon = costs * (1 + 2e-4) + program.costs(polyline) - costs
            began, worked = time.perf_counter(), time.process_time()
            solution = program.solve(polyline, epsilon)
            solve.append(time.perf_counter() - began)
            cpu.append(time.process_time() - worked)
            iterations.append(solution.iterations)
            status.append(solution.status)
            if solution.converged:
                shorter.append(1 - solution.polyline.lengths.sum() / polyline.lengths.sum())
                free.append(is_free(problem, solution.polyline.trajectory(problem.model)))
        rows[str(count)] = {
            "cases": len(cases),
            "converged": len(shorter),
            "free at once": sum(free),
            "build_ms": 1e3 * statistics.median(build),
            "solve_ms": 1e3 * statistics.median(solve),
            "solve_cpu_ms": 1e3 * statistics.median(cpu),
            "solve_ms_worst": 1e3 * max(solve),
            "iterations": statistics.median(iterations),
            "shorter": float(statistics.mean(shorter)),
            "not converged": [s for s in status if not s.startswith("Solve")],
        }
        print(count, rows[str(count)], flush=True)
    return rows


def coverage(problem: hpop.Problem, step: float) -> dict[str, Any]:
    """Measure how far polylines improve each point of the lattice's front, and the hypervolume."""
    lattice = problem.solve("lattice", step=step)
    began = time.perf_counter()
    candidates = EpsilonConstraint(step=step).solve(problem)
    seconds = time.perf_counter() - began
    front = problem.front(candidates)
    joined = lattice | front
    slack = AGREE * np.maximum(lattice.costs, 1e-3)
    no_worse = np.array([(front.costs <= row + s).all(axis=1) for row, s in zip(lattice.costs, slack, strict=True)])
    better = np.array([(front.costs < row - s).any(axis=1) for row, s in zip(lattice.costs, slack, strict=True)])
    low, high = joined.costs.min(axis=0), np.maximum(lattice.costs, 1e-9).max(axis=0) * 1.01
    volumes = [hypervolume((f.costs - low) / (high - low), np.ones(len(low))) for f in (lattice, front, joined)]
    again = trajectory_costs(candidates.objectives, candidates.trajectories, problem.world)
    off = np.abs(again - candidates.planned) / np.maximum(np.abs(again), 1e-6)
    row = {
        "step": step,
        "names": list(lattice.names),
        "lattice points": len(lattice),
        "polyline points": len(front),
        "joined points": len(joined),
        "no worse in any cost": float(no_worse.any(axis=1).mean()),
        "strictly better": float((no_worse & better).any(axis=1).mean()),
        "hypervolume lattice": volumes[0],
        "hypervolume polylines": volumes[1],
        "hypervolume ratio": volumes[1] / volumes[0],
        "planned against re-evaluated, relative": dict(zip(front.names, off.max(axis=0).tolist(), strict=True)),
        "least lattice": lattice.costs.min(axis=0).tolist(),
        "least polylines": front.costs.min(axis=0).tolist(),
        "seconds": seconds,
        "notes": list(candidates.notes),
        "stats": dict(candidates.stats),
    }
    print(json.dumps(row), flush=True)
    return row


def workers(problem: hpop.Problem, step: float) -> dict[str, Any]:
    """Seconds of one plan, lattice included, here and with workers in turn; the least of some runs of each."""
    planner = EpsilonConstraint(step=step)
    seconds: dict[int, list[float]] = {1: [], WORKERS: []}
    jobs: dict[int, list[float]] = {1: [], WORKERS: []}
    found = []
    with processes(WORKERS) as pool:
        EpsilonConstraint(step=step, max_points=4 * WORKERS).solve(problem, executor=pool)  # imports, kernels
        for _ in range(RUNS):
            for count, executor in ((1, None), (WORKERS, pool)):
                began = time.perf_counter()
                candidates = planner.solve(problem, executor=executor)
                seconds[count].append(time.perf_counter() - began)
                jobs[count].append(candidates.stats["build_seconds"] + candidates.stats["solve_seconds"])
                found.append(candidates.planned.tolist())
    if any(planned != found[0] for planned in found):
        raise AssertionError("workers change the result")
    best = {count: int(np.argmin(runs)) for count, runs in seconds.items()}
    one, many = (seconds[count][best[count]] for count in (1, WORKERS))
    slower = jobs[WORKERS][best[WORKERS]] / jobs[1][best[1]]
    row = {
        "workers": WORKERS,
        "bounds tried": candidates.stats["tried"],
        "one_s": one,
        "workers_s": many,
        "speed_up": one / many,
        "jobs slower": slower,
        "speed_up at equal jobs": slower * one / many,
    }
    print(json.dumps(row), flush=True)
    return row


def main() -> None:
    """Run all parts and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/bench/epsilon_constraint.json"))
    parser.add_argument("--step", type=float, default=0.25)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data")))
    options = parser.parse_args()
    result: dict[str, Any] = {"convergence": convergence(museum_problem("m160"))}
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    criteria = ["exposure", "turns", "length"]
    museum = hpop.World.from_geojson(ROOT / "examples" / "museum.geojson")
    tour = hpop.Problem(museum, robot, (2, 10, 0), (28, 10, 0), criteria)
    result["museum"] = coverage(tour, options.step)
    for criteria_of in (["clearance", "length"], ["clearance", "turns", "length"]):
        asked = hpop.Problem(museum, robot, tour.start, tour.goal, criteria_of)
        result[" ".join(criteria_of)] = coverage(asked, 2 * options.step)
    result["workers"] = workers(tour, options.step)
    office = options.data / "pal_office" / "map.yaml"
    if office.exists():
        world = hpop.World.from_ros_map(office)
        result["pal_office"] = coverage(
            hpop.Problem(world, robot, (6, -8, np.pi / 2), (-10, 1, None), criteria), options.step
        )
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
