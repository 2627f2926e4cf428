"""Drives of robots with several speeds: after any event, the options are those of an own label setting from there.

The label setting knows nothing of hpop's graphs, searches and drives. It begins where the options begin, at the speed
that the robot has there, in a new world with the closed areas.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive.plan import joined
from hpop.errors import DriveError, QueryError
from hpop.motions import States
from hpop.planners import Lattice
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.query import built_query
from hpop.planners.graphs.speeds import with_speeds
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Limits
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.world import Person
from hpop.world.content.content import Zone
from tests.drive.test_fresh_search import covered
from tests.planners.speeds.test_enumerated import ACROSS, CRITERIA, HEADINGS, RADIUS, SIZE, Oracle, executed_as_planned
from tests.planners.timed.test_enumerated import driven, is_safe, person
from tests.planners.timed.test_run_speeds import ANN, ROOMY, RateCase, SpeedCase, room

PLANNER = Lattice(step=1.0, headings=HEADINGS)
EXTENT = shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5)
SUMS: list[Any] = [names for names in CRITERIA if "peak_optic_flow" not in names]


class Room:
    """A room with a goal in a corner, a robot with two or three speeds, and what is closed, noted beside the drive."""

    def __init__(self, seed: int) -> None:
        rng = self.rng = np.random.default_rng(seed)
        self.closed: list[Any] = []
        self.robot = hpop.DifferentialDrive(
            radius=RADIUS,
            camera_offset=(0.1, 0.0),  # beside the axis, a slower turn is felt less
            speeds=[(0.5, 1.0), (0.25, 0.8, 1.5)][seed % 2],
            turn_rates=[(0.8, 1.5), 1.5, (0.3, 0.8, 1.5)][seed % 3],
            acceleration=float(rng.choice([0.5, 2.0])),
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


def among_people(seed: int) -> Iterator[tuple[SpeedCase, hpop.drive.Options]]:
    """Yield options of a drive among people, each with the query on a grid of which they should be the front."""
    rng = np.random.default_rng(seed)
    people = tuple(
        person(*rng.uniform((0.3, 0.3), (1.3, 0.9)), *rng.uniform(-0.5, 0.5, 2), rng.uniform(2, 6), name=name)
        for name in ("Ann", "Bob")[: 1 + seed % 2]
    )
    hold, goal = (None, 1.0)[seed % 3 > 0], (3, int(rng.integers(2)))
    case = SpeedCase(people, hold=hold, goal=goal, ticks=32)
    if seed >= 60:
        case = RateCase(people, hold=hold, goal=goal, ticks=30)
    tick = case.robot.tick
    problem, front = case.front()
    planner = Lattice(step=case.robot.step, headings=4, clock=tick, hold=case.hold, arrive_by=case.ticks * tick)
    if not len(front) or any("taken to stop" in note for note in front.notes):
        return
    drive, now = hpop.follow(problem, front, int(rng.integers(len(front))), planner=planner), 0.0
    for _ in range(3):
        drive.ready(now)
        options = drive.options(now, 0.2)
        commit = options.commit
        if commit.arrives:
            return
        assert options.status is Status.COMPLETE
        x, y, yaw, speed = (float(getattr(commit.state, name)[0]) for name in ("x", "y", "yaw", "speed"))
        cell = round(x / case.robot.step), round(y / case.robot.step), round(yaw / (np.pi / 2)) % 4
        ticks = round(commit.time / tick)
        yield (
            replace(
                case,
                people=tuple(one.later(commit.time) for one in people),
                start=cell,
                begins=case.numbers[case.robot.model.speed_classes.index(speed)] if speed else 0,
                ticks=case.ticks - ticks,
            ),
            options,
        )
        drive.take(int(rng.integers(len(options))))
        now = commit.time + 0.01


@pytest.mark.seeds(1, of=100)
def test_options_among_people_are_those_of_all_plans_of_a_grid_from_there(seed: int) -> None:
    for case, options in among_people(seed):
        priced = sorted(case.plans(), key=lambda plan: plan[0])
        best: list[tuple[float, ...]] = []
        for row, motions in priced:
            if any(all(a <= b for a, b in zip(other, row, strict=True)) for other in best):
                continue
            if is_safe(case, driven(case, motions), case.people):
                best.append(row)
                assert (options.front.costs <= np.array(row) + 1e-6).all(axis=1).any(), (row, motions)
        possible = {tuple(np.round(row, 6)) for row, _ in priced}
        for row, way in zip(options.front.costs, options.front.trajectories, strict=True):
            assert tuple(np.round(row, 6)) in possible
            assert not [other for other in best if (np.array(other) <= row + 1e-6).all() and (other < row - 1e-6).any()]
            whole = joined(options.commit.before, way)
            assert list(whole.model.faults(whole)) == []


@pytest.mark.seeds(0, of=30)
def test_a_drive_goes_on_as_people_come_and_go_and_areas_close_and_open(seed: int, tmp_path: Path) -> None:
    rng, lone = np.random.default_rng(seed), Room(seed)
    problem = lone.problem((0.0, 1.0, 0.0))
    problem = replace(problem, criteria=["duration", "felt_acceleration", "turns"])
    front = problem.solve(PLANNER)
    drive, now = hpop.follow(problem, front, int(rng.integers(len(front))), planner=PLANNER), 0.0
    for event in ("people", "close", "open", "people", "gone"):
        now += float(rng.uniform(0.1, 1.5))
        with suppress(DriveError):  # an area that covers the robot, or nothing closed
            if event in ("people", "gone"):
                walk = {"velocity": tuple(rng.uniform(-0.4, 0.4, 2)), "until": 8.0, "radius": 0.15}
                drive.world(now, people=[Person(*rng.uniform((1.0, -0.4), (3.4, 2.4)), **walk)] * (event == "people"))
            else:
                lone.event(drive, now)
        drive.ready(now)
        options = drive.options(now, 0.3)
        for option in options:
            whole = joined(options.commit.before, option.item)
            assert list(whole.model.faults(whole)) == []
            begins = float(getattr(option.item.states, "speed", np.zeros(1))[0])
            assert begins == float(options.commit.state.speed[0]) or not len(option.item)
        if len(options):
            drive.take(int(rng.integers(len(options))))
    assert list(lone.robot.faults(drive.plan)) == []
    drive.save(tmp_path / "drive.json")
    assert hpop.drive.load(tmp_path / "drive.json").plan.describe() == drive.plan.describe()


@pytest.mark.cases(2)
@pytest.mark.parametrize("people", [(), (ANN,)])
@pytest.mark.parametrize("rates", [(0.6, 1.5), 1.5])
@pytest.mark.parametrize("headings", [8, 4])
@pytest.mark.parametrize("yaw", [None, 0.3])
def test_known_plans_to_a_goal_beside_the_graph_are_options_at_once(
    people: tuple[Person, ...], rates: Any, headings: int, yaw: float | None
) -> None:
    criteria, ends = ["duration", "felt_acceleration"], ((0, 0, 0), (4.2, 0.7, yaw))
    model = replace(ROOMY, turn_rates=rates)
    problem = Problem(room(*people), model, *ends, criteria, quanta={"duration": 0.1})
    planner = Lattice(step=0.5, headings=headings)
    front = problem.solve(planner)
    drive = hpop.follow(problem, front, 0, planner=planner)
    drive.ready(0.0)
    options = drive.options(0.0, 0.0).front.trajectories  # 0 s are for no search

    begins = options[0].states.take([0])

    def columns(states: States) -> np.ndarray:
        return np.stack([getattr(states, name) for name in ("x", "y", "yaw", "speed")], axis=1)

    later = list[tuple[tuple[str, ...], np.ndarray]]()  # what remains of plans that come where the options begin
    for plan in front.trajectories:
        there = np.flatnonzero(np.isclose(columns(plan.states), columns(begins)).all(axis=1))[-1:]
        later += [(plan.kinds[row:], columns(plan.states)[row:]) for row in there.tolist()]
    assert later
    for kinds, states in later:
        assert any(kinds == option.kinds and np.allclose(states, columns(option.states)) for option in options)


@pytest.mark.parametrize("model", [hpop.DifferentialDrive(radius=0.2), ROOMY])
def test_among_people_the_last_turn_at_a_goal_beside_the_graph_is_known_without_a_search(
    model: hpop.DifferentialDrive,
) -> None:
    goal, planner = (1.3, 0.2, 0.3), Lattice(step=0.5)
    problem = Problem(room(ANN), model, (0, 0, 0), goal, ["duration", "length"], quanta={"duration": 0.1})
    drive = hpop.follow(problem, problem.solve(planner), 0, planner=planner)
    last_move = max(row for row, kind in enumerate(drive.plan.kinds) if kind == "move")
    now = float(drive.plan.times[last_move + 1]) - 0.05
    drive.ready(now)
    options = drive.options(now, 0.0)  # 0 s are for no search
    assert [option.kinds for option in options.front.trajectories] == [drive.plan.kinds[last_move + 1 :]]
    assert options.gap < math.inf
