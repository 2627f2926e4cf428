"""Fronts over speeds are those of a label setting that shares no code with hpop's graphs and searches.

Positions, moves, turns, joins of the goal, durations and changes of speed are computed here, from the geometry of
boxes and discs. Only the criteria are hpop's, each evaluated on one motion at a time.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import trajectory_cost
from hpop.criteria.costs import trajectory_costs
from hpop.errors import QueryError
from hpop.motions import States, laws_of
from hpop.planners.graph_planners import Lattice
from hpop.planners.spending import Limits
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.trajectories.trajectory import Trajectory

Costs = tuple[int, ...]
Node = tuple[float, float, int, int]
"""Position, m, number of the heading, number of the speed: 0 is rest."""
SIZE, RADIUS, HEADINGS = (4, 3), 0.3, 4
ACROSS = 2 * np.pi / HEADINGS
CRITERIA = [
    ["duration", "turns", {"exposure": {"radius": 0.8}}],
    ["duration", "speed_changes", "felt_acceleration"],
    ["proximity", "duration", "turns"],
    ["peak_optic_flow", "duration"],
    ["length", "turns", "speed_changes"],
]


class Oracle:
    """Own graph of speeds on a grid of 1 m, and own label setting."""

    def __init__(self, problem: Problem, boxes: list[Any], goal: tuple[float, float]) -> None:
        self.problem, self.goal = problem, goal
        self.speeds = (0.0, *problem.model.speed_classes)
        blocked = shapely.union_all(boxes) if boxes else shapely.Point()
        self.blocked = blocked.buffer(RADIUS, quad_segs=64)
        self.known = dict[Any, tuple[float, ...]]()

    def is_free(self, *points: tuple[float, float]) -> bool:
        way = shapely.LineString(points) if len(points) > 1 else shapely.Point(points[0])
        return not self.blocked.intersects(way) and all(-0.2 <= x <= 3.2 and -0.2 <= y <= 2.2 for x, y in points)

    def paid(self, kind: str, *states: tuple[float, float, float, float]) -> tuple[float, ...]:
        """Return the costs of one motion between two states (x, y, yaw, speed)."""
        key = (kind, *np.round(states, 9).ravel().tolist())
        if key not in self.known:
            columns = dict(zip(("x", "y", "yaw", "speed"), np.array(states, float).T, strict=True))
            if kind.startswith("turn"):
                del columns["speed"]
            motion, world = Trajectory(self.problem.model, States(**columns), (kind,)), self.problem.world
            self.known[key] = tuple(trajectory_cost(c, motion, world) for c in self.problem.criteria)
        return self.known[key]

    def counted(self, *motions: tuple[float, ...]) -> Costs:
        """Return the costs of some motions of one arc, in quanta, rounded up once."""
        joined = []
        for criterion, values in zip(self.problem.criteria, zip(*motions, strict=True), strict=True):
            total = max(values) if criterion.aggregate == "max" else sum(values)
            joined.append(int(np.ceil(total / criterion.quantum - 1e-6)))
        return tuple(joined)

    def add(self, a: Costs, b: Costs) -> Costs:
        each = zip(self.problem.criteria, a, b, strict=True)
        return tuple(max(u, v) if criterion.aggregate == "max" else u + v for criterion, u, v in each)

    def turn(self, x: float, y: float, yaw: float, to: float) -> Iterator[tuple[float, ...]]:
        by = np.angle(np.exp(1j * (to - yaw)))
        by = np.pi if np.isclose(by, -np.pi) else by
        if abs(by) > 1e-9:
            for kind in (k for k in laws_of(self.problem.model) if k.startswith("turn")):  # one for each turn rate
                yield self.paid(kind, (x, y, yaw, 0.0), (x, y, yaw + by, 0.0))

    def successors(self, node: Node) -> Iterator[tuple[Node | None, Costs]]:
        x, y, heading, number = node
        yaw, speed = heading * ACROSS, self.speeds[number]
        for other in range(len(self.speeds)):  # changes: from and to rest, and to neighbours
            if other != number and (0 in (number, other) or abs(other - number) == 1):
                change = self.paid("speed_change", (x, y, yaw, speed), (x, y, yaw, self.speeds[other]))
                yield (x, y, heading, other), self.counted(change)
        if number == 0:
            for other in range(HEADINGS):
                for motion in self.turn(x, y, yaw, other * ACROSS):
                    yield (x, y, other, 0), self.counted(motion)
        else:
            dx, dy = round(np.cos(yaw)), round(np.sin(yaw))
            if self.is_free((x, y), (x + dx, y + dy)):
                move = self.paid("move", (x, y, yaw, speed), (x + dx, y + dy, yaw, speed))
                yield (x + dx, y + dy, heading, number), self.counted(move)
        yield from self.to_goal(node)

    def to_goal(self, node: Node) -> Iterator[tuple[None, Costs]]:
        """Yield the ways to the goal, which may have any heading: at its place at rest, or by a join."""
        (x, y, heading, number), (gx, gy) = node, self.goal
        if (gx, gy) == (x, y):
            if number == 0:
                yield None, (0,) * len(self.problem.criteria)
            return
        if (gx, gy) in set(product(map(float, range(SIZE[0])), map(float, range(SIZE[1])))):
            return
        if np.hypot(gx - x, gy - y) > 1.5 or not self.is_free((x, y), (gx, gy)):
            return
        yaw, ahead = heading * ACROSS, float(np.arctan2(gy - y, gx - x))
        turns = list(self.turn(x, y, yaw, ahead))
        for (other, speed), turn in product(enumerate(self.speeds), turns or [None]):
            if other and number == (0 if turns else other):
                starts = [self.paid("speed_change", (x, y, ahead, 0.0), (x, y, ahead, speed))] if turns else []
                move = self.paid("move", (x, y, ahead, speed), (gx, gy, ahead, speed))
                stops = self.paid("speed_change", (gx, gy, ahead, speed), (gx, gy, ahead, 0.0))
                yield None, self.counted(*([turn] if turn else []), *starts, move, stops)

    def front(self, start: tuple[float, float], heading: int = 0, number: int = 0) -> set[Costs]:
        """Return the non-dominated costs from a start with a heading and a speed, by their numbers."""
        nothing = (0,) * len(self.problem.criteria)
        labels, found = defaultdict[Node, set[Costs]](set), set[Costs]()
        heap: list[tuple[Costs, Node | None]] = [(nothing, (*start, heading, number))]
        order = {heap[0]}
        while heap:
            cost, node = heapq.heappop(heap)
            known = found if node is None else labels[node]
            if any(all(a <= b for a, b in zip(other, cost, strict=True)) for other in (*known, *found)):
                continue
            known -= {other for other in known if all(a <= b for a, b in zip(cost, other, strict=True))}
            known.add(cost)
            for to, paid in self.successors(node) if node is not None else ():
                label = (self.add(cost, paid), to)
                if label not in order:
                    order.add(label)
                    heapq.heappush(heap, _Label(label))
        return found


class _Label(tuple):  # type: ignore[type-arg]
    """Cost and node, ordered by cost alone."""

    def __new__(cls, label: tuple[Costs, Node | None]) -> _Label:
        return super().__new__(cls, label)

    def __lt__(self, other: tuple[Any, ...]) -> bool:
        return bool(self[0] < other[0])


def drawn(seed: int, *, one: bool = False) -> tuple[Problem, Oracle, tuple[float, float]]:
    """Return a small problem with two or three speeds and one or two turn rates, or one of each, and its oracle."""
    rng = np.random.default_rng(seed)
    boxes = [shapely.box(x, y, x + 0.5, y + 0.5) for x, y in rng.uniform(0, 3, (rng.integers(0, 3), 2))]
    world = hpop.World.from_polygons(boxes, extent=shapely.box(-0.5, -0.5, SIZE[0] - 0.5, SIZE[1] - 0.5))
    (sx, sy), (gx, gy) = ((float(x), float(y)) for x, y in rng.integers(0, SIZE, (2, 2)))
    if rng.random() < 0.4 and gx < 3:  # a goal beside the lattice
        gx += 0.3
    speeds = sorted(rng.choice([0.25, 0.5, 0.8, 1.0, 1.5], 1 if one else rng.integers(2, 4), replace=False).tolist())
    acceleration = float(rng.choice([0.5, 1.0, 2.0]))
    rates = sorted(rng.choice([0.3, 0.8, 1.5, 3.0], 1 if one else 1 + seed % 2, replace=False).tolist())
    camera = (0.1 * (seed % 2), 0.0)  # beside the axis, a slower turn is felt less
    limits = {"speeds": speeds, "turn_rates": rates, "acceleration": acceleration}
    robot = hpop.DifferentialDrive(radius=RADIUS, camera_offset=camera, **limits)
    criteria = CRITERIA[seed % len(CRITERIA)]
    problem = Problem(world, robot, (sx, sy, 0.0), (gx, gy, None), criteria)
    return problem, Oracle(problem, boxes, (gx, gy)), (sx, sy)


@pytest.mark.seeds(3, of=80)
def test_the_front_is_that_of_an_own_label_setting_over_paths_and_speeds(seed: int) -> None:
    problem, oracle, start = drawn(seed)
    planner = Lattice(step=1.0, headings=HEADINGS)
    try:
        query = planner.query(problem)
    except QueryError:
        pytest.skip("start or goal is blocked")
    wanted = oracle.front(start)
    assert set(map(tuple, query.paths(Limits()).costs.tolist())) == wanted
    candidates = planner.solve(problem)
    again = trajectory_costs(candidates.objectives, candidates.trajectories, problem.world)
    assert (np.abs(again - candidates.planned) <= candidates.tolerance + 1e-9).all()
    front = problem.solve(planner)
    assert bool(wanted) == bool(len(front))
    assert verify(problem, front) == []
    for trajectory in front.trajectories:
        executed_as_planned(trajectory)


def executed_as_planned(trajectory: Trajectory) -> None:
    """Check an execution by integrating its wheels: it ends where the plan does, no later, within all limits."""
    robot, run = trajectory.model, trajectory.execution()
    assert run.duration <= trajectory.duration + 1e-9
    if not len(run):  # the start is the goal
        return
    ends = np.unique(np.concatenate([run.times, np.arange(0.0, run.duration, 0.01)]))
    times = np.sort(np.concatenate([ends[:-1] + 1e-9, 0.5 * (ends[:-1] + ends[1:]), ends[1:] - 1e-9]))
    track = robot.wheels(run, times)
    for speed, change in ((track.left_speed, track.left_acceleration), (track.right_speed, track.right_acceleration)):
        assert np.abs(speed).max() <= robot.wheel_speed + 1e-9
        assert np.abs(change).max() <= robot.wheel_acceleration + 1e-6
    v, turn_rate = 0.5 * (track.left_speed + track.right_speed), track.right_speed - track.left_speed
    turn_rate = turn_rate / robot.wheel_base
    begin, yaw, x, y = 0, run.states.yaw[0], run.states.x[0], run.states.y[0]
    for begin, lasts in zip(range(0, times.size, 3), np.diff(ends).tolist(), strict=True):
        speeds, rates = v[begin : begin + 3], turn_rate[begin : begin + 3]
        half = yaw + lasts / 24 * (5 * rates[0] + 8 * rates[1] - rates[2])
        after = yaw + lasts / 6 * (rates[0] + 4 * rates[1] + rates[2])
        headings = np.array([yaw, half, after])
        x += lasts / 6 * np.dot([1, 4, 1], speeds * np.cos(headings))
        y += lasts / 6 * np.dot([1, 4, 1], speeds * np.sin(headings))
        yaw = after
        here = run.at(float(ends[begin // 3 + 1]))
        assert np.hypot(here.x[0] - x, here.y[0] - y) < 1e-4  # a turn has kinks within a step
    assert np.hypot(trajectory.states.x[-1] - x, trajectory.states.y[-1] - y) < 1e-4
    assert abs(trajectory.states.yaw[-1] - yaw) < 1e-4
    classes_kept(trajectory, run, times, v)


def classes_kept(trajectory: Trajectory, run: Trajectory, times: Any, speed: Any) -> None:
    """Check that the execution is nowhere faster than the class that is planned there."""
    passed = trajectory.model.execution(trajectory)[1]
    moves = np.array(["x" in laws_of(trajectory.model)[kind].varies for kind in trajectory.kinds], dtype=bool)
    for i in np.flatnonzero(moves).tolist():
        within = (times > passed[i]) & (times < passed[i + 1])
        assert speed[within].max(initial=0.0) <= trajectory.states.speed[i] + 1e-6
        at = run.at(passed[[i, i + 1]])
        planned = trajectory.states.take([i, i + 1])
        assert np.hypot(at.x - planned.x, at.y - planned.y).max() < 1e-6


def kept(costs: set[Costs]) -> set[Costs]:
    """Return the non-dominated ones of some costs."""
    return {c for c in costs if not any(o != c and all(a <= b for a, b in zip(o, c, strict=True)) for o in costs)}


@pytest.mark.seeds(3, of=40)
def test_a_tour_of_stops_at_rest_is_the_filtered_sum_of_the_fronts_between_them(seed: int) -> None:
    problem, *_ = drawn(2000 + seed)
    rng = np.random.default_rng(seed)
    (x, y, heading), dwell = rng.integers(0, (*SIZE, HEADINGS)).tolist(), 2.0
    stop, criteria = [float(x), float(y), heading * ACROSS], ["duration", "turns", "felt_acceleration"]
    planner, tour = Lattice(step=1.0, headings=HEADINGS), hpop.Tour([{"goal": stop, "dwell": dwell}])
    ends = {"world": problem.world, "model": problem.model, "criteria": criteria}
    try:
        toured = Problem(start=problem.start, goal=problem.goal, tour=tour, **ends)
        there = planner.query(Problem(start=problem.start, goal=stop, **ends)).paths(Limits()).costs
        onward = planner.query(Problem(start=stop, goal=problem.goal, **ends)).paths(Limits()).costs
        found = planner.query(toured).paths(Limits()).costs
    except QueryError:
        pytest.skip("start, stop or goal is blocked")
    held = np.array([round(dwell / 1e-6), 0, 0])
    wanted = kept({tuple((a + b + held).tolist()) for a in there for b in onward})
    assert set(map(tuple, found.tolist())) == wanted
    assert verify(toured, toured.solve(planner)) == []


@pytest.mark.seeds(3, of=20)
def test_one_speed_in_a_list_changes_nothing(seed: int) -> None:
    problem, _, _ = drawn(seed, one=True)
    robot = problem.model
    assert isinstance(robot, hpop.DifferentialDrive)
    limits = {"speed": robot.speed, "turn_rate": robot.turn_rate, "acceleration": robot.acceleration}
    alone = hpop.DifferentialDrive(radius=RADIUS, camera_offset=robot.camera_offset, **limits)
    assert alone == robot
    before = Problem(problem.world, alone, problem.start, problem.goal, list(problem.criteria))
    try:
        fronts = [each.solve("lattice", step=0.5) for each in (before, problem)]
    except QueryError:
        pytest.skip("start or goal is blocked")
    assert fronts[0].costs.tobytes() == fronts[1].costs.tobytes()
    assert [t.kinds for t in fronts[0].trajectories] == [t.kinds for t in fronts[1].trajectories]
    assert fronts[0].certificate == fronts[1].certificate
