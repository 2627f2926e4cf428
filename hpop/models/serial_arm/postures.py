"""Poses of an arm's bodies in many states (compiled kernel).

Import this module on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.runtime.compiled import inlined, kernel


@inlined
def _product(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Write the product of two poses (4, 4) to ``out``, except its last row."""
    for i in range(3):
        x, y, z = a[i, 0], a[i, 1], a[i, 2]
        for j in range(4):
            out[i, j] = x * b[0, j] + y * b[1, j] + z * b[2, j]
        out[i, 3] += a[i, 3]


@kernel
def place_bodies(
    origins: FloatArray,
    axes: FloatArray,
    sliding: BoolArray,
    values: FloatArray,
    frames: IntArray,
    offsets: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (B, N, 4, 4) where bodies are in the world in each state.

    origins, axes, sliding  of the n joints, as in :class:`hpop.models.serial_arm.chain.Chain`
    values   (n, N)         joint values, rad or m
    frames   (B,)           frame that carries each body
    offsets  (B, 4, 4)      pose of each body in its frame
    """
    joints, count = values.shape
    places, turn, step = np.zeros((joints + 1, 4, 4)), np.zeros((4, 4)), np.zeros((4, 4))
    for i in range(4):
        places[0, i, i] = 1.0
    for n in range(count):
        for k in range(joints):
            x, y, z, value = axes[k, 0], axes[k, 1], axes[k, 2], values[k, n]
            if sliding[k]:
                for i in range(3):
                    for j in range(3):
                        turn[i, j] = 1.0 if i == j else 0.0
                    turn[i, 3] = axes[k, i] * value
            else:
                sine, cosine = math.sin(value), math.cos(value)
                rest = 1.0 - cosine
                turn[0, 0], turn[0, 1], turn[0, 2] = (
                    cosine + rest * x * x,
                    rest * x * y - sine * z,
                    rest * x * z + sine * y,
                )
                turn[1, 0], turn[1, 1], turn[1, 2] = (
                    rest * x * y + sine * z,
                    cosine + rest * y * y,
                    rest * y * z - sine * x,
                )
                turn[2, 0], turn[2, 1], turn[2, 2] = (
                    rest * x * z - sine * y,
                    rest * y * z + sine * x,
                    cosine + rest * z * z,
                )
                turn[0, 3] = turn[1, 3] = turn[2, 3] = 0.0
            _product(origins[k], turn, step)
            _product(places[k], step, places[k + 1])
        for b in range(len(frames)):
            pose = out[b, n]
            _product(places[frames[b]], offsets[b], pose)
            pose[3, 0] = pose[3, 1] = pose[3, 2] = 0.0
            pose[3, 3] = 1.0
