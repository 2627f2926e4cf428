"""Squared acceleration of the camera, added up over time."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.criteria.base import criterion
from hpop.motions import Instants, Motions
from hpop.motions.laws import SPEED


@criterion("squared_acceleration", group="C", unit="m²/s³", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class SquaredAcceleration:
    """Integral of the camera's squared acceleration: ∫ |a|² dt, a the acceleration of the camera in the world.

    Unit m²/s³; a sum over motions. Strong accelerations count more than weak ones that last longer: a run from rest to
    rest that reaches the speed v with the acceleration a costs 2 a v. Among all motions from rest to rest over the
    distance d in the time T, the one whose acceleration falls linearly costs least, 12 d²/T³.

    Planned motions at constant speed cost nothing; the cost of their starts and stops appears in the executed cost. For
    a robot with several ``speeds``, planned changes of speed cost what their ramps will. `hpop.retime` minimises this
    cost along a path.

    Source: this project. It is convex in the squared speed along a path, so that programs find its optima.
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), m²/s³."""
        if m.law.varies == {SPEED}:  # a planned change of speed in place, whose ramp lasts twice as long
            change = smooth_abs(m.end.speed - m.start.speed)
            return change * m.law.acceleration  # type: ignore[attr-defined]
        return m.integrate(_squared_acceleration)


def _squared_acceleration(s: Instants) -> Column:
    x, y, z = s.twist_rate("camera").velocity
    return x * x + y * y + z * z
