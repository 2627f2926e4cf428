"""Rooms with walls and doors in which tests drive, and fronts of ways through them, each planned once."""

from __future__ import annotations

from functools import cache

import numpy as np
import shapely

import hpop
from hpop.world import Person, World
from hpop.world.content.content import Zone

STEP = 0.5
NORTH, SOUTH = shapely.box(5.2, 4.0, 5.9, 6.0), shapely.box(5.2, 0.0, 5.9, 1.4)  # m: the doors of the wall between
MIDDLE = [shapely.box(5.4, 1.4, 5.7, 4.0)]
EXTENT = shapely.box(0, 0, 11, 6)
START, GOAL = (1.0, 2.0, 0.0), (10.0, 2.0, None)


def two_doors(*zones: Zone, people: tuple[Person, ...] = ()) -> World:
    """Return a hall of 11 x 6 m and a wall across it: a wide opening in the north, a narrow nearer one in the south."""
    return World.from_polygons(MIDDLE, extent=EXTENT).with_content(people=people, zones=zones)


def asked(world: World, *criteria: str, start: tuple[float, float, float] = START) -> hpop.Problem:
    """Return the problem of driving from the west of the hall to its east."""
    robot = hpop.DifferentialDrive(radius=0.3)
    return hpop.Problem(world, robot, start, GOAL, list(criteria or ("obstruction", "turns", "length")))


@cache
def planned() -> tuple[hpop.Problem, hpop.Front]:
    """Return the problem of the hall with both doors open, and its front."""
    problem = asked(
        two_doors(Zone("speed", NORTH, limit=1.0, name="north"), Zone("speed", SOUTH, limit=1.0, name="south"))
    )
    return problem, problem.solve("lattice", step=STEP)


def through(way: hpop.Trajectory) -> str:
    """Return the door that a trajectory takes."""
    between = (way.states.x > 5.2) & (way.states.x < 5.9)
    return "north" if float(np.mean(way.states.y[between])) > 3.0 else "south"
