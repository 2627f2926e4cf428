"""MotionBenchMaker's problems for the Panda, and the arm: what the benchmarks of an arm ask about.

Its fingers are 40 mm out, as far as they go (the requests say 65), its meshes those of the wheel example-robot-data.
"""

from __future__ import annotations

import importlib.metadata
import os
from pathlib import Path
from typing import Any

import yaml

import hpop
from hpop.models.serial_arm.model import SerialArm

DATA = Path(os.environ.get("HPOP_DATA", Path(__file__).resolve().parents[2] / "shared" / "data")) / "mbm_panda"
SETS = ("bookshelf_small", "table_pick")
NUMBERS = range(1, 21)
CAMERA = (0.06, 0.0, 0.05, 0.0, -1.5707963267948966, 0.0)  # beside the fingers, looking where they point
LACKING = f"nothing is measured: it takes the wheel example-robot-data, and {DATA} (set HPOP_DATA)"


def panda() -> SerialArm | None:
    """The arm, if its files are there."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    urdf = next(Path(str(f.locate())) for f in files if str(f).endswith("panda_description/urdf/panda.urdf"))
    if not DATA.is_dir():
        return None
    return SerialArm.from_urdf(
        urdf,
        tip="panda_hand",
        acceleration=5.0,
        srdf=DATA / "panda.srdf",
        packages={"example-robot-data": urdf.parents[3]},
        camera=CAMERA,
        fixed={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04},
    )


def world(name: str, number: int) -> hpop.World:
    """The scene of a problem."""
    return hpop.World.from_moveit_scene(DATA / "problems" / f"{name}_panda" / f"scene{number:04d}.yaml")


def problem(arm: SerialArm, name: str, number: int, *more: Any) -> hpop.Problem:
    """To grasp soon, without turning the view, in sight of what is grasped; and more criteria."""
    request = yaml.load(
        (DATA / "problems" / f"{name}_panda" / f"request{number:04d}.yaml").read_text(), yaml.CSafeLoader
    )
    given = request["start_state"]["joint_state"]
    start = dict(zip(given["name"], given["position"], strict=True))
    goal = {one["joint_name"]: one["position"] for one in request["goal_constraints"][0]["joint_constraints"]}
    tool = arm.pose("tool", arm.space.state(goal))
    target = [float(place[0]) for place in (tool.x, tool.y, tool.z)]
    criteria = ["duration", "rotation", {"look_at": {"target": target}}, *more]
    return hpop.Problem(world(name, number), arm, {joint: start[joint] for joint in goal}, goal, criteria)
