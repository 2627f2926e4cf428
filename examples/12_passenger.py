"""Ride in a car along a winding road of one kilometre: how fast to drive where, so that the passenger stays well.

The path is given. The front has a speed profile for each optimal trade-off between the time of the ride and the
passenger's motion sickness dose. Three of them are drawn along the way: speed, and acceleration in g.
"""

from pathlib import Path

import numpy as np
import shapely

import hpop
from hpop.motions import States
from hpop.view import draw_felt, draw_front, draw_map

#: Pieces of the road: length, m, and curvature at its end, 1/m (positive to the left), linear over each piece.
ROAD = [
    (100, 0), (30, 1 / 60), (60, 1 / 60), (30, 0), (80, 0), (30, -1 / 45), (50, -1 / 45), (60, 1 / 70), (70, 1 / 70),
    (30, 0), (120, 0), (25, -1 / 40), (45, -1 / 40), (25, 0), (60, 0), (30, 1 / 55), (40, 1 / 55), (30, 0), (85, 0),
]  # fmt: skip


def road(car: hpop.Ackermann) -> hpop.Trajectory:
    """Return the ride along the road at cruise speed: clothoids and straight lines."""
    poses, yaw, bend = [(0.0, 0.0, 0.0)], 0.0, 0.0
    for length, after in ROAD:
        share = (np.arange(2000) + 0.5) / 2000
        heading = yaw + length * share * (bend + 0.5 * (after - bend) * share)
        x, y = poses[-1][0] + length * np.cos(heading).mean(), poses[-1][1] + length * np.sin(heading).mean()
        yaw, bend = yaw + 0.5 * length * (bend + after), after
        poses.append((x, y, yaw))
    columns = dict(zip(("x", "y", "yaw"), np.array(poses).T, strict=True))
    return hpop.Trajectory(car, States(**columns), ("clothoid",) * len(ROAD))


def main(folder: Path = Path("out/12_passenger"), points: int = 5) -> hpop.Front:
    """Compute the front of speed profiles, print it, and draw three of them along the way."""
    # Robot: a car of 4.3 m, with a seat 1.2 m ahead of its rear axle, where the passenger feels the ride.
    car = hpop.Ackermann(
        wheelbase=2.6,
        steering=0.55,
        steering_rate=0.4,
        speed=14.0,
        reverse_speed=0.0,
        acceleration=2.5,
        footprint=((3.4, 0.9), (-0.9, 0.9), (-0.9, -0.9), (3.4, -0.9)),
        seat=(1.2, 0.4, 0.6),
    )
    ride = road(car)
    start, goal = (tuple(float(getattr(ride.states, n)[i]) for n in ("x", "y", "yaw")) for i in (0, -1))

    # World: open land around the road.
    line = shapely.LineString(np.column_stack([ride.states.x, ride.states.y]))
    world = hpop.World.from_polygons([], extent=shapely.box(*line.buffer(40).bounds))

    # Criteria: the others are computed for each profile and reported. `ride_sickness` is for a passenger who reads.
    criteria = ["felt_msdv", "lateral_load", "felt_jerk", "ride_comfort", "ride_sickness"]
    problem = hpop.Problem(world, car, start, goal, criteria)

    # Plan: from the fastest ride that the car can drive to twice its time.
    front = hpop.retime(problem, ride, discomfort="felt_msdv", points=points)
    print(front.certificate)
    print(front)

    # Choose and draw: the fastest ride, the knee (the best compromise) and the gentlest ride.
    folder.mkdir(parents=True, exist_ok=True)
    front.save(folder / "front.json")
    knee = front.knee().index
    chosen = {"fastest": 0, "knee": knee, "gentlest": len(front) - 1}
    draw_map(problem, front, chosen=chosen, colour="duration").savefig(folder / "map.png", dpi=150)
    draw_front(front, chosen=chosen).savefig(folder / "front.png", dpi=150)
    draw_felt(front, chosen=chosen).savefig(folder / "felt.png", dpi=150)
    return front


if __name__ == "__main__":
    main()
