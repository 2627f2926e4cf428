"""Compiled loop that counts the lines of sight that bodies in space block, with few divisions per line."""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.world.geometry._kernels import PARALLEL, TOUCH, bundle, in_bundle, inside, within_reach

LATER = -1  # the planes of a hull are sorted when a ray meets its box, but none of its balls
BOX = 3  # most planes of a box that face a point outside it


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
    axis: tuple[float, ...],
    sine: float,
    sorted_: FloatArray,
    room: int,
) -> tuple[int, int]:
    """Copy the planes of a body to sorted_, from row ``room`` on: planes that face the point ``o`` first.

    Return the row after the planes that face the point o, and the row after all planes. The last column becomes the
    distance of the point behind each plane, m. Nothing is copied for a body that no ray from the point can enter: one
    that contains the point, or that lies behind the cone of rays.
    """
    front, back = room, room + last - first
    for k in range(first, last):
        x, y, z = planes[k, 0], planes[k, 1], planes[k, 2]
        gap = planes[k, 3] - x * o[0] - y * o[1] - z * o[2]
        if gap < 0.0:
            if x * axis[0] + y * axis[1] + z * axis[2] > sine:
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
def _is_clear(planes: FloatArray, first: int, o: tuple[float, ...]) -> bool:
    """Return whether a point ``o`` is outside the box of a hull, its first six planes, by more than a touch."""
    for k in range(first, first + 2 * BOX):
        if planes[k, 3] - planes[k, 0] * o[0] - planes[k, 1] * o[1] - planes[k, 2] * o[2] < -2.0 * TOUCH:
            return True
    return False


@lean
def _meets_box(planes: FloatArray, first: int, o: tuple[float, ...], d: tuple[float, ...], reach: float) -> bool:
    """Return whether a ray may enter the box of a hull before ``reach``, m; if not, `_enters` would say no, too."""
    low, high = 0.0, reach
    for k in range(first, first + 2 * BOX):
        x, y, z = planes[k, 0], planes[k, 1], planes[k, 2]
        gap, slant = planes[k, 3] - x * o[0] - y * o[1] - z * o[2], x * d[0] + y * d[1] + z * d[2]
        if gap < 0.0:
            if slant >= -PARALLEL:
                return False
            low = max(low, gap / slant)
        elif slant > PARALLEL:
            high = min(high, gap / slant)
    return low <= high + TOUCH


@lean
def _enters_ball(
    balls: FloatArray, first: int, last: int, o: tuple[float, ...], d: tuple[float, ...], reach: float
) -> bool:
    """Return whether a ray is in a ball inside a hull where it is nearest to the ball's centre, before ``reach``, m.

    If it begins clear of the hull, `_enters` would say so, too, but looks at all planes.
    """
    for k in range(first, last):
        x, y, z = balls[k, 0] - o[0], balls[k, 1] - o[1], balls[k, 2] - o[2]
        along = x * d[0] + y * d[1] + z * d[2]
        if 0.0 < along < reach and x * x + y * y + z * z - along * along < balls[k, 3] * balls[k, 3]:
            return True
    return False


@kernel
def blocked(
    planes: FloatArray,
    begin: IntArray,
    rounds: FloatArray,
    own_planes: FloatArray,
    own_begin: IntArray,
    own_rounds: FloatArray,
    inner: FloatArray,
    first_ball: IntArray,
    poses: FloatArray,
    origins: FloatArray,
    directions: FloatArray,
    reach: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (N,) the fraction of rays from each origin (N, 3) that enter a body before ``reach`` (N, K), m.

    directions (N, K, 3): unit vectors. Bodies belong to the world, or to the robot ("own"). Each body of the
    robot moves with a frame: poses (B, N, 4, 4). See `Surfaces` for planes, begin and rounds; inner and first_ball are
    the balls in the hulls of the robot.
    """
    count, own_count = len(rounds), len(own_rounds)
    near, some = np.empty(max(count, own_count), np.int64), np.empty(count + own_count, np.int64)
    balls, seen_from = np.empty((own_count, 8)), np.empty((own_count, 3))
    faces = np.empty((len(planes) + len(own_planes), 4))
    lists = np.empty((count + own_count, 3), np.int64)
    ranges, sorted_ = np.empty((own_count, 3), np.int64), np.full(own_count, -1)  # of hulls with balls
    for n in range(len(origins)):
        o = (origins[n, 0], origins[n, 1], origins[n, 2])
        farthest = reach[n].max()
        cone = bundle(directions[n])
        sine = math.sin(cone[3]) if cone[3] < 0.5 * math.pi else 2.0
        axis = (cone[0], cone[1], cone[2])
        room = kept = 0
        for i in range(in_bundle(rounds, o, cone, near, within_reach(rounds, o, farthest, near))):
            b = near[i]
            lists[b, 0] = room
            lists[b, 1], lists[b, 2] = _faced(planes, begin[b], begin[b + 1], o, axis, sine, faces, room)
            if lists[b, 2] > room or rounds[b, 6] > 0.0:
                room, some[kept] = lists[b, 2], b
                kept += 1
        for b in range(own_count):
            pose, c = poses[b, n], own_rounds[b]
            seen_from[b, 0], seen_from[b, 1], seen_from[b, 2] = _turned_back(
                pose, (o[0] - pose[0, 3], o[1] - pose[1, 3], o[2] - pose[2, 3])
            )
            for i in range(3):
                balls[b, i] = pose[i, 0] * c[0] + pose[i, 1] * c[1] + pose[i, 2] * c[2] + pose[i, 3]
            balls[b, 7] = c[7]
        for i in range(in_bundle(balls, o, cone, near, within_reach(balls, o, farthest, near))):
            b, place = near[i], count + near[i]
            at, along = (seen_from[b, 0], seen_from[b, 1], seen_from[b, 2]), _turned_back(poses[b, n], axis)
            lists[place, 0] = room
            if first_ball[b + 1] > first_ball[b] and _is_clear(own_planes, own_begin[b], at):
                lists[place, 0], some[kept] = LATER, place
                kept += 1
                continue
            lists[place, 1], lists[place, 2] = _faced(
                own_planes, own_begin[b], own_begin[b + 1], at, along, sine, faces, room
            )
            if lists[place, 2] > room or own_rounds[b, 6] > 0.0:
                room, some[kept] = lists[place, 2], place
                kept += 1
        hits = 0
        for k in range(directions.shape[1]):
            towards = directions[n, k, 0], directions[n, k, 1], directions[n, k, 2]
            for i in range(kept):
                place = some[i]
                b = place - count
                if b < 0:
                    d = towards
                    if rounds[place, 6] > 0.0:
                        low, high = inside(planes, begin[place], begin[place + 1], rounds[place], o, d)
                        hidden = low <= high and TOUCH < low < reach[n, k]
                    else:
                        hidden = _enters(faces, lists[place, 0], lists[place, 1], lists[place, 2], d, reach[n, k])
                else:
                    d = _turned_back(poses[b, n], towards)
                    if own_rounds[b, 6] > 0.0:
                        at = (seen_from[b, 0], seen_from[b, 1], seen_from[b, 2])
                        low, high = inside(own_planes, own_begin[b], own_begin[b + 1], own_rounds[b], at, d)
                        hidden = low <= high and TOUCH < low < reach[n, k]
                    elif lists[place, 0] != LATER:
                        hidden = _enters(faces, lists[place, 0], lists[place, 1], lists[place, 2], d, reach[n, k])
                    else:
                        at = (seen_from[b, 0], seen_from[b, 1], seen_from[b, 2])
                        if not _meets_box(own_planes, own_begin[b], at, d, reach[n, k]):
                            continue
                        hidden = _enters_ball(inner, first_ball[b], first_ball[b + 1], at, d, reach[n, k])
                        if not hidden:
                            if sorted_[b] != n:
                                along = _turned_back(poses[b, n], axis)
                                ranges[b, 0] = room
                                ranges[b, 1], ranges[b, 2] = _faced(
                                    own_planes, own_begin[b], own_begin[b + 1], at, along, sine, faces, room
                                )
                                room, sorted_[b] = ranges[b, 2], n
                            hidden = ranges[b, 2] > ranges[b, 0] and _enters(
                                faces, ranges[b, 0], ranges[b, 1], ranges[b, 2], d, reach[n, k]
                            )
                if hidden:
                    hits += 1
                    some[0], some[i] = some[i], some[0]  # it is likely to block the next ray too
                    break
        out[n] = hits / directions.shape[1]
