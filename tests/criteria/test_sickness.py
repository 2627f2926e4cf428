"""Motion sickness: the dose value of ISO 2631-1, the model of conflict, and the share of people."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.integrate import solve_ivp
from scipy.signal import TransferFunction, cont2discrete, lfilter, lsim

from hpop.criteria import MSDV, Sickness, trajectory_cost
from hpop.criteria.comfort.sickness import W_F, Constants, sicken
from hpop.criteria.costs import running_costs
from hpop.errors import CriterionError
from hpop.models import DifferentialDrive
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

WORLD = World.from_polygons([], extent=shapely.box(0, 0, 40, 40))
PUBLISHED = [(0.1, 0.695), (0.16, 1.006), (0.2, 0.992), (0.25, 0.854), (0.4, 0.384), (0.63, 0.116)]


@pytest.mark.parametrize(("frequency", "gain"), PUBLISHED)
def test_the_weighting_has_the_gains_of_the_standard(frequency, gain):
    assert W_F.gain(frequency) == pytest.approx(gain, abs=6e-4)


@pytest.mark.parametrize(("frequency", "gain"), PUBLISHED)
def test_the_digital_filter_weighs_a_long_sinusoid_alike(frequency, gain):
    times = np.arange(0, 400, 0.02)
    out = W_F.apply(np.sin(2 * np.pi * frequency * times)[:, None], 0.02)[times >= 200, 0]  # whole periods
    assert np.sqrt(2 * np.mean(out**2)) == pytest.approx(gain, rel=3e-3)


def test_a_constant_acceleration_is_not_weighed_in_the_long_run():
    assert abs(W_F.apply(np.ones((20_000, 1)), 0.02)[-1, 0]) < 1e-6


@pytest.mark.cases("1.2")
@pytest.mark.parametrize("turn", [0.0, 1.2])
def test_the_dose_of_a_drive_is_that_of_the_analog_filter(turn):
    robot = DifferentialDrive(acceleration=0.5)
    path = Trajectory.from_poses(robot, [(1, 1, 0), (9, 1, 0), (9 + 8 * np.cos(turn), 1 + 8 * np.sin(turn), turn)])
    executed = path.execution()
    times = np.linspace(0, executed.duration, 20_001)
    states, (_, change) = executed.at(times), executed.rates(times)
    ahead = change.x * np.cos(states.yaw) + change.y * np.sin(states.yaw)
    out = ahead
    for numerator, denominator in W_F.sections:
        _, out, _ = lsim(TransferFunction(numerator, denominator), out, times)
    expected = np.sqrt(np.trapezoid(out**2, times))
    assert trajectory_cost(MSDV(), path, WORLD) == pytest.approx(expected, rel=0.01)


def test_turning_about_the_camera_has_no_dose_but_a_camera_off_the_axis_swings():
    poses = [(1, 1, 0), (1, 1, 3)]
    doses = [
        trajectory_cost(MSDV(), Trajectory.from_poses(DifferentialDrive(camera_offset=offset), poses), WORLD)
        for offset in ((0.0, 0.0), (0.2, 0.0), (0.0, 0.4))
    ]
    assert doses[0] == 0.0
    assert doses[2] == pytest.approx(2 * doses[1])
    assert doses[1] > 0


def test_the_dose_only_grows():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (9, 1, 0), (9, 9, 2)])
    running = running_costs(MSDV(), path, WORLD)
    assert (np.diff(running) > 0).all()


def test_its_group_unit_and_aggregate_for_msdv():
    assert (MSDV.group, MSDV.unit, MSDV.aggregate) == ("C", "m/s^1.5", "trajectory")


G = 9.81


def test_vertical_shaking_gives_the_published_incidences():
    # 0.234 g rms at 0.2 Hz, Euler steps of 0.01 s: 50.56, 68.14 and 70.99 % after 30, 60 and 120 minutes.
    times = 0.01 * np.arange(720_000)
    felt = np.zeros((times.size, 3))
    felt[:, 2] = G * 0.234 * np.sqrt(2) * np.sin(2 * np.pi * 0.2 * times)
    incidence = sicken(felt=felt, step=0.01).incidence
    assert incidence[[179_999, 359_999, 719_999]] == pytest.approx([50.56, 68.14, 70.99], abs=0.005)


def test_without_motion_or_without_vection_nobody_gets_sick():
    moving = np.random.default_rng(0).normal(size=(2000, 3))
    assert sicken(felt=0 * moving).incidence.max() < 1e-20
    assert sicken(seen=moving, seen_rotation=moving, vection=0.0).incidence.max() < 1e-20
    assert sicken(seen=moving).incidence.max() > 1e-6


def test_seeing_oneself_turn_about_the_vertical_alone_gives_no_conflict():
    yaw = np.zeros((6000, 3))
    yaw[:, 2] = 1.5
    assert sicken(seen_rotation=yaw).conflict.max() < 1e-9
    roll = yaw[:, ::-1]
    assert sicken(seen_rotation=roll).conflict.max() > 0.1


def test_a_seen_acceleration_tilts_the_expected_vertical_as_its_transfer_function_says():
    # With a still head, delta = v_hat - g: (1 + Kac) tau delta'' + delta' + Kvc delta = a', resonant near 0.2 Hz.
    times = 0.001 * np.arange(15_000)
    seen = np.zeros((times.size, 3))
    seen[:, 0] = np.where((times > 1) & (times < 3), 0.8, 0.0) - np.where((times > 9) & (times < 10), 1.1, 0.0)
    _, tilt, _ = lsim(TransferFunction([1, 0], [1.5 * 2, 1, 5]), seen[:, 0], times)
    found = sicken(seen=seen, step=0.001)
    assert found.conflict == pytest.approx(np.abs(tilt), abs=2e-3)
    # And the incidence is the conflict's share through a double lag of 720 s.
    share = (tilt / 0.5) ** 2 / (1 + (tilt / 0.5) ** 2)
    _, incidence, _ = lsim(TransferFunction([85], [720**2, 2 * 720, 1]), share, times)
    assert found.incidence[-1] == pytest.approx(incidence[-1], rel=1e-2)


def signals(t):
    """Felt acceleration and rotation, seen acceleration and rotation: smooth, about all axes."""
    phases = np.arange(12).reshape(4, 3)
    size = np.array([[2.0], [0.6], [1.5], [0.8]])
    return size * np.sin((0.5 + 0.13 * phases) * t + phases)


def by_scipy(duration, vection):
    """|v - v_hat| at the end, the algebraic loops solved as linear equations in the signals of the block diagram."""
    k = Constants()
    eye = np.eye(3)

    def rates(t, x):
        canal_fast, canal_slow, memory, v, v_hat, g_hat, g = x.reshape(7, 3)
        felt, turn, seen, seen_turn = signals(t)
        f = felt + np.array([0, 0, G])
        # Canals as two high-passes in series, tau s/(tau s + 1) each, by the lag of each.
        first = turn - canal_slow
        sensed = first - canal_fast
        # w_hat = input + Kwc (sensed - (w_hat - memory)): the expected canals are one high-pass.
        w_hat = np.linalg.solve((1 + k.k_wc) * eye, k.k_w * turn + vection * seen_turn + k.k_wc * (sensed + memory))
        expected = w_hat - memory
        # a_hat = input + Kac (a_s - (a_hat + g_hat - v_hat))
        a_hat = np.linalg.solve((1 + k.k_ac) * eye, k.k_a * (f - g) + vection * seen + k.k_ac * (f - v - g_hat + v_hat))
        return np.concatenate(
            [
                (first - canal_fast) / k.tau_d,
                (turn - canal_slow) / k.tau_a,
                (w_hat - memory) / k.tau_d,
                (f - v) / k.tau - np.cross(sensed, v),
                (a_hat + g_hat - v_hat) / k.tau - np.cross(expected, v_hat),
                k.k_vc * (v - v_hat),
                -np.cross(turn, g),
            ]
        )

    start = np.concatenate([np.zeros(9), np.tile([0, 0, G], 4)])
    end = solve_ivp(rates, (0, duration), start, rtol=1e-9, atol=1e-10).y[:, -1].reshape(7, 3)
    return np.linalg.norm(end[3] - end[4])


@pytest.mark.cases("0.7")
@pytest.mark.parametrize("vection", [0.0, 0.7])
def test_motion_about_all_axes_agrees_with_an_independent_integration(vection):
    step, duration = 2e-4, 4.0
    given = np.array([signals(t) for t in step * np.arange(round(duration / step) + 1)])
    felt, turn, seen, seen_turn = given.transpose(1, 0, 2)
    found = sicken(felt=felt, felt_rotation=turn, seen=seen, seen_rotation=seen_turn, vection=vection, step=step)
    assert found.conflict[-1] == pytest.approx(by_scipy(duration, vection), rel=3e-3)
    assert found.conflict[-1] > 0.1


def test_signals_must_be_given_and_of_one_shape():
    with pytest.raises(ValueError, match="at least one of felt"):
        sicken()
    with pytest.raises(ValueError, match="must have one shape"):
        sicken(felt=np.zeros((5, 3)), seen=np.zeros((6, 3)))


@pytest.mark.parametrize("vection", [1.0, 0.4])
def test_a_straight_drive_agrees_with_the_linear_model_of_its_ramps(vection):
    path = Trajectory.from_poses(DifferentialDrive(acceleration=0.5), [(1, 1, 0.5), (15, 1 + 14 * math.tan(0.5), 0.5)])
    count = math.ceil(path.execution().duration / 0.01)
    times, step = np.linspace(0, path.execution().duration, count + 1, retstep=True)
    ahead = vection * 0.5 * ((times < 2.0) * 1.0 - (times > times[-1] - 2.0) * 1.0)
    system = ([1, 0], [3, 1, 5])  # with a still head, v_hat - g: 3 x'' + x' + 5 x = a'
    numerator, denominator, _ = cont2discrete(system, step, method="euler")
    for tilt, tolerance in (
        (lfilter(numerator.ravel(), denominator, ahead), 0.01),
        (lsim(TransferFunction(*system), ahead, times)[1], 0.06),  # what Euler's method errs by at 0.01 s
    ):
        share = tilt**2 / (0.25 + tilt**2)
        # M at T: the impulse response of the double lag is t exp(-t/720)/720².
        lag = times[-1] - times
        expected = np.trapezoid(85 * share * lag * np.exp(-lag / 720) / 720**2, times)
        assert trajectory_cost(Sickness(vection), path, WORLD) == pytest.approx(expected, rel=tolerance)


def test_stopping_often_is_worse_than_driving_on():
    robot = DifferentialDrive()
    on = Trajectory.from_poses(robot, [(1, 1, 0), (21, 1, 0), (21, 11, 1.57)])
    stops = [(1 + 2 * i, 1 + 0.3 * (i % 2), 0) for i in range(11)]
    often = Trajectory.from_poses(robot, [*stops, (21, 11, 1.57)])
    assert trajectory_cost(Sickness(), often, WORLD) > 2 * trajectory_cost(Sickness(), on, WORLD)


def test_turning_about_the_camera_gives_none_and_no_vection_gives_none():
    turn = [(1, 1, 0), (1, 1, 3)]
    on_axis, off_axis = (
        Trajectory.from_poses(DifferentialDrive(camera_offset=offset), turn) for offset in ((0, 0), (0.3, 0))
    )
    assert trajectory_cost(Sickness(), on_axis, WORLD) < 1e-20
    assert trajectory_cost(Sickness(), off_axis, WORLD) > 1e-9
    assert trajectory_cost(Sickness(0.0), off_axis, WORLD) < 1e-20


def test_it_builds_up_along_the_way():
    path = Trajectory.from_poses(DifferentialDrive(), [(1, 1, 0), (9, 1, 0), (9, 9, 2)])
    assert (np.diff(running_costs(Sickness(), path, WORLD)) > 0).all()


@pytest.mark.parametrize("vection", [-0.1, 1.1, math.nan])
def test_vection_is_a_share(vection):
    with pytest.raises(CriterionError, match="vection must be a share"):
        Sickness(vection)


def test_its_group_unit_and_aggregate_for_sickness():
    assert (Sickness.group, Sickness.unit, Sickness.aggregate) == ("C", "%", "trajectory")
