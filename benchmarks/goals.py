"""Inverse kinematics: processor seconds for 1,000 states of each kind of goal, on the Panda of MotionBenchMaker.

    python benchmarks/goals.py [--count 1000]

Needs the public data (set HPOP_DATA to where they are): mbm_panda/panda_spherized.urdf, whose joints are the Panda's.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path

import numpy as np
import shapely

import hpop
from hpop.goals import CameraAt, Goal, LookAt, ToolAt
from hpop.models.serial_arm import SerialArm

ROOT = Path(__file__).resolve().parents[1]
DATA = Path(os.environ.get("HPOP_DATA", ROOT.parent / "shared" / "data"))
GOALS: list[Goal] = [
    LookAt((0.6, 0.0, 0.3), (0.2, 0.4)),
    LookAt((0.6, 0.0, 0.3), (0.2, 0.4), roll=0.0),
    CameraAt((0.4, 0.2, 0.5), yaw_pitch_roll=(0.0, -1.57, 0.0)),
    ToolAt((0.4, 0.2, 0.5), direction=(0.0, 0.0, -1.0)),
    ToolAt((0.4, 0.2, 0.5)),
]


def main() -> None:
    """Print a line for each goal."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    count = parser.parse_args().count
    urdf = DATA / "mbm_panda" / "panda_spherized.urdf"
    if not urdf.is_file():
        raise SystemExit(f"no file {urdf}; set HPOP_DATA to where the public data are")
    arm = SerialArm.from_urdf(urdf, tip="panda_hand", acceleration=7.5)
    world = hpop.World.from_polygons([], extent=shapely.box(-2, -2, 2, 2))
    for goal in GOALS:
        problem = hpop.Problem(world, arm, [0, -0.5, 0, -2, 0, 1.5, 0.7], goal, ["duration"])
        problem.target.states(problem, np.random.default_rng(0), 10)  # imports
        begun = time.process_time()
        states = problem.target.states(problem, np.random.default_rng(1), count)
        print(f"{time.process_time() - begun:6.2f} s  {states.size:,} of {count:,} states: {goal}")


if __name__ == "__main__":
    main()
