"""Speeds among people: fronts are those of all plans in a small grid whose straight runs have one speed each.

Plans, times, and distances in time are those of :mod:`.test_enumerated`, which shares no code with hpop.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.errors import ModelError
from hpop.motions import Motions, States
from hpop.planners import Lattice
from hpop.planners.graphs.run_speeds import run_speed_graph
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.runtime.limits import Status
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person
from tests.planners.timed.rooms_with_people import GridRobot, Motion, State
from tests.planners.timed.test_enumerated import Case, check, person

SPEEDS, ACCELERATION = (0.5, 1.0), 1.25
TURNS = {"turn_rate": math.pi / 0.8, "turn_acceleration": math.pi / 0.16}
MODEL = hpop.DifferentialDrive(radius=0.1, speeds=SPEEDS, acceleration=ACCELERATION, **TURNS)
ROBOT = GridRobot(MODEL, 0.4, 0.2, 2, 3, 5, 0)  # m, s, then ticks of a move at 1 m/s and of turns


@dataclass(frozen=True)
class SpeedCase(Case):
    """A query of a robot with two speeds; it begins at rest, 0, or on a run with the speed of this number."""

    robot: GridRobot = ROBOT
    begins: int = 0
    numbers: tuple[int, ...] = (1, 2)
    rates: tuple[str, ...] = ("turn",)

    @property
    def stray(self) -> float:
        return SPEEDS[-1] ** 2 / (8 * ACCELERATION)

    @property
    def criteria(self) -> list[str]:
        return ["duration", "felt_acceleration", "turns"]

    def costs(self, motions: Sequence[Motion], ticks: int) -> tuple[float, float, float]:
        """Return duration, s, felt acceleration, m/s, and turns; a run from rest to rest feels twice its speed."""
        felt = sum(SPEEDS[ticks - 1] for kind, ticks in motions if kind == "change")
        return ticks * self.robot.tick, felt, float(sum("turn" in kind for kind, _ in motions))

    def lasts(self, kind: str, amount: int) -> int:
        """Return the ticks of a motion: 4 or 2 for a move at 0.5 or 1 m/s, 1 or 2 for a change from or to rest."""
        return {1: 4, 2: 2}[amount] if kind == "move" else super().lasts(kind, amount)

    def plans(self) -> Iterator[tuple[tuple[float, ...], list[Motion]]]:
        hold = None if self.hold is None else round(self.hold / self.robot.tick)

        def onward(state: State, tick: int, motions: list[Motion], *, held: bool) -> Iterator[tuple[list[Motion], int]]:
            if state[:2] == self.goal:
                yield motions, tick
                return
            column, row, heading = state
            dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading]
            for number in self.numbers:
                for count in range(1, max(self.size)):
                    after = tick + 2 * number + count * self.lasts("move", number)
                    to = (column + count * dx, row + count * dy)
                    if after <= self.ticks and 0 <= to[0] < self.size[0] and 0 <= to[1] < self.size[1]:
                        run = [("change", number), *[("move", number)] * count, ("change", number)]
                        yield from onward((*to, heading), after, [*motions, *run], held=False)
            for turn, quarters in itertools.product(self.rates, (1, -1, 2)):
                lasts = self.lasts(turn, quarters)
                if tick + lasts <= self.ticks:
                    turned = (column, row, (heading + quarters) % 4)
                    yield from onward(turned, tick + lasts, [*motions, (turn, quarters)], held=False)
            if hold is not None and not held:
                for lasts in range(hold, self.ticks - tick):
                    yield from onward(state, tick + lasts, [*motions, ("hold", lasts)], held=True)

        column, row, heading = self.start
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading]
        for count in range(max(self.size) if self.begins else 1):
            to = (column + count * dx, row + count * dy)
            run = [*[("move", self.begins)] * count, *[("change", self.begins)] * (self.begins > 0)]
            after = sum(self.lasts(*motion) for motion in run)
            if after <= self.ticks and 0 <= to[0] < self.size[0] and 0 <= to[1] < self.size[1]:
                for motions, ticks in onward((*to, heading), after, run, held=False):
                    yield self.costs(motions, ticks), motions


CASES = {
    "crosses": SpeedCase((person(0.8, 0.65, 0.0, -0.4),), ticks=26),
    "crosses, without holds": SpeedCase((person(0.8, 0.65, 0.0, -0.4),), hold=None),
    "crosses with a margin": SpeedCase((person(0.8, 0.75, 0.0, -0.4),), margin=0.1, ticks=26),
    "comes against the robot": SpeedCase((person(1.4, 0.0, -0.4),), goal=(3, 1), ticks=26),
    "stands in the way for a while": SpeedCase((person(0.8, 0.0, until=3.0),), ticks=28),
}


@pytest.mark.cases("crosses, without holds")
@pytest.mark.parametrize("name", list(CASES))
def test_the_front_is_that_of_all_runs_at_all_speeds(name: str) -> None:
    check(CASES[name])


@pytest.mark.seeds(1, of=50)
def test_random_walks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = tuple(
        person(*rng.uniform((0.3, 0.3), (1.3, 0.9)), *rng.uniform(-0.5, 0.5, 2), rng.uniform(1, 4), name=name)
        for name in ("Ann", "Bob")[: 1 + seed % 2]
    )
    case = SpeedCase(people, hold=(None, 1.0)[seed % 3 > 0], goal=(int(rng.integers(2, 4)), int(rng.integers(2))))
    check(replace(case, ticks=25 if case.hold else 27))


@dataclass(frozen=True)
class Paced(hpop.DifferentialDrive):
    """A robot with two turn rates whose author forgot the speeds."""

    speed_classes = ()


def test_several_turn_rates_without_speeds_are_refused_among_people() -> None:
    case = RateCase((person(0.8, 0.65, 0.0, -0.4),), robot=RATED._replace(model=Paced(turn_rates=(SLOW, FAST))))
    with pytest.raises(ModelError, match="has paces, so among people who move it needs speed_classes"):
        case.front()


def test_no_states_have_no_nodes() -> None:
    problem = RateCase((person(0.8, 0.65, 0.0, -0.4),)).problem
    graph = run_speed_graph(Lattice(step=0.4, headings=4).lattice(problem))
    assert graph.in_layer(np.zeros(0, np.int64), np.zeros(0)).size == 0


def test_known_plans_with_slow_turns_are_options_at_once() -> None:
    case = RateCase((person(0.8, 0.65, 0.0, -0.4),), start=(0, 1, 0), goal=(3, 0), ticks=28)
    problem, front = case.front()
    planner = Lattice(step=case.robot.step, headings=4, clock=case.robot.tick, hold=case.hold)
    drive = hpop.follow(problem, front, 0, planner=planner)
    drive.ready(0.0)
    known = drive.options(0.0, 0.0)  # s, without a search
    assert known.status is Status.TIME_LIMIT
    assert {"turn", "turn_1.9635"} <= {kind for t in known.front.trajectories for kind in t.kinds}


def room(*people: Person) -> hpop.World:
    walls = [shapely.box(2.0, 1.0, 2.4, 3.0)]
    return hpop.World.from_polygons(walls, extent=shapely.box(-0.5, -0.5, 5, 3)).with_content(people=people)


ANN = Person(2.2, 0.9, velocity=(0.0, -0.4), until=6.0, radius=0.2, name="Ann")
ROOMY = hpop.DifferentialDrive(radius=0.2, speeds=(0.4, 0.8, 1.2), turn_rates=(0.6, 1.5))


@pytest.mark.cases(2)
@pytest.mark.parametrize(
    "planner", [{"lattice": {"step": 0.5}}, {"any-angle": {"step": 0.5}}, {"roadmap": {"samples": 60}}]
)
def test_executions_keep_the_times_of_plans_and_their_distance_from_people(planner: dict) -> None:
    criteria = ["duration", "felt_acceleration", {"hall_zones": {}}]
    problem = Problem(
        room(ANN), ROOMY, (0, 0, 0), (4.2, 0.7, None), criteria, quanta={"hall_zones": 0.1, "duration": 0.1}
    )
    front = problem.solve(planner)
    assert len(front) > 1
    assert verify(problem, front) == []
    assert "each straight run at 0.4, 0.8 or 1.2 m/s" in front.certificate
    assert len({round(float(s), 6) for t in front.trajectories for s in t.states.speed} - {0.0}) > 1
    for trajectory in front.trajectories:
        run = trajectory.execution()
        assert run.duration == pytest.approx(trajectory.duration, abs=1e-6)
        times = np.arange(0.0, run.duration, 0.01)
        planned, done = trajectory.at(times), run.at(times)
        assert np.hypot(planned.x - done.x, planned.y - done.y).max() <= 1.2**2 / 8 + 1e-6
        speed = np.hypot(np.diff(done.x), np.diff(done.y)) / 0.01
        assert np.abs(np.diff(speed)).max() <= 0.01 * (1 + 1e-3)
        gap = np.hypot(done.x - ANN.at(times)[0], done.y - ANN.at(times)[1]) - 0.4
        assert gap[times < 6.0].min() >= -1e-3


def test_a_robot_that_rests_in_the_middle_of_a_straight_line_keeps_the_times_of_its_plan() -> None:
    x, speed = np.array([0, 0, 1, 1, 1, 2, 2.0]), np.array([0, 0.8, 0.8, 0, 0.4, 0.4, 0])
    states = States(x=x, y=0 * x, yaw=0 * x, speed=speed)
    plan = Trajectory(ROOMY, states, ("speed_change", "move", "speed_change") * 2)
    plan = plan.with_holds(np.zeros(0, np.int64), np.zeros(0), punctual=True)
    times = np.arange(0.0, plan.duration, 0.01)
    assert np.abs(plan.at(times).x - plan.execution().at(times).x).max() <= 0.8**2 / 8 + 1e-6


def test_several_speeds_are_at_least_as_good_as_each_that_is_the_fastest() -> None:
    world, ends = room(ANN), ((0, 0, 0), (4.0, 0.0, None))
    several = Problem(world, ROOMY, *ends, ["duration", "turns"]).solve("lattice", step=0.5)
    alone = Problem(world, hpop.DifferentialDrive(radius=0.2, speed=1.2), *ends, ["duration", "turns"])
    one = alone.solve("lattice", step=0.5)
    for row in one.costs:  # one speed has no planned start and stop, which last v/a together
        assert (several.costs <= row + np.array([1.2 + 0.5, 1e-6])).all(axis=1).any()


@dataclass(frozen=True)
class SpeedTour(SpeedCase):
    """A query of a robot with two speeds, with one stop at a cell, for a dwell of ``dwell`` s or in passing."""

    stop: tuple[int, int] = (1, 0)
    dwell: float = 0.4
    size: tuple[int, int] = (3, 2)
    goal: tuple[int, int] = (2, 0)

    @property
    def problem(self) -> Problem:
        plain = super().problem
        at = [self.robot.step * i for i in self.stop]
        tour = hpop.Tour([{"at": at, "within": 0.05, "dwell": self.dwell}])
        return Problem(plain.world, plain.model, plain.start, plain.goal, self.criteria, tour=tour)

    def plans(self) -> Iterator[tuple[tuple[float, ...], list[Motion]]]:
        hold = None if self.hold is None else round(self.hold / self.robot.tick)
        dwell = round(self.dwell / self.robot.tick)

        def onward(
            state: State, tick: int, motions: list[Motion], *, seen: bool, held: bool
        ) -> Iterator[tuple[list[Motion], int]]:
            column, row, heading = state
            seen |= not dwell and state[:2] == self.stop
            if state[:2] == self.goal and seen:
                yield motions, tick
                return
            if dwell and not seen and state[:2] == self.stop and tick + dwell <= self.ticks:
                yield from onward(state, tick + dwell, [*motions, ("hold", dwell)], seen=True, held=False)
            dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading]
            for number in self.numbers:
                for count in range(1, max(self.size)):
                    after = tick + 2 * number + count * self.lasts("move", number)
                    to = (column + count * dx, row + count * dy)
                    if after <= self.ticks and 0 <= to[0] < self.size[0] and 0 <= to[1] < self.size[1]:
                        run = [("change", number), *[("move", number)] * count, ("change", number)]
                        passed = {(column + i * dx, row + i * dy) for i in range(1, count + 1)}
                        sees = seen or (not dwell and self.stop in passed)
                        yield from onward((*to, heading), after, [*motions, *run], seen=sees, held=False)
            for turn, quarters in itertools.product(self.rates, (1, -1, 2)):
                lasts = self.lasts(turn, quarters)
                if tick + lasts <= self.ticks:
                    turned = (column, row, (heading + quarters) % 4)
                    yield from onward(turned, tick + lasts, [*motions, (turn, quarters)], seen=seen, held=False)
            if hold is not None and not held:
                for lasts in range(hold, self.ticks - tick):
                    yield from onward(state, tick + lasts, [*motions, ("hold", lasts)], seen=seen, held=True)

        for motions, ticks in onward(self.start, 0, [], seen=False, held=False):
            yield self.costs(motions, ticks), motions


SLOW, FAST = math.pi / 1.6, math.pi / 0.8
TURNING = hpop.DifferentialDrive(
    radius=0.1, acceleration=ACCELERATION, turn_rates=(SLOW, FAST), turn_acceleration=math.pi / 0.32
)
RATED = GridRobot(TURNING, 0.4, 0.2, 2, 4, 6, 0)


@criterion("test_effort", group="C", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Effort:
    """Own criterion: 1 for each quarter of a slow turn, 2 for one of a fast turn."""

    def cost(self, m: Motions) -> Column:
        if "yaw" not in m.law.varies:
            return 0.0 * m.duration
        return np.abs(m.end.yaw - m.start.yaw) / (math.pi / 2) * (2.0 if m.kind == "turn" else 1.0)


@criterion("test_fastest", group="C", unit="rad/s", aggregate="max")
@dataclass(frozen=True)
class Fastest:
    """Own criterion: the fastest turn, 1 for a slow one and 2 for a fast one."""

    def cost(self, m: Motions) -> Column:
        return 0.0 * m.duration + (0.0 if "yaw" not in m.law.varies else 2.0 if m.kind == "turn" else 1.0)


@dataclass(frozen=True)
class RateCase(SpeedCase):
    """A query of a robot with one speed and two turn rates; the largest has kind "turn", the other "slow turn"."""

    robot: GridRobot = RATED
    numbers: tuple[int, ...] = (2,)
    rates: tuple[str, ...] = ("turn", "slow turn")
    worst: bool = False

    @property
    def criteria(self) -> list[Any]:
        return ["duration", Fastest() if self.worst else Effort(), "turns"]

    def costs(self, motions: Sequence[Motion], ticks: int) -> tuple[float, float, float]:
        """Return duration, s, what turns cost, and turns."""
        each = [(2.0 if kind == "turn" else 1.0, abs(quarters)) for kind, quarters in motions if "turn" in kind]
        paid = max([0.0, *(one for one, _ in each)]) if self.worst else sum(one * quarters for one, quarters in each)
        return ticks * self.robot.tick, paid, float(len(each))

    def lasts(self, kind: str, amount: int) -> int:
        """Return the ticks of a motion: 5 or 9 for a slow turn by a quarter or a half."""
        return {1: 5, -1: 5, 2: 9}[amount] if kind == "slow turn" else super().lasts(kind, amount)


@dataclass(frozen=True)
class RateTour(RateCase, SpeedTour):
    """A query of a robot with one speed and two turn rates, with one stop."""

    size: tuple[int, int] = (3, 2)
    goal: tuple[int, int] = (2, 0)


@pytest.mark.seeds(1, of=50)
def test_each_turn_has_one_of_several_rates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = tuple(
        person(*rng.uniform((0.3, 0.3), (1.3, 0.9)), *rng.uniform(-0.5, 0.5, 2), rng.uniform(1, 4), name=name)
        for name in ("Ann", "Bob")[: 1 + seed % 2]
    )
    start, goal = (0, int(rng.integers(2)), int(rng.integers(4))), (int(rng.integers(1, 4)), int(rng.integers(2)))
    case = RateCase(people, hold=(None, 1.0)[seed % 3 > 0], start=start, goal=goal, worst=bool(seed % 2))
    front = check(replace(case, ticks=28))
    assert "each turn at one of 2 rates (turn_1.9635, turn)" in front.certificate


@pytest.mark.seeds(1, of=70)
def test_tours_are_those_of_all_runs_that_visit_the_stop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = (person(*rng.uniform((0.3, 0.3), (1.1, 0.9)), *rng.uniform(-0.5, 0.5, 2), rng.uniform(1, 4)),)
    stop = ((1, 0), (1, 1), (0, 1))[seed % 3]
    tour = SpeedTour if seed < 30 else RateTour
    case = tour(people, hold=(None, 1.0)[seed % 2], stop=stop, dwell=(0.4, 0.0)[seed // 2 % 2], ticks=24)
    front = check(case)
    for trajectory in front.trajectories:
        run, at = trajectory.execution(), [ROBOT.step * i for i in stop]
        times = np.arange(0.0, run.duration, 0.01)
        states = run.at(times)
        there = np.hypot(states.x - at[0], states.y - at[1]) < (1e-3 if case.dwell else 0.21)
        assert there.any()
        if case.dwell:
            rests = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], there, [0]]))))[::2]
            assert rests.max() * 0.01 >= case.dwell - 0.011


FINE = ROBOT._replace(step=0.2, move=1)


@dataclass(frozen=True)
class JoinCase(SpeedCase):
    """A query in a corridor whose start and goal lie between positions of the lattice, which are every other cell."""

    robot: GridRobot = FINE
    start: State = (1, 0, 0)
    goal: tuple[int, int] = (5, 0)
    size: tuple[int, int] = (7, 1)

    @property
    def lowest(self) -> tuple[float, float]:
        return -0.4, -0.4

    @property
    def planner(self) -> dict[str, Any]:
        return {"step": 0.4, "anchor": "world"}

    def lasts(self, kind: str, amount: int) -> int:
        return super().lasts(kind, amount) // (2 if kind == "move" else 1)

    def chains(self, state: State, to: int, ends: int | None = None) -> Iterator[list[Motion]]:
        """Yield all turns, runs and turns from a state to another cell, of one rate and one speed each."""
        ahead = 0 if to > state[0] else 2
        first, last = (ahead - state[2]) % 4, 0 if ends is None else (ends - ahead) % 4
        for rate, number in itertools.product(self.rates if first or last else self.rates[:1], self.numbers):
            turns = [[(rate, {3: -1}.get(turn, turn))] if turn else [] for turn in (first, last)]
            moves = [("move", number)] * abs(to - state[0])
            yield [*turns[0], ("change", number), *moves, ("change", number), *turns[1]]

    def onward(self, state: State) -> Iterator[tuple[State, list[Motion]]]:
        """Yield all that a robot may do at rest in a state, but for waits, and the states to which it leads."""
        column, _, heading = state
        near = [to for to in range(self.size[0]) if abs(to - column) <= 3]  # one and a half steps
        if self.goal[0] in near:
            for chain in self.chains(state, self.goal[0]):
                yield (*self.goal, 0), chain
        if column % 2:  # only the start is left from here
            for to, ends in itertools.product(near, range(4)):
                for chain in self.chains(state, to, ends) if to % 2 == 0 else ():
                    yield (to, 0, ends), chain
            return
        for rate, quarters in itertools.product(self.rates, (1, -1, 2)):
            yield (column, 0, (heading + quarters) % 4), [(rate, quarters)]
        for to in range(0, self.size[0], 2):
            if heading == (0 if to > column else 2) and to != column:
                for chain in self.chains(state, to):
                    yield (to, 0, heading), chain

    def plans(self) -> Iterator[tuple[tuple[float, ...], list[Motion]]]:
        hold = None if self.hold is None else round(self.hold / self.robot.tick)

        def plans_from(state: State, tick: int, motions: list[Motion], *, held: bool) -> Iterator[Any]:
            if state[:2] == self.goal:
                yield self.costs(motions, tick), motions
                return
            for to, chain in self.onward(state):
                after = tick + sum(self.lasts(*motion) for motion in chain)
                if after <= self.ticks:
                    yield from plans_from(to, after, [*motions, *chain], held=False)
            for lasts in range(hold, self.ticks - tick) if hold is not None and not held else ():
                yield from plans_from(state, tick + lasts, [*motions, ("hold", lasts)], held=True)

        yield from plans_from(self.start, 0, [], held=False)


CHOOSING = hpop.DifferentialDrive(
    radius=0.1, speeds=SPEEDS, acceleration=ACCELERATION, turn_rates=(SLOW, FAST), turn_acceleration=math.pi / 0.32
)
BOTH = GridRobot(CHOOSING, 0.2, 0.2, 1, 4, 6, 0)


@dataclass(frozen=True)
class RateJoinCase(RateCase, JoinCase):
    """A query of a robot with two turn rates and one speed or two, whose start and goal are joined to the lattice."""

    robot: GridRobot = BOTH
    numbers: tuple[int, ...] = (1, 2)
    start: State = (1, 0, 0)
    goal: tuple[int, int] = (5, 0)
    size: tuple[int, int] = (7, 1)

    @property
    def criteria(self) -> list[Any]:
        return ["duration", "felt_acceleration", Effort()]

    def costs(self, motions: Sequence[Motion], ticks: int) -> tuple[float, float, float]:
        """Return duration, s, felt acceleration, m/s, and what turns cost."""
        return *JoinCase.costs(self, motions, ticks)[:2], RateCase.costs(self, motions, ticks)[1]

    def lasts(self, kind: str, amount: int) -> int:
        return JoinCase.lasts(self, kind, amount) if kind == "move" else RateCase.lasts(self, kind, amount)


@pytest.mark.seeds(1, of=range(3, 63))
def test_motions_that_join_a_start_and_a_goal_have_each_speed_and_each_turn_rate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    people = tuple(
        person(*rng.uniform((0.3, 0.3), (1.3, 0.9)), *rng.uniform(-0.5, 0.5, 2), rng.uniform(1, 4), name=name)
        for name in ("Ann", "Bob")[: 1 + seed % 2]
    )
    start, goal = (1 + 2 * int(rng.integers(3)), 0, int(rng.integers(4))), (1 + 2 * int(rng.integers(3)), 0)
    goal = goal if goal[0] != start[0] else (goal[0] % 6 + 1, 0)
    case = (JoinCase if seed % 3 == 2 else RateJoinCase)(
        people, hold=(None, 1.0)[seed // 2 % 2], start=start, goal=goal
    )
    front = check(replace(case, ticks=25))
    assert "the start joined to" in front.certificate


def test_a_tour_among_people_can_be_slow_on_all_motions_that_join_its_start_stop_and_goal() -> None:
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 5, 3)).with_content(people=[replace(ANN, x=4.5)])
    tour = hpop.Tour([{"at": (2.3, 1.7), "within": 0.05, "dwell": 1.0}])
    problem = Problem(world, ROOMY, (0.7, 0.8, 0.2), (3.3, 1.3, None), ["duration", "felt_acceleration"], tour=tour)
    front = problem.solve("lattice", step=0.5, headings=4, anchor="world")
    assert verify(problem, front) == []
    fastest, slowest = (front.trajectories[int(np.argmin(front.costs[:, j]))].states.speed.max() for j in (0, 1))
    assert fastest > slowest == ROOMY.speeds[0]
