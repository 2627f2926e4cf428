"""Reader for the grid maps of the MovingAI benchmark (Sturtevant 2012, movingai.com)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import file_source, read_bytes, read_text
from hpop.world.geometry.shapes import Raster, check_positive, check_size, check_span
from hpop.world.ground import Ground
from hpop.world.world import World

PASSABLE = ".GS"
TERRAIN = ".GS@OTW"
BLOCK = 1_000_000
"""Cells that are processed together."""
LINES = 4
"""Bytes per cell while a map is read, in addition to the cells: the file, its text and its lines."""


def read(path: str | Path, *, resolution: float = 1.0) -> World:
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
