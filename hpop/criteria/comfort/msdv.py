"""Motion sickness dose value of the visual motion."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import criterion
from hpop.criteria.comfort import visual_motion
from hpop.trajectories.history import History

STEP = 0.02  # s: 50 Hz, 80 times the upper corner of Wf, so the bilinear transform bends nothing

# Corner frequencies (Hz) and quality factors of Wf, ISO 2631-1:1997, annex A.
HIGH_PASS = 0.08
LOW_PASS = 0.63
TRANSITION = (0.25, 0.86)  # of acceleration to velocity
STEP_UP = ((0.0625, 0.80), (0.1, 0.80))


def sections() -> tuple[tuple[FloatArray, FloatArray], ...]:
    """Return the factors (numerator, denominator) of Wf(s): band limits, transition, upward step.

    Coefficients begin with the highest power.
    """
    butterworth = 2**-0.5
    high, low = _quadratic(HIGH_PASS, butterworth), _quadratic(LOW_PASS, butterworth)
    rise, settle = (_quadratic(*corner) for corner in STEP_UP)
    transition = _quadratic(*TRANSITION)
    return (np.array([1.0, 0.0, 0.0]), high), (low[-1:], low), (transition[-1:], transition), (rise, settle)


def weighting(frequency: float) -> float:
    """Return |Wf| at a frequency, Hz.

    >>> round(weighting(0.16), 3)
    1.006
    """
    s = 2j * np.pi * frequency
    return float(np.prod([abs(np.polyval(b, s) / np.polyval(a, s)) for b, a in sections()]))


def _quadratic(frequency: float, quality: float) -> FloatArray:
    """Return the coefficients of s² + s w/Q + w², with w the angular frequency."""
    w = 2 * np.pi * frequency
    return np.array([1.0, w / quality, w * w])


def apply_wf_filter(acceleration: FloatArray, step: float) -> FloatArray:
    """Return accelerations (N, k), m/s², after the filter Wf, from rest; each column by itself.

    step  s between samples
    """
    from scipy.signal import sosfilt

    filtered: FloatArray = sosfilt(np.array(_digital(step)), acceleration, axis=0)
    return filtered


@lru_cache(maxsize=16)
def _digital(step: float) -> tuple[FloatArray, ...]:
    """Return the digital filter by factors; coefficients of their product would lose nearly all digits at this rate."""
    from scipy.signal import bilinear

    return tuple(np.concatenate(bilinear(b, a, fs=1.0 / step)) for b, a in sections())


@criterion("msdv", group="C", unit="m/s^1.5", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class MSDV:
    """Motion sickness dose value of the camera's visual motion: sqrt(∫ a_w² dt).

    a_w is the acceleration of the executed camera motion, weighted by the filter Wf, which passes about 0.1 to 0.3 Hz.
    All components in the camera's frame (ahead, left, up) are weighted and their squares added, until the robot
    arrives. Unit m/s^1.5; a criterion of the whole trajectory. Samples of 50 Hz are within half a percent of the analog
    filter.

    Source: ISO 2631-1:1997. Deviation: the standard is about vertical motion that is felt (MSDV/3 % of people vomit). A
    seated user feels nothing and sees the robot's motion, most of it horizontal. So this is a number to compare
    trajectories by, not a prediction.
    """

    def cost(self, m: History) -> FloatArray:
        """Return the dose (M,), m/s^1.5, up to the end of each motion."""
        visual = visual_motion(m, STEP)
        squares = np.sum(apply_wf_filter(visual.acceleration, visual.step) ** 2, axis=1)
        dose = np.sqrt(np.cumsum(squares) * visual.step)
        return m.at_motion_ends(visual.times, dose)
