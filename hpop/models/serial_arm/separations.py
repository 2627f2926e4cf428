"""Distances of bodies of an arm that are near each other, and their gradients by the joints (compiled).

A distance is that of :mod:`hpop.models.collision.gjk` to a billionth. With n from the point of b that is nearest to a
to that of a, and p the former, it changes by -n·(∂p/∂q) with a joint that carries b and not a. That is its gradient
where no other points are as near; where edges or faces are parallel, it is that of one of the pairs of nearest points.

Imported on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.models.serial_arm.certificate import apart_at_least, measured, placed
from hpop.models.serial_arm.scene import Scene
from hpop.runtime.compiled import kernel, lean

PRECISE = 1e-9  # relative


@lean
def _shares(simplex: FloatArray, shares: FloatArray) -> int:
    """Write of which shares (3,) of its corners the point of a simplex nearest to the origin is made; their number.

    0 where the origin is within it. Corners that are not needed are left out already.
    """
    size = 0
    while size < 4 and simplex[size, 3] < math.inf:
        size += 1
    ax, ay, az = simplex[0, 0], simplex[0, 1], simplex[0, 2]
    shares[0] = 1.0
    if size == 4:
        return 0
    if size == 1:
        return 1
    ux, uy, uz = simplex[1, 0] - ax, simplex[1, 1] - ay, simplex[1, 2] - az
    uu, ua = ux * ux + uy * uy + uz * uz, -(ux * ax + uy * ay + uz * az)
    if size == 2:
        shares[1] = ua / uu
        shares[0] = 1.0 - shares[1]
        return 2
    vx, vy, vz = simplex[2, 0] - ax, simplex[2, 1] - ay, simplex[2, 2] - az
    vv, va, uv = vx * vx + vy * vy + vz * vz, -(vx * ax + vy * ay + vz * az), ux * vx + uy * vy + uz * vz
    square = uu * vv - uv * uv
    if not square > 0.0:
        return 0
    shares[1], shares[2] = (ua * vv - va * uv) / square, (va * uu - ua * uv) / square
    shares[0] = 1.0 - shares[1] - shares[2]
    return 3


@lean
def _change(
    scene: Scene, a: int, b: int, poses: FloatArray, simplex: FloatArray, shares: FloatArray, gradient: FloatArray
) -> None:
    """Write how the distance of two bodies changes with each joint (n,), by the nearest simplex of their difference."""
    gradient[:] = 0.0
    nx, ny, nz, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(_shares(simplex, shares)):
        share = shares[i]
        nx, ny, nz = nx + share * simplex[i, 0], ny + share * simplex[i, 1], nz + share * simplex[i, 2]
        px, py, pz = px + share * simplex[i, 3], py + share * simplex[i, 4], pz + share * simplex[i, 5]
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if length == 0.0:
        return
    first, second = poses[scene.frames[a]], poses[scene.frames[b]]
    x = (first[0, 0] * nx + first[0, 1] * ny + first[0, 2] * nz) / length
    y = (first[1, 0] * nx + first[1, 1] * ny + first[1, 2] * nz) / length
    z = (first[2, 0] * nx + first[2, 1] * ny + first[2, 2] * nz) / length
    qx = second[0, 0] * px + second[0, 1] * py + second[0, 2] * pz + second[0, 3]
    qy = second[1, 0] * px + second[1, 1] * py + second[1, 2] * pz + second[1, 3]
    qz = second[2, 0] * px + second[2, 1] * py + second[2, 2] * pz + second[2, 3]
    for k in range(scene.frames[a], scene.frames[b]):
        axis = poses[k + 1]
        ux, uy, uz = axis[0, 2], axis[1, 2], axis[2, 2]
        if scene.sliding[k]:
            gradient[k] = -(x * ux + y * uy + z * uz)
        else:
            rx, ry, rz = qx - axis[0, 3], qy - axis[1, 3], qz - axis[2, 3]
            gradient[k] = -(x * (uy * rz - uz * ry) + y * (uz * rx - ux * rz) + z * (ux * ry - uy * rx))


@kernel
def near_pairs(
    scene: Scene, states: FloatArray, within: float, owner: IntArray, distance: FloatArray, gradient: FloatArray
) -> int:
    """Write state, distance and gradient of each pair nearer than ``within`` m in states (N, n).

    Returns how many there are; what does not fit into ``owner`` (R,) is only counted.
    """
    count, joints, bodies = scene.pairs.shape[0], scene.sliding.size, scene.frames.size
    poses, centres = np.zeros((joints + 1, 3, 4)), np.empty((bodies, 3))
    poses[0, 0, 0] = poses[0, 1, 1] = poses[0, 2, 2] = 1.0
    direction, scratch, shares = np.empty(3), np.empty((7, 6)), np.empty(3)
    found = 0
    for i in range(states.shape[0]):
        placed(scene, states[i], poses, centres)
        for pair in range(count):
            a, b = scene.pairs[pair, 0], scene.pairs[pair, 1]
            if apart_at_least(scene, a, b, poses, centres, within) >= within:
                continue
            direction[:] = 0.0
            apart, _ = measured(scene, pair, poses, centres, direction, scratch, 0.0, within, within, PRECISE)
            if apart >= within:
                continue
            if found < owner.size:
                owner[found], distance[found] = i, apart
                _change(scene, a, b, poses, scratch[3:], shares, gradient[found])
            found += 1
    return found
