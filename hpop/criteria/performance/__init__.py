"""Criteria of performance, and the target that several of them look at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hpop.base.options import FARTHEST, real
from hpop.base.text import shown
from hpop.errors import CriterionError
from hpop.motions import Pose, Vector


@dataclass(frozen=True)
class Targeted:
    """A criterion of the view of one place, (x, y, z) in m, world frame."""

    target: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", checked_target(self.target))

    @property
    def places(self) -> tuple[tuple[float, float, float], ...]:
        """The target."""
        return (self.target,)

    def offset(self, pose: Pose) -> Vector:
        """Return the vector from the camera to the target, m: three columns."""
        x, y, z = self.target
        return x - pose.x, y - pose.y, z - pose.z


def checked_target(target: Any) -> tuple[float, float, float]:
    """Return three coordinates; CriterionError for anything else."""
    try:
        x, y, z = target
    except (TypeError, ValueError):
        raise CriterionError(f"target is a place (x, y, z) in m, got {shown(target)}") from None
    kind = "(x, y, z), each a coordinate in m,"
    x, y, z = (float(real("target", c, -FARTHEST, FARTHEST, kind, error=CriterionError)) for c in (x, y, z))
    return x, y, z
