"""Readers for maps of ROS: a map_server yaml file with its image, or an occupancy grid in a bag of ROS 1 or 2.

Bags need the extra ``bags`` (rosbags).
"""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import one_of, real
from hpop.base.text import shown
from hpop.errors import MapError, did_you_mean
from hpop.world.files import extract, file_source, named, read_bytes, read_text, read_yaml
from hpop.world.geometry.shapes import Raster, check_heights, check_pose, check_positive, check_span
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.readers.image import read_image
from hpop.world.world import World

KEYS = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
MODES = ("trinary", "scale", "raw")
MAX_YAML = 1_000_000
"""Largest yaml file, bytes; a larger file is an image that was given by mistake."""
GREY = 205
"""Grey value that map_saver writes for an unknown cell, regardless of the thresholds in its yaml file."""
TELLS_GREY = 0.196
"""Largest free_thresh with which this grey value is read as unknown."""
NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)(e[-+]?\d+)?", re.IGNORECASE)
"""Pattern of a text that is a number."""
ENDINGS = (".pgm", ".png", ".bmp", ".ppm", ".gif", ".jpg", ".jpeg")
"""File endings of map images, tried where a yaml file names an image without one."""
TRUTH = {"0": False, "1": True, **dict.fromkeys(("false", "no", "off", "n"), False)}
TRUTH |= dict.fromkeys(("true", "yes", "on", "y"), True)
"""Texts for true and false in ``negate``: map_server accepts 0 and 1 as well as the words of YAML."""
OCCUPIED, FREE = 65, 19
"""Percent from which a cell is occupied, and percent up to which it is free, as in map_saver."""


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """Map in the format of map_server: occupied, free and unknown cells.

    occupied, free  (H, W) bool       row 0 at the bottom; a cell that is neither is unknown
    resolution      float         m
    origin          (x, y, yaw)   m, m, rad
    contents        bytes of the yaml file and of the image
    free_greys      number of free cells with the grey that map_saver writes for unknown cells
    notes           warnings to print, such as on an image found elsewhere
    """

    occupied: BoolArray
    free: BoolArray
    resolution: float
    origin: tuple[float, float, float]
    contents: tuple[bytes, bytes]
    free_greys: int = 0
    notes: tuple[str, ...] = ()

    @property
    def unknown(self) -> int:
        """Return the number of cells that are neither occupied nor free."""
        return int((~self.free & ~self.occupied).sum())


def read(
    path: str | Path,
    *,
    unknown_is_free: bool = False,
    keep_out: str | Path | None = None,
    height: Heights | None = None,
) -> World:
    """Read a map_server yaml and its image as a `World` of cells.

    Numbers and ``negate`` may be quoted. A missing image is looked for beside the yaml file: by its name alone, in
    upper or lower case (``Map.PGM``), or without its ending.

    ``world.notes`` mention unknown cells, cells that map_saver wrote as unknown but ``free_thresh`` makes free, an
    image at another place, and a mask that closes nothing or has unknown cells.

    Parameters
    ----------
    path : path of the yaml file
    unknown_is_free : bool
        Whether unknown cells, and everything beyond the image, are free rather than obstacles.
    keep_out : path of a second yaml file, optional
        A mask, on any grid: its occupied cells are closed to the robot but invisible to the camera. With ``mode:
        scale`` these are the cells published as 100, which Nav2's keep-out filter treats as lethal.
    height : (z_min, z_max) in metres, optional
        Heights of all obstacle cells; unlimited by default.

    Raises
    ------
    MapError
        If a file is missing or broken, or a value makes no sense.
    """
    grid = load(path)
    contents, notes = list(grid.contents), grid.notes
    heights = WHOLE if height is None else check_heights(height)
    zone: BaseGeometry = MultiPolygon()
    if keep_out is not None:
        mask = load(keep_out)
        contents += mask.contents
        notes += (*mask.notes, *_on_mask(mask, keep_out))
        try:
            zone = Raster(mask.occupied, mask.resolution, mask.origin).solid()
        except MapError as error:
            raise MapError(f"{keep_out}: {error}") from None
    options = {
        "unknown_is_free": bool(unknown_is_free),
        "keep_out": None if keep_out is None else str(Path(keep_out).absolute()),
        "height": None if height is None else [v if math.isfinite(v) else None for v in heights],
    }
    cells = grid.occupied if unknown_is_free else ~grid.free
    raster = Raster(cells, grid.resolution, grid.origin, *heights)
    notes += () if unknown_is_free else _on_unknown(grid, path)
    return World(Ground(raster=raster, outside_is_obstacle=not unknown_is_free), zone, notes=notes).read_from(
        file_source("ros_map", path, options, *contents)
    )


def _on_unknown(grid: OccupancyMap, path: str | Path) -> tuple[str, ...]:
    """Return notes on unknown cells, and on cells that were saved as unknown but are free (Nav2 until 2025)."""
    share, greys = (
        f"{path}: {100 * cells / grid.free.size:.3g} % of its cells" for cells in (grid.unknown, grid.free_greys)
    )
    notes = (
        f"{share} are unknown and count as obstacles; with unknown_is_free they are free.",
        f"{greys} have the grey {GREY} that map_saver writes for unknown ones, but its free_thresh makes them free, as "
        f"in map_server. If these cells were never seen, write free_thresh: {TELLS_GREY}.",
    )
    return tuple(note for note, cells in zip(notes, (grid.unknown, grid.free_greys), strict=True) if cells)


def _on_mask(mask: OccupancyMap, path: str | Path) -> tuple[str, ...]:
    """Return notes on a keep-out mask that closes nothing or has unknown cells."""
    closed = int(mask.occupied.sum())
    says = f"{path}: {closed:,} cells of the mask are closed" if closed else f"{path}: the mask closes nothing"
    if not mask.unknown:
        return () if closed else (f"{says}: all of its cells are free.",)
    return (
        f"{says}, and {mask.unknown:,} are neither occupied nor free, so they stay open. Lower occupied_thresh if they "
        "are to be closed.",
    )


def load(path: str | Path) -> OccupancyMap:
    """Read a map_server yaml file and its image, and classify the cells; MapError for a missing or invalid file."""
    if isinstance(path, str | os.PathLike) and Path(path).suffix.lower() in ENDINGS:
        beside = Path(path).with_suffix(".yaml")
        hint = f": {named(beside)}" if beside.is_file() else f", or read it by World.from_image({str(path)!r}, 0.05)"
        raise MapError(f"{named(path)} is an image; give the yaml file of map_server that names it{hint}.")
    content = read_bytes(path, "map file", limit=MAX_YAML)
    data = _mapping(read_text(content, path, "map file"), path)
    data = {key: _plain(value) for key, value in data.items()}
    try:
        resolution = check_positive("resolution", data["resolution"])
        origin = check_pose(data["origin"])
    except MapError as error:
        raise MapError(f"{path}: {error}") from None
    occupied_thresh, free_thresh = (
        float(real(f"{path}: {key}", data[key], 0, 1, error=MapError)) for key in ("occupied_thresh", "free_thresh")
    )
    if free_thresh > occupied_thresh:
        raise MapError(f"{path}: free_thresh {free_thresh} must not exceed occupied_thresh {occupied_thresh}.")
    negate = data["negate"]
    negate = TRUTH.get(negate.lower()) if isinstance(negate, str) else negate
    if not isinstance(negate, int | float) or negate not in (0, 1):
        raise MapError(f"{path}: negate must be 0, 1, true or false; got {shown(data['negate'])}.")
    mode = data.get("mode", "trinary")
    mode = mode.lower() if isinstance(mode, str) else mode
    one_of(f"{path}: mode", mode, MODES, error=MapError)
    name = data["image"]
    if not isinstance(name, str) or not name:
        raise MapError(f"{path}: image must be the path of an image, relative to the yaml; got {shown(name)}.")
    image_path, notes = _image_beside(Path(path), name)
    image = read_bytes(image_path, "map image")
    picture = read_image(image, image_path)
    height, width = picture.height, picture.width
    check_span(height, width, resolution, path)
    occupied, free = np.empty((2, height, width), dtype=bool)
    free_greys = 0
    for rows, colours, alpha in picture.blocks():
        occupied[rows], free[rows] = classify(
            colours,
            alpha,
            mode,
            bool(negate),
            occupied_thresh,
            free_thresh,
        )
        if mode != "raw" and not negate:
            greys = (np.round(255 * colours) == GREY).all(axis=-1)
            free_greys += int((greys & free[rows]).sum())
    return OccupancyMap(occupied[::-1], free[::-1], resolution, origin, (content, image), free_greys, notes)


def _plain(value: Any) -> Any:
    """Convert quoted numbers, also in lists, to numbers, as the YAML library of map_server does."""
    if isinstance(value, list):
        return [_plain(item) for item in value]
    if isinstance(value, str) and NUMBER.fullmatch(value.strip()):
        return float(value)
    return value


def _image_beside(path: Path, name: str) -> tuple[Path, tuple[str, ...]]:
    """Return the path of the image that a yaml file names, and a note if the image was found elsewhere.

    ``path`` is that of the yaml file, ``name`` that of the image in it.

    A map copied from another machine may name another folder, case or ending. Only the folders of the named image and
    of the yaml file are searched; if no image is there, the named path is returned.
    """
    given = path.parent / name
    if "\0" in name or os.path.lexists(given):
        return given, ()
    wanted = PureWindowsPath(name).name.casefold()  # accepts both kinds of slashes
    matches = {wanted: 0, **{wanted + ending: 1 + i for i, ending in enumerate(ENDINGS)}}
    found: tuple[int, str] | None = None
    for folder in dict.fromkeys((given.parent, path.parent)):
        if folder != path.parent and Path(name).is_absolute():
            continue
        try:
            with os.scandir(folder) as entries:
                for entry in entries:
                    rank = matches.get(entry.name.casefold())
                    if rank is not None and (found is None or (rank, entry.name) < found) and entry.is_file():
                        found = rank, entry.name
        except (OSError, ValueError):
            continue
        if found is not None:
            image = folder / found[1]
            return image, (f"{path}: its image {named(name)} is not there; {named(image)} is read instead.",)
    return given, ()


def classify(
    colours: FloatArray,
    alpha: FloatArray | None,
    mode: str,
    negate: bool,
    occupied_thresh: float,
    free_thresh: float,
) -> tuple[BoolArray, BoolArray]:
    """Return the occupied and the free pixels (H, W) as map_server classifies them; all others are unknown.

    The brightness of a pixel is the mean of its colours in [0, 1]; in trinary mode the alpha channel is included in the
    mean. ``occ`` is 1 - brightness, or the brightness if negated.

    - trinary: occupied if occ > occupied_thresh, free if occ < free_thresh.
    - scale: as trinary, but a pixel that is not opaque is unknown. map_server grades pixels between the thresholds from
      0 to 100; here 100 is occupied, 0 is free, and other grades are unknown.
    - raw: the byte itself is the occupancy in percent, and unknown above 100, whatever `negate` says; occupied if at
      least 100 occupied_thresh, free if at most 100 free_thresh.
    """
    if mode == "trinary" and alpha is not None:
        channels = np.broadcast_to(colours, (*alpha.shape, 3))
        brightness = (channels.sum(axis=-1) + alpha) / 4.0
    else:
        brightness = colours.mean(axis=-1)
    if mode == "raw":
        percent = np.round(brightness * 255.0)
        known = percent <= 100
        occupied = known & (percent >= 100 * occupied_thresh)
        return occupied, known & ~occupied & (percent <= 100 * free_thresh)
    occ = brightness if negate else 1.0 - brightness
    occupied, free = occ > occupied_thresh, occ < free_thresh
    if mode == "scale" and free_thresh < occupied_thresh:
        grade = np.rint((occ - free_thresh) / (occupied_thresh - free_thresh) * 100)
        occupied, free = grade >= 100, grade <= 0
    if mode == "scale" and alpha is not None:
        occupied, free = occupied & (alpha == 1.0), free & (alpha == 1.0)
    return occupied, free


def _mapping(text: str, path: str | Path) -> dict[str, Any]:
    data = read_yaml(text, path)
    if not isinstance(data, dict):
        raise MapError(f"{path} must hold a yaml mapping with {', '.join(KEYS)}; got {type(data).__name__}.")
    missing = [key for key in KEYS if key not in data]
    if missing:
        hint = next(filter(None, (did_you_mean(key, missing) for key in data if key not in KEYS)), "")
        raise MapError(f"{path} lacks {', '.join(missing)}; a map_server yaml has {', '.join(KEYS)}.{hint}")
    for key in KEYS:
        value = data[key]
        if isinstance(value, dict) or (
            isinstance(value, list) and any(isinstance(item, dict | list | set) for item in value)
        ):
            raise MapError(f"{path}: {key} must be a plain value, not a nested one.")
    return data


def read_bag(
    path: str | Path,
    *,
    topic: str | None = None,
    unknown_is_free: bool = False,
    height: Heights | None = None,
) -> World:
    """Read the last occupancy grid on a topic of a bag as a `World` of cells.

    Parameters
    ----------
    path : path of a ``.bag`` (ROS 1), or of a folder with ``metadata.yaml``, a ``.mcap`` or a ``.db3`` (ROS 2)
    topic : str, optional
        Topic of the grid; default: ``/map``, or the only topic with a grid.
    unknown_is_free : bool
        Whether cells that are neither occupied (65 % or more) nor free (19 % or less), and everything beyond the grid,
        are free rather than obstacles. The thresholds are those of map_saver.
    height : (z_min, z_max) in metres, optional
        Heights of all obstacle cells; unlimited by default.

    Saved fronts keep the SHA-256 of the message, not of the bag. Message definitions in the bag are not used.

    Raises
    ------
    MapError
        If there is no bag, or no map in it, or several maps and no topic is chosen.
    """
    if topic is not None and not isinstance(topic, str):
        raise MapError(f"topic must be the name of a topic, such as /map; got {shown(topic)}.")
    heights = WHOLE if height is None else check_heights(height)
    found = extract("bag", path, b"", {"path": _checked(path), "topic": topic})
    words = found.words
    cells = found.arrays["cells"]
    resolution = words["resolution"]
    rows, columns = cells.shape
    check_span(rows, columns, resolution, f"{path}, topic {words['topic']}")
    try:
        occupied = cells >= OCCUPIED if unknown_is_free else (cells < 0) | (cells > FREE)
        raster = Raster(occupied, resolution, words["origin"], *heights)
    except MapError as error:
        raise MapError(f"{path}, topic {words['topic']}: {error}") from None
    unknown = (cells > FREE) & (cells < OCCUPIED) | (cells < 0)
    others = f"; other maps are on {', '.join(words['others'][:10])}" * bool(words["others"])
    which = "the only" if words["messages"] == 1 else f"of {words['messages']:,} the last"
    note = (
        f"{path}: {which} grid on {words['topic']}{others}. {100 * unknown.mean():.3g} % of its cells are unknown, and "
        f"{'free' if unknown_is_free else 'obstacles'}."
    )
    options = {
        "topic": words["topic"],
        "unknown_is_free": bool(unknown_is_free),
        "height": None if height is None else [v if math.isfinite(v) else None for v in heights],
    }
    source = {"kind": "ros_bag", "path": os.path.abspath(path), "options": options, "sha256": [words["sha256"]]}
    return World(Ground(raster=raster, outside_is_obstacle=not unknown_is_free), notes=(note,)).read_from(source)


def _checked(path: str | Path) -> str:
    """Return the absolute path of a bag; `MapError` if it is missing, or holds anything but files and folders."""
    try:
        whole = os.path.abspath(path)
        within = [entry.path for entry in os.scandir(whole)] if os.path.isdir(whole) else [whole]
    except (OSError, TypeError, ValueError) as error:
        raise MapError(f"bag {named(path)} cannot be opened: {error}.") from None
    for each in within:
        if not (os.path.isfile(each) or os.path.isdir(each)):
            is_there = os.path.lexists(each)
            what = "is no regular file" if is_there else "does not exist"
            raise MapError(f"bag {named(path)}: {named(each)} {what}. Check the path.")
    return whole
