"""Compiled functions that draw into one column of a panorama whatever a ray meets: floors, walls, people, plates.

This module and `columns` use only sums, products, quotients and square roots, which all machines round equally. The
only exception is the search for candidate rays, which does not affect results.

Vertical positions in the picture count in rows from its top. (dx, dy) is the unit vector of a ray, and t, m, a distance
along it. Arguments are described in `tiles`: ``view`` (`CameraView`), ``sheet`` (`ColumnBuffer`, which the functions
change), ``look`` (`SurfaceLook`), ``tile`` (`Tile`), ``things`` (`Things`); ``item``, ``edge`` and ``part`` are each a
row of an array of `Things`.
"""

from __future__ import annotations

import math

from hpop.runtime.compiled import lean

# mypy: disable-error-code="no-untyped-def"


PI = math.pi
NEAR, FAR = 1e-3, 1e6
"""Distances from the camera, m: the nearest that is drawn, and one that counts as infinite."""
WALL, THING, EXTENT, ZONE = 0, 1, 2, 3
"""Kinds of items: walls, other obstacles, the floor, and zones on the floor."""
CYLINDER, ELLIPSOID = 0, 1
"""Shapes of body parts of people."""
LEAST_LEFT = 1e-4
"""Uncovered share of a row below which the row counts as complete."""
FLATTEST = 1e-9
"""Sine of the angle between a ray and a plate below which the plate is seen edge-on and not drawn."""
STRETCHED = 3.0
"""Largest ratio of a pixel's length to the width for which the texture is smoothed."""


@lean
def arctangent(x):
    """Return the arctangent within 1e-9, computed from products and quotients only, for reproducible results."""
    away = abs(x)
    turned = 0.0
    if away > 2.414213562373095:
        turned, away = 0.5 * PI, -1.0 / away
    elif away > 0.4142135623730951:
        turned, away = 0.25 * PI, (away - 1.0) / (away + 1.0)
    q = away * away
    series = 1 / 13 - q * (1 / 15 - q * (1 / 17 - q * (1 / 19 - q / 21)))
    series = 1 / 3 - q * (1 / 5 - q * (1 / 7 - q * (1 / 9 - q * (1 / 11 - q * series))))
    found = turned + away * (1.0 - q * series)
    return found if x >= 0.0 else -found


@lean
def row_of(slope, view):
    """Return the vertical position in the picture of a line of sight whose elevation has the tangent ``slope``."""
    return 0.5 * len(view.slopes) - arctangent(slope) / view.pixel


@lean
def _lines(x, width, look):
    """Return the share of an interval of length ``width`` round x that is covered by lines of the surface grid."""
    line, pitch = look.line, look.pitch
    low, high = (x + 0.5 * (line - width)) / pitch, (x + 0.5 * (line + width)) / pitch
    whole_low, whole_high = math.floor(low), math.floor(high)
    on_low = whole_low * line + min((low - whole_low) * pitch, line)
    on_high = whole_high * line + min((high - whole_high) * pitch, line)
    return min(max((on_high - on_low) / width, 0.0), 1.0)


@lean
def _texture(u, v, width, tile):
    """Return the surface texture at (u, v), m, averaged over pixels that are ``width`` m wide; bilinear."""
    level = 0
    while level < len(tile.widths) - 1 and tile.widths[level] < width:
        level += 1
    size = tile.sizes[level]
    start, mask, scale = tile.starts[level], size - 1, size / tile.period
    x, y = u * scale, v * scale
    i, j = math.floor(x), math.floor(y)
    x, y = x - i, y - j
    left, low = int(i) & mask, int(j) & mask
    right, high = (left + 1) & mask, start + ((low + 1) & mask) * size
    low = start + low * size
    values = tile.values
    below = values[low + left] + x * (values[low + right] - values[low + left])
    above = values[high + left] + x * (values[high + right] - values[high + left])
    return below + y * (above - below)


@lean
def _take(row, top, bottom, number, sheet, view):
    """Mark a row as covered between two vertical positions, and return the share of the row that this newly covers.

    If ``view.hard``, the share is 1 or 0: whether the row's middle lies between them and was uncovered.
    """
    left = sheet.left[row]
    if view.hard:
        share = 1.0 if left > 0.0 and top <= row + 0.5 < bottom else 0.0
    else:
        share = min(min(bottom, row + 1.0) - max(top, float(row)), left)
    if share <= 0.0:
        return 0.0
    sheet.left[row] = left - share
    sheet.numbers[row] = number
    return share


@lean
def _add(row, share, red, green, blue, t, sheet, look):
    """Add ``share`` times a colour, mixed with the haze for a distance t, to a row."""
    haze = t / (t + look.haze)
    sheet.summed[row, 0] += share * (red + haze * (look.haze_colour[0] - red))
    sheet.summed[row, 1] += share * (green + haze * (look.haze_colour[1] - green))
    sheet.summed[row, 2] += share * (blue + haze * (look.haze_colour[2] - blue))


@lean
def _rows(top, bottom, view):
    """Return the first row that the interval from ``top`` to ``bottom`` touches, and the row after the last."""
    return max(math.floor(top), 0), min(math.ceil(bottom), len(view.slopes))


@lean
def draw_plane(rise, t0, t1, red, green, blue, number, grid, contrast, dx, dy, sheet, view, tile):
    """Draw the part of a horizontal surface, ``rise`` m above the camera, between the distances t0 and t1.

    number    of the thing, for ``sheet.numbers``
    grid      share by which the lines of the surface grid are darker; 0 for none
    contrast  of the texture; 0 for none
    """
    top, bottom = row_of(rise / t1, view), row_of(rise / t0, view)
    if rise > 0.0:
        top, bottom = bottom, top
    first, beyond = _rows(top, bottom, view)
    for row in range(first, beyond):
        if sheet.left[row] <= 0.0:
            continue
        share = _take(row, top, bottom, number, sheet, view)
        if share <= 0.0 or view.hard:
            continue
        slope = view.slopes[row]
        t = min(max(rise / slope, t0), t1) if slope * rise > 0.0 else t1
        square = t * t + rise * rise
        long, wide = square / abs(rise) * view.pixel, math.sqrt(square) * view.pixel
        x, y = view.x + t * dx, view.y + t * dy
        factor = 1.0
        if contrast > 0.0:
            width = max(math.sqrt(long * wide), long / STRETCHED)
            factor = 1.0 + contrast * _texture(x, y, width, tile)
        if grid > 0.0:
            on_x = _lines(x, long * abs(dx) + wide * abs(dy), view.look)
            on_y = _lines(y, long * abs(dy) + wide * abs(dx), view.look)
            factor *= 1.0 - grid * (on_x + on_y - on_x * on_y)
        _add(row, share, red * factor, green * factor, blue * factor, t, sheet, view.look)


@lean
def draw_front(t, item, edge, dx, dy, sheet, view, tile):
    """Draw the vertical face of an upright prism at one of its edges."""
    look = view.look
    low, high = item[1] - view.z, item[2] - view.z
    top, bottom = row_of(high / t, view), row_of(low / t, view)
    first, beyond = _rows(top, bottom, view)
    along_x, along_y = edge[2] - edge[0], edge[3] - edge[1]
    length = math.sqrt(along_x * along_x + along_y * along_y)
    along_x, along_y = along_x / length, along_y / length
    against = abs(dx * along_y - dy * along_x)
    shade = min(look.ambient + look.diffuse * (along_y * look.light[0] - along_x * look.light[1]), 1.0)
    u = (view.x + t * dx) * along_x + (view.y + t * dy) * along_y
    wide = t * view.pixel / max(against, 1e-3)
    upright = _lines(u, wide, look)
    has_skirting = item[0] == WALL and item[1] <= 0.0
    for row in range(first, beyond):
        if sheet.left[row] <= 0.0:
            continue
        share = _take(row, top, bottom, item[6], sheet, view)
        if share <= 0.0 or view.hard:
            continue
        slope = view.slopes[row]
        long = t * (1.0 + slope * slope) * view.pixel
        v = min(max(view.z + t * slope, item[1]), item[2])
        width = max(math.sqrt(long * wide), max(long, wide) / STRETCHED)
        level = _lines(v, long, look)
        factor = shade * (1.0 + look.wall_contrast * _texture(u, v, width, tile))
        factor *= 1.0 - look.wall_grid * (upright + level - upright * level)
        if has_skirting:
            on_it = min(max((look.skirting - v) / long + 0.5, 0.0), 1.0)
            factor *= 1.0 - on_it * (1.0 - look.skirting_shade)
        _add(row, share, item[3] * factor, item[4] * factor, item[5] * factor, t, sheet, view.look)


@lean
def draw_part(t, part, dx, dy, sheet, view):
    """Draw the slice of a person's body part that a ray meets."""
    look = view.look
    x, y = part[0] - view.x, part[1] - view.y
    along, aside, radius = dx * x + dy * y, dx * y - dy * x, part[5]
    depth = math.sqrt(max(radius * radius - aside * aside, 0.0))
    middle, half = 0.5 * (part[6] + part[7]) - view.z, 0.5 * (part[7] - part[6])
    if part[4] == CYLINDER:
        top, bottom = row_of((part[7] - view.z) / t, view), row_of((part[6] - view.z) / t, view)
        tall = 0.0
    else:
        tall = half * depth / radius  # half height of the slice, an ellipse
        stretch = depth / tall
        raised = middle * stretch
        reach = depth * math.sqrt(max(along * along + raised * raised - depth * depth, 0.0))
        over = along * along - depth * depth
        top = row_of((along * raised + reach) / over / stretch, view)
        bottom = row_of((along * raised - reach) / over / stretch, view)
    first, beyond = _rows(top, bottom, view)
    for row in range(first, beyond):
        if sheet.left[row] <= 0.0:
            continue
        share = _take(row, top, bottom, part[14], sheet, view)
        if share <= 0.0 or view.hard:
            continue
        slope, hit, up = view.slopes[row], t, 0.0
        if tall > 0.0:
            a = 1.0 / (depth * depth) + slope * slope / (tall * tall)
            b = along / (depth * depth) + slope * middle / (tall * tall)
            c = along * along / (depth * depth) + middle * middle / (tall * tall) - 1.0
            hit = (b - math.sqrt(max(b * b - a * c, 0.0))) / a
            up = (slope * hit - middle) / (half * half)
        nx, ny = (hit * dx - x) / (radius * radius), (hit * dy - y) / (radius * radius)
        length = math.sqrt(nx * nx + ny * ny + up * up)
        towards = (nx * look.light[0] + ny * look.light[1] + up * look.light[2]) / length
        shade = min(look.ambient + 1.6 * look.diffuse * towards, 1.1)
        colour = 8 if nx * part[2] + ny * part[3] > 0.0 else 11
        _add(row, share, part[colour] * shade, part[colour + 1] * shade, part[colour + 2] * shade, t, sheet, view.look)


@lean
def draw_plate(t, p, dx, dy, sheet, view, things):
    """Draw the slice of a landmark's plate that a ray meets: of its picture, or of its back."""
    look = view.look
    plate, places = things.plates[p], things.places
    low = plate[2] - 0.5 * plate[6] - view.z
    top, bottom = row_of((low + plate[6]) / t, view), row_of(low / t, view)
    first, beyond = _rows(top, bottom, view)
    across = (view.x + t * dx - plate[0]) * -plate[4] + (view.y + t * dy - plate[1]) * plate[3]
    is_front = dx * plate[3] + dy * plate[4] < 0.0
    level = 0
    while level < places.shape[1] - 1 and places[p, level + 1, 2] * t * view.pixel > plate[6]:
        level += 1
    start, columns, rows = places[p, level, 0], places[p, level, 1], places[p, level, 2]
    x = min(max((across / plate[5] + 0.5) * columns - 0.5, 0.0), columns - 1.001)
    left = int(x)
    x -= left
    shade = min(look.ambient + look.diffuse * (plate[3] * look.light[0] + plate[4] * look.light[1]), 1.0)
    for row in range(first, beyond):
        if sheet.left[row] <= 0.0:
            continue
        share = _take(row, top, bottom, plate[7], sheet, view)
        if share <= 0.0 or view.hard:
            continue
        if not is_front:
            _add(row, share, 150.0 * shade, 140.0 * shade, 126.0 * shade, t, sheet, view.look)
            continue
        y = min(max((1.0 - (t * view.slopes[row] - low) / plate[6]) * rows - 0.5, 0.0), rows - 1.001)
        under = int(y)
        y -= under
        at = start + 3 * (under * columns + left)
        for channel in range(3):
            a = things.bitmaps[at + channel] * (1.0 - x) + things.bitmaps[at + 3 + channel] * x
            b = things.bitmaps[at + 3 * columns + channel] * (1.0 - x)
            b += things.bitmaps[at + 3 * columns + 3 + channel] * x
            sheet.summed[row, channel] += share * shade * (a + y * (b - a))


@lean
def _angle(x, y):
    """Return the angle of a vector, rad, as `math.atan2` does."""
    if abs(y) > abs(x):
        return math.copysign(0.5 * PI, y) - arctangent(x / y)
    if x == 0.0:
        return 0.0
    found = arctangent(y / x)
    if x > 0.0:
        return found
    return found + math.copysign(PI, y)


@lean
def turned(level, columns, slopes, axes, out):
    """Fill ``out`` (H, W, 3) with the view of a tilted camera, resampled from a level picture that looks along x.

    axes     (3, 3)  of the tilted camera: unit vectors ahead, left and up, in the columns
    columns  (W, 2)  cos and sin of the bearing of each column from ahead
    slopes   (H,)    tangents of the elevations of the rows

    Each pixel is interpolated bilinearly, and rounded to whole numbers, halves up.
    """
    rows, width = len(level), len(level[0])
    for row in range(len(slopes)):
        across = 1.0 / math.sqrt(1.0 + slopes[row] * slopes[row])
        rise = slopes[row] * across
        for column in range(len(columns)):
            a, b = across * columns[column, 0], across * columns[column, 1]
            x = a * axes[0, 0] + b * axes[0, 1] + rise * axes[0, 2]
            y = a * axes[1, 0] + b * axes[1, 1] + rise * axes[1, 2]
            z = a * axes[2, 0] + b * axes[2, 1] + rise * axes[2, 2]
            u = (0.5 - _angle(x, y) / (2.0 * PI)) * width - 0.5
            v = (0.5 - _angle(math.sqrt(x * x + y * y), z) / PI) * rows - 0.5
            v = min(max(v, 0.0), rows - 1.001)
            left, under = math.floor(u), int(v)
            u, v = u - left, v - under
            left %= width
            right = (left + 1) % width
            for channel in range(3):
                above = level[under, left, channel] * (1.0 - u) + level[under, right, channel] * u
                below = level[under + 1, left, channel] * (1.0 - u) + level[under + 1, right, channel] * u
                out[row, column, channel] = math.floor(above + v * (below - above) + 0.5)
