"""Motion against the direction of one-way zones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.criteria.others import base_velocity, one_way_flows
from hpop.motions import Instants, Motions


@criterion("against_flow", group="O", unit="m", aggregate="sum", requires=("base", "one-way zones"))
@dataclass(frozen=True)
class AgainstFlow:
    """Metres moved against the direction of one-way zones: ∫ (-v · direction)₊ dt.

    v is the velocity of the base's axis. The direction at a point is that of the nearest segment of the zone's path;
    beyond a corner, it is halfway between those of two segments. Moving across the direction costs nothing. Where zones
    overlap, each counts. Unit m; a sum over motions. The definition is this library's own, not a published measure.

    The border of a zone, and the line where the direction changes, are blurred over about two cells of the distance
    grid on either side (see :class:`hpop.world.fields.field.Field`), so that the cost has a gradient.
    """

    def cost(self, m: Motions) -> Column:
        """Return for each motion (M,) its velocity component against one-way zones, integrated over time, m."""
        if m.base.stays:
            return 0.0 * m.base.start.x  # a turn in place moves in no direction
        flows = one_way_flows(m.world)

        def against(s: Instants) -> Column:
            x, y = s.base.x, s.base.y
            vx, vy = base_velocity(m, s)
            return sum(np.maximum(-(vx * ahead(x, y) + vy * left(x, y)), 0.0) for ahead, left in flows)

        return m.integrate(against)
