"""Tracks: recorded or predicted positions of people over time, and their files.

Files of PeTrack, the ETH data set, JuPedSim, or CSV are read; their format is recognised.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Hashable, Sequence
from contextlib import closing
from io import StringIO
from typing import Any, Literal, get_args

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, distinct
from hpop.base.options import one_of
from hpop.base.text import python_value, shown
from hpop.errors import MapError
from hpop.world.files import read_bytes, read_text
from hpop.world.tracks import csv
from hpop.world.tracks.csv import HEAD, comments_of, titled
from hpop.world.tracks.table import MOST_ROWS, PathLike, TrackFile, Tracks, identity, tracks_of
from hpop.world.tracks.track import Track

__all__ = ["Track", "read_tracks"]

ANNOTATED = 2.5
"""Annotations of each person per second in the ETH data set."""
OBSMAT_COLUMNS = 8
UNIT_OF_X = re.compile(r"^#.*\bx\s*[/\[(]\s*(mm|cm|m)\b", re.IGNORECASE | re.MULTILINE)
ORDER = ("id", "frame", "x", "y")
MAGIC = b"SQLite format 3\x00"
EXPECTED = "expected JuPedSim's tables trajectory_data (frame, id, pos_x, pos_y) and metadata (key, value), with fps"
CELLS = ("id", "frame", "pos_x", "pos_y")
LONGEST = 10_000  # bytes of a cell
TrackFormat = Literal["csv", "petrack", "obsmat", "jupedsim"]
MAX_BYTES = 200_000_000
"""Size of the largest file of tracks that is read, bytes."""


def read_numbers(text: str, source: TrackFile, widths: Sequence[int], columns: str) -> FloatArray:
    """Return rows of finite numbers (N, one of ``widths``); a MapError names the columns and the faulty line."""
    expected = f"expected rows of {' or '.join(map(str, widths))} numbers ({columns})"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # about a file without rows
            rows = np.loadtxt(StringIO(text), ndmin=2, max_rows=MOST_ROWS + 1)
    except (ValueError, OverflowError):
        raise source.error(f"cannot be read: {expected}{_wrong_line(text, widths)}.") from None
    if not rows.shape[0]:
        raise source.error(f"has no rows: {expected}.")
    if rows.shape[1] not in widths or not np.isfinite(rows).all():
        raise source.error(f"cannot be read: {expected}{_wrong_line(text, widths)}.")
    return rows


def _wrong_line(text: str, widths: Sequence[int]) -> str:
    """Return the end of an error message, which quotes the first wrong line; "" if there is none.

    A line is wrong if a word is no finite number, or if its number of words is not in ``widths`` or differs from that
    of the first line with words.
    """
    width = None
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        width = width or len(words)
        if words and (len(words) not in {*widths} & {width} or not all(map(_is_finite, words))):
            return f"; line {number} is {shown(line)}"
    return ""


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(float(value))
    except (TypeError, ValueError):
        return False


def _wrong_cell(rows: Sequence[Sequence[Any]]) -> str:
    """Describe, for an error message, the first cell in rows of JuPedSim's trajectory_data that is no finite number.

    If all are numbers, the frame rate (fps) in its metadata must be the faulty one.
    """
    for number, row in enumerate(rows, 1):
        for column, value in zip(CELLS, row, strict=True):
            if not _is_finite(value):
                return f"{column} in row {number} of trajectory_data is {shown(value)}"
    return "fps in metadata"


def is_obsmat(text: str) -> bool:
    """Return whether a file seems to be an obsmat.txt of the ETH data set: its first row has eight values, no comma."""
    first = text.lstrip().partition("\n")[0].split()
    return len(first) == OBSMAT_COLUMNS and not first[0].startswith("#") and "," not in first[0]


def obsmat_tracks(text: str, source: TrackFile, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks of the ETH data set (Pellegrini et al., ICCV 2009), obsmat.txt; MapError for another file.

    ``wanted`` lists the ids of the people to read; None means all.

    Each row has eight numbers separated by blanks: frame, id, x, z, y and the velocity in the order x, z, y; metres,
    where y is the second axis of the ground. People were annotated 2.5 times a second, so the step between annotated
    frames gives the video's frame rate unless it is given.
    """
    rows = read_numbers(text, source, (OBSMAT_COLUMNS,), "frame id x z y vx vz vy")
    steps = np.diff(distinct(rows[:, 0]))
    rate = source.frame_rate if source.frame_rate is not None or not steps.size else ANNOTATED * float(steps.min())
    times = rows[:, 0] / source.rate(rate)
    a_metre = source.a_metre(None)
    ids = [identity(one) for one in rows[:, 1].tolist()]
    return tracks_of(source, ids, times, rows[:, 2] / a_metre, rows[:, 4] / a_metre, wanted)


def is_petrack(text: str, source: TrackFile) -> bool:
    """Return whether a file begins like a file of PeTrack: comments, then a row of 4 or 5 values without commas.

    If a comment names columns, they must be id, frame, x and y in this order.
    """
    rows = [line for line in text[:HEAD].splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not text.lstrip().startswith("#") or not rows or "," in rows[0] or len(rows[0].split()) not in (4, 5):
        return False
    titles = comments_of(text, source).titles
    return not titles or tuple(titled(titles, source).places) == ORDER


def petrack_tracks(text: str, source: TrackFile, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks of PeTrack (Boltes and Seyfried, Neurocomputing 100, 2013); MapError for another file.

    ``wanted`` lists the ids of the people to read; None means all.

    The text file has comments with the frame rate, such as ``# framerate: 25 fps``, then a row per person and frame,
    ``id frame x y z``, separated by blanks. The unit is in the comment that names the columns (``x/cm``), or in one of
    its own (``# unit: cm``); the default is m. The pedestrian data archive has such files.
    """
    comments, titled_unit = comments_of(text, source), UNIT_OF_X.search(text[:HEAD])
    unit = titled_unit.group(1).lower() if titled_unit else comments.unit
    rows = read_numbers(text, source, (4, 5), "id frame x y z")
    x, y = rows[:, 2:4].T / source.a_metre(unit)
    times = rows[:, 1] / source.rate(comments.rate)
    return tracks_of(source, [identity(one) for one in rows[:, 0].tolist()], times, x, y, wanted)


def jupedsim_tracks(data: bytes, source: TrackFile, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks of JuPedSim from version 1.0 on, an SQLite database; MapError for another file.

    ``wanted`` lists the ids of the people to read; None means all.

    Table ``trajectory_data`` has a row per agent and frame (frame, id, pos_x m, pos_y m); table ``metadata`` has the
    frame rate under the key ``fps`` (https://www.jupedsim.org). Triggers and views of the database are never run.
    """
    import sqlite3  # slow to import

    try:
        with closing(sqlite3.connect(":memory:")) as base:
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(LONGEST, len(data)))
            base.deserialize(data)
            base.execute("PRAGMA trusted_schema = OFF")
            known = {name for (name,) in base.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
            if lacking := {"trajectory_data", "metadata"} - known:
                raise source.error(f"lacks the table {', '.join(sorted(lacking))}: {EXPECTED}.")
            said = base.execute("SELECT value FROM metadata WHERE key = 'fps'").fetchone()
            found = base.execute("SELECT id, frame, pos_x, pos_y FROM trajectory_data").fetchmany(MOST_ROWS + 1)
    except (sqlite3.Error, UnicodeDecodeError, MemoryError) as error:
        raise source.error(f"cannot be read as SQLite ({error}): {EXPECTED}.") from None
    if not found:
        raise source.error("has no rows: expected a row per person and time.")
    try:
        rate = None if said is None else float(said[0])
        rows = np.array(found, dtype=np.float64)
    except (TypeError, ValueError):
        raise source.error(f"has cells that are no numbers: {_wrong_cell(found)}; {EXPECTED}.") from None
    if not np.isfinite(rows).all():
        raise source.error(f"has cells that are no numbers: {_wrong_cell(found)}; {EXPECTED}.")
    a_metre = source.a_metre("m")
    ids = [identity(one) for one in rows[:, 0].tolist()]
    return tracks_of(source, ids, rows[:, 1] / source.rate(rate), rows[:, 2] / a_metre, rows[:, 3] / a_metre, wanted)


@checked_arguments
def read_tracks(
    path: PathLike,
    frame_rate: float | None = None,
    unit: str | None = None,
    format: TrackFormat | None = None,
    ids: Sequence[Hashable] | None = None,
) -> Tracks:
    """Return recorded tracks of people from a file, by id, in the order of ``ids`` or else of the file.

    Parameters
    ----------
    path : CSV (id, t or frame, x, y), a PeTrack text file (id frame x y z), an ``obsmat.txt`` of the ETH data set, or a
        file of JuPedSim (SQLite, or text of versions before 1.0)
    frame_rate : frames per second, if the file has frames and does not state the rate
    unit : unit of positions, "m", "cm" or "mm", if the file does not state it; m by default
    format : "csv", "petrack", "obsmat" or "jupedsim" (SQLite); recognised by default
    ids : people to read; all by default

    Times are those of the file: frame 0 is at 0 s. Times counted from 1970 are shifted to begin at 0 s.
    :meth:`Track.later` shifts time 0. The ``notes`` of the result mention all that was left out, repaired or assumed:
    people with one point, unreachable points, gaps, unsorted rows, the order of columns without a header.

    Raises MapError for a file that is unreadable, too large or contradictory, or that has no valid tracks: two
    positions at one time, invalid numbers, or speeds that suggest a wrong unit.
    """
    source = TrackFile(path, frame_rate, unit)
    if ids is not None:
        is_list = isinstance(ids, list | tuple) or (isinstance(ids, np.ndarray) and ids.ndim == 1)
        chosen = [python_value(person) for person in ids] if is_list else []
        if not chosen or not all(isinstance(person, str | int | float) for person in chosen):
            raise MapError(f"ids must be a list of numbers and names, such as [1, 7]; got {shown(ids)}.")
        ids = chosen
    if format is not None:
        one_of("the format of a track file", format, get_args(TrackFormat), error=MapError)
    data = read_bytes(path, "the track file", limit=MAX_BYTES)  # type: ignore[arg-type]  # checked there
    if format == "jupedsim" or (format is None and data.startswith(MAGIC)):
        return jupedsim_tracks(data, source, ids)
    text = read_text(data, path, "the track file")  # type: ignore[arg-type]  # checked there
    if text.lstrip()[:1] in ("{", "["):
        raise source.error(
            "is JSON, which hpop does not read; write it as CSV: a line id,t,x,y, then a row per person and time"
        )
    if format == "obsmat" or (format is None and is_obsmat(text)):
        return obsmat_tracks(text, source, ids)
    if format == "petrack" or (format is None and is_petrack(text, source)):
        return petrack_tracks(text, source, ids)
    return csv.tracks(text, source, ids)
