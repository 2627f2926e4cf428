"""Benchmark of an arm's geometry: poses, states, clearances and certified motions a second of one core.

``python benchmarks/arm.py --out out/bench/arm.json``

The Panda among the seven solids of MotionBenchMaker's first bookshelf and the twelve of its first table, its fingers 40
mm out, with the meshes of the wheel example-robot-data; without these there is nothing to measure. Motions lead from
free states to others: a share of the way to one that is drawn as well. Seconds are of the processor, kernels loaded.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import hpop
from hpop.models.serial_arm.model import SerialArm
from hpop.motions import Motions, States

ROOT = Path(__file__).parents[1]
POSES = 100_000
STATES = 20_000
SHARES = {"far": 1.0, "middling": 0.3, "near": 0.1}
SCENES = ("bookshelf_small", "table_pick")


def panda(data: Path) -> SerialArm | None:
    """The arm, if its files are there."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    urdf = next(Path(str(f.locate())) for f in files if str(f).endswith("panda_description/urdf/panda.urdf"))
    return SerialArm.from_urdf(
        urdf,
        tip="panda_hand",
        acceleration=5.0,
        srdf=data / "panda.srdf",
        packages={"example-robot-data": urdf.parents[3]},
        fixed={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04},
    )


def seconds(work: Callable[[], object]) -> float:
    """Of the processor, the least of three runs after one that loads what is needed."""
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


def measured(arm: SerialArm, world: hpop.World, rng: np.random.Generator) -> dict[str, Any]:
    """States, clearances and motions in one world."""
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
        row[f"motions_{name}"] = {
            "a_second": len(motions) / seconds(lambda motions=motions: collision.motions_free(motions)),  # type: ignore[misc]
            "free": float(collision.motions_free(motions).mean()),
            "median_duration_s": float(np.median(motions.duration)),
        }
    return row


def main() -> None:
    """Measure, print and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    arguments = parser.parse_args()
    data, rng = arguments.data / "mbm_panda", np.random.default_rng(1)
    arm = panda(data) if data.is_dir() else None
    if arm is None:
        print(f"nothing is measured: it takes the wheel example-robot-data, and {data}")
        return
    drawn = arm.space.sample(rng, POSES)
    report: dict[str, Any] = {f"poses_{POSES}_s": seconds(lambda: columns(arm, drawn))}
    for name in SCENES:
        world = hpop.World.from_moveit_scene(data / "problems" / f"{name}_panda" / "scene0001.yaml")
        report[name] = measured(arm, world, rng)
    print(json.dumps(report, indent=1))
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps(report, indent=1) + "\n")


if __name__ == "__main__":
    main()
