"""Compiled loop that finds which lines of sight bodies in space block, with few divisions per line.

The rays from one point to a target form a narrow cone. A hull in this cone is seen as a convex polygon. The sides of
the polygon decide for the cone as a whole: it misses the hull, it is blocked, or a few sides cut it and are compared
with each ray.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.world.geometry._kernels import PARALLEL, TOUCH, bundle, in_bundle, inside, within_reach

BOX = 3  # most planes of a box that face a point outside it
EDGES = 12  # of a box
ASKED = 2  # a ray that is to be tested; see rays_in_space
NONE, UNSURE = -1, -2  # no ray enters a hull; the outline of a hull does not decide it
ROUND, FACES, OUTLINE = 0, 1, 2  # by what a ray is tested: cylinder or ball, all faces, outline of a hull


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
    planes: FloatArray,
    first: int,
    last: int,
    o: tuple[float, ...],
    cone: tuple[float, ...],
    reach: float,
    sorted_: FloatArray,
    room: int,
) -> tuple[int, int]:
    """Copy the planes of a body to sorted_, from row ``room`` on: planes that face the point ``o`` first.

    Return the row after the planes that face the point o, and the row after all planes. The last column becomes the
    distance of the point behind each plane, m. Nothing is copied for a body that no ray from the point can enter: one
    that contains the point, or one with a plane that all rays, at most ``reach`` m long, stay in front of.

    cone  axis x, y, z of the rays, and sine and cosine of their largest angle with it; a sine of 2 for rays all round
    """
    front, back = room, room + last - first
    for k in range(first, last):
        x, y, z = planes[k, 0], planes[k, 1], planes[k, 2]
        gap = planes[k, 3] - x * o[0] - y * o[1] - z * o[2]
        if gap < 0.0:
            along = x * cone[0] + y * cone[1] + z * cone[2]
            if along > cone[3]:
                return room, room
            if -cone[4] < along < 0.0:
                along = along * cone[4] - cone[3] * math.sqrt(1.0 - along * along)
                if along * reach > gap:
                    return room, room
            at = front
            front += 1
        else:
            back -= 1
            at = back
        sorted_[at, 0], sorted_[at, 1], sorted_[at, 2], sorted_[at, 3] = x, y, z, gap
    return front, room + last - first if front > room else room


@lean
def _enters(planes: FloatArray, first: int, front: int, last: int, d: tuple[float, ...], reach: float) -> bool:
    """Return whether a ray enters a convex body before ``reach``, m; `_faced` has sorted the planes of the body.

    A ray is inside the body once it has crossed all planes that face the origin and none of the others; this test needs
    few divisions. The planes of a hull's bounding box come first, because most rays that miss the hull miss the box.
    """
    low, middle = 0.0, min(front, first + BOX)
    for k in range(first, middle):
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
def _cut(
    columns: FloatArray,
    first: int,
    last: int,
    sides: IntArray,
    corners: FloatArray,
    begin: int,
    end: int,
    o: tuple[float, ...],
    axis: tuple[float, ...],
    sine: float,
    gaps: FloatArray,
    outline: IntArray,
    sorted_: FloatArray,
    room: int,
) -> int:
    """Write the planes through the point ``o`` and the outline of a hull that cut a cone of rays, from row ``room`` on.

    Return the row after them: ``room`` if all rays enter the hull, NONE if no ray does, and UNSURE if o is not clear of
    the hull. The outline consists of the edges between a face that faces the point and a face that does not; rays that
    enter the hull are on the inner side of all planes through them. See `Surfaces` for sides and corners.

    columns        planes (4, P); the hull has numbers ``first`` to ``last``
    begin, end     numbers of its edges
    gaps, outline  scratch memory
    """
    for k in range(last - first):
        gaps[k] = columns[3, first + k] - columns[0, first + k] * o[0] - columns[1, first + k] * o[1]
        gaps[k] -= columns[2, first + k] * o[2]
    count = 0
    for e in range(begin, end):  # without branches, which the processor would guess wrongly
        outline[count] = e
        count += (gaps[sides[e, 0]] < 0.0) != (gaps[sides[e, 1]] < 0.0)
    is_clear = False
    for e in outline[:count]:
        i, j = sides[e, 0], sides[e, 1]
        is_clear |= min(gaps[i], gaps[j]) < -2.0 * TOUCH
        ax, ay, az = corners[e, 0] - o[0], corners[e, 1] - o[1], corners[e, 2] - o[2]
        bx, by, bz = corners[e, 3] - o[0], corners[e, 4] - o[1], corners[e, 5] - o[2]
        x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        if gaps[i] >= 0.0:
            x, y, z = -x, -y, -z
        along, most = x * axis[0] + y * axis[1] + z * axis[2], sine * math.sqrt(x * x + y * y + z * z)
        if along > most:
            return NONE
        if along >= -most:
            sorted_[room, 0], sorted_[room, 1], sorted_[room, 2] = x, y, z
            room += 1
    return room if is_clear else UNSURE


@kernel
def blocked(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    first_edge: IntArray,
    sides: IntArray,
    corners: FloatArray,
    fixed: int,
    poses: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: FloatArray,
    out: NDArray[np.int8],
) -> None:
    """Write to out (N, K) whether rays from each origin (N, 3) enter a body before ``reach`` (N, K), m: 0 or 1.

    Only rays are tested for which out is ASKED. directions (N, K, 3): unit vectors. The first ``fixed`` bodies do not
    move. Each of the others moves with a frame: poses (B - fixed, N, 4, 4). See `Surfaces` for the other arrays.
    """
    count, rays = len(rounds), directions.shape[1]
    near, some, asked = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(rays, np.int64)
    balls, at, towards = np.empty((count, 8)), np.empty((count, 3)), np.empty((rays, 3))
    most = 1
    for b in range(count):
        most = max(most, begin[b + 1] - begin[b])
    faces, gaps = np.empty((len(planes) + len(sides), 4)), np.empty(most)
    columns, outline = np.ascontiguousarray(planes.T), np.empty(len(sides) + 1, np.int64)
    lists, form = np.empty((count, 3), np.int64), np.empty(count, np.int64)
    for b in range(fixed):
        balls[b] = rounds[b]
    for n in range(len(origins)):
        wanted, farthest, nearest = 0, 0.0, math.inf
        for k in range(rays):
            if out[n, k] == ASKED:
                asked[wanted] = k
                out[n, k] = 0
                for i in range(3):
                    towards[wanted, i] = directions[n, k, i]
                farthest, nearest = max(farthest, reach[n, k]), min(nearest, reach[n, k])
                wanted += 1
        if wanted == 0 or farthest <= 0.0:
            continue
        o = (origins[n, 0], origins[n, 1], origins[n, 2])
        cone = bundle(towards[:wanted])
        sine, cosine = (math.sin(cone[3]), math.cos(cone[3])) if cone[3] < 0.5 * math.pi else (2.0, 0.0)
        axis = (cone[0], cone[1], cone[2])
        for b in range(fixed, count):
            pose, c = poses[b - fixed, n], rounds[b]
            for i in range(3):
                balls[b, i] = pose[i, 0] * c[0] + pose[i, 1] * c[1] + pose[i, 2] * c[2] + pose[i, 3]
            balls[b, 7] = c[7]
        room = kept = 0
        is_hidden = False
        for i in range(in_bundle(balls, o, cone, near, within_reach(balls, o, farthest, near))):
            b = near[i]
            here, along = o, axis
            if b >= fixed:
                pose = poses[b - fixed, n]
                here = _turned_back(pose, (o[0] - pose[0, 3], o[1] - pose[1, 3], o[2] - pose[2, 3]))
                along = _turned_back(pose, axis)
                at[b, 0], at[b, 1], at[b, 2] = here
            form[b], lists[b, 0] = FACES, room
            if rounds[b, 6] > 0.0:
                form[b] = ROUND
            elif first_edge[b + 1] > first_edge[b]:
                depth = balls[b, 7]
                for i3 in range(3):
                    depth += axis[i3] * (balls[b, i3] - o[i3])
                if cosine > 0.0 and depth < nearest * cosine:  # the body is before the ends of all rays
                    last, first, edge = NONE, begin[b], first_edge[b]
                    for part in range(2):  # the box of the body, then its other planes
                        until, to = (first + 2 * BOX, edge + EDGES) if part == 0 else (begin[b + 1], first_edge[b + 1])
                        if part == 0 or until > first:
                            last = _cut(
                                columns,
                                first,
                                until,
                                sides,
                                corners,
                                edge,
                                to,
                                here,
                                along,
                                sine,
                                gaps,
                                outline,
                                faces,
                                room,
                            )
                        first, edge = until, to
                        if last == NONE:
                            break
                    if last == NONE:
                        continue
                    if last == room:
                        is_hidden = True
                        break
                    if last != UNSURE:
                        form[b], lists[b, 1], lists[b, 2] = OUTLINE, last, last
            if form[b] == FACES:
                lists[b, 1], lists[b, 2] = _faced(
                    planes, begin[b], begin[b + 1], here, (*along, sine, cosine), farthest, faces, room
                )
                if lists[b, 2] == room:
                    continue
            if form[b] != ROUND:
                room = lists[b, 2]
            some[kept] = b
            kept += 1
        if is_hidden:
            for i in range(wanted):
                out[n, asked[i]] = 1
            continue
        if kept == 0:
            continue
        for j in range(wanted):
            k = asked[j]
            ray = towards[j, 0], towards[j, 1], towards[j, 2]
            for i in range(kept):
                b = some[i]
                d = ray if b < fixed else _turned_back(poses[b - fixed, n], ray)
                if form[b] == OUTLINE:
                    hidden = True
                    for e in range(lists[b, 0], lists[b, 1]):
                        if faces[e, 0] * d[0] + faces[e, 1] * d[1] + faces[e, 2] * d[2] > 0.0:
                            hidden = False
                            break
                elif form[b] == FACES:
                    hidden = _enters(faces, lists[b, 0], lists[b, 1], lists[b, 2], d, reach[n, k])
                else:
                    here = o if b < fixed else (at[b, 0], at[b, 1], at[b, 2])
                    low, high = inside(planes, begin[b], begin[b + 1], rounds[b], here, d)
                    hidden = low <= high and TOUCH < low < reach[n, k]
                if hidden:
                    out[n, k] = 1
                    some[0], some[i] = some[i], some[0]  # it is likely to block the next ray too
                    break
