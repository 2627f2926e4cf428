"""Worlds with people who move, for tests of planners with a clock; and plans, enumerated one by one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import shapely

from hpop.models import DifferentialDrive
from hpop.motions import States
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

ROBOT = DifferentialDrive(radius=0.25)
WALL = [shapely.box(2.9, 0.0, 3.1, 1.5), shapely.box(2.9, 2.5, 3.1, 4.5), shapely.box(2.9, 5.5, 3.1, 6.0)]
TWO_DOORS = World.from_polygons(WALL, extent=shapely.box(0, 0, 6, 6))
"""Two rooms side by side, with a door at y = 2 and another, out of the way, at y = 5."""
QUANTA = {"length": 1e-3}


def in_the_door(until: float, **others) -> Person:
    """Return a person who stands in the door on the path and is gone after ``until``."""
    return Person(3.0, 2.0, until=until, name="Ann", **others)


def through_the_doors(*people: Person, criteria=("length", "duration"), robot=ROBOT, **options) -> Problem:
    """From one room to the other."""
    world = TWO_DOORS.with_content(people=people)
    quanta = {name: step for name, step in QUANTA.items() if name in criteria}
    more = len(robot.space.names) - 3  # a head
    start, goal = (1.0, 2.0, 0.0, *[0.0] * more), (5.0, 2.0, None, *[None] * more)
    return Problem(world, robot, start, goal, list(criteria), quanta=quanta, **options)


def gaps(problem: Problem, trajectory: Trajectory, step: float = 0.01) -> np.ndarray:
    """Least gap, m, to each person who moves, of a round robot, at densely sampled times of a trajectory."""
    times = np.arange(0.0, trajectory.duration, step)
    states = trajectory.at(times)
    least = []
    for person in problem.world.content.people:
        if not person.moves:
            continue
        px, py = person.at(times)
        gap = np.hypot(states.x - px, states.y - py) - person.radius - problem.model.radius
        least.append(np.where(np.broadcast_to(person.there(times), times.shape) > 0, gap, np.inf).min())
    return np.array(least)


# Robots on small grids with four headings, all motions of which last a whole number of ticks


class GridRobot(NamedTuple):
    """A robot that moves by ``step``, m, on a grid; durations of its motions in ticks of ``tick``, s.

    Before it moves off at first it stands for v/2a, ``stands`` ticks, also after it has waited.
    """

    model: DifferentialDrive
    step: float
    tick: float
    move: int
    quarter: int
    half: int
    stands: int


EVEN = GridRobot(
    DifferentialDrive(radius=0.1, speed=1.0, acceleration=1.0, turn_rate=math.pi / 2, turn_acceleration=math.pi / 2),
    *(0.5, 0.5, 1, 6, 8, 1),
)
State = tuple[int, int, int]
"""Column, row, and heading in quarter turns."""
Motion = tuple[str, int]
"""A move, a turn by some quarters, or a hold of some ticks."""


def motions_in_a_grid(
    robot: GridRobot, start: State, goal: tuple[int, int], size: tuple[int, int], ticks: int, hold: int | None
) -> Iterator[tuple[list[Motion], int]]:
    """Yield all plans to a (column, row) that arrive in time, with their ticks; holds last ``hold`` ticks or more."""
    columns, rows = size

    def onward(state: State, tick: int, motions: list[Motion], *, held: bool) -> Iterator[tuple[list[Motion], int]]:
        if state[:2] == goal:
            yield motions, tick
            return
        column, row, heading = state
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading]
        stood = [] if any(kind != "hold" for kind, _ in motions) else [("hold", robot.stands)]
        after = tick + len(stood) * robot.stands + robot.move
        if after <= ticks and 0 <= column + dx < columns and 0 <= row + dy < rows:
            yield from onward((column + dx, row + dy, heading), after, [*motions, *stood, ("move", 1)], held=False)
        for quarters, lasts in ((1, robot.quarter), (-1, robot.quarter), (2, robot.half)):
            if tick + lasts <= ticks:
                turned = (column, row, (heading + quarters) % 4)
                yield from onward(turned, tick + lasts, [*motions, ("turn", quarters)], held=False)
        if hold is not None and not held:
            for lasts in range(hold, ticks - tick):
                yield from onward(state, tick + lasts, [*motions, ("hold", lasts)], held=True)

    yield from onward(start, 0, [], held=False)


def plans_in_a_grid(
    robot: GridRobot, start: State, goal: tuple[int, int], size: tuple[int, int], ticks: int, hold: int | None
) -> Iterator[Trajectory]:
    """Yield the plans of :func:`motions_in_a_grid` as trajectories."""
    for motions, _ in motions_in_a_grid(robot, start, goal, size, ticks, hold):
        yield _trajectory(robot, start, motions)


def _trajectory(robot: GridRobot, start: State, motions: list[Motion]) -> Trajectory:
    column, row, heading = start
    rows = [(column * robot.step, row * robot.step, heading * math.pi / 2, 0.0)]
    for kind, amount in motions:
        x, y, yaw, clock = rows[-1]
        if kind == "move":
            rows.append((x + robot.step * round(math.cos(yaw)), y + robot.step * round(math.sin(yaw)), yaw, clock))
        elif kind == "turn":
            rows.append((x, y, yaw + amount * math.pi / 2, clock))
        else:
            rows.append((x, y, yaw, clock + amount * robot.tick))
    columns = dict(zip(("x", "y", "yaw", "clock"), np.array(rows).T, strict=True))
    kinds = tuple(kind for kind, _ in motions)
    if "hold" not in kinds:
        del columns["clock"]
    return Trajectory(robot.model, States(**columns), kinds)


def nondominated(costs: np.ndarray) -> np.ndarray:
    """Rows that no other one is better than, by comparing each with each; of equal ones the first."""
    kept = []
    for i, row in enumerate(costs):
        others = [other for j, other in enumerate(costs) if j != i]
        if not any((other <= row).all() and ((other < row).any() or j < i) for j, other in enumerate(others)):
            kept.append(row)
    return np.array(kept)
