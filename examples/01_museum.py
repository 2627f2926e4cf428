"""Plan a tour through a museum: every optimal trade-off between obstruction of the camera, turns and length.

The criteria are V, N and D of Becerra et al. 2020 (arXiv 2002.10696). V is the mean share of a ball of 2 m around the
camera that obstacles fill.
"""

from pathlib import Path

import hpop
from hpop.view import save_pictures

HERE = Path(__file__).parent


def main(folder: Path = Path("out/01_museum")) -> hpop.Front:
    """Plan the tour, choose from the front, and draw it."""
    # World: 30 x 20 m, rooms with exhibits of several heights, and a hallway with a narrow passage between two statues.
    world = hpop.World.from_geojson(HERE / "museum.geojson")

    # Criteria: names, or names with parameters such as {"exposure": {"radius": 1.5}}, or objects such as Rotation().
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(2.0, 10.0, 0.0),
        goal=(28.0, 10.0, 0.0),
        criteria=["obstruction", "turns", "length"],
    )

    # Plan: the whole Pareto front of a lattice, a grid of poses 0.25 m apart.
    front = problem.solve(planner="lattice", step=0.25)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")

    # Choose: a compromise, the trajectory nearest to a wish, and the shortest.
    for label, point in {
        "knee": front.knee(),
        "about 3 turns": front.nearest({"turns": 3}),
        "shortest": front.best("length"),
    }.items():
        costs = ", ".join(f"{name} {value:.2f}" for name, value in (point.costs | point.reported).items())
        print(f"{label}: {costs}")

    # Save the front, and draw the map, the front, and the costs along the path.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
