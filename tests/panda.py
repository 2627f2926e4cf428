"""The Panda, and the problems of MotionBenchMaker that are set for it.

Its meshes and URDF are those of the wheel example-robot-data. The fingers are 40 mm out, as far as they go: the
requests say 65 mm, and 105 mm would put them into obstacles at some goals.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import pytest
import yaml

from hpop.models.serial_arm.model import SerialArm
from hpop.world import World

SETS = ("bookshelf_small", "table_pick")
NUMBERS = range(1, 21)  # of the problems in each
FINGERS = 0.04  # m
CAMERA = (0.06, 0.0, 0.05, 0.0, -1.5707963267948966, 0.0)  # beside the fingers, looking where they point


@cache
def panda(data: Path, fingers: float = FINGERS) -> SerialArm:
    """The arm with its camera beside the fingers; the test is skipped where its meshes are not installed."""
    try:
        files = importlib.metadata.files("example-robot-data") or ()
    except importlib.metadata.PackageNotFoundError:
        files = ()
    urdf = next((Path(str(f.locate())) for f in files if str(f).endswith("panda_description/urdf/panda.urdf")), None)
    if urdf is None:
        pytest.skip("the Panda's meshes are in the wheel example-robot-data, which is not installed")
    return SerialArm.from_urdf(
        urdf,
        tip="panda_hand",
        acceleration=5.0,
        srdf=data / "panda.srdf",
        packages={"example-robot-data": urdf.parents[3]},
        camera=CAMERA,
        fixed={"panda_finger_joint1": fingers, "panda_finger_joint2": fingers},
    )


def asked(data: Path, name: str, number: int) -> tuple[World, Mapping[str, float], Mapping[str, float]]:
    """World, start and goal of a problem by set and number."""
    folder = data / "problems" / f"{name}_panda"
    request = yaml.load((folder / f"request{number:04d}.yaml").read_text(), yaml.CSafeLoader)
    given = request["start_state"]["joint_state"]
    start = dict(zip(given["name"], given["position"], strict=True))
    goal = {one["joint_name"]: one["position"] for one in request["goal_constraints"][0]["joint_constraints"]}
    return World.from_moveit_scene(folder / f"scene{number:04d}.yaml"), {name: start[name] for name in goal}, goal
