"""The compiled inner loops of `hpop.world.rays_in_space`: where lines enter and leave convex bodies."""

from __future__ import annotations

import math

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.compiled import kernel, lean

PARALLEL = 1e-15  # of unit vectors: a line that slants less against a plane never meets it
TOUCH = 1e-6  # m: what a ray enters sooner contains its origin, which may be on its surface, as a lens in its case
WIDER = 1e-6  # rad: so much wider than it is a cone is taken to be
NOWHERE = (1.0, 0.0)  # an interval that begins after its end


@lean
def _inside(
    planes: FloatArray, first: int, last: int, round_: FloatArray, o: tuple[float, ...], d: tuple[float, ...]
) -> tuple[float, float]:
    """From where to where the line o + t d, |d| = 1, is inside a body; the end is before the beginning if nowhere.

    See `Surfaces` for what planes (P, 4) and round_ (8,) are.
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
def _near(rounds: FloatArray, o: tuple[float, ...], reach: float, found: IntArray) -> int:
    """Write to found the bodies that are no farther than reach from a place, and give their number."""
    count = 0
    for b in range(len(rounds)):
        x, y, z = rounds[b, 0] - o[0], rounds[b, 1] - o[1], rounds[b, 2] - o[2]
        if math.sqrt(x * x + y * y + z * z) < reach + rounds[b, 7]:
            found[count] = b
            count += 1
    return count


@lean
def _in_bundle(rounds: FloatArray, o: tuple[float, ...], directions: FloatArray, found: IntArray, count: int) -> int:
    """Keep of some bodies those that a bundle of rays (K, 3) from a place may meet: within the cone round all of it."""
    x = y = z = 0.0
    for k in range(len(directions)):
        x, y, z = x + directions[k, 0], y + directions[k, 1], z + directions[k, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < 0.5 * len(directions):  # all round, or nearly
        return count
    x, y, z = x / length, y / length, z / length
    cosine = 1.0
    for k in range(len(directions)):
        cosine = min(cosine, x * directions[k, 0] + y * directions[k, 1] + z * directions[k, 2])
    spread = math.acos(max(cosine, -1.0)) + WIDER
    kept = 0
    for i in range(count):
        b = found[i]
        dx, dy, dz = rounds[b, 0] - o[0], rounds[b, 1] - o[1], rounds[b, 2] - o[2]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if distance > rounds[b, 7]:
            off = math.acos(max(-1.0, min(1.0, (x * dx + y * dy + z * dz) / distance)))
            if off > spread + math.asin(rounds[b, 7] / distance):
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
    """How far a ray gets until it enters one of some bodies; at most reach."""
    best = reach
    for b in some:
        low, high = _inside(planes, begin[b], begin[b + 1], rounds[b], o, d)
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
    """Write to out (N, K) how far from each origin (N, 3) its rays (N, K, 3) first enter a body; at most reach.

    What contains the origin is left, not entered.
    """
    near = np.empty(len(rounds), np.int64)
    for n in range(len(origins)):
        o = (origins[n, 0], origins[n, 1], origins[n, 2])
        count = _near(rounds, o, reach, near)
        some = near[: _in_bundle(rounds, o, directions[n], near, count)]
        for k in range(directions.shape[1]):
            d = (directions[n, k, 0], directions[n, k, 1], directions[n, k, 2])
            out[n, k] = _first(planes, begin, rounds, some, o, d, reach)


@kernel
def blocked(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    own_planes: FloatArray,
    own_begin: IntArray,
    own_rounds: FloatArray,
    poses: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (N,) the share of the rays (N, K, 3) from each origin (N, 3) that enter a body before reach (N, K).

    Bodies are those of a world, and others, each in its own frame, of which poses (B, N, 4, 4) say where it is.
    """
    near, own_near = np.empty(len(rounds), np.int64), np.empty(len(own_rounds), np.int64)
    balls, seen_from = np.empty((len(own_rounds), 8)), np.empty((len(own_rounds), 3))
    for n in range(len(origins)):
        o = (origins[n, 0], origins[n, 1], origins[n, 2])
        farthest = reach[n].max()
        some = near[: _in_bundle(rounds, o, directions[n], near, _near(rounds, o, farthest, near))]
        for b in range(len(own_rounds)):
            pose, c = poses[b, n], own_rounds[b]
            x, y, z = o[0] - pose[0, 3], o[1] - pose[1, 3], o[2] - pose[2, 3]
            for i in range(3):
                balls[b, i] = pose[i, 0] * c[0] + pose[i, 1] * c[1] + pose[i, 2] * c[2] + pose[i, 3]
                seen_from[b, i] = pose[0, i] * x + pose[1, i] * y + pose[2, i] * z
            balls[b, 7] = c[7]
        own_some = own_near[: _in_bundle(balls, o, directions[n], own_near, _near(balls, o, farthest, own_near))]
        count = 0
        for k in range(directions.shape[1]):
            x, y, z = directions[n, k]
            hidden = _first(planes, begin, rounds, some, o, (x, y, z), reach[n, k]) < reach[n, k]
            for b in own_some:
                if hidden:
                    break
                pose, at = poses[b, n], (seen_from[b, 0], seen_from[b, 1], seen_from[b, 2])
                d = (
                    pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
                    pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
                    pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
                )
                low, high = _inside(own_planes, own_begin[b], own_begin[b + 1], own_rounds[b], at, d)
                hidden = low <= high and TOUCH < low < reach[n, k]
            count += hidden
        out[n] = count / directions.shape[1]


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
    reach: float,
    nearest: float,
    largest: bool,
    out: FloatArray,
) -> None:
    """Write to out (N,) the mean, or the largest, angular speed at which a camera sees the bodies move, rad/s.

    places, velocity, rotation (N, 3): of the camera, world frame; axes (N, 3, 3): ahead, left and up, one a row; view
    (K, 3): unit vectors along these axes in which it looks. A surface at distance r in direction d shifts by
    w x d + (v - (v d) d) / r, where r is at least nearest, and at most reach.
    """
    near = np.empty(len(rounds), np.int64)
    for n in range(len(places)):
        o = (places[n, 0], places[n, 1], places[n, 2])
        some = near[: _near(rounds, o, reach, near)]
        vx, vy, vz = velocity[n]
        wx, wy, wz = rotation[n]
        total = worst = 0.0
        for k in range(len(view)):
            a, b, c = view[k]
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
        out[n] = worst if largest else total / len(view)


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
    """Write to out (N,) the share of the ball round each centre (N, 3) inside bodies, each place counted once.

    The mean over directions (K, 3) of what the bodies fill of a ray's cone: t³ / radius³ grows evenly with the volume.
    """
    near = np.empty(len(rounds), np.int64)
    lows, highs = np.empty(len(rounds)), np.empty(len(rounds))
    for n in range(len(centres)):
        o = (centres[n, 0], centres[n, 1], centres[n, 2])
        some = near[: _near(rounds, o, radius, near)]
        out[n] = 0.0
        if not some.size:
            continue
        total = 0.0
        for k in range(len(directions)):
            d = (directions[k, 0], directions[k, 1], directions[k, 2])
            hits = 0
            for b in some:
                low, high = _inside(planes, begin[b], begin[b + 1], rounds[b], o, d)
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
