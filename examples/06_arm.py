"""Inspect three cans with a camera in the hand of an arm: quickly, with little rotation, away from the shelf.

The cans are the stops of a tour, in any order: each tour on the front has its own.
"""

from dataclasses import replace
from math import radians
from pathlib import Path

import hpop
from hpop.criteria import Rotation, trajectory_cost
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


def main(folder: Path = Path("out/06_arm"), samples: int = 300) -> hpop.Front:
    """Plan tours from home past the cans and back, and draw their front."""
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

    # Stops: any state in which the camera sees the can upright, from 0.15 to 0.3 m away. It looks for two seconds.
    stops = [
        {"look_at": {"target": place, "distance": (0.15, 0.3), "roll": 0.0}, "dwell": 2.0, "name": f"can {name}"}
        for name, place in CANS.items()
    ]
    home = arm.space.named["home"]
    problem = hpop.Problem(
        world=world,
        model=arm,
        start=home,
        goal=home,
        criteria=["duration", "rotation", {"clearance": {"enough": 0.1}}],  # a cost below 0.1 m
        tour=hpop.Tour(stops, order="any"),
    )

    # Plan: the exact front on a random roadmap, over all orders of the cans and all states at each can.
    front = problem.solve(planner="roadmap", samples=samples)
    print(f"{len(front)} tours ({front.status}); {front.certificate}")

    # Choose: the fastest tour, and the knee. Each has its own order.
    for name in ("least duration", "knee"):
        point = front.named()[name]
        order = " -> ".join(visit["stop"] for visit in front.provenance[point.index]["visits"])
        print(f"{name}: {order}; " + ", ".join(f"{cost} {value:.2f}" for cost, value in point.costs.items()))

    # View: software turns the pictures of a 360-degree camera back, so that the viewer's view never rotates.
    fastest = front.named()["least duration"].trajectory
    unwound = replace(fastest, model=hpop.ViewModel(arm, "unwound"))
    turned = [trajectory_cost(Rotation(), each, world) for each in (fastest, unwound)]
    print(f"rotation of the fastest tour: {turned[0]:.2f} rad, with an unwound view {turned[1]:.2f} rad")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
