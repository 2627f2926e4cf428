"""The upright plane that a view from the side shows: along a horizontal direction, and up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray

STEP = 15  # degrees
MINUS = "\N{MINUS SIGN}"


@dataclass(frozen=True)
class Section:
    """An upright plane, seen at right angles.

    degrees  of its direction, counter-clockwise from x: a multiple of 15, above -90 and up to 90
    """

    degrees: int

    @classmethod
    def along(cls, paths: Sequence[FloatArray]) -> Section:
        """The one along which paths (N, 3), m, spread most, their principal axis; along x if they do not spread."""
        pieces = np.concatenate([np.stack([path[:-1, :2], path[1:, :2]], axis=1) for path in paths])  # (n, 2, 2)
        middle = pieces.mean(axis=1)
        weight = np.hypot(*(pieces[:, 1] - pieces[:, 0]).T)
        if not weight.sum() > 0.0:
            return cls(0)
        off = middle - np.average(middle, axis=0, weights=weight)
        spread = np.einsum("n,ni,nj->ij", weight, off, off)
        yaw = 0.5 * math.atan2(2.0 * spread[0, 1], spread[0, 0] - spread[1, 1])
        degrees = STEP * round(math.degrees(yaw) / STEP)
        return cls(90 if degrees == -90 else degrees)

    @property
    def direction(self) -> FloatArray:
        """Its horizontal unit vector (2,)."""
        yaw = math.radians(self.degrees)
        return np.array([math.cos(yaw), math.sin(yaw)])

    @property
    def label(self) -> str:
        """What its horizontal axis measures: x and y of the map where it is along one of them.

        >>> Section(0).label, Section(90).label, Section(-30).label
        ('x (m)', 'y (m)', 'along −30°: x cos 30° − y sin 30° (m)')
        """
        if self.degrees in (0, 90):
            return "y (m)" if self.degrees else "x (m)"
        angle, sign = f"{abs(self.degrees)}°", "+" if self.degrees > 0 else MINUS
        return f"along {sign.strip('+')}{angle}: x cos {angle} {sign} y sin {angle} (m)"

    def flattened(self, points: FloatArray) -> FloatArray:
        """Points in space (..., 3) as they are in the picture (..., 2), m."""
        return np.stack([points[..., :2] @ self.direction, points[..., 2]], axis=-1)
