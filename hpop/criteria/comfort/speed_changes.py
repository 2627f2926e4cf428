"""Number of changes of speed on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions, is_curve
from hpop.motions.laws import SPEED

LEAST_CHANGE = 1e-6  # m/s: smaller differences of speed are rounding errors


@criterion("speed_changes", group="C", unit="1", aggregate="sum", requires=("base",), smooth=False, quantum=1.0)
@dataclass(frozen=True)
class SpeedChanges:
    """Number of changes between two speeds of the robot while it drives.

    Unit 1; a sum over motions. A change to the next faster or slower speed counts once, and starting and stopping do
    not count: ``turns`` and ``duration`` charge for stops. It is 0 for a robot with one speed, and along curves, where
    the speed changes all the time. Needs a robot with several ``speeds`` to be more than 0.

    Source: this project. Few changes make a ride predictable, which viewers name as a reason for comfort (Suomalainen
    et al. 2021, doi 10.1007/978-3-030-90739-6_1, in open answers about turns).
    """

    def cost(self, m: Motions) -> Column:
        """Return 1 (M,) for each change between two speeds other than 0, and 0 for all other motions."""
        if SPEED not in m.law.varies or is_curve(m.law):
            return 0.0 * m.duration
        before, after = m.start.speed, m.end.speed
        changes = (np.minimum(before, after) > 0.0) & (np.abs(after - before) > LEAST_CHANGE)
        return np.where(changes, 1.0, 0.0)
