"""Looking at a target: the angle between the camera's axis and the direction to the target."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import angle_between
from hpop.criteria.base import criterion
from hpop.criteria.performance import Targeted
from hpop.motions import Motions


@criterion("look_at", group="P", unit="rad s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class LookAt(Targeted):
    """Angle between the middle of the view and the target, over time: ∫ γ dt.

    target  (x, y, z)  m, world frame

    γ is the angle between the camera's axis ahead and the direction to the target, rad in [0, π]; 0 where the camera is
    at the target. Unit rad s; a sum over motions.

    Source: the look-at objective of Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019). γ is computed as atan2(|a × d|, a
    · d), which is exact at small angles, where an arc cosine loses half the digits.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        return m.integrate(lambda s: angle_between(s.camera.ahead, self.offset(s.camera)))
