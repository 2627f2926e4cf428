"""Drive a plan and change it on the way: the viewer wishes for fewer turns, a visitor stops, and a passage closes.

After each event, the options are the exact front of the remaining path, from where the robot can leave its plan.
"""

from pathlib import Path

import shapely

import hpop
from hpop.drive import Event, performed
from hpop.view import draw_drive, draw_encounters


def main(folder: Path = Path("out/07_drive"), step: float = 0.5) -> hpop.Trajectory:
    """Plan among visitors, drive, print the options after each event, and draw the drive."""
    # World: the museum, and a visitor who comes along the hallway and is predicted to go on for 20 s.
    museum = hpop.examples.museum()
    ada = hpop.world.Person(24.0, 10.0, velocity=(-0.6, 0.0), name="Ada", until=20.0)
    problem = hpop.Problem(
        world=museum.world.with_content(people=[ada]),
        model=museum.model,
        start=museum.start,
        goal=museum.goal,
        criteria=["turns", "duration", "hall_zones"],  # without the duration, waiting would cost nothing
    )

    # Plan: the exact front in space and time, since a person moves.
    front = problem.solve("lattice", step=step)
    print(f"{len(front)} plans; {front.certificate}")

    # Drive the trajectory that disturbs the visitor least. The clock is simulated, so the drive takes no real time.
    drive = hpop.follow(problem, front, "least hall_zones")
    events = [
        Event(2.0, "wish", "fewer turns"),
        Event(5.0, "stop", "Ada"),
        Event(9.0, "close", shapely.box(14.0, 9.0, 15.0, 11.0), name="between the statues"),
    ]
    happenings = []
    for happening in performed(drive, events):
        options = happening.options
        print(f"{happening.event.at:4.1f} s  {happening.event}: {len(options)} options, {options.status}")
        if happening.taken is not None:
            who = "the viewer takes" if happening.asked else "the robot takes"
            costs = ", ".join(f"{name} {value:.4g}" for name, value in happening.taken.costs.items())
            print(f"        {who} number {happening.taken.index}, for the rest {costs}")
        happenings.append(happening)
    print(f"driven in {drive.plan.duration:.1f} s")

    # Draw the options after each event, and the quickest plan among the visitors as predicted.
    folder.mkdir(parents=True, exist_ok=True)
    draw_drive(drive, happenings).savefig(folder / "drive.png", dpi=150)
    draw_encounters(problem, front.best("duration").item, name="the quickest").savefig(folder / "plan.png", dpi=150)
    drive.save(folder / "drive.json")
    return drive.plan


if __name__ == "__main__":
    main()
