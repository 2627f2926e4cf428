"""Smoothness: 720 for the minimum-jerk movement, and closed forms for trapezoidal and triangular speed profiles."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from hpop.criteria import Smoothness, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))


def cost(poses, ramp=0.1, **model):
    trajectory = Trajectory.from_poses(DifferentialDrive(**model), poses)
    return trajectory_cost(Smoothness(ramp), trajectory, WORLD)


def minimum_jerk(distance, duration, ramp):
    """Flash and Hogan 1985: x = D (10 s³ - 15 s⁴ + 6 s⁵), whose squared jerk integrates to 720 D²/T⁵."""

    def at(t):
        s = t / duration
        change = distance * (60 * s - 180 * s**2 + 120 * s**3) / duration**2
        return SimpleNamespace(twist_rate=lambda body: SimpleNamespace(velocity=(0.6 * change, 0.8 * change, 0.0)))

    history = SimpleNamespace(
        executed=SimpleNamespace(duration=duration),
        at=at,
        passed=np.array([0.0, duration]),
        of_motions=lambda column: np.array([distance]),
    )
    return Smoothness(ramp=ramp).cost(history)[0]


@pytest.mark.parametrize(("distance", "duration"), [(1.0, 1.0), (3.0, 7.0)])
def test_the_minimum_jerk_movement_costs_720(distance, duration):
    assert minimum_jerk(distance, duration, duration / 20_000) == pytest.approx(720.0, rel=1e-3)


@pytest.mark.parametrize(("duration", "ramp"), [(5.0, 0.1), (5.6, 0.1), (12.0, 0.1), (3.0, 0.02)])
def test_a_ramp_takes_1800_of_its_share_of_the_time_off_the_minimum(duration, ramp):
    """The jerk of 60 D/T³ at either end counts a quarter of a ramp short: 2 * 60² / 4 = 1800."""
    assert minimum_jerk(2.0, duration, ramp) == pytest.approx(720.0 - 1800.0 * ramp / duration, rel=2e-3)


def test_a_long_run_has_four_jumps_of_its_acceleration():
    v, a, length, ramp = 0.8, 0.5, 6.0, 0.07
    duration = length / v + v / a
    expected = duration**5 / length**2 * 4 * a**2 / ramp
    assert cost([(0, 0, 0), (length, 0, 0)], ramp, speed=v, acceleration=a) == pytest.approx(expected, rel=1e-9)


def test_a_short_run_has_two_jumps_and_one_of_twice_the_size():
    v, a, length, ramp = 2.0, 0.5, 3.0, 0.07
    duration = 2 * np.sqrt(length / a)
    expected = duration**5 / length**2 * (1 + 4 + 1) * a**2 / ramp
    assert cost([(0, 0, 0), (length, 0, 0)], ramp, speed=v, acceleration=a) == pytest.approx(expected, rel=1e-9)


def test_two_runs_with_a_turn_between_them_have_eight_jumps_and_all_the_time():
    v, a, turn_rate, alpha = 1.0, 1.0, 1.5, 3.0
    duration = (4 / v + v / a) + (3 / v + v / a) + (np.pi / 2 / turn_rate + turn_rate / alpha)
    expected = duration**5 / 7**2 * 8 * a**2 / 0.1
    assert cost([(0, 0, 0), (4, 0, 0), (4, 3, np.pi / 2)]) == pytest.approx(expected, rel=1e-9)


def test_it_has_no_dimension():
    path = [(0, 0, 0), (4, 0, 0), (4, 3, np.pi / 2)]
    plain = cost(path)
    twice_as_large = cost([(2 * x, 2 * y, yaw) for x, y, yaw in path], speed=2.0, acceleration=2.0)
    twice_as_fast = cost(path, 0.05, speed=2.0, acceleration=4.0, turn_rate=3.0, turn_acceleration=12.0)
    assert twice_as_large == pytest.approx(plain, rel=1e-9)
    assert twice_as_fast == pytest.approx(plain, rel=1e-9)


def test_a_stop_on_the_way_is_less_smooth():
    straight = cost([(0, 0, 0), (8, 0, 0)])
    assert cost([(0, 0, 0), (4, 0, 0), (4, 0, 0.5), (8, 0, 0)]) > 2 * straight
    assert cost([(0, 0, 0), (4, 0, 0), (8, 0, 0)]) == pytest.approx(straight)  # one run, planned as two moves


def test_what_goes_nowhere_costs_nothing():
    assert cost([(1, 1, 0)]) == 0.0
    assert cost([(1, 1, 0), (1, 1, 2)]) == 0.0


def test_the_last_running_value_is_the_cost_and_turning_first_counts_nothing_yet():
    trajectory = Trajectory.from_poses(DifferentialDrive(), [(0, 0, 1), (4, 0, 0), (4, 3, 2)])
    running = running_costs(Smoothness(), trajectory, WORLD)
    assert trajectory.kinds == ("turn", "move", "turn", "move", "turn")
    assert running[0] == 0.0
    assert (running[1:] > 0).all()
    assert running[-1] == trajectory_cost(Smoothness(), trajectory, WORLD)


@pytest.mark.parametrize("ramp", [0.0, -0.1, np.inf, np.nan])
def test_the_ramp_must_be_a_time(ramp):
    with pytest.raises(CriterionError, match="ramp must be a positive time"):
        Smoothness(ramp)
