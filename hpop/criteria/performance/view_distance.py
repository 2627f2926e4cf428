"""View distance: how far the camera is outside a band of good distances to a target."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import norm
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.performance import Targeted
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions


@criterion("view_distance", group="P", unit="m s", aggregate="sum", requires=("camera",), world_frame=True)
@dataclass(frozen=True)
class ViewDistance(Targeted):
    """Distance by which the camera is too near to a target or too far away, over time: ∫ (near - d)₊ + (d - far)₊ dt.

    target     (x, y, z)  m, world frame
    near, far  m          band of good distances

    d is the distance from the camera to the target. Unit m s; a sum over motions.

    Source: the distance objective of Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019). Deviation: theirs has one best
    distance, this one a band. From all distances in the band the target is sharp and large enough, and the other costs
    decide among them.
    """

    near: float = 0.2
    far: float = 0.6

    def __post_init__(self) -> None:
        super().__post_init__()
        set_reals(self, "near", "far", least=0, most=MOST, kind="a distance in m", error=CriterionError)
        if not self.near <= self.far:
            raise CriterionError(f"near must not exceed far, in m, got near={self.near!r}, far={self.far!r}")

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the distance outside the band (M,), m s."""

        def outside(s: Instants) -> Column:
            distance = norm(self.offset(s.camera))
            return np.maximum(np.maximum(self.near - distance, distance - self.far), 0.0)

        return m.integrate(outside)
