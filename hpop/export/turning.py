"""Rotations as formats ask for them: angles of a quaternion, products, matrices; quaternions are x, y, z, w."""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import FloatArray


def matrices(quaternions: FloatArray) -> FloatArray:
    """Rotation matrices (N, 3, 3) of unit quaternions (N, 4); their columns are the axes of the body."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def pitch_of(quaternions: FloatArray) -> FloatArray:
    """How far up each looks (N,), rad."""
    ahead = matrices(quaternions)[:, :, 0]
    return np.arctan2(ahead[:, 2], np.hypot(ahead[:, 0], ahead[:, 1]))


def roll_of(quaternions: FloatArray) -> FloatArray:
    """How far each leans to the right (N,), rad."""
    turned = matrices(quaternions)
    return np.arctan2(turned[:, 2, 1], turned[:, 2, 2])


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotations (N, 4): b first, then a (Hamilton)."""
    ax, ay, az, aw = a.T
    bx, by, bz, bw = b.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def back(quaternions: FloatArray) -> FloatArray:
    """The rotations (N, 4) the other way round."""
    turned: FloatArray = quaternions * np.array([-1.0, -1.0, -1.0, 1.0])
    return turned
