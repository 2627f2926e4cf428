"""Reader for the map in a bag of ROS 1 or 2, a ``nav_msgs/OccupancyGrid``. It needs the extra ``bags`` (rosbags)."""

from __future__ import annotations

import math
import os
from pathlib import Path

from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.files import extract, named
from hpop.world.geometry.shapes import Raster, check_heights, check_span
from hpop.world.ground import WHOLE, Ground, Heights
from hpop.world.world import World

OCCUPIED, FREE = 65, 19
"""Percent from which a cell is occupied, and up to which it is free, as map_saver writes them."""


def read(
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
        Where the grid was sent; without it ``/map``, or the only one.
    unknown_is_free : bool
        Cells that are neither occupied (65 % or more) nor free (19 % or less), and all beyond the grid, are obstacles
        unless this is set: the cells are those of the map that map_saver would save.
    height : (z_min, z_max) in metres, optional
        Heights of all obstacle cells; the whole height by default.

    Saved fronts keep the SHA-256 of the message, not of the bag. Message definitions in the bag are not used.

    Raises
    ------
    MapError
        If there is no bag, no map in it (with the topics that it has), or several and none is chosen.
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
    """The whole path of a file, or of a folder of files; `MapError` for what is not there, or would be waited for."""
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
