"""Inspect three cans with a camera in the hand of an arm: quickly, with little rotation, looking at the can.

Each can has its own front, from which the knee is chosen. The next plan begins where this trajectory ends.
"""

from math import radians
from pathlib import Path

import hpop
from hpop.goals import LookAt
from hpop.models import SerialArm
from hpop.view import save_pictures
from hpop.world import Box, Cylinder, Solid, pose_at

HERE = Path(__file__).parent
BOARDS = {
    "table": ((1.0, 1.4, 0.04), (0.2, 0.0, -0.02)),
    "shelf bottom": ((0.3, 1.0, 0.02), (0.65, 0.0, 0.01)),
    "shelf middle": ((0.3, 1.0, 0.02), (0.65, 0.0, 0.36)),
    "shelf top": ((0.3, 1.0, 0.02), (0.65, 0.0, 0.71)),
    "shelf back": ((0.02, 1.0, 0.72), (0.81, 0.0, 0.36)),
    "left side": ((0.3, 0.02, 0.72), (0.65, 0.51, 0.36)),
    "right side": ((0.3, 0.02, 0.72), (0.65, -0.51, 0.36)),
    "divider": ((0.3, 0.02, 0.33), (0.65, 0.05, 0.535)),
}
CANS = {"below": (0.66, -0.2, 0.0785), "left": (0.7, 0.25, 0.4285), "right": (0.7, -0.25, 0.4285)}


def main(folder: Path = Path("out/06_arm"), samples: int = 300) -> list[hpop.Front]:
    """Plan from can to can, choose the knee, and draw each front."""
    # World: a shelf on a table, made of boxes and cylinders, which are placed by their centres.
    boards = [Solid(Box(size), pose_at(place), name) for name, (size, place) in BOARDS.items()]
    cans = [Solid(Cylinder(0.033, 0.115), pose_at(place), f"can {name}") for name, place in CANS.items()]
    world = hpop.World.from_solids([*boards, *cans])

    # Robot: six joints from a URDF; the camera is beside the fingers.
    arm = SerialArm.from_urdf(
        HERE / "arm/arm6.urdf",
        srdf=HERE / "arm/arm6.srdf",
        tip="tool",
        camera=(-0.06, 0.0, -0.08, 0.0, radians(-90), 0.0),
        field_of_view=(radians(60), radians(45)),
        acceleration=6.0,
    )

    start, fronts = arm.space.named["home"], []
    for name, place in CANS.items():
        # Goal: any state in which the camera sees the can upright, from 0.15 to 0.3 m away.
        problem = hpop.Problem(
            world=world,
            model=arm,
            start=start,
            goal=LookAt(place, distance=(0.15, 0.3), roll=0.0),
            criteria=["duration", "rotation", {"look_at": {"target": place}}],
        )

        # Plan: collision-free paths on a random roadmap, then splines that are no worse than these paths.
        front = problem.solve(planner="spline", warm_start={"roadmap": {"samples": samples}})
        print(f"can {name}: {len(front)} trajectories ({front.status}); {front.certificate}")

        # Choose: the knee. The next plan begins at its end.
        knee = front.knee()
        print(", ".join(f"{cost} {value:.2f}" for cost, value in knee.costs.items()))
        save_pictures(problem, front, folder / name)
        start = arm.space.values(knee.item.states.take([-1]))
        fronts.append(front)
    return fronts


if __name__ == "__main__":
    main()
