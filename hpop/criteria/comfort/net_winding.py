"""Net winding: the angle by which a user who turns with the camera is twisted at the end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import criterion
from hpop.trajectories.history import History


@criterion(
    "net_winding",
    group="C",
    unit="rad",
    aggregate="trajectory",
    requires=("camera", "heading"),
    smooth=False,
    instead=("rotation", "camera_roll"),
)
@dataclass(frozen=True)
class NetWinding:
    """Angle by which the user is twisted at the end: |Σ Δθ|, the absolute sum of the camera's signed turns.

    Unit rad; a criterion of the whole trajectory. A user who follows the camera's turns with the body is twisted by
    this angle when the robot arrives. Left and right turns cancel. Four left turns by 90 degrees are a whole turn,
    although the heading is as before. The headings at start and goal determine the winding up to whole turns, so the
    criterion distinguishes paths that pass obstacles on different sides. Only the winding at the end counts, not the
    largest one on the way.

    Source: Suomalainen et al. (HRI 2022) found that users prefer unwinding turns and find them more comfortable.
    """

    def cost(self, m: History) -> FloatArray:
        """Return the absolute winding (M,), rad, after each motion."""
        winding: FloatArray = np.abs(np.cumsum(m.of_motions(lambda motions: motions.camera.rotation)))
        return winding
