"""Drives of robots with several speeds: after any event, the options are those of an own label setting from there.

The label setting knows nothing of hpop's graphs, searches and drives. It begins where the options begin, at the speed
that the robot has there, in a new world with the closed areas.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import DriveError, QueryError
from hpop.motions import States
from hpop.planners import Lattice
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import built_query
from hpop.planners.graphs.speeds import with_speeds
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Limits
from hpop.problems.problem import Problem
from hpop.world.content.content import Zone
from tests.drive.test_fresh_search import covered
from tests.planners.speeds.test_enumerated import ACROSS, CRITERIA, HEADINGS, RADIUS, SIZE, Oracle, executed_as_planned

PLANNER = Lattice(step=1.0, headings=HEADINGS)
EXTENT = shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5)
SUMS: list[Any] = [names for names in CRITERIA if "peak_optic_flow" not in names]


class Room:
    """A room with a goal in a corner, a robot with two or three speeds, and what is closed, noted beside the drive."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.closed: list[Any] = []
        self.robot = hpop.DifferentialDrive(
            radius=RADIUS, speeds=[(0.5, 1.0), (0.25, 0.8, 1.5)][seed % 2], acceleration=float(rng.choice([0.5, 2.0]))
        )
        self.goal = (3.0 - 0.4 * (seed % 3 == 2), float(rng.integers(0, SIZE[1])))
        self.criteria = SUMS[seed % len(SUMS)]

    def problem(self, start: tuple[float, ...]) -> Problem:
        zones = [Zone("keep-out", area) for area in self.closed]
        world = hpop.World.from_polygons([], extent=EXTENT).with_content(zones=zones)
        return Problem(world, self.robot, start, (*self.goal, None), self.criteria)

    def event(self, drive: hpop.drive.Execution, now: float) -> None:
        if self.closed and self.rng.random() < 0.4:
            drive.world(now, open=self.closed.pop())
            return
        x, y = self.rng.uniform((0.0, -0.5), (3.0, 2.0))
        area = shapely.box(x, y, x + 0.4, y + self.rng.uniform(0.3, 1.5))
        drive.world(now, close=area)
        self.closed.append(area)


@pytest.mark.seeds(1, of=40)
def test_options_are_those_of_an_own_label_setting_from_there(seed: int, tmp_path: Path) -> None:
    room = Room(seed)
    problem = room.problem((0.0, 1.0, 0.0))
    front = problem.solve(PLANNER)
    drive, now = hpop.follow(problem, front, int(room.rng.integers(len(front)))), 0.0
    for _ in range(4):
        now += float(room.rng.uniform(0.1, 2.5))
        with suppress(DriveError):  # an area that covers the robot
            room.event(drive, now)
        options = drive.options(now, 0.3)
        check(room, options)
        if len(options):
            drive.take(int(room.rng.integers(len(options))))
    assert list(room.robot.faults(drive.plan)) == []
    executed_as_planned(drive.plan)
    costs, past = problem.evaluate(drive.plan), drive.at(drive.plan.duration).past
    assert past == pytest.approx(costs, abs=1e-5) or room.closed  # exposure depends on what was closed
    drive.save(tmp_path / "drive.json")
    assert hpop.drive.load(tmp_path / "drive.json").plan.describe() == drive.plan.describe()


def check(room: Room, options: hpop.drive.Options) -> None:
    """Compare options with the costs of the own label setting, up to rounding; the present plan is one of them."""
    state = options.commit.state
    x, y, yaw, speed = (float(getattr(state, name)[0]) for name in ("x", "y", "yaw", "speed"))
    fault = (yaw / ACROSS) % 1.0
    problem = room.problem((x, y, yaw))
    if max(abs(x - round(x)), abs(y - round(y)), min(fault, 1.0 - fault)) < 1e-9:
        oracle = Oracle(problem, room.closed, room.goal)
        number = int(np.abs(np.array([0.0, *room.robot.speeds]) - speed).argmin())
        found = oracle.front((round(x), round(y)), round(yaw / ACROSS) % HEADINGS, number)
        quanta = np.array([criterion.quantum for criterion in problem.criteria])
        wanted = np.array(sorted(found)).reshape(-1, quanta.size) * quanta
    else:
        wanted, quanta = fresh(problem)
        rest: list[Any] = [hpop.Trajectory(room.robot, stopping(state), ("speed_change",))] if speed else []
        wanted = wanted + sum(np.array([*dict(problem.evaluate(change)).values()]) for change in rest)
    slack = np.where(quanta < 1.0, 40 * quanta, 0.5)  # each motion is rounded up
    assert covered(options.front.costs, wanted, slack)
    assert covered(wanted, options.front.costs, slack)


def stopping(state: States) -> States:
    """Return the ends of a change to rest."""
    columns = {name: np.repeat(column, 2) for name, column in state.__dict__.items()}
    columns["speed"][1] = 0.0
    return States(**columns)


def fresh(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return the costs and quanta of a new search from a state between the positions of the lattice, at rest."""
    objectives = edge_objectives(problem.criteria, "lattice")
    quanta = np.array([criterion.quantum for criterion in problem.criteria])
    try:
        lattice = replace(PLANNER.lattice(problem), anchor=(0.0, 1.0))
        ends = with_speeds(PLANNER.ends(lattice, problem), problem.model, objectives.optimised)
    except QueryError:
        return np.zeros((0, quanta.size)), quanta
    return built_query(BuiltGraph(ends, problem), objectives).paths(Limits()).costs * quanta, quanta


@pytest.mark.seeds(1, of=10)
def test_options_along_a_tour_are_those_of_a_fresh_problem_at_that_speed(seed: int) -> None:
    room = Room(seed)
    tour = hpop.Tour([{"at": (2.0, 2.0 * (seed % 2)), "within": 0.5, "dwell": 2.0}, {"at": (1.0, 2.0), "within": 0.1}])
    problem = replace(room.problem((0.0, 1.0, 0.0)), tour=tour)
    front = problem.solve(PLANNER)
    drive = hpop.follow(problem, front, int(room.rng.integers(len(front))))
    options = drive.options(0.1, 1.0)
    x, y, yaw, speed = (float(getattr(options.commit.state, name)[0]) for name in ("x", "y", "yaw", "speed"))
    query = PLANNER.query(replace(problem, start=(x, y, yaw)))
    number = (0.0, *room.robot.speeds).index(speed)
    wanted = replace(query, start=query.start + number).paths(Limits()).costs * query.quanta
    slack = np.where(query.quanta < 1.0, 40 * query.quanta, 0.5)
    assert covered(wanted, options.front.costs, slack)
    assert covered(options.front.costs, wanted, slack)
