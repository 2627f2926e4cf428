"""Encounters with people: time to collision, social force, and visibility to people."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import SocialForce, TimeToCollision, VisibilityToPeople, motion_costs, trajectory_cost
from hpop.criteria.others.encounters import time_to_collision
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT_TIME_TO_COLLISION = DifferentialDrive(radius=0.3, speed=1.0)
coordinate = st.floats(-3, 3)


def ttc(px, py, vx, vy, reach):
    return float(time_to_collision(*(np.array([value]) for value in (px, py, vx, vy)), reach)[0])


@given(coordinate, coordinate, coordinate, coordinate, st.floats(0.2, 1.0))
def test_it_is_the_first_time_at_which_two_discs_touch(px, py, vx, vy, reach):
    found = ttc(px, py, vx, vy, reach)
    t = np.linspace(0, 20, 20_001)
    touching = np.hypot(px + vx * t, py + vy * t) <= reach - 1e-9  # who only grazes, at a tangent, is not hit
    if touching.any():
        assert found <= t[np.argmax(touching)] + 1e-9
    if math.isfinite(found):
        gap = math.hypot(px + vx * found, py + vy * found) - reach
        assert gap <= 1e-6 * (1 + found)
        before = t[t < found - 1e-6]
        assert (np.hypot(px + vx * before, py + vy * before) > reach).all()


def test_the_formula_as_published():
    p, v, reach = np.array([3.0, 0.4]), np.array([-1.2, 0.1]), 0.7
    root = math.sqrt((p @ v) ** 2 - v @ v * (p @ p - reach**2))
    assert ttc(*p, *v, reach) == pytest.approx((-p @ v - root) / (v @ v))


def test_who_parts_or_passes_or_stands_is_never_hit_and_who_touches_is():
    assert ttc(2, 0, 1, 0, 0.5) == math.inf
    assert ttc(2, 0.6, -1, 0, 0.5) == math.inf
    assert ttc(2, 0, 0, 0, 0.5) == math.inf
    assert ttc(0.3, 0, 1, 0, 0.5) == 0


@pytest.mark.parametrize(("stop", "least"), [(1.0, 4 - 1 - 0.55), (2.0, 4 - 2 - 0.55), (3.4, 0.05)])
def test_driving_at_somebody_who_stands_costs_by_the_time_left_where_it_stops(stop, least):
    world = ROOM.with_content(people=[Person(4, 0)])
    approach = Trajectory.from_poses(ROBOT_TIME_TO_COLLISION, [(0, 0, 0), (stop, 0, 0)])
    assert trajectory_cost(TimeToCollision(horizon=3), approach, world) == pytest.approx(1 - least / 3)


def test_driving_away_and_turning_beside_somebody_costs_nothing():
    world = ROOM.with_content(people=[Person(4, 0)])
    leaving = Trajectory.from_poses(ROBOT_TIME_TO_COLLISION, [(3, 0, math.pi), (-3, 0, 0)])
    assert trajectory_cost(TimeToCollision(), leaving, world) == 0


def test_standing_in_the_way_of_somebody_who_walks_costs():
    world = ROOM.with_content(people=[Person(4, 0, velocity=(-0.5, 0.0))])
    turn = Trajectory.from_poses(ROBOT_TIME_TO_COLLISION, [(0, 0, 0), (0, 0, 2.0)])
    left = (4 - 0.5 * turn.duration - 0.55) / 0.5
    assert trajectory_cost(TimeToCollision(horizon=20), turn, world) == pytest.approx(1 - left / 20)


def test_the_worst_moment_of_a_trajectory_among_many():
    people = [Person(2, 3.0, velocity=(-0.6, -0.4)), Person(2, -2), Person(3.1, 5.5, velocity=(0.0, -0.2))]
    world = ROOM.with_content(people=people)
    trajectory = Trajectory.from_poses(ROBOT_TIME_TO_COLLISION, [(-4, 0, 0), (3, 0, 0), (3, 2, 1.0)])
    t = np.linspace(0, trajectory.duration, 100_001)
    s, (velocity, _) = trajectory.at(t), trajectory.rates(t)
    worst = 0.0
    for p in people:
        px, py = s.x - p.x - p.velocity[0] * t, s.y - p.y - p.velocity[1] * t
        vx, vy = velocity.x - p.velocity[0], velocity.y - p.velocity[1]
        a, b, c = vx**2 + vy**2, 2 * (px * vx + py * vy), px**2 + py**2 - (0.3 + p.radius) ** 2
        with np.errstate(invalid="ignore", divide="ignore"):
            first = (-b - np.sqrt(b**2 - 4 * a * c)) / (2 * a)
        first = np.where(c <= 0, 0.0, np.where(first > 0, first, np.inf))
        worst = max(worst, np.max(1 - first / 4))
    assert 0.2 < worst < 1
    assert trajectory_cost(TimeToCollision(horizon=4), trajectory, world) == pytest.approx(worst, abs=0.025)


def test_on_symbols_it_has_the_same_values_and_no_gradient_that_is_not_a_number():
    world = ROOM.with_content(people=[Person(4, 0), Person(0, 0), Person(2, 3)])
    x, y, yaw = np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.0, 0.2, 2.0, 0.0]), np.array([0.0, 0.1, 1.5, 2.0])
    start = States(x=x, y=y, yaw=yaw)
    move = States(x=x + np.cos(yaw), y=y + np.sin(yaw), yaw=yaw)
    still = States(x=x, y=y, yaw=yaw)
    turn = States(x=x, y=y, yaw=yaw + 1.0)
    for kind, end in (("move", move), ("move", still), ("turn", turn)):
        motions = Motions(world, ROBOT_TIME_TO_COLLISION, ROBOT_TIME_TO_COLLISION.laws[kind], start, end, panels=3)
        symbols = SymbolicMotions.of(motions)
        value, jacobian = symbols.values_and_jacobian(TimeToCollision().cost(symbols.motions))
        assert value == pytest.approx(motion_costs(TimeToCollision(), motions), abs=1e-9)
        assert np.isfinite(jacobian).all()


@pytest.mark.proof
@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too_for_time_to_collision(seed):
    check_criterion(TimeToCollision(), rng=seed)


@pytest.mark.parametrize("wrong", [{"horizon": 0.0}, {"horizon": np.inf}, {"robot_radius": -1.0}])
def test_parameters_that_make_no_sense_are_refused_for_time_to_collision(wrong):
    with pytest.raises(CriterionError):
        TimeToCollision(**wrong)


ROBOT_SOCIAL_FORCE = DifferentialDrive(speed=0.8)


def force(person, person_velocity, robot, robot_velocity):
    """Moussaïd et al. 2009, equations 3 to 5, complex numbers as vectors: f = f_v t + f_θ n."""
    e = (robot - person) / abs(robot - person)
    interaction = 2.0 * (person_velocity - robot_velocity) + e
    t = interaction / abs(interaction)
    n = 1j * t
    theta = cmath.phase(e / t)
    b = 0.35 * abs(interaction)
    d = abs(robot - person)
    slowing = -4.5 * math.exp(-d / b - (3 * b * theta) ** 2)
    turning = -4.5 * math.copysign(1, theta) * math.exp(-d / b - (2 * b * theta) ** 2)
    return slowing * t + turning * n


def test_the_force_on_people_over_time_is_that_of_the_paper():
    people = [Person(2, 1, velocity=(-0.6, -0.1)), Person(0, -0.7, 0.5), Person(2.5, 5, velocity=(0.1, -0.7))]
    trajectory = Trajectory.from_poses(ROBOT_SOCIAL_FORCE, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
    n = 20_000
    t = (np.arange(n) + 0.5) * trajectory.duration / n
    s, (velocity, _) = trajectory.at(t), trajectory.rates(t)
    total = 0.0
    for p in people:
        v = complex(*p.velocity)
        for i in range(0, n, 4):
            at = complex(p.x, p.y) + v * t[i]
            total += abs(force(at, v, complex(s.x[i], s.y[i]), complex(velocity.x[i], velocity.y[i])))
    expected = total * 4 * trajectory.duration / n
    assert expected > 1
    assert trajectory_cost(SocialForce(), trajectory, ROOM.with_content(people=people)) == pytest.approx(
        expected, rel=2e-3
    )


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_a_robot_that_turns_beside_somebody_pushes_by_the_distance(distance):
    world = ROOM.with_content(people=[Person(distance, 0, 1.0)])
    turn = Trajectory.from_poses(ROBOT_SOCIAL_FORCE, [(0, 0, 0), (0, 0, 2.0)])
    expected = 4.5 * math.exp(-distance / 0.35) * math.sqrt(2) * turn.duration
    assert trajectory_cost(SocialForce(), turn, world) == pytest.approx(expected)


def test_driving_at_somebody_pushes_more_than_driving_away():
    world = ROOM.with_content(people=[Person(3, 0)])
    towards, away = (Trajectory.from_poses(ROBOT_SOCIAL_FORCE, [(a, 0, 0), (b, 0, 0)]) for a, b in ((0, 2), (4, 6)))
    assert trajectory_cost(SocialForce(), towards, world) > 10 * trajectory_cost(SocialForce(), away, world)


def test_where_nothing_is_defined_the_cost_and_its_gradient_are_still_numbers():
    # at the person's place; and at the relative velocity at which D = λΔv + e vanishes
    world = ROOM.with_content(people=[Person(0.0, 0.0)])
    robot = DifferentialDrive(speed=0.5)
    x = np.array([0.0, -0.5, 1.0])
    start = States(x=x, y=np.zeros(3), yaw=np.zeros(3))
    ends = {
        "move": States(x=x + np.array([1.0, 1.0, 1.0]), y=np.zeros(3), yaw=np.zeros(3)),
        "turn": States(x=x, y=np.zeros(3), yaw=np.full(3, 2.0)),
    }
    for kind, end in ends.items():
        motions = Motions(world, robot, robot.laws[kind], start, end, panels=3)
        symbols = SymbolicMotions.of(motions)
        value, jacobian = symbols.values_and_jacobian(SocialForce().cost(symbols.motions))
        assert np.isfinite(jacobian).all()
        assert value[[0, 2]] == pytest.approx(motion_costs(SocialForce(), motions)[[0, 2]], rel=1e-6, abs=1e-9)
        assert np.isfinite(value).all()


@pytest.mark.proof
@pytest.mark.parametrize("seed", [1])
def test_it_is_a_good_criterion_in_other_worlds_too_for_social_force(seed):
    check_criterion(SocialForce(), rng=seed)


@pytest.mark.parametrize(
    "wrong",
    [{"strength": 0.0}, {"stretch": -1.0}, {"anticipation": -1.0}, {"turning": np.inf}, {"slowing": np.nan}],
)
def test_parameters_that_make_no_sense_are_refused_for_social_force(wrong):
    with pytest.raises(CriterionError, match=next(iter(wrong))):
        SocialForce(**wrong)


ROBOT_VISIBILITY_TO_PEOPLE = DifferentialDrive(speed=0.8)


def rate_at(x, y, *people, **options):
    turn = Trajectory.from_poses(ROBOT_VISIBILITY_TO_PEOPLE, [(x, y, 0), (x, y, 2.0)])
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
    trajectory = Trajectory.from_poses(ROBOT_VISIBILITY_TO_PEOPLE, [(-4, 0, 0), (3, 0, 0), (3, 4, 1.0)])
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
def test_it_is_a_good_criterion_in_other_worlds_too_for_visibility_to_people(seed):
    check_criterion(VisibilityToPeople(), rng=seed)


@pytest.mark.parametrize("range_", [0.0, -1.0, np.inf, np.nan])
def test_a_range_that_is_no_distance_is_refused(range_):
    with pytest.raises(CriterionError, match="range must be a positive distance"):
        VisibilityToPeople(range_)
