"""Textures and pictures of surfaces, and the arrays that the compiled functions of panoramas take as arguments."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.text import printable
from hpop.view.ride import surfaces
from hpop.view.ride.scene import Plate
from hpop.view.ride.surfaces import PERIOD, waves

Rgb = tuple[float, float, float]


class Tile(NamedTuple):
    """Surface texture, averaged for pixels of several widths (levels).

    values  all levels, one after the other
    starts  (L,)  first index of each level
    sizes   (L,)  side of each level in pixels, a power of two
    widths  (L,)  m  width of a pixel at each level
    period  m  side of the tile
    """

    values: NDArray[np.float32]
    starts: IntArray
    sizes: IntArray
    widths: FloatArray
    period: float


class Things(NamedTuple):
    """Arrays of all things to draw, for the compiled functions.

    A ``number`` identifies a thing, as in ``Panorama.numbers``. ``kind`` (wall, zone, ...) and ``shape`` (cylinder or
    ellipsoid) are constants of :mod:`hpop.view.ride.rows`. Lengths are in m.

    edges    (E, 4)  m  x0, y0, x1, y1, counter-clockwise round solids
    item_of  (E,)  index of the item to which each edge belongs
    items    (I, 7)  kind, low, high, red, green, blue, number
    parts    (P, 16)  body parts of people: x, y, cos and sin of the heading, shape, radius, low, high, colours of
             front and back, number, and 0
    plates   (L, 8)  x, y, z of the middle, normal x, y, width, height, number
    bitmaps  pixels of all plates' pictures, level by level
    places   (L, B, 3)  first index, width and height in pixels of each plate and level
    highest  m  greatest height of a thing
    """

    edges: FloatArray
    item_of: IntArray
    items: FloatArray
    parts: FloatArray
    plates: FloatArray
    bitmaps: NDArray[np.uint8]
    places: IntArray
    highest: float


class RayMeetings(NamedTuple):
    """Result of `columns.crossings`: the edges that each ray meets, as linked lists.

    last      (N,)  index of the last meeting in the list of each ray, or -1
    distance  (M,)  m, of each meeting
    edge      (M,)  index of the edge met
    before    (M,)  index of the previous meeting in the list of that ray, or -1
    """

    last: IntArray
    distance: FloatArray
    edge: IntArray
    before: IntArray


class SurfaceLook(NamedTuple):
    """Appearance of surfaces for the compiled functions; the constants are those of `surfaces`.

    Colours are (3,). ``pitch``, ``line`` and ``skirting`` are lengths and ``haze`` is a distance, m; ``light`` is a
    unit vector; the others are factors on colours.
    """

    floor: Rgb
    outside: Rgb
    zone_share: float
    floor_contrast: float
    outside_contrast: float
    wall_contrast: float
    floor_grid: float
    wall_grid: float
    pitch: float
    line: float
    skirting: float
    skirting_shade: float
    light: Rgb
    ambient: float
    diffuse: float
    haze: float
    haze_colour: Rgb

    @classmethod
    def of_surfaces(cls) -> SurfaceLook:
        """Return the constants of `surfaces` as an argument, because cached compiled functions keep old constants."""
        contrast, grid = surfaces.CONTRAST, surfaces.GRID
        return cls(
            floor=_rgb(surfaces.FLOOR),
            outside=_rgb(surfaces.OUTSIDE),
            zone_share=surfaces.ZONE_SHARE,
            floor_contrast=contrast["floor"],
            outside_contrast=contrast["outside"],
            wall_contrast=contrast["wall"],
            floor_grid=grid["floor"],
            wall_grid=grid["wall"],
            pitch=surfaces.PITCH,
            line=surfaces.LINE,
            skirting=surfaces.SKIRTING,
            skirting_shade=surfaces.SKIRTING_SHADE,
            light=surfaces.LIGHT,
            ambient=surfaces.AMBIENT,
            diffuse=surfaces.DIFFUSE,
            haze=surfaces.HAZE,
            haze_colour=_rgb(surfaces.SKY_HORIZON),
        )


def _rgb(colour: surfaces.Colour) -> Rgb:
    red, green, blue = colour
    return float(red), float(green), float(blue)


class CameraView(NamedTuple):
    """Camera of a panorama, with the geometry of the picture.

    x, y, z     m
    pixel       rad  from one row or column to the next
    directions  (N, 2)  unit vectors of all rays, counter-clockwise
    shift       index of the ray at the left end of the picture
    per_column  number of rays in a column
    slopes      (H,)  tangents of the elevations of the rows' middles
    sky         (H, 3)  colour of the sky in each row
    hard        whether each pixel shows only the thing at its middle
    look        appearance of surfaces
    """

    x: float
    y: float
    z: float
    pixel: float
    directions: FloatArray
    shift: int
    per_column: int
    slopes: FloatArray
    sky: FloatArray
    hard: bool
    look: SurfaceLook


class ColumnBuffer(NamedTuple):
    """Column of a panorama while it is drawn.

    summed   (H, 3)  colours so far
    left     (H,)    share of each row of the present ray that is not yet drawn
    numbers  (H,)    number of the thing drawn there
    """

    summed: FloatArray
    left: FloatArray
    numbers: NDArray[np.int32]


class DrawingBuffers(NamedTuple):
    """Working arrays for drawing a column.

    sheet   the column
    is_in   (I,)  whether the ray is inside each item; all False before and after a column
    opened  (I,)  items that contain the ray, in the first entries
    order   edges, body parts and plates that a ray meets, from near to far
    away    m  distance of each
    """

    sheet: ColumnBuffer
    is_in: BoolArray
    opened: IntArray
    order: IntArray
    away: FloatArray

    @classmethod
    def of(cls, rows: int, items: int, meetings: int) -> DrawingBuffers:
        """Allocate arrays for a number of rows, of items, and of meetings of one ray."""
        sheet = ColumnBuffer(np.empty((rows, 3)), np.empty(rows), np.empty(rows, np.int32))
        opened, order = np.empty(items, np.int64), np.empty(meetings, np.int64)
        return cls(sheet, np.zeros(items, np.bool_), opened, order, np.empty(meetings))


FINEST = 512
"""Pixels along a side of the finest level."""
WIDEST = 4.0
"""Width of the widest pixels, m, which average the texture away."""
PER_OCTAVE = 2
"""Levels per doubling of the pixels' width."""
STEP = 2.0**-20
"""Step to which values of the texture are rounded, so that bytes do not depend on the last digit of cosines."""
PLATE_PIXELS = (384, 240)
"""Width and height of the largest picture of a plate."""
LINES = 4
"""Most lines of a name."""
INK, FRAME, GOLD = (46, 44, 40), (92, 78, 62), (168, 134, 72)


@cache
def texture() -> Tile:
    """Return the surface texture, averaged for each level of pixel width.

    A pixel averages with a normal weight of standard deviation half its width w, which damps a wave of frequency f by
    exp(-(pi f w)² / 2).
    """
    i, j, amplitude, phase = waves().T
    widths, levels = [], []
    width = PERIOD / FINEST
    while width <= WIDEST:
        size = 1 << max(3, math.ceil(math.log2(PERIOD / width) - 1e-9))
        kept = amplitude * np.exp(-0.5 * (math.pi * np.hypot(i, j) / PERIOD * width) ** 2)
        turns = 2.0 * math.pi * np.arange(size) / size
        across, along = i[:, None] * turns + phase[:, None], j[:, None] * turns
        # cos(a + b) as products: of each wave a row and a column
        level = (kept[:, None] * np.cos(along)).T @ np.cos(across) - (kept[:, None] * np.sin(along)).T @ np.sin(across)
        widths.append(width)
        levels.append(np.round(level / STEP) * STEP)
        width *= 2.0 ** (1.0 / PER_OCTAVE)
    sizes = np.array([len(level) for level in levels], np.int64)
    starts = np.concatenate([[0], np.cumsum(sizes**2)[:-1]])
    values = np.concatenate([level.ravel() for level in levels]).astype(np.float32)
    return Tile(values, starts, sizes, np.array(widths), PERIOD)


def plates(drawn: tuple[Plate, ...]) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return the pictures on plates, each at successively halved sizes.

    Returned are all pixels in one array, and the first index, width and height of each picture and size.
    """
    values, places, start = [np.zeros(0, np.uint8)], [], 0
    for plate in drawn:
        picture, levels = _picture(plate), []
        while min(picture.size) >= 4:
            pixels = np.asarray(picture, np.uint8)
            values.append(pixels.ravel())
            levels.append((start, picture.width, picture.height))
            start += pixels.size
            picture = picture.resize((picture.width // 2, picture.height // 2), Image.Resampling.BOX)
        places.append(levels)
    return np.concatenate(values), np.array(places, np.int64).reshape(len(drawn), -1 if places else 0, 3)


def _picture(plate: Plate) -> Image.Image:
    """Draw the picture on a landmark's plate: its name; without a name a painting, or a star if it has no facing."""
    image = Image.new("RGB", PLATE_PIXELS, plate.colour)
    pen = ImageDraw.Draw(image)
    width, height = PLATE_PIXELS
    if plate.landmark.name.strip():
        pen.rectangle((0, 0, width - 1, height - 1), outline=FRAME, width=10)
        _write(pen, printable(plate.landmark.name))
    elif plate.landmark.facing is None:
        pen.rectangle((0, 0, width - 1, height - 1), outline=FRAME, width=10)
        angles = math.pi * (0.2 * np.arange(10) + 0.5)
        reach = np.where(np.arange(10) % 2, 0.4, 1.0) * 0.36 * height
        corners = np.stack([width / 2 + reach * np.cos(angles), height / 2 - reach * np.sin(angles)], axis=1)
        pen.polygon([tuple(corner) for corner in corners.tolist()], fill=(236, 178, 32), outline=INK)
    else:
        _paint(pen, plate.number)
    return image


def _write(pen: ImageDraw.ImageDraw, text: str) -> None:
    """Write a name on a plate as large as possible, in at most `LINES` lines."""
    width, height = PLATE_PIXELS
    font_file = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"
    for size in range(80, 14, -4):
        font = ImageFont.truetype(str(font_file), size, layout_engine=ImageFont.Layout.BASIC)
        lines = wrap(text, max(int(1.5 * width / size), 4), break_long_words=size < 32)
        boxes = [pen.textbbox((0, 0), line, font=font) for line in lines]
        if len(lines) <= LINES and len(lines) * 1.25 * size <= height - 44 and max(b[2] for b in boxes) <= width - 48:
            break
    lines = lines[:LINES]
    top = (height - 1.25 * size * (len(lines) - 1)) / 2
    for k, line in enumerate(lines):
        pen.text((width / 2, top + 1.25 * size * k), line, font=font, fill=INK, anchor="mm")


def _paint(pen: ImageDraw.ImageDraw, number: int) -> None:
    """Paint a landscape on a plate: sky, sun, and two ranges of hills, in colours that depend on the number."""
    width, height = PLATE_PIXELS
    turn = number * 0.618034 % 1.0
    skies = ((196, 216, 232), (240, 214, 176), (206, 222, 204), (226, 206, 220))
    near = ((96, 122, 92), (112, 96, 120), (70, 104, 124), (140, 104, 76))
    kind = number % 4
    pen.rectangle((0, 0, width, height), fill=skies[kind])
    x, y = width * (0.25 + 0.5 * turn), height * 0.36
    pen.ellipse((x - 26, y - 26, x + 26, y + 26), fill=(250, 240, 206))
    for depth, lift in ((0, 0.42), (1, 0.66)):
        colour = tuple((near[kind][c] * (1 + depth) + skies[kind][c] * (1 - depth)) // 2 for c in range(3))
        across = np.arange(0, width + 8, 8)
        ridge = height * (lift + 0.10 * np.sin(across / 47.0 + 6.3 * turn + 2 * depth) + 0.05 * np.sin(across / 19.0))
        pen.polygon([(0, height), *zip(across.tolist(), ridge.tolist(), strict=True), (width, height)], fill=colour)
    pen.rectangle((0, 0, width - 1, height - 1), outline=GOLD, width=22)
    pen.rectangle((21, 21, width - 22, height - 22), outline=FRAME, width=3)
