"""Claims: contact with people who move is found when it happens, of sure and of uncertain ones, whatever the robot."""

import math

import numpy as np
import pytest
import shapely
from scipy.stats import norm

from hpop.models import DifferentialDrive
from hpop.models.collision import Part
from hpop.motions import States
from hpop.problems.problem import Problem
from hpop.problems.verify import verify
from hpop.trajectories.contacts import contact, distance_to_outline
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Future, Person, Track, World

ROOM = World.from_polygons([], extent=shapely.box(0, -3, 10, 3))
ROBOT = DifferentialDrive(radius=0.25, speed=1.0)
STRAIGHT = Trajectory.from_poses(ROBOT, [(1, 0, 0), (9, 0, 0)])  # at 1 m/s from x = 1


def touched(person, trajectory=STRAIGHT, margin=0.0, robot=ROBOT):
    return contact(robot.parts, [person], trajectory, margin)


def test_who_comes_towards_the_robot_is_touched_when_the_gap_closes():
    """1 m/s each, 8 m apart, bodies of 0.25 m: after (8 - 0.5) / 2 seconds."""
    assert touched(Person(9.0, 0.0, velocity=(-1, 0), name="Ann")) == "touches Ann at 3.76 s"


@pytest.mark.parametrize(("aside", "margin", "near"), [(0.51, 0.0, False), (0.51, 0.1, True), (0.49, 0.0, True)])
def test_who_passes_beside_is_as_near_as_the_bodies_are(aside, margin, near):
    assert bool(touched(Person(9.0, aside, velocity=(-1, 0)), margin=margin)) == near


def test_who_is_gone_by_then_or_not_yet_there_is_not_touched():
    assert not touched(Person(5.0, 0.0, until=3.0))
    assert touched(Person(5.0, 0.0, until=4.0)) == "touches person 0 at 3.51 s"


def test_one_that_holds_lets_people_pass():
    crosses = Person(5.0, -3.0, velocity=(0, 0.8))
    assert touched(crosses)
    assert not touched(crosses, STRAIGHT.with_hold(at=0, seconds=4.0))


def test_several_futures_count_by_their_weight():
    head_on, aside = {"velocity": (-1.0, 0.0)}, {"velocity": (0.0, 1.0)}
    for weight, near in ((0.04, False), (0.06, True)):
        futures = (Future(weight, **head_on), Future(1 - weight, **aside))
        assert bool(touched(Person(9.0, 0.0, futures=futures))) == near


@pytest.mark.parametrize("sigma", [0.2, 0.5])
def test_an_uncertain_place_counts_by_its_share(sigma):
    """Beside a long straight edge the share is that of a half-plane: the robot is a wide box, the person a point."""
    wide = DifferentialDrive(footprint=((20.0, 0.2), (-20.0, 0.2), (-20.0, -0.2), (20.0, -0.2)))
    along = Trajectory.from_poses(wide, [(4, 0, 0), (6.5, 0, 0)])
    for share, near in ((0.04, False), (0.08, True)):
        aside = 0.2 + 0.01 - sigma * float(norm.ppf(share))
        comes = Track.through([(2, 5, aside), (60, 5, aside)])  # later than a robot may still be leaving
        assert bool(touched(Person.along(comes, radius=0.01, spread=sigma), along, robot=wide)) == near


@pytest.mark.parametrize(("x", "near"), [(1.65, True), (0.35, False)])
def test_a_chance_of_contact_at_the_beginning_may_be_left_but_not_grow(x, near):
    """0.1 m between the surfaces, and a deviation of 0.1 m: a share of some 16 % is in contact."""
    person = Person(x, 0.0, radius=0.3, spread=0.1, until=60.0, name="Ann")
    assert touched(person) == ("touches Ann at 0.01 s" if near else "")


def test_a_chance_of_contact_that_comes_with_less_certainty_may_be_left():
    """Less and less surely behind the robot; walking up to it is another thing."""
    behind = {"x": 0.2, "y": 0.0, "radius": 0.3, "until": 60.0, "name": "Ann"}
    waits = STRAIGHT.with_hold(at=0, seconds=1.0)
    assert not touched(Person(**behind, growth=0.2), waits)
    assert touched(Person(**behind, spread=0.05, velocity=(0.3, 0.0)), waits).startswith("touches Ann at 0.")


def test_a_robot_that_turns_sweeps_with_its_corners():
    long = DifferentialDrive(footprint=((0.8, 0.1), (-0.2, 0.1), (-0.2, -0.1), (0.8, -0.1)))
    turns = Trajectory.from_poses(long, [(5, 0, 0), (5, 0, math.pi / 2)])
    walks = Person(5.6, 0.6, velocity=(1e-3, 0.0), radius=0.1)
    assert np.hypot(0.6, 0.6) < 0.95
    assert touched(walks, turns, robot=long)
    assert not touched(walks, Trajectory.from_poses(long, [(5, 0, 0), (5, 0, -math.pi / 2)]), robot=long)


@pytest.mark.parametrize("corners", range(1, 7))
def test_the_distance_from_the_robot_is_that_of_its_placed_outline(corners):
    """For hulls of one corner, of two, and of more; each grown by a radius."""
    rng = np.random.default_rng(corners)
    parts = [Part(tuple(map(tuple, rng.uniform(-1, 1, (corners, 2)))), float(rng.uniform(0, 0.3)), 0, 1)] * 2
    x, y = rng.uniform(-2, 2, (2, 200))
    states = States(x=x, y=y, yaw=rng.uniform(-math.pi, math.pi, 200))
    places = rng.uniform(-2, 2, (200, 2))
    outlines = shapely.convex_hull(shapely.multipoints(parts[0].placed(states)))
    expected = np.maximum(shapely.distance(outlines, shapely.points(places)) - parts[0].radius, 0.0)
    np.testing.assert_allclose(distance_to_outline(parts, states, places), expected, atol=1e-12)
    assert corners < 3 or (expected == 0).any()


def test_who_begins_within_a_margin_may_leave_once():
    beside = Person(1.0, 0.8, velocity=(0.0, 1e-3))
    assert not touched(beside, margin=0.5)
    back = Trajectory.from_poses(ROBOT, [(1, 0, 0), (4, 0, 0), (1, 0, 0)])
    assert touched(beside, back, margin=0.5)


def test_who_comes_within_a_margin_at_once_may_be_left_but_not_later():
    turns = Trajectory.from_poses(ROBOT, [(1, 0, 0), (1, 0, math.pi), (1, 0, 0)])
    for at, near in ((0.5, False), (1.1, True)):
        comes = Person(-1.2 * at, 0.0, velocity=(1.2, 0.0), until=at + 0.3)
        assert bool(touched(comes, turns, margin=0.5)) == near


def test_a_front_that_touches_somebody_is_at_fault():
    problem = Problem(ROOM, ROBOT, (1, 0, 0), (9, 0, None), ["length"])
    front = problem.solve(planner={"lattice": {"step": 0.5}})
    assert not verify(problem, front)
    walker = ROOM.with_content(people=[Person(9.0, 0.1, velocity=(-1, 0), name="Ann")])
    among = Problem(walker, ROBOT, (1, 0, 0), (9, 0, None), ["length"])
    assert any("touches Ann at 3.7" in fault for fault in verify(among, front))
    assert not verify(among, among.solve(planner={"lattice": {"step": 0.5}}))


def test_a_robot_that_drives_off_does_not_touch_who_follows_more_quickly_than_it_starts():
    follows = Person(0.52, 0.0, velocity=(0.1, 0.0), until=5.0, name="Ann")  # 2 cm within its body
    assert not touched(follows, STRAIGHT.execution())
    assert touched(follows, Trajectory.from_poses(ROBOT, [(1, 0, math.pi), (0.8, 0, math.pi)])).startswith(
        "touches Ann"
    )
