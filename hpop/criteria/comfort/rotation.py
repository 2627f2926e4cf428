"""Total rotation of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions


@criterion("rotation", group="C", unit="rad", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Rotation:
    """Total rotation of the camera, about any axis: ∫ |ω| dt.

    It adds up the angles of all turns, pans and tilts, left or right. Unit rad; a sum over motions. Source: Kemeny et
    al. 2017, who name rotation as the strongest cause of sickness.
    """

    def cost(self, m: Motions) -> Column:
        """Return the absolute rotation (M,), rad."""
        return m.camera.turned
