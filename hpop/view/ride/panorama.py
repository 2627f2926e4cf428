"""Renderer of 360 degree panoramas from any position in a scene: equirectangular, with reproducible bytes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.view.ride import surfaces, tiles
from hpop.view.ride.columns import crossings, draw, longest
from hpop.view.ride.rows import CYLINDER, ELLIPSOID, EXTENT, THING, WALL, ZONE, turned
from hpop.view.ride.scene import ViewScene
from hpop.view.ride.tiles import CameraView, DrawingBuffers, RayMeetings, SurfaceLook, Things

Picture = NDArray[np.uint8]
"""Panorama (H, W, 3), sRGB; row 0 looks up, the middle of a row ahead, its left part to the left."""

FINE = 1 << 16
"""Number of parts of a column to which headings are rounded: 5e-8 rad at a width of 2048."""
STEP = 2.0**-30
"""Step to which sines and cosines are rounded, so that libraries that differ in the last digit give equal bytes."""
RAYS = 2
"""Number of rays that are averaged in each column."""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Renderer of panoramas of a scene, all of one width.

    scene  what is drawn
    width  columns, even; there are half as many rows

    Columns are evenly spaced in bearing and rows in elevation: column c has the bearing (W/2 - c - 1/2) 2 pi / W from
    ahead, counter-clockwise positive, and row r the elevation (H/2 - r - 1/2) pi / H. A camera rotated by a whole
    number of columns gives shifted, otherwise equal bytes.
    """

    scene: ViewScene
    width: int

    def draw(self, position: FloatArray, yaw: float, t: float) -> Picture:
        """Render the panorama of a level camera at a position (3,), m, with a yaw, rad, at a time, s."""
        return self._render(position, yaw, t, per_column=RAYS, hard=False)[0]

    def numbers(self, position: FloatArray, yaw: float, t: float) -> NDArray[np.int32]:
        """Return the number of the thing visible at the middle of each pixel (H, W); 0 for floor and sky.

        Numbers are those of the scene's prisms, cells, figures (people) and plates (landmarks).
        """
        return self._render(position, yaw, t, per_column=1, hard=True)[1]

    def draw_turned(self, position: FloatArray, axes: FloatArray, t: float) -> Picture:
        """Render the panorama of a tilted camera at a position (3,), m, at a time, s.

        Its axes (3, 3) are unit vectors ahead, left and up, in the columns.
        It resamples a level picture of twice the size, so that little sharpness is lost.
        """
        fine = Panorama(self.scene, 2 * self.width)
        fine.__dict__.update(_static_edges=self._static_edges, _pictures=self._pictures)
        level = fine._render(position, 0.0, t, per_column=1, hard=False)[0]
        out = np.empty((self.width // 2, self.width, 3), np.uint8)
        columns = _unit(self.width / 2 - np.arange(self.width) - 0.5, self.width)
        turned(level, columns, _slopes(self.width // 2), np.round(axes / STEP) * STEP, out)
        return out

    def _render(
        self, position: FloatArray, yaw: float, t: float, *, per_column: int, hard: bool
    ) -> tuple[Picture, NDArray[np.int32]]:
        """Render a panorama with ``per_column`` rays in each column.

        Return its colours, and if ``hard`` the number of the thing at the middle of each pixel, else an empty array.
        """
        rays, rows = per_column * self.width, self.width // 2
        x, y, z = (float(value) for value in position)
        whole, part = divmod(round(yaw / (2.0 * math.pi) * self.width * FINE), FINE)
        # Ray k has the bearing (k + offset) 2 pi / rays. The first ray is half a ray from the left end.
        offset = per_column * part / FINE - 0.5
        directions = _unit(np.arange(rays) + offset, rays)
        view = CameraView(
            x,
            y,
            z,
            2.0 * math.pi / self.width,
            directions,
            (per_column * whole + rays // 2) % rays,
            per_column,
            _slopes(rows),
            _sky(rows),
            hard,
            SurfaceLook.of_surfaces(),
        )
        things = self._things(x, y, t)
        met, most = _meetings(things.edges, x, y, directions)
        room = DrawingBuffers.of(rows, len(things.items), most + len(things.parts) + len(things.plates))
        colours = np.empty((rows, self.width, 3), np.uint8)
        numbers = np.zeros((rows, self.width) if hard else (0, 0), np.int32)
        draw(0, self.width, met, things, view, tiles.texture(), room, colours, numbers)
        return colours, numbers

    @cached_property
    def _static_edges(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """Everything that does not move: edges (E, 4), the item to which each belongs, and items (I, 7).

        Items are prisms, boxes of raster cells, the floor and its zones; columns are those of :class:`tiles.Things`.
        """
        edges: list[FloatArray] = []
        counts: list[int] = []
        items: list[tuple[float, ...]] = []

        def add(rings: tuple[FloatArray, ...], item: tuple[float, ...]) -> None:
            around = [np.concatenate([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings]
            edges.extend(around)
            counts.append(sum(map(len, around)))
            items.append(item)

        for prism in self.scene.prisms:
            kind = WALL if prism.is_wall else THING
            add(prism.rings, (kind, prism.low, prism.high, *prism.colour, prism.number))
        if self.scene.cells is not None:
            cells = self.scene.cells
            item = (WALL, cells.low, cells.high, *cells.colour, cells.number)
            for box in cells.corners:
                add((box,), item)
        for rings in self.scene.floor:
            add(rings, (EXTENT, 0.0, 0.0, *surfaces.FLOOR, 0))
        for area in self.scene.areas:
            for rings in area.polygons:
                add(rings, (ZONE, 0.0, 0.0, *area.colour, 0))
        of = np.repeat(np.arange(len(items)), counts)
        return np.concatenate([np.empty((0, 4)), *edges]), of, np.array(items, np.float64).reshape(-1, 7)

    @cached_property
    def _pictures(self) -> tuple[NDArray[np.uint8], IntArray]:
        """Pixels of the pictures on plates of landmarks, and (first index, width, height) of each picture and size."""
        return tiles.plates(self.scene.plates)

    def _things(self, x: float, y: float, t: float) -> Things:
        """Return everything to draw at a time t, s, for the compiled functions.

        Plates of landmarks without a facing are turned towards the camera at (x, y).
        """
        parts: list[tuple[float, ...]] = []
        for figure in self.scene.figures:
            person, now = figure.person.likeliest, np.float64(t)
            if not person.there(now):
                continue
            placed = (*map(float, person.at(now)), math.cos(yaw := float(person.yaw_at(now))), math.sin(yaw))
            for part in figure.parts:
                shape = CYLINDER if part.shape == "cylinder" else ELLIPSOID
                colours = (*part.colour, *part.back)
                parts.append((*placed, shape, part.radius, part.low, part.high, *colours, figure.number, 0.0))
        plates: list[tuple[float, ...]] = []
        for plate in self.scene.plates:
            mark = plate.landmark
            if mark.facing is None:
                away = math.hypot(x - mark.x, y - mark.y) or 1.0
                normal = ((x - mark.x) / away, (y - mark.y) / away)
            else:
                normal = (math.cos(mark.facing), math.sin(mark.facing))
            plates.append((mark.x, mark.y, mark.z, *normal, plate.width, plate.height, plate.number))
        edges, item_of, items = self._static_edges
        bitmaps, places = self._pictures
        tables = _rows_of(parts, 16), _rows_of(plates, 8)
        highest = max(
            items[:, 2].max(initial=0.0),
            tables[0][:, 7].max(initial=0.0),
            (tables[1][:, 2] + tables[1][:, 6]).max(initial=0.0),
        )
        return Things(edges, item_of, items, *tables, bitmaps, places, float(highest))


def _meetings(edges: FloatArray, x: float, y: float, directions: FloatArray) -> tuple[RayMeetings, int]:
    """Find where rays meet edges; return the meetings, and the largest number of meetings of one ray."""
    room, last = 8 * len(directions) + 64, np.empty(len(directions), np.int64)
    while True:
        met = RayMeetings(last, np.empty(room), np.empty(room, np.int64), np.empty(room, np.int64))
        found = crossings(edges, x, y, directions, *met)
        if found <= room:
            break
        room = found
    return met, int(longest(last, met.before))


def _rows_of(rows: list[tuple[float, ...]], columns: int) -> FloatArray:
    """Return a list of rows as an array (N, columns); (0, columns) for an empty list."""
    return np.array(rows, np.float64).reshape(-1, columns)


def _unit(steps: NDArray[np.floating[Any]], count: int) -> FloatArray:
    """Return rounded unit vectors (N, 2) at the angles ``steps`` times 2 pi / ``count``."""
    angles = steps * (2.0 * math.pi / count)
    vectors: FloatArray = np.round(np.stack([np.cos(angles), np.sin(angles)], axis=1) / STEP) * STEP
    return vectors


@cache
def _slopes(rows: int) -> FloatArray:
    """Return the tangent of the elevation angle at the middle of each row (H,), rounded relative to its size."""
    elevations = (rows / 2 - np.arange(rows) - 0.5) * (math.pi / rows)
    mantissa, exponent = np.frexp(np.tan(elevations))
    slopes: FloatArray = np.ldexp(np.round(mantissa / STEP) * STEP, exponent)
    return slopes


@cache
def _sky(rows: int) -> FloatArray:
    """Return the sky's colour (H, 3) in each row, from overhead (row 0) to the horizon; below it the horizon's."""
    up = np.clip((rows / 2 - np.arange(rows) - 0.5) / (rows / 2), 0.0, 1.0)[:, None]
    horizon, zenith = np.array(surfaces.SKY_HORIZON, float), np.array(surfaces.SKY_ZENITH, float)
    sky: FloatArray = horizon + (zenith - horizon) * up * (2.0 - up)
    return sky
