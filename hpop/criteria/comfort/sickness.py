"""Motion sickness: the dose value of ISO 2631-1 (MSDV), and the share of people who would have vomited."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import body_motion
from hpop.errors import CriterionError
from hpop.trajectories.history import History

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

    Source: :mod:`hpop.criteria.comfort.svc` has the model (Wada and others), its constants, and this project's reading
    of it. Euler steps of 0.01 s, as in the published simulations, make the value too large: usually by 3 %, and by at
    most 7 % among random drives with turns and holds.
    """

    vection: float = 1.0

    def __post_init__(self) -> None:
        set_reals(self, "vection", least=0, most=1, kind="a share", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the share of people (M,), %, who would have vomited by the end of each motion."""
        from hpop.criteria.comfort.svc import STEP, sicken  # importing numba takes half a second

        visual = body_motion(m, "camera", STEP)
        sick = sicken(seen=visual.acceleration, seen_rotation=visual.rotation, vection=self.vection, step=visual.step)
        return m.at_motion_ends(visual.times, np.concatenate([[0.0], sick.incidence[:-1]]))
