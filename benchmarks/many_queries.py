"""Benchmark of many queries on one map: processor time of the first query and of others, in a world that is kept.

    python benchmarks/many_queries.py [--map NAME ...] [--queries 25] [--loop 50] [--large 0] [--out FILE]

Then come the queries of a robot node that replans in a loop. Each begins halfway along the knee of the last front,
after a box of 2 x 3 cells at a random place became occupied. The time of this update is included.

Step 0.25 m, criteria exposure, turns and length. Kernels are loaded by queries in another world before; then the map
is read anew, and what the first query takes includes its fields and its lattice, but not reading the file. Starts and
goals of the others are drawn at random; those within walls are drawn again. ``arcs`` and ``labels`` do not depend on
the machine.

With ``--large N``, the first and N other queries on a map of 2,000 x 2,000 cells of 0.05 m with 150 boxes, made here:
duration, turns and length, for a disc and a rectangle. Starts and goals are drawn anywhere ("near"), or in opposite
corners ("far"). ``early_s`` are the seconds until `Problem.fronts` has its first stage: the largest of three far
queries, each in a world that is made anew.
"""

from __future__ import annotations

import argparse
import json
import resource
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any

import maps
import numpy as np

import hpop
from hpop.errors import QueryError

CRITERIA = ["exposure", "turns", "length"]


def problem(name: str) -> hpop.Problem:
    """Read a map anew, with the robot and the query of its example."""
    return hpop.examples.museum() if name == "museum" else maps.problem(name)


def planning(asked: hpop.Problem) -> hpop.Planning:
    """Keep the lattice of a world."""
    return hpop.Planning(asked.world, asked.model, CRITERIA, {"lattice": {"step": 0.25}})


def measure(name: str, queries: int) -> dict[str, Any]:
    """Time the first and other queries on one map."""
    asked = problem(name)
    warm = planning(asked)
    for _ in range(2):
        warm.solve(asked.start, asked.goal)
    asked = problem(name)
    many = planning(asked)
    begun = process_time()
    first = many.solve(asked.start, asked.goal)
    seconds = process_time() - begun
    others, labels = list[float](), list[int]()
    rng = np.random.default_rng(1)
    x0, y0, x1, y1 = asked.world.bounds
    while len(others) < queries:
        start, goal = rng.uniform((x0, y0), (x1, y1), (2, 2)).round(2)
        begun = process_time()
        try:
            front = many.solve((*start, 0.0), (*goal, None))
        except QueryError:
            continue
        if len(front):
            others.append(process_time() - begun)
            labels.append(front.runs[-1]["labels_generated"])
    median = float(np.median(others))
    return {
        "arcs": first.runs[-1]["edges"],
        "labels_median": int(np.median(labels)),
        "first_s": round(seconds, 3),
        "others_median_s": round(median, 3),
        "others_95_percent_s": round(float(np.quantile(others, 0.95)), 3),
        "ratio": round(median / seconds, 3),
    }


def measure_loop(name: str, queries: int) -> dict[str, Any]:
    """Time updates and queries on a map of cells that change."""
    asked = problem(name)
    if asked.world.raster is None:
        return {}
    many, robot = planning(asked), asked.start
    for _ in range(2):
        many.solve(robot, asked.goal)
    updates, solved = list[float](), list[float]()
    rng = np.random.default_rng(2)
    x0, y0, x1, y1 = asked.world.bounds
    free = np.argwhere(~asked.world.raster.cells)
    rows, columns = asked.world.raster.cells.shape
    while len(solved) < queries:
        row, column = free[rng.integers(len(free))].tolist()
        box = np.ones((min(2, rows - row), min(3, columns - column)), dtype=bool)
        goal = rng.uniform((x0, y0), (x1, y1)).round(2)
        begun = process_time()
        many = many.updated(many.world.updated(box, at=(column, row)))
        updated = process_time()
        try:
            front = many.solve(robot, (*goal, None))
        except QueryError:
            continue
        if len(front):
            updates.append(updated - begun)
            solved.append(process_time() - updated)
            states = front.knee().trajectory.states
            half = len(states.x) // 2
            robot = tuple(float(column[half]) for column in (states.x, states.y, states.yaw))
    return {
        "loop_median_s": round(float(np.median(np.add(updates, solved))), 3),
        "loop_update_median_s": round(float(np.median(updates)), 3),
        "loop_query_median_s": round(float(np.median(solved)), 3),
    }


def large_world() -> hpop.World:
    """Return a map of 100 x 100 m with boxes of up to 6 x 3 m."""
    cells = np.zeros((2000, 2000), dtype=bool)
    for x, y, width, height in np.random.default_rng(0).integers((0, 0, 10, 10), (1900, 1900, 120, 60), (150, 4)):
        cells[y : y + height, x : x + width] = True
    return hpop.World.from_cells(cells, 0.05, origin=(-50.0, -50.0, 0.0))


class FirstStage(Exception):
    """Raised to end planning at its first stage."""


def measure_large(robot: hpop.DifferentialDrive, queries: int) -> dict[str, Any]:
    """Time the first and other queries, near and far, and early fronts of far ones, on a map of 100 x 100 m."""
    criteria, lattice = ["duration", "turns", "length"], {"lattice": {"step": 0.25}}
    small = hpop.World.from_cells(np.zeros((200, 200), dtype=bool), 0.05, origin=(-5.0, -5.0, 0.0))
    for x in (3.0, 2.0):  # load the kernels
        hpop.Planning(small, robot, criteria, lattice).solve((-3.0, -3.0, 0.0), (x, 3.0, None))
        fine = {"lattice": {"step": 0.05}}
        list(
            hpop.Problem(small, robot, (-3.0, -3.0, 0.0), (x, 3.0, None), criteria).fronts([fine], stage=lambda _: None)
        )
    world = large_world()
    free = np.random.default_rng(1).uniform(-48, 48, (4000, 2)).round(2)
    free = free[world.clearance(free[:, 0], free[:, 1]) > 0.8]
    corner = free[(free < -30).all(axis=1)], free[(free > (30, 10)).all(axis=1)]
    ends = {"near": (free[:queries], free[queries : 2 * queries]), "far": (corner[0][:queries], corner[1][:queries])}
    world, result = large_world(), dict[str, Any]()
    planning = hpop.Planning(world, robot, criteria, lattice)

    def seconds(start: Any, goal: Any) -> float:
        begun = process_time()
        planning.solve((*start.tolist(), 0.3), (*goal.tolist(), None))
        return round(process_time() - begun, 2)

    result["first_s"] = seconds(corner[0][-1], corner[1][-1])
    for name, (starts, goals) in ends.items():
        result[f"{name}_s"] = [seconds(start, goal) for start, goal in zip(starts, goals, strict=True)]

    result["peak_mb"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024

    def stop(front: hpop.Front) -> None:
        raise FirstStage

    early = list[float]()
    for start, goal in zip(*(points[:3].tolist() for points in corner), strict=True):
        asked = hpop.Problem(large_world(), robot, (*start, 0.3), (*goal, None), criteria)
        begun = process_time()
        try:
            list(asked.fronts([lattice], stage=stop))
        except FirstStage:
            early.append(process_time() - begun)
    return result | {"early_s": round(max(early), 2)}


def main() -> None:
    """Measure, print, and write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--map", nargs="*", default=["museum", "pal_office", "nav2_depot"])
    parser.add_argument("--queries", type=int, default=25)
    parser.add_argument("--loop", type=int, default=50)
    parser.add_argument("--large", type=int, default=0)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    result = {}
    for name in options.map:
        if name != "museum" and (why := maps.missing(name)):
            print(f"{name}: left out, {why}")
            continue
        result[name] = measure(name, options.queries) | measure_loop(name, options.loop)
        print(name, result[name], flush=True)
    corners = ((0.3, 0.225), (-0.3, 0.225), (-0.3, -0.225), (0.3, -0.225))
    shapes: dict[str, dict[str, Any]] = {"disc": {"radius": 0.3}, "rectangle": {"footprint": corners}}
    for shape, footprint in shapes.items() if options.large else ():
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:  # its own peak of memory
            robot = hpop.DifferentialDrive(speed=0.8, **footprint)
            result[f"large, {shape}"] = process.submit(measure_large, robot, options.large).result()
        print(shape, result[f"large, {shape}"], flush=True)
    if options.out:
        options.out.parent.mkdir(parents=True, exist_ok=True)
        options.out.write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
