"""Time spent rotating."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.criteria.base import criterion
from hpop.motions import Motions

STILL = 1e-9  # rad: tolerance for the rotation of a camera whose head turns back while its base turns


@criterion("rotation_time", group="C", unit="s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class RotationTime:
    """Time in which the camera turns; waits before and after a turn do not count.

    Unit s; a sum over motions. A turn by |Δθ| from rest to rest lasts |Δθ|/ω + ω/α, or 2 sqrt(|Δθ|/α) if it is too
    short to reach ω. With fast ramps that is Σ |Δθ|/ω. Beside ``rotation`` this distinguishes slow turns from fast
    ones.

    Source: Widdowson et al. 2019: a faster rotation by a given angle shortens the sensory conflict.
    """

    def cost(self, m: Motions) -> Column:
        """Return the duration (M,), s, without waits, of each motion that turns the camera; 0 for all others."""
        busy = sum(phase.duration for phase in m.phases if phase.shape != "hold")
        return np.where(m.camera.turned > STILL, busy, 0.0)
