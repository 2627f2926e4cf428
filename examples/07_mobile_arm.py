"""Plan for an arm on a mobile base, whose camera shall look at the can behind the divider of a shelf.

The arm is folded while the base drives, and the base stands while the arm moves. A table is in the way. The quickest
trajectory, the one that rotates the view least and the one that sees the can soonest pass it on different sides and end
at different places.
"""

from math import pi, radians
from pathlib import Path

import shapely

import hpop
from hpop.goals import LookAt
from hpop.view import save_pictures
from hpop.world import Box, Cylinder, Solid, pose_at

HERE = Path(__file__).parent
BEHIND_THE_DIVIDER = (4.75, 2.5, 0.82)
BOXES = {  # name: size and centre, m
    "table": ((1.3, 0.8, 0.04), (2.4, 2.35, 0.73)),
    **{f"leg {x}, {y}": ((0.06, 0.06, 0.71), (x, y, 0.355)) for x in (1.8, 3.0) for y in (2.0, 2.7)},
    "crate": ((0.5, 0.5, 0.9), (2.6, 0.55, 0.45)),
    **{f"shelf {z}": ((0.3, 1.4, 0.02), (4.7, 2.2, z)) for z in (0.3, 0.75, 1.2)},
    "back": ((0.02, 1.4, 1.2), (4.86, 2.2, 0.61)),
    **{f"side {y}": ((0.3, 0.02, 1.21), (4.7, y, 0.605)) for y in (2.91, 1.49)},
    "divider": ((0.3, 0.02, 0.42), (4.7, 2.2, 0.97)),
}
CANS = {"left": (4.75, 2.5, 0.818), "right": (4.75, 1.9, 0.818)}


def main(folder: Path = Path("out/07_mobile_arm"), samples: int = 800) -> hpop.Front:
    """Plan, print the best trajectory in each cost, and draw the front."""
    # World: a room of 5 x 4 m with a table and a shelf.
    solids = [Solid(Box(size), pose_at(centre), name) for name, (size, centre) in BOXES.items()]
    solids += [Solid(Cylinder(0.033, 0.115), pose_at(centre), f"can {name}") for name, centre in CANS.items()]
    room = [(0, 0), (5, 0), (5, 4), (0, 4)]
    world = hpop.World.from_solids(solids, extent=shapely.Polygon(room))

    # Robot: the arm stands 0.4 m above the floor, on a round base.
    arm = hpop.SerialArm.from_urdf(
        HERE / "arm/arm6.urdf",
        srdf=HERE / "arm/arm6.srdf",
        tip="tool",
        base=(0, 0, 0.4, 0, 0, 0),
        camera=(-0.06, 0, -0.08, 0, -pi / 2, 0),  # beside the fingers
        field_of_view=(radians(60), radians(45)),
        acceleration=6.0,
    )
    base = hpop.DifferentialDrive(radius=0.25, body_height=0.4, speed=0.5, acceleration=0.5)
    robot = hpop.MobileArm(arm, base, folded="home")

    # Criteria: the duration, the rotation of the view, and the angle between the view and the can over time.
    problem = hpop.Problem(
        world=world,
        model=robot,
        start=(0.6, 2.2, 0.0, *arm.space.named["home"]),
        goal=LookAt(BEHIND_THE_DIVIDER, distance=(0.2, 0.4), roll=0.0),
        criteria=["duration", "rotation", {"look_at": {"target": BEHIND_THE_DIVIDER}}],
    )

    # Plan for ten seconds: the exact front of a random roadmap.
    front = problem.solve(planner="roadmap", samples=samples)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")

    # Choose: the quickest, the least rotation of the view, and the soonest view of the can.
    for name in front.names:
        best = front.best(name)
        costs = ", ".join(f"{cost} {value:.2f}" for cost, value in best.costs.items())
        print(f"least {name}: {costs}; {best.item.kinds.count('run')} drives, {best.item.kinds.count('reach')} reaches")

    # Save the front, and draw the map, the view from the side, and the joints over time.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
