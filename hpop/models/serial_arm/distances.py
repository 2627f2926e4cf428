"""Distances of an arm: the smallest one along each motion, and gradients of small ones (compiled kernels).

**Smallest distance along a motion**, within a proved tolerance. A motion is a segment in joint space: q(s) = start +
s Δ, with s from 0 to 1. At a test, let n be a direction that separates a body from an obstacle, by a plane at right
angles to n. When s differs from the tested one by δ, all points p of the body are beyond the plane by at least

    min over p of n·(p + δ p') - ½ A δ²

Here p' = v + ω x p is the velocity per unit of s, so the minimum is attained at the support point of the body in the
direction n + δ (n x ω). The minimum is concave in δ, hence above the chord between δ = 0 and the end of the interval. A
is an upper bound on |p''|: a second derivative by two joints is at most the distance from the axis of the later joint.
The bound is of second order, so intervals near the smallest distance need not be very short.

The ends of a motion are tested first, then each interval in its middle. Parts of it that are proved to be farther away
than the smallest distance so far, less the tolerance, are cut out. The remaining parts are tested later, only for the
obstacles that are not proved yet.

**Gradients.** Distances are computed by :mod:`hpop.models.serial_arm.gjk`, to a billionth. Let p be the point of body b
nearest to body a, and n the direction from p to the nearest point of a. The derivative of the distance by a joint that
carries b, but not a, is -n·(∂p/∂q). This is the gradient if the nearest points are unique. Where edges or faces are
parallel, it is the gradient for one pair of nearest points.

Import this module on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.models.serial_arm.certificate import GAP, POOL, apart_at_least, measured, placed
from hpop.models.serial_arm.gjk import support
from hpop.models.serial_arm.scene import ArmScene
from hpop.runtime.compiled import kernel, lean

PRECISE = 1e-6  # relative: by how much a smallest distance along a motion may be too small
NEARLY_EXACT = 1e-9  # relative: by how much a distance with a gradient may be too small


@lean
def _bounds(scene: ArmScene, b: int, moved: FloatArray, slides: FloatArray) -> tuple[float, float]:
    """Return upper bounds on the first and second derivatives by s of the points of body b along a motion.

    moved   (n,)  absolute changes |Δ| of the joints
    slides  (n,)  largest absolute values of the joints, because extended slides lengthen the arm
    """
    before = 0.0
    for k in range(scene.frames[b]):
        before += moved[k]
    longer = speed = change = 0.0
    for k in range(scene.frames[b] - 1, -1, -1):
        before -= moved[k]
        if scene.sliding[k]:
            speed += moved[k]
            change += 2.0 * moved[k] * before
            longer += slides[k]
        else:
            lever = scene.levers[b, k] + longer
            speed += moved[k] * lever
            change += moved[k] * lever * (moved[k] + 2.0 * before)
    return speed, change


@lean
def _twists(scene: ArmScene, way: FloatArray, poses: FloatArray, twists: FloatArray) -> None:
    """Write the twists (n + 1, 6) of the frames per unit of s along a motion with joint changes ``way`` (n,).

    A twist is the velocity of the frame's point at the origin of the world, then the angular velocity.
    """
    for k in range(way.size):
        for i in range(6):
            twists[k + 1, i] = twists[k, i]
        pose, rate = poses[k + 1], way[k]
        x, y, z = rate * pose[0, 2], rate * pose[1, 2], rate * pose[2, 2]
        if scene.sliding[k]:
            twists[k + 1, 0] += x
            twists[k + 1, 1] += y
            twists[k + 1, 2] += z
        else:
            twists[k + 1, 0] += pose[1, 3] * z - pose[2, 3] * y
            twists[k + 1, 1] += pose[2, 3] * x - pose[0, 3] * z
            twists[k + 1, 2] += pose[0, 3] * y - pose[1, 3] * x
            twists[k + 1, 3] += x
            twists[k + 1, 4] += y
            twists[k + 1, 5] += z


@lean
def _least_along(scene: ArmScene, b: int, pose: FloatArray, x: float, y: float, z: float) -> float:
    """Return the smallest scalar product of a body's points with the vector (x, y, z), in the world."""
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z
    px, py, pz = support(scene.bodies, b, -u, -v, -w)
    ball = scene.bodies.ball[b] * math.sqrt(x * x + y * y + z * z)
    least: float = pose[0, 3] * x + pose[1, 3] * y + pose[2, 3] * z + px * u + py * v + pz * w - ball
    return least


@lean
def _cut(above: float, slope: float, change: float) -> float:
    """Return the largest δ >= 0 up to which above + slope δ - ½ change δ² stays above 0, for above >= 0."""
    if change <= 0.0:
        return math.inf if slope >= 0.0 else above / -slope
    root = math.sqrt(slope * slope + 2.0 * change * above)
    return (slope + root) / change if slope > 0.0 else 2.0 * above / (root - slope) if root > slope else 0.0


@lean
def _proved(
    scene: ArmScene,
    pair: int,
    poses: FloatArray,
    twists: FloatArray,
    direction: FloatArray,
    floor: float,
    change: float,
    before: float,
    after: float,
) -> tuple[float, float]:
    """Return how far s may differ from a test, to either side, while a pair surely stays ``floor`` m apart.

    direction      (3,)  from the second body to the first, which is fixed; a plane across it separates the two
    change         upper bound on the second derivative of the second body's points by s
    before, after  lengths of the interval of s before and after the test
    """
    a, b = scene.pairs[pair, 0], scene.pairs[pair, 1]
    pose, twist = poses[scene.frames[b]], twists[scene.frames[b]]
    x, y, z = -direction[0], -direction[1], -direction[2]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    plane: float = _least_along(scene, a, poses[scene.frames[a]], -x, -y, -z)
    here: float = _least_along(scene, b, pose, x, y, z)
    above = here + plane - floor
    if not above > 0.0:
        return 0.0, 0.0
    u, v, w = y * twist[5] - z * twist[4], z * twist[3] - x * twist[5], x * twist[4] - y * twist[3]
    along = x * twist[0] + y * twist[1] + z * twist[2]
    far_before = far_after = 0.0
    if before > 0.0:
        there: float = _least_along(scene, b, pose, x - before * u, y - before * v, z - before * w)
        far_before = _cut(above, (there - here) / before - along, change)
    if after > 0.0:
        there = _least_along(scene, b, pose, x + after * u, y + after * v, z + after * w)
        far_after = _cut(above, (there - here) / after + along, change)
    return far_before, far_after


@kernel
def closest(
    scene: ArmScene, start: FloatArray, end: FloatArray, most: float, tolerance: float, least: FloatArray
) -> int:
    """Write to least (M,) the smallest distance, m, of any pair of bodies along each motion, at most ``most``.

    start, end  (M, n) joint values at both ends; a motion is the segment between them in joint space
    tolerance   m, by which a result may be too large

    A result may also be too small, by the precision of distances: a millionth, or a hundredth of a millimetre between
    two round bodies. The first body of each pair must be fixed. Returns the number of tests.
    """
    count, joints, bodies = scene.pairs.shape[0], scene.sliding.size, scene.frames.size
    poses, centres = np.zeros((joints + 1, 3, 4)), np.empty((bodies, 3))
    poses[0, 0, 0] = poses[0, 1, 1] = poses[0, 2, 2] = 1.0
    twists, scratch = np.zeros((joints + 1, 6)), np.empty((7, 4))
    directions, speeds, changes = np.empty((count, 3)), np.empty(bodies), np.empty(bodies)
    q, way, moved, slides = np.empty(joints), np.empty(joints), np.empty(joints), np.empty(joints)
    low, high, begins, ends = np.empty(64), np.empty(64), np.empty(64, np.int64), np.empty(64, np.int64)
    pool, near = np.empty(2 * count + POOL, np.int64), np.empty(count, np.int64)
    lowers, asked = np.empty(count), np.empty(count, np.bool_)
    for pair in range(count):
        pool[pair] = pair
    looks = 0
    for m in range(start.shape[0]):
        for k in range(joints):
            way[k] = end[m, k] - start[m, k]
            moved[k], slides[k] = abs(way[k]), max(abs(start[m, k]), abs(end[m, k]))
        for b in range(bodies):
            speeds[b], changes[b] = _bounds(scene, b, moved, slides)
        directions[:] = 0.0
        seen, used, head, tail = most, count, 0, 1
        low[0], high[0], begins[0], ends[0] = 0.0, 1.0, 0, count
        while head < tail and seen > 0.0:
            place = 0.0 if head == 0 else 1.0 if head == 1 and low[1] > 0.0 else 0.5 * (low[head] + high[head])
            before, after = place - low[head], high[head] - place
            half = max(before, after)
            for k in range(joints):
                q[k] = start[m, k] + place * way[k]
            placed(scene, q, poses, centres)
            _twists(scene, way, poses, twists)
            looks += 1
            left, nearest = 0, 0
            for i in range(begins[head], ends[head]):
                pair = pool[i]
                enough = seen - tolerance + speeds[scene.pairs[pair, 1]] * half
                apart = apart_at_least(scene, scene.pairs[pair, 0], scene.pairs[pair, 1], poses, centres, enough)
                if apart < enough:
                    near[left], lowers[left], asked[left] = pair, apart, False
                    nearest = left if apart < lowers[nearest] else nearest
                    left += 1
            if left:  # start with the nearest obstacle, which often decides
                near[0], near[nearest] = near[nearest], near[0]
                lowers[0], lowers[nearest] = lowers[nearest], lowers[0]
            for i in range(left):
                if lowers[i] < seen:
                    pair, asked[i] = near[i], True
                    enough = seen - tolerance + speeds[scene.pairs[pair, 1]] * half
                    lowers[i], upper = measured(
                        scene, pair, poses, centres, directions[pair], scratch, 0.0, enough, seen, PRECISE
                    )
                    if lowers[i] < seen and upper - lowers[i] > PRECISE * upper:  # no progress on round bodies: restart
                        directions[pair] = 0.0
                        again, _ = measured(
                            scene, pair, poses, centres, directions[pair], scratch, 0.0, enough, seen, PRECISE
                        )
                        lowers[i] = max(lowers[i], again)
                    seen = min(seen, lowers[i])
            floor, proved_before, proved_after = seen - tolerance, before, after
            first, fits = used, used + left <= pool.size
            for i in range(left):
                pair, b = near[i], scene.pairs[near[i], 1]
                speed, enough = speeds[b], floor + speeds[b] * half
                suffices = floor + speed * max(proved_before, proved_after)
                if lowers[i] < suffices and not asked[i]:
                    lowers[i], _ = measured(
                        scene, pair, poses, centres, directions[pair], scratch, 0.0, enough, suffices, GAP
                    )
                if lowers[i] >= enough:
                    continue
                if lowers[i] < suffices:  # otherwise other pairs limit the proof; smaller intervals decide this one
                    far_before, far_after = _proved(
                        scene, pair, poses, twists, directions[pair], floor, changes[b], before, after
                    )
                    room = (lowers[i] - floor) / speed
                    far_before, far_after = max(far_before, room), max(far_after, room)
                    if far_before >= before and far_after >= after:
                        continue
                    proved_before, proved_after = min(proved_before, far_before), min(proved_after, far_after)
                if fits:
                    pool[used] = pair
                    used += 1
            if tail + 2 > low.size:
                low, high = np.append(low, np.empty(low.size)), np.append(high, np.empty(low.size))
                begins = np.append(begins, np.empty(begins.size, np.int64))
                ends = np.append(ends, np.empty(ends.size, np.int64))
            for side in range(2):
                if (proved_after < after) if side else (proved_before < before):
                    low[tail] = place + proved_after if side else low[head]
                    high[tail] = high[head] if side else place - proved_before
                    begins[tail], ends[tail] = (first, used) if fits else (begins[head], ends[head])
                    tail += 1
            head += 1
        least[m] = max(0.0, seen)
    return looks


@lean
def _shares(simplex: FloatArray, shares: FloatArray) -> int:
    """Write the barycentric coordinates (3,) of the point of a simplex nearest to the origin; return their number.

    The simplex must have no other corners than those that span this point, as ``distance`` leaves it. Returns 0 if the
    origin is inside the simplex, or if a triangle is flat.
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
    scene: ArmScene, a: int, b: int, poses: FloatArray, simplex: FloatArray, shares: FloatArray, gradient: FloatArray
) -> None:
    """Write the derivative (n,) of the distance of two bodies by each joint.

    simplex  corners that span the nearest points, as left by :func:`gjk.distance`
    shares   memory for their barycentric coordinates
    """
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
    scene: ArmScene, states: FloatArray, within: float, owner: IntArray, distance: FloatArray, gradient: FloatArray
) -> int:
    """Write the state's index, distance and gradient of each pair of bodies closer than ``within`` m, in N states.

    states    (N, n)  joint values
    owner     (R,)    result: index of the state of each pair found
    distance  (R,)    result, m
    gradient  (R, n)  result: derivatives of the distance by the joints

    Returns the number of pairs found; those beyond the room of R are only counted.
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
            apart, _ = measured(scene, pair, poses, centres, direction, scratch, 0.0, within, within, NEARLY_EXACT)
            if apart >= within:
                continue
            if found < owner.size:
                owner[found], distance[found] = i, apart
                _change(scene, a, b, poses, scratch[3:], shares, gradient[found])
            found += 1
    return found
