"""Which rays in the plane, all round a camera, meet which edges: each edge is asked of the few rays that it spans."""

# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

import math

from hpop.runtime.compiled import lean

HALF_TURN = 3.1
"""rad: an edge that seems longer is so close that the angle cannot tell on which side of the camera it passes."""


@lean
def crossings(edges, x, y, directions, last, distance, edge, before):
    """Meetings of rays from (x, y), m, with edges (E, 4), m; directions (N, 2) are counter-clockwise, evenly apart.

    Fills of each ray its last meeting (N,), or -1; and of each meeting its distance, m, its edge, and the meeting of
    the same ray before it, or -1. Returns how many meetings there are: where these are more than there is room for,
    only so many are told. An edge is met where its ends are on either side of the ray, one end on the ray being counted
    as on its left: so a ray leaves a ring as often as it enters it, whichever corners it passes. Angles only say which
    rays are asked.
    """
    count, room, found = len(directions), len(distance), 0
    to_ray = count / (2.0 * math.pi)
    first = math.atan2(directions[0, 1], directions[0, 0])
    for ray in range(count):
        last[ray] = -1
    for e in range(len(edges)):
        ax, ay = edges[e, 0] - x, edges[e, 1] - y
        bx, by = edges[e, 2] - x, edges[e, 3] - y
        along_x, along_y = bx - ax, by - ay
        through = ax * along_y - ay * along_x
        begin = math.atan2(ay, ax)
        turned = math.atan2(ax * by - ay * bx, ax * bx + ay * by)
        if turned < 0.0:
            begin, turned = begin + turned, -turned
        ray = math.floor((begin - first) * to_ray) - 1
        steps = count if turned > HALF_TURN else min(int(turned * to_ray) + 4, count)
        for _ in range(steps):
            ray = ray % count
            dx, dy = directions[ray, 0], directions[ray, 1]
            if (dx * ay - dy * ax >= 0.0) != (dx * by - dy * bx >= 0.0):
                t = through / (dx * along_y - dy * along_x)
                if t > 0.0:
                    if found < room:
                        distance[found], edge[found], before[found] = t, e, last[ray]
                        last[ray] = found
                    found += 1
            ray += 1
    return found


@lean
def longest(last, before):
    """The most meetings of one ray."""
    most = 0
    for ray in range(len(last)):
        count, k = 0, last[ray]
        while k >= 0:
            count, k = count + 1, before[k]
        most = max(most, count)
    return most
