"""Time to collision: against stepping two discs forward, and its worst moment on a trajectory."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import TimeToCollision, motion_costs, trajectory_cost
from hpop.criteria.others.time_to_collision import time_to_collision
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.motions.symbolic import SymbolicMotions
from hpop.testing import check_criterion
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World
from hpop.world.content.content import Person

ROOM = World.from_polygons([], extent=shapely.box(-10, -10, 10, 10))
ROBOT = DifferentialDrive(radius=0.3, speed=1.0)
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
    approach = Trajectory.from_poses(ROBOT, [(0, 0, 0), (stop, 0, 0)])
    assert trajectory_cost(TimeToCollision(horizon=3), approach, world) == pytest.approx(1 - least / 3)


def test_driving_away_and_turning_beside_somebody_costs_nothing():
    world = ROOM.with_content(people=[Person(4, 0)])
    leaving = Trajectory.from_poses(ROBOT, [(3, 0, math.pi), (-3, 0, 0)])
    assert trajectory_cost(TimeToCollision(), leaving, world) == 0


def test_standing_in_the_way_of_somebody_who_walks_costs():
    world = ROOM.with_content(people=[Person(4, 0, velocity=(-0.5, 0.0))])
    turn = Trajectory.from_poses(ROBOT, [(0, 0, 0), (0, 0, 2.0)])
    left = (4 - 0.5 * turn.duration - 0.55) / 0.5
    assert trajectory_cost(TimeToCollision(horizon=20), turn, world) == pytest.approx(1 - left / 20)


def test_the_worst_moment_of_a_trajectory_among_many():
    people = [Person(2, 3.0, velocity=(-0.6, -0.4)), Person(2, -2), Person(3.1, 5.5, velocity=(0.0, -0.2))]
    world = ROOM.with_content(people=people)
    trajectory = Trajectory.from_poses(ROBOT, [(-4, 0, 0), (3, 0, 0), (3, 2, 1.0)])
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
        motions = Motions(world, ROBOT, ROBOT.laws[kind], start, end, panels=3)
        symbols = SymbolicMotions.of(motions)
        value, jacobian = symbols.values_and_jacobian(TimeToCollision().cost(symbols.motions))
        assert value == pytest.approx(motion_costs(TimeToCollision(), motions), abs=1e-9)
        assert np.isfinite(jacobian).all()


@pytest.mark.proof
@pytest.mark.seeds(1, of=[1, 2])
def test_it_is_a_good_criterion_in_other_worlds_too(seed):
    check_criterion(TimeToCollision(), rng=seed)


@pytest.mark.parametrize("wrong", [{"horizon": 0.0}, {"horizon": np.inf}, {"robot_radius": -1.0}])
def test_parameters_that_make_no_sense_are_refused(wrong):
    with pytest.raises(CriterionError):
        TimeToCollision(**wrong)
