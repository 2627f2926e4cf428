"""Passing distance: how near walls and objects go by."""

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
    """max of (enough - d(camera))₊ while the camera translates: by how much it passes nearer than ``enough`` metres.

    enough  m  distance beyond which passing feels natural, at most 5
    band    m  obstacles that overlap the heights [camera - band, camera + band] count

    Naturalness depends on the passing distance to walls and objects (user studies of immersive telepresence,
    2020-2022). It is about what the user sees go by, so unlike ``clearance`` it takes the camera, not the base; only
    obstacles near eye level, not a kerb below or a lintel above; nothing that is invisible, such as keep-out zones;
    and only motions that move the camera, not a turn about it close to a wall. It is not weighted by the speed: see
    ``peak_optic_flow``.
    """

    enough: float = 1.0  # m from people, beyond which it costs nothing
    band: float = 0.5

    def __post_init__(self) -> None:
        set_reals(self, "enough", least=LEAST, most=MARGIN, kind="a distance in m", error=CriterionError)
        set_reals(self, "band", least=0, most=MOST, kind="a height in m", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Worst shortfall (M,), m."""
        z = camera_height(m)
        heights = (z - self.band, z + self.band)
        seen = as_seen(m.world, heights)
        worst = m.worst(lambda s: np.maximum(self.enough - seen.clearance(s.camera.x, s.camera.y, z=heights), 0.0))
        return np.where(m.camera.length > 0.0, worst, 0.0)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """A bound: the distance to half-planes that hold all that is seen."""
        z = float(np.round(path.model.pose("camera", path.start).z[0], 6))
        heights = (z - self.band, z + self.band)
        seen = as_seen(path.world, heights).free_space(heights)
        return ConvexCost(path.shortfall(self.enough, seen, "camera"), exact=False)
