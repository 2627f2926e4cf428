"""Fronts of tours among people are those of all plans that visit the stops, and each visit lasts for its dwell time.

Plans on a small grid are enumerated one by one, as in :mod:`.test_enumerated`. Costs by time are compared with those of
a label setting in plain Python on the tables of one layer, which knows nothing of layers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import QueryError
from hpop.planners.graph_planners import Lattice
from hpop.planners.graphs.timed import Timing, timed_query
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Limits, Spending
from hpop.problems.front import Front
from hpop.problems.named_rows import stop_visits
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World
from tests.planners.timed.rooms_with_people import Motion, State, through_the_doors
from tests.planners.timed.test_enumerated import ROUND, Case, check, person
from tests.search.timed.enumeration import nondominated
from tests.search.timed.semantics import Semantics, Vector

TIMED = (
    ["hall_zones"],
    ["personal_space", "length"],
    ["hall_zones", "duration"],
    [{"exposure": {"radius": 0.8}}, "hall_zones"],
    ["worst_intrusion", "duration"],
    ["clearance", "hall_zones"],
)
ORDERS: tuple[Literal["given", "any"], ...] = ("given", "any")
RUN = 0.4  # s: v/a, to stop and start again
Stop = tuple[tuple[int, int], float, bool]
"""Cell (column, row), dwell in s, and whether it is optional."""


@dataclass(frozen=True)
class TourCase(Case):
    """A query with stops on a grid; each is a cell, or a cell and its neighbours."""

    stops: tuple[Stop, ...] = (((1, 0), 0.4, False),)
    within: float = 0.05
    order: Literal["given", "any"] = "given"
    size: tuple[int, int] = (3, 2)
    goal: tuple[int, int] = (2, 0)
    ticks: int = 34

    @property
    def problem(self) -> Problem:
        step = self.robot.step
        stops: list[Any] = [
            {"at": (step * x, step * y), "within": self.within, "dwell": dwell, "optional": optional}
            for (x, y), dwell, optional in self.stops
        ]
        plain = super().problem
        criteria = ["duration", "length", "turns", *["stops_missed"] * any(stop["optional"] for stop in stops)]
        return Problem(plain.world, plain.model, plain.start, plain.goal, criteria, tour=hpop.Tour(stops, self.order))

    def inside(self, cell: tuple[int, int], stop: int) -> bool:
        """Return whether a cell belongs to a stop."""
        (x, y), _, _ = self.stops[stop]
        return self.robot.step * math.hypot(cell[0] - x, cell[1] - y) <= self.within

    def sequences(self) -> Iterator[tuple[int, ...]]:
        """Yield the orders in which the stops may be visited, with and without optional ones."""
        must = {i for i, (_, _, optional) in enumerate(self.stops) if not optional}
        for size in range(len(self.stops) + 1):
            for sequence in permutations(range(len(self.stops)), size):
                if must <= {*sequence} and (self.order == "any" or [*sequence] == sorted(sequence)):
                    yield sequence

    def plans(self) -> Iterator[tuple[tuple[float, ...], list[Motion]]]:
        any_optional = any(optional for _, _, optional in self.stops)
        for sequence in self.sequences():
            missed = (float(len(self.stops) - len(sequence)),) if any_optional else ()
            for motions, ticks in self._onward(sequence, self.start, 0, [], stands=True, held=False):
                yield self.costs(motions, ticks) + missed, motions

    def _onward(
        self, stops: Sequence[int], state: State, tick: int, motions: list[Motion], *, stands: bool, held: bool
    ) -> Iterator[tuple[list[Motion], int]]:
        """Yield all plans that go on from a state; they still visit some stops, in this order.

        stands  whether a move must be preceded by the time to start
        """
        robot, (column, row, heading) = self.robot, state
        while stops and not self.stops[stops[0]][1] and self.inside(state[:2], stops[0]):
            stops = stops[1:]
        if not stops and state[:2] == self.goal:
            yield motions, tick
            return
        if stops and self.stops[stops[0]][1] and self.inside(state[:2], stops[0]):
            lasts = round((self.stops[stops[0]][1] + RUN) / robot.tick)
            if tick + lasts <= self.ticks:
                stood = [*motions, ("hold", lasts)]
                yield from self._onward(stops[1:], state, tick + lasts, stood, stands=False, held=False)
        dx, dy = ((1, 0), (0, 1), (-1, 0), (0, -1))[heading]
        before = [("hold", robot.stands)] * stands
        after = tick + len(before) * robot.stands + robot.move
        if after <= self.ticks and 0 <= column + dx < self.size[0] and 0 <= row + dy < self.size[1]:
            moved = (column + dx, row + dy, heading)
            yield from self._onward(stops, moved, after, [*motions, *before, ("move", 1)], stands=False, held=False)
        for quarters, lasts in ((1, robot.quarter), (-1, robot.quarter), (2, robot.half)):
            if tick + lasts <= self.ticks:
                turned = (column, row, (heading + quarters) % 4)
                yield from self._onward(
                    stops, turned, tick + lasts, [*motions, ("turn", quarters)], stands=False, held=False
                )
        if self.hold is not None and not held:
            for lasts in range(round(self.hold / robot.tick), self.ticks - tick):
                waited = [*motions, ("hold", lasts)]
                yield from self._onward(stops, state, tick + lasts, waited, stands=stands, held=True)


def checked(case: TourCase) -> Front:
    """Check a front against all plans, and that each execution really stands at the stops."""
    front = check(case)
    missed = front.names.index("stops_missed") if "stops_missed" in front.names else None
    for row, trajectory in zip(front.costs, front.trajectories, strict=True):
        visited = len(case.stops) - (0 if missed is None else round(row[missed]))
        for way in (trajectory, trajectory.execution()):
            assert any(visits(case, way, s) for s in case.sequences() if len(s) >= visited), "a stop is not visited"
    return front


def visits(case: TourCase, trajectory: Trajectory, sequence: Sequence[int]) -> bool:
    """Return whether a trajectory visits stops in an order, each for its dwell time, by samples of its states."""
    dt = 0.01
    states = trajectory.at(np.arange(0.0, trajectory.duration + dt, dt))
    poses = np.stack([states.x, states.y, states.yaw], axis=1)
    still = np.append(np.abs(np.diff(poses, axis=0)).max(axis=1) < 1e-7, True)
    now = 0
    for stop in sequence:
        (x, y), dwell, _ = case.stops[stop]
        centre = case.robot.step * np.array([x, y])
        inside = np.hypot(*(poses[:, :2] - centre).T) <= case.within + (0.0 if dwell else dt)
        count = max(1, round(dwell / dt) - 1)  # a sample may be missing at either end
        stands = inside & still if dwell else inside
        runs = np.convolve(stands, np.ones(count, np.int64))[count - 1 : stands.size]
        begins = np.flatnonzero(runs == count)
        begins = begins[begins >= now]
        if not begins.size:
            return False
        now = int(begins[0]) + (count if dwell else 0)
    return True


CROSSES = person(0.8, 0.65, 0.0, -0.4)
CASES = {
    "crosses": TourCase((CROSSES,)),
    "crosses two stops": TourCase((CROSSES,), stops=(((1, 0), 0.4, False), ((1, 1), 0.0, False)), order="any"),
    "crosses, without holds": TourCase((CROSSES,), hold=None, stops=(((2, 1), 0.4, False),)),
    "stands at the stop for a while": TourCase((person(0.4, 0.0, until=3.0),)),
    "walks through the goal, where the stop is": TourCase((CROSSES,), stops=(((2, 0), 0.4, False),)),
    "walks through the goal, which is passed": TourCase(
        (CROSSES,), stops=(((2, 0), 0.0, False), ((1, 0), 0.4, False)), ticks=38
    ),
    "walks to the start, where the stop is": TourCase(
        (person(0.0, 0.6, 0.0, -0.3, until=2.0),), stops=(((0, 0), 1.0, False),)
    ),
    "passes the start, which is a stop": TourCase(
        (person(-0.3, 0.3, 0.4, 0.0),), stops=(((0, 0), 0.0, False), ((2, 1), 0.0, False))
    ),
    "stands at an optional stop": TourCase((person(0.4, 0.4, until=3.0),), stops=(((1, 1), 0.4, True),)),
    "crosses two optional stops": TourCase(
        (CROSSES,), stops=(((1, 0), 0.4, True), ((2, 1), 0.0, True)), order="any", ticks=32
    ),
    "crosses a stop of many cells": TourCase((CROSSES,), within=0.41, stops=(((1, 0), 0.8, False),), ticks=28),
    "comes against the robot": TourCase(
        (person(1.0, 0.0, -0.4, until=1.0),), stops=(((1, 0), 0.4, False), ((1, 0), 0.6, False))
    ),
}
FEW = ("crosses two stops",)


@pytest.mark.cases(*FEW)
@pytest.mark.parametrize("case", [pytest.param(case, id=name) for name, case in CASES.items()])
def test_a_front_of_tours_among_people_is_that_of_all_plans(case: TourCase) -> None:
    assert len(checked(case))


def some_case(seed: int) -> TourCase:
    """Return one or two stops in a grid where one person walks."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.2, 1.0), rng.uniform(-0.2, 0.6)
    speed, angle = rng.choice([0.1, 0.3, 0.6]), rng.uniform(0, 2 * math.pi)
    walks = float(speed * math.cos(angle)), float(speed * math.sin(angle))
    crowd = person(
        float(x), float(y), *walks, float(rng.uniform(1.0, 3.0)), afterwards=str(rng.choice(["gone", "stays"]))
    )
    cells = [(int(x), int(y)) for x, y in rng.integers(0, (3, 2), (int(rng.integers(1, 3)), 2))]
    stops = tuple((cell, float(rng.choice([0.0, 0.4, 0.8])), bool(rng.random() < 0.3)) for cell in cells)
    within, order = float(rng.choice([0.05, 0.41], p=[0.8, 0.2])), ORDERS[int(rng.integers(2))]
    start = (int(rng.integers(0, 2)), int(rng.integers(0, 2)), int(rng.integers(0, 4)))
    hold, margin = 1.0 if rng.random() < 0.7 else None, float(rng.choice([0.0, 0.1]))
    ticks = 30 if within > 0.1 or len(stops) > 1 else 34
    return TourCase((crowd,), ROUND, margin, hold, start, stops=stops, within=within, order=order, ticks=ticks)


@pytest.mark.seeds(1, of=60)
def test_any_front_of_tours_among_people_is_that_of_all_plans(seed: int) -> None:
    checked(some_case(seed))


# Costs that depend on time, in any order of stops


def by_labels(case: TourCase, timing: Timing) -> set[Vector]:
    """Return the front of all tours by label setting on the tables of one layer; labels of one tick are compared."""
    timed, tour = timing.timed, timing.tour
    assert tour is not None
    of, clock = Semantics(timed.graph), timed.clock
    members = [{*np.flatnonzero(np.isin(timed.arcs.states_of, states)).tolist()} for states in tour.tour.members]
    goals = {*np.flatnonzero(np.isin(timed.arcs.states_of, tour.tour.goals)).tolist()}
    dwells = [math.ceil((dwell + RUN) / clock.tick - 1e-9) if dwell else 0 for _, dwell, _ in case.stops]
    count, number = len(case.stops), len(of.aggregates)
    optional = {i for i, (_, _, is_optional) in enumerate(case.stops) if is_optional}
    missed = [i == number - 1 for i in range(number)] if optional else [False] * number

    def plus(costs: Vector, skipped: int) -> Vector:
        return tuple(cost + skipped * is_missed for cost, is_missed in zip(costs, missed, strict=True))

    def decided(done: frozenset[int], stop: int) -> tuple[frozenset[int], int] | None:
        """Return the stops that are decided after a visit, and how many it skips; None if it is not allowed."""
        earlier = frozenset(range(stop) if case.order == "given" else ()) - done
        allowed = stop not in done and earlier <= optional
        return (done | earlier | {stop}, len(earlier)) if allowed else None

    labels: list[dict[tuple[int, frozenset[int]], set[Vector]]] = [{} for _ in range(of.last + 1)]
    solutions: set[Vector] = set()

    def arrive(node: int, done: frozenset[int], tick: int, costs: Vector, *, may_end: bool) -> None:
        if tick > of.last:
            return
        left = frozenset(range(count)) - done
        if node in goals and left <= optional and may_end:
            solutions.add(plus(costs, len(left)))
        if node not in goals or left:
            labels[tick].setdefault((node, done), set()).add(costs)
        for stop in left:
            after = decided(done, stop)
            if after is not None and not dwells[stop] and node in members[stop]:
                arrive(node, after[0], tick, plus(costs, after[1]), may_end=may_end)

    def leave(node: int, done: frozenset[int], tick: int, costs: Vector) -> None:
        for arc in of.arcs_of[node]:
            if of.may_leave(arc, node, tick):
                end, paid = tick + of.durations[arc], of.add(costs, of.arc_costs(arc, node, tick))
                last = timed.last_rows.get(arc)
                may_end = last is None or not timed.graph.blocked[last, min(tick, of.horizon)]
                arrive(of.heads[arc], done, end, paid, may_end=may_end)
        for stop, lasts in enumerate(dwells):
            after = decided(done, stop)
            if after is None or not lasts or node not in members[stop]:
                continue
            place, end, begin = of.place[node], tick + lasts, min(tick, of.horizon)
            if of.may_stand(place, tick, end):
                paid = of.add(costs, [
                    standing if j in of.standing or of.aggregates[j] == "max" else of.rate[place][j] * lasts >> 20
                    for j, standing in enumerate(of.hold_costs(place, begin, begin + lasts))
                ])  # fmt: skip
                arrive(int(timed.arcs.states_of[node]), after[0], end, plus(paid, after[1]), may_end=True)

    arrive(timing.start, frozenset(), 0, (0,) * number, may_end=True)
    for tick in range(of.last + 1):
        for (node, done), every in labels[tick].items():
            for paid in nondominated(every):
                leave(node, done, tick, paid)
                for end in range(tick + of.hold, of.last) if of.hold is not None else ():
                    if not of.may_stand(of.place[node], tick, end):
                        break
                    leave(node, done, end, of.add(paid, of.hold_costs(of.place[node], tick, end)))
    return {*nondominated(solutions)}


@pytest.mark.seeds(1, of=60)
def test_costs_of_tours_by_time_are_those_of_a_label_setting_without_layers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    case = replace(some_case(1000 + seed), ticks=60)
    (x, y), angle = rng.uniform(0.0, (0.8, 0.4)), rng.uniform(0, 2 * math.pi)  # where the person is after two seconds
    vx, vy = (float(rng.uniform(0.2, 0.5) * part) for part in (math.cos(angle), math.sin(angle)))
    crowd = person(
        float(x) - 2.0 * vx, float(y) - 2.0 * vy, vx, vy, afterwards=str(rng.choice(["gone", "gone", "stays"]))
    )
    stops = (*case.stops, ((int(rng.integers(0, 3)), int(rng.integers(0, 2))), 0.0, bool(rng.random() < 0.5)))
    case = replace(case, people=(crowd,), stops=stops)
    whole = case.problem
    more = [c for c in whole.criteria if c.name == "stops_missed"]
    criteria = [*TIMED[seed % len(TIMED)], "turns", *more]
    goal = (*whole.start[:2], None) if rng.random() < 0.2 else whole.goal
    problem = Problem(whole.world, whole.model, whole.start, goal, criteria, tour=whole.tour)
    planner = Lattice(step=ROUND.step, headings=4, clock=0.2, hold=case.hold, margin=case.margin, arrive_by=12.0)
    objectives = edge_objectives(problem.criteria, "lattice")
    *_, built = planner.toured_graphs(problem, objectives, Spending())
    query = timed_query(built, objectives, problem, planner.time_options)
    assert query.timing is not None
    expected = by_labels(case, query.timing)
    assert {*map(tuple, query.paths(Limits()).costs.tolist())} == expected
    assert verify(problem, problem.solve(planner)) == []


# Rooms


HALL = {"at": (1.0, 5.0), "within": 0.5, "dwell": 2.0, "name": "hall"}
CASE = {"at": (4.6, 1.4), "within": 0.15, "dwell": 3.0, "name": "case"}  # between the states of a lattice
DOOR = {"at": (3.0, 2.0), "within": 0.6, "name": "door"}
QUICK = ("turns", "duration")
WALKER = Person(5.0, 1.2, velocity=(-0.8, 0.3), until=5.0, name="Bob")


def toured(stops: Sequence[Any], order: Any = "any", *people: Person, **more: Any) -> Problem:
    """Return a tour of two rooms with two doors."""
    given = {"criteria": ("hall_zones", "turns", "duration"), **more}
    return through_the_doors(*(people or (WALKER,)), tour=hpop.Tour([*stops], order), **given)


def stands(front: Front, tour: hpop.Tour) -> None:
    """Check each visit of the executions on samples, at the times that are exported."""
    stops = dict(zip(tour.names, tour.stops, strict=True))
    for row, trajectory in enumerate(front.trajectories):
        execution = trajectory.execution()
        made = stop_visits(front, row, executed=True)
        assert {visit.name for visit in made} >= {name for name, stop in stops.items() if not stop.optional}
        for visit in made:
            stop = stops[visit.name]
            states = execution.at(np.linspace(visit.begin, visit.end, 40))
            assert visit.end - visit.begin >= stop.dwell - 1e-6
            assert max(np.ptp(states.x), np.ptp(states.y), np.ptp(states.yaw)) < 1e-9
            assert stop.at is not None
            assert stop.within is not None
            assert np.hypot(states.x - stop.at[0], states.y - stop.at[1]).max() <= stop.within + 1e-6


def test_verification_finds_an_execution_that_stands_too_briefly() -> None:
    problem = toured([{**DOOR, "dwell": 3.0}], criteria=("turns", "length"))
    front = problem.solve("lattice", step=0.5)
    straight = front[(front.costs[:, 0] == 0)]
    assert verify(problem, straight) == []
    longer = replace(problem, tour=hpop.Tour([{**DOOR, "dwell": 4.0}]))
    ((visit,),) = (origin["visits"] for origin in straight.provenance)
    claimed = {**visit, "end": visit["begin"] + 4.0}
    changed = replace(straight, provenance=tuple({**o, "visits": [claimed]} for o in straight.provenance))
    assert verify(longer, changed) == ["trajectory 0, as it is executed, stands at stop 'door' for 3 s"]


@pytest.mark.proof
@pytest.mark.parametrize("planner", ["lattice", {"roadmap": {"samples": 60}}, "any-angle"])
def test_each_planner_that_waits_for_people_stands_at_the_stops(planner: Any) -> None:
    is_sampled = isinstance(planner, dict)  # joins of further states to a roadmap would take long
    problem = toured([{**HALL, "within": 1.0} if is_sampled else HALL, DOOR if is_sampled else CASE])
    options = {} if is_sampled else {"step": 0.5}
    front = problem.solve(planner, **options)
    assert front.status == "complete"
    assert len(front)
    assert problem.tour is not None
    stands(front, problem.tour)
    assert verify(problem, front) == []
    assert "in any order, on a clock of 0.05 s, standing 1 s longer" in front.certificate
    assert f"visiting {' and '.join(problem.tour.names)} in any order" in front.certificate


def test_a_person_who_stands_at_a_stop_delays_its_visit() -> None:
    stop = {"at": (2.0, 2.0), "within": 0.3, "dwell": 2.0}
    stays_until, elsewhere = (Person(x, 2.0, until=12.0, name="Ann") for x in (2.0, 5.5))
    late, early = (
        toured([stop], "any", one, criteria=QUICK).solve("lattice", step=0.5) for one in (stays_until, elsewhere)
    )
    assert min(origin["visits"][0]["begin"] for origin in late.provenance) > 12.0
    assert min(origin["visits"][0]["begin"] for origin in early.provenance) < 5.0


def test_a_stop_where_a_person_stays_is_named_or_missed() -> None:
    stays = Person(1.4, 5.0, velocity=(-0.2, 0.0), until=2.0, afterwards="stays", name="Ann")
    front = toured([CASE, HALL], "given", stays).solve("lattice", step=0.5)
    assert front.status == "no path"
    assert any("people are too near to hall whenever the robot could stand there" in note for note in front.notes)
    optional = toured([{**HALL, "optional": True}], "given", stays, criteria=("turns", "duration", "stops_missed"))
    assert set(optional.solve("lattice", step=0.5).costs[:, 2]) == {1.0}


def test_more_than_64_sets_of_stops_are_refused_among_people_who_move() -> None:
    stops = [{"at": (1.0, 3.0 + 0.3 * i), "within": 0.5} for i in range(7)]
    with pytest.raises(QueryError, match="at most 64 sets of visited stops"):
        toured(stops).solve("lattice", step=0.5)
    with pytest.raises(QueryError, match="leave stop_states out"):
        toured(stops[:2]).solve("lattice", step=0.5, stop_states=1)


def test_a_stop_behind_walls_is_named_among_people_too() -> None:
    walls = shapely.box(0.6, 4.6, 1.4, 5.4).boundary.buffer(0.05)
    problem = toured([HALL])
    world = World.from_polygons([walls], extent=shapely.box(0, 0, 6, 6)).with_content(people=(WALKER,))
    start, goal, stop = (3.0, 1.0, 0.0), (5.0, 1.0, None), {"at": (1.0, 5.0), "within": 0.05, "name": "hall"}
    closed = Problem(world, problem.model, start, goal, problem.criteria, tour=hpop.Tour([stop]))
    front = closed.solve("lattice", step=0.5)
    assert front.status == "no path"
    assert any("stop 'hall' cannot be reached from the start" in note for note in front.notes)


@pytest.mark.proof
def test_limits_precision_and_checkpoints_work_as_without_a_tour(tmp_path: Path) -> None:
    problem = toured([HALL, CASE])
    exact = problem.solve("lattice", step=0.5)
    rough = problem.solve("lattice", step=0.5, eps=0.2)
    assert (exact.costs[:, None] * 1.21 + 0.1 >= rough.costs[None]).all(axis=2).any(axis=1).all()
    assert len(rough) <= len(exact)
    saved = {"checkpoint": str(tmp_path / "search"), "step": 0.5}
    stopped = problem.solve("lattice", **saved, max_labels=5)
    assert stopped.status == "label limit"
    assert verify(problem, stopped) == []
    assert problem.solve("lattice", **saved).costs == pytest.approx(exact.costs)


@pytest.mark.parametrize("optional", [False, True])
def test_a_tour_whose_stops_are_all_at_the_start_and_goal_needs_no_motion(optional: bool) -> None:
    here = {"at": (1.0, 2.0), "within": 0.3, "name": "here"}
    stops = [here, *[{**HALL, "optional": True}] * optional]
    criteria = ("turns", "duration", *["stops_missed"] * optional)
    problem = toured(stops, criteria=criteria)
    front = replace(problem, goal=(1.0, 2.0, None)).solve("lattice", step=0.5)
    assert any(not len(trajectory) for trajectory in front.trajectories)
    assert len(front) == (1 if not optional else len(front)) > 0
    assert verify(replace(problem, goal=(1.0, 2.0, None)), front) == []
