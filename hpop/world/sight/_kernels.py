"""Compiled loops for sight: rays and optic flow along bearings, shadows, isovists, and landmarks in view."""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import kernel

PAD = 2  # samples of padding before the first sample of a field
TOUCHING = 1e-9  # m: an edge nearer than this blocks as if it were this far away


@kernel
def _hit(x: float, y: float, cos: float, sin: float, edges: FloatArray, e: int) -> float:
    """Return the distance from a point in a direction to edge e, m; inf if the ray misses it or is parallel to it."""
    dx, dy = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
    across = cos * dy - sin * dx
    if across == 0.0:
        return math.inf
    wx, wy = edges[e, 0] - x, edges[e, 1] - y
    along: float = (wx * dy - wy * dx) / across
    share = (wx * sin - wy * cos) / across
    if along < 0.0 or share < -1e-12 or share > 1.0 + 1e-12:
        return math.inf
    return along


@kernel
def cast(
    edges: FloatArray,
    start: IntArray,
    members: IntArray,
    shape: tuple[int, int],
    corner: tuple[float, float],
    side: float,
    x: FloatArray,
    y: FloatArray,
    directions: FloatArray,
    reach: float,
    out: FloatArray,
) -> None:
    """Write to out (M, B) the distance, m, from each point along directions (B, 2) to the first edge; at most reach.

    A ray visits the buckets of an `EdgeGrid` in order, and stops at a hit within the buckets visited so far.
    """
    rows, columns = shape
    right, top = corner[0] + columns * side, corner[1] + rows * side
    for n in range(x.size):
        for b in range(directions.shape[0]):
            cos, sin = directions[b]
            # Where the ray enters and leaves the grid.
            enter, leave = 0.0, reach
            for p, d, low, high in ((x[n], cos, corner[0], right), (y[n], sin, corner[1], top)):
                if abs(d) < 1e-15:
                    if p < low or p > high:
                        leave = -1.0
                else:
                    first, last = (low - p) / d, (high - p) / d
                    enter, leave = max(enter, min(first, last)), min(leave, max(first, last))
            best = reach
            if enter <= leave:
                u, v = (x[n] + enter * cos - corner[0]) / side, (y[n] + enter * sin - corner[1]) / side
                j, i = min(max(int(u), 0), columns - 1), min(max(int(v), 0), rows - 1)
                right_first = enter + ((j + 1 if cos > 0 else j) - u) * side / cos if abs(cos) > 1e-15 else math.inf
                up_first = enter + ((i + 1 if sin > 0 else i) - v) * side / sin if abs(sin) > 1e-15 else math.inf
                right_step = side / abs(cos) if abs(cos) > 1e-15 else math.inf
                up_step = side / abs(sin) if abs(sin) > 1e-15 else math.inf
                while True:
                    for m in range(start[i * columns + j], start[i * columns + j + 1]):
                        best = min(best, _hit(x[n], y[n], cos, sin, edges, members[m]))
                    t = min(right_first, up_first)
                    if best <= t or t > leave:
                        break
                    if right_first <= up_first:
                        j += 1 if cos > 0 else -1
                        right_first += right_step
                    else:
                        i += 1 if sin > 0 else -1
                        up_first += up_step
                    if j < 0 or j >= columns or i < 0 or i >= rows:
                        break
            out[n, b] = best


@kernel
def flow(
    layers: FloatArray,
    directions: FloatArray,
    u: FloatArray,
    v: FloatArray,
    velocity_x: FloatArray,
    velocity_y: FloatArray,
    turn_rate: FloatArray,
    tilt: FloatArray,
    yaw: FloatArray,
    width: FloatArray,
    nearest: float,
    largest: bool,
    out: FloatArray,
) -> None:
    """Write to out (M,) the mean, or the largest, angular speed of surfaces over the bearings, rad/s; see `Bearings`.

    layers  (H, W, 3 B)  as from `Bearings.layers`, perhaps with contrasts, or the distances (H, W, B) alone
    u, v    (M,)         positions in grid steps, clamped as in `Field`
    tilt    (3, M)       upward velocity, and rotation about x and about y; (3, 0) if all are zero
    yaw     (M,)         middle of the angle ``width`` (M,) of visible bearings, rad; (0,) if all are visible
    """
    rows, columns, splines = layers.shape
    count = directions.shape[0]
    sector = 2.0 * math.pi / count
    partial, tilts = yaw.size > 0, tilt.shape[1] > 0
    value = np.empty(splines)
    wu, wv = np.empty(4), np.empty(4)
    for n in range(u.size):
        if math.isnan(u[n]) or math.isnan(v[n]):
            out[n] = math.nan
            continue
        a = min(max(u[n], 1.0), columns - 2.0)
        b = min(max(v[n], 1.0), rows - 2.0)
        j, i = min(int(a), columns - 3), min(int(b), rows - 3)
        _weights(a - j, wu)
        _weights(b - i, wv)
        value[:] = 0.0
        for p in range(4):
            for q in range(4):
                weight = wv[p] * wu[q]
                for k in range(splines):
                    value[k] += weight * layers[i - 1 + p, j - 1 + q, k]
        total = worst = 0.0
        seen = 0.0 if partial else float(count)
        for k in range(count):
            across = velocity_x[n] * directions[k, 1] - velocity_y[n] * directions[k, 0]
            inverse = 1.0 / max(value[k], nearest)
            if splines > count:
                inverse += value[2 * count + k] * (value[count + k] - inverse)
            speed = abs(across * inverse - turn_rate[n])
            if tilts:
                speed = math.hypot(
                    speed, tilt[0, n] * inverse + tilt[1, n] * directions[k, 1] - tilt[2, n] * directions[k, 0]
                )
            if splines > 3 * count:
                speed *= min(max(value[3 * count + k], 0.0), 1.0)
            if partial:
                off = abs((k * sector - yaw[n] + math.pi) % (2.0 * math.pi) - math.pi)
                share = min(1.0, width[n] / sector, (0.5 * width[n] - off) / sector + 0.5)
                if share <= 0.0:
                    continue
                seen += share
                total += share * speed
            else:
                total += speed
            worst = max(worst, speed)
        out[n] = worst if largest else total / seen


@kernel
def _weights(s: float, out: FloatArray) -> None:
    """Write to out the cubic B-spline weights of four successive samples, at s steps beyond the second of them."""
    r = 1.0 - s
    out[0] = r * r * r / 6.0
    out[1] = (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0
    out[2] = (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
    out[3] = s * s * s / 6.0


@kernel
def _line(turns: IntArray, low: int, left: int, ax: float, ay: float, bx: float, by: float) -> None:
    """Add one directed line of an outline, from (ax, ay) to (bx, by), to the array ``turns`` of winding numbers.

    In each row that the line crosses, the next node to its right gets +1 if the line goes down, and -1 if it goes up.
    Then the sum of a row up to a node counts how often the outline winds round the node. A row through an end of
    the line is crossed only if this end is the lower one. x is computed from the lower end, so that opposite lines
    cancel exactly. ``turns`` begins at row ``low`` and column ``left``.
    """
    high, right = low + turns.shape[0], left + turns.shape[1] - 1
    sign = 1
    if ay < by:
        sign = -1
    else:
        ax, ay, bx, by = bx, by, ax, ay
    first = math.ceil(min(max(ay, float(low)), float(high)))
    last = math.ceil(min(max(by, float(low)), float(high)))
    for row in range(first, last):
        x = ax + (row - ay) * (bx - ax) / (by - ay)
        turns[row - low, math.ceil(min(max(x, float(left)), float(right))) - left] += sign


@kernel
def shadows(
    edges: FloatArray,
    near: FloatArray,
    far: FloatArray,
    u: float,
    v: float,
    shape: tuple[int, int],
    low: int,
    left: int,
    turns: IntArray,
) -> None:
    """Add the outlines of all shadows to turns (H, W + 1), so that sums along a row count the shadows on each node.

    edges      (E, 4)  grid steps: x0, y0, x1, y1, with the solid on the left
    near, far  (E,)    where the shadow of an edge begins and ends, in multiples of its distance from the light
    u, v               position of the light, grid steps
    shape              rows and columns of the grid
    low, left          row and column of the grid where ``turns`` begins
    """
    reach = 0.0
    for x in (-u, shape[1] + 1 - u):
        for y in (-v, shape[0] - v):
            reach = max(reach, 4.0 * math.hypot(x, y))
    for e in range(edges.shape[0]):
        ax, ay = edges[e, 0] - u, edges[e, 1] - v
        bx, by = edges[e, 2] - u, edges[e, 3] - v
        enters = ax * by - ay * bx < 0.0
        endless = math.isinf(far[e])
        if not enters:
            if not endless:  # the far end: the light passes the top or bottom of the prism
                _line(turns, low, left, far[e] * ax + u, far[e] * ay + v, far[e] * bx + u, far[e] * by + v)
            continue
        if endless:
            fa, fb = reach / math.hypot(ax, ay), reach / math.hypot(bx, by)
        else:
            fa = fb = far[e]
        n = near[e]
        _line(turns, low, left, n * ax + u, n * ay + v, n * bx + u, n * by + v)
        _line(turns, low, left, n * bx + u, n * by + v, fb * bx + u, fb * by + v)
        _line(turns, low, left, fa * ax + u, fa * ay + v, n * ax + u, n * ay + v)
        if endless:  # back beyond the grid, by way of the edge's normal
            length = math.hypot(bx - ax, by - ay)
            nx, ny = reach * (ay - by) / length, reach * (bx - ax) / length
            _line(turns, low, left, fb * bx + u, fb * by + v, nx + u, ny + v)
            _line(turns, low, left, nx + u, ny + v, fa * ax + u, fa * ay + v)


@kernel
def lit(turns: IntArray, split: int, out: FloatArray) -> None:
    """Add to out (H, W) the fraction of the split x split nodes round each sample that lie in no shadow.

    turns  (H split, W split + 1)  as from `shadows`
    """
    for row in range(turns.shape[0]):
        count = 0
        for column in range(turns.shape[1] - 1):
            count += turns[row, column]
            if count == 0:
                out[row // split, column // split] += 1.0 / (split * split)


@kernel
def isovists(
    edges: FloatArray, x: FloatArray, y: FloatArray, radius: float, cos: FloatArray, sin: FloatArray, out: FloatArray
) -> None:
    """Write to out (M,) the visible fraction of the disc of the given radius, m, round each point.

    edges     (E, 4)  m: x0, y0, x1, y1, with the solid on the left
    cos, sin  (K,)    directions of rays, in the middle of K equal sectors from angle 0

    A ray ends where it first enters a solid.
    """
    rays = cos.size
    sector = 2.0 * math.pi / rays
    shortened = [1.0] * rays  # radius / length of each ray, >= 1
    for k in range(x.size):
        for i in range(rays):
            shortened[i] = 1.0
        for e in range(edges.shape[0]):
            ax, ay = edges[e, 0] - x[k], edges[e, 1] - y[k]
            bx, by = edges[e, 2] - x[k], edges[e, 3] - y[k]
            cross = ax * by - ay * bx
            length = math.hypot(bx - ax, by - ay)
            if cross > 0.0 or -cross >= radius * length:
                continue
            apart = min(ax * ax + ay * ay, bx * bx + by * by) >= radius * radius
            if apart and (ax * (bx - ax) + ay * (by - ay)) * (bx * (bx - ax) + by * (by - ay)) >= 0.0:
                continue  # both ends are out of reach, on one side of the perpendicular
            # A ray in direction u ends at d / (n u): d is the distance of the edge's line, n its normal.
            scale = radius / (length * max(-cross / length, TOUCHING))
            nx, ny = scale * (ay - by), scale * (bx - ax)
            low = math.atan2(by, bx)
            span = math.atan2(ay, ax) - low
            if span < 0.0:
                span += 2.0 * math.pi
            if span > math.pi + 1e-6:  # seen end on, so it spans no angle
                continue
            first = math.ceil(low / sector - 0.5)
            last = math.floor((low + span) / sector - 0.5)
            for i in range(first, last + 1):
                j = i % rays
                shortened[j] = max(shortened[j], nx * cos[j] + ny * sin[j])
        closed = 0.0
        for i in range(rays):
            closed += 1.0 - 1.0 / (shortened[i] * shortened[i])
        out[k] = 1.0 - closed / rays


@kernel
def _share(s: float, place: int) -> float:
    """Return cubic B-spline weight number ``place`` of four samples, at s steps beyond the second of them."""
    r = 1.0 - s
    if place == 0:
        return r * r * r / 6.0
    if place == 1:
        return (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0
    if place == 2:
        return (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
    return s * s * s / 6.0


@kernel
def unseen(
    values: FloatArray,
    windows: IntArray,
    shape: tuple[int, int],
    marks: FloatArray,
    cos_half: FloatArray,
    half_height: FloatArray,
    corner_x: float,
    corner_y: float,
    spacing: float,
    x: FloatArray,
    y: FloatArray,
    yaw: FloatArray,
    pitch: FloatArray,
    out: FloatArray,
) -> None:
    """Write to out (M,) 1 - the total visibility, in [0, 1], of the landmarks within the angle of view.

    The visibility of each landmark, times its share of all weights, is a field; see `landmark_field`.

    values            (N,)    samples of all fields, one field after another, row by row; 0 beyond the windows
    windows           (L, 5)  of each field: index of its first value, first row, rows, first column, columns
    shape                     rows and columns of the grid; beyond it the values of its border hold
    marks             (L, 3)  m: x, y, and height above the camera
    cos_half          (M,)    cosine of half the angle of view
    half_height       (M,)    half the vertical angle of view, rad
    corner_x, corner_y        first node of the padded grid, m, with nodes ``spacing`` m apart
    x, y, yaw, pitch  (M,)    of the camera, m and rad; pitch is (0,) if all elevations are in view
    """
    rows, columns = shape[0] + 2 * PAD, shape[1] + 2 * PAD
    count = len(windows)
    weight = [0.0] * 16
    value = [math.nan] * count  # of each field at the point, computed on first use
    px = py = math.nan
    i = j = 0
    for k in range(x.size):
        if math.isnan(x[k]) or math.isnan(y[k]) or math.isnan(yaw[k]):
            out[k] = math.nan
            continue
        if x[k] != px or y[k] != py:  # turns in place evaluate one point many times
            px, py = x[k], y[k]
            a = min(max((px - corner_x) / spacing, 1.0), columns - 2.0)
            b = min(max((py - corner_y) / spacing, 1.0), rows - 2.0)
            j, i = min(int(a), columns - 3), min(int(b), rows - 3)
            s, t = a - j, b - i
            for p in range(4):
                for q in range(4):
                    weight[4 * p + q] = _share(t, p) * _share(s, q)
            for m in range(count):
                value[m] = math.nan
        ahead, left = math.cos(yaw[k]), math.sin(yaw[k])
        total = 0.0
        for m in range(count):
            dx, dy = marks[m, 0] - px, marks[m, 1] - py
            flat = math.sqrt(dx * dx + dy * dy)
            if ahead * dx + left * dy < cos_half[k] * flat:
                continue
            if pitch.size > 0 and abs(math.atan2(marks[m, 2], flat) - pitch[k]) > half_height[k]:
                continue
            if math.isnan(value[m]):
                total_here = 0.0
                for p in range(4):
                    row = min(max(i - 1 + p - PAD, 0), shape[0] - 1) - windows[m, 1]
                    if not 0 <= row < windows[m, 2]:
                        continue
                    for q in range(4):
                        column = min(max(j - 1 + q - PAD, 0), shape[1] - 1) - windows[m, 3]
                        if 0 <= column < windows[m, 4]:
                            total_here += weight[4 * p + q] * values[windows[m, 0] + row * windows[m, 4] + column]
                value[m] = total_here
            total += value[m]
        out[k] = min(max(1.0 - total, 0.0), 1.0)
