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
NUMBERS = range(1, 21)  # of the problems in each
FINGERS = 0.04  # m
CAMERA = (0.06, 0.0, 0.05, 0.0, -1.5707963267948966, 0.0)  # beside the fingers, looking where they point
LACKING = f"nothing is measured: it takes the wheel example-robot-data, and {DATA} (set HPOP_DATA)"


def panda(data: Path = DATA, fingers: float = FINGERS) -> SerialArm | None:
    """Return the arm with its fingers opened by ``fingers`` m, if its files exist."""
    try:
        files = importlib.metadata.files("example-robot-data") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    urdf = next((Path(str(f.locate())) for f in files if str(f).endswith("panda_description/urdf/panda.urdf")), None)
    if urdf is None or not data.is_dir():
        return None
    return SerialArm.from_urdf(
        urdf,
        tip="panda_hand",
        acceleration=5.0,
        srdf=data / "panda.srdf",
        packages={"example-robot-data": urdf.parents[3]},
        camera=CAMERA,
        fixed={"panda_finger_joint1": fingers, "panda_finger_joint2": fingers},
    )


def asked(name: str, number: int, data: Path = DATA) -> tuple[hpop.World, dict[str, float], dict[str, float]]:
    """World, start and goal of a problem by set and number."""
    folder = data / "problems" / f"{name}_panda"
    request = yaml.load((folder / f"request{number:04d}.yaml").read_text(), yaml.CSafeLoader)
    given = request["start_state"]["joint_state"]
    start = dict(zip(given["name"], given["position"], strict=True))
    goal = {one["joint_name"]: one["position"] for one in request["goal_constraints"][0]["joint_constraints"]}
    world = hpop.World.from_moveit_scene(folder / f"scene{number:04d}.yaml")
    return world, {joint: start[joint] for joint in goal}, goal


def problem(arm: SerialArm, name: str, number: int, *more: Any) -> hpop.Problem:
    """To grasp soon, without turning the view, in sight of what is grasped; and more criteria."""
    world, start, goal = asked(name, number)
    tool = arm.pose("tool", arm.space.state(goal))
    target = [float(place[0]) for place in (tool.x, tool.y, tool.z)]
    return hpop.Problem(world, arm, start, goal, ["duration", "rotation", {"look_at": {"target": target}}, *more])
