"""Costs that jump where people come and go, or change within centimetres, against sampling a hundred times as dense."""

import math

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import ExpectedContacts, TimeToCollision, WorstIntrusion, trajectory_cost
from hpop.criteria.others.metrics import social_metrics
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, Track, World

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = hpop.DifferentialDrive(speed=0.8, radius=0.3)
AHEAD = Trajectory.from_poses(ROBOT, [(0, 0, 0), (4, 0, 0)])


def cost(criterion, *people, drive=AHEAD):
    return trajectory_cost(criterion, drive, ROOM.with_content(people=people))


@pytest.mark.parametrize("leaves", [0.333, 1.0, 2.417, 2.4999999, 5.0])
def test_who_leaves_is_driven_at_until_that_very_moment(leaves):
    """A person stands 6 m ahead: the time to collision is the gap between surfaces divided by the speed."""
    left = (6 - 0.55 - 0.8 * leaves) / 0.8
    assert cost(TimeToCollision(horizon=8.0), Person(6, 0, until=leaves)) == pytest.approx(1 - left / 8, abs=1e-7)
    metrics = social_metrics(AHEAD, ROOM.with_content(people=[Person(6, 0, until=leaves)]))
    assert metrics.least_time_to_collision == pytest.approx(left, abs=1e-6)
    assert metrics.min_human_distance == pytest.approx(6 - 0.55 - 0.8 * leaves, abs=1e-6)


def test_who_turns_away_is_walked_at_until_that_very_moment():
    """Both walk at each other, then one goes aside, which is no collision course any more."""
    aside = Track.through([(0, 8, 0), (2.345, 8 - 2.345, 0), (4.345, 8 - 2.345, 6)])
    left = (8 - 0.55 - 1.8 * 2.345) / 1.8
    assert cost(TimeToCollision(horizon=4.0), Person.along(aside)) == pytest.approx(1 - left / 4, abs=1e-7)


def test_who_comes_counts_from_the_moment_of_coming():
    comes = Person.along(Track.through([(1.234, 0.5, 0.9), (2.0, 0.5, 4.0)]))
    apart = math.hypot(0.5 - 0.8 * 1.234, 0.9) - 0.55
    depth = (0.5 - apart) / 0.2 + 0.5
    nearer = depth**3 * (10 - 15 * depth + 6 * depth**2)
    assert 0 < nearer < 1
    assert cost(WorstIntrusion(distance=0.4, softness=0.2), comes) == pytest.approx(nearer, abs=1e-6)


def worlds(seed):
    """People who stand, walk, come and leave about a way of moves, turns and a hold."""
    rng = np.random.default_rng(seed)
    x, y, yaw = rng.uniform(-3, 3, (3, 3))
    drive = Trajectory.from_poses(ROBOT, list(zip(x, y, yaw, strict=True))).with_hold(at=1, seconds=2.0)
    people = []
    for _ in range(3):
        t = rng.uniform(0, drive.duration)
        at = drive.at(np.array([t]))
        off, walk = rng.uniform(-0.6, 0.6, 2), rng.uniform(-1.2, 1.2, 2)
        begin, end = t - rng.uniform(0, 2), t + rng.uniform(0, 2)
        ends = [(time, *(np.concatenate([at.x, at.y]) + off + walk * (time - t))) for time in (max(begin, 0.0), end)]
        people.append(Person.along(Track.through(ends)))
    return drive, people


@pytest.mark.seeds(2, of=30)
def test_contacts_are_those_of_dense_sampling(seed):
    drive, people = worlds(seed)
    criterion = ExpectedContacts(distance=0.1, softness=0.1)
    t = (np.arange(400_000) + 0.5) * drive.duration / 400_000
    at, near = drive.at(t), np.zeros(t.size)
    for person in people:
        x, y = person.at(t)
        depth = np.clip((0.1 + 0.55 + 0.1 - np.hypot(at.x - x, at.y - y)) / 0.1, 0, 1)
        near += person.there(t) * depth**3 * (10 - 15 * depth + 6 * depth**2)
    assert near.max() > 0
    assert cost(criterion, *people, drive=drive) == pytest.approx(near.mean() * drive.duration, rel=3e-4, abs=3e-5)
    assert cost(WorstIntrusion(distance=0.1), *people, drive=drive) == pytest.approx(near.max(), abs=5e-3)
