"""Distance of two convex bodies, as a proved lower bound and an upper bound (compiled kernels).

The algorithm is that of Gilbert, Johnson and Keerthi 1988 (doi 10.1109/56.2083). It searches the Minkowski difference
of the bodies for its point v nearest to the origin, by a sequence of simplices. Let w be the support point of the
difference in the direction -v. Then a plane separates the bodies, and no two of their points are nearer than v·w/|v|
(the duality gap of van den Bergen 1999, doi 10.1080/10867651.1999.10487502). This lower bound holds for any v, so after
any number of steps, from any first direction, for degenerate simplices and for round bodies. The treatment of simplices
only decides how soon the two bounds are close.

Deviation from the source: the nearest point of a simplex is found region by region (Ericson 2004, Real-Time Collision
Detection, 5.1). The projection on a triangle uses its normal, which is precise where barycentric coordinates are not.

Import this module on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

from hpop.base.arrays import FloatArray
from hpop.models.serial_arm.scene import Bodies
from hpop.runtime.compiled import lean

STEPS = 128  # most steps; bodies without round parts take about 10
TOUCHING = 1e-14  # share of a simplex' size: a simplex nearer than that to the origin counts as containing it
Point = tuple[float, float, float]
Nearest = tuple[float, float, float, int]


@lean
def support(bodies: Bodies, b: int, x: float, y: float, z: float) -> Point:
    """Return the point of body b that is farthest in the direction (x, y, z); the ball's radius is not added."""
    points = bodies.points
    best, at = -math.inf, bodies.first[b]
    for i in range(bodies.first[b], bodies.first[b + 1]):
        along = points[i, 0] * x + points[i, 1] * y + points[i, 2] * z
        if along > best:
            best, at = along, i
    px, py, pz = points[at, 0], points[at, 1], points[at, 2]
    if bodies.disc[b] > 0.0:
        plane = bodies.plane
        u = plane[b, 0, 0] * x + plane[b, 0, 1] * y + plane[b, 0, 2] * z
        v = plane[b, 1, 0] * x + plane[b, 1, 1] * y + plane[b, 1, 2] * z
        across = math.sqrt(u * u + v * v)
        if across > 0.0:
            u, v = u * bodies.disc[b] / across, v * bodies.disc[b] / across
            px += u * plane[b, 0, 0] + v * plane[b, 1, 0]
            py += u * plane[b, 0, 1] + v * plane[b, 1, 1]
            pz += u * plane[b, 0, 2] + v * plane[b, 1, 2]
    return px, py, pz


@lean
def _on_segment(simplex: FloatArray, i: int, j: int) -> Nearest:
    """Return the point nearest to the origin on the segment between corners i and j of a simplex.

    The fourth value tells which corners span it: bit i is set for corner i.
    """
    ax, ay, az = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    dx, dy, dz = simplex[j, 0] - ax, simplex[j, 1] - ay, simplex[j, 2] - az
    square, along = dx * dx + dy * dy + dz * dz, -(ax * dx + ay * dy + az * dz)
    if along <= 0.0:
        return ax, ay, az, 1 << i
    if along >= square:
        return simplex[j, 0], simplex[j, 1], simplex[j, 2], 1 << j
    share = along / square
    return ax + share * dx, ay + share * dy, az + share * dz, 1 << i | 1 << j


@lean
def _on_triangle(simplex: FloatArray, i: int, j: int, k: int) -> Nearest:
    """Return the point of the triangle i, j, k nearest to the origin, and the corners that span it as bits."""
    found: Nearest
    ax, ay, az = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    bx, by, bz = simplex[j, 0], simplex[j, 1], simplex[j, 2]
    cx, cy, cz = simplex[k, 0], simplex[k, 1], simplex[k, 2]
    ux, uy, uz = bx - ax, by - ay, bz - az
    vx, vy, vz = cx - ax, cy - ay, cz - az
    ua, va = -(ux * ax + uy * ay + uz * az), -(vx * ax + vy * ay + vz * az)
    if ua <= 0.0 and va <= 0.0:
        return ax, ay, az, 1 << i
    ub, vb = -(ux * bx + uy * by + uz * bz), -(vx * bx + vy * by + vz * bz)
    if ub >= 0.0 and vb <= ub:
        return bx, by, bz, 1 << j
    if ua * vb - ub * va <= 0.0 and ua >= 0.0 and ub <= 0.0:
        found = _on_segment(simplex, i, j)
        return found
    uc, vc = -(ux * cx + uy * cy + uz * cz), -(vx * cx + vy * cy + vz * cz)
    if vc >= 0.0 and uc <= vc:
        return cx, cy, cz, 1 << k
    if uc * va - ua * vc <= 0.0 and va >= 0.0 and vc <= 0.0:
        found = _on_segment(simplex, i, k)
        return found
    if ub * vc - uc * vb <= 0.0 and vb >= ub and uc >= vc:
        found = _on_segment(simplex, j, k)
        return found
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square == 0.0:
        found = _on_segment(simplex, j, k)
        return found
    share = (nx * ax + ny * ay + nz * az) / square
    return share * nx, share * ny, share * nz, 1 << i | 1 << j | 1 << k


@lean
def _is_beyond(simplex: FloatArray, i: int, j: int, k: int, opposite: int) -> bool:
    """Return whether the origin and the opposite corner are on different sides of the face i, j, k of a simplex.

    The answer is also True if the simplex is too flat to tell.
    """
    ax, ay, az = simplex[i, 0], simplex[i, 1], simplex[i, 2]
    ux, uy, uz = simplex[j, 0] - ax, simplex[j, 1] - ay, simplex[j, 2] - az
    vx, vy, vz = simplex[k, 0] - ax, simplex[k, 1] - ay, simplex[k, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    dx, dy, dz = simplex[opposite, 0] - ax, simplex[opposite, 1] - ay, simplex[opposite, 2] - az
    height = nx * dx + ny * dy + nz * dz
    origin = -(nx * ax + ny * ay + nz * az)
    flat = 1e-24 * (nx * nx + ny * ny + nz * nz) * (dx * dx + dy * dy + dz * dz)
    beyond: bool = height * height <= flat or height * origin < 0.0
    return beyond


@lean
def _on_simplex(simplex: FloatArray, size: int) -> Nearest:
    """Return the point of a simplex nearest to the origin, and the corners that span it as bits.

    All four bits are set only if the simplex contains the origin.
    """
    found: Nearest
    if size == 1:
        return simplex[0, 0], simplex[0, 1], simplex[0, 2], 1
    if size == 2:
        found = _on_segment(simplex, 0, 1)
        return found
    if size == 3:
        found = _on_triangle(simplex, 0, 1, 2)
        return found
    x, y, z, corners, least = 0.0, 0.0, 0.0, 15, math.inf
    for opposite in range(4):
        i, j, k = (opposite + 1) & 3, (opposite + 2) & 3, (opposite + 3) & 3
        if _is_beyond(simplex, i, j, k, opposite):
            px, py, pz, some = _on_triangle(simplex, i, j, k)
            square = px * px + py * py + pz * pz
            if square < least:
                x, y, z, corners, least = px, py, pz, some, square
    return x, y, z, corners


@lean
def distance(
    bodies: Bodies,
    a: int,
    b: int,
    pose: FloatArray,
    direction: FloatArray,
    simplex: FloatArray,
    near: float,
    enough: float,
    suffices: float,
    gap: float,
) -> tuple[float, float]:
    """Return a proved lower bound and an upper bound on the distance of two bodies, m.

    The search stops as soon as one of these holds: the upper bound is below ``near``; the lower bound has reached
    ``enough``; the upper bound is below ``enough`` and the lower bound has reached ``suffices``; the bounds differ by
    at most the share ``gap`` of the upper one; or floating-point numbers allow no progress.

    Parameters
    ----------
    pose : (3, 4) pose of the frame of b in the frame of a
    direction : (3,) direction from b to a, in the frame of a: the first one to try, replaced by that of the last step
    simplex : (4, 3) or wider, memory. With six columns, the last three return the points of b, in its frame, that
        belong to the corners of the nearest simplex; rows without a corner are infinite there
    """
    keeps = simplex.shape[1] == 6
    margin = bodies.ball[a] + bodies.ball[b]
    x, y, z = direction[0], direction[1], direction[2]
    if not x * x + y * y + z * z > 0.0:
        x, y, z = 1.0, 0.0, 0.0
    size, lower, upper = 0, 0.0, math.inf
    length = math.sqrt(x * x + y * y + z * z)
    for _ in range(STEPS):
        ax, ay, az = support(bodies, a, -x, -y, -z)
        bx, by, bz = support(
            bodies,
            b,
            pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
            pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
            pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
        )
        wx = ax - (pose[0, 0] * bx + pose[0, 1] * by + pose[0, 2] * bz + pose[0, 3])
        wy = ay - (pose[1, 0] * bx + pose[1, 1] * by + pose[1, 2] * bz + pose[1, 3])
        wz = az - (pose[2, 0] * bx + pose[2, 1] * by + pose[2, 2] * bz + pose[2, 3])
        direction[0], direction[1], direction[2] = x, y, z
        below = (x * wx + y * wy + z * wz) / length - margin
        risen = below > lower
        lower = max(lower, below)
        if lower >= enough or (size and upper - lower <= gap * upper):
            break
        known = False
        for i in range(size):
            known |= simplex[i, 0] == wx and simplex[i, 1] == wy and simplex[i, 2] == wz
        if known:
            break
        simplex[size, 0], simplex[size, 1], simplex[size, 2] = wx, wy, wz
        if keeps:
            simplex[size, 3], simplex[size, 4], simplex[size, 5] = bx, by, bz
        x, y, z, corners = _on_simplex(simplex, size + 1)
        left, largest = 0, 0.0
        for i in range(size + 1):
            largest = max(largest, abs(simplex[i, 0]) + abs(simplex[i, 1]) + abs(simplex[i, 2]))
            if corners >> i & 1:
                for column in range(6 if keeps else 3):
                    simplex[left, column] = simplex[i, column]
                left += 1
        size = left
        length = math.sqrt(x * x + y * y + z * z)
        if size == 4 or length <= TOUCHING * largest:
            upper = 0.0
            break
        if not (length - margin < upper or risen):  # neither bound improves: the numbers allow no more precision
            break
        upper = min(upper, max(0.0, length - margin))
        if upper < near or (upper < enough and lower >= suffices):
            break
    if keeps:
        for i in range(size, 4):
            simplex[i, 3] = math.inf
    return lower, upper
