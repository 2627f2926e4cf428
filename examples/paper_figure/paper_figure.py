"""Plan the paper's example (Becerra et al. 2020): from V = 0 with N = 8 to the shortest path with N = 0.

Three walls with a narrow slit each stand between start and goal, which both head along +x. The straight path through
the slits is shortest and needs no turn, but the camera comes close to the walls. The path round all three walls takes
eight turns, but no obstacle comes into the ball of 2 m around the camera. The paper's own map is not published, so this
map only has its structure. Floor and ceiling are no obstacles.
"""

from pathlib import Path

import shapely

import hpop
from hpop.view import save_pictures

SLIT = (9.5, 10.5)  # y of the slits, m
LENGTHS = {6.5: (1.5, 14.0), 11.75: (6.0, 18.5), 17.0: (1.5, 14.0)}  # x of each wall: the y it spans, m


def museum() -> hpop.World:
    """Return a closed room of 20.75 x 17 m in which each way round a wall has at least 2.25 m on both sides."""
    inner, outer = shapely.box(1.5, 1.5, 22.25, 18.5), shapely.box(1.25, 1.25, 22.5, 18.75)
    walls = [shapely.difference(outer, inner)]
    for x, (low, high) in LENGTHS.items():
        walls += [shapely.box(x, low, x + 0.25, SLIT[0]), shapely.box(x, SLIT[1], x + 0.25, high)]
    return hpop.World.from_polygons(walls)


def main(folder: Path = Path("out/paper_figure")) -> hpop.Front:
    """Plan, print the three kinds of optimal trajectories, and draw them."""
    problem = hpop.Problem(
        world=museum(),
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(4.0, 10.0, 0.0),
        goal=(19.75, 10.0, 0.0),
        criteria=["obstruction", "turns", "length"],
    )
    front = problem.solve(planner="lattice", step=0.25)

    for label, point in {
        "s1, nothing near the camera": front.lexicographic(["exposure", "turns"]),
        "s2, between": front.knee(),
        "s3, no turn and shortest": front.best("turns"),
    }.items():
        v, n, d = point.reported["obstruction"], point.costs["turns"], point.costs["length"]
        print(f"{label}: V = {v:.4f}, N = {n:.0f}, D = {d:.2f} m")
    print(f"{len(front)} optimal trajectories; {front.certificate}")
    folder.mkdir(parents=True, exist_ok=True)
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    main()
