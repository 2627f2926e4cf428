"""Tests of motion primitives and their lattice: closed, within the car's limits, free, and with exact costs."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import OptionError, QueryError, UnsupportedModel
from hpop.models.ackermann.primitives import HEADING_ANGLES, LEGS, primitives
from hpop.motions import States
from hpop.planners.graphs import PrimitivesGraph
from hpop.planners.objectives import edge_objectives
from hpop.planners.searches import Exact
from hpop.scenario import load_scenario
from hpop.world import Person
from tests.search.conftest import front_by_closure

CAR = hpop.Ackermann()
ROOM = hpop.World.from_polygons([shapely.box(4, 0, 4.3, 2.5)], extent=shapely.box(0, 0, 8, 6))
PROBLEM = hpop.Problem(ROOM, CAR, (1.5, 2.0, 0.3), (6.5, 2.0, -1.2), ["length", "turns"])
COARSE = PrimitivesGraph(step=0.5)
KNOWN = primitives()


def runge_kutta(begin: float, end: float, length: float, yaw: float, steps: int) -> np.ndarray:
    """Return x, y and yaw after driving from the origin, while the curvature changes evenly between two values."""

    def slope(s: float, pose: np.ndarray) -> np.ndarray:
        return np.array([math.cos(pose[2]), math.sin(pose[2]), begin + (end - begin) * s / length])

    pose, h = np.array([0.0, 0.0, yaw]), length / steps
    for i in range(steps):
        s = i * h
        a = slope(s, pose)
        b = slope(s + h / 2, pose + h / 2 * a)
        c = slope(s + h / 2, pose + h / 2 * b)
        pose = pose + h / 6 * (a + 2 * b + 2 * c + slope(s + h, pose + h * c))
    return pose


def shape_of(number: int):
    """Return the shape of the clothoids of one primitive, from the poses between them, as the car's law sees them."""
    knots, legs = KNOWN.knots[number], np.flatnonzero(KNOWN.lengths[number] > 0)
    states = States(**dict(zip(("x", "y", "yaw"), knots.T, strict=True)))
    return CAR.laws["clothoid"].shape(states.take(legs), states.take(legs + 1))


@pytest.mark.parametrize(
    "number", [0, 5, 7, *(pytest.param(i, marks=pytest.mark.proof) for i in range(8, KNOWN.tail.size))]
)
def test_a_primitive_ends_on_the_lattice_by_runge_kutta(number):
    shape = shape_of(number)
    begin, end = shape.curvature(0.0), shape.curvature(1.0)
    assert abs(begin[0]) < 1e-9  # wheels straight ahead
    assert abs(end[-1]) < 1e-9
    assert begin[1:] == pytest.approx(end[:-1], abs=1e-9)
    pose = np.array([0.0, 0.0, HEADING_ANGLES[KNOWN.tail[number]]])
    for ends in zip(begin, end, shape.length, strict=True):
        way = runge_kutta(*ends, pose[2], 150)
        pose = np.array([*(pose[:2] + way[:2]), way[2]])
    assert pose[:2] == pytest.approx(KNOWN.step[number], abs=1e-9)
    assert abs(math.remainder(pose[2] - HEADING_ANGLES[KNOWN.head[number]], 2 * math.pi)) < 1e-9


def test_primitives_keep_the_limits_they_state():
    shapes = [shape_of(number) for number in range(KNOWN.tail.size)]
    assert max(np.abs([s.curvature(0.0), s.curvature(1.0)]).max() for s in shapes) <= KNOWN.curvature + 1e-9
    assert max(np.abs(s.sharpness).max() for s in shapes) <= KNOWN.sharpness + 1e-9


def test_primitives_are_symmetric_and_have_different_ends():
    """A quarter turn of every primitive is one, and so is its mirror image at the x axis."""
    rows = {(t, *step, h % 16) for t, step, h in zip(KNOWN.tail, KNOWN.step.tolist(), KNOWN.head, strict=True)}
    assert len(rows) == KNOWN.tail.size
    assert {((t + 4) % 16, -dy, dx, (h + 4) % 16) for t, dx, dy, h in rows} == rows
    assert {(-t % 16, dx, -dy, -h % 16) for t, dx, dy, h in rows} == rows


def test_the_smallest_step_is_that_of_the_radius_or_of_the_steering_rate():
    least = KNOWN.least_step(CAR)
    assert least == pytest.approx(math.sqrt(CAR.speed * CAR.wheelbase * KNOWN.sharpness / CAR.steering_rate))
    assert KNOWN.least_step(hpop.Ackermann(steering_rate=None)) == pytest.approx(KNOWN.curvature * CAR.radius)
    with pytest.raises(OptionError, match=r"steering allows steps of 0\.4 m or more"):
        PROBLEM.solve({"exact": {"on": {"primitives": {"step": 0.3}}}})


@pytest.fixture(scope="module")
def front():
    return PROBLEM.solve({"exact": {"on": COARSE.spec}})


@pytest.fixture(scope="module")
def lattice():
    return COARSE.lattice(PROBLEM)


def test_plans_begin_and_end_exactly_and_keep_the_steering_limits(front):
    """Steering angles and rates are computed from the velocities; the wheels do not slide."""
    assert front.status == hpop.Status.COMPLETE.value
    for trajectory in front.trajectories:
        start, end = (PROBLEM.model.space.values(trajectory.states.take([i])) for i in (0, -1))
        assert start == pytest.approx(PROBLEM.start, abs=1e-9)
        assert end[:2] == pytest.approx(PROBLEM.goals[0][:2], abs=1e-9)
        assert abs(math.remainder(end[2] - PROBLEM.goals[0][2], 2 * math.pi)) < 1e-9
        done = trajectory.execution()
        for driven in (trajectory, done):
            assert not list(CAR.faults(driven))
        times = np.linspace(0, done.duration, 3000)
        states, (rates, _) = done.at(times), done.rates(times)
        speed = rates.x * np.cos(states.yaw) + rates.y * np.sin(states.yaw)
        assert np.abs(rates.y * np.cos(states.yaw) - rates.x * np.sin(states.yaw)).max() < 1e-9
        moves = np.abs(speed) > 0.05
        angle = np.arctan(CAR.wheelbase * rates.yaw[moves] / speed[moves])
        assert np.abs(angle).max() <= CAR.steering + 1e-6
        together = np.diff(np.flatnonzero(moves)) == 1
        assert (np.abs(np.diff(angle)) / times[1])[together].max() <= CAR.steering_rate + 1e-2


def test_runge_kutta_follows_a_plan_with_the_steering_angles_of_its_motions(front):
    trajectory, names = front.trajectories[0], ("x", "y", "yaw")
    pose = np.array([float(getattr(trajectory.states, name)[0]) for name in names])
    for i, kind in enumerate(trajectory.kinds):
        one = CAR.laws[kind].shape(trajectory.states.take([i]), trajectory.states.take([i + 1]))
        way = runge_kutta(one.curvature(0.0)[0], one.curvature(1.0)[0], one.length[0], pose[2], 60)
        pose = np.array([*(pose[:2] + way[:2]), way[2]])
    assert pose == pytest.approx([float(getattr(trajectory.states, name)[-1]) for name in names], abs=1e-8)


def test_what_the_lattice_calls_free_is_free_by_the_judge(lattice):
    arcs = lattice.arcs
    some = np.random.default_rng(0).choice(arcs.heads.size, 40, replace=False)
    tails = np.searchsorted(arcs.start, some, side="right") - 1
    judge = CAR.judge(ROOM)
    for _, motions in lattice.chains(tails, arcs.heads[some].astype(np.int64)).motions():
        assert judge.motions_free(motions).all()


@pytest.mark.proof
def test_costs_are_those_of_the_chains(lattice):
    """Also those that are computed once for each primitive, and of primitives driven backwards."""
    names = ["length", "duration", "turns", "clearance"]
    problem = hpop.Problem(ROOM, CAR, PROBLEM.start, PROBLEM.goal, names)
    criteria = edge_objectives(problem.criteria, "exact").optimised
    graph = lattice.graph(criteria)
    some = np.random.default_rng(1).choice(lattice.arcs.heads.size, 60, replace=False)
    tails = np.searchsorted(lattice.arcs.start, some, side="right") - 1
    each = lattice.chains(tails, lattice.arcs.heads[some].astype(np.int64)).costs(criteria)
    assert np.abs(graph.costs[some] - each).max() <= 1


def test_a_goal_heading_that_no_manoeuvre_reaches_is_said_to_be_one():
    """In an alley as wide as the car is long, it can stand across, but not come to stand so."""
    alley = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 1.25))
    problem = hpop.Problem(alley, CAR, (1.0, 0.6, 0.0), (5.0, 0.22, math.pi / 2), ["length"])
    front = problem.solve({"exact": {"on": "primitives"}})
    assert not len(front)
    assert any("no manoeuvre of the car reaches the goal in its heading" in note for note in front.notes)


@pytest.mark.parametrize(("reverse_speed", "width", "turns"), [(0.0, 4.0, False), (0.0, 14.0, True), (0.5, 14.0, True)])
def test_a_car_that_cannot_turn_around_is_told_that_the_heading_is_out_of_reach(reverse_speed, width, turns):
    """It reaches the position with the heading of the lane. Turning needs two radii, 2.3 m, and room for its body."""
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 30, width))
    car = hpop.Ackermann(wheelbase=2.7, reverse_speed=reverse_speed, steering_rate=None)
    found = hpop.Problem(world, car, (3, 2, 0), (20, 2, math.pi), ["length"]).solve({"exact": {"on": "primitives"}})
    assert bool(found.trajectories) is turns
    assert any("not in its heading" in note for note in found.notes) is not turns


def test_planners_that_do_not_consider_time_name_the_one_that_does_for_a_car():
    walker = Person(10, 5, velocity=(-1, 0), name="Ann")
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 20, 10)).with_content(people=[walker])
    problem = hpop.Problem(world, hpop.Ackermann(), (3, 2, 0), (17, 8, 0), ["length"])
    for planner in ("roadmap", {"weighted-sum": {"on": "primitives"}}):
        with pytest.raises(QueryError, match=r"people who move: Ann\. For a robot that steers, use .*on: primitives"):
            problem.solve(planner)


def test_other_robots_are_refused():
    problem = hpop.Problem(ROOM, hpop.DifferentialDrive(), (1, 2, 0), (8, 2, 0), ["length"])
    with pytest.raises(UnsupportedModel, match="exact needs a model with steering"):
        problem.solve({"exact": {"on": "primitives"}})


def test_a_car_that_cannot_reverse_plans_forwards_only():
    car = hpop.Ackermann(reverse_speed=0.0)
    front = hpop.Problem(ROOM, car, (1.5, 2.0, 0.0), (6.0, 4.0, 0.0), ["length"]).solve({"exact": {"on": COARSE.spec}})
    (trajectory,) = front.trajectories
    times = np.linspace(0, trajectory.duration, 500)
    states, (rates, _) = trajectory.at(times), trajectory.rates(times)
    assert (rates.x * np.cos(states.yaw) + rates.y * np.sin(states.yaw)).min() > -1e-9


def test_a_primitive_has_four_legs_or_is_straight():
    legs = (KNOWN.lengths > 0).sum(axis=1)
    assert set(legs.tolist()) == {1, LEGS}


@pytest.mark.proof
def test_the_front_is_that_of_all_paths_of_the_lattice(lattice):
    objectives = edge_objectives(PROBLEM.criteria, "exact")
    every = front_by_closure(lattice.graph(objectives.optimised), lattice.start, set(lattice.goals))
    planned = Exact(COARSE.spec).solve(PROBLEM).planned / [criterion.quantum for criterion in PROBLEM.criteria]
    assert sorted(map(tuple, np.round(planned).tolist())) == sorted(map(tuple, np.array(every, float).tolist()))


@pytest.mark.proof
@pytest.mark.parametrize(
    "planner",
    [{"exact": {"eps": 0.05}}, {"exact": {"max_turns": 4}}, {"weighted-sum": {}}],
    ids=["eps", "turns", "sums"],
)
def test_every_search_runs_on_the_lattice(planner, front):
    """Each finds a part of the exact front, or covers it within its precision."""
    ((name, options),) = planner.items()
    found = PROBLEM.solve({name: {"on": COARSE.spec, **options}})
    assert len(found)
    least = front.costs.min(axis=0)
    assert (found.costs.min(axis=0) <= 1.05 * least + 1e-6).any()
    assert (found.costs >= least - 1e-6).all()


@pytest.mark.proof
def test_a_tour_on_the_lattice_visits_its_stop():
    tour = hpop.Tour([{"at": [3.0, 4.5], "within": 0.6, "dwell": 2.0}])
    problem = hpop.Problem(ROOM, CAR, (1.5, 2.0, 0.3), (6.5, 2.0, -1.2), ["length"], tour=tour)
    for trajectory in problem.solve({"exact": {"on": COARSE.spec}}).trajectories:
        assert "hold" in trajectory.kinds
        at = trajectory.states.take([trajectory.kinds.index("hold")])
        assert math.dist((float(at.x[0]), float(at.y[0])), (3.0, 4.5)) <= 0.6 + 1e-9
        assert not list(CAR.faults(trajectory.execution()))


@pytest.mark.proof
def test_the_car_of_the_example_parks_within_its_limits():
    """The front trades time for felt acceleration; plans and executions keep all limits of the shuttle."""
    problem = load_scenario(Path(__file__).parents[3] / "examples/car_park.yaml").problem
    found = problem.solve({"exact": {"on": "primitives"}})
    assert len(found) > 5
    for trajectory in found.trajectories:
        assert not list(problem.model.faults(trajectory))
        assert not list(problem.model.faults(trajectory.execution()))


@pytest.mark.parametrize(("step", "noted"), [(None, False), (3.5, True)])
def test_a_step_far_beyond_the_smallest_is_remarked_on(step, noted):
    world = hpop.World.from_polygons([], extent=shapely.box(-8, -8, 8, 8))
    front = hpop.Problem(world, hpop.Ackermann(), (0, 0, 0), (3.5, 0, 0), ["length"]).solve(
        {"exact": {"on": {"primitives": {"step": step}}}}
    )
    assert any("tight manoeuvres may be missing" in note for note in front.notes) == noted
