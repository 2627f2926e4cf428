"""At what height a model's camera is, and whether that ever changes.

Where it does not, all that a camera sees of upright walls is a matter of the plane; where it does, of space.
"""

from __future__ import annotations

import numpy as np

from hpop.base.math import is_symbolic
from hpop.errors import UnsupportedCriterion
from hpop.motions import Model, Motions

POSTURES = 16  # states, drawn from all that there are, whose cameras are compared
LEVEL = 1e-6  # m: heights that differ by less are one


def rises(model: Model) -> bool:
    """Whether the camera's height depends on the state: of an arm or a lift, not of a head on a base."""
    states = model.space.sample(np.random.default_rng(0), POSTURES)
    return bool(np.ptp(model.pose("camera", states).z + np.zeros(POSTURES)) > LEVEL)


def camera_height(m: Motions) -> float:
    """Height of the camera above the floor, m: the same for all motions of a batch.

    Raises UnsupportedCriterion where it is not.
    """
    ends = m.camera.start.z, m.camera.end.z
    if any(map(is_symbolic, ends)) or np.ptp(np.concatenate(ends)) > LEVEL:
        raise UnsupportedCriterion(
            "surfaces round the camera are found at one camera height, but this camera goes up and down"
        )
    return float(np.round(ends[0][0], 6))
