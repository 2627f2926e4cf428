"""Plan for a Panda that reaches into a bookshelf: quickly, with little rotation of the view, looking at the can.

The problem is one of MotionBenchMaker. You need panda.srdf and the unpacked problems.tar.bz2 from kavrakilab/vamp,
resources/panda, and the meshes of the arm: `pip install example-robot-data trimesh`. HPOP_DATA names the folder that
contains mbm_panda.
"""

import importlib.metadata
import os
import sys
from contextlib import suppress
from math import dist, radians
from pathlib import Path
from typing import Any

import yaml

import hpop
import hpop.errors
from hpop.models import SerialArm
from hpop.view import save_pictures

DATA = Path(os.environ.get("HPOP_DATA", Path(__file__).parents[2] / "shared/data")) / "mbm_panda"
PLANNER = {"spline": {"warm_start": {"roadmap": {"samples": 2000}}}}


def panda_urdf() -> Path:
    """Return the Panda's URDF, which comes with its meshes; FileNotFoundError if the package is not installed."""
    with suppress(importlib.metadata.PackageNotFoundError):
        for file in importlib.metadata.files("example-robot-data") or []:
            if file.match("panda_description/urdf/panda.urdf"):
                return Path(str(file.locate())).resolve()
    raise FileNotFoundError("no meshes of the Panda: pip install example-robot-data trimesh")


def main(folder: Path = Path("out/06_panda"), number: int = 1, planner: Any = PLANNER) -> hpop.Front:
    """Plan and draw the front."""
    # World: the boards and cans of a MoveIt scene. The start and the goal come from its request.
    problems = DATA / "problems/bookshelf_small_panda"
    if not problems.is_dir():
        raise FileNotFoundError(f"no folder {problems}; set HPOP_DATA to the folder that has mbm_panda in it")
    world = hpop.World.from_moveit_scene(problems / f"scene{number:04d}.yaml")
    asked = yaml.safe_load((problems / f"request{number:04d}.yaml").read_text())
    joints = asked["start_state"]["joint_state"]
    goal = {joint["joint_name"]: joint["position"] for joint in asked["goal_constraints"][0]["joint_constraints"]}
    start = {name: at for name, at in zip(joints["name"], joints["position"], strict=True) if name in goal}

    # Robot: the fingers are fully open, and the camera is beside them. A URDF has no accelerations, so they are given.
    urdf = panda_urdf()
    arm = SerialArm.from_urdf(
        urdf,
        srdf=DATA / "panda.srdf",
        packages={"example-robot-data": urdf.parents[3]},
        tip="panda_hand",
        acceleration=5.0,
        camera=(0.06, 0.0, 0.05, 0.0, radians(-90), 0.0),
        fixed={"panda_finger_joint1": 0.04, "panda_finger_joint2": 0.04},
    )

    # Criteria: the camera should look at the can that is nearest to the goal of the hand.
    hand = arm.pose("tool", arm.space.state(goal))
    cans = [tuple(solid.pose[:3, 3]) for solid in world.ground.solids if solid.name.startswith("Can")]
    target = min(cans, key=lambda can: dist(can, (hand.x[0], hand.y[0], hand.z[0])))
    problem = hpop.Problem(world, arm, start, goal, ["duration", "rotation", {"look_at": {"target": target}}])

    # Plan: collision-free paths on a random roadmap, then splines that are no worse than these paths.
    front = problem.solve(planner)
    print(f"{len(front)} trajectories ({front.status}); {front.certificate}")

    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    try:
        main()
    except (hpop.errors.HpopError, FileNotFoundError) as error:
        sys.exit(f"error: {error}")
