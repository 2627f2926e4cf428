"""Acceleration of the camera, added up over time."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import norm, smooth_abs
from hpop.criteria.base import criterion
from hpop.motions import Motions
from hpop.motions.laws import SPEED


@criterion("felt_acceleration", group="C", unit="m/s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class FeltAcceleration:
    """Integral of the camera's acceleration: ∫ |a| dt, a the acceleration of the camera in the world.

    Unit m/s; a sum over motions. On a straight run it is the sum of all changes of speed: a run from rest to rest at
    1 m/s costs 2 m/s, one that also slows down to 0.5 m/s for a while costs 3 m/s. A camera off the axis of a turning
    base also has the acceleration of its circle.

    For a robot with several ``speeds``, starts, stops and changes of speed are motions of the plan, and searches
    minimise their cost. The plan of a robot with one speed has that speed throughout; the cost of starting and
    stopping then appears only in the executed cost, which is reported beside the planned one.

    Source: this project. A seated user sees these accelerations and feels none of them; such conflicts are held to
    cause motion sickness (Reason and Brand, "Motion Sickness", 1975). Unlike ``jerk`` and ``msdv``, it adds up along a
    path, so that searches can minimise it.
    """

    def cost(self, m: Motions) -> Column:
        """Return the integral (M,), m/s."""
        if m.law.varies == {SPEED}:  # a planned change of speed in place
            return smooth_abs(m.end.speed - m.start.speed)
        return m.integrate(lambda s: norm(s.twist_rate("camera").velocity))
