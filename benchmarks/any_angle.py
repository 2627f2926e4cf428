"""Benchmark of roadmaps: what angles other than 45 degrees, and random positions, add to the lattice's front.

``python benchmarks/any_angle.py --out out/bench/any_angle.json``

A lattice point is strictly dominated if some point of the other front is nowhere worse and better by a thousandth in
one cost. Hypervolumes are of costs scaled from the joined front's ideal to a hundredth beyond the lattice's worst.
Seconds hold everything that the planner does, the lattice included where it starts from one; `over_lattice` divides
them by those of the lattice planner. Counts and ratios depend on no machine.
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
from hpop.planners import AnyAngle, Candidates, Lattice, Roadmap

ROOT = Path(__file__).parents[1]
BETTER = 1e-3  # relative
ROUNDED = 1e-6  # relative, or quanta: sums along other edges


def problems(data: Path) -> dict[str, hpop.Problem]:
    """Return the museum, and the office if the public data exist."""
    robot = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)
    criteria = ["exposure", "turns", "length"]
    museum = hpop.World.from_geojson(ROOT / "examples" / "museum.geojson")
    found = {"museum": hpop.Problem(museum, robot, (2, 10, 0), (28, 10, 0), criteria)}
    office = data / "pal_office" / "map.yaml"
    if office.exists():
        world = hpop.World.from_ros_map(office)
        found["pal_office"] = hpop.Problem(world, robot, (6, -8, np.pi / 2), (-10, 1, None), criteria)
    return found


def timed(planner: Lattice | AnyAngle | Roadmap, problem: hpop.Problem) -> tuple[Candidates, float]:
    """Return a planner's result and its seconds, with kernels already loaded."""
    planner.solve(problem)
    began = time.perf_counter()
    return planner.solve(problem), time.perf_counter() - began


def compared(problem: hpop.Problem, step: float, samples: int) -> dict[str, Any]:
    """Compare the fronts of the lattice and of both roadmaps."""
    found, lattice_s = timed(Lattice(step), problem)
    lattice = problem.front(found)
    row: dict[str, Any] = {
        "step": step,
        "lattice_points": len(lattice),
        "lattice_labels": found.stats["labels_generated"],
        "lattice_s": lattice_s,
    }
    for planner in (AnyAngle(step), Roadmap(samples=samples)):
        candidates, seconds = timed(planner, problem)
        front = problem.front(candidates)
        joined = lattice | front
        same = ROUNDED * np.maximum(lattice.costs, 1.0)
        no_worse = np.all(front.costs <= (lattice.costs + same)[:, None], axis=2)  # (lattice's, other's)
        better = np.any(front.costs < ((1 - BETTER) * lattice.costs)[:, None], axis=2)
        low, high = joined.costs.min(axis=0), 1.01 * lattice.costs.max(axis=0)
        volumes = [hypervolume((f.costs - low) / (high - low), np.ones(len(low))) for f in (lattice, front, joined)]
        row[candidates.stats["planner"]] = {
            "status": str(candidates.status),
            "points": len(front),
            "joined_points": len(joined),
            "lattice_covered": float(np.any(no_worse, axis=1).mean()),
            "lattice_strictly_dominated": float(np.any(no_worse & better, axis=1).mean()),
            "hypervolume_over_lattice": volumes[1] / volumes[0],
            "joined_hypervolume_over_lattice": volumes[2] / volumes[0],
            "least": dict(zip(front.names, front.costs.min(axis=0).tolist(), strict=True)),
            "least_lattice": dict(zip(front.names, lattice.costs.min(axis=0).tolist(), strict=True)),
            **{
                name: candidates.stats[name] for name in ("positions", "states", "edges", "labels_generated", "dropped")
            },
            "build_s": candidates.stats["build_seconds"],
            "search_s": candidates.stats["search_seconds"],
            "seconds": seconds,
            "over_lattice": seconds / lattice_s,
            "notes": list(candidates.notes),
        }
    return row


def main() -> None:
    """Measure both worlds and write what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step", type=float, default=0.25)
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data")))
    parser.add_argument("--out", type=Path, help="JSON file; printed in any case")
    options = parser.parse_args()
    result = {name: compared(asked, options.step, options.samples) for name, asked in problems(options.data).items()}
    print(json.dumps(result, indent=1))
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
