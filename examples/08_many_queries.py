"""Answer fifty queries on one map. The first one builds the graph; the others only join their start and goal to it.

Then run the loop of a robot node: fifty queries, each from where the robot is, on a grid in which some cells change.
"""

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


def loop(step: float = 0.25, queries: int = 50, seed: int = 1) -> list[hpop.Front]:
    """Plan as a robot node does: a box appears in the occupancy grid, and the robot gets a new goal on its way."""
    museum = hpop.examples.museum()
    grid = occupancy(museum.world, 0.1)
    world = hpop.World.from_occupancy_grid(grid, 0.1, (*museum.world.bounds[:2], 0.0))
    planning = hpop.Planning(world, museum.model, ["exposure", "turns", "length"], {"lattice": {"step": step}})

    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = world.bounds
    robot = museum.start
    fronts, seconds = [planning.solve(robot, museum.goal)], list[float]()
    while len(fronts) < queries:
        row, column = rng.integers((0, 0), (grid.shape[0] - 3, grid.shape[1] - 3))
        message = grid.copy()  # as in a nav_msgs/OccupancyGrid, with a box of 0.3 m
        message[row : row + 3, column : column + 3] = 100
        goal = rng.uniform((x0, y0), (x1, y1)).round(2)
        begun = process_time()
        planning = planning.updated(planning.world.updated(message))
        try:
            front = planning.solve(robot, (*goal, None))
        except QueryError:
            continue  # the goal is within a wall, or the box is where the robot stands
        if len(front):
            seconds.append(process_time() - begun)
            fronts.append(front)
            states = front.knee().trajectory.states
            half = len(states.x) // 2
            robot = tuple(float(column[half]) for column in (states.x, states.y, states.yaw))

    print(f"{queries} queries on a changing grid: {np.median(seconds):.2f} s of processor time each, update included")
    return fronts


def occupancy(world: hpop.World, resolution: float) -> np.ndarray:
    """Return the world as an occupancy grid, 0 for a free and 100 for an occupied cell; row 0 at the bottom."""
    x0, y0, x1, y1 = world.bounds
    x, y = np.meshgrid(np.arange(x0, x1, resolution), np.arange(y0, y1, resolution))
    clearance = world.clearance(x.ravel() + resolution / 2, y.ravel() + resolution / 2)
    return np.where(clearance > 0, 0, 100).astype(np.int8).reshape(x.shape)


if __name__ == "__main__":
    main()
    loop()
