"""Spaces of people and of groups who talk."""

from __future__ import annotations

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import CuttingBetween, HallZones, OSpace, PersonalSpace, motion_costs, trajectory_cost
from hpop.criteria.others.personal_space import spreads
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT_PERSONAL_SPACE = DifferentialDrive(speed=0.8)


def turn_at(x, y):
    return Trajectory.from_poses(ROBOT_PERSONAL_SPACE, [(x, y, 0), (x, y, 2.0)])


def rate_at(x, y, *people, **options):
    turn = turn_at(x, y)
    return trajectory_cost(PersonalSpace(**options), turn, ROOM.with_content(people=people)) / turn.duration


@pytest.mark.parametrize(
    ("speed", "ahead", "side", "behind"),
    [(0.0, 0.5, 1 / 3, 0.25), (0.2, 0.5, 1 / 3, 0.25), (0.25, 0.5, 1 / 3, 0.25), (1.5, 3.0, 2.0, 1.5)],
)
def test_who_walks_faster_needs_more_space(speed, ahead, side, behind):
    assert spreads(Person(0, 0, velocity=(0.0, speed))) == pytest.approx((ahead, side, behind))


@pytest.mark.parametrize(("forward", "left", "exponent"), [(0.5, 0, 0.5), (-0.25, 0, 0.5), (0, 1 / 3, 0.5), (0, 0, 0)])
@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_one_standard_deviation_off_each_way_costs_the_same(forward, left, exponent, yaw):
    x = 1 + forward * math.cos(yaw) - left * math.sin(yaw)
    y = 2 + forward * math.sin(yaw) + left * math.cos(yaw)
    assert rate_at(x, y, Person(1, 2, yaw)) == pytest.approx(math.exp(-exponent))


def test_passing_behind_costs_half_of_passing_in_front():
    person = Person(0.0, 0.0, math.pi / 2)
    front, behind = (
        trajectory_cost(
            PersonalSpace(),
            Trajectory.from_poses(ROBOT_PERSONAL_SPACE, [(0, end * 0.05, math.pi / 2), (0, end * 8, math.pi / 2)]),
            ROOM.with_content(people=[person]),
        )
        for end in (1, -1)
    )
    # the turn to drive away at the same place is no part of the integrals below; its rate differs a little
    for cost, sigma, turns in ((front, 0.5, 0), (behind, 0.25, 2)):
        integral = sigma * math.sqrt(math.pi / 2) * math.erfc(0.05 / sigma / math.sqrt(2)) / ROBOT_PERSONAL_SPACE.speed
        near = math.exp(-0.5 * (0.05 / sigma) ** 2)
        turning = turn_half().duration * near if turns else 0.0
        assert cost == pytest.approx(integral + turning, rel=1e-4)


def turn_half():
    return Trajectory.from_poses(ROBOT_PERSONAL_SPACE, [(0, 0, 0), (0, 0, math.pi)])


def test_people_add_up_or_the_worst_counts():
    one, other = Person(0.3, 0.0, 2.0), Person(-0.2, 0.3, -1.0)
    alone = [rate_at(0, 0, person) for person in (one, other)]
    assert rate_at(0, 0, one, other) == pytest.approx(sum(alone))
    assert rate_at(0, 0, one, other, people="max") == pytest.approx(max(alone))


@pytest.mark.parametrize("combine", ["sum", "max"])
def test_people_who_move_are_met_where_they_are_then_and_face_where_they_go(combine):
    people = [
        Person(2, 1, yaw=1.0, velocity=(-0.6, -0.1)),
        Person(0, -0.5, yaw=0.5),
        Person(3, 5, velocity=(0.0, -0.7), yaw=3.0),
    ]
    trajectory = Trajectory.from_poses(ROBOT_PERSONAL_SPACE, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    rates = []
    for p in people:
        v = math.hypot(*p.velocity)
        facing = math.atan2(p.velocity[1], p.velocity[0]) if v else p.yaw
        way = np.stack([s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t])
        x, y = np.array([[math.cos(facing), math.sin(facing)], [-math.sin(facing), math.cos(facing)]]) @ way
        ahead = max(2 * v, 0.5)
        rates.append(np.exp(-(x**2) / 2 / np.where(x > 0, ahead, ahead / 2) ** 2 - y**2 / 2 / (ahead * 2 / 3) ** 2))
    expected = np.mean(np.sum(rates, 0) if combine == "sum" else np.max(rates, 0)) * trajectory.duration
    found = trajectory_cost(PersonalSpace(combine), trajectory, ROOM.with_content(people=people))
    assert expected > 0.1
    assert found == pytest.approx(expected, rel=1e-3)


@pytest.mark.proof
def test_the_nearest_person_alone_makes_a_good_criterion_too():
    check_criterion(PersonalSpace("max"))


def test_another_way_to_combine_people_is_refused():
    with pytest.raises(CriterionError, match="one of sum, max, got 'mean'"):
        PersonalSpace("mean")


ROBOT_HALL_ZONES = DifferentialDrive(radius=0.3, speed=0.8)


def chord(radius, offset):
    return 2 * math.sqrt(radius**2 - offset**2) if radius > offset else 0.0


@pytest.mark.parametrize("offset", [0.0, 0.4, 1.0, 2.0, 3.9])
def test_passing_a_person_straight_costs_the_chords_of_the_zones(offset):
    world = ROOM.with_content(people=[Person(1.0, 2.0 + offset, 1.0, radius=0.2)])
    passing = Trajectory.from_poses(ROBOT_HALL_ZONES, [(-9, 2, 0), (9, 2, 0)])
    found = trajectory_cost(HallZones(intimate=1.0, personal=0.6, social=0.1, softness=0.02), passing, world)
    # centre to centre: zone + body + robot; each zone counts by what its weight adds to that of the next
    limits = [zone + 0.2 + 0.3 for zone in (0.45, 1.2, 3.6)]
    metres = sum(step * chord(limit, offset) for limit, step in zip(limits, (0.4, 0.5, 0.1), strict=True))
    assert found == pytest.approx(metres / 0.8, abs=0.03)  # panels of 0.1 m see the sharp borders


@pytest.mark.parametrize(
    ("distance", "rate"),
    [(0.5, 1.0), (0.6 + 0.55, 0.5), (0.55 + 2.0, 0.1), (0.55 + 4.0, 0.0), (0.55 + 0.45, 0.75), (0.55 + 1.2, 0.3)],
)
def test_a_turn_in_place_costs_the_weight_of_its_zone_half_way_at_borders(distance, rate):
    world = ROOM.with_content(people=[Person(distance, 0.0)])
    turn = Trajectory.from_poses(ROBOT_HALL_ZONES, [(0, 0, 0), (0, 0, 2.0)])
    assert trajectory_cost(HallZones(), turn, world) == pytest.approx(rate * turn.duration)


def test_time_is_counted_for_each_person_also_while_they_move():
    people = [Person(2, 1, velocity=(-0.5, 0.2), radius=0.3), Person(0, -1), Person(5, 5, velocity=(0.0, -1.0))]
    world = ROOM.with_content(people=people)
    trajectory = Trajectory.from_poses(ROBOT_HALL_ZONES, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 200_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s = trajectory.at(t)
    expected = 0.0
    for p in people:
        gap = np.hypot(s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t) - p.radius - 0.3
        # between the borders' bands the weight is linear in the smooth step 6u⁵ - 15u⁴ + 10u³ of the gap
        bands = [np.interp(gap, [limit - 0.15, limit + 0.15], [1, 0]) for limit in (0.45, 1.2, 3.6)]
        weight = [np.polyval([6, -15, 10, 0, 0, 0], band) for band in bands]
        expected += np.mean(0.5 * weight[0] + 0.4 * weight[1] + 0.1 * weight[2]) * trajectory.duration
    assert trajectory_cost(HallZones(), trajectory, world) == pytest.approx(expected, rel=1e-3)


def test_the_robot_is_as_large_as_it_reaches_unless_a_radius_is_given():
    square = DifferentialDrive(footprint=((0.3, 0.4), (-0.3, 0.4), (-0.3, -0.4), (0.3, -0.4)))
    world = ROOM.with_content(people=[Person(0.0, 2.0)])
    turn = Trajectory.from_poses(square, [(0, 0, 0), (0, 0, 2.0)])
    same = Trajectory.from_poses(DifferentialDrive(radius=0.5), [(0, 0, 0), (0, 0, 2.0)])
    cost = HallZones(softness=0.9)
    assert trajectory_cost(cost, turn, world) == pytest.approx(trajectory_cost(cost, same, world))
    point = trajectory_cost(HallZones(softness=0.9, robot_radius=0.0), turn, world)
    assert point < trajectory_cost(cost, turn, world)


@pytest.mark.parametrize(
    "wrong",
    [
        {"intimate": 0.2},
        {"social": -0.1},
        {"intimate": 0.0, "personal": 0.0, "social": 0.0},
        {"intimate": np.inf},
        {"personal": np.nan},
        {"softness": 0.0},
        {"softness": 1.0},
        {"robot_radius": -0.1},
        {"robot_radius": np.nan},
    ],
)
def test_parameters_that_make_no_sense_are_refused_for_hall_zones(wrong):
    with pytest.raises(CriterionError):
        HallZones(**wrong)


ROBOT_O_SPACE = DifferentialDrive(speed=0.8)


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
    through = Trajectory.from_poses(ROBOT_O_SPACE, [(-9, 0.4, 0), (9, 0.4, 0)])
    expected = 0.6 * math.sqrt(2 * math.pi) / ROBOT_O_SPACE.speed * math.exp(-0.5 * (0.4 / 0.6) ** 2)
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
    trajectory = Trajectory.from_poses(ROBOT_O_SPACE, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
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
    trajectory = Trajectory.from_poses(ROBOT_O_SPACE, [(-4, 0, 0), (3, 0, 0)])
    still = ROOM.with_content(people=people[:2], groups=[(0, 1)])
    assert trajectory_cost(OSpace(), trajectory, world) == trajectory_cost(OSpace(), trajectory, still)


def test_it_asks_for_conversations():
    with pytest.raises(CriterionError, match="requires groups"):
        trajectory_cost(
            OSpace(),
            Trajectory.from_poses(ROBOT_O_SPACE, [(0, 0, 0), (1, 0, 0)]),
            ROOM.with_content(people=[Person(0, 0)]),
        )


@pytest.mark.parametrize("wrong", [{"stride": -1.0}, {"stride": np.inf}, {"sigma": 0.0}, {"sigma": np.nan}])
def test_parameters_that_make_no_sense_are_refused_for_o_space(wrong):
    with pytest.raises(CriterionError):
        OSpace(**wrong)


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
