"""Plan by a measured field: a survey of the Wi-Fi in a real office. Pass the YAML file of the map of pal_office.

python examples/11_wifi_survey.py ../shared/data/pal_office/map.yaml [survey.csv]
"""

import sys
from pathlib import Path

import numpy as np

import hpop
import hpop.errors
from hpop.view import save_pictures
from hpop.world import read_field

ACCESS_POINTS = [(8.0, 0.0), (-4.0, 6.5)]  # m
AREA = (-14.0, -12.0, 12.0, 8.0)  # m: the north of the office was not surveyed
AT_ONE_METRE, EXPONENT = -40.0, 3.0  # dBm, and the exponent of the path loss inside buildings


def survey(path: Path) -> None:
    """Write what a surveyor would measure each metre: log-distance path loss from the nearest access point.

    The strength at the distance d is -40 dBm - 10 * 3 * log10(d / 1 m).
    """
    x0, y0, x1, y1 = AREA
    x, y = map(np.ravel, np.meshgrid(np.arange(x0, x1 + 0.5), np.arange(y0, y1 + 0.5)))
    distance = np.min([np.hypot(x - ax, y - ay) for ax, ay in ACCESS_POINTS], axis=0)
    strength = AT_ONE_METRE - 10.0 * EXPONENT * np.log10(np.maximum(distance, 1.0))
    rows = np.column_stack([x, y, strength])
    np.savetxt(path, rows, delimiter=",", fmt="%.2f", header="x,y,wifi", comments="")


def main(map_file: Path, measured: Path | None = None, folder: Path = Path("out/11_wifi_survey")) -> hpop.Front:
    """Plan across the office by the time with weak Wi-Fi, turns and length."""
    folder.mkdir(parents=True, exist_ok=True)
    world = hpop.World.from_ros_map(map_file)
    if measured is None:
        survey(measured := folder / "wifi.csv")

    # The field: -85 dBm counts where nothing was measured. The note says how much of the free space that is.
    wifi = read_field(measured, name="wifi", unit="dBm", outside=-85.0)
    world = world.with_fields([wifi])
    print(wifi, *world.notes, sep="\n")

    # A second at -60 dBm costs nothing, a second at -75 dBm costs one second, in between in proportion.
    problem = hpop.Problem(
        world=world,
        model=hpop.DifferentialDrive(radius=0.3, camera_height=1.2),
        start=(6.0, -8.0, np.pi / 2),
        goal=(-10.0, 1.0, None),
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
    if len(sys.argv) not in (2, 3) or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    try:
        main(*map(Path, sys.argv[1:]))
    except hpop.errors.HpopError as error:
        sys.exit(f"error: {error}")
