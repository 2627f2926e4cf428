"""Reader for blueprints: an image in which dark means obstacle."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from hpop.base.options import real
from hpop.errors import MapError
from hpop.world.files import file_source, read_bytes
from hpop.world.geometry.shapes import Raster, check_heights, check_inside, check_pose, check_positive, check_span
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.readers import blueprint, thin_lines
from hpop.world.readers.picture import read_image
from hpop.world.world import World


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
        Area, m², below which connected dark pixels are no obstacle: lettering, specks of a scan.
    inside : (x, y), optional
        A point of the free space, m: what cannot be reached from it is solid, such as the inside of walls that are
        drawn as two lines, and all outside of the building.
    origin : (x, y, yaw)
        World pose of the image's lower-left corner, m and rad.
    height : (z_min, z_max), optional
        Heights of all obstacles, m; the whole height by default.
    outside_is_obstacle : bool
        Whether the camera counts all beyond the image as obstacle.
    thinnest_obstacle : float, optional
        Thickness, m, below which lines are no obstacle: the swings of doors, where walls are thicker.

    A photograph is turned as its EXIF orientation says. ``world.notes`` tell that, how many pixels are neither dark nor
    light, which grey areas are free, which specks look like lettering and which thin lines close passages, each with
    the option that makes it otherwise; and what these options left out or closed.

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
    for rows, colours, alpha in picture.blocks():
        brightness = colours.mean(axis=-1)
        if alpha is not None:
            brightness = brightness * alpha + (1.0 - alpha)
        dark[rows] = brightness < threshold
        shade[rows] = np.round(255 * brightness)
    options = {
        "resolution": resolution,
        "threshold": float(threshold),
        "smallest_obstacle": smallest_obstacle,
        "inside": None if inside is None else list(inside),
        "origin": list(origin),
        "height": None if height is None else [v if math.isfinite(v) else None for v in heights],
        "outside_is_obstacle": bool(outside_is_obstacle),
        "thinnest_obstacle": thinnest_obstacle,
    }
    raster = Raster(dark[::-1], resolution, origin, *heights)
    del dark
    notes = ["it is turned as its EXIF orientation says"] if picture.is_turned else []
    if not raster.cells.any():
        notes.append(f"no pixel is darker than the threshold {threshold:g}, so there are no obstacles")
    notes += blueprint.greys(shade[::-1], raster.cells, float(threshold), raster)
    if thinnest_obstacle is not None:
        cells, note = thin_lines.without_lines(raster, thinnest_obstacle)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    if smallest_obstacle is not None:
        cells, note = blueprint.without_specks(raster, smallest_obstacle)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    notes += blueprint.lettering(raster)
    if thinnest_obstacle is None:
        notes += thin_lines.closing(raster)
    if inside is not None:
        cells, note = blueprint.closed_from(raster, inside)
        raster, notes = replace(raster, cells=cells), [*notes, note]
    ground = Ground(raster=raster, outside_is_obstacle=bool(outside_is_obstacle))
    said = tuple(f"{path}: {note}." for note in notes)
    return World(ground, notes=said).read_from(file_source("image", path, options, content))
