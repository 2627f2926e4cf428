"""Watch one arm at its work with the camera in the hand of another: in view, unhidden, with little rotation.

The working arm fetches a can from behind a divider. Its motion is known; the viewing arm is planned against it in time.
"""

from math import radians
from pathlib import Path

import hpop
from hpop.goals import Anywhere
from hpop.models import SerialArm
from hpop.view import save_pictures
from hpop.world import Box, Cylinder, Solid, World, pose_at

HERE = Path(__file__).parent
CAN = (0.6, 0.0, 0.0575)


def arm(base: tuple[float, float, float, float, float, float], speed: float) -> SerialArm:
    """Return an arm of six joints, with a camera beside its fingers, that uses a share of its top speeds."""
    return SerialArm.from_urdf(
        HERE / "arm/arm6.urdf",
        srdf=HERE / "arm/arm6.srdf",
        tip="tool",
        camera=(-0.06, 0.0, -0.08, 0.0, radians(-90), 0.0),
        field_of_view=(radians(60), radians(45)),
        acceleration=6.0,
        base=base,
        velocity_scaling=speed,
    )


def main(folder: Path = Path("out/06_two_arms"), samples: int = 100) -> hpop.Front:
    """Plan the working arm, then the viewing arm, and draw the viewing arm's front."""
    world = World.from_solids(
        [
            Solid(Box((1.2, 2.0, 0.04)), pose_at((0.3, 0.4, -0.02)), "table"),
            Solid(Box((0.02, 0.3, 0.25)), pose_at((0.45, 0.2, 0.125)), "divider"),
            Solid(Cylinder(0.033, 0.115), pose_at(CAN), "can"),
        ]
    )

    # The working arm: the quickest of its plans is its motion. A CSV file of a controller would do as well.
    worker = arm((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), speed=0.25)
    above = {"tool_at": {"position": (CAN[0], CAN[1], 0.2), "direction": (0.0, 0.0, -1.0)}}
    work = hpop.Problem(world, worker, "home", above, ["duration", "rotation"]).solve("roadmap", samples=100)

    # The viewing arm stands beside it. It may end in any state, when the working arm is done.
    viewer = arm((0.1, 0.8, 0.0, 0.0, 0.0, radians(-45)), speed=0.5)
    arms = hpop.TwoArms(work=work.best("duration").trajectory, view=viewer, step=0.2)
    tool = {"target": "work_tool"}
    problem = hpop.Problem(
        world=world,
        model=arms,
        start="home",
        goal=Anywhere(),
        criteria=[{"look_at": tool}, "rotation", {"occlusion": {**tool, "rays": 7}}],
    )
    front = problem.solve("roadmap", samples=samples, eps=0.05)
    print(f"{len(front)} plans ({front.status}); {front.certificate}")

    # Choose: the plan that keeps the tool in the middle of its view, the one that stays, and the knee.
    for name in ("least look_at", "least rotation", "knee"):
        point = front.named()[name]
        print(f"{name}: " + ", ".join(f"{cost} {value:.2f}" for cost, value in point.costs.items()))
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
