"""Readers for pictures and grids of cells: blueprints, in which dark pixels are obstacles, and maps of MovingAI.

Images are decoded a block of rows at a time. Decoded pixels take several bytes each, so a large image is never decoded
as a whole. The MovingAI benchmark is that of Sturtevant 2012 (movingai.com).
"""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.base.options import real
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import file_source, named, read_bytes, read_text
from hpop.world.geometry.shapes import (
    MAX_CELLS,
    Raster,
    check_heights,
    check_inside,
    check_pose,
    check_positive,
    check_size,
    check_span,
)
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.readers import blueprint
from hpop.world.world import World

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

FORMATS = ("PPM", "PNG", "BMP", "GIF", "JPEG")
"""Pillow names of the formats that are read; PPM includes PGM."""
ORIENTATION = 0x0112
"""EXIF tag of the orientation of an image."""
DEEP = ("I", "I;16", "I;16B", "F")
"""Pillow modes with more than 8 bits per pixel."""
BLOCK = 1_000_000
"""Pixels that are processed together."""
DECODED, SHADES = 8, 80
"""Memory per pixel while an image is read, bytes: for the image and its cells, and for pixels processed together."""


@dataclass(frozen=True, eq=False)
class DecodedImage:
    """Image that can be read block by block, row 0 at the top.

    height, width  pixels
    is_turned      whether it was rotated or mirrored by its EXIF orientation
    """

    height: int
    width: int
    _image: Any
    _path: str | Path
    is_turned: bool = False

    def blocks(self) -> Iterator[tuple[slice, FloatArray, FloatArray | None]]:
        """Yield about a million pixels at a time: rows (from the top), brightness (h, W, channels) and opacity (h, W).

        Brightness and opacity are from 0 to 1. Grey images have one channel, coloured images three. The opacity is None
        for an image without transparency.
        """
        step = max(1, BLOCK // self.width)
        for top in range(0, self.height, step):
            limits.check(READING)
            rows = slice(top, min(top + step, self.height))
            pixels, alpha = self._pixels(rows)
            yield rows, shades(pixels), None if alpha is None else shades(alpha)

    def _pixels(self, rows: slice) -> tuple[Pixels, Pixels | None]:
        image = self._image
        try:
            part = image.crop((0, rows.start, self.width, rows.stop))
            if image.mode in DEEP:
                return np.clip(np.asarray(part), 0, 65535).astype(np.uint16)[..., None], None
            alpha = image.has_transparency_data
            mode = ("L" if image.mode in ("1", "L", "LA") else "RGB") + ("A" if alpha else "")
            pixels = np.asarray(part.convert(mode))
        except Exception as error:  # each decoder fails in its own way
            raise _unreadable(image, self._path, error) from None
        pixels = pixels.reshape(rows.stop - rows.start, self.width, -1)
        return (pixels[..., :-1], pixels[..., -1]) if alpha else (pixels, None)


def read_image(data: bytes, path: str | Path, *, upright: bool = False) -> DecodedImage:
    """Open an image whose pixels are decoded block by block, after checking its size; MapError if it is no image.

    White is the largest value of 8 or 16 bits. One byte per pixel counts towards the memory limit from now on.
    ``upright`` applies the EXIF orientation, as image viewers do; map_server does not.
    """
    from PIL import Image, ImageOps, UnidentifiedImageError  # slow to import

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data), formats=FORMATS)
    except Image.DecompressionBombError:
        raise MapError(
            f"image {named(path)} is too large: at most {MAX_CELLS:,} cells are read. Crop it or lower its resolution."
        ) from None
    except UnidentifiedImageError:
        raise MapError(
            f"image {named(path)} is no image that can be read; expected PGM (P2, P5), PNG, BMP, GIF or JPEG."
        ) from None
    except Exception as error:  # each decoder fails in its own way
        raise MapError(f"image {named(path)} cannot be read ({error}); check that the file is intact.") from None
    width, height = image.size
    check_size(height, width, f"image {named(path)}")
    pixels = height * width
    limits.hold(READING, pixels, DECODED * pixels + SHADES * min(pixels, BLOCK))
    if not upright or _orientation(image) == 1:
        return DecodedImage(height, width, image, path)
    try:
        ImageOps.exif_transpose(image, in_place=True)
    except Exception as error:  # each decoder fails in its own way
        raise _unreadable(image, path, error) from None
    width, height = image.size
    return DecodedImage(height, width, image, path, is_turned=True)


def _orientation(image: Any) -> int:
    """Return the EXIF orientation of an image, from 1 to 8; 1 if it is unknown."""
    try:
        orientation = image.getexif().get(ORIENTATION, 1)
    except Exception:  # EXIF data may be broken in any way
        return 1
    return orientation if orientation in range(2, 9) else 1


def _unreadable(image: Any, path: str | Path, error: Exception) -> MapError:
    width, height = image.size
    return MapError(
        f"image {named(path)} is {width} x {height} by its header, but its pixels cannot be read ({error}). Check that "
        "the file is complete."
    )


def shades(pixels: Pixels) -> FloatArray:
    """Convert pixel values of 8 or 16 bits to brightness from 0 (black) to 1 (white, the largest value)."""
    return np.asarray(pixels / float(np.iinfo(pixels.dtype).max))


def read(
    path: str | Path,
    resolution: float,
    *,
    threshold: float = 0.5,
    smallest_obstacle: float | None = None,
    inside: tuple[float, float] | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    height: Heights | None = None,
    outside_is_obstacle: bool = True,
    thinnest_obstacle: float | None = None,
    contrast: bool = False,
) -> World:
    """Read a blueprint as a `World` of cells: pixels darker than the threshold are obstacles.

    Parameters
    ----------
    path : path of the image (PNG, PGM, JPEG, ...)
    resolution : float
        Side of a pixel, m.
    threshold : float
        Brightness, from 0 (black) to 1 (white), below which a pixel is an obstacle; colours are averaged,
        transparent pixels lie on white paper.
    smallest_obstacle : float, optional
        Connected dark pixels with less area, m², are no obstacle, such as lettering or specks of a scan.
    inside : (x, y), optional
        A point in the free space, m. Areas that cannot be reached from there become solid, such as the inside of walls
        drawn as two lines, and everything outside the building.
    origin : (x, y, yaw)
        World pose of the image's lower-left corner, m and rad.
    height : (z_min, z_max), optional
        Heights of all obstacles, m; unlimited by default.
    outside_is_obstacle : bool
        Whether the area beyond the image obstructs the camera.
    thinnest_obstacle : float, optional
        Thinner lines, m, are no obstacle, such as the swings of doors between thicker walls.
    contrast : bool
        Whether the colour of an obstacle sets its contrast, a weight in ``optic_flow``: that of Michelson against
        white paper, (1 - Y) / (1 + Y), where Y is the relative luminance of the colour (sRGB). Black is 1. The darkest
        obstacle pixel within two pixels counts, because edges are blurred.

    A photograph is rotated by its EXIF orientation, which ``world.notes`` mention. The notes also report grey pixels,
    grey areas that count as free, specks that look like lettering, and thin lines that close passages, each with the
    option that changes it. Finally they state the areas that these options removed or closed.

    Raises
    ------
    MapError
        If the image is missing, broken or too large, or an option makes no sense.
    """
    threshold = real("threshold", threshold, 0, 1, "a brightness", error=MapError)
    resolution = check_positive("resolution", resolution)
    origin = check_pose(origin)
    heights = WHOLE if height is None else check_heights(height)
    if smallest_obstacle is not None:
        smallest_obstacle = check_positive("smallest_obstacle", smallest_obstacle)
    if thinnest_obstacle is not None:
        thinnest_obstacle = check_positive("thinnest_obstacle", thinnest_obstacle)
    inside = check_inside(inside)
    content = read_bytes(path, "image")
    picture = read_image(content, path, upright=True)
    check_span(picture.height, picture.width, resolution, path)
    dark = np.empty((picture.height, picture.width), dtype=bool)
    shade = np.empty(dark.shape, dtype=np.uint8)
    faint = np.empty(dark.shape if contrast else (0, 0), dtype=np.uint8)
    for rows, colours, alpha in picture.blocks():
        brightness = colours.mean(axis=-1)
        if alpha is not None:
            brightness = brightness * alpha + (1.0 - alpha)
        dark[rows] = brightness < threshold
        shade[rows] = np.round(255 * brightness)
        if contrast:
            faint[rows] = np.round(100 * blueprint.contrast(colours, alpha))
    options = {
        "resolution": resolution,
        "threshold": float(threshold),
        "smallest_obstacle": smallest_obstacle,
        "inside": None if inside is None else list(inside),
        "origin": list(origin),
        "height": None if height is None else [v if math.isfinite(v) else None for v in heights],
        "outside_is_obstacle": bool(outside_is_obstacle),
        "thinnest_obstacle": thinnest_obstacle,
        **({"contrast": True} if contrast else {}),
    }
    raster = Raster(dark[::-1], resolution, origin, *heights)
    del dark
    notes = ["it is turned as its EXIF orientation says"] if picture.is_turned else []
    if not raster.cells.any():
        notes.append(f"no pixel is darker than the threshold {threshold:g}, so there are no obstacles")
    notes += blueprint.greys(shade[::-1], raster.cells, float(threshold), raster)
    if thinnest_obstacle is not None:
        cells, note = blueprint.without_lines(raster, thinnest_obstacle)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    if smallest_obstacle is not None:
        cells, note = blueprint.without_specks(raster, smallest_obstacle)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    notes += blueprint.lettering(raster)
    if thinnest_obstacle is None:
        notes += blueprint.closing(raster)
    drawn = raster.cells
    if inside is not None:
        cells, note = blueprint.closed_from(raster, inside)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    if contrast:
        contrasts, note = blueprint.contrasts_of(raster.cells, drawn, faint[::-1])
        raster, notes = replace(raster, contrasts=contrasts), [*notes, note]
    ground = Ground(raster=raster, outside_is_obstacle=bool(outside_is_obstacle))
    said = tuple(f"{path}: {note}." for note in notes)
    return World(ground, notes=said).read_from(file_source("image", path, options, content))


PASSABLE = ".GS"
TERRAIN = ".GS@OTW"
LINES = 4
"""Bytes per cell while a map is read, in addition to the cells: the file, its text and its lines."""


def read_movingai(path: str | Path, *, resolution: float = 1.0) -> World:
    """Read a ``.map`` file of type octile as a `World` of cells; only ``.``, ``G`` and ``S`` are passable.

    The first row of the file is the top one: the centre of the cell in column ``col`` and row ``row`` of the
    file is at ``((col + .5) resolution, (height - 1 - row + .5) resolution)``. ``resolution`` is in metres.

    Raises
    ------
    MapError
        If the file is missing, its header is no header of an octile map, or its rows do not fit the header.
    """
    content = read_bytes(path, "map file")
    limits.hold(READING, len(content), LINES * len(content))
    lines = read_text(content, path, "map file").splitlines()
    header = [line.split() for line in lines[:4]]
    names = [words[0].lower() if words else "" for words in header]
    if names != ["type", "height", "width", "map"] or header[0][1:] != ["octile"]:
        raise MapError(
            f"{path} must begin with the lines 'type octile', 'height H', 'width W', 'map'; got {shown(lines[:4])}."
        )
    height, width = (_count(path, words) for words in header[1:3])
    check_size(height, width, f"map {str(path)!r}")
    rows = lines[4:]
    while rows and not rows[-1].strip():
        rows.pop()
    lengths = {len(row) for row in rows}
    if len(rows) != height or lengths != {width}:
        raise MapError(
            f"{path} must have {height} rows of {width} cells, as its header says; got {len(rows)} rows of "
            f"{sorted(lengths)[:5]} cells. Check that the file is complete."
        )
    occupied = np.empty((height, width), dtype=bool)
    step = max(1, BLOCK // width)
    for top in range(0, height, step):
        limits.check(READING)
        text = "".join(rows[top : top + step])
        if unknown := set(text) - set(TERRAIN):
            raise MapError(f"{path}: each cell must be one of the characters {TERRAIN}; got {min(unknown)!r}.")
        cells = np.frombuffer(text.encode("ascii"), dtype=np.uint8).reshape(-1, width)
        occupied[top : top + step] = ~np.isin(cells, [ord(letter) for letter in PASSABLE])
    resolution = check_positive("resolution", resolution)
    check_span(height, width, resolution, path)
    return World(Ground(raster=Raster(occupied[::-1], resolution), outside_is_obstacle=True)).read_from(
        file_source("movingai", path, {"resolution": resolution}, content)
    )


def _count(path: str | Path, words: list[str]) -> int:
    if len(words) != 2 or not (words[1].isascii() and words[1].isdigit() and len(words[1]) < 10):
        raise MapError(f"{path}: {words[0]} must be followed by one whole number; got {shown(' '.join(words))}.")
    return int(words[1])
