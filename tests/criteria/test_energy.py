"""Duration and energy of the drive."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from hpop.criteria import Duration, Energy, motion_costs, trajectory_cost
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.motions import Motions, States
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD_DURATION = World.from_polygons([], extent=shapely.box(-20, -20, 20, 20))


@given(st.floats(0.2, 2.0), st.floats(0.2, 3.0), st.floats(0.3, 2.0), st.floats(0.5, 4.0), st.floats(0.05, 3.1))
def test_an_l_shaped_path_lasts_what_pencil_and_paper_give(v, a, w, alpha, angle):
    robot = DifferentialDrive(speed=v, acceleration=a, turn_rate=w, turn_acceleration=alpha)
    trajectory = Trajectory.from_poses(robot, [(0, 0, 0), (3, 0, 0), (3 + 2 * np.cos(angle), 2 * np.sin(angle), angle)])
    spin = angle / w + w / alpha if angle >= w * w / alpha else 2 * np.sqrt(angle / alpha)
    assert trajectory_cost(Duration(), trajectory, WORLD_DURATION) == pytest.approx(5 / v + spin + v / a)
    runs = [d / v + v / a if d >= v * v / a else 2 * np.sqrt(d / a) for d in (3, 2)]
    assert trajectory_cost(Duration(), trajectory.execution(), WORLD_DURATION) == pytest.approx(sum(runs) + spin)


def test_duration_is_that_of_the_trajectory():
    trajectory = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (3, 0, 0), (3, 4, 1), (0, 0, 0)])
    for one in (trajectory, trajectory.execution()):
        assert trajectory_cost(Duration(), one, WORLD_DURATION) == pytest.approx(one.duration, rel=1e-12)


def test_duration_is_a_robot_criterion_in_seconds():
    assert (Duration.group, Duration.unit, Duration.aggregate) == ("R", "s", "sum")


WORLD_ENERGY = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))
MODEL = DifferentialDrive(speed=0.8, acceleration=0.5, turn_rate=1.2, turn_acceleration=2.0, wheel_base=0.5)
NOTHING = {f"c{i}": 0.0 for i in range(1, 7)}
POSES = [(0, 0, 1), (3, 1, 2), (2, 5, -1), (2.2, 5.1, 0)]


def cost(trajectory, **constants):
    return trajectory_cost(Energy(**constants), trajectory, WORLD_ENERGY)


def planned(*poses):
    return Trajectory.from_poses(MODEL, poses)


def test_cruising_takes_constant_power_on_both_wheels():
    power = 0.3 * 0.8**2 + 0.7 * 0.8 + 1.1
    expected = 2 * power * 4.0 / 0.8
    assert cost(planned((0, 0, 0), (4, 0, 0)), c1=9, c2=0.3, c3=0.7, c4=1.1, c5=9, c6=9) == pytest.approx(expected)


def test_standing_takes_c4_on_both_wheels_all_the_time():
    trajectory = planned(*POSES)
    assert cost(trajectory, **{**NOTHING, "c4": 1.5}) == pytest.approx(2 * 1.5 * trajectory.duration)


def test_friction_takes_the_way_of_both_wheels_in_either_sense():
    turn, move = planned((0, 0, 0), (0, 0, -2.0)), planned((0, 0, 0), (3, 0, 0))
    friction = {**NOTHING, "c3": 4.0}
    assert cost(turn, **friction) == pytest.approx(2 * 4.0 * 0.25 * 2.0)  # each wheel goes b/2 times the angle
    assert cost(move, **friction) == pytest.approx(2 * 4.0 * 3.0)
    assert cost(move.execution(), **friction) == pytest.approx(2 * 4.0 * 3.0)


def test_what_braking_would_give_back_is_lost():
    kinetic = {**NOTHING, "c6": 15.0}
    run, spin = planned((0, 0, 0), (5, 0, 0)).execution(), planned((0, 0, 0), (0, 0, 3)).execution()
    assert cost(run, **kinetic) == pytest.approx(2 * 0.5 * 15.0 * 0.8**2)
    assert cost(spin, **kinetic) == pytest.approx(2 * 0.5 * 15.0 * (1.2 * 0.25) ** 2)


def test_speeding_up_and_braking_take_ohmic_power():
    run = planned((0, 0, 0), (5, 0, 0)).execution()
    assert cost(run, **{**NOTHING, "c1": 3.0}) == pytest.approx(2 * 3.0 * 0.5**2 * 2 * (0.8 / 0.5))


def test_c5_helps_in_speeding_up_only_so_much_as_it_takes():
    run = planned((0, 0, 0), (5, 0, 0)).execution()
    expected = 2 * 2.0 * 0.5 * (0.8 / 0.5)  # 2 a while speeding up; braking would give as much back
    assert cost(run, **{**NOTHING, "c5": 2.0}) == pytest.approx(expected)


@pytest.mark.cases("True")
@pytest.mark.parametrize("executed", [False, True])
def test_it_is_the_integral_over_the_wheels_of_the_model(executed):
    """The wheel speeds that the model reports, motion by motion, by scipy's adaptive quadrature."""
    c1, c2, c3, c4, c5, c6 = constants = 1.5, 2.5, 4.0, 1.0, 0.5, 12.0
    trajectory = planned(*POSES)
    trajectory = trajectory.execution() if executed else trajectory

    def power(t):
        track = MODEL.wheels(trajectory, np.array([t]))
        total = 0.0
        for v, a in (
            (track.left_speed[0], track.left_acceleration[0]),
            (track.right_speed[0], track.right_acceleration[0]),
        ):
            v, a = (v, a) if v >= 0 else (-v, -a)
            total += max(c1 * a * a + c2 * v * v + c3 * v + c4 + c5 * a + c6 * v * a, 0.0)
        return total

    kinks = [0.0]
    for i, kind in enumerate(trajectory.kinds):
        at = slice(i, i + 1), slice(i + 1, i + 2)
        for phase in MODEL.laws[kind].phases(*(trajectory.states.take(part) for part in at)):
            kinks.append(kinks[-1] + float(phase.duration[0]))
    # Inside each smooth part; its ends belong to the next one.
    parts = [(a + 1e-12, b - 1e-12) for a, b in pairwise(kinks) if b - a > 1e-9]
    expected = sum(quad(power, a, b, limit=200, epsabs=1e-7)[0] for a, b in parts)
    names = dict(zip(NOTHING, constants, strict=True))
    assert cost(trajectory, **names) == pytest.approx(expected, rel=5e-3)


def test_many_turns_cost_what_each_of_them_costs_alone():
    rng = np.random.default_rng(0)
    angle = rng.choice([-2.0, -0.3, 0.3, 1.0, 2.0], 50)
    zeros, yaw = np.zeros(50), rng.uniform(-3, 3, 50)
    start, end = States(x=zeros, y=zeros, yaw=yaw), States(x=zeros, y=zeros, yaw=yaw + angle)
    together = motion_costs(Energy(), Motions(WORLD_ENERGY, MODEL, MODEL.laws["turn"], start, end))
    alone = [cost(planned((0, 0, 0), (0, 0, float(a)))) for a in angle]
    assert together == pytest.approx(alone, rel=1e-9)


def test_a_robot_without_wheels_is_refused():
    @dataclass(frozen=True)
    class Floating(DifferentialDrive):
        @property
        def provides(self):
            return frozenset({"base", "camera"})

    trajectory = Trajectory.from_poses(Floating(), POSES)
    with pytest.raises(CriterionError, match="'energy' requires wheels"):
        cost(trajectory)


@pytest.mark.parametrize("name", sorted(NOTHING))
@pytest.mark.parametrize("value", [-1.0, np.inf, np.nan])
def test_constants_must_be_at_least_zero(name, value):
    with pytest.raises(CriterionError, match=f"{name} must be a number from 0"):
        Energy(**{name: value})
