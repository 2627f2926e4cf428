"""Reader for measured fields: CSV, NumPy arrays, grey images, and occupancy grids of map_server."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.fields.measured import MOST_SAMPLES, MeasuredField
from hpop.world.files import named, read_bytes, read_text, read_yaml
from hpop.world.geometry.shapes import check_pose, check_positive, rotate
from hpop.world.readers.image import read_image

__all__ = ["read_field"]

WHAT = "field"
OFF_GRID = 0.01
"""Largest distance of a point in a CSV file from its place on the grid, as a share of the spacing."""
MOST_BYTES = 64 * MOST_SAMPLES
GRIDS = (".yaml", ".yml")


def read_field(
    path: str | Path,
    *,
    name: str,
    unit: str,
    spacing: float | None = None,
    origin: tuple[float, float, float] | None = None,
    outside: float | None = None,
    range: tuple[float, float] | None = None,
) -> MeasuredField:
    """Read a measured field. The ending of the file decides the format.

    Parameters
    ----------
    path : path of the file
        - ``.csv``: a header with x and y (m) and a column called ``name`` or ``value``; a line for each point. The
          points lie on a grid, in any order, and some may be missing.
        - ``.npy``: an array (H, W) of NumPy, the row with the lowest y first.
        - ``.yaml`` of map_server with its image: an occupancy grid, white 0 to black 100.
        - any other ending: a grey image.
        NaN, missing points and transparent pixels are not measured.
    name, unit : name of the field, and unit of its values
    spacing : float
        Distance of neighbouring samples, m. A CSV file and a yaml file state it themselves.
    origin : (x, y, yaw)
        Pose in the world, m and rad: of the lower-left corner of an image, of the first sample of a ``.npy`` file, of
        the frame of a CSV file. A yaml file states it itself.
    outside : float, optional
        Value where nothing was measured, see `MeasuredField`.
    range : (low, high)
        Values in the unit for black and white of an image; for 0 and 100 of an occupancy grid, by default 0 and 100.

    Raises
    ------
    MapError
        If the file is missing, broken or too large, or a value makes no sense.
    """
    ending = Path(path).suffix.lower()
    given = {"spacing": spacing, "origin": origin, "range": range}
    allowed = {".csv": {"origin"}, ".npy": {"spacing", "origin"}, **{key: {"range"} for key in GRIDS}}
    for key, value in given.items():
        if value is not None and key not in allowed.get(ending, given):
            raise MapError(f"{named(path)} has no use for {key}, because a {ending} file states it; leave {key} out.")
    data = read_bytes(path, WHAT, limit=MOST_BYTES)
    x, y, yaw = check_pose(origin or (0.0, 0.0, 0.0))
    if ending == ".csv":
        values, spacing, (u, v) = _table(data, path, name)
    elif ending == ".npy":
        values, spacing, (u, v) = _array(data, path), _needed("spacing", spacing, path), (0.0, 0.0)
    elif ending in GRIDS:
        values, spacing, (x, y, yaw) = _occupancy(data, path, _ends(range or (0.0, 100.0), path))
        u = v = 0.5 * spacing
    else:
        spacing = _needed("spacing", spacing, path)
        values = _image(data, path, *_ends(_needed("range", range, path, "[value of black, of white]"), path))
        u = v = 0.5 * spacing
    aside, along = rotate(u, v, yaw)
    try:
        return MeasuredField(values, spacing, (x + aside, y + along, yaw), name=name, unit=unit, outside=outside)
    except MapError as error:
        raise MapError(f"{named(path)}: {error}") from None


def _needed(key: str, value: Any, path: str | Path, what: str = "distance of neighbouring samples, m") -> Any:
    if value is None:
        raise MapError(f"{named(path)} needs {key} ({what}), because the file does not state it; add it.")
    return check_positive(f"{named(path)}: {key}", value) if key == "spacing" else value


def _ends(ends: Any, path: str | Path) -> tuple[float, float]:
    """Return the values of the darkest and the brightest pixel, or of 0 and 100, as floats."""
    try:
        low, high = ends
    except (TypeError, ValueError):
        raise MapError(f"{named(path)}: range must be two values [low, high]; got {shown(ends)}.") from None
    low, high = (float(real("range", end, -MOST, MOST, "a value", error=MapError)) for end in (low, high))
    return low, high


def _table(data: bytes, path: str | Path, name: str) -> tuple[FloatArray, float, tuple[float, float]]:
    """Return the samples of a CSV file, their spacing, m, and the position of the first sample."""
    lines = list(csv.reader(io.StringIO(read_text(data, path, WHAT))))
    header = [word.strip() for word in lines[0]] if lines else []
    value = next((key for key in (name, "value") if key in header), None)
    if value is None or not {"x", "y"} <= set(header):
        raise MapError(
            f"{named(path)} needs a header with x, y and {name} (or value), separated by commas; got "
            f"{shown(','.join(header))}."
        )
    columns = [header.index(key) for key in ("x", "y", value)]
    numbers = []
    for number, line in enumerate(lines[1:], 2):
        if not "".join(line).strip():
            continue
        try:
            numbers.append([float(line[column]) for column in columns])
        except (ValueError, IndexError):
            raise MapError(
                f"{named(path)}, line {number}: expected numbers for x, y and {value}; got {shown(','.join(line))}."
            ) from None
    points = np.array(numbers).reshape(-1, 3)
    if not len(points):
        raise MapError(f"{named(path)} has a header but no points; it needs at least two.")
    if not (finite := np.isfinite(points[:, :2]).all(axis=1)).all():
        raise MapError(
            f"{named(path)}: x and y of each point must be finite; those of point {np.argmin(finite) + 1} are not."
        )
    first = points[:, :2].min(axis=0)
    gaps = [np.diff(np.unique(np.round(column, 6))) for column in points[:, :2].T]
    spacing = round(float(min((gap.min() for gap in gaps if gap.size), default=0.0)), 6)
    if spacing <= 0:
        raise MapError(f"{named(path)} needs points at two places at least, on a grid; got one place.")
    steps = (points[:, :2] - first) / spacing
    places = np.rint(steps)
    columns_, rows = (int(most) + 1 for most in places.max(axis=0))
    off = np.abs(steps - places).max(axis=1) > OFF_GRID
    if off.any():
        i = int(np.argmax(off))
        raise MapError(
            f"{named(path)} must have its points on a grid with equal steps in x and y. Its smallest step is "
            f"{spacing:g} m, but the point ({points[i, 0]:g}, {points[i, 1]:g}) m is off that grid. Interpolate "
            "scattered points first, for example by scipy.interpolate.griddata."
        )
    if rows * columns_ > MOST_SAMPLES:
        raise MapError(
            f"{named(path)} spans a grid of {columns_:,} x {rows:,} points at its smallest step of {spacing:g} m; at "
            f"most {MOST_SAMPLES:,} are read. Interpolate to a larger step, or leave out points that lie far away."
        )
    values = np.full((rows, columns_), np.nan)
    u, v = places.astype(np.int64).T
    if np.unique(v * columns_ + u).size < len(points):
        raise MapError(f"{named(path)} has two values for one place; keep one of them, or their mean.")
    values[v, u] = points[:, 2]
    return values, spacing, (float(first[0]), float(first[1]))


def _array(data: bytes, path: str | Path) -> FloatArray:
    """Return the array of a ``.npy`` file."""
    try:
        values = np.load(io.BytesIO(data), allow_pickle=False)
        return np.asarray(values, dtype=np.float64)
    except (ValueError, TypeError, EOFError, OSError) as error:
        raise MapError(
            f"{named(path)} is no array of numbers that NumPy saved ({error}); save it by np.save."
        ) from None


def _image(data: bytes, path: str | Path, black: float, white: float) -> FloatArray:
    """Return the samples of an image, one for each pixel, the lowest row first; NaN for transparent pixels.

    black, white  samples of black and of white pixels; greys lie in between
    """
    picture = read_image(data, path)
    if picture.height * picture.width > MOST_SAMPLES:
        raise MapError(
            f"{named(path)} is {picture.width} x {picture.height} pixels; a field has at most {MOST_SAMPLES:,}. "
            "Lower its resolution."
        )
    values = np.empty((picture.height, picture.width))
    for rows, colours, alpha in picture.blocks():
        brightness = colours.mean(axis=-1)
        values[rows] = black + (white - black) * brightness
        if alpha is not None:
            values[rows][alpha < 1.0] = np.nan
    return values[::-1]


def _occupancy(
    data: bytes, path: str | Path, ends: tuple[float, float]
) -> tuple[FloatArray, float, tuple[float, float, float]]:
    """Return the samples of an occupancy grid, the side of a cell, m, and the pose of its lower-left corner."""
    given = read_yaml(read_text(data, path, WHAT), path)
    missing = [key for key in ("image", "resolution", "origin") if not isinstance(given, dict) or key not in given]
    if missing:
        raise MapError(f"{named(path)} must be a yaml file of map_server; it lacks {', '.join(missing)}.")
    image = Path(path).parent / str(given["image"])
    black, white = ends[::-1] if str(given.get("negate", 0)) in ("0", "False") else ends
    values = _image(read_bytes(image, "image of a field"), image, black, white)
    return values, check_positive("resolution", given["resolution"]), check_pose(given["origin"])
