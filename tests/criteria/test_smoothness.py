"""Smoothness: bending energy, curvature sign changes and jerk."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.criteria import BendingEnergy, CurvatureSignChanges, Rotation, Smoothness, trajectory_cost
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(-50, -50, 50, 50))


def cost_of_bending_energy(trajectory, **parameters):
    return trajectory_cost(BendingEnergy(**parameters), trajectory, WORLD)


def along(line, samples=4001):
    """∫ κ² ds of a polyline that is dense in every bend, by finite differences of its heading."""
    way = np.linspace(0.0, line.length, samples)
    points = shapely.get_coordinates(shapely.line_interpolate_point(line, way))
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1]))
    return np.sum(np.diff(heading) ** 2) / way[1]


def test_a_half_circle_costs_pi_over_its_radius(arcs):
    assert cost_of_bending_energy(arcs([3 * np.pi], [np.pi])) == pytest.approx(np.pi / 3, rel=1e-12)


def test_a_circle_in_many_pieces_costs_the_same_as_in_one(arcs):
    assert cost_of_bending_energy(arcs([0.1] * 60, [0.05] * 60)) == pytest.approx(
        cost_of_bending_energy(arcs([6.0], [3.0])), rel=1e-12
    )


def test_straight_moves_cost_nothing():
    assert cost_of_bending_energy(Trajectory.from_poses(DifferentialDrive(), [(0, 0, 0), (5, 0, 0)])) == 0.0


@pytest.mark.cases("0.5")
@pytest.mark.parametrize("rounding", [0.3, 0.5, 1.0])
def test_corners_cost_what_the_path_with_rounded_corners_bends(rounding):
    corners = [(0, 0), (4, 0), (4, 4), (9, 4)]
    left = [(0, 0), (4 - rounding, 0)]
    angles = np.linspace(0, np.pi / 2, 2001)
    first = np.stack([4 - rounding + rounding * np.sin(angles), rounding - rounding * np.cos(angles)], axis=1)
    second = np.stack([4 + rounding - rounding * np.cos(angles), 4 - rounding + rounding * np.sin(angles)], axis=1)
    smooth = shapely.LineString(np.concatenate([left, first, second, [(9, 4)]]))
    poses = [(*corner, yaw) for corner, yaw in zip(corners, (0, 0, np.pi / 2, 0), strict=True)]
    trajectory = Trajectory.from_poses(DifferentialDrive(), poses)
    assert cost_of_bending_energy(trajectory, rounding=rounding) == pytest.approx(along(smooth), rel=0.02)


def test_a_curve_sharper_than_the_rounding_costs_as_the_rounded_corner(arcs):
    corner = cost_of_bending_energy(arcs([0.0], [np.pi / 2]), rounding=0.5)
    assert corner == pytest.approx(np.pi)
    assert cost_of_bending_energy(arcs([0.1 * np.pi / 2], [np.pi / 2]), rounding=0.5) == pytest.approx(corner)
    assert cost_of_bending_energy(arcs([0.6 * np.pi / 2], [np.pi / 2]), rounding=0.5) < corner


def test_piecewise_linear_trajectories_rank_by_their_total_rotation():
    poses = [(0, 0, 1), (3, 1, 2), (2, 5, -1), (8, 8, 0)]
    trajectory = Trajectory.from_poses(DifferentialDrive(), poses)
    assert cost_of_bending_energy(trajectory, rounding=0.25) == pytest.approx(
        trajectory_cost(Rotation(), trajectory, WORLD) / 0.25
    )


@pytest.mark.parametrize("rounding", [0.0, -1.0, np.inf, np.nan])
def test_the_rounding_must_be_a_radius(rounding):
    with pytest.raises(CriterionError, match="rounding must be a positive radius"):
        BendingEnergy(rounding)


def count(trajectory, **parameters):
    return trajectory_cost(CurvatureSignChanges(**parameters), trajectory, WORLD)


def polyline(*turns):
    """Return a trajectory of moves of one metre with turns in place (rad) between them."""
    heading, x, y, poses = 0.0, 0.0, 0.0, [(0.0, 0.0, 0.0)]
    for turn in (0.0, *turns):
        heading += turn
        x, y = x + np.cos(heading), y + np.sin(heading)
        poses.append((x, y, heading))
    return Trajectory.from_poses(DifferentialDrive(), poses)


@pytest.mark.parametrize(
    ("turns", "flips"),
    [((), 0), ((0.5,), 0), ((0.5, 0.7, 2.0), 0), ((0.5, -0.5), 1), ((0.5, -0.5, 0.5, -0.5), 3), ((-1, -1, 1, 1), 1)],
)
def test_turns_in_place_count_by_their_sense(turns, flips):
    assert count(polyline(*turns)) == flips


@given(st.lists(st.sampled_from([-2.0, -0.3, 0.3, 1.0]), max_size=12))
def test_a_polyline_has_as_many_as_its_turns_change_sense(turns):
    assert count(polyline(*turns)) == sum(a * b < 0 for a, b in pairwise(turns))


def test_a_turn_in_place_of_less_than_a_degree_is_none():
    assert count(polyline(0.5, np.deg2rad(-0.9), 0.5)) == 0
    assert count(polyline(0.5, np.deg2rad(-1.1), 0.5)) == 2


def test_turns_in_place_that_undo_each_other_are_both_seen(arcs):
    assert count(arcs([1.0, 0.0, 0.0, 1.0], [0.0, 1.0, -1.0, 0.0])) == 1


@pytest.mark.parametrize("half_waves", [1, 2, 5])
@pytest.mark.parametrize("pieces", [60, 997])
def test_a_sine_has_an_inflection_between_any_two_half_waves(arcs, half_waves, pieces):
    x = np.linspace(0.0, half_waves * np.pi, pieces)
    length, rotation = np.hypot(np.diff(x), np.diff(np.sin(x))), np.diff(np.arctan(np.cos(x)))
    assert count(arcs(length, rotation)) == half_waves - 1


def test_noise_of_a_recorded_track_is_no_curvature(arcs):
    rng = np.random.default_rng(3)
    rotation = np.full(400, 0.01 / 2.0)  # a circle of radius 2 m in steps of a centimetre
    wobble = np.diff(rng.normal(0.0, 0.004, 401))
    assert np.sum(np.diff(np.sign(rotation + wobble)) != 0) > 100
    assert count(arcs(np.full(400, 0.01), rotation + wobble)) == 0


def test_less_curvature_than_least_is_straight(arcs):
    slalom = arcs([3.0, 3.0, 3.0], [0.12, -0.12, 0.12])  # radius 25 m
    assert count(slalom, least=0.03) == 2
    assert count(slalom, least=0.05) == 0


def test_pieces_are_no_longer_than_the_spacing(arcs):
    slalom = arcs([0.25] * 12, [0.2, -0.2] * 6)  # each bend is one piece
    assert count(slalom, spacing=0.25) == 11


def test_straight_parts_between_bends_to_one_side_are_no_change(arcs):
    assert count(arcs([1.0, 5.0, 1.0], [0.5, 0.0, 0.5])) == 0
    assert count(arcs([1.0, 5.0, 1.0], [0.5, 0.0, -0.5])) == 1


def test_an_arc_to_the_other_side_than_a_turn_in_place_is_one_change(arcs):
    assert count(arcs([2.0, 0.0, 2.0], [0.0, 1.0, -1.0])) == 1
    assert count(arcs([2.0, 0.0, 2.0], [0.0, 1.0, 1.0])) == 0


def test_the_running_count_rises_where_the_sign_flips(arcs):
    trajectory = arcs([1.0, 0.0, 1.0, 1.0, 0.0], [0.4, -1.0, 0.0, 0.5, 1.0])
    assert running_costs(CurvatureSignChanges(), trajectory, WORLD).tolist() == [0, 1, 1, 2, 2]


@pytest.mark.parametrize("parameters", [{"spacing": 0.0}, {"spacing": np.nan}, {"least": -1.0}, {"least": np.inf}])
def test_parameters_must_be_lengths_and_curvatures(parameters):
    with pytest.raises(CriterionError, match=f"{next(iter(parameters))} must be"):
        CurvatureSignChanges(**parameters)


def cost_of_smoothness(poses, ramp=0.1, **model):
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
    assert cost_of_smoothness([(0, 0, 0), (length, 0, 0)], ramp, speed=v, acceleration=a) == pytest.approx(
        expected, rel=1e-9
    )


def test_a_short_run_has_two_jumps_and_one_of_twice_the_size():
    v, a, length, ramp = 2.0, 0.5, 3.0, 0.07
    duration = 2 * np.sqrt(length / a)
    expected = duration**5 / length**2 * (1 + 4 + 1) * a**2 / ramp
    assert cost_of_smoothness([(0, 0, 0), (length, 0, 0)], ramp, speed=v, acceleration=a) == pytest.approx(
        expected, rel=1e-9
    )


def test_two_runs_with_a_turn_between_them_have_eight_jumps_and_all_the_time():
    v, a, turn_rate, alpha = 1.0, 1.0, 1.5, 3.0
    duration = (4 / v + v / a) + (3 / v + v / a) + (np.pi / 2 / turn_rate + turn_rate / alpha)
    expected = duration**5 / 7**2 * 8 * a**2 / 0.1
    assert cost_of_smoothness([(0, 0, 0), (4, 0, 0), (4, 3, np.pi / 2)]) == pytest.approx(expected, rel=1e-9)


def test_it_has_no_dimension():
    path = [(0, 0, 0), (4, 0, 0), (4, 3, np.pi / 2)]
    plain = cost_of_smoothness(path)
    twice_as_large = cost_of_smoothness([(2 * x, 2 * y, yaw) for x, y, yaw in path], speed=2.0, acceleration=2.0)
    twice_as_fast = cost_of_smoothness(path, 0.05, speed=2.0, acceleration=4.0, turn_rate=3.0, turn_acceleration=12.0)
    assert twice_as_large == pytest.approx(plain, rel=1e-9)
    assert twice_as_fast == pytest.approx(plain, rel=1e-9)


def test_a_stop_on_the_way_is_less_smooth():
    straight = cost_of_smoothness([(0, 0, 0), (8, 0, 0)])
    assert cost_of_smoothness([(0, 0, 0), (4, 0, 0), (4, 0, 0.5), (8, 0, 0)]) > 2 * straight
    assert cost_of_smoothness([(0, 0, 0), (4, 0, 0), (8, 0, 0)]) == pytest.approx(
        straight
    )  # one run, planned as two moves


def test_what_goes_nowhere_costs_nothing():
    assert cost_of_smoothness([(1, 1, 0)]) == 0.0
    assert cost_of_smoothness([(1, 1, 0), (1, 1, 2)]) == 0.0


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
