"""Visibility of the robot to people: known angles, and the integral compared with sampling."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria import VisibilityToPeople, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=0.8)


def rate_at(x, y, *people, **options):
    turn = Trajectory.from_poses(ROBOT, [(x, y, 0), (x, y, 2.0)])
    return trajectory_cost(VisibilityToPeople(**options), turn, ROOM.with_content(people=people)) / turn.duration


@pytest.mark.parametrize(("angle", "factor"), [(0, 0), (math.pi / 3, 0.25), (math.pi / 2, 0.5), (math.pi, 1)])
@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("yaw", [0.0, 2.5])
def test_straight_ahead_is_seen_the_back_is_not(angle, factor, side, yaw):
    x, y = 1 + math.cos(yaw + side * angle), 2 + math.sin(yaw + side * angle)
    assert rate_at(x, y, Person(1, 2, yaw), range=4.0) == pytest.approx(factor * 0.75**2)


@pytest.mark.parametrize(("distance", "near"), [(0.0, 0.5), (1.0, 0.25), (1.999, 2.5e-7), (2.0, 0), (3.0, 0)])
def test_what_is_far_off_does_not_matter(distance, near):
    assert rate_at(0, -distance, Person(0, 0), range=2.0) == pytest.approx(near * (0.5 if distance else 1), abs=1e-12)


def test_people_who_walk_look_where_they_go():
    people = [
        Person(2, 1, yaw=2.0, velocity=(-0.6, -0.1)),
        Person(0, -0.7, 0.5),
        Person(2.5, 5, yaw=1.0, velocity=(0.1, -0.7)),
    ]
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    expected = 0.0
    for p in people:
        gaze = math.atan2(p.velocity[1], p.velocity[0]) if any(p.velocity) else p.yaw
        dx, dy = s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t
        angle = np.abs(np.angle(np.exp(1j * (np.arctan2(dy, dx) - gaze))))
        near = np.clip(1 - np.hypot(dx, dy) / 3.6, 0, 1) ** 2
        expected += np.mean(np.sin(angle / 2) ** 2 * near) * trajectory.duration  # half-angle formula
    found = trajectory_cost(VisibilityToPeople(), trajectory, ROOM.with_content(people=people))
    assert expected > 1
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1])
def test_it_is_a_good_criterion_in_other_worlds_too(seed):
    check_criterion(VisibilityToPeople(), rng=seed)


@pytest.mark.parametrize("range_", [0.0, -1.0, np.inf, np.nan])
def test_a_range_that_is_no_distance_is_refused(range_):
    with pytest.raises(CriterionError, match="range must be a positive distance"):
        VisibilityToPeople(range_)
