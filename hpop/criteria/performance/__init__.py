"""Criteria of performance (does the camera do its work?), and a base class for those with a target to look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hpop.base.options import FARTHEST, real
from hpop.base.text import shown
from hpop.errors import CriterionError
from hpop.motions import Pose, Vector


@dataclass(frozen=True)
class Targeted:
    """Base class for criteria on how the camera views a target, a position (x, y, z), m, in the world frame."""

    target: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", checked_target(self.target))

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """Positions that pictures mark: the target."""
        return (self.target,)

    def offset(self, pose: Pose) -> Vector:
        """Return the vector from the camera to the target, m, as three columns."""
        x, y, z = self.target
        return x - pose.x, y - pose.y, z - pose.z


def checked_target(target: Any) -> tuple[float, float, float]:
    """Check a target and return it as three floats, m; CriterionError for anything but (x, y, z)."""
    try:
        x, y, z = target
    except (TypeError, ValueError):
        raise CriterionError(f"target must be a position (x, y, z) in m, got {shown(target)}") from None
    kind = "(x, y, z), each a coordinate in m,"
    x, y, z = (float(real("target", value, -FARTHEST, FARTHEST, kind, error=CriterionError)) for value in (x, y, z))
    return x, y, z
