"""What the kernels that draw pictures all round are given: tuples of arrays and numbers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.view.ride import surfaces

Rgb = tuple[float, float, float]


class Tile(NamedTuple):
    """The texture at levels of ever wider pixels.

    values  all levels, one after the other
    starts  (L,)  where each begins
    sizes   (L,)  its side, a power of two
    widths  (L,)  m  of the pixels for which it was made
    period  m  side of the tile
    """

    values: NDArray[np.float32]
    starts: IntArray
    sizes: IntArray
    widths: FloatArray
    period: float


class Things(NamedTuple):
    """All that is drawn.

    edges    (E, 4)  m  x0, y0, x1, y1: round what is solid counter-clockwise
    item_of  (E,)
    items    (I, 7)  kind, low, high, red, green, blue, number
    parts    (P, 16)  of people: x, y, cos and sin of the heading, shape, radius, low, high, colours of front and back,
             number, and 0
    plates   (L, 8)  x, y, z of the middle, normal x, y, width, height, number
    bitmaps  values of all plates' pictures, level by level
    places   (L, B, 3)  of each plate and level: where it begins, its width and height in pixels
    highest  m  of all that stands
    """

    edges: FloatArray
    item_of: IntArray
    items: FloatArray
    parts: FloatArray
    plates: FloatArray
    bitmaps: NDArray[np.uint8]
    places: IntArray
    highest: float


class Met(NamedTuple):
    """What `rays.crossings` tells: the last meeting of each ray; and distance, edge and meeting before, of each."""

    last: IntArray
    distance: FloatArray
    edge: IntArray
    before: IntArray


class Look(NamedTuple):
    """How surfaces look, see `surfaces`: colours (3,), and factors on them."""

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
    def of_surfaces(cls) -> Look:
        """That of all pictures. Kernels are given it: values that they imported would stay in those that are kept."""
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


class View(NamedTuple):
    """From where, and on which picture.

    x, y, z     m
    pixel       rad  from one row or column to the next
    directions  (N, 2)  unit vectors of all rays, counter-clockwise
    shift       the ray that the left end of the picture would be
    per_column  rays of a column
    slopes      (H,)  of the middles of rows, upwards
    sky         (H, 3)
    hard        whether each pixel shows what its middle sees, and nothing else of it
    look
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
    look: Look


class Sheet(NamedTuple):
    """The column that is being drawn.

    summed   (H, 3)  colours so far
    left     (H,)    share of each row of the present ray that is not drawn
    numbers  (H,)    what was drawn there
    """

    summed: FloatArray
    left: FloatArray
    numbers: NDArray[np.int32]


class Room(NamedTuple):
    """Where a column is drawn.

    sheet
    is_in   (I,)  whether the ray is within each item: nowhere, before and after
    opened  (I,)  those within which it is, as many as are told
    order   edges, parts and plates that a ray meets, from near to far
    away    m  how far each is
    """

    sheet: Sheet
    is_in: BoolArray
    opened: IntArray
    order: IntArray
    away: FloatArray

    @classmethod
    def of(cls, rows: int, items: int, meetings: int) -> Room:
        """Room for pictures of so many rows, items, and meetings of a ray."""
        sheet = Sheet(np.empty((rows, 3)), np.empty(rows), np.empty(rows, np.int32))
        opened, order = np.empty(items, np.int64), np.empty(meetings, np.int64)
        return cls(sheet, np.zeros(items, np.bool_), opened, order, np.empty(meetings))
