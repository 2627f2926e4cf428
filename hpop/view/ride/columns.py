"""Compiled functions that draw a panorama column by column.

Everything in the scene is upright, so one ray in the ground plane suffices for each column. The ray meets edges of
obstacles at distances t. Going outwards, each stretch of floor, each top and each front face covers an interval of
rows, given by its height and distance. Nearer things are drawn first and hide farther ones. A row that is partly
covered takes a share of the colour, so that edges are smooth without further rays.

In all functions (dx, dy) is the unit vector of a ray, and t, m, a distance along it. What a ray may meet has one
sequence of numbers: edges of items first, then body parts, then plates. Arguments are described in `tiles`: ``things``
(`Things`), ``view`` (`CameraView`), ``sheet`` (`ColumnBuffer`), ``room`` (`DrawingBuffers`), ``tile`` (`Tile`).
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.runtime.compiled import kernel, lean
from hpop.view.ride.rows import (
    EXTENT,
    FAR,
    FLATTEST,
    LEAST_LEFT,
    NEAR,
    ZONE,
    draw_front,
    draw_part,
    draw_plane,
    draw_plate,
    row_of,
)

# mypy: disable-error-code="no-untyped-def"


@lean
def _meets_part(part, dx, dy, view):
    """Return the distance, m, at which a ray enters a body part of a person; FAR if it misses it or begins inside."""
    x, y = part[0] - view.x, part[1] - view.y
    aside = dx * y - dy * x
    reach = part[5] * part[5] - aside * aside
    t = dx * x + dy * y - math.sqrt(max(reach, 0.0))
    return t if reach > 0.0 and t > NEAR else FAR


@lean
def _meets_plate(plate, dx, dy, view):
    """Return the distance, m, at which a ray meets the plate of a landmark; FAR if it misses it."""
    x, y = plate[0] - view.x, plate[1] - view.y
    against = dx * plate[3] + dy * plate[4]
    if abs(against) < FLATTEST:
        return FAR
    t = (x * plate[3] + y * plate[4]) / against
    across = (t * dx - x) * -plate[4] + (t * dy - y) * plate[3]
    return t if t > NEAR and abs(across) <= 0.5 * plate[5] else FAR


@lean
def _insert(what, t, order, away, count):
    """Insert the number ``what`` and its distance t into the first ``count`` entries of ``order`` and ``away``.

    They stay sorted by distance, then by number.
    """
    k = count
    while k > 0 and (away[k - 1] > t or (away[k - 1] == t and order[k - 1] > what)):
        away[k], order[k] = away[k - 1], order[k - 1]
        k -= 1
    away[k], order[k] = t, what


@lean
def _stretch(t0, t1, opened, count, things, dx, dy, sheet, view, tile):
    """Draw all horizontal surfaces between the distances t0 and t1 along a ray: tops, undersides and the floor.

    The first ``count`` entries of ``opened`` are the items that contain this stretch of the ray.
    """
    look = view.look
    items, wall = things.items, look.wall_contrast
    upward, downward = look.ambient + look.diffuse * look.light[2], look.ambient - look.diffuse * look.light[2]
    bound = np.inf
    while True:  # tops below the camera, the highest first
        best = -1
        for k in range(count):
            top = items[opened[k], 2]
            is_next = items[opened[k], 0] < EXTENT and top < min(view.z, bound)
            if is_next and (best < 0 or top > items[best, 2]):
                best = opened[k]
        if best < 0:
            break
        bound = items[best, 2]
        item = items[best]
        red, green, blue = item[3] * upward, item[4] * upward, item[5] * upward
        draw_plane(bound - view.z, t0, t1, red, green, blue, item[6], 0.0, wall, dx, dy, sheet, view, tile)
    bound = -np.inf
    while True:  # undersides above it, the lowest first
        best = -1
        for k in range(count):
            under = items[opened[k], 1]
            is_next = items[opened[k], 0] < EXTENT and under > max(view.z, bound)
            if is_next and (best < 0 or under < items[best, 1]):
                best = opened[k]
        if best < 0:
            break
        bound = items[best, 1]
        item = items[best]
        red, green, blue = item[3] * downward, item[4] * downward, item[5] * downward
        draw_plane(bound - view.z, t0, t1, red, green, blue, item[6], 0.0, wall, dx, dy, sheet, view, tile)
    if view.z <= 0.0:
        return
    red, green, blue = look.outside
    grid, contrast = 0.0, look.outside_contrast
    for k in range(count):
        if items[opened[k], 0] == EXTENT:
            red, green, blue = look.floor
            grid, contrast = look.floor_grid, look.floor_contrast
    for k in range(count):
        item = items[opened[k]]
        if item[0] == ZONE:
            red += look.zone_share * (item[3] - red)
            green += look.zone_share * (item[4] - green)
            blue += look.zone_share * (item[5] - blue)
    red, green, blue = red * upward, green * upward, blue * upward
    draw_plane(-view.z, t0, t1, red, green, blue, 0, grid, contrast, dx, dy, sheet, view, tile)


@lean
def _ray(count, open_count, dx, dy, room, things, view, tile):
    """Draw everything that one ray meets, from near to far, into the rows of its column.

    count       number of meetings in ``room.order`` and ``room.away``
    open_count  number of items that contain the camera, in ``room.opened``
    """
    sheet, is_in, opened, order, away = room.sheet, room.is_in, room.opened, room.order, room.away
    edges = len(things.edges)
    lowest = len(view.slopes) - 1  # row that is not drawn yet
    t0 = NEAR
    for place in range(count + 1):
        t1 = max(away[place], NEAR) if place < count else FAR
        if t1 > t0:
            _stretch(t0, t1, opened, open_count, things, dx, dy, sheet, view, tile)
            t0 = t1
        if place == count:
            break
        what = order[place]
        if what >= edges + len(things.parts):
            draw_plate(t1, what - edges - len(things.parts), dx, dy, sheet, view, things)
        elif what >= edges:
            draw_part(t1, things.parts[what - edges], dx, dy, sheet, view)
        else:
            i = things.item_of[what]
            is_in[i] ^= True
            if is_in[i]:
                opened[open_count] = i
                open_count += 1
                if things.items[i, 0] < EXTENT:
                    draw_front(t1, things.items[i], things.edges[what], dx, dy, sheet, view, tile)
            else:
                k = 0
                while opened[k] != i:
                    k += 1
                open_count -= 1
                opened[k] = opened[open_count]
        while lowest >= 0 and sheet.left[lowest] <= LEAST_LEFT:
            lowest -= 1
        if lowest + 1 <= row_of(max(things.highest - view.z, 0.0) / t1, view):
            break  # the rows of all farther things are drawn


@lean
def draw(begin, end, met, things, view, tile, room, colours, numbers):
    """Draw columns ``begin`` to ``end`` of a panorama into the arrays ``colours`` (H, C, 3) and ``numbers`` (H, C).

    Numbers of the visible things are written only if ``view.hard``. Colours are rounded to whole numbers, halves up.
    ``met`` is the result of `crossings`; ``room`` holds working arrays, which are overwritten.
    """
    last, edge = met.last, met.edge
    rows, rays = len(view.slopes), len(view.directions)
    sheet, is_in, opened, order, away = room.sheet, room.is_in, room.opened, room.order, room.away
    for column in range(begin, end):
        for row in range(rows):
            for channel in range(3):
                sheet.summed[row, channel] = 0.0
        for sub in range(view.per_column):
            ray = (view.shift - column * view.per_column - sub) % rays
            dx, dy = view.directions[ray, 0], view.directions[ray, 1]
            for row in range(rows):
                sheet.left[row] = 1.0
                sheet.numbers[row] = 0
            k = last[ray]
            while k >= 0:
                is_in[things.item_of[edge[k]]] ^= True  # met an odd number of times: the camera is in it
                k = met.before[k]
            count, k, open_count = 0, last[ray], 0
            while k >= 0:
                i = things.item_of[edge[k]]
                if is_in[i]:
                    known = False
                    for j in range(open_count):
                        known = known or opened[j] == i
                    if not known:
                        opened[open_count] = i
                        open_count += 1
                _insert(edge[k], met.distance[k], order, away, count)
                count, k = count + 1, met.before[k]
            for p in range(len(things.parts)):
                t = _meets_part(things.parts[p], dx, dy, view)
                if t < FAR:
                    _insert(len(things.edges) + p, t, order, away, count)
                    count += 1
            for p in range(len(things.plates)):
                t = _meets_plate(things.plates[p], dx, dy, view)
                if t < FAR:
                    _insert(len(things.edges) + len(things.parts) + p, t, order, away, count)
                    count += 1
            _ray(count, open_count, dx, dy, room, things, view, tile)
            k = last[ray]
            while k >= 0:
                is_in[things.item_of[edge[k]]] = False
                k = met.before[k]
            for row in range(rows):
                if sheet.left[row] > 0.0:
                    for channel in range(3):
                        sheet.summed[row, channel] += sheet.left[row] * view.sky[row, channel]
        for row in range(rows):
            for channel in range(3):
                value = math.floor(sheet.summed[row, channel] / view.per_column + 0.5)
                colours[row, column, channel] = min(max(value, 0), 255)
            if view.hard:
                numbers[row, column] = sheet.numbers[row]


HALF_TURN = 3.1
"""rad: an edge that seems longer is so close that the angle cannot tell on which side of the camera it passes."""


@lean
def crossings(edges, x, y, directions, last, distance, edge, before):
    """Find where rays from the camera (x, y), m, meet the edges (E, 4), m, of obstacles.

    Directions (N, 2) of the rays are counter-clockwise, evenly apart.

    The meetings of a ray form a linked list. Written are, for each ray, its last meeting (N,), or -1; and for each
    meeting its distance, m, its edge, and the ray's previous meeting, or -1. Returns the number of meetings; those
    beyond the arrays' size are not written. An edge is met if its ends are on different sides of the ray, where an end
    on the ray counts as left. So a ray leaves a ring as often as it enters it, even at corners. Angles only select
    candidate rays.
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
    """Return the largest number of edges that one ray meets."""
    most = 0
    for ray in range(len(last)):
        count, k = 0, last[ray]
        while k >= 0:
            count, k = count + 1, before[k]
        most = max(most, count)
    return most


def boxes(cells: BoolArray) -> IntArray:
    """Cover the True cells (H, W) with disjoint rectangles (B, 4): first column and row, and those after the last.

    >>> boxes(np.array([[True, True, False], [True, True, True]])).tolist()
    [[0, 0, 2, 2], [2, 1, 3, 2]]
    """
    return cast(IntArray, _boxes(np.array(cells, dtype=np.bool_)))


@kernel
def _boxes(cells):
    """Cover the True cells with rectangles greedily, each first extended along its row, then to further rows.

    ``cells`` is overwritten.
    """
    rows, columns = cells.shape
    found = np.empty((64, 4), np.int64)
    count = 0
    for row in range(rows):
        column = 0
        while column < columns:
            if not cells[row, column]:
                column += 1
                continue
            end = column + 1
            while end < columns and cells[row, end]:
                end += 1
            top = row + 1
            while top < rows and cells[top, column:end].all():
                top += 1
            cells[row:top, column:end] = False
            if count == len(found):
                grown = np.empty((2 * count, 4), np.int64)
                grown[:count] = found
                found = grown
            found[count] = column, row, end, top
            count += 1
            column = end
    return found[:count].copy()
