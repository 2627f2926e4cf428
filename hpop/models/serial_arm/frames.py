"""Where the frames of a chain are, as matrices: what the solids that an arm carries are placed by."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.models.serial_arm.chain import Chain
from hpop.motions import States


def frames(chain: Chain, states: States) -> list[FloatArray]:
    """Poses (N, 4, 4) of frames 0 to n in each of the states; of numbers."""
    found = [np.broadcast_to(np.eye(4), (states.size, 4, 4))]
    for name, sliding, axis, origin in zip(chain.names, chain.sliding, chain.axes, chain.origins, strict=True):
        value = np.broadcast_to(getattr(states, name), (states.size,))
        found.append(found[-1] @ origin @ (_slid if sliding else _turned)(axis, value))
    return found


def _slid(axis: FloatArray, way: FloatArray) -> FloatArray:
    """Poses (N, 4, 4) that ways (N,), m, along an axis lead to."""
    poses: FloatArray = np.tile(np.eye(4), (way.size, 1, 1))
    poses[:, :3, 3] = way[:, None] * axis
    return poses


def _turned(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Poses (N, 4, 4) that angles (N,), rad, about an axis lead to (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    poses: FloatArray = np.tile(np.eye(4), (angle.size, 1, 1))
    poses[:, :3, :3] += sine * skew + rest * (skew @ skew)
    return poses
