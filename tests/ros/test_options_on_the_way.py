"""Options that are offered and taken while a small simulated robot drives."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

import hpop
from hpop.errors import RosError
from hpop.planners.graph_planners import Lattice
from hpop.ros import Interface, PlanarPose, planar_pose
from hpop.ros.follow_drive import UnderWay
from hpop.ros.follow_plans import Ended, FollowPlanner, FollowSettings, Planned, Sighting
from hpop.ros.following import Follower
from hpop.ros.planning import chosen_row
from hpop.simulation.tracking import Tracker
from hpop.world import Person
from tests.ros.robot import AtOnce, Robot, Trip
from tests.ros.test_following import RADIUS, least_gap


@pytest.fixture(scope="module")
def round_a_box() -> FollowPlanner:
    """Return a planner in a hall of 10 x 6 m with a box in its middle."""
    cells = np.zeros((60, 100), np.bool_)
    cells[26:36, 45:55] = True
    model = hpop.DifferentialDrive(radius=RADIUS, speed=0.8)
    criteria = ["turns", "length", "proximity"]
    problem = hpop.Problem(hpop.World.from_cells(cells, 0.1), model, (1, 3, 0), (9, 3, None), criteria)
    return FollowPlanner(problem, [Lattice(step=0.5)], Interface())


def on_the_way(planner: FollowPlanner, *people: Person, **settings: Any) -> tuple[Trip, list[str]]:
    """Return a trip that drives at full speed on a long straight past the box, and a list of what is said from then."""
    said = list[str]()
    follower = Follower(planner, FollowSettings(choice="least length", **settings), AtOnce(), say=said.append)
    trip = Trip(follower, Robot(2.0, 4.0, 0.0))
    follower.saw(people, 0.0)
    follower.follow("a", [PlanarPose(9.0, 3.0, 0.0, "map")], 0.0)
    assert trip.go(20, lambda: trip.robot.v > 0.79)
    said.clear()
    return trip, said


def test_an_option_is_taken_on_the_way_and_the_robot_drives_on(round_a_box):
    trip, said = on_the_way(round_a_box)
    trip.follower.take("least length", trip.now)
    speeds = []
    trip.go(1.5, lambda: speeds.append(trip.robot.v))
    assert min(speeds) > 0.78
    assert "without a stop" in said[-1]
    trip.follower.take("least proximity", trip.now)
    assert trip.go_until_ended().reached
    assert not any(line.startswith("stops") for line in said)
    assert trip.robot.hardest <= 1.0 + 1e-6
    *_, first, second = (event.path for event in trip.events if isinstance(event, Planned))
    lines = [shapely.LineString([planar_pose(pose)[:2] for pose in path["poses"]]) for path in (first, second)]
    assert lines[0].hausdorff_distance(lines[1]) > 0.2
    assert max(lines[1].distance(shapely.Point(place)) for place in trip.robot.passed) < 0.05
    assert least_gap(trip, shapely.box(4.5, 2.6, 5.5, 3.6)) >= 0


def test_among_people_an_option_is_taken_on_the_way_after_a_stop_that_is_said(round_a_box):
    person = Person(6.5, 5.5, velocity=(0.0, -0.5), until=4.0)  # she would be in the way of the robot's side of the box
    trip, said = on_the_way(round_a_box, person)
    gaps, walked = [], trip.now

    def walks() -> bool:
        now = person.later(min(trip.now, 4.0))
        trip.follower.saw([Person(now.x, now.y, velocity=(0.0, -0.5 if trip.now < 4.0 else 0.0), until=4.0)], trip.now)
        gaps.append(math.dist((now.x, now.y), (trip.robot.x, trip.robot.y)) - RADIUS - 0.25)
        return any(isinstance(event, Ended) for event in trip.events)

    trip.follower.take("least proximity", trip.now)
    trip.go(0.2, walks)
    assert "where the robot stops" in said[-1]
    assert trip.state()["state"] == "driving"
    assert trip.go(60, walks)
    assert trip.events[-1].reached
    assert min(gaps) > 0
    assert trip.now > walked + 4.0


def test_options_are_published_on_the_way_and_a_row_is_taken_until_the_robot_is_there(round_a_box):
    trip, said = on_the_way(round_a_box, offers=2.0)
    before = len(trip.events)
    assert trip.go(5, lambda: len(trip.events) > before)
    offer = trip.events[-1].options
    ahead, row = offer["ahead"], offer["named"]["least proximity"]
    assert -0.06 <= ahead["after"] - (ahead["x"] - trip.robot.x) / 0.8 <= 0.46  # if it brakes for a turn there
    trip.go(ahead["until"] - 0.1)
    trip.follower.take(str(row), trip.now)
    assert "the plan changes at" in said[-1]
    cost = dict(zip(offer["rows"], offer["costs"], strict=True))[row]
    with pytest.raises(RosError, match="row 0 belongs to an earlier front"):
        trip.follower.take("0", trip.now)
    trip.go(0.1)
    taken = next(event for event in trip.events[::-1] if event.path is not None)
    assert taken.options["costs"][taken.options["rows"].index(taken.options["chosen"])] == cost


def test_a_row_on_which_the_robot_would_now_meet_a_person_is_not_taken_on_the_way(round_a_box):
    trip, _said = on_the_way(round_a_box, offers=2.0)
    before = len(trip.events)
    assert trip.go(5, lambda: len(trip.events) > before)
    offer = trip.events[-1].options
    row = offer["named"]["least length"]
    assert trip.follower.ahead is not None
    option = chosen_row(trip.follower.ahead[1], "least length").point.trajectory
    seconds, met = offer["ahead"]["after"], option.at(2.0)
    x, y = float(met.x[0]), float(met.y[0])
    person = Person(x, y - 0.5 * (seconds + 2.0), velocity=(0.0, 0.5))  # who comes to the place when the robot does
    trip.follower.saw([person], trip.now)
    run = trip.follower.run
    with pytest.raises(RosError, match="people are elsewhere now"):
        trip.follower.take(str(row), trip.now)
    assert trip.follower.run is run
    trip.follower.saw([Person(0.5, 0.5)], trip.now)  # as if she were seen elsewhere: the way is planned again
    assert trip.go(5, lambda: trip.follower.ahead is not None)
    trip.follower.take("least length", trip.now)
    assert trip.go_until_ended().reached


def test_options_of_a_standing_robot_are_not_driven_once_a_person_walks_at_it(round_a_box):
    trip, _said = on_the_way(round_a_box, Person(9.5, 0.5), asks=True)
    trip.follower.halt(stopped=True)
    assert trip.go(5, lambda: trip.stands)
    trip.follower.halt(stopped=False)
    assert trip.go(5, lambda: trip.state()["state"] == "asks")
    first = trip.follower.offered
    trip.go(5)
    begun, gaps, x, y = trip.now, [], trip.robot.x, trip.robot.y

    def walks() -> bool:
        px = x + 6.0 - 0.8 * (trip.now - begun)
        trip.follower.saw([Person(px, y, velocity=(-0.8, 0.0))], trip.now)
        gaps.append(math.dist((px, y), (trip.robot.x, trip.robot.y)) - RADIUS - 0.25)
        return trip.follower.offered not in (None, first)

    walks()
    with pytest.raises(RosError, match="people are elsewhere now"):
        trip.follower.take("least length", trip.now)
    assert trip.go(2, walks)
    trip.follower.take("least length", trip.now)
    trip.go(14, lambda: walks() and False)
    assert min(gaps) > 0


def test_people_are_predicted_for_places_far_ahead(round_a_box):
    seen = Sighting(round_a_box)
    seen.saw([Person(1.0, 5.0, velocity=(0.5, 0.0))], 0.0)
    (person,) = seen.world_with_people(1.0, 11.0).content.people
    assert (person.x, person.y) == (pytest.approx(6.5), 5.0)


def test_an_option_near_the_goal_is_taken_after_a_stop_that_is_said(round_a_box):
    trip, said = on_the_way(round_a_box)
    assert trip.go(20, lambda: trip.state()["remaining_length"] < 0.5)
    trip.follower.take("least turns", trip.now)
    assert said[-1].startswith("stops: another option was taken")
    assert trip.go_until_ended().reached


def test_a_place_ahead_counts_the_wait_before_the_robot_leaves_and_brakes_by_the_limits_of_the_plan():
    problem = hpop.Problem(
        hpop.World.from_cells(np.zeros((60, 80), bool), 0.1),
        hpop.DifferentialDrive(radius=0.2, speed=0.8),
        (1, 1, 0),
        (7, 5, None),
        ["turns", "length"],
    )
    plan = problem.solve(Lattice(step=0.5)).trajectories[0]
    tracker = Tracker(plan)
    at_once, waiting = (UnderWay.of(plan, tracker, begin).place_ahead(0.0, 0.5) for begin in (0.0, 3.0))
    assert at_once is not None
    assert waiting is not None
    assert waiting.after == pytest.approx(at_once.after + 3.0)
    tracker.limits = replace(tracker.limits, speed=0.1)  # as by a mask
    slowed = UnderWay.of(plan, tracker, 0.0).place_ahead(0.0, 0.5)
    assert slowed is not None
    assert (slowed.latest, slowed.after) == (at_once.latest, at_once.after)
