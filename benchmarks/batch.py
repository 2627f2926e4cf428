"""Benchmark of batches: 200 problems on one and on two cores, the overhead of a case, and 10,000 tiny cases.

    python benchmarks/batch.py [--problems 200] [--tiny 10000] [--out FILE]

Problems lie between random free places of the museum, with exposure, turns and length on a lattice of 0.5 m anchored at
the world; kernels are loaded before. The overhead is the time of a batch in one process less the seconds that its cases
took. Tiny cases are distinct goals in an empty hall of 4 x 4 m; their memory is the largest of the planning process.
"""

from __future__ import annotations

import argparse
import json
import resource
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
import shapely

import hpop

LATTICE = {"lattice": {"step": 0.5, "anchor": "world"}}
HALL = hpop.World.from_polygons([], extent=shapely.box(0, 0, 4, 4))
ROBOT = hpop.DifferentialDrive(radius=0.3)


def problems(count: int) -> list[hpop.Problem]:
    """Return problems between random free places of the museum."""
    museum = hpop.examples.museum()
    x0, y0, x1, y1 = museum.world.bounds
    places = np.random.default_rng(1).uniform((x0, y0), (x1, y1), (10 * count, 2)).round(2)
    free = places[museum.world.clearance(*places.T) > museum.model.radius + 0.1]
    criteria = ["exposure", "turns", "length"]
    pairs = zip(free[:count], free[count : 2 * count], strict=True)
    return [hpop.Problem(museum.world, museum.model, (*start, 0.0), (*goal, None), criteria) for start, goal in pairs]


def tiny(count: int) -> Iterator[hpop.Problem]:
    """Yield problems of a few states each."""
    for number in range(count):
        x, y = np.divmod(number, 100)
        yield hpop.Problem(HALL, ROBOT, (1, 1, 0), (1 + x / 50, 1 + y / 50, None), ["turns", "length"])


def seconds(asked: list[hpop.Problem], planner: Any, workers: int | None) -> tuple[float, float]:
    """Return the seconds of a batch by the clock, and those of its cases together."""
    with TemporaryDirectory() as folder:
        begin = perf_counter()
        results = hpop.batch(asked, planner, out=folder, workers=workers)
        taken = perf_counter() - begin
        table = results.table(["case", "seconds"]).to_pydict()
    return taken, sum(dict(zip(table["case"], table["seconds"], strict=True)).values())


def main() -> None:
    """Measure, print, and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", type=int, default=200)
    parser.add_argument("--tiny", type=int, default=10_000)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    asked = problems(options.problems)
    seconds(asked[:4], LATTICE, None)
    alone, of_cases = seconds(problems(options.problems), LATTICE, None)
    together, _ = seconds(problems(options.problems), LATTICE, 2)
    small = list(tiny(options.tiny))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    taken, inside = seconds(small, {"lattice": {"step": 1.0}}, None)
    result = {
        "problems": options.problems,
        "one_core_s": round(alone, 2),
        "two_cores_s": round(together, 2),
        "two_cores_of_one": round(together / alone, 3),
        "overhead_ms": round(1e3 * (alone - of_cases) / options.problems, 2),
        "tiny": options.tiny,
        "tiny_s": round(taken, 2),
        "tiny_overhead_ms": round(1e3 * (taken - inside) / options.tiny, 2),
        "tiny_more_memory_mb": round((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3, 1),
    }
    print(json.dumps(result, indent=1))
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
