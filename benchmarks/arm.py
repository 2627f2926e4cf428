"""Benchmark of an arm's geometry: poses, goals, states, clearances, certified motions, and costs of hidden targets.

``python benchmarks/arm.py --out out/bench/arm.json``

The Panda among the seven solids of MotionBenchMaker's first bookshelf and the twelve of its first table, its fingers 40
mm out, with the meshes of the wheel example-robot-data; without these there is nothing to measure. Motions lead from
free states to others: a share of the way to one that is drawn as well. Seconds are of the processor, kernels loaded.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mbm
import numpy as np

import hpop
from hpop.criteria import make_criterion, motion_costs
from hpop.goals import LookAt
from hpop.models.serial_arm.model import SerialArm
from hpop.motions import Motions, States

POSES = 100_000
STATES = 20_000
GOALS = 1_000
SHARES = {"far": 1.0, "middling": 0.3, "near": 0.1}


def seconds(work: Callable[[], object]) -> float:
    """Return the processor seconds of a call: the least of three runs after a warm-up."""
    runs = []
    for _ in range(4):
        began = time.process_time()
        work()
        runs.append(time.process_time() - began)
    return min(runs[1:])


def columns(arm: SerialArm, states: States) -> list[Any]:
    """All of the camera's poses."""
    pose = arm.pose("camera", States(**states.__dict__))  # of other states: what is known of the same ones is kept
    return [pose.x, pose.y, pose.z, *pose.ahead, *pose.left, *pose.up]


def goals(arm: SerialArm) -> dict[str, Any]:
    """States in which the camera looks at what is grasped, from 20 to 40 cm away, by inverse kinematics."""
    asked = mbm.problem(arm, mbm.SETS[0], 1)
    target = asked.criteria[2].target
    problem = hpop.Problem(asked.world, arm, asked.start, LookAt(target, (0.2, 0.4)), ["duration"])
    states = problem.target.states(problem, np.random.default_rng(1), GOALS)
    return {
        "seconds": seconds(lambda: problem.target.states(problem, np.random.default_rng(1), GOALS)),
        "found": states.size,
        "free": int(arm.collision(asked.world).states_free(states).sum()),
    }


def hidden(motions: Motions, target: Any, rays: int) -> float:
    """Processor seconds of `occlusion` for 250,000 such motions."""
    criterion = make_criterion({"occlusion": {"target": target, "rays": rays}})

    def costs() -> None:
        motion_costs(criterion, Motions(motions.world, motions.model, motions.law, motions.start, motions.end))

    return 250_000 / len(motions) * seconds(costs)


def measured(arm: SerialArm, problem: hpop.Problem, rng: np.random.Generator) -> dict[str, Any]:
    """States, clearances and motions in the world of a problem, and views of what is grasped."""
    world, target = problem.world, problem.criteria[2].target
    collision, drawn = arm.collision(world), arm.space.sample(rng, STATES)
    free = collision.states_free(drawn)
    row: dict[str, Any] = {
        "states_a_second": STATES / seconds(lambda: collision.states_free(drawn)),
        "states_free": float(free.mean()),
        "clearances_a_second": STATES / seconds(lambda: collision.clearance(drawn)),
    }
    start = drawn.take(np.flatnonzero(free)[::2])
    other = start.take(rng.permutation(start.size))
    for name, share in SHARES.items():
        ways = {n: getattr(other, n) - getattr(start, n) for n in start.names}
        end = States(**{n: getattr(start, n) + share * way for n, way in ways.items()})
        motions = Motions(world, arm, arm.laws["reach"], start, end)
        if name == "middling":
            row["occlusion_of_250000_motions_s"] = {rays: hidden(motions, target, rays) for rays in (37, 1)}
        row[f"motions_{name}"] = {
            "a_second": len(motions) / seconds(lambda motions=motions: collision.motions_free(motions)),  # type: ignore[misc]
            "free": float(collision.motions_free(motions).mean()),
            "median_duration_s": float(np.median(motions.duration)),
        }
    return row


def main() -> None:
    """Measure, print and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    arm, rng = mbm.panda(), np.random.default_rng(1)
    if arm is None:
        print(mbm.LACKING)
        return
    drawn = arm.space.sample(rng, POSES)
    report: dict[str, Any] = {f"poses_{POSES}_s": seconds(lambda: columns(arm, drawn))}
    report[f"goals_{GOALS}"] = goals(arm)
    for name in mbm.SETS:
        report[name] = measured(arm, mbm.problem(arm, name, 1), rng)
    print(json.dumps(report, indent=1))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
