"""Reported metrics of a trajectory among people, compared with brute force and plain geometry."""

import math

import numpy as np
import pytest
import shapely

from hpop.criteria.others.metrics import SocialMetrics, social_metrics, zone_fractions
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(radius=0.3, speed=0.8)
PEOPLE = [Person(1, 2.2, velocity=(-0.4, -0.1), radius=0.2), Person(0, -1.2), Person(6, 6, velocity=(-0.2, -0.2))]
WORLD = ROOM.with_content(people=PEOPLE)
TRAJECTORY = Trajectory.from_poses(ROBOT, [(-6, 0, 0), (3, 0, 0), (3, 2, 1.0)])


def gaps(n):
    """Return the gap to each person (people, n) at the middles of n intervals."""
    t = (np.arange(n) + 0.5) * TRAJECTORY.duration / n
    s = TRAJECTORY.at(t)
    centres = [(p.x + p.velocity[0] * t, p.y + p.velocity[1] * t) for p in PEOPLE]
    reach = [p.radius + 0.3 for p in PEOPLE]
    return np.array([np.hypot(x - s.x, y - s.y) - r for (x, y), r in zip(centres, reach, strict=True)])


def test_metrics_are_those_of_brute_force():
    found = social_metrics(TRAJECTORY, WORLD, shortest_length=9.5)
    nearest = gaps(2000).min(axis=0)
    assert 0 < (nearest >= 0.5).mean() < 1
    assert found.min_human_distance == pytest.approx(nearest.min(), abs=2e-3)
    assert found.space_compliance == pytest.approx((nearest >= 0.5).mean(), abs=2e-3)
    assert found.path_efficiency == pytest.approx(9.5 / 11)


def test_the_time_to_collision_is_that_of_stepping_forward():
    step = 0.02
    worst = math.inf
    times = np.arange(0.0, TRAJECTORY.duration, step)
    s, (v, _) = TRAJECTORY.at(times), TRAJECTORY.rates(times)
    for i, t in enumerate(times):
        ahead = np.arange(0, 5, 0.005)
        for p in PEOPLE:
            x = s.x[i] + v.x[i] * ahead - p.x - p.velocity[0] * (t + ahead)
            y = s.y[i] + v.y[i] * ahead - p.y - p.velocity[1] * (t + ahead)
            hit = np.hypot(x, y) <= p.radius + 0.3
            worst = min(worst, ahead[np.argmax(hit)] if hit.any() else math.inf)
    assert worst < 5
    assert social_metrics(TRAJECTORY, WORLD).least_time_to_collision == pytest.approx(worst, abs=0.04)


def test_the_time_to_collision_with_someone_who_comes_straight_on():
    """At the end of 2 m at .8 m/s someone who set out 6 m ahead at .5 m/s is 6 - .5 * 2.5 - 2 m away: 2.25 m of gap."""
    ahead = Trajectory.from_poses(ROBOT, [(0, 0, 0), (2, 0, 0)])
    found = social_metrics(ahead, ROOM.with_content(people=[Person(6, 0, velocity=(-0.5, 0.0), radius=0.2)]))
    assert found.least_time_to_collision == pytest.approx(2.25 / 1.3)


def test_fractions_of_time_in_zones_are_those_of_brute_force_and_add_up_to_one():
    found = zone_fractions(TRAJECTORY, WORLD)
    nearest = gaps(2000).min(axis=0)
    limits = {"intimate": (-9, 0.45), "personal": (0.45, 1.2), "social": (1.2, 3.6), "public": (3.6, 99)}
    assert list(found) == list(limits)
    for name, (low, high) in limits.items():
        expected = ((nearest >= low) & (nearest < high)).mean()
        assert expected > 0
        assert found[name] == pytest.approx(expected, abs=3e-3)
    assert sum(found.values()) == pytest.approx(1)


def test_passing_one_person_straight_spends_the_chords_in_the_zones():
    passing = Trajectory.from_poses(ROBOT, [(-8, 0, 0), (8, 0, 0)])
    found = zone_fractions(passing, ROOM.with_content(people=[Person(0, 1)]), robot_radius=0.0)
    half = [math.sqrt((zone + 0.25) ** 2 - 1) if zone + 0.25 > 1 else 0.0 for zone in (0.45, 1.2, 3.6)]
    assert found["intimate"] == 0
    assert found["personal"] == pytest.approx(half[1] / 8, abs=2e-3)
    assert found["social"] == pytest.approx((half[2] - half[1]) / 8, abs=2e-3)


def test_without_people_nobody_is_disturbed():
    assert social_metrics(TRAJECTORY, ROOM) == SocialMetrics(math.inf, 1.0, math.inf, None)
    assert zone_fractions(TRAJECTORY, ROOM)["public"] == 1


def test_a_collision_has_a_negative_gap_and_no_time_left():
    through = Trajectory.from_poses(ROBOT, [(-2, 0, 0), (2, 0, 0)])
    found = social_metrics(through, ROOM.with_content(people=[Person(0, 0)]))
    assert found.min_human_distance == pytest.approx(-0.55, abs=0.01)
    assert found.least_time_to_collision == 0


def test_where_nothing_moves_the_moment_counts():
    stands = Trajectory.from_poses(ROBOT, [(0, 0, 0)])
    found = social_metrics(stands, ROOM.with_content(people=[Person(1, 0)]), shortest_length=1.0)
    assert found.min_human_distance == pytest.approx(0.45)
    assert found.space_compliance == 0
    assert found.path_efficiency == 1


def test_no_path_is_more_than_efficient():
    assert social_metrics(TRAJECTORY, WORLD, shortest_length=11.5).path_efficiency == 1


@pytest.mark.parametrize("wrong", [{"step": 0.0}, {"shortest_length": 0.0}, {"robot_radius": -1.0}])
def test_what_makes_no_sense_is_refused(wrong):
    with pytest.raises(CriterionError, match=next(iter(wrong))):
        social_metrics(TRAJECTORY, WORLD, **wrong)
