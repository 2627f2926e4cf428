"""Net winding: how far the user is twisted at the end."""

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
    """|Σ Δθ|, the signed rotations of the camera added up without wrapping, at the end of the trajectory.

    Suomalainen et al. (HRI 2022) found that users prefer unwinding turns and find them more comfortable. A user who
    follows the camera's turns with her own body is twisted by this angle when the robot arrives: three left turns and
    one more are a whole turn, though the heading is as before; left and right cancel. Start and goal headings fix it
    up to whole turns, so it chooses between ways round. The winding at the end counts, not the largest on the way.
    """

    def cost(self, m: History) -> FloatArray:
        """Winding (M,), rad, after each motion."""
        winding: FloatArray = np.abs(np.cumsum(m.of_motions(lambda motions: motions.camera.rotation)))
        return winding
