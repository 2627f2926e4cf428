"""Camera length: how far the camera goes."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions


@criterion("camera_length", group="C", unit="m", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraLength:
    """∫ |v| dt, the length of the camera's path in space.

    What ``length`` is to the base, and for the same reason: a short path shortens the exposure (Becerra et al. 2020,
    arXiv 2002.10696). A camera in a hand has no base that goes with it, and one beside the axis of its base goes
    farther, also where the base turns in place.
    """

    def cost(self, m: Motions) -> Column:
        """Path length (M,), m."""
        return m.camera.length
