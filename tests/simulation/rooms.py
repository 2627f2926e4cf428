"""Random rooms with people, in which simulated robots drive: plans for a larger and slower robot than the real one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely

import hpop
from hpop.simulation import DriveLimits, farthest_off
from hpop.world import Person, World

WIDTH, DEPTH = 12.0, 9.0  # m
ROBOT = hpop.DifferentialDrive(radius=0.25)
SLOWER = 0.8  # share of the real robot's speeds with which it is planned


class Room(NamedTuple):
    """One room: its problem, the disturbances of the drive, and the bound of the distance from the plan."""

    problem: hpop.Problem
    disturbances: dict[str, float]
    bound: float


def room(seed: int) -> Room:
    """Return a room with up to four boxes and up to three people who cross it, and disturbances."""
    rng = np.random.default_rng(seed)
    given = {"delay": rng.uniform(0, 0.2), "slip": rng.uniform(0, 0.1), "noise": rng.uniform(0, 0.05)}
    bound = farthest_off(DriveLimits.of(ROBOT), **given)
    planned = hpop.DifferentialDrive(
        radius=ROBOT.radius + bound,
        speed=SLOWER * ROBOT.speed,
        acceleration=SLOWER**2 * ROBOT.acceleration,
        turn_rate=SLOWER * ROBOT.turn_rate,
        turn_acceleration=SLOWER**2 * ROBOT.turn_acceleration,
    )
    corners = rng.uniform((2.0, 1.0), (WIDTH - 3.0, DEPTH - 2.0), (rng.integers(0, 5), 2))
    boxes = [
        shapely.box(x, y, x + w, y + d)
        for (x, y), (w, d) in zip(corners, rng.uniform(0.3, 1.2, (len(corners), 2)), strict=True)
    ]
    people = []
    for i in range(int(rng.integers(0, 4))):
        x, y = rng.uniform((3.0, 0.5), (WIDTH - 1.0, DEPTH - 0.5))
        heading, speed = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 1.2)
        people.append(
            Person(float(x), float(y), velocity=(speed * np.cos(heading), speed * np.sin(heading)), name=f"person {i}")
        )
    world = World.from_polygons(boxes, extent=shapely.box(0, 0, WIDTH, DEPTH)).with_content(people=people)
    start = (1.0, float(rng.uniform(1.0, DEPTH - 1.0)), 0.0)
    goal = (WIDTH - 1.0, float(rng.uniform(1.0, DEPTH - 1.0)), None)
    return Room(hpop.Problem(world, planned, start, goal, ["duration", "length", "rotation"]), given, bound)
