"""Cars among people: plans and executions never touch a person, by a judge of their own, and fronts are enumerated.

The judge places the car's polygon every 20 ms by shapely, and shares nothing with the planner but positions in time.
"""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely

import hpop
from hpop.models.execution import Ramps
from hpop.motions import HOLD, laws_of
from hpop.planners.graphs import PrimitivesGraph
from hpop.planners.graphs.timed import timed_query
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.planners.graphs.timed.outlines import nearer_than, to_parts
from hpop.planners.objectives import edge_objectives
from hpop.planners.spending import Limits, Spending
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World
from tests.search.timed.enumeration import front_by_enumeration
from tests.search.timed.instances import TimedQuery

CAR = hpop.Ackermann()
FORWARDS = hpop.Ackermann(reverse_speed=0.0, steering_rate=None)
GRAPH = PrimitivesGraph(step=0.5)
STEP = 0.02  # s
TOUCH = 1e-3  # m, by which the judge may err between two moments


def road(*people: Person, car: hpop.Ackermann = CAR, criteria=("length", "duration"), size=(6.0, 2.5), **options):
    """Return a problem on a short road, with a wall in its middle from below."""
    width, height = size
    walls = [shapely.box(width / 2, 0.0, width / 2 + 0.2, 0.4)]
    world = World.from_polygons(walls, extent=shapely.box(0, 0, width, height)).with_content(people=people)
    return Problem(world, car, (0.8, height / 2, 0.0), (width - 1.4, height / 2, 0.0), list(criteria), **options)


def gaps(problem: Problem, driven: Trajectory) -> float:
    """Return the least gap, m, between the car's outline and any person who is there."""
    body, least = shapely.Polygon(problem.model.footprint), math.inf
    times = np.append(np.arange(0.0, driven.duration, STEP), driven.duration)
    states = driven.at(times)
    corners = np.array(body.exterior.coords)
    cos, sin = np.cos(states.yaw)[:, None], np.sin(states.yaw)[:, None]
    x = states.x[:, None] + cos * corners[:, 0] - sin * corners[:, 1]
    y = states.y[:, None] + sin * corners[:, 0] + cos * corners[:, 1]
    outlines = shapely.polygons(np.stack([x, y], axis=2))
    for person in problem.world.content.people:
        px, py = (np.broadcast_to(column, times.shape) for column in person.at(times))
        there = np.broadcast_to(person.there(times), times.shape) > 0
        apart = shapely.distance(outlines, shapely.points(px, py)) - person.radius
        least = min(least, float(apart[there].min(initial=math.inf)))
    return least


def crowd(seed: int) -> list[Person]:
    """Return two people who walk across the road."""
    rng = np.random.default_rng(seed)
    return [
        Person(*rng.uniform([2.0, 0.3], [5.0, 2.2]), velocity=tuple(rng.uniform(-0.5, 0.5, 2)), name=f"P{i}")
        for i in range(2)
    ]


@cache
def front_of(seed: int, margin: float = 0.0):
    problem = road(*crowd(seed))
    return problem, problem.solve({"exact": {"on": GRAPH.spec, "eps": 0.05, "margin": margin}})


SEEDS = [0, *(pytest.param(i, marks=pytest.mark.proof) for i in range(1, 25))]


@pytest.mark.parametrize("seed", SEEDS)
def test_no_plan_touches_a_person_and_executions_keep_its_times(seed):
    """Executions stay within v²/8a of their plans at every moment, so both keep clear of people."""
    problem, front = front_of(seed)
    stray = Ramps.of(CAR).stray
    assert stray == CAR.speed**2 / (8 * CAR.acceleration)
    assert front.status in (hpop.Status.COMPLETE.value, hpop.Status.NO_PATH.value)
    for plan in front.trajectories:
        done = plan.execution()
        assert gaps(problem, plan) > -TOUCH
        assert gaps(problem, done) > -TOUCH
        assert not [*CAR.faults(plan), *CAR.faults(done)]
        times = np.linspace(0.0, plan.duration, 4000)
        planned, driven = plan.at(times), done.at(np.minimum(times, done.duration))
        assert np.hypot(planned.x - driven.x, planned.y - driven.y).max() <= stray + 1e-6
        assert done.duration <= plan.duration + 1e-6


U_TURN = PrimitivesGraph(step=0.6).spec


@pytest.mark.parametrize("car", [hpop.Ackermann(reverse_speed=0.0), pytest.param(CAR, marks=pytest.mark.proof)])
def test_the_parts_of_a_long_arc_are_driven_one_by_one_as_planned(car):
    """An arc of half a circle is planned in two parts, with a stop to steer before each: so it is driven."""
    ann = Person(4.2298, 3.6079, velocity=(-0.3721, -0.4704), name="Ann")
    world = World.from_polygons([], extent=shapely.box(0, 0, 6.5, 5.6)).with_content(people=[ann])
    start, goal = (2.5, 1.6, 0.0), (2.5, 1.6 + 2 * car.radius, math.pi)
    problem = Problem(world, car, start, goal, ["length", "duration"])
    front = problem.solve({"exact": {"on": U_TURN, "eps": 0.02}})
    assert any(pair == ("arc", "arc") for plan in front.trajectories for pair in pairwise(plan.kinds))
    for plan in front.trajectories:
        done = plan.execution()
        assert gaps(problem, plan) > -TOUCH
        assert gaps(problem, done) > -TOUCH
        times = np.linspace(0.0, plan.duration, 4000)
        planned, driven = plan.at(times), done.at(np.minimum(times, done.duration))
        assert np.hypot(planned.x - driven.x, planned.y - driven.y).max() <= Ramps.of(car).stray + 1e-6


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(6))
def test_a_margin_is_kept(seed):
    problem, front = front_of(seed, margin=0.3)
    start = shapely.Point(*problem.start[:2])
    for plan in front.trajectories if all(start.distance(shapely.Point(p.x, p.y)) > 3 for p in crowd(seed)) else ():
        assert gaps(problem, plan) > 0.3 - TOUCH


def test_a_car_waits_for_a_person_or_goes_first():
    """A person crosses where the road is narrow; alone, the car drives straight on."""
    alone = road().solve({"exact": {"on": GRAPH.spec}})
    crossing = Person(3.1, 0.8, velocity=(0.0, 0.25), name="Ann")
    problem = road(crossing)
    front = problem.solve({"exact": {"on": GRAPH.spec}})
    first = front.trajectories[int(front.costs[:, 1].argmin())]
    assert front.costs[:, 0].min() >= alone.costs[:, 0].min() - 1e-6
    assert first.duration > alone.costs[:, 1].min() + 0.9  # at least the stop at the start and at the goal
    assert gaps(problem, first) > 0
    assert "people are assumed to do as predicted" in front.certificate


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(8))
def test_the_front_is_that_of_all_walks_with_waits(seed):
    """All vectors of all walks with holds on a coarse clock, in plain Python, without dominance."""
    rng = np.random.default_rng(seed)
    walker = Person(*rng.uniform([2.4, 0.3], [3.6, 1.5]), velocity=tuple(rng.uniform(-0.4, 0.4, 2)))
    problem = road(walker, car=FORWARDS, size=(4.4, 1.8))
    options = TimeOptions(clock=0.5, hold=1.0, arrive_by=9.0)
    objectives = edge_objectives(problem.criteria, "exact")
    (built,) = GRAPH.toured_graphs(problem, objectives, Spending())
    query = timed_query(built, objectives, problem, options)
    graph = query.timing.timed.graph
    expected = front_by_enumeration(TimedQuery(graph, query.timing.start, tuple(query.goals)))
    paths = query.paths(Limits())
    assert sorted(map(tuple, paths.costs.tolist())) == sorted(expected)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(1, 8))  # with 0, the person stays near the start
def test_no_plan_that_keeps_well_clear_is_missing(seed):
    """Plans are enumerated with waits at the start; each that is 0.5 m clear, even 0.3 s early or late, is covered.

    The times of a plan are computed here: a run of length L lasts L/v, and v/2a before and after it.
    """
    rng = np.random.default_rng(seed)
    walker = Person(*rng.uniform([2.6, 0.5], [3.6, 2.0]), velocity=(rng.uniform(-0.3, 0.3), rng.uniform(0.5, 1.0)))
    world = World.from_polygons([], extent=shapely.box(0, 0, 6, 5)).with_content(people=[walker])
    problem = Problem(world, FORWARDS, (0.8, 2.5, 0.0), (4.6, 3.2, None), ["length", "duration"])
    front, lattice = problem.solve({"exact": {"on": GRAPH.spec}}), GRAPH.lattice(problem)
    half, counted = FORWARDS.speed / (2 * FORWARDS.acceleration), 0
    for nodes in _paths(lattice, 5):
        runs = [nodes[:-1], nodes[-2:]] if len(nodes) > 2 else [nodes]
        ways = [lattice.trajectories([np.array(run)])[0] for run in runs]
        for waits in (0.0, *np.arange(1.0, 6.0, 0.25).tolist()):
            begins, clear, stands = 0.0, math.inf, waits
            for way in ways:
                run = way.with_holds(np.array([0, len(way)]), np.array([stands + half, half]))
                clear = min([clear, *(_apart(problem, run, begins + late, 0.0) for late in (-0.3, 0.0, 0.3))])
                begins, stands = begins + run.duration, 0.0
            if clear > 0.5:
                counted += 1
                length = sum(way.duration for way in ways) * FORWARDS.speed
                slack = np.array([1e-3, 0.05 * (len(nodes) + 2)])
                assert (front.costs <= np.array([length, begins]) + slack).all(axis=1).any()
    assert counted > 40


def _paths(lattice, most: int) -> list[list[int]]:
    """Return all paths of a lattice from its start to a goal with at most some arcs."""
    found, open_paths = list[list[int]](), [[lattice.start]]
    while open_paths:
        path = open_paths.pop()
        for head in lattice.arcs.heads[slice(*lattice.arcs.start[path[-1] : path[-1] + 2])].tolist():
            if head in lattice.goals:
                found.append([*path, head])
            elif len(path) < most:
                open_paths.append([*path, head])
    return found


@pytest.mark.proof
def test_a_run_stands_before_and_after_it_and_turns_around_only_at_rest():
    """Start and stop take v/2a each, by the speed in their direction; directions change only where the car stands."""
    car = hpop.Ackermann(steering_rate=None)
    walker = Person(5.5, 2.3, velocity=(0.05, 0.0))
    world = World.from_polygons([], extent=shapely.box(0, 0, 6, 4)).with_content(people=[walker])
    problem = Problem(world, car, (2.0, 1.0, 0.0), (2.0, 3.0, 0.0), ["length", "duration"])
    front = problem.solve({"exact": {"on": GRAPH.spec, "eps": 0.1}})
    assert len(front)
    for plan in front.trajectories:
        way, held, pauses = 0.0, 0.0, list[tuple[float, float, float]]()
        for i, kind in enumerate(plan.kinds):
            start, end = plan.states.take([i]), plan.states.take([i + 1])
            if kind == HOLD.kind:
                held += float(end.clock[0] - start.clock[0])
                continue
            length = float(laws_of(car)[kind].shape(start, end).length[0])
            if length * way <= 0.0:
                pauses.append((way, held, length))
            way, held = length, 0.0
        pauses.append((way, held, 0.0))
        for before, stood, after in pauses:
            needed = sum(_speed(car, each) / (2 * car.acceleration) for each in (before, after))
            assert stood >= needed - 1e-9


def _speed(car: hpop.Ackermann, length: float) -> float:
    return car.speed * (length > 0) + car.reverse_speed * (length < 0)


@pytest.mark.parametrize("seed", [0, *(pytest.param(i, marks=pytest.mark.proof) for i in range(1, 6))])
def test_an_open_departure_is_free_even_early_or_late_and_ahead_or_behind(seed):
    """Judged are departures beside blocked ones: 0.2 s early or late, the car v²/8a ahead of its plan or behind."""
    problem = road(*crowd(seed))
    (built,) = GRAPH.toured_graphs(problem, edge_objectives(problem.criteria, "exact"), Spending())
    timed = timed_query(built, edge_objectives(problem.criteria, "exact"), problem, TimeOptions()).timing.timed
    graph, runs, rng = timed.graph, built.ends.space, np.random.default_rng(seed)
    beside = graph.blocked[:, 4:-1] & ~graph.blocked[:, 5:]  # open again, after a person has passed
    beside = np.concatenate([np.zeros((len(beside), 5), bool), beside], axis=1)
    beside[:, 5:-1] |= ~graph.blocked[:, 5:-1] & graph.blocked[:, 6:]  # the last before a person comes
    rows, ticks = np.nonzero(beside & ~graph.blocked)
    assert rows.size > 100
    some = rng.choice(rows.size, 60, replace=False)
    stray = Ramps.of(CAR).stray
    for row, tick in zip(rows[some].tolist(), ticks[some].tolist(), strict=True):
        begins = tick * timed.clock.tick
        for _, motions in runs.legs(graph.timed[[row]].astype(np.int64)):
            lasts = float(np.broadcast_to(motions.duration, 1)[0])
            if motions.kind != HOLD.kind:
                way = Trajectory(CAR, _both(motions), (motions.kind,))
                ahead = stray / _speed(CAR, float(motions.law.shape(motions.start, motions.end).length[0]))  # s
                for off in (-1.0, 0.0, 1.0):
                    for late in (-0.2, 0.0, 0.2):
                        assert _apart(problem, way, begins + late, off * ahead) > -TOUCH
            begins += lasts


def _both(motions) -> hpop.motions.States:
    """Return the states before and after a single motion."""
    ends = motions.start, motions.end
    names = CAR.space.names
    return hpop.motions.States(**{n: np.concatenate([getattr(state, n) for state in ends]) for n in names})


def _apart(problem: Problem, way: Trajectory, begins: float, ahead: float) -> float:
    """Return the least gap, m, of a motion that begins at a time, s, to people, where it is ahead by some time, s."""
    times = np.linspace(0.0, way.duration, 40 + int(20 * way.duration))
    states = way.at(np.clip(times + ahead, 0.0, way.duration))
    corners = np.array(CAR.footprint)
    cos, sin = np.cos(states.yaw)[:, None], np.sin(states.yaw)[:, None]
    x = states.x[:, None] + cos * corners[:, 0] - sin * corners[:, 1]
    y = states.y[:, None] + sin * corners[:, 0] + cos * corners[:, 1]
    outlines, least = shapely.polygons(np.stack([x, y], axis=2)), math.inf
    for person in problem.world.content.people:
        when = np.maximum(begins + times, 0.0)
        px, py = (np.broadcast_to(column, times.shape) for column in person.at(when))
        there = np.broadcast_to(person.there(when), times.shape) > 0
        apart = shapely.distance(outlines, shapely.points(px, py)) - person.radius
        least = min(least, float(apart[there].min(initial=math.inf)))
    return least


@pytest.mark.parametrize("count", [1, 2, 4])
def test_outlines_are_nearer_than_a_distance_where_shapely_says_so(count):
    rng = np.random.default_rng(count)
    parts = CAR.parts
    yaw, least = rng.uniform(-4, 4, 3000), rng.uniform(0.0, 1.0, 3000)
    if count == 4:  # strips
        a, b, c = (rng.normal(0, 1.5, (3000, 2)) for _ in range(3))
        points = [a, b, b + c, a + c]
    else:
        points = [rng.normal(0, 1.5, (3000, 2)) for _ in range(count)]
    corners = [(p[:, 0], p[:, 1]) for p in points]
    assert (nearer_than(parts, yaw, corners, least) == (to_parts(parts, yaw, corners) < least)).all()
