"""Motion that a passenger feels: weightings and doses of ISO 2631-1, jerk, load in curves, and sickness; seats."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.signal import TransferFunction, lsim

import hpop
from hpop.criteria import (
    FeltJerk,
    FeltMSDV,
    LateralLoad,
    RideComfort,
    RideSickness,
    VibrationDose,
    make_criterion,
    trajectory_cost,
)
from hpop.criteria.comfort.sickness import W_D, W_F, W_K, sicken
from hpop.errors import CriterionError, ModelError
from hpop.models import DifferentialDrive, PanTilt
from hpop.trajectories.trajectory import Trajectory

WORLD = hpop.World.from_polygons([], extent=shapely.box(0, 0, 40, 40))
BENT = [(1, 1, 0), (9, 1, 0), (12, 9, 1.2)]
# ISO 2631-1:1997, table 3: 1000 Wk and 1000 Wd at one-third octaves. Left out is Wd at 10 Hz: the printed 212 does not
# fit annex A, which gives 202.
TABLE = {
    0.1: (31.2, 62.4), 0.2: (121, 243), 0.4: (352, 713), 0.5: (418, 853), 0.8: (477, 992), 1.0: (482, 1011),
    1.25: (484, 1008), 1.6: (494, 968), 2.0: (531, 890), 2.5: (631, 776), 3.15: (804, 642), 4.0: (967, 512),
    5.0: (1039, 409), 6.3: (1054, 323), 8.0: (1036, 253), 12.5: (902, 161), 16.0: (768, 125), 20.0: (636, 100),
    31.5: (405, 63.2), 50.0: (246, 38.8), 80.0: (132, 21.1), 100.0: (88.7, 14.1),
}  # fmt: skip


def cost(name, path, **options):
    """Return a criterion's cost of a trajectory in an empty world."""
    return trajectory_cost(make_criterion({name: options}), path, WORLD)


def seated(*seat, **options):
    """Return a drive along a bent path by a robot with a seat."""
    return Trajectory.from_poses(DifferentialDrive(seat=seat, acceleration=0.5, **options), BENT)


def felt(path, ahead, left, step=1e-3):
    """Return times and accelerations (N, 2), ahead and left, of a point of a rigid base, by its formulas."""
    executed = path.execution()
    times = np.arange(0.0, executed.duration, step)
    states, (rates, changes) = executed.at(times), executed.rates(times)
    cos, sin, turn, spin = np.cos(states.yaw), np.sin(states.yaw), rates.yaw, changes.yaw
    level = changes.x * cos + changes.y * sin - spin * left - turn**2 * ahead
    aside = changes.y * cos - changes.x * sin + spin * ahead - turn**2 * left
    return times, np.stack([level, aside], axis=1)


def analog(weighting, signal, times):
    """Return a signal (N,) filtered by the factors of a weighting's transfer function, by scipy's simulation."""
    for numerator, denominator in weighting.sections:
        _, signal, _ = lsim(TransferFunction(numerator, denominator), signal, times)
    return signal


@pytest.mark.parametrize("frequency", TABLE)
def test_the_weightings_have_the_printed_gains_of_the_standard(frequency):
    gains = 1000 * W_K.gain(frequency), 1000 * W_D.gain(frequency)
    assert gains == pytest.approx(TABLE[frequency], rel=0.01)


@pytest.mark.parametrize(("weighting", "frequency"), [(W_D, 1.0), (W_K, 8.0), (W_D, 40.0), (W_F, 0.2)])
def test_the_digital_filter_weighs_a_sinusoid_as_the_transfer_function_does(weighting, frequency):
    step = 0.002
    times = np.arange(0, 20 + 40 / frequency, step)
    out = weighting.apply(np.sin(2 * np.pi * frequency * times)[:, None], step)[:, 0]
    last = out[-round(20 / frequency / step) :]
    assert np.sqrt(2 * np.mean(last**2)) == pytest.approx(weighting.gain(frequency), rel=0.03)


@pytest.mark.parametrize("seat", [(0.0, 0.0, 0.5), (0.4, -0.2, 0.5)])
def test_doses_are_those_of_the_analog_filters_on_the_motion_of_a_rigid_body(seat):
    path = seated(*seat)
    times, acceleration = felt(path, *seat[:2])
    sick = np.stack([analog(W_F, column, times) for column in acceleration.T])
    weighted = np.stack([analog(W_D, column, times) for column in acceleration.T])
    assert cost("felt_msdv", path) == pytest.approx(np.sqrt(np.trapezoid((sick**2).sum(0), times)), rel=0.01)
    square, fourth = (np.trapezoid((weighted**power).sum(0), times) for power in (2, 4))
    assert cost("ride_comfort", path) == pytest.approx(np.sqrt(square / times[-1]), rel=0.01)
    assert cost("vibration_dose", path) == pytest.approx(fourth**0.25, rel=0.01)


def test_groups_units_and_aggregates_of_felt_motion():
    whole = FeltMSDV, RideComfort, VibrationDose, FeltJerk, RideSickness
    assert [cls.unit for cls in whole] == ["m/s^1.5", "m/s²", "m/s^1.75", "m²/s⁵", "%"]
    assert {(cls.group, cls.aggregate) for cls in whole} == {("C", "trajectory")}
    assert (LateralLoad.group, LateralLoad.unit, LateralLoad.aggregate) == ("C", "m/s²", "max")


def test_a_seat_at_the_camera_has_the_dose_and_jerk_of_the_camera():
    path = seated(0.2, 0.1, 1.2, camera_offset=(0.2, 0.1))
    assert cost("felt_msdv", path) == cost("msdv", path) > 0
    assert cost("felt_jerk", path) == cost("jerk", path) > 0


def test_the_lateral_load_of_a_turn_is_that_of_its_circle_or_of_its_start():
    turn = [(1, 1, 0), (1, 1, 3)]
    robots = [DifferentialDrive(seat=s, turn_rate=1.5, turn_acceleration=3.0) for s in ((0, 0.4, 0), (0.5, 0, 0))]
    to_the_side, ahead = (cost("lateral_load", Trajectory.from_poses(robot, turn)) for robot in robots)
    assert to_the_side == pytest.approx(0.4 * 1.5**2)
    assert ahead == pytest.approx(0.5 * 3.0)
    assert cost("lateral_load", Trajectory.from_poses(robots[0], [(1, 1, 0), (9, 1, 0)])) == 0.0


def test_who_reads_gets_sicker_than_who_looks_ahead():
    path = seated(0.0, 0.0, 0.5)
    reading, glancing, looking = (cost("ride_sickness", path, vision=share) for share in (0.0, 0.5, 0.9))
    assert reading > 3 * glancing > 0
    assert looking < 1e-3 * reading


def test_sickness_of_a_ride_is_that_of_the_felt_acceleration():
    path = seated(0.3, 0.0, 0.5)
    times, acceleration = felt(path, 0.3, 0.0, step=0.01)
    turning = path.execution().rates(times)[0].yaw
    motion = [np.zeros((times.size, 3)) for _ in range(2)]
    motion[0][:, :2], motion[1][:, 2] = acceleration, turning
    expected = sicken(felt=motion[0], felt_rotation=motion[1], step=0.01).incidence[-1]
    assert cost("ride_sickness", path) == pytest.approx(expected, rel=0.02)


def test_a_head_that_pans_keeps_the_seat_of_its_base():
    robot = PanTilt(base=DifferentialDrive(seat=(0.1, 0.0, 0.5)))
    assert "seat" in robot.provides
    states = robot.space.state((1.0, 2.0, 0.5 * np.pi, 1.0, 0.2))
    seat = robot.pose("seat", states)
    assert [seat.x[0], seat.y[0], seat.z[0], seat.yaw[0]] == pytest.approx([1.0, 2.1, 0.5, 0.5 * np.pi])


def test_a_front_of_a_wheelchair_shows_the_felt_dose_and_is_saved_with_the_seat(tmp_path):
    robot = DifferentialDrive(seat=(0.1, 0.0, 0.5))
    problem = hpop.Problem(WORLD, robot, (5, 5, 0), (9, 8, 0), ["length", "turns", "felt_msdv"])
    front = problem.solve("lattice", step=1.0)
    assert min(point.costs["felt_msdv"] for point in front) > 0
    front.save(tmp_path / "front.json")
    assert hpop.Front.load(tmp_path / "front.json").problem["model"]["differential_drive"]["seat"] == [0.1, 0.0, 0.5]


@pytest.mark.parametrize("seat", [(1, 2), 3, (0, 0, -0.1), (0, 50, 0), ("a", 0, 0)])
def test_a_seat_is_three_lengths(seat):
    with pytest.raises(ModelError, match="seat must be"):
        DifferentialDrive(seat=seat)


def test_criteria_of_a_seat_need_one():
    with pytest.raises(CriterionError, match="give the robot a seat"):
        cost("felt_jerk", Trajectory.from_poses(DifferentialDrive(), BENT))
