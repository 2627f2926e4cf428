"""Distances of bodies of an arm that are near each other, and their gradients by the joints (compiled).

A distance is that of :mod:`hpop.models.collision.gjk` to a billionth. It has a gradient where no other points are as
near as the nearest; where edges or faces are parallel, central differences give one of its generalised gradients.

Imported on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import kernel
from hpop.models.serial_arm.certificate import apart_at_least, measured, placed
from hpop.models.serial_arm.scene import Scene

PRECISE = 1e-9  # relative
ASIDE = 1e-5  # rad or m: how far each joint is moved for a difference


@kernel
def near_pairs(
    scene: Scene, states: FloatArray, within: float, owner: IntArray, distance: FloatArray, gradient: FloatArray
) -> int:
    """Write state, distance and gradient of each pair nearer than ``within`` m in states (N, n).

    Returns how many there are; what does not fit into ``owner`` (R,) is only counted.
    """
    count, joints, bodies = scene.pairs.shape[0], scene.sliding.size, scene.frames.size
    poses, centres = np.zeros((2 * joints + 1, joints + 1, 3, 4)), np.empty((2 * joints + 1, bodies, 3))
    for place in range(2 * joints + 1):
        for row in range(3):
            poses[place, 0, row, row] = 1.0
    direction, scratch, q = np.empty(3), np.empty((7, 4)), np.empty(joints)
    found = 0
    for i in range(states.shape[0]):
        q[:] = states[i]
        placed(scene, q, poses[0], centres[0])
        moved = False
        for pair in range(count):
            a, b = scene.pairs[pair, 0], scene.pairs[pair, 1]
            if apart_at_least(scene, a, b, poses[0], centres[0], within) >= within:
                continue
            direction[:] = 0.0
            apart, _ = measured(scene, pair, poses[0], centres[0], direction, scratch, 0.0, within, within, PRECISE)
            if apart >= within:
                continue
            if found < owner.size:
                for k in range(joints if not moved else 0):
                    for side in range(2):
                        q[k] = states[i, k] + (ASIDE if side == 0 else -ASIDE)
                        placed(scene, q, poses[1 + 2 * k + side], centres[1 + 2 * k + side])
                    q[k] = states[i, k]
                moved = True
                owner[found], distance[found] = i, apart
                for k in range(joints):
                    gradient[found, k] = 0.0
                    if scene.frames[a] <= k < scene.frames[b]:
                        for side in range(2):
                            place = 1 + 2 * k + side
                            aside, _ = measured(
                                scene, pair, poses[place], centres[place], direction, scratch,
                                0.0, math.inf, math.inf, PRECISE,
                            )  # fmt: skip
                            gradient[found, k] += (aside if side == 0 else -aside) / (2.0 * ASIDE)
            found += 1
    return found
