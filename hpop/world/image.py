"""Reader for blueprints: an image in which dark means obstacle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from hpop.errors import MapError
from hpop.options import real
from hpop.world.files import file_source, read_bytes
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.picture import read_image
from hpop.world.shapes import Raster, check_heights, check_pose, check_positive, check_span
from hpop.world.world import World


def read(
    path: str | Path,
    resolution: float,
    *,
    threshold: float = 0.5,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    height: Heights | None = None,
    outside_is_obstacle: bool = True,
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
    origin : (x, y, yaw)
        World pose of the image's lower-left corner, m and rad.
    height : (z_min, z_max), optional
        Heights of all obstacles, m; the whole height by default.
    outside_is_obstacle : bool
        Whether the camera counts all beyond the image as obstacle.

    Raises
    ------
    MapError
        If the image is missing, broken or too large, or an option makes no sense.
    """
    real("threshold", threshold, 0, 1, "a brightness", error=MapError)
    resolution = check_positive("resolution", resolution)
    origin = check_pose(origin)
    heights = WHOLE if height is None else check_heights(height)
    content = read_bytes(path, "image")
    picture = read_image(content, path)
    check_span(picture.height, picture.width, resolution, path)
    dark = np.empty((picture.height, picture.width), dtype=bool)
    for rows, colours, alpha in picture.blocks():
        brightness = colours.mean(axis=-1)
        if alpha is not None:
            brightness = brightness * alpha + (1.0 - alpha)
        dark[rows] = brightness < threshold
    options = {
        "resolution": resolution,
        "threshold": float(threshold),
        "origin": list(origin),
        "height": None if height is None else [v if math.isfinite(v) else None for v in heights],
        "outside_is_obstacle": bool(outside_is_obstacle),
    }
    raster = Raster(dark[::-1], resolution, origin, *heights)
    return World(Ground(raster=raster, outside_is_obstacle=bool(outside_is_obstacle))).read_from(
        file_source("image", path, options, content)
    )
