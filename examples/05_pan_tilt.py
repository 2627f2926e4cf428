"""A museum tour with a camera on a pan-tilt head: what is seen, rotation, looking where one drives, and length.

While the base turns, the head may turn back by the same angle, so that the view stays still: users feel better
(Suomalainen et al., HRI 2022). What that spares in rotation it costs in looking where one drives; the front has both.
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
    """Plan, choose, look."""
    # World: the museum of example 01, with what is worth seeing.
    world = hpop.World.from_geojson(HERE / "museum.geojson").with_content(landmarks=[*PAINTINGS, *EXHIBITS])

    # Robot: at the pace of a visitor, with a camera that sees 110 degrees; a cable stops the head at both sides.
    head = hpop.PanTilt(
        hpop.DifferentialDrive(radius=0.3, camera_height=1.2, speed=0.5, acceleration=0.5),
        pan=(radians(-170), radians(170)),
        tilt=(radians(-30), radians(30)),
        field_of_view=(radians(110), radians(70)),
    )

    # Criteria: the mean share of the exhibits that is not seen is represented on the lattice by its integral over time.
    problem = hpop.Problem(
        world=world,
        model=head,
        start={"x": 2.0, "y": 10.0, "yaw": 0.0, "pan": 0.0, "tilt": 0.0},
        goal={"x": 28.0, "y": 17.0, "yaw": 0.0, "pan": None, "tilt": None},
        criteria=["landmark_visibility", "rotation", "heading_mismatch", "length"],
    )

    # Plan: at each position of the lattice the base has 8 headings, and the head 7 pans and 3 tilts. Half a minute.
    front = problem.solve(planner="lattice", step=step)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")

    # Choose: who sees most, who turns least, who looks where she drives; and how often the head turns back.
    for name in ("landmark_blindness", "rotation", "heading_mismatch"):
        best = front.best(name)
        costs = ", ".join(f"{cost} {value:.2f}" for cost, value in (best.costs | best.reported).items())
        kinds = {kind: best.item.kinds.count(kind) for kind in ("turn", "unwind", "pan", "tilt")}
        print(f"least {name}: {costs}; " + ", ".join(f"{number} {kind}" for kind, number in kinds.items() if number))

    # Look: wedges on the map show where the camera looks.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
