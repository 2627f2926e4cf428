"""Jerk (third time derivative of the position) of the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import camera_at
from hpop.errors import CriterionError
from hpop.trajectories.history import History

SPLIT = 10  # samples per smoothing time


@criterion("jerk", group="C", unit="m²/s⁵", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class Jerk:
    """Squared jerk of the executed camera motion, over time: ∫ |p'''|² dt, at a bandwidth of ``1/smoothing``.

    smoothing  time h, s, over which the motion is smoothed; by default 0.1 (10 Hz)

    Unit m²/s⁵; a criterion of the whole trajectory. The value grows with the bandwidth: compare only values with equal
    ``smoothing``.

    The robot's acceleration jumps (its speed profile is a trapezoid), so its jerk is a series of impulses, whose square
    has no integral. So p''' is a third difference over h, (p(t + 3h/2) - 3 p(t + h/2) + 3 p(t - h/2) - p(t - 3h/2)) /
    h³. This is the jerk smoothed three times by a moving mean of length h. A jump of the acceleration by a then costs
    11 a²/(20 h) if the next jump is at least 3 h away. A straight move from rest to rest with acceleration a has four
    jumps and costs 2.2 a²/h.
    """

    smoothing: float = 0.1

    def __post_init__(self) -> None:
        set_reals(self, "smoothing", least=0.001, most=MOST, kind="a time in s", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the integral (M,), m²/s⁵, of the squared jerk up to the end of each motion.

        The last value includes the time just after the end, into which smoothing spreads the last jump.
        """
        step, duration = self.smoothing / SPLIT, m.executed.duration
        half = 3 * SPLIT // 2  # steps from the middle of the third difference to its ends
        index = np.arange(-2 * half, int(np.ceil(duration / step)) + 2 * half + 1)
        times = np.asarray(step * index, dtype=np.float64)
        _, position = camera_at(m, times)
        position = position - position[0]
        jerk = position[3 * SPLIT :] - 3 * position[2 * SPLIT : -SPLIT] + 3 * position[SPLIT : -2 * SPLIT]
        jerk = (jerk - position[: -3 * SPLIT]) / self.smoothing**3  # (N, 3)
        done = np.asarray(np.cumsum(np.sum(jerk * jerk, axis=1)) * step, dtype=np.float64)
        running = m.at_motion_ends(times[half:-half], done)
        running[-1] = done[-1]
        return running
