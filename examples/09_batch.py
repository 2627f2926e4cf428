"""Solve two hundred problems on four floors with three planners, and draw a figure that compares the planners."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import shapely

import hpop
from hpop.batches import summaries, summary_lines
from hpop.view import draw_batch

PLANNERS = {
    "lattice, 1 m": {"lattice": {"step": 1.0, "anchor": "world"}},
    "lattice, 0.5 m": {"lattice": {"step": 0.5, "anchor": "world"}},
    "roadmap": {"roadmap": {"samples": 60, "seed": 1}},
}
CRITERIA = ["exposure", "turns", "length"]
SIZE = (20.0, 14.0)  # m


def floor(seed: int, cabinets: int = 12) -> hpop.World:
    """Return a hall with cabinets at random places."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform((1.0, 1.0), (SIZE[0] - 3.0, SIZE[1] - 3.0), size=(cabinets, 2))
    sides = rng.uniform(0.5, 2.0, size=(cabinets, 2))
    boxes = shapely.union_all(shapely.box(*corners.T, *(corners + sides).T))
    parts = list(boxes.geoms) if hasattr(boxes, "geoms") else [boxes]
    return hpop.World.from_polygons(parts, extent=shapely.box(0, 0, *SIZE))


def problems(floors: int, pairs: int) -> Iterator[hpop.Problem]:
    """Yield problems between random free places of each floor."""
    robot = hpop.DifferentialDrive(radius=0.3)
    for seed in range(floors):
        world, rng = floor(seed), np.random.default_rng(seed)
        places = rng.uniform(0.5, np.array(SIZE) - 0.5, size=(20 * pairs, 2)).round(2)
        free = places[world.clearance(*places.T) > 0.6]
        for start, goal in zip(free[:pairs], free[pairs : 2 * pairs], strict=True):
            yield hpop.Problem(world, robot, (*start, 0.0), (*goal, None), CRITERIA)


def main(out: str = "out/09_batch", floors: int = 4, pairs: int = 50, workers: int = 2) -> hpop.batches.Results:
    """Solve all problems, print a summary of each planner, and draw the figure."""
    results = hpop.batch(list(problems(floors, pairs)), PLANNERS, out=out, workers=workers)
    of_planners = summaries(results)
    print(*summary_lines(of_planners), sep="\n")
    draw_batch(of_planners, Path(out) / "summary.png")
    return results


if __name__ == "__main__":
    main()
