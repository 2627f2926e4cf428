"""Compiled loop that finds which lines of sight to a ball are blocked by bodies in space, with few divisions per line.

The rays from a camera to the ball are aimed at points of a disc, and each ray is a pair of coordinates on it. A plane
through the camera meets the disc in a line, so a ray is compared with a plane by two products. A hull is seen from the
camera as a convex polygon. Its sides are such planes, and most of them decide for all rays as a whole: no ray enters
the hull, all rays do, or a few sides lie among the rays and are compared with each ray.

Postures of one motion follow each other. So the side that kept all rays off a hull in the last posture is tried first
in the next one, and so is the hull that blocked all rays.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.world.geometry._kernels import PARALLEL, TOUCH, WIDER, inside
from hpop.world.geometry._outline_in_space import BOX, CORNERS, EDGES, NONE, UNSURE, cut, depths, still_apart

ASKED = 2  # a ray that is to be tested; see rays_in_space


@lean
def _turned_back(pose: FloatArray, d: tuple[float, ...]) -> tuple[float, float, float]:
    """Transform a vector (x, y, z) from the world into the frame of a pose (4, 4)."""
    return (
        pose[0, 0] * d[0] + pose[1, 0] * d[1] + pose[2, 0] * d[2],
        pose[0, 1] * d[0] + pose[1, 1] * d[1] + pose[2, 1] * d[2],
        pose[0, 2] * d[0] + pose[1, 2] * d[1] + pose[2, 2] * d[2],
    )


@lean
def _faced(
    columns: FloatArray,
    first: int,
    last: int,
    o: tuple[float, ...],
    cone: tuple[float, ...],
    reach: float,
    sorted_: FloatArray,
) -> tuple[int, int]:
    """Copy the planes of a body to sorted_: planes that face the point ``o`` first.

    Return the number of planes that face the point o, and the number of all planes. The last column becomes the
    distance of the point behind each plane, m. Nothing is copied for a body that no ray from the point can enter: one
    that contains the point, or one with a plane that all rays, at most ``reach`` m long, stay in front of.

    cone  axis x, y, z of the rays, and sine and cosine of their largest angle with it; a sine of 2 for rays all round
    """
    front, back = 0, last - first
    for k in range(first, last):
        x, y, z = columns[0, k], columns[1, k], columns[2, k]
        gap = columns[3, k] - x * o[0] - y * o[1] - z * o[2]
        if gap < 0.0:
            along = x * cone[0] + y * cone[1] + z * cone[2]
            if along > cone[3]:
                return 0, 0
            if -cone[4] < along < 0.0:
                along = along * cone[4] - cone[3] * math.sqrt(1.0 - along * along)
                if along * reach > gap:
                    return 0, 0
            at = front
            front += 1
        else:
            back -= 1
            at = back
        sorted_[at, 0], sorted_[at, 1], sorted_[at, 2], sorted_[at, 3] = x, y, z, gap
    return front, last - first if front > 0 else 0


@lean
def _enters(planes: FloatArray, front: int, last: int, d: tuple[float, ...], reach: float) -> bool:
    """Return whether a ray enters a convex body before ``reach``, m; `_faced` has sorted the planes of the body.

    A ray is inside the body once it has crossed all planes that face the origin and none of the others; this test needs
    few divisions. The planes of a hull's bounding box come first, because most rays that miss the hull miss the box.
    """
    low, middle = 0.0, min(front, BOX)
    for k in range(middle):
        slant = planes[k, 0] * d[0] + planes[k, 1] * d[1] + planes[k, 2] * d[2]
        if slant >= -PARALLEL:
            return False
        low = max(low, planes[k, 3] / slant)
    if low >= reach:
        return False
    between = max(front, last - 2 * BOX)
    for k in range(between, last):
        slant = planes[k, 0] * d[0] + planes[k, 1] * d[1] + planes[k, 2] * d[2]
        if slant > PARALLEL and planes[k, 3] < low * slant:
            return False
    for k in range(middle, front):
        slant = planes[k, 0] * d[0] + planes[k, 1] * d[1] + planes[k, 2] * d[2]
        if slant >= -PARALLEL:
            return False
        if planes[k, 3] < low * slant:
            low = planes[k, 3] / slant
            if low >= reach:
                return False
    if low <= TOUCH:
        return False
    for k in range(front, last):
        slant = planes[k, 0] * d[0] + planes[k, 1] * d[1] + planes[k, 2] * d[2]
        if slant > PARALLEL and planes[k, 3] < low * slant:
            return False
    return True


@lean
def _disc_axes(
    d: tuple[float, float, float], distance: float, radius: float
) -> tuple[float, float, float, float, float, float]:
    """Return two perpendicular vectors of length ``radius`` in the disc that faces the origin of an offset ``d``."""
    x, y, z = d
    a, b, c = abs(x), abs(y), abs(z)  # the axis most perpendicular to it
    if a <= b and a <= c:
        ux, uy, uz = 0.0, z, -y
    elif b <= c:
        ux, uy, uz = -z, 0.0, x
    else:
        ux, uy, uz = y, -x, 0.0
    scale = radius / math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux * scale, uy * scale, uz * scale
    return ux, uy, uz, (y * uz - z * uy) / distance, (z * ux - x * uz) / distance, (x * uy - y * ux) / distance


@lean
def _cone(
    d: tuple[float, float, float], u: tuple[float, ...], spot: tuple[float, float, float], radius: float
) -> tuple[float, float, float, float, float]:
    """Return a cone that contains the rays to a spot: its axis x, y, z, and sine and cosine of half its opening.

    The sine is 2 and the cosine 0 if there is no such cone. See `blocked` for d, and `_disc_axes` for u.
    """
    x = d[0] + spot[0] * u[0] + spot[1] * u[3]
    y = d[1] + spot[0] * u[1] + spot[1] * u[4]
    z = d[2] + spot[0] * u[2] + spot[1] * u[5]
    length = math.sqrt(x * x + y * y + z * z)
    sine = spot[2] * radius / length
    if sine >= 1.0:
        return x / length, y / length, z / length, 2.0, 0.0
    return x / length, y / length, z / length, sine, math.sqrt(1.0 - sine * sine)


@lean
def _spot(s: FloatArray, t: FloatArray, count: int) -> tuple[float, float, float]:
    """Return the mean of the first ``count`` points of a disc, and the radius of a circle round it with all of them."""
    x = y = square = 0.0
    for k in range(count):
        x, y = x + s[k], y + t[k]
    x, y = x / count, y / count
    for k in range(count):
        square = max(square, (s[k] - x) * (s[k] - x) + (t[k] - y) * (t[k] - y))
    return x, y, math.sqrt(square) * (1.0 + WIDER) + WIDER


@kernel
def blocked(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    first_edge: IntArray,
    sides: NDArray[np.uint32],
    first_corner: IntArray,
    corners: FloatArray,
    fixed: int,
    poses: FloatArray,
    origins: FloatArray,
    offsets: FloatArray,
    radius: float,
    disc: FloatArray,
    out: NDArray[np.int8],
) -> None:
    """Write to out (N, K) whether rays from each origin (N, 3) to a ball enter a body before they reach it: 0 or 1.

    Only rays are tested for which out is ASKED. The first ``fixed`` bodies do not move. Each of the others moves with a
    frame: poses (B - fixed, N, 4, 4). See `Surfaces` for the other arrays.

    offsets (N, 3)  from each origin to the centre of the ball, m
    disc (K, 2)     points of the unit disc: scaled to the ball and turned to face the origin, rays are aimed at them
    """
    count, rays = len(rounds), len(disc)
    asked, hidden = np.empty(rays, np.int64), np.empty(rays, np.bool_)
    s, t, worst = np.empty(rays), np.empty(rays), np.empty(rays)
    towards, reach = np.empty((rays, 3)), np.empty(rays)
    columns, tips = np.ascontiguousarray(planes.T), np.ascontiguousarray(corners.T)
    gaps, facing, seen = np.empty(len(planes)), np.empty(len(planes), np.uint8), np.empty((3, len(corners)))
    memory = gaps, facing, seen, np.empty(len(sides) + 1, np.int64)
    faces = np.empty((len(planes) + len(sides), 4))
    apart, order = np.full(count, -1, np.int64), np.arange(count)
    all_rays = _spot(disc[:, 0], disc[:, 1], rays)
    for n in range(len(origins)):
        wanted = 0
        for k in range(rays):
            asked[wanted] = k
            wanted += out[n, k] == ASKED
        if wanted == 0:
            continue
        o, d = (origins[n, 0], origins[n, 1], origins[n, 2]), (offsets[n, 0], offsets[n, 1], offsets[n, 2])
        square, narrow = d[0] * d[0] + d[1] * d[1] + d[2] * d[2], radius * radius
        distance = math.sqrt(square)
        for j in range(wanted):
            out[n, asked[j]] = 0
            s[j], t[j] = disc[asked[j], 0], disc[asked[j], 1]
        if distance <= radius:
            continue
        spot = all_rays if wanted == rays else _spot(s, t, wanted)
        u = _disc_axes(d, distance, radius)
        cone = _cone(d, u, spot, radius)
        has_directions = False
        for i in range(count):
            b = order[i]
            x, y, z = rounds[b, 0], rounds[b, 1], rounds[b, 2]
            if b >= fixed:
                pose = poses[b - fixed, n]
                x, y, z = (
                    pose[0, 0] * x + pose[0, 1] * y + pose[0, 2] * z + pose[0, 3],
                    pose[1, 0] * x + pose[1, 1] * y + pose[1, 2] * z + pose[1, 3],
                    pose[2, 0] * x + pose[2, 1] * y + pose[2, 2] * z + pose[2, 3],
                )
            x, y, z, ball = x - o[0], y - o[1], z - o[2], rounds[b, 7]
            if x * d[0] + y * d[1] + z * d[2] >= (distance + ball) * distance:  # behind the disc
                continue
            far = x * x + y * y + z * z
            if (
                far > ball * ball and cone[4] > 0.0
            ):  # compare cosines of angles: at the centre of the ball, and its edge
                edge = math.sqrt(far - ball * ball)
                if cone[0] * x + cone[1] * y + cone[2] * z < cone[4] * edge - cone[3] * ball:
                    continue
            here = o
            if b >= fixed:
                pose = poses[b - fixed, n]
                here = _turned_back(pose, (o[0] - pose[0, 3], o[1] - pose[1, 3], o[2] - pose[2, 3]))
            last, front = UNSURE, 0
            is_before = False
            if first_edge[b + 1] > first_edge[b]:
                ahead, ux, uy = d, u[:3], u[3:]
                if b >= fixed:
                    pose = poses[b - fixed, n]
                    ahead, ux, uy = _turned_back(pose, d), _turned_back(pose, ux), _turned_back(pose, uy)
                first, tip, start = begin[b], first_corner[b], first_edge[b]
                low, high = depths(columns, first, ahead, here)
                if low >= square or high <= 0.0:  # behind the disc, or behind the camera
                    continue
                is_before = high < (distance - radius) * distance  # before the whole ball
                lines = (
                    ahead[0] / square,
                    ahead[1] / square,
                    ahead[2] / square,
                    ux[0] / narrow,
                    ux[1] / narrow,
                    ux[2] / narrow,
                    uy[0] / narrow,
                    uy[1] / narrow,
                    uy[2] / narrow,
                )
                e = apart[b]
                if e >= 0:
                    of, to = (first, tip) if e < start + EDGES else (first + 2 * BOX, tip + CORNERS)
                    if still_apart(columns, of, tips, to, sides[e], here, lines, spot):
                        continue
                last, apart[b] = cut(
                    columns,
                    first,
                    first + 2 * BOX,
                    tips,
                    tip,
                    tip + CORNERS,
                    sides,
                    start,
                    start + EDGES,
                    here,
                    lines,
                    spot,
                    memory,
                    faces,
                )
                if last != NONE and first_edge[b + 1] > start + EDGES:  # a hull, not only its box
                    last, apart[b] = cut(
                        columns,
                        first + 2 * BOX,
                        begin[b + 1],
                        tips,
                        tip + CORNERS,
                        first_corner[b + 1],
                        sides,
                        start + EDGES,
                        first_edge[b + 1],
                        here,
                        lines,
                        spot,
                        memory,
                        faces,
                    )
                if last == NONE:
                    continue
            if last == 0 and is_before:
                for j in range(wanted):
                    out[n, asked[j]] = 1
                for i2 in range(i, 0, -1):
                    order[i2] = order[i2 - 1]
                order[0] = b
                break
            if last > 0 and is_before:
                for j in range(wanted):
                    worst[j] = -1.0
                for e in range(last):
                    c0, c1, c2 = faces[e, 0], faces[e, 1], faces[e, 2]
                    for j in range(wanted):
                        outside = c0 + c1 * s[j] + c2 * t[j]
                        worst[j] = outside if outside > worst[j] else worst[j]
                for j in range(wanted):
                    hidden[j] = worst[j] <= 0.0
            else:
                is_round = rounds[b, 6] > 0.0
                if not is_round:
                    ahead = cone[:3]
                    if b >= fixed:
                        ahead = _turned_back(poses[b - fixed, n], ahead)
                    front, last = _faced(columns, begin[b], begin[b + 1], here, ahead + cone[3:], distance, faces)
                    if last == 0:
                        continue
                if not has_directions:
                    has_directions = True
                    for j in range(wanted):
                        k = asked[j]
                        x = d[0] + s[j] * u[0] + t[j] * u[3]
                        y = d[1] + s[j] * u[1] + t[j] * u[4]
                        z = d[2] + s[j] * u[2] + t[j] * u[5]
                        length = math.sqrt(x * x + y * y + z * z)
                        x, y, z = x / length, y / length, z / length
                        along = x * d[0] + y * d[1] + z * d[2]
                        towards[k, 0], towards[k, 1], towards[k, 2] = x, y, z
                        beside = max(square - along * along, 0.0)  # squared distance of the ball's centre
                        reach[k] = along - math.sqrt(max(narrow - beside, 0.0))
                for j in range(wanted):
                    k = asked[j]
                    ray = towards[k, 0], towards[k, 1], towards[k, 2]
                    if b >= fixed:
                        ray = _turned_back(poses[b - fixed, n], ray)
                    if is_round:
                        low, high = inside(planes, begin[b], begin[b + 1], rounds[b], here, ray)
                        hidden[j] = low <= high and TOUCH < low < reach[k]
                    else:
                        hidden[j] = _enters(faces, front, last, ray, reach[k])
            left = 0
            for j in range(wanted):
                k = asked[j]
                out[n, k] = hidden[j]
                asked[left], s[left], t[left] = k, s[j], t[j]
                left += not hidden[j]
            if left == 0:
                break
            if left < wanted:
                wanted = left
                spot = _spot(s, t, wanted)
                cone = _cone(d, u, spot, radius)
