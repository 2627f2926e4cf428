"""Criterion that measures the metres driven at an angle to the walls."""

from dataclasses import dataclass

import numpy as np

import hpop
from hpop.errors import CriterionError


@hpop.criterion("oblique", group="O", unit="m", aggregate="sum", world_frame=True)
@dataclass(frozen=True)
class Oblique:
    """Metres driven at an angle to the walls: ∫ sin²(2(ψ - axis)) ds, full at 45 degrees and 0 along the walls.

    A robot that drives along the directions of a room is easier to predict for people.
    """

    axis: float = 0.0  # rad, the direction of the walls

    def __post_init__(self) -> None:
        if not np.isfinite(self.axis):
            raise CriterionError(f"'axis' must be an angle in rad, got {self.axis!r}")

    def cost(self, m: hpop.Motions) -> np.ndarray:
        """Return the weighted length (M,), m; the heading changes along curves."""
        return m.integrate(lambda s: np.abs(s.speed) * np.sin(2.0 * (s.base.yaw - self.axis)) ** 2)
