"""Total rotation of the camera."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions


@criterion("rotation", group="C", unit="rad", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class Rotation:
    """∫ |ω| dt, the total rotation of the camera about whatever axis: Σ |Δθ| of turns, pans and tilts.

    Kemeny et al. 2017: rotation is what most evokes sickness.
    """

    def cost(self, m: Motions) -> Column:
        """Absolute rotation (M,), rad."""
        return m.camera.turned
