"""Looking at a target: by how much it is off the middle of the view."""

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
    """∫ γ dt, γ the angle between the camera's axis ahead and the direction to the target, rad in [0, π].

    target  (x, y, z)  m, world frame

    The look-at objective of Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019). γ is atan2(|a × d|, a · d), which is exact
    at small angles, where an arc cosine loses half the digits. 0 where the camera is at the target.
    """

    def cost(self, m: Motions) -> Column:
        """Time integral (M,), rad s."""
        return m.integrate(lambda s: angle_between(s.camera.ahead, self.offset(s.camera)))
