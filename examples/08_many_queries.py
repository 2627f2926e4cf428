"""Answer fifty queries on one map. The first one builds the graph; the others only join their start and goal to it."""

from time import process_time

import numpy as np

import hpop
from hpop.errors import QueryError


def main(step: float = 0.25, queries: int = 50, seed: int = 1) -> list[hpop.Front]:
    """Plan between random places of the museum, and print the time of the first query and of the others."""
    museum = hpop.examples.museum()
    planning = hpop.Planning(
        world=museum.world,
        model=museum.model,
        criteria=["exposure", "turns", "length"],
        planner={"lattice": {"step": step}},
    )

    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = museum.world.bounds
    fronts, seconds = list[hpop.Front](), list[float]()
    while len(fronts) < queries:
        start, goal = rng.uniform((x0, y0), (x1, y1), (2, 2)).round(2)
        begun = process_time()
        try:
            fronts.append(planning.solve((*start, 0.0), (*goal, None)))
        except QueryError:
            continue  # the start or the goal is inside a wall, or too near to one
        seconds.append(process_time() - begun)

    first, others = seconds[0], float(np.median(seconds[1:]))
    print(f"{queries} queries, {sum(map(len, fronts)):,} trajectories")
    print(f"processor time: the first {first:.2f} s, the others {others:.2f} s (median), {others / first:.2f} of it")
    return fronts


if __name__ == "__main__":
    main()
