"""Plan a guided tour of a museum: the search decides which exhibits to see, in which order, and how fast to drive.

Four exhibits are to be seen, each for ten seconds. Two of them may be skipped. The front has a tour for each optimal
trade-off between time, calm driving, and the number of skipped exhibits. Each tour has its own order, path and speeds.
"""

from math import radians
from pathlib import Path

import hpop
from hpop.view import draw_front, draw_map, draw_trace
from hpop.world.content import Landmark

#: The middle of each exhibit: x, y and height, m.
EXHIBITS = {
    "dinosaur": (9.4, 3.2, 1.5),
    "vitrine": (15.1, 18.1, 1.2),
    "meteorite": (19.1, 2.9, 1.0),
    "model ship": (25.1, 18.05, 1.0),
}
OPTIONAL = ("meteorite", "model ship")


def main(folder: Path = Path("out/10_guided_tour"), step: float = 0.5) -> hpop.Front:
    """Plan all optimal tours, print some of them with their order of exhibits, and draw them."""
    # World: the museum of the other examples, with the exhibits as landmarks that a camera can see.
    museum = hpop.examples.museum()
    landmarks = [Landmark(*place, name=name) for name, place in EXHIBITS.items()]
    world = museum.world.with_content(landmarks=landmarks)

    # Robot: its camera looks ahead and sees 60 degrees. It drives at three speeds, m/s, and changes them on its way.
    robot = hpop.DifferentialDrive(
        radius=0.3, camera_height=1.2, field_of_view=(radians(60), radians(45)), speeds=(0.5, 1.0, 1.5)
    )

    # Tour: at each stop the robot stands for ten seconds, at most 3 m from the exhibit, and has it in view.
    stops = [{"landmark": name, "within": 3.0, "dwell": 10.0, "optional": name in OPTIONAL} for name in EXHIBITS]

    # Criteria: the time of the tour; all speeding up and braking that the viewer feels; the number of skipped stops.
    problem = hpop.Problem(
        world=world,
        model=robot,
        start=(2.0, 10.0, 0.0),
        goal=(28.0, 10.0, None),  # the exit, with any heading
        criteria=["duration", "felt_acceleration", "stops_missed"],
        tour=hpop.Tour(stops, order="any"),
    )

    # Plan: exhibits, orders, paths and speeds are chosen in one exact search.
    front = problem.solve(planner="lattice", step=step)
    print(f"{len(front)} optimal tours ({front.status}); {front.certificate}\n")

    # Choose: the fastest tour for each number of exhibits. Points of a front are sorted by the first criterion, time.
    chosen: dict[str, int] = {}
    for point in front:
        seen = len(EXHIBITS) - round(point.costs["stops_missed"])
        chosen.setdefault(f"fastest with {seen} exhibits", point.index)

    # Print these and twelve that represent the front. Its provenance has the visits of each tour, in order of time.
    few = [point.costs for point in front.representative(12)]
    printed = [point for point in front if point.index in chosen.values() or point.costs in few]
    print(f"{len(printed)} of them (*: on the map)")
    print("  time (s)  acceleration (m/s)  skipped  speeds (m/s)  order of the exhibits")
    for point in printed:
        time, acceleration, skipped = point.costs.values()
        speeds = " ".join(f"{speed:g}" for speed in sorted(set(point.item.states.speed)) if speed > 0)
        order = ", ".join(visit["stop"] for visit in point.provenance["visits"])
        mark = "*" if point.index in chosen.values() else " "
        print(f"{mark} {time:8.1f}  {acceleration:18.1f}  {skipped:7.0f}  {speeds:12}  {order}")

    # Draw: these tours on the map with the numbers of the stops, and on the front; then one of them over time.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    draw_map(problem, front, chosen=chosen, colour="duration").savefig(folder / "map.png", dpi=150)
    draw_front(front, chosen=chosen).savefig(folder / "front.png", dpi=150)
    tour = front.trajectories[chosen["fastest with 4 exhibits"]]
    draw_trace(problem, tour, name="the fastest tour with 4 exhibits").savefig(folder / "trace.png", dpi=150)
    return front


if __name__ == "__main__":
    main()
