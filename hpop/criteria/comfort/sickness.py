"""Motion sickness: the dose value of ISO 2631-1 (MSDV), and a model of the conflict of felt and seen motion.

The dose value predicts the share of people who would have vomited. The subjective-vertical-conflict model (SVC) does so
from the felt and the seen motion, with six degrees of freedom each.

By the SVC, motion sickness comes from the conflict between the vertical that the senses report, v, and the one that the
brain expects, v_hat (Bles and Bos 1998). The form is that of Kamiji, Kurata, Wada and Doi (2007) as revised by Inoue,
Liu and Wada (SAE 2023-01-0176, form IN1, with its constants). Vectors are in the head's frame; f = g + a is the felt
specific force, a the acceleration and w the angular velocity of the head.

Felt:      w_s = T_d T_a s² / ((T_d s + 1)(T_a s + 1)) w         semicircular canals
           v' = (f - v)/tau - w_s x v,    a_s = f - v            otoliths: vertical and acceleration
Expected:  w_hat = K_w w + K_wc (w_s - w_hat_s),   w_hat_s = T_d s / (T_d s + 1) w_hat
           a_hat = K_a a + K_ac (a_s - a_hat_s),   f_hat = a_hat + g_hat
           v_hat' = (f_hat - v_hat)/tau - w_hat_s x v_hat,   a_hat_s = f_hat - v_hat
           g_hat' = K_vc (v - v_hat)
Sickness:  u = (|v - v_hat|/b)²,  H = u/(1 + u),  tau_I² M'' + 2 tau_I M' + M = P H    M in % of people who vomit

**Seen motion.** The terms K_a a and K_w w stand for what the brain knows of the motion from other sources than the
vestibular organs. A seated user feels no motion (a = w = 0, so without vision there is no conflict and M is 0) but sees
it. So a share ``vection`` of the seen acceleration and angular velocity is added to these terms. That is this project's
reading of "visually driven". Published visual versions add feedback gains of their own, fitted to other experiments.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import body_motion
from hpop.errors import CriterionError
from hpop.runtime.compiled import kernel
from hpop.trajectories.history import History

GRAVITY = 9.81  # m/s²
STEP = 0.01  # s, of Euler's method, as in the published simulations; it makes responses to a jolt 3 to 7 % too large


@dataclass(frozen=True)
class Constants:
    """Constants of the model, form IN1 (Inoue, Liu, Wada 2023), named as in the equations at the top of this file."""

    k_a: float = 0.1
    k_w: float = 0.1
    k_wc: float = 10.0
    k_vc: float = 5.0  # 1/s
    k_ac: float = 0.5
    tau_d: float = 7.0  # s
    tau_a: float = 190.0  # s
    tau: float = 2.0  # s
    b: float = 0.5  # m/s²
    p: float = 85.0  # %
    tau_i: float = 720.0  # s


@dataclass(frozen=True, eq=False)
class Sickened:
    """Predictions of the motion sickness model at N steps of time.

    incidence  (N,)  %     share of people who would have vomited by the end of each step
    conflict   (N,)  m/s²  |v - v_hat|, sensed minus expected vertical, at the beginning of each step
    """

    incidence: FloatArray
    conflict: FloatArray


def sicken(
    *,
    felt: FloatArray | None = None,
    felt_rotation: FloatArray | None = None,
    seen: FloatArray | None = None,
    seen_rotation: FloatArray | None = None,
    vection: float = 1.0,
    step: float = STEP,
    constants: Constants | None = None,
) -> Sickened:
    """Run the motion sickness model on samples (N, 3) of motion, one every ``step`` seconds.

    felt           m/s²   acceleration of the head (ahead, left, up) without gravity; None if the head stays still
    felt_rotation  rad/s  angular velocity of the head; None for zero
    seen           m/s²   acceleration that the eyes see; None for no visible motion
    seen_rotation  rad/s  angular velocity that the eyes see; None for zero
    vection               share of the seen motion that the user takes for his or her own

    Before the first sample the head has long been upright and at rest.

    For a head that turns out of the upright, ``felt`` is in its own frame and includes the change of gravity: felt = f
    - (0, 0, g).
    """
    signals = [signal for signal in (felt, felt_rotation, seen, seen_rotation) if signal is not None]
    if not signals or any(signal.shape != (len(signals[0]), 3) for signal in signals):
        raise ValueError(
            "at least one of felt, felt_rotation, seen and seen_rotation must be given, and those given must have one "
            f"shape (N, 3); got the shapes {[s.shape for s in signals]}"
        )

    def filled(signal: FloatArray | None) -> FloatArray:
        return np.zeros(signals[0].shape) if signal is None else np.ascontiguousarray(signal, dtype=np.float64)

    gravity = np.array([0.0, 0.0, GRAVITY])
    incidence, conflict = np.empty(len(signals[0])), np.empty(len(signals[0]))
    _integrate(
        filled(felt) + gravity,
        filled(felt_rotation),
        vection * filled(seen),
        vection * filled(seen_rotation),
        gravity,
        np.array(astuple(constants or Constants())),
        step,
        incidence,
        conflict,
    )
    return Sickened(incidence, conflict)


@kernel
def _integrate(
    force: FloatArray,
    rotation: FloatArray,
    seen: FloatArray,
    seen_rotation: FloatArray,
    gravity: FloatArray,
    constants: FloatArray,
    step: float,
    incidence: FloatArray,
    conflict: FloatArray,
) -> None:
    """Integrate the model by Euler steps; write ``incidence`` and ``conflict``. Vectors are in the head's frame.

    force, rotation        (N, 3)  m/s², rad/s  felt specific force and angular velocity
    seen, seen_rotation    (N, 3)  m/s², rad/s  seen acceleration and angular velocity, times vection
    gravity                (3,)    m/s²         at the start, where the head is at rest
    constants                                   fields of :class:`Constants` in order
    incidence, conflict    (N,)    %, m/s²      results, as in :class:`Sickened`
    """
    ka, kw, kwc, kvc, kac, tau_d, tau_a, tau, b, percent, tau_i = constants
    g, v, v_hat, g_hat = gravity.copy(), gravity.copy(), gravity.copy(), gravity.copy()
    canal, canal_rate, expected_canal = np.zeros(3), np.zeros(3), np.zeros(3)
    sick = sick_rate = 0.0
    for n in range(len(incidence)):
        f, w = force[n], rotation[n]
        canal_change = w - (1.0 / tau_d + 1.0 / tau_a) * canal_rate - canal / (tau_d * tau_a)
        w_sensed = canal_change
        w_expected = (expected_canal + kw * w + seen_rotation[n] + kwc * w_sensed) / (1.0 + kwc)
        f_hat = (ka * (f - g) + seen[n] + g_hat + kac * (f - v + v_hat)) / (1.0 + kac)
        v_change = (f - v) / tau - np.cross(w_sensed, v)
        v_hat_change = (f_hat - v_hat) / tau - np.cross(w_expected, v_hat)
        g_hat_change = kvc * (v - v_hat)
        g_change = -np.cross(w, g)
        square = np.sum((v - v_hat) ** 2) / b**2
        sick_change = (percent * square / (1.0 + square) - sick) / tau_i**2 - 2.0 * sick_rate / tau_i
        conflict[n] = b * np.sqrt(square)
        canal = canal + step * canal_rate
        canal_rate = canal_rate + step * canal_change
        expected_canal = expected_canal - step * w_expected / tau_d
        g, v = g + step * g_change, v + step * v_change
        v_hat, g_hat = v_hat + step * v_hat_change, g_hat + step * g_hat_change
        sick, sick_rate = sick + step * sick_rate, sick_rate + step * sick_change
        incidence[n] = sick


MSDV_STEP = 0.02  # s: 50 Hz is 80 times the upper corner frequency of Wf, so the bilinear transform distorts nothing
BUTTERWORTH = 2**-0.5  # quality factor of the band limits


@dataclass(frozen=True)
class Weighting:
    """Frequency weighting of ISO 2631-1:1997, annex A: corner frequencies, Hz, and quality factors of its filters.

    high_pass, low_pass  Hz       band limits
    lead                 Hz       of the transition's numerator; None for a constant numerator
    transition           (Hz, 1)  of acceleration to velocity: frequency and quality factor of the denominator
    step_up              two pairs (Hz, 1)  upward step: numerator, then denominator; () for none
    """

    high_pass: float
    low_pass: float
    lead: float | None
    transition: tuple[float, float]
    step_up: tuple[tuple[float, float], ...] = ()

    @cached_property
    def sections(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Factors of the transfer function, each as coefficients of numerator and denominator, highest power first."""
        high, low = _quadratic(self.high_pass, BUTTERWORTH), _quadratic(self.low_pass, BUTTERWORTH)
        down = _quadratic(*self.transition)
        rise = () if self.lead is None else (down[-1] / (2 * np.pi * self.lead),)
        factors = [(np.array([1.0, 0.0, 0.0]), high), (low[-1:], low), (np.array([*rise, down[-1]]), down)]
        if self.step_up:
            rise_up, settle = (_quadratic(*corner) for corner in self.step_up)
            factors.append((rise_up, settle))
        return tuple(factors)

    def gain(self, frequency: float) -> float:
        """Return the gain of the filter at a frequency, Hz.

        >>> round(W_F.gain(0.16), 3)
        1.006
        """
        s = 2j * np.pi * frequency
        return float(np.prod([abs(np.polyval(b, s) / np.polyval(a, s)) for b, a in self.sections]))

    def apply(self, acceleration: FloatArray, step: float) -> FloatArray:
        """Return accelerations (N, k), m/s², filtered from rest; each of the k columns by itself.

        step  s, between two samples
        """
        from scipy.signal import sosfilt

        filtered: FloatArray = sosfilt(np.array(_digital(self, step)), acceleration, axis=0)
        return filtered


def _quadratic(frequency: float, quality: float) -> FloatArray:
    """Return the coefficients of s² + s w/Q + w², where w is the angular frequency, rad/s, and Q the quality factor."""
    w = 2 * np.pi * frequency
    return np.array([1.0, w / quality, w * w])


@lru_cache(maxsize=16)
def _digital(weighting: Weighting, step: float) -> tuple[FloatArray, ...]:
    """Return the digital filter for a sampling step, s, as second-order sections.

    The coefficients of their product would lose nearly all digits at this sampling rate.
    """
    from scipy.signal import bilinear

    return tuple(np.concatenate(bilinear(b, a, fs=1.0 / step)) for b, a in weighting.sections)


W_F = Weighting(0.08, 0.63, None, (0.25, 0.86), ((0.0625, 0.80), (0.1, 0.80)))
"""Weighting of motion sickness: passes about 0.1 to 0.3 Hz."""
W_D = Weighting(0.4, 100.0, 2.0, (2.0, 0.63))
"""Weighting of horizontal vibration at a seat: passes about 0.4 to 2 Hz."""
W_K = Weighting(0.4, 100.0, 12.5, (12.5, 0.63), ((2.37, 0.91), (3.35, 0.91)))
"""Weighting of vertical vibration at a seat: passes about 0.4 to 12 Hz."""


@criterion("msdv", group="C", unit="m/s^1.5", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class MSDV:
    """Motion sickness dose value of the camera's visual motion: sqrt(∫ a_w² dt).

    a_w is the acceleration of the executed camera motion, weighted by the filter Wf, which passes about 0.1 to 0.3 Hz.
    Each component in the camera's frame (ahead, left, up) is filtered, and their squares are added and integrated until
    the robot arrives. Unit m/s^1.5; a criterion of the whole trajectory. Sampling at 50 Hz changes the result by less
    than half a percent.

    Source: ISO 2631-1:1997. Deviation: the standard is about vertical motion that people feel (MSDV/3 % of them vomit).
    A seated user feels nothing and only sees the robot's motion, most of which is horizontal. So use this number to
    compare trajectories, not as a prediction.
    """

    dose: ClassVar = ("camera", W_F)

    def cost(self, m: History) -> FloatArray:
        """Return the dose (M,), m/s^1.5, up to the end of each motion."""
        return sickness_dose(m, "camera")


def sickness_dose(m: History, body: str) -> FloatArray:
    """Return the motion sickness dose value (M,), m/s^1.5, of a body's motion up to the end of each motion."""
    sampled = body_motion(m, body, MSDV_STEP)
    squares = np.sum(W_F.apply(sampled.acceleration, sampled.step) ** 2, axis=1)
    return m.at_motion_ends(sampled.times, np.sqrt(np.cumsum(squares) * sampled.step))


@criterion("sickness", group="C", unit="%", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class Sickness:
    """Share of people expected to have vomited by the end, by the subjective-vertical-conflict model.

    vection  share of the seen motion that users take for their own motion, in [0, 1]; 1 is the worst case

    Unit %; a criterion of the whole trajectory. The model's user is seated, keeps the head upright, and sees the
    executed motion of the camera, including rotations about any axis. Accelerations of the robot tilt the vertical that
    the user expects, most at about 0.2 Hz. A turn about the vertical does not tilt it, and costs nothing unless the
    camera is away from the axis or still accelerating. Sickness builds up over tau_I = 12 minutes, so short drives give
    small numbers: use them for comparison, and combine the criterion with ``rotation``.

    Source: :mod:`hpop.criteria.comfort.sickness` has the model (Wada and others), its constants, and this project's
    reading of it. Euler steps of 0.01 s, as in the published simulations, make the value too large: usually by 3 %, and
    by at most 7 % among random drives with turns and holds.
    """

    vection: float = 1.0

    def __post_init__(self) -> None:
        set_reals(self, "vection", least=0, most=1, kind="a share", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the share of people (M,), %, who would have vomited by the end of each motion."""
        visual = body_motion(m, "camera", STEP)
        sick = sicken(seen=visual.acceleration, seen_rotation=visual.rotation, vection=self.vection, step=visual.step)
        return m.at_motion_ends(visual.times, np.concatenate([[0.0], sick.incidence[:-1]]))
