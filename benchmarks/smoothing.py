"""Benchmark of smoothing: does it converge, how long does it take, are all turns kept, what is gained.

``python benchmarks/smoothing.py --out out/bench/smoothing.json``
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hpop
from hpop.criteria import Duration, Turns
from hpop.criteria.costs import trajectory_costs
from hpop.planners.objectives import edge_objectives
from hpop.planners.programs.smoothing.job import SmoothingJob
from hpop.planners.programs.smoothing.program import DrivenProgram
from hpop.problems.verify import verify

ROOT = Path(__file__).parents[1]
CASES = 40  # polylines, evenly chosen from a front
CRITERIA = ["exposure", "turns", "length"]
HARDER = ["clearance", "optic_flow", "energy", "angular_acceleration", "peak_optic_flow"]  # in the place of exposure
FEW = 12  # polylines for each of these


class Clock:
    """Counts and times every solve of a program."""

    def __init__(self) -> None:
        self.seconds: list[float] = []
        self.cpu: list[float] = []
        self.converged: list[bool] = []
        self.iterations: list[int] = []
        self.intervals: list[int] = []

    def __enter__(self) -> Clock:
        self._solve = solve = DrivenProgram.solve

        def timed(program: DrivenProgram, *args: Any, **options: Any) -> Any:
            began, worked = time.perf_counter(), time.process_time()
            solution = solve(program, *args, **options)
            self.seconds.append(time.perf_counter() - began)
            self.cpu.append(time.process_time() - worked)
            self.converged.append(solution.trajectory is not None)
            self.iterations.append(solution.iterations)
            self.intervals.append(len(program.structure.phase))
            return solution

        DrivenProgram.solve = timed  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        DrivenProgram.solve = self._solve  # type: ignore[method-assign]

    def row(self, which: np.ndarray) -> dict[str, Any]:
        """Shares and medians of some of the solves."""
        if not which.any():
            return {"programs": 0}
        seconds, cpu, iterations = (np.array(c)[which] for c in (self.seconds, self.cpu, self.iterations))
        return {
            "programs": int(which.sum()),
            "converged share": float(np.array(self.converged)[which].mean()),
            "median ms": 1e3 * float(np.median(seconds)),
            "median cpu ms": 1e3 * float(np.median(cpu)),
            "converged in .3 s, share": float((np.array(self.converged)[which] & (seconds <= 0.3)).mean()),
            "worst ms": 1e3 * float(seconds.max()),
            "median iterations": float(np.median(iterations)),
        }


def smoothing(problem: hpop.Problem, step: float) -> dict[str, Any]:
    """Smooth polylines of the lattice's front, one by one."""
    front = problem.solve("lattice", step=step)
    polylines = [front.trajectories[i] for i in np.unique(np.linspace(0, len(front) - 1, CASES).astype(int))]
    objectives = edge_objectives(problem.criteria, "smoothing").optimised
    job = SmoothingJob(problem, objectives, None, 60)
    with Clock() as clock:
        outcomes = [job.solve(polyline) for polyline in polylines]
    found = [
        (before, o.candidate.trajectory)
        for before, o in zip(polylines, outcomes, strict=True)
        if o.candidate is not None
    ]
    before, after = (
        trajectory_costs([Turns(), Duration(), *objectives], [pair[side] for pair in found], problem.world)
        for side in (0, 1)
    )
    executed = trajectory_costs([Duration()], [b.execution() for b, _ in found], problem.world)[:, 0]
    planned = np.array([o.candidate.planned for o in outcomes if o.candidate is not None])
    off = np.abs(planned - after[:, 2:]) / np.maximum(after[:, 2:], 1e-6)
    ratio = np.median(after[:, 2:] / np.maximum(before[:, 2:], 1e-9), axis=0)
    builds = [o.seconds["build"] for o in outcomes if o.seconds["build"] > 0]
    sixty = np.array(clock.intervals) == 60
    row = {
        "step": step,
        "polylines": len(polylines),
        "smoothed": len(found),
        "dropped": dict(Counter(o.reason for o in outcomes if o.reason)),
        "60 intervals": clock.row(sixty),
        "more, for more turns": clock.row(~sixty),
        "programs a polyline": len(clock.seconds) / len(polylines),
        "repairs": sum(o.counts["repairs"] for o in outcomes),
        "structures": len(builds),
        "median build ms": 1e3 * statistics.median(builds) if builds else 0.0,
        "turns kept": int((after[:, 0] >= before[:, 0]).sum()),
        "duration over that of the execution": float(np.median(after[:, 1] / executed)),
        "cost over the polyline's, median": dict(zip((c.name for c in objectives), ratio.tolist(), strict=True)),
        "planned against re-evaluated, relative": float(off.max()),
        "seconds a polyline, all in": statistics.median(sum(o.seconds.values()) for o in outcomes),
    }
    print(json.dumps(row), flush=True)
    return row


def harder(problem: hpop.Problem, step: float) -> dict[str, dict[str, Any]]:
    """Smooth some of the same polylines for criteria with kinks, or that look around."""
    front = problem.solve("lattice", step=step)
    polylines = [front.trajectories[i] for i in np.unique(np.linspace(0, len(front) - 1, FEW).astype(int))]
    rows = {}
    for name in HARDER:
        asked = replace(problem, criteria=(name, "turns", "length"))
        job = SmoothingJob(asked, edge_objectives(asked.criteria, "smoothing").optimised, None, 60)
        with Clock() as clock:
            outcomes = [job.solve(polyline) for polyline in polylines]
        pairs = [
            (p.execution(), o.candidate.trajectory) for p, o in zip(polylines, outcomes, strict=True) if o.candidate
        ]
        before, after = (
            trajectory_costs(job.criteria[:1], [pair[side] for pair in pairs], problem.world)[:, 0] for side in (0, 1)
        )
        rows[name] = {
            "polylines": len(polylines),
            "smoothed": len(pairs),
            "dropped": dict(Counter(o.reason for o in outcomes if o.reason)),
            **clock.row(np.array(clock.intervals) == 60),
            "cost over the polyline's execution, median": float(np.median(after / np.maximum(before, 1e-9))),
        }
        print(name, json.dumps(rows[name]), flush=True)
    return rows


def checked(problem: hpop.Problem) -> int:
    """Faults that an independent check finds in a small front of the planner."""
    faults = verify(problem, problem.solve("smoothing", step=1.0))
    return len(faults)


def main() -> None:
    """Run all parts and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("out/bench/smoothing.json"))
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data")))
    options = parser.parse_args()
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    museum = hpop.World.from_geojson(ROOT / "examples" / "museum.geojson")
    problem = hpop.Problem(museum, robot, (2, 10, 0), (28, 10, 0), CRITERIA)
    result: dict[str, Any] = {"museum": smoothing(problem, 0.5), "faults": checked(problem)}
    result["museum"]["harder"] = harder(problem, 0.5)
    office = options.data / "pal_office" / "map.yaml"
    if office.exists():
        world = hpop.World.from_ros_map(office)
        problem = hpop.Problem(world, robot, (6, -8, np.pi / 2), (-10, 1, None), CRITERIA)
        result["pal_office"] = smoothing(problem, 0.25)
        result["pal_office"]["harder"] = harder(problem, 0.25)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
