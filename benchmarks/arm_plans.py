"""Benchmark of plans for an arm: roadmaps, their fronts and splines on MotionBenchMaker, beside OMPL's RRT-Connect.

``python benchmarks/arm_plans.py --out out/bench/arm_plans.json [--problems 20]``

The arm grasps with what it grasps in sight: costs are the duration, the rotation of its camera, the angle to the target
over time. Roadmaps of 10,000 samples on one problem, with three and four costs, their fronts and their weighted sums;
then problems of both sets on 2,000, the quickest and the calmest path of each front made a spline. Joint lengths are
those of MotionBenchMaker, rad. RRT-Connect has OMPL's defaults and asks the same certificates for one motion at a time,
from Python; OMPL shortens its path. It shows what one plan is worth beside a front, not how fast OMPL is. Seconds are
the processor's, kernels loaded.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import mbm
import numpy as np

import hpop
from hpop.base.arrays import FloatArray
from hpop.criteria import Criterion, make_criterion
from hpop.criteria.costs import trajectory_costs
from hpop.motions import Motions, States
from hpop.planners import Roadmap
from hpop.planners.programs.spline.job import SplineJob
from hpop.planners.spending import Spending
from hpop.search import pareto_paths, supported_paths
from hpop.trajectories.trajectory import Trajectory

LARGE, SAMPLES = 10_000, 2_000
FAR = {"eight far links": 8, "24 far links": 24}
AIMS = {"quick splines": 0, "splines for each cost": None}  # place of the cost that is minimised
JOINT_LENGTH = make_criterion("joint_length")
MOST = 20_000  # motions that OMPL asks about
SHORTENED = 100  # tries of OMPL's to leave out what lies between two places of a path


class Watch:
    """Processor seconds since the last look."""

    def __init__(self) -> None:
        self.before = time.process_time()

    def seconds(self) -> float:
        """Return the processor seconds since the last call."""
        before, self.before = self.before, time.process_time()
        return self.before - before


def large(problem: hpop.Problem, far: int) -> dict[str, Any]:
    """Measure a roadmap of one problem from nothing to its front."""
    watch, planner = Watch(), Roadmap(samples=LARGE, far=far)
    roadmap = planner.roadmap(problem, Spending())
    row: dict[str, Any] = {"nodes": roadmap.size, "drawn_and_linked_s": watch.seconds()}
    graph = roadmap.graph(problem.criteria)
    row |= {"edges": graph.arcs, "costs_s": watch.seconds()}
    paths = pareto_paths(graph, roadmap.start, roadmap.goals, free=roadmap.arcs_free)
    row |= {
        "front_s": watch.seconds(),
        "front": len(paths),
        "rounds": paths.stats.rounds,
        "edges_checked": paths.stats.arcs_checked,
        "edges_checked_share": paths.stats.arcs_checked / graph.arcs,
        "labels_generated": paths.stats.labels_generated,
    }
    supported = supported_paths(graph, roadmap.start, roadmap.goals, free=roadmap.arcs_free)
    return row | {
        "weighted_sums_s": watch.seconds(),
        "weighted_sums": len(supported),
        "weighted_sums_edges_checked": supported.stats.arcs_checked,
    }


def planned(problem: hpop.Problem) -> dict[str, Any]:
    """Measure the front of a problem, two splines of it, and RRT-Connect."""
    watch = Watch()
    found = Roadmap(samples=SAMPLES).solve(problem)
    row: dict[str, Any] = {"front_s": watch.seconds(), "front": len(found.trajectories)}
    row |= {"edges_checked_share": found.stats["edges_checked"] / found.stats["edges"]}
    if not len(found.trajectories):
        return row
    costs = costed(problem.criteria, found.trajectories, problem)
    row |= {"least_joint_length": float(costed((JOINT_LENGTH,), found.trajectories, problem).min())}
    row |= {"least": costs.min(axis=0).tolist()}
    ends = [found.trajectories[i] for i in dict.fromkeys(costs.argmin(axis=0)[:2].tolist())]
    row |= {name: splines(problem, ends, minimise) for name, minimise in AIMS.items()}
    baseline = rrt_connect(problem)
    if baseline is not None:
        (vector,) = costed(problem.criteria, [baseline.pop("trajectory")], problem)
        row["rrt_connect"] = baseline | {
            "costs": vector.tolist(),
            "dominated_by": int(((costs <= vector).all(axis=1) & (costs < vector).any(axis=1)).sum()),
        }
    return row


def costed(criteria: Sequence[Criterion], paths: Sequence[Trajectory], problem: hpop.Problem) -> FloatArray:
    """Costs (n, k) of some paths."""
    return trajectory_costs(criteria, paths, problem.world)


def splines(problem: hpop.Problem, paths: Sequence[Trajectory], minimise: int | None) -> list[dict[str, Any]]:
    """Turn some paths into splines, one after another; the program is built before."""
    job = SplineJob(problem, problem.criteria, tuple(range(len(problem.criteria))), minimise, pieces=12)
    job.solve(paths[0])
    rows = []
    for path in paths:
        watch = Watch()
        outcome = job.solve(path)
        improved = outcome.candidate or ()
        row: dict[str, Any] = {"seconds": watch.seconds(), "splines": len(improved)}
        if improved:
            before, after = costed(problem.criteria, [path, improved[0].trajectory], problem)
            row["costs_over_those_of_the_path"] = (after / before).tolist()
        rows.append(row)
    return rows


# OMPL


def rrt_connect(problem: hpop.Problem) -> dict[str, Any] | None:
    """Return a path by OMPL on the same certificates; None where OMPL is not installed."""
    try:
        ob, og, util = (import_module(f"ompl.{name}") for name in ("base", "geometric", "util"))
    except ImportError:
        return None
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(1)
    arm, collision = problem.model, problem.model.collision(problem.world)
    names, asked = arm.space.names, 0

    def states(*rows: Any) -> States:
        return States(**{name: np.array([row[k] for row in rows]) for k, name in enumerate(names)})

    class Certified(ob.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802  (OMPL's name)
            nonlocal asked
            asked += 1
            motion = Motions(problem.world, arm, arm.laws["reach"], states(a), states(b))
            return bool(collision.motions_free(motion)[0])

    space, bounds = ob.RealVectorStateSpace(len(names)), ob.RealVectorBounds(len(names))
    for k, (low, high) in enumerate(zip(arm.space.low, arm.space.high, strict=True)):
        bounds.setLow(k, low)
        bounds.setHigh(k, high)
    space.setBounds(bounds)
    information = ob.SpaceInformation(space)
    information.setStateValidityChecker(lambda state: bool(collision.states_free(states(state))[0]))
    validator = Certified(information)
    information.setMotionValidator(validator)
    information.setup()
    definition, ends = ob.ProblemDefinition(information), []
    for values in (problem.start, problem.goal):
        end = information.allocState()
        for k, value in enumerate(values):
            end[k] = value
        ends.append(end)
    definition.setStartAndGoalStates(*ends)
    tree = og.RRTConnect(information)
    tree.setProblemDefinition(definition)
    tree.setup()
    watch = Watch()
    tree.solve(ob.PlannerTerminationCondition(lambda: asked > MOST))
    row: dict[str, Any] = {"seconds": watch.seconds(), "motions_asked": asked}
    if not definition.hasExactSolution():
        return row | {"found": False}
    path = definition.getSolutionPath()
    og.PathSimplifier(information).partialShortcutPath(path, SHORTENED, SHORTENED)
    og.PathSimplifier(information).reduceVertices(path, SHORTENED, SHORTENED)
    trajectory = Trajectory.through(arm, states(*path.getStates()))
    (length,) = costed((JOINT_LENGTH,), [trajectory], problem).ravel()
    return row | {
        "found": True,
        "shortening_s": watch.seconds(),
        "joint_length": float(length),
        "free": all(bool(collision.motions_free(m).all()) for _, m in trajectory.batches(problem.world)),
        "trajectory": trajectory,
    }


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Summarise the problems of a set."""
    solved = [row for row in rows if row["front"]]
    found: dict[str, Any] = {
        "problems": len(rows),
        "solved": len(solved),
        "front": middle([row["front"] for row in rows]),
        "front_s": middle([row["front_s"] for row in rows]),
        "edges_checked_share": middle([row["edges_checked_share"] for row in rows]),
        "least_joint_length": middle([row["least_joint_length"] for row in solved]),
    }
    for name in AIMS:
        made = [one for row in solved for one in row[name]]
        ratios = np.array([one["costs_over_those_of_the_path"] for one in made if one["splines"]])
        found[name] = {
            "paths": len(made),
            "paths_with_splines": len(ratios),
            "splines": sum(one["splines"] for one in made),
            "seconds_a_path": middle([one["seconds"] for one in made]),
            "costs_over_those_of_the_path": np.median(ratios, axis=0).tolist() if len(ratios) else None,
        }
    trees = [row["rrt_connect"] for row in solved if "rrt_connect" in row]
    if reached := [(row, tree) for row, tree in zip(solved, trees, strict=False) if tree["found"]]:
        least = np.array([np.array(tree["costs"]) / row["least"] for row, tree in reached])
        found["rrt_connect"] = {
            "found": len(reached),
            "seconds": middle([tree["seconds"] for _, tree in reached]),
            "motions_asked": middle([tree["motions_asked"] for _, tree in reached]),
            "joint_length": middle([tree["joint_length"] for _, tree in reached]),
            "costs_over_the_least_of_the_front": np.median(least, axis=0).tolist(),
            "dominated_by_the_front": sum(tree["dominated_by"] > 0 for _, tree in reached),
        }
    return found


def middle(values: Sequence[float]) -> dict[str, float]:
    """Return the median and the largest value."""
    return {"median": float(np.median(values)), "most": float(np.max(values))} if values else {}


def main() -> None:
    """Measure, print and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    parser.add_argument("--problems", type=int, default=20, help="of each set, at most 20")
    arguments = parser.parse_args()
    arm = mbm.panda()
    if arm is None:
        print(mbm.LACKING)
        return
    report: dict[str, Any] = {}
    for more in ([], ["singularity"]):
        asked = mbm.problem(arm, mbm.SETS[0], 1, *more)
        for planner in ("roadmap", {"weighted-sum": {"on": {"roadmap": {"samples": 200}}}}):  # kernels
            asked.solve(planner)
        for name, far in FAR.items():
            report[f"{len(asked.criteria)} costs, {name}"] = row = large(asked, far)
            print(len(asked.criteria), "costs,", name, row, flush=True)
    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in mbm.SETS}
    for name, number in product(mbm.SETS, mbm.NUMBERS[: arguments.problems]):
        rows[name].append(planned(mbm.problem(arm, name, number)))
        print(name, number, rows[name][-1], flush=True)
    report |= {name: summary(each) for name, each in rows.items()}
    print(json.dumps(report, indent=1))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(report | {"rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
