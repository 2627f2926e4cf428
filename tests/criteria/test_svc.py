"""The subjective-vertical-conflict model: published values, and an independent integration by scipy."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import TransferFunction, lsim

from hpop.criteria.comfort.svc import Constants, sicken

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
    with pytest.raises(ValueError, match="must be at least one array"):
        sicken()
    with pytest.raises(ValueError, match="all of equal shape"):
        sicken(felt=np.zeros((5, 3)), seen=np.zeros((6, 3)))
