"""Plan by a measured field: a survey of the Wi-Fi in a building. Pass a map of map_server, start and goal, in m.

python examples/11_wifi_survey.py examples/notebooks/floor.yaml 1.2 -3 12.6 2.3 [survey.csv]
"""

import sys
from pathlib import Path

import numpy as np

import hpop
import hpop.errors
from hpop.view import save_pictures
from hpop.world import read_field

ACCESS_POINTS = [(0.2, 0.2), (0.85, 0.52)]  # shares of the map's width and height
SURVEYED = 0.86  # of the map's height: the north was not surveyed
AT_ONE_METRE, EXPONENT = -40.0, 3.0  # dBm, and the exponent of the path loss inside buildings


def survey(path: Path, bounds: tuple[float, float, float, float]) -> None:
    """Write what a surveyor would measure each metre: log-distance path loss from the nearest access point.

    The strength at the distance d is -40 dBm - 10 * 3 * log10(d / 1 m).
    """
    x0, y0, x1, y1 = bounds
    x, y = map(np.ravel, np.meshgrid(np.arange(x0, x1 + 0.5), np.arange(y0, y0 + SURVEYED * (y1 - y0) + 0.5)))
    places = [(x0 + ax * (x1 - x0), y0 + ay * (y1 - y0)) for ax, ay in ACCESS_POINTS]
    distance = np.min([np.hypot(x - ax, y - ay) for ax, ay in places], axis=0)
    strength = AT_ONE_METRE - 10.0 * EXPONENT * np.log10(np.maximum(distance, 1.0))
    rows = np.column_stack([x, y, strength])
    np.savetxt(path, rows, delimiter=",", fmt="%.2f", header="x,y,wifi", comments="")


def main(
    map_file: Path,
    start: tuple[float, float],
    goal: tuple[float, float],
    measured: Path | None = None,
    folder: Path = Path("out/11_wifi_survey"),
) -> hpop.Front:
    """Plan across the building by the time with weak Wi-Fi, turns and length."""
    folder.mkdir(parents=True, exist_ok=True)
    world = hpop.World.from_ros_map(map_file)
    if measured is None:
        survey(measured := folder / "wifi.csv", world.ground.extent.bounds)

    # The field: -85 dBm counts where nothing was measured. The note says how much of the free space that is.
    wifi = read_field(measured, name="wifi", unit="dBm", outside=-85.0)
    world = world.with_fields([wifi])
    print(wifi, *world.notes, sep="\n")

    # A second at -60 dBm costs nothing, a second at -75 dBm costs one second, in between in proportion.
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(*start, 0.0),
        goal=(*goal, None),
        criteria=[{"field_exposure": {"good": -60.0, "bad": -75.0}}, "turns", "length"],
    )
    front = problem.solve(planner="lattice", step=0.25, time_limit=60.0)
    print(f"{len(front)} optimal trajectories ({front.status})")
    print("least time with weak Wi-Fi:", front.costs[np.argmin(front.costs[:, 0])])
    print("shortest:                  ", front.costs[np.argmin(front.costs[:, 2])])
    front.save(folder / "front.json")
    save_pictures(problem, front, folder)
    return front


if __name__ == "__main__":
    if len(sys.argv) not in (6, 7):
        sys.exit(__doc__)
    try:
        x, y, goal_x, goal_y = map(float, sys.argv[2:6])
    except ValueError as error:
        sys.exit(f"error: {error}; expected numbers as start and goal\n{__doc__}")
    try:
        main(Path(sys.argv[1]), (x, y), (goal_x, goal_y), *map(Path, sys.argv[6:]))
    except hpop.errors.HpopError as error:
        sys.exit(f"error: {error}")
