"""O-space: where the middle of a conversation is, and the time in it against sampling."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import OSpace, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=0.8)


def test_two_who_face_each_other_three_metres_apart_have_it_in_the_middle():
    pair = (Person(1.0, 2.0, 0.0), Person(4.0, 2.0, math.pi))
    assert OSpace().centre(pair) == pytest.approx((2.5, 2.0))


def test_four_on_a_circle_of_a_stride_who_face_its_centre_have_it_there():
    angles = [0.3, 1.9, 3.4, 5.0]
    circle = tuple(Person(7 + 1.5 * math.cos(a), 1 + 1.5 * math.sin(a), a + math.pi) for a in angles)
    assert OSpace().centre(circle) == pytest.approx((7.0, 1.0))


def test_two_side_by_side_have_it_a_stride_ahead():
    assert OSpace(stride=1.2).centre((Person(0, 0, 0), Person(0, 1, 0))) == pytest.approx((1.2, 0.5))


def test_driving_through_the_middle_costs_the_gaussian_of_the_offset():
    world = ROOM.with_content(people=[Person(0, 1.5, -math.pi / 2), Person(0, -1.5, math.pi / 2)], groups=[(0, 1)])
    through = Trajectory.from_poses(ROBOT, [(-9, 0.4, 0), (9, 0.4, 0)])
    expected = 0.6 * math.sqrt(2 * math.pi) / ROBOT.speed * math.exp(-0.5 * (0.4 / 0.6) ** 2)
    assert trajectory_cost(OSpace(sigma=0.6), through, world) == pytest.approx(expected, rel=1e-6)


def test_conversations_add_up_and_walk_along_with_their_people():
    people = [
        Person(1, 1, 0.5, velocity=(0.3, 0.1)),
        Person(2, 2, -1.0, velocity=(0.4, 0.0)),
        Person(-2, -1, 0.0),
        Person(0, -1, 2.0),
        Person(-1, 1, -1.5),
    ]
    groups = [(0, 1), (2, 3, 4)]
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    expected = 0.0
    for group in groups:
        votes = [
            (p.x + p.velocity[0] * t + 1.5 * math.cos(p.yaw), p.y + p.velocity[1] * t + 1.5 * math.sin(p.yaw))
            for p in (people[i] for i in group)
        ]
        x, y = np.mean([vote[0] for vote in votes], axis=0), np.mean([vote[1] for vote in votes], axis=0)
        expected += np.mean(np.exp(-((s.x - x) ** 2 + (s.y - y) ** 2) / 2 / 0.75**2)) * trajectory.duration
    found = trajectory_cost(OSpace(), trajectory, ROOM.with_content(people=people, groups=groups))
    assert expected > 0.1
    assert found == pytest.approx(expected, rel=1e-4)


def test_who_walks_alone_does_not_make_it_ask_for_the_time():
    people = [Person(0, 1.5, -1.6), Person(0, -1.5, 1.6), Person(5, 5, velocity=(1.0, 0.0))]
    world = ROOM.with_content(people=people, groups=[(0, 1)])
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0)])
    still = ROOM.with_content(people=people[:2], groups=[(0, 1)])
    assert trajectory_cost(OSpace(), trajectory, world) == trajectory_cost(OSpace(), trajectory, still)


def test_it_asks_for_conversations():
    with pytest.raises(CriterionError, match="requires groups"):
        trajectory_cost(
            OSpace(), Trajectory.from_poses(ROBOT, [(0, 0, 0), (1, 0, 0)]), ROOM.with_content(people=[Person(0, 0)])
        )


@pytest.mark.parametrize("wrong", [{"stride": -1.0}, {"stride": np.inf}, {"sigma": 0.0}, {"sigma": np.nan}])
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(CriterionError):
        OSpace(**wrong)
