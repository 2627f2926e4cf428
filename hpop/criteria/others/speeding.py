"""Speeding: driving faster than the limit of a speed zone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.criteria.base import criterion
from hpop.criteria.others import speed_limits
from hpop.motions import Instants, Motions


@criterion("speeding", group="O", unit="m", aggregate="sum", requires=("base", "speed zones"))
@dataclass(frozen=True)
class Speeding:
    """Distance that the base covers in excess of the limits in speed zones: ∫ (v - limit)₊ dt in speed zones.

    A path of 10 m at 2 m/s where 1 m/s is allowed takes 5 s and costs (2 - 1) · 5 = 5 m, not 10 m.

    v is the speed of the base; a zone applies while the base's axis is in it. Where zones overlap, the lowest limit
    holds. Unit m; a sum over motions. The definition is this library's own, not a published measure.

    The border of a zone is blurred over about two cells of the distance grid on either side (see
    :class:`hpop.world.fields.field.Field`), so that the cost has a gradient. This does not change the cost of a path
    straight across the border.
    """

    def cost(self, m: Motions) -> Column:
        """Return for each motion (M,) its speed above the limits of speed zones, integrated over time, m."""
        if m.base.stays:
            return 0.0 * m.base.start.x  # a turn in place covers no metres
        limits = speed_limits(m.world)

        def excess(s: Instants) -> Column:
            x, y, speed = s.base.x, s.base.y, smooth_abs(s.speed)
            return sum(np.maximum(speed - limit, 0.0) * inside(x, y) for limit, inside in limits)

        return m.integrate(excess)
