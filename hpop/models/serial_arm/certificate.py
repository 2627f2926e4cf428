"""Proof that an arm does not collide anywhere along a motion, and lower bounds on its distances (compiled kernels).

A motion is a segment in joint space: q(s) = start + s Δ, with s from 0 to 1. Along it, no point of a body moves faster
than Λ = Σ ρ_k |Δ_k| per unit of s, where ρ_k is an upper bound on its distance from the axis of joint k (1 for a joint
that slides). For the distance of two bodies, only the joints between them count. So if the distance is d at s, the two
bodies do not touch at any s' with |s' - s| Λ < d. Since d is a proved lower bound on the distance
(:mod:`hpop.models.serial_arm.gjk`), a motion that is called free is free.

An interval of s is tested in its middle. The part that this test proves free is cut out. The remaining parts are tested
later, only for the pairs of bodies that are not proved yet. Each test proves a part, or finds the arm nearer than
allowed, so that every motion is decided.

There are two bounds ρ_k. For the whole motion, it is the sum of the link lengths between (``ArmScene.levers``). Near a
test, it is the present distance r_k plus its growth: within h of the test, points move at most
Σ |Δ_k| (r_k h + Λ_k h²/2), where Λ_k is their speed relative to joint k.

Import this module on first use only, because importing numba takes half a second.
"""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.models.serial_arm.gjk import distance
from hpop.models.serial_arm.scene import ArmScene
from hpop.runtime.compiled import kernel, lean

GAP = 0.25  # relative precision of distances that cannot prove the whole interval
POOL = 1 << 14  # room for lists of pairs, beside two full lists; once it is full, lists are no longer shortened


@lean
def placed(scene: ArmScene, q: FloatArray, poses: FloatArray, centres: FloatArray) -> None:
    """Compute where an arm is at joint values q (n,): frames and bodies in the world.

    Writes the poses of the frames to poses (n + 1, 3, 4), the world's first, and the centres of the bodies to centres
    (B, 3).
    """
    for k in range(q.size):
        at, before, origin = poses[k + 1], poses[k], scene.origins[k]
        for row in range(3):
            x, y, z = before[row, 0], before[row, 1], before[row, 2]
            for column in range(4):
                at[row, column] = x * origin[0, column] + y * origin[1, column] + z * origin[2, column]
            at[row, 3] += before[row, 3]
        if scene.sliding[k]:
            for row in range(3):
                at[row, 3] += q[k] * at[row, 2]
        else:
            cos, sin = math.cos(q[k]), math.sin(q[k])
            for row in range(3):
                x, y = at[row, 0], at[row, 1]
                at[row, 0], at[row, 1] = cos * x + sin * y, cos * y - sin * x
    for b in range(scene.frames.size):
        at, centre = poses[scene.frames[b]], scene.bodies.centre[b]
        for row in range(3):
            x, y, z = at[row, 0], at[row, 1], at[row, 2]
            centres[b, row] = x * centre[0] + y * centre[1] + z * centre[2] + at[row, 3]


@lean
def _relative(a: FloatArray, b: FloatArray, pose: FloatArray) -> None:
    """Write to ``pose`` the pose of frame b relative to frame a; all (3, 4)."""
    for row in range(3):
        x, y, z = a[0, row], a[1, row], a[2, row]
        for column in range(4):
            pose[row, column] = x * b[0, column] + y * b[1, column] + z * b[2, column]
        pose[row, 3] -= x * a[0, 3] + y * a[1, 3] + z * a[2, 3]


@lean
def _outside(scene: ArmScene, b: int, pose: FloatArray, x: float, y: float, z: float) -> float:
    """Return the distance, m, of a point (x, y, z) from the bounding box of body b; ``pose`` is its frame's pose."""
    box, centre = scene.bodies.box, scene.bodies.centre
    x, y, z = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
    u = pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z - centre[b, 0]
    v = pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z - centre[b, 1]
    w = pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z - centre[b, 2]
    square = 0.0
    for i in range(3):
        off = abs(box[b, i, 0] * u + box[b, i, 1] * v + box[b, i, 2] * w) - box[b, 3, i]
        if off > 0.0:
            square += off * off
    return math.sqrt(square)


@lean
def apart_at_least(scene: ArmScene, a: int, b: int, poses: FloatArray, centres: FloatArray, enough: float) -> float:
    """Return a cheap lower bound on the distance of two bodies, m, from their bounding spheres.

    If that is less than ``enough``, the bounding box of the larger body is used as well.
    """
    reach, x, y, z = scene.bodies.reach, centres[b, 0], centres[b, 1], centres[b, 2]
    dx, dy, dz = x - centres[a, 0], y - centres[a, 1], z - centres[a, 2]
    bound: float = math.sqrt(dx * dx + dy * dy + dz * dz) - reach[a] - reach[b]
    if bound >= enough:
        return bound
    if reach[a] < reach[b]:
        a, b = b, a
    by_box: float = _outside(scene, a, poses[scene.frames[a]], centres[b, 0], centres[b, 1], centres[b, 2]) - reach[b]
    return max(bound, by_box)


@lean
def measured(
    scene: ArmScene,
    pair: int,
    poses: FloatArray,
    centres: FloatArray,
    direction: FloatArray,
    scratch: FloatArray,
    near: float,
    enough: float,
    suffices: float,
    gap: float,
) -> tuple[float, float]:
    """Return a lower and an upper bound on the distance of a pair of bodies, m, by :func:`gjk.distance`.

    direction  (3,)  direction that separated them at the last test, from which the search begins; zeros at first
    scratch    (7, 4) or (7, 6)  memory; with six columns its last four rows return the nearest simplex

    ``near``, ``enough``, ``suffices`` and ``gap`` say when the search may stop, as in :func:`gjk.distance`.
    """
    a, b = scene.pairs[pair, 0], scene.pairs[pair, 1]
    first, second = poses[scene.frames[a]], poses[scene.frames[b]]
    pose, simplex = scratch[:3], scratch[3:]
    _relative(first, second, pose)
    if direction[0] == 0.0 and direction[1] == 0.0 and direction[2] == 0.0:
        x, y, z = centres[a, 0] - centres[b, 0], centres[a, 1] - centres[b, 1], centres[a, 2] - centres[b, 2]
        for i in range(3):
            direction[i] = first[0, i] * x + first[1, i] * y + first[2, i] * z
    bounds: tuple[float, float] = distance(scene.bodies, a, b, pose, direction, simplex, near, enough, suffices, gap)
    return bounds


@lean
def _speeds(scene: ArmScene, moved: FloatArray, slides: FloatArray, speeds: FloatArray) -> None:
    """Write upper bounds (B, n + 1), m, on how far the points of each body move relative to each frame.

    moved   (n,)  absolute changes |Δ| of the joints in the motion
    slides  (n,)  largest absolute values of the joints in the motion, because extended slides lengthen the arm
    speeds  result
    """
    for b in range(scene.frames.size):
        frame = scene.frames[b]
        longer, total = 0.0, 0.0
        for k in range(frame, moved.size + 1):
            speeds[b, k] = 0.0
        for k in range(frame - 1, -1, -1):
            if scene.sliding[k]:
                total += moved[k]
                longer += slides[k]
            else:
                total += moved[k] * (scene.levers[b, k] + longer)
            speeds[b, k] = total


@lean
def _speeds_here(
    scene: ArmScene,
    b: int,
    poses: FloatArray,
    centres: FloatArray,
    moved: FloatArray,
    slides: FloatArray,
    speeds: FloatArray,
    here: FloatArray,
    growth: FloatArray,
) -> None:
    """Write the bounds of :func:`_speeds` for one body b near its present position, where they are smaller.

    here[b] receives the bounds (n + 1,) at the present position, growth[b] half of their growth per unit of s.
    """
    longer, total, more = 0.0, 0.0, 0.0
    for k in range(scene.frames[b] - 1, -1, -1):
        if scene.sliding[k]:
            total += moved[k]
            longer += slides[k]
        else:
            frame = poses[k + 1]
            x, y, z = centres[b, 0] - frame[0, 3], centres[b, 1] - frame[1, 3], centres[b, 2] - frame[2, 3]
            u = y * frame[2, 2] - z * frame[1, 2]
            v = z * frame[0, 2] - x * frame[2, 2]
            w = x * frame[1, 2] - y * frame[0, 2]
            lever = math.sqrt(u * u + v * v + w * w) + scene.bodies.reach[b]
            total += moved[k] * min(lever, scene.levers[b, k] + longer)
            more += 0.5 * moved[k] * speeds[b, k + 1]
        here[b, k], growth[b, k] = total, more


@kernel
def blocked_by(
    scene: ArmScene,
    start: FloatArray,
    end: FloatArray,
    deviation: FloatArray,
    near: float,
    kept: float,
    found: IntArray,
) -> int:
    """Decide for each motion whether the arm is free along it, and write the blocking pair of bodies to found (M,).

    A value of -1 means proved free: no pair comes nearer than ``kept`` anywhere on the motion. A motion is blocked if
    a test finds a pair nearer than ``near``, or nearer than ``kept`` plus the deviations. Returns the number of tests.

    Parameters
    ----------
    start, end : (M, n) joint values at both ends; the motion is the segment between them in joint space
    deviation : (M, n) largest difference of each joint from this segment, for motions that are curved
    near, kept : m, 0 < kept <= near
    """
    count, joints, bodies = scene.pairs.shape[0], scene.sliding.size, scene.frames.size
    poses, centres = np.zeros((joints + 1, 3, 4)), np.empty((bodies, 3))
    poses[0, 0, 0] = poses[0, 1, 1] = poses[0, 2, 2] = 1.0
    speeds, offs = np.empty((bodies, joints + 1)), np.empty((bodies, joints + 1))
    directions, scratch = np.empty((count, 3)), np.empty((7, 4))
    moved, off, slides, q = np.empty(joints), np.empty(joints), np.empty(joints), np.empty(joints)
    pool = np.empty(POOL + 2 * count, np.int64)
    low, high = np.empty(256), np.empty(256)
    begins, ends = np.empty(256, np.int64), np.empty(256, np.int64)
    here, growth, known = np.empty((bodies, joints + 1)), np.empty((bodies, joints + 1)), np.full(bodies, -1)
    looks = 0
    for m in range(start.shape[0]):
        for k in range(joints):
            moved[k], off[k] = abs(end[m, k] - start[m, k]), deviation[m, k]
            slides[k] = max(abs(start[m, k]), abs(end[m, k])) + off[k]
        _speeds(scene, moved, slides, speeds)
        _speeds(scene, off, slides, offs)
        for pair in range(count):
            pool[pair] = pair
            directions[pair] = 0.0
        found[m] = -1
        used, head, tail = count, 0, 1
        low[0], high[0], begins[0], ends[0] = 0.0, 1.0, 0, count
        while head < tail and found[m] < 0:
            middle, half = 0.5 * (low[head] + high[head]), 0.5 * (high[head] - low[head])
            for k in range(joints):
                q[k] = start[m, k] + middle * (end[m, k] - start[m, k])
            placed(scene, q, poses, centres)
            looks += 1
            proved, first, fits = half, used, used + ends[head] - begins[head] <= pool.size
            for place in range(begins[head], ends[head]):
                pair = pool[place]
                a, b = scene.pairs[pair, 0], scene.pairs[pair, 1]
                frame = scene.frames[a]
                speed, least = speeds[b, frame], kept + offs[b, frame]
                enough = least + speed * half
                apart = apart_at_least(scene, a, b, poses, centres, enough)
                if apart >= enough:
                    continue
                if known[b] != looks:
                    _speeds_here(scene, b, poses, centres, moved, slides, speeds, here, growth)
                    known[b] = looks
                enough = min(enough, least + (here[b, frame] + growth[b, frame] * half) * half)
                if apart >= enough:
                    continue
                suffices = least + min(speed, here[b, frame] + growth[b, frame] * proved) * proved
                if apart < suffices:  # otherwise another pair limits what is proved; smaller intervals decide this one
                    lower, upper = measured(
                        scene, pair, poses, centres, directions[pair], scratch, near, enough, suffices, GAP
                    )
                    if lower >= enough:
                        continue
                    if upper < near or lower <= least:
                        found[m] = pair
                        break
                    room, slow = lower - least, here[b, frame]
                    further = 2.0 * room / (slow + math.sqrt(slow * slow + 4.0 * growth[b, frame] * room))
                    proved = min(proved, max(room / speed, further))
                if fits:
                    pool[used] = pair
                    used += 1
            if found[m] < 0 and proved < half:
                if tail + 2 > low.size:
                    low, high = np.append(low, np.empty(low.size)), np.append(high, np.empty(low.size))
                    begins = np.append(begins, np.empty(begins.size, np.int64))
                    ends = np.append(ends, np.empty(ends.size, np.int64))
                first, last = (first, used) if fits else (begins[head], ends[head])
                for side in range(2):
                    low[tail + side] = middle + proved if side else low[head]
                    high[tail + side] = high[head] if side else middle - proved
                    begins[tail + side], ends[tail + side] = first, last
                tail += 2
            head += 1
    return looks


@kernel
def nearest(scene: ArmScene, states: FloatArray, most: float, gap: float, least: FloatArray) -> None:
    """Write to least (N,), m, a lower bound on the smallest distance of any pair of bodies in each state (N, n).

    most  m, distance from which on distances need not be known: bounds are at most this
    gap   the smallest distance exceeds its bound by at most this share
    """
    count, joints, bodies = scene.pairs.shape[0], scene.sliding.size, scene.frames.size
    poses, centres = np.zeros((joints + 1, 3, 4)), np.empty((bodies, 3))
    poses[0, 0, 0] = poses[0, 1, 1] = poses[0, 2, 2] = 1.0
    direction, scratch, bounds = np.empty(3), np.empty((7, 4)), np.empty(count)
    for i in range(states.shape[0]):
        placed(scene, states[i], poses, centres)
        least[i], first = most, 0
        for pair in range(count):
            bounds[pair] = apart_at_least(scene, scene.pairs[pair, 0], scene.pairs[pair, 1], poses, centres, most)
            if bounds[pair] < bounds[first]:
                first = pair
        for place in range(count):  # start with the nearest pair, which often decides
            pair = first if place == 0 else place - 1 if place <= first else place
            if bounds[pair] < least[i]:
                direction[:] = 0.0
                lower, _ = measured(scene, pair, poses, centres, direction, scratch, 0.0, least[i], least[i], gap)
                least[i] = min(least[i], lower)
