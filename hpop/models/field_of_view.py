"""What a camera sees at once: bearings within h/2 of its yaw, and elevations within v/2 of its pitch."""

from __future__ import annotations

import math
from typing import Any

from hpop.base.options import LEAST, Angle, real
from hpop.base.text import shown
from hpop.errors import CriterionError, ModelError
from hpop.motions import Model

FieldOfView = tuple[Angle, Angle]

ROUND_OFF = 1e-3  # rad by which decimals of pi may exceed it
ALL = (2 * math.pi, math.pi)


def field_of_view(model: Model, fov: float | None = None) -> FieldOfView:
    """Angles (h, v), rad, that the model's camera sees at once: all round for a model that does not say.

    fov : the horizontal angle that a criterion asks for in its place, at all elevations
    """
    if fov is not None:
        return fov, ALL[1]
    return model.field_of_view or ALL


def checked_fov(fov: float | None) -> float | None:
    """Return a criterion's own angle of view, None for the model's; CriterionError unless it is an angle."""
    if fov is None:
        return None
    kind = "None for the model's, or an angle of view in rad"
    return real("fov", fov, LEAST, ALL[0] + ROUND_OFF, kind, error=CriterionError)


def checked_field_of_view(angles: Any) -> FieldOfView | None:
    """A model's parameter as two angles (h, v), rad, or None for all round; ModelError for anything else."""
    if angles is None:
        return None
    try:
        h, v = angles
    except (TypeError, ValueError):
        raise ModelError(f"field_of_view is (horizontal, vertical) in rad, or None; got {shown(angles)}") from None
    kind = "(horizontal, vertical) in rad, each an angle"
    limits = zip((h, v), ALL, strict=True)
    hint = "degrees are written as '60 deg' in a scenario, math.radians(60) in Python"
    h, v = (float(real("field_of_view", a, LEAST, m + ROUND_OFF, kind, hint=hint, error=ModelError)) for a, m in limits)
    return h, v
