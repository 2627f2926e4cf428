"""Compiled loops for geometry: distances to the nearest of many edges, and rays that enter and leave convex bodies."""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean

# The first plan waits while these kernels compile; each function called makes this longer.
PARALLEL = 1e-15  # sine of the angle below which a line counts as parallel to a plane
TOUCH = 1e-6  # m: a body that a ray enters sooner counts as containing the origin, as a camera's case does
WIDER = 1e-6  # rad by which a cone is widened against rounding
NOWHERE = (1.0, 0.0)  # an empty interval


@lean
def nearest(
    edges: FloatArray,
    members: IntArray,
    boxes: FloatArray,
    waiting: IntArray,
    away: FloatArray,
    x: FloatArray,
    y: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (M,) the distance, m, of each point to its nearest edge; see `EdgeTree` for the other arrays.

    ``waiting`` and ``away`` are scratch memory, two numbers for each level of the tree. The nearer of two boxes is
    searched first; boxes farther than the nearest edge so far are skipped. Successive points are mostly close together,
    so each search begins at the leaf of the last nearest edge.
    """
    inner = len(boxes) - len(members)
    width = members.shape[1]
    last = inner
    for n in range(x.size):
        if math.isnan(x[n]) or math.isnan(y[n]):
            out[n] = math.nan
            continue
        best = math.inf
        waiting[0], away[0], waiting[1], away[1] = 0, 0.0, last, 0.0
        count = 2
        while count > 0:
            count -= 1
            node = waiting[count]
            if away[count] > best:
                continue
            if node >= inner:
                for m in range(width):
                    e = members[node - inner, m]
                    wx, wy = x[n] - edges[e, 0], y[n] - edges[e, 1]
                    dx, dy = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
                    length2 = dx * dx + dy * dy
                    if length2 > 0.0:
                        t = min(max((wx * dx + wy * dy) / length2, 0.0), 1.0)
                        wx -= t * dx
                        wy -= t * dy
                    distance2 = wx * wx + wy * wy
                    if distance2 < best:
                        best, last = distance2, node
                continue
            for side in range(2):
                child = 2 * node + 1 + side
                u = max(boxes[child, 0] - x[n], x[n] - boxes[child, 2], 0.0)
                v = max(boxes[child, 1] - y[n], y[n] - boxes[child, 3], 0.0)
                waiting[count], away[count] = child, u * u + v * v
                count += 1
            if away[count - 1] > away[count - 2]:  # the nearer one is next
                waiting[count - 1], waiting[count - 2] = waiting[count - 2], waiting[count - 1]
                away[count - 1], away[count - 2] = away[count - 2], away[count - 1]
        out[n] = math.sqrt(best)


@lean
def inside(
    planes: FloatArray, first: int, last: int, round_: FloatArray, o: tuple[float, ...], d: tuple[float, ...]
) -> tuple[float, float]:
    """Return the interval (low, high) of t, m, in which the line o + t d is inside a convex body; low > high for none.

    d has length 1. The body's planes are the rows ``first`` to ``last`` - 1 of ``planes`` (P, 4). ``round_`` (8,) has
    its cylinder or ball, and its bounding ball: it is a row of ``rounds`` of `Surfaces`, which explains the numbers.
    """
    mx, my, mz = o[0] - round_[0], o[1] - round_[1], o[2] - round_[2]
    along = mx * d[0] + my * d[1] + mz * d[2]
    if along * along < mx * mx + my * my + mz * mz - round_[7] * round_[7]:
        return NOWHERE
    low, high = -math.inf, math.inf
    radius = round_[6]
    if radius > 0.0:
        ax, ay, az = round_[3], round_[4], round_[5]
        shift = ax * mx + ay * my + az * mz
        mx, my, mz = mx - shift * ax, my - shift * ay, mz - shift * az
        climb = ax * d[0] + ay * d[1] + az * d[2]
        dx, dy, dz = d[0] - climb * ax, d[1] - climb * ay, d[2] - climb * az
        square, half = dx * dx + dy * dy + dz * dz, mx * dx + my * dy + mz * dz
        rest = mx * mx + my * my + mz * mz - radius * radius
        if square < PARALLEL:
            if rest > 0.0:
                return NOWHERE
        else:
            root = half * half - square * rest
            if root < 0.0:
                return NOWHERE
            root = math.sqrt(root)
            low, high = (-half - root) / square, (-half + root) / square
    for k in range(first, last):
        slant = planes[k, 0] * d[0] + planes[k, 1] * d[1] + planes[k, 2] * d[2]
        gap = planes[k, 3] - planes[k, 0] * o[0] - planes[k, 1] * o[1] - planes[k, 2] * o[2]
        if slant > PARALLEL:
            high = min(high, gap / slant)
        elif slant < -PARALLEL:
            low = max(low, gap / slant)
        elif gap < 0.0:
            return NOWHERE
        if low > high:
            return NOWHERE
    return low, high


@lean
def within_reach(rounds: FloatArray, o: tuple[float, ...], reach: float, found: IntArray) -> int:
    """Write to ``found`` the numbers of bodies whose bounding ball is within ``reach`` m of o; return their count."""
    count = 0
    for b in range(len(rounds)):
        x, y, z = rounds[b, 0] - o[0], rounds[b, 1] - o[1], rounds[b, 2] - o[2]
        if math.sqrt(x * x + y * y + z * z) < reach + rounds[b, 7]:
            found[count] = b
            count += 1
    return count


@lean
def bundle(directions: FloatArray) -> tuple[float, float, float, float]:
    """Return a cone that holds rays (K, 3), not the smallest one: its unit axis x, y, z and its half angle, rad.

    If the rays spread too far for a useful cone, the axis is 0, 0, 0 and the half angle is 4, which holds everything.
    """
    x = y = z = 0.0
    for k in range(len(directions)):
        x, y, z = x + directions[k, 0], y + directions[k, 1], z + directions[k, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < 0.5 * len(directions):
        return 0.0, 0.0, 0.0, 4.0
    x, y, z = x / length, y / length, z / length
    cosine = 1.0
    for k in range(len(directions)):
        cosine = min(cosine, x * directions[k, 0] + y * directions[k, 1] + z * directions[k, 2])
    return x, y, z, math.acos(max(cosine, -1.0)) + WIDER


@lean
def in_bundle(rounds: FloatArray, o: tuple[float, ...], cone: tuple[float, ...], found: IntArray, count: int) -> int:
    """Keep the first ``count`` bodies in ``found`` only if their bounding ball meets a cone; return the new count."""
    if cone[3] > math.pi:
        return count
    sine, cosine = math.sin(cone[3]), math.cos(cone[3])
    kept = 0
    for i in range(count):
        b = found[i]
        dx, dy, dz = rounds[b, 0] - o[0], rounds[b, 1] - o[1], rounds[b, 2] - o[2]
        square, radius = dx * dx + dy * dy + dz * dz, rounds[b, 7]
        if square > radius * radius:  # compare cosines of angles: at the centre of the ball, and at its edge
            edge = math.sqrt(square - radius * radius)
            along = cone[0] * dx + cone[1] * dy + cone[2] * dz
            if cosine * radius + sine * edge > 0.0 and along < cosine * edge - sine * radius:
                continue
        found[kept] = b
        kept += 1
    return kept


@lean
def _first(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    some: IntArray,
    o: tuple[float, ...],
    d: tuple[float, ...],
    reach: float,
) -> float:
    """Return the distance, m, at which a ray enters the first of some bodies; at most ``reach``."""
    best = reach
    for b in some:
        low, high = inside(planes, begin[b], begin[b + 1], rounds[b], o, d)
        if low <= high and TOUCH < low < best:
            best = low
    return best


@kernel
def first_hits(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: float,
    out: FloatArray,
) -> None:
    """Write to out (N, K) the distance, m, at which each ray enters a body; at most ``reach``.

    origins (N, 3), m; directions (N, K, 3): unit vectors. A body that contains the origin does not count.
    """
    near = np.empty(len(rounds), np.int64)
    for n in range(len(origins)):
        o = (origins[n, 0], origins[n, 1], origins[n, 2])
        count = within_reach(rounds, o, reach, near)
        some = near[: in_bundle(rounds, o, bundle(directions[n]), near, count)]
        for k in range(directions.shape[1]):
            d = (directions[n, k, 0], directions[n, k, 1], directions[n, k, 2])
            out[n, k] = _first(planes, begin, rounds, some, o, d, reach)


@kernel
def flow(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    places: FloatArray,
    axes: FloatArray,
    velocity: FloatArray,
    rotation: FloatArray,
    view: FloatArray,
    half: FloatArray,
    reach: float,
    nearest: float,
    largest: bool,
    out: FloatArray,
) -> None:
    """Write to out (N,) the mean, or the largest, angular speed of the surfaces that a camera sees, rad/s.

    places, velocity, rotation (N, 3): position and motion of the camera, world frame; axes (N, 3, 3): its unit vectors
    ahead, left and up, one per row; view (K, 3): directions in which it looks, along these axes. A surface at distance
    r in direction d shifts by w x d + (v - (v d) d) / r, where r is at least ``nearest`` and at most ``reach``.

    half (N, 2): half the horizontal and the vertical angle of view, rad, beyond which directions are left out; (0, 2)
    for no limits. If no direction is within them, the flow is 0.
    """
    near = np.empty(len(rounds), np.int64)
    for n in range(len(places)):
        o = (places[n, 0], places[n, 1], places[n, 2])
        some = near[: within_reach(rounds, o, reach, near)]
        vx, vy, vz = velocity[n]
        wx, wy, wz = rotation[n]
        total = worst = 0.0
        seen = 0
        for k in range(len(view)):
            a, b, c = view[k]
            if len(half) > 0 and (
                abs(math.atan2(b, a)) > half[n, 0] or abs(math.atan2(c, math.hypot(a, b))) > half[n, 1]
            ):
                continue
            seen += 1
            dx = a * axes[n, 0, 0] + b * axes[n, 1, 0] + c * axes[n, 2, 0]
            dy = a * axes[n, 0, 1] + b * axes[n, 1, 1] + c * axes[n, 2, 1]
            dz = a * axes[n, 0, 2] + b * axes[n, 1, 2] + c * axes[n, 2, 2]
            near_by = 1.0 / max(_first(planes, begin, rounds, some, o, (dx, dy, dz), reach), nearest)
            along = vx * dx + vy * dy + vz * dz
            x = wy * dz - wz * dy + (vx - along * dx) * near_by
            y = wz * dx - wx * dz + (vy - along * dy) * near_by
            z = wx * dy - wy * dx + (vz - along * dz) * near_by
            speed = math.sqrt(x * x + y * y + z * z)
            total += speed
            worst = max(worst, speed)
        out[n] = worst if largest else total / max(seen, 1)


@kernel
def filled(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    centres: FloatArray,
    directions: FloatArray,
    radius: float,
    out: FloatArray,
) -> None:
    """Write to out (N,) the fraction of the ball of ``radius`` m round each centre (N, 3) that bodies fill.

    The fraction is a mean over rays in directions (K, 3). Each ray contributes the sum of (high³ - low³) / radius³ over
    the intervals in which it is inside bodies; overlaps count once.
    """
    near = np.empty(len(rounds), np.int64)
    lows, highs = np.empty(len(rounds)), np.empty(len(rounds))
    for n in range(len(centres)):
        o = (centres[n, 0], centres[n, 1], centres[n, 2])
        some = near[: within_reach(rounds, o, radius, near)]
        out[n] = 0.0
        if not some.size:
            continue
        total = 0.0
        for k in range(len(directions)):
            d = (directions[k, 0], directions[k, 1], directions[k, 2])
            hits = 0
            for b in some:
                low, high = inside(planes, begin[b], begin[b + 1], rounds[b], o, d)
                low, high = max(low, 0.0), min(high, radius)
                if low < high:  # keep them in the order in which they begin
                    place = hits
                    while place > 0 and lows[place - 1] > low:
                        lows[place], highs[place] = lows[place - 1], highs[place - 1]
                        place -= 1
                    lows[place], highs[place] = low, high
                    hits += 1
            reached = 0.0
            for i in range(hits):
                low, high = max(lows[i], reached), highs[i]
                if low < high:
                    total += high**3 - low**3
                    reached = high
        out[n] = total / (len(directions) * radius**3)
