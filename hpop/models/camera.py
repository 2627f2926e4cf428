"""Field of view and height of a model's camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hpop.base.math import is_symbolic
from hpop.base.options import LEAST, Angle, real
from hpop.base.text import shown
from hpop.errors import CriterionError, ModelError, UnsupportedCriterion
from hpop.motions import Model, Motions

POSTURES = 16  # random states for comparing heights of the camera
LEVEL = 1e-6  # m: tolerance for equal heights
ROUND_OFF = 1e-3  # rad by which decimals of pi may exceed it
ALL = (2 * math.pi, math.pi)
FieldOfView = tuple[Angle, Angle]


def height_varies(model: Model) -> bool:
    """Return whether the camera's height depends on the state, as on an arm or a lift."""
    states = model.space.sample(np.random.default_rng(0), POSTURES)
    return bool(np.ptp(model.pose("camera", states).z + np.zeros(POSTURES)) > LEVEL)


def camera_height(m: Motions) -> float:
    """Return the height of the camera above the floor, m, common to all motions of a batch.

    Raises UnsupportedCriterion if it differs between them.
    """
    ends = m.camera.start.z, m.camera.end.z
    if any(map(is_symbolic, ends)) or np.ptp(np.concatenate(ends)) > LEVEL:
        raise UnsupportedCriterion("it needs a camera at a constant height, but this camera goes up and down")
    return float(np.round(ends[0][0], 6))


def field_of_view(model: Model, fov: float | None = None) -> FieldOfView:
    """Return the angles (h, v), rad, of the camera's view; all round for a model without them.

    fov : horizontal angle that replaces them, at all elevations
    """
    if fov is not None:
        return fov, ALL[1]
    return model.field_of_view or ALL


def checked_fov(fov: float | None) -> float | None:
    """Return a criterion's angle of view, rad; None stands for the model's. CriterionError if it is no such angle."""
    if fov is None:
        return None
    kind = "None for the model's, or an angle of view in rad"
    return real("fov", fov, LEAST, ALL[0] + ROUND_OFF, kind, error=CriterionError)


def checked_field_of_view(angles: Any) -> FieldOfView | None:
    """Return a model's field of view as two angles (h, v), rad, or None for all round; ModelError otherwise."""
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
