"""Cutting between people who talk: crossings of segments, against shapely and in every splitting of a path."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import CuttingBetween, motion_costs, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(speed=1.0)
PAIR = ROOM.with_content(people=[Person(0, 1.1), Person(0, -1.1)], groups=[(0, 1)])
small = st.integers(-2, 2)


def crossings(points, world=PAIR):
    """Count on a path through points, headings as they come."""
    return trajectory_cost(CuttingBetween(), path(points), world)


def path(points):
    return Trajectory.from_poses(ROBOT, [(x, y, 0) for x, y in points])


def test_passing_between_two_counts_once_and_there_and_back_twice():
    assert crossings([(-2, 0.3), (2, 0.3)]) == 1
    assert crossings([(2, 0.3), (-2, 0.3)]) == 1
    assert crossings([(-2, 0.3), (2, 0.3), (-2, -0.3)]) == 2


def test_passing_behind_one_of_them_does_not_count():
    assert crossings([(-2, 1.2), (2, 1.2)]) == 0
    assert crossings([(-2, -0.5), (-1, -3.0), (2, -0.5)]) == 0


def test_three_who_talk_have_three_segments():
    ring = ROOM.with_content(people=[Person(0, 1), Person(0, -1), Person(2, 0), Person(1, 5)], groups=[(0, 1, 2)])
    assert crossings([(-2, 0.1), (3, 0.1)], ring) == 2
    assert crossings([(-2, 4), (3, 4)], ring) == 0


@given(st.lists(st.tuples(small, small), min_size=2, max_size=6, unique=True), st.integers(2, 5))
def test_however_a_path_is_split_it_counts_the_same_also_on_the_segment(points, parts):
    fine = [points[0]]
    for (x0, y0), (x1, y1) in pairwise(points):
        fine += [(x0 + (x1 - x0) * i / parts, y0 + (y1 - y0) * i / parts) for i in range(1, parts + 1)]
    pair = ROOM.with_content(people=[Person(-1.55, -1.55), Person(1.55, 1.55)], groups=[(0, 1)])
    if parts in (2, 4):  # binary fractions, so that points on this segment are on it exactly
        assert crossings(fine, pair) == crossings(points, pair)
    assert crossings(fine) == crossings(points)


def test_stopping_and_turning_on_the_segment_crosses_once():
    assert crossings([(-2, 0), (0, 0), (2, 0)]) == 1
    assert crossings([(-2, 0), (0, 0), (0, 0.5), (0, -0.5), (2, 0)]) == 1
    assert crossings([(2, 0), (0, 0), (0, 0.5), (-2, 0)]) == 1


def test_a_path_that_only_touches_the_segment_crosses_an_even_number_of_times():
    assert crossings([(-2, 0), (0, 0), (-2, 0)]) in (0, 2)
    assert crossings([(2, 0), (0, 0), (2, 0)]) in (0, 2)
    assert crossings([(-2, 0), (0, 0), (-2, 0)]) + crossings([(2, 0), (0, 0), (2, 0)]) == 2  # as the docstring says


def test_random_paths_cross_as_often_as_shapely_says():
    rng = np.random.default_rng(5)
    people = [Person(*place) for place in rng.uniform(-3, 3, (5, 2))]
    groups = [(0, 1), (2, 3, 4)]
    world = ROOM.with_content(people=people, groups=groups)
    pairs = [pair for group in groups for pair in combinations(group, 2)]
    segments = [shapely.LineString([(people[i].x, people[i].y), (people[j].x, people[j].y)]) for i, j in pairs]
    total = 0
    for _ in range(50):
        points = rng.uniform(-4, 4, (4, 2))
        legs = [shapely.LineString(points[i : i + 2]) for i in range(3)]
        expected = sum(leg.crosses(segment) for leg in legs for segment in segments)
        assert crossings(points, world) == expected
        total += expected
    assert total > 50


def test_who_walks_by_with_a_friend_is_met_where_they_are_then():
    side_by_side = [Person(-3, 1, velocity=(0.5, 0.0)), Person(-3, -1, velocity=(0.5, 0.0))]
    world = ROOM.with_content(people=side_by_side, groups=[(0, 1)])
    # they are at x = -3 + t/2: the robot, 1 m/s, overtakes them at t = 4 where it starts at x = -5
    assert crossings([(-5, 0), (-2, 0)], world) == 0
    assert crossings([(-5, 0), (0, 0)], world) == 1
    # one who waits is passed
    assert crossings([(0, 0), (0.0001, 0)], world) == 0
    turning = Trajectory.from_poses(ROBOT, [(0, 0, 0), *[(0, 0, a) for a in np.arange(1, 10) % 2 * 3.0]])
    assert turning.duration > 6
    assert trajectory_cost(CuttingBetween(), turning, world) == 1


def test_on_a_graph_without_time_people_who_talk_must_stand():
    states = [States(x=np.array([x]), y=np.zeros(1), yaw=np.zeros(1)) for x in (-1.0, 1.0)]
    walking = [Person(0, 1, velocity=(0.1, 0.0)), Person(0, -1)]
    with pytest.raises(CriterionError, match="give the people no velocity"):
        motion_costs(
            CuttingBetween(),
            Motions(
                ROOM.with_content(people=walking, groups=[(0, 1)]), ROBOT, ROBOT.laws["move"], states[0], states[1]
            ),
        )
    assert motion_costs(CuttingBetween(), Motions(PAIR, ROBOT, ROBOT.laws["move"], *states)).tolist() == [1.0]


def test_two_at_one_place_have_nothing_between_them():
    same = ROOM.with_content(people=[Person(0, 0), Person(0, 0, math.pi)], groups=[(0, 1)])
    assert crossings([(-1, 0), (1, 0)], same) == 0


@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too(seed):
    check_criterion(CuttingBetween(), rng=seed)


def test_between_people_who_walk_apart_crossings_are_those_of_a_dense_path():
    rng, model = np.random.default_rng(2), DifferentialDrive()
    for _ in range(12):
        velocities = rng.uniform(-0.3, 0.3, (3, 2))
        people = [Person(*rng.uniform(3, 7, 2), velocity=tuple(velocity)) for velocity in velocities]
        world = World.from_polygons([], extent=shapely.box(-5, -5, 15, 15)).with_content(
            people=people, groups=[(0, 1, 2)]
        )
        corners, poses = rng.uniform(2, 8, (4, 2)), []
        for (ax, ay), (bx, by) in pairwise(corners):
            poses += [(ax, ay, np.arctan2(by - ay, bx - ax)), (bx, by, np.arctan2(by - ay, bx - ax))]
        way = Trajectory.from_poses(model, poses)
        times = np.linspace(0, way.duration, 20_001)
        states, expected = way.at(times), 0
        for one, other in combinations(people, 2):
            ax, ay = one.x + one.velocity[0] * times, one.y + one.velocity[1] * times
            dx, dy = other.x + other.velocity[0] * times - ax, other.y + other.velocity[1] * times - ay
            along = ((states.x - ax) * dx + (states.y - ay) * dy) / (dx**2 + dy**2)
            left = (states.y - ay) * dx - (states.x - ax) * dy >= 0
            expected += ((left[1:] != left[:-1]) & (along[1:] >= 0) & (along[1:] <= 1)).sum()
        assert trajectory_cost(CuttingBetween(), way, world) == expected
