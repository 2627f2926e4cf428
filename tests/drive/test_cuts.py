"""A plan is cut where and when the robot would touch something, whatever it does when it hears of that."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

import hpop
from hpop.drive.closings import Closing
from hpop.drive.known_paths import clear_trajectories
from hpop.drive.plan import Plan, between, cut_of, held, joined
from hpop.trajectories.contacts import contact
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

ROBOT = hpop.DifferentialDrive(radius=0.25)


def plan() -> Plan:
    """East for 2 m, a quarter turn, north for 4 m, metre by metre."""
    poses = [(x, 0.0, 0.0) for x in (0.0, 1.0, 2.0)] + [(2.0, y, np.pi / 2) for y in (0.0, 1.0, 2.0, 3.0, 4.0)]
    return Plan(hpop.Trajectory.from_poses(ROBOT, poses))


def moments(way: hpop.Trajectory, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times and positions, a millisecond apart, from a time on."""
    times = np.arange(t, way.duration, 1e-3)
    states = way.at(times)
    return times, states.x, states.y


WHEN = [0.7, 2.1, 3.0, 4.2, 5.5]
"""s: in a move, three times in the turn, which would take another time if it began or ended there, in a move."""


@pytest.mark.parametrize("t", WHEN)
def test_a_plan_is_cut_when_the_robot_would_come_too_near_to_somebody(t: float) -> None:
    way, margin = plan().announced, 0.1
    assert way.kinds[:3] == ("move", "move", "turn")
    person = Person(2.0 + 0.7 * (6.5 - t), 2.0, velocity=(-0.7, 0.0), until=12.0)  # comes by at 6.5 s
    times, x, y = moments(way, t)
    apart = np.hypot(x - (person.x - 0.7 * (times - t)), y - person.y) - 0.25 - 0.25
    met = float(times[np.argmax(apart < margin)])
    if met < t + 1.0:  # it may still leave the margin, but not touch anybody
        met = float(times[np.argmax(apart < 0.0)])
    assert t < met < 6.9
    cut = cut_of(plan(), t, (), (person,), margin)
    assert cut.safe == pytest.approx(met, abs=0.025)
    assert cut.safe is not None
    assert cut.stops is not None
    assert t <= cut.stops <= cut.safe
    # And somebody who is too early for that cuts nothing.
    early = Person(2.0 + 0.7 * (6.5 - t) - 2.0, 2.0, velocity=(-0.7, 0.0), until=12.0)
    assert np.hypot(x - (early.x - 0.7 * (times - t)), y - 2.0).min() > 0.65
    assert cut_of(plan(), t, (), (early,), margin) == (None, None)


def test_a_robot_that_waits_where_somebody_comes_stands_there() -> None:
    waits = Plan(plan().announced.with_hold(at=0, seconds=3.0))
    comes = Person(-1.5, 0.0, velocity=(1.0, 0.0), until=5.0)  # the surfaces meet after 1 s of the hold's last 2
    cut = cut_of(waits, 1.0, (), (comes,))
    assert cut.safe == pytest.approx(2.0, abs=0.025)
    assert cut.stops == 1.0


@pytest.mark.parametrize("t", WHEN)
def test_a_plan_is_cut_before_what_is_closed(t: float) -> None:
    way, area = plan().announced, shapely.box(1.5, 2.4, 2.5, 2.6)
    times, x, y = moments(way, t)
    met = float(times[np.argmax(shapely.distance(shapely.points(x, y), area) < 0.25)])
    cut = cut_of(plan(), t, (Closing(area),))
    assert cut.safe == pytest.approx(met, abs=2e-3)
    assert cut.stops == way.times[(way.states.y <= 2.0)][-1]


def test_before_the_robot_leaves_people_walk_on() -> None:
    """A person is reported 3 s before the robot leaves, and crosses its path 4 s after it has left."""
    world = hpop.World.from_polygons([], extent=shapely.box(-2, -4, 12, 4))
    problem = hpop.Problem(world, ROBOT, (0.0, 0.0, 0.0), (8.0, 0.0, 0.0), ["length", "turns"])
    drive = hpop.follow(problem, problem.solve("lattice", step=1.0), "least length")
    crosses = Person(4.0, 3.5, velocity=(0.0, -0.5), until=10.0)
    change = drive.world(-3.0, people=[crosses])
    assert change.safe_until == pytest.approx(4.0 - 0.5, abs=0.6)


def punctual() -> Trajectory:
    """East for 5 m, metre by metre, on the clock of its plan, half a second after it was told to."""
    run = Trajectory.from_poses(ROBOT, [(float(x), 0.0, 0.0) for x in range(6)])
    stands = held(Trajectory.from_poses(ROBOT, [(0.0, 0.0, 0.0)]), 0.5)
    way = joined(stands, run)
    return Trajectory(way.model, way.states, way.kinds, punctual=True)


def at_the_goal(when: float) -> Person:
    """Touches a robot at the goal at some time, s, and has gone at once."""
    return Person(5.0, 0.5 + when, velocity=(0.0, -1.0), until=when + 0.03)


@pytest.mark.parametrize("when", [5.6, 5.9])
def test_who_comes_to_the_goal_while_the_robot_stops_there_cuts_a_plan_that_keeps_its_clock(when: float) -> None:
    """As executed it comes to rest v/2a, half a second, after its plan."""
    way, comes = punctual(), at_the_goal(when)
    assert way.duration == 5.5
    assert way.execution().duration == pytest.approx(6.0)
    cut = cut_of(Plan(way), 0.0, (), (comes,), 0.0)
    assert cut.safe == pytest.approx(when, abs=0.025)
    assert cut.stops == 4.5
    assert cut_of(Plan(way), 0.0, (), (at_the_goal(6.1),), 0.0) == (None, None)
    # Where it can no more keep away it comes to the goal.
    late = comes.later(5.2)
    assert cut_of(Plan(way), 5.2, (), (late,), 0.0) == (None, None)


def test_known_ways_are_looked_at_as_a_robot_that_comes_along_executes_them() -> None:
    """A route that began from rest would come to the goal when the person has gone."""
    way, comes = punctual(), at_the_goal(5.8)
    world = hpop.World.from_polygons([], extent=shapely.box(-2, -8, 12, 8)).with_content(people=(comes,))
    problem = hpop.Problem(world, ROBOT, (0.0, 0.0, 0.0), (5.0, 0.0, 0.0), ["length", "turns"])
    before, rest = between(way, 0.0, 3.5), between(way, 3.5, way.duration)
    then = problem.at(ROBOT.space.values(rest.states.take([0])), 3.5)
    assert not contact(ROBOT.parts, then.world.content.people, rest)
    assert not contact(ROBOT.parts, then.world.content.people, rest.execution())
    assert not [*clear_trajectories([rest], then, before, (), 0.0, None, bool)]


def test_a_margin_into_which_somebody_comes_as_a_way_is_taken_may_be_left() -> None:
    """Chosen at 3.5 s, half a second before a person is near: planned so, and driven so."""
    way = punctual()
    comes = Person(3.6, 4.85, velocity=(0.0, -1.0), until=4.12)  # 0.73 m from the axis at the nearest, and gone
    assert cut_of(Plan(way), 1.0, (), (comes.later(1.0),), 0.3).stops is not None
    assert cut_of(Plan(way, chosen=3.5), 1.0, (), (comes.later(1.0),), 0.3) == (None, None)
