"""Length of the camera's path."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions


@criterion("camera_length", group="C", unit="m", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraLength:
    """Length of the camera's path in space: ∫ |v| dt.

    Unit m; a sum over motions. It is for the camera what ``length`` is for the base: a short path shortens the exposure
    to virtual reality (Becerra et al. 2020, arXiv 2002.10696). The two differ if the camera is on an arm, or away from
    the axis of its base, so that turns in place move it too.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.camera.length
