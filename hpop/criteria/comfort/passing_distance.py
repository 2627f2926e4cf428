"""Passing distance: how near the camera passes walls and objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError
from hpop.models.camera import camera_height
from hpop.motions import Motions
from hpop.world.sight.bearings import MARGIN, as_seen


@criterion("passing_distance", group="C", unit="m", aggregate="max", requires=("camera",), quantum=1e-3)
@dataclass(frozen=True)
class PassingDistance:
    """Shortfall of the distance at which the moving camera passes objects: max over time of (enough - d(camera))₊.

    enough  m  distance from which on passing feels natural, at most 5
    band    m  obstacles count if they overlap the heights from camera - band to camera + band

    d is the distance from the camera to the nearest visible obstacle. Unit m; the worst moment. Unlike ``clearance`` it
    is measured from the camera, not from the base. Obstacles away from eye level (a kerb, a lintel) do not count, nor
    do keep-out zones, which are invisible, nor turns in place. Speed does not matter; it does in ``peak_optic_flow``.

    Source: the naturalness of a ride depends on the distance at which walls and objects pass (user studies of immersive
    telepresence, 2020-2022).
    """

    enough: float = 1.0  # m from visible obstacles, beyond which it costs nothing
    band: float = 0.5

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MARGIN, kind="a distance in m", error=CriterionError)
        set_reals(self, "band", least=0, most=MOST, kind="a height in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the largest shortfall of the distance (M,), m."""
        z = camera_height(m)
        heights = (z - self.band, z + self.band)
        seen = as_seen(m.world, heights)
        worst = m.worst(lambda s: np.maximum(self.enough - seen.clearance(s.camera.x, s.camera.y, z=heights), 0.0))
        return np.where(m.camera.length > 0.0, worst, 0.0)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return a convex upper bound on the cost of a polyline.

        Distances are measured to half-planes that contain the visible obstacles.
        """
        z = float(np.round(path.model.pose("camera", path.start).z[0], 6))
        heights = (z - self.band, z + self.band)
        seen = as_seen(path.world, heights).free_space(heights)
        return ConvexCost(path.shortfall(self.enough, seen, "camera"), exact=False)
