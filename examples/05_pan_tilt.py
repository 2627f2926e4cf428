"""Plan a museum tour with a camera on a pan-tilt head: view of the exhibits, rotation, looking ahead, and length.

While the base turns, the head may turn back by the same angle, so that the view stays still and viewers feel better
(Suomalainen et al., HRI 2022). But then the viewer does not look where the robot drives. The front trades off both.
"""

from math import radians
from pathlib import Path

import hpop
from hpop.view import save_pictures
from hpop.world.content import Landmark

HERE = Path(__file__).parent
PAINTINGS = [Landmark(x, 8.1, z=1.6, facing=radians(90)) for x in (8, 10, 12, 17, 19, 21)]  # on the hallway's wall
EXHIBITS = [Landmark(22.0, 19.6, z=1.6, facing=radians(-90)), Landmark(25.1, 18.05, z=1.6, name="model ship")]


def main(folder: Path = Path("out/05_pan_tilt"), step: float = 0.5) -> hpop.Front:
    """Plan the tour, print the best trajectory in each cost, and draw the front."""
    # World: the museum of example 01 with landmarks, which are points worth seeing.
    world = hpop.World.from_geojson(HERE / "museum.geojson").with_content(landmarks=[*PAINTINGS, *EXHIBITS])

    # Robot: it drives as slowly as visitors walk. Its camera sees 110 degrees, and a cable limits the pan.
    head = hpop.PanTilt(
        hpop.DifferentialDrive(radius=0.3, camera_height=1.2, speed=0.5, acceleration=0.5),
        pan=(radians(-170), radians(170)),
        tilt=(radians(-30), radians(30)),
        field_of_view=(radians(110), radians(70)),
    )

    # Criteria: landmark_visibility is a mean over time, so the search minimises its sum, landmark_blindness.
    problem = hpop.Problem(
        world=world,
        model=head,
        start={"x": 2.0, "y": 10.0, "yaw": 0.0, "pan": 0.0, "tilt": 0.0},
        goal={"x": 28.0, "y": 17.0, "yaw": 0.0, "pan": None, "tilt": None},
        criteria=["landmark_visibility", "rotation", "heading_mismatch", "length"],
    )

    # Plan for half a minute. At each position of the lattice the base has 8 headings, the head 7 pans and 3 tilts.
    front = problem.solve(planner="lattice", step=step)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")

    # Choose: the best view of the exhibits, the least rotation, and the best view ahead; count the head's motions.
    for name in ("landmark_blindness", "rotation", "heading_mismatch"):
        best = front.best(name)
        costs = ", ".join(f"{cost} {value:.2f}" for cost, value in (best.costs | best.reported).items())
        kinds = {kind: best.item.kinds.count(kind) for kind in ("turn", "unwind", "pan", "tilt")}
        print(f"least {name}: {costs}; " + ", ".join(f"{number} {kind}" for kind, number in kinds.items() if number))

    # Save and draw the front. Wedges on the map show where the camera looks.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
