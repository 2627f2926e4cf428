"""Plan on a ROS map of a real building. Pass the YAML file of the map, and x and y of start and goal in metres.

python examples/02_ros_map.py map.yaml 2.0 3.0 21.0 9.0
"""

import sys
from pathlib import Path

import hpop
import hpop.errors
from hpop.view import save_pictures


def main(
    map_file: Path,
    start: tuple[float, float],
    goal: tuple[float, float],
    folder: Path = Path("out/02_ros_map"),
) -> hpop.Front:
    """Plan from a pose that heads along +x to a position with any heading."""
    # World: unknown cells count as obstacles. Add keep_out="mask.yaml" if you have a keep-out mask.
    world = hpop.World.from_ros_map(map_file)

    # Criteria: with the duration among them, every trajectory found is also optimal for the mean obstruction.
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(radius=0.25, camera_height=1.2),
        start=(*start, 0.0),
        goal=(*goal, None),
        criteria=["obstruction", "turns", "duration"],
    )

    # Plan: stop after a minute at the latest. The status says whether the front is complete.
    front = problem.solve(planner="lattice", step=0.25, time_limit=60.0)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")
    for note in front.notes:
        print(f"note: {note}")

    # Save and draw the front.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    x0, y0, x1, y1 = map(float, sys.argv[2:])
    try:
        main(Path(sys.argv[1]), (x0, y0), (x1, y1))
    except hpop.errors.HpopError as error:
        sys.exit(f"error: {error}")
