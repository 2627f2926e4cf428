"""A telepresence robot tours a museum: every optimal trade-off between camera obstruction, turns and length.

The criteria are those of Becerra et al. 2020 (arXiv 2002.10696): V, N and D, with a ball of 2 m round the camera.
"""

from pathlib import Path

import hpop
from hpop.view import save_pictures

HERE = Path(__file__).parent


def main(folder: Path = Path("out/01_museum")) -> hpop.Front:
    """Plan, choose, look."""
    # World: 30 x 20 m, rooms with exhibits of several heights, and a hallway that two statues make narrow.
    world = hpop.World.from_geojson(HERE / "museum.geojson")

    # Criteria: the paper's three. Rotation() or {"exposure": {"radius": 1.5}} would do as well as a name.
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(2.0, 10.0, 0.0),
        goal=(28.0, 10.0, 0.0),
        criteria=["obstruction", "turns", "length"],
    )

    # Plan: the whole Pareto front of an SE(2) lattice, exactly.
    front = problem.solve(planner="lattice", step=0.25)
    print(f"{len(front)} optimal trajectories ({front.status}); {front.certificate}")

    # Choose: a compromise, or what a user asks for at run time.
    for label, point in {
        "knee": front.knee(),
        "about 3 turns": front.nearest({"turns": 3}),
        "shortest": front.best("length"),
    }.items():
        costs = ", ".join(f"{name} {value:.2f}" for name, value in (point.costs | point.reported).items())
        print(f"{label}: {costs}")

    # Look: the map, the front, and what happens along the way.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
