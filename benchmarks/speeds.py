"""Benchmark of speeds as a decision: fronts over three speeds beside the joined fronts of each speed alone.

    python benchmarks/speeds.py [--step 0.5] [--eps 0] [--out FILE]

The museum of examples/, criteria duration, turns and the squared flow: the integral of (v/d)², v the speed and d the
clearance, at least 0.1 m. Plans for one speed leave out the first start and the last stop, so their durations get v/a.
``gain`` is the ratio of the hypervolumes, costs scaled over both fronts, reference point 1.1. ``labels`` and ``points``
do not depend on the machine.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

import hpop
from hpop.criteria.base import criterion
from hpop.frontier import hypervolume, is_nondominated
from hpop.motions import Motions

SPEEDS = (0.5, 1.0, 1.5)
QUANTUM = 1e-6  # s, and of the squared flow
NEAREST = 0.1  # m


@criterion("flow_squared", group="C", unit="rad²/s", aggregate="sum", requires=("base",), quantum=1e-4)
@dataclass(frozen=True)
class FlowSquared:
    """Integral of the squared flow of the nearest obstacle: ∫ (v / max(d, 0.1 m))² dt."""

    def cost(self, m: Motions) -> Any:
        """Return the integral (M,), rad²/s."""
        if m.base.stays:
            return 0.0 * m.duration
        clearance = m.world.clearance_field()
        return m.integrate(
            lambda s: (s.speed / np.maximum(clearance(s.base.x, s.base.y), NEAREST)) ** 2, detail=NEAREST
        )


def measure(speeds: tuple[float, ...], step: float, eps: float) -> tuple[dict[str, Any], Any]:
    """Plan with some speeds, and return the figures and the costs."""
    museum, robot = hpop.examples.museum(), hpop.DifferentialDrive(speeds=speeds)
    criteria = ["duration", "turns", FlowSquared()]
    problem = hpop.Problem(museum.world, robot, museum.start, (28, 10, None), criteria)
    begun = process_time()
    found = hpop.Lattice(step=step, eps=eps).solve(problem)
    costs = found.planned.copy()
    costs[:, 0] += speeds[0] / robot.acceleration if len(speeds) == 1 else 0.0
    figures = {
        "speeds": list(speeds),
        "points": len(costs),
        "states": found.stats["states"],
        "arcs": found.stats["edges"],
        "labels": found.stats["labels_generated"],
        "seconds": round(process_time() - begun, 2),
    }
    return figures, costs


def main() -> None:
    """Measure all fronts, and print or write the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--step", type=float, default=0.5)
    parser.add_argument("--eps", type=float, default=0.0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    measure(SPEEDS, 1.0, 0.0)  # loads the kernels
    rows, fronts = zip(
        *(measure(speeds, options.step, options.eps) for speeds in (*((s,) for s in SPEEDS), SPEEDS)), strict=True
    )
    joined = np.concatenate(fronts[:-1])
    joined = joined[is_nondominated(np.round(joined / QUANTUM).astype(np.int64))]
    both = np.concatenate([joined, fronts[-1]])
    span = np.ptp(both, axis=0)
    volumes = [hypervolume((front - both.min(axis=0)) / span, np.full(3, 1.1)) for front in (joined, fronts[-1])]
    result = {"runs": rows, "joined_points": len(joined), "gain": round(volumes[1] / volumes[0], 3)}
    if options.out is None:
        print(json.dumps(result, indent=1))
    else:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
