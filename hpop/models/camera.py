"""Field of view and height of a robot model's camera."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hpop.base.math import is_symbolic
from hpop.base.options import LEAST, Angle, real
from hpop.base.text import shown
from hpop.errors import CriterionError, ModelError, UnsupportedCriterion
from hpop.motions import Model, Motions

POSTURES = 16  # number of random states in which heights of the camera are compared
LEVEL = 1e-6  # m: tolerance for equal heights
ROUND_OFF = 1e-3  # rad by which a rounded pi, such as 3.142, may exceed pi
ALL = (2 * math.pi, math.pi)
FieldOfView = tuple[Angle, Angle]


def height_varies(model: Model) -> bool:
    """Return whether the camera's height depends on the state, as on an arm or a lift."""
    states = model.space.sample(np.random.default_rng(0), POSTURES)
    return bool(np.ptp(model.pose("camera", states).z + np.zeros(POSTURES)) > LEVEL)


def camera_height(m: Motions) -> float:
    """Return the height of the camera above the floor, m, if it is constant over a batch of motions.

    Raises UnsupportedCriterion if it is not.
    """
    ends = m.camera.start.z, m.camera.end.z
    if any(map(is_symbolic, ends)) or np.ptp(np.concatenate(ends)) > LEVEL:
        raise UnsupportedCriterion(
            "the criterion needs a camera at a constant height, but this robot moves its camera up and down; leave the "
            "criterion out"
        )
    return float(np.round(ends[0][0], 6))


def field_of_view(model: Model, fov: float | None = None) -> FieldOfView:
    """Return the horizontal and vertical angle, rad, of the camera's view; (2 pi, pi) if the model sets none.

    fov  horizontal angle, rad, that replaces the model's, with a vertical angle of pi; None for the model's
    """
    if fov is not None:
        return fov, ALL[1]
    return model.field_of_view or ALL


def checked_fov(fov: float | None) -> float | None:
    """Check a criterion's option ``fov`` (horizontal angle of view, rad, or None for the model's) and return it.

    Raises CriterionError for any other value.
    """
    if fov is None:
        return None
    kind = "None for the model's, or an angle of view in rad"
    return real("fov", fov, LEAST, ALL[0] + ROUND_OFF, kind, error=CriterionError)


def checked_field_of_view(angles: Any) -> FieldOfView | None:
    """Check a model's option ``field_of_view``: angles (horizontal, vertical), rad, or None for all round.

    Raises ModelError for any other value.
    """
    if angles is None:
        return None
    try:
        h, v = angles
    except (TypeError, ValueError):
        raise ModelError(
            f"field_of_view must be (horizontal, vertical) in rad, or None for all round, got {shown(angles)}"
        ) from None
    kind = "(horizontal, vertical) in rad, each an angle"
    limits = zip((h, v), ALL, strict=True)
    hint = "degrees are written as '60 deg' in a scenario, math.radians(60) in Python"
    h, v = (float(real("field_of_view", a, LEAST, m + ROUND_OFF, kind, hint=hint, error=ModelError)) for a, m in limits)
    return h, v
