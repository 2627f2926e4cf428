"""Reader for point clouds in PLY and PCD files, whose points become voxels: boxes on a grid of a stated resolution.

Read are ASCII and binary files with columns x, y and z. Faces of a PLY and other columns are ignored. Nothing is
decompressed, and no number in a header makes memory be reserved: a file has at least as many bytes as it has points.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.base.text import printable, shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import file_source, named, read_bytes
from hpop.world.world import World

MOST_BYTES = 200_000_000
"""Size of the largest file, bytes."""
MOST_CLOUD_POINTS = 5_000_000
"""Largest number of points of a file."""
HEADER = 100_000
"""Largest size of a header, bytes."""
BESIDE = 5
"""Bytes per byte of a file while it is read: its columns and coordinates."""
PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
"""NumPy types of the types in a PLY header, without the order of bytes."""
PCD_TYPES = {"F": {4: "f4", 8: "f8"}, "I": {1: "i1", 2: "i2", 4: "i4", 8: "i8"}}
PCD_TYPES["U"] = {size: kind.replace("i", "u") for size, kind in PCD_TYPES["I"].items()}


class _PointTable(NamedTuple):
    """Table of points as a header describes it.

    columns  name, type and number of values of each column
    number   number of points
    is_text  whether the numbers are written as text
    order    order of bytes of binary numbers, "<" or ">"
    begin    place of the first point in the file, in bytes
    note     sentence for the user, or ""
    """

    columns: tuple[tuple[str, str, int], ...]
    number: int
    is_text: bool
    order: str
    begin: int
    note: str = ""


def read(path: str | Path, *, resolution: float) -> World:
    """Read a point cloud, in m, as boxes that cover all its points: the filled cells of a grid, merged.

    ``resolution`` is the side of a cell, m. The boxes contain every point, so a robot that keeps off the boxes keeps
    off the points. What lies between points that are farther apart than a cell is not covered. Points without finite
    coordinates are left out, and a note counts them. The VIEWPOINT of a PCD file is not applied, and a note says so.

    Raises
    ------
    MapError
        If the file is missing, damaged, compressed or too large, or its points fill too many cells.
    """
    content = read_bytes(path, "point cloud", limit=MOST_BYTES)
    limits.hold(READING, len(content), BESIDE * len(content))
    table = _ply_header(content, path) if content.startswith(b"ply") else _pcd_header(content, path)
    points = _points(content, table, path)
    world = World.from_points(points, resolution)
    notes = tuple(f"{named(path)}: {note}" for note in (table.note, *world.notes) if note)
    return World(world.ground, notes=notes).read_from(
        file_source("point_cloud", path, {"resolution": resolution}, content)
    )


def _error(path: str | Path, said: str) -> MapError:
    return MapError(f"{named(path)}: {said}.")


def _ply_header(content: bytes, path: str | Path) -> _PointTable:
    """Return the table of points (element vertex) of a PLY file."""
    end = content.find(b"end_header", 0, HEADER)
    begin = content.find(b"\n", end) + 1
    if end < 0 or not begin:
        raise _error(path, "a PLY file must have a header that ends with end_header; export it again")
    kind, count, columns, elements = "", -1, [], 0
    for line in content[:end].decode("latin-1").splitlines():
        match line.split():
            case ["format", kind, _]:
                pass
            case ["element", name, number]:
                elements += 1
                if elements == 1 and name != "vertex":
                    raise _error(
                        path, f"the first element of a PLY file must be vertex, got {shown(name)}; export points only"
                    )
                count = _count(number, path) if elements == 1 else count
            case ["property", "list", *_] if elements == 1:
                raise _error(path, "points (element vertex) must have no lists; export x, y and z only")
            case ["property", text, name] if elements == 1:
                columns.append((name, _known(PLY_TYPES, text, path), 1))
    orders = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}
    return _PointTable(tuple(columns), count, kind == "ascii", _known(orders, kind, path), begin)


def _pcd_header(content: bytes, path: str | Path) -> _PointTable:
    """Return the table of points of a PCD file."""
    said: dict[str, list[str]] = {}
    begin = 0
    while "DATA" not in said and begin < HEADER:
        end = content.find(b"\n", begin, HEADER)
        if end < 0:
            break
        words = content[begin:end].decode("latin-1").split()
        begin = end + 1
        if words and not words[0].startswith("#"):
            said[words[0].upper()] = words[1:]
    lacking = [key for key in ("FIELDS", "SIZE", "TYPE", "POINTS", "DATA") if not said.get(key)]
    if lacking:
        raise _error(path, f"expected a PLY or a PCD file, but its header lacks {', '.join(lacking)}; export it again")
    names, sizes, kinds = said["FIELDS"], said["SIZE"], said["TYPE"]
    counts = said.get("COUNT", ["1"] * len(names))
    if not len(names) == len(sizes) == len(kinds) == len(counts):
        raise _error(path, "FIELDS, SIZE, TYPE and COUNT of its header must have as many entries; export it again")
    kind = said["DATA"][0]
    if kind == "binary_compressed":
        raise _error(
            path,
            "compressed points are not read; write them out, by pcl_convert_pcd_ascii_binary IN.pcd OUT.pcd 1, or in "
            "Open3D by write_point_cloud(OUT, cloud, compressed=False)",
        )
    _known({"ascii": "", "binary": ""}, kind, path)
    columns = [
        (name, _known(_known(PCD_TYPES, letter, path), _count(size, path), path), _count(number, path))
        for name, size, letter, number in zip(names, sizes, kinds, counts, strict=True)
    ]
    view = said.get("VIEWPOINT", [])
    note = (
        f"its VIEWPOINT, {' '.join(view)}, is not applied: points are taken as in the world"
        if any(word.strip("-0.") for word in view[:3] + view[4:])
        else ""
    )
    return _PointTable(tuple(columns), _count(said["POINTS"][0], path), kind == "ascii", "<", begin, note)


def _known(table: Mapping[Any, Any], key: Any, path: str | Path) -> Any:
    """Return an entry of a table; MapError, about a header, if there is none."""
    if key not in table:
        raise _error(path, f"its header must have one of {', '.join(map(str, table))}, got {shown(key)}")
    return table[key]


def _count(word: str, path: str | Path) -> int:
    if not (word.isascii() and word.isdecimal() and len(word) < 10):
        raise _error(path, f"counts in its header must be whole numbers, got {shown(word)}")
    return int(word)


def _points(content: bytes, table: _PointTable, path: str | Path) -> FloatArray:
    """Return the coordinates (N, 3), m, of all points."""
    places: dict[str, int] = {}
    place = 0
    for name, _, count in table.columns:
        places.setdefault(name, place)
        place += count
    if not {"x", "y", "z"} <= places.keys() or not 0 < place <= HEADER:
        raise _error(path, f"points must have columns x, y and z; got {shown([name for name, _, _ in table.columns])}")
    if not 0 < table.number <= MOST_CLOUD_POINTS:
        raise _error(path, f"expected 1 to {MOST_CLOUD_POINTS:,} points, got {table.number:,}; thin the cloud out")
    xyz = [places[name] for name in "xyz"]
    lost = "expected {:,} points as in its header, got {:,}; the file is damaged or incomplete: export it again"
    if table.is_text:
        text = io.BytesIO(content[table.begin :])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # that empty lines do not count
                rows = np.loadtxt(text, usecols=xyz, max_rows=table.number, ndmin=2, comments=None)
        except (ValueError, UnicodeDecodeError) as error:
            raise _error(path, f"its points cannot be read ({printable(error)[:80]}); export it again") from None
        if len(rows) < table.number:
            raise _error(path, lost.format(table.number, len(rows)))
        return np.asarray(rows, np.float64)
    fields = [(f"{i}", table.order + kind, (count,)) for i, (_, kind, count) in enumerate(table.columns)]
    record = np.dtype(fields)
    there = (len(content) - table.begin) // max(record.itemsize, 1)
    if there < table.number:
        raise _error(path, lost.format(table.number, there))
    rows_: NDArray[np.void] = np.frombuffer(content, record, table.number, table.begin)
    names = [name for name, _, _ in table.columns]
    return np.stack([rows_[str(names.index(name))][:, 0].astype(np.float64) for name in "xyz"], axis=1)
