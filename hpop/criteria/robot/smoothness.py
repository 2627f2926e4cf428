"""Smoothness: the dimensionless jerk of the executed motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.trajectories.history import History


@criterion(
    "smoothness",
    group="R",
    unit="1",
    aggregate="trajectory",
    requires=("base",),
    smooth=False,
    instead=("jerk", "angular_acceleration"),
)
@dataclass(frozen=True)
class Smoothness:
    """Dimensionless squared jerk of the base's executed motion: (T⁵/D²) ∫ |p'''|² dt.

    p is the position of the base, T the duration and D the length of its path. Unit 1; a criterion of the whole
    trajectory. The value depends neither on the speed nor on the size of the path. The smoothest movement from rest to
    rest along a line costs about 720 - 1800 ramp/T: 720 in the limit of a ``ramp`` of 0, and 685 for 5 s and the
    default ramp. A trajectory in which the base does not move costs 0.

    Source: Hogan and Sternad, "Sensitivity of smoothness measures to movement duration, amplitude, and arrests", J.
    Motor Behavior 41(6), 2009. Deviation: their D is the distance between the ends, which would be 0 on a round trip.

    The acceleration of an executed move jumps, and a jump has infinite jerk. So the acceleration, which is 0 before the
    start and after the end, is sampled at the middles of intervals of ``ramp`` seconds and interpolated linearly. A
    jump then contributes |Δp''|²/ramp to the integral. Compare only values with equal ``ramp``.
    """

    ramp: float = 0.1  # s, time over which a jump of the acceleration is spread

    def __post_init__(self) -> None:
        set_reals(self, "ramp", least=LEAST, most=MOST, kind="a positive time in s", error=CriterionError)

    def cost(self, m: History) -> Column:
        """Return the dimensionless squared jerk (M,) of the trajectory up to the end of each motion."""
        executed = m.executed
        samples = int(np.ceil(executed.duration / self.ramp))
        middles = self.ramp * (np.arange(samples, dtype=np.float64) + 0.5)
        acceleration = m.at(middles).twist_rate("base").velocity
        x, y = (np.where(middles < executed.duration, a, 0.0) for a in acceleration[:2])
        jumps = np.diff(x, prepend=0.0, append=0.0) ** 2 + np.diff(y, prepend=0.0, append=0.0) ** 2
        times = np.minimum(self.ramp * np.arange(samples + 1), executed.duration)
        elapsed = m.passed[1:]
        done = np.searchsorted(times, elapsed, side="right")
        jerk = np.concatenate([[0.0], np.cumsum(jumps / self.ramp)])[done]
        path = np.cumsum(m.of_motions(lambda motions: motions.base.length))
        return elapsed**5 * jerk / np.where(path > 0, path, np.inf) ** 2
