"""Tracks as CSV: a row a person and time, with or without a header.

With a header the columns may be in any order: an id (id, person, track, agent, ...), a time in s (t, time) or a frame
(frame), x and y; units may stand in it (``x/cm``, ``x [cm]``). Without one they are id, t, x, y, t being a frame where
a frame rate is given. Ids may be words; commas, semicolons or tabs separate.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Hashable, Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.text import shown
from hpop.world.tracks.table import MOST_ROWS, UNITS, Asked, identity, tracks_of
from hpop.world.tracks.track import Track

NAMES = {
    "id": ("id", "person", "person_id", "personid", "persid", "track", "track_id", "trackid", "agent", "agent_id"),
    "t": ("t", "time", "seconds", "timestamp"),
    "frame": ("frame", "frame_id", "frameid", "frame_number"),
    "x": ("x", "pos_x", "x_pos"),
    "y": ("y", "pos_y", "y_pos"),
}
UNIT = re.compile(r"^(.*?)\s*[/\[(]\s*(\w+)\s*[\])]?$")
LONGEST = 500  # characters of a row of four columns and some more


def tracks(text: str, asked: Asked, wanted: Sequence[Hashable] | None = None) -> dict[Hashable, Track]:
    """Tracks by id; MapError for what is no such file."""
    rows = _rows(text, asked)
    first = next(rows, None)
    if first is None:
        raise asked.error("has no rows: expected id, t, x, y.")
    if len(first) == 1 and len(first[0].split()) > 1:
        raise asked.error(
            "has blanks between its columns; expected commas, semicolons or tabs. Rows of numbers alone are read with "
            "format 'petrack' (id frame x y) or 'obsmat'."
        )
    header = not _is_number(first[-1])
    places, unit = _columns(first, asked) if header else (_without_header(first, asked), None)
    if not header:
        rows = iter([first, *rows])
    lines = _Lines(text, header)
    numbered = enumerate(islice(rows, MOST_ROWS + 1))
    chosen = [_picked(row, places, asked, lines, number) for number, row in numbered]
    clock = "frame" if "frame" in places else "t"
    columns = {
        name: _numbers([row[i] for row in chosen], name, asked, lines) for i, name in enumerate(places) if name != "id"
    }
    if clock == "t" and asked.frame_rate is not None:
        raise asked.error("has times in s; leave frame_rate out, which is for frames.")
    times = columns[clock] / (asked.rate(None) if clock == "frame" else 1.0)
    a_metre, who = asked.a_metre(unit), list(places).index("id")
    ids = [_identity(row[who]) for row in chosen]
    if "" in ids:
        raise asked.error(f"has no id in line {lines.of(ids.index(''))}; expected a number or a name.")
    return tracks_of(asked, ids, times, columns["x"] / a_metre, columns["y"] / a_metre, wanted)


class _Lines(NamedTuple):
    """The lines of a file, to say where a row is; counted only where a fault is told."""

    text: str
    header: bool

    def of(self, row: int) -> int:
        """The line, from 1, of a row of numbers, from 0."""
        lines = (number for number, line in enumerate(self.text.splitlines(), 1) if _has_a_row(line))
        return next(islice(lines, row + self.header, None), 0)


def _has_a_row(line: str) -> bool:
    """Whether a line is no comment and not empty."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _rows(text: str, asked: Asked) -> Iterator[list[str]]:
    """Rows that are no comments and not empty."""
    lines = (line for line in text.splitlines() if _has_a_row(line))
    sample = next(lines, "")
    delimiter = max(",;\t", key=sample.count)
    if sample:
        yield from csv.reader([sample[:LONGEST]], delimiter=delimiter)
    try:
        yield from csv.reader(lines, delimiter=delimiter, strict=True)
    except csv.Error as error:
        raise asked.error(f"cannot be read as CSV: {error}.") from None


def _columns(header: Sequence[str], asked: Asked) -> tuple[dict[str, int], str | None]:
    """Where each column is, and the unit of places if the header says one."""
    places, units = dict[str, int](), set[str]()
    for place, title in enumerate(header):
        found = UNIT.match(title.strip())
        name, unit = (found.group(1), found.group(2)) if found else (title.strip(), None)
        kind = next((kind for kind, names in NAMES.items() if name.strip().lower() in names), None)
        if kind is None:
            continue
        if kind in places:
            raise asked.error(f"has two columns for {kind}: {shown(header[places[kind]])} and {shown(title)}.")
        places[kind] = place
        if kind in ("x", "y") and unit is not None:
            units.add(unit.lower())
    lacking = [name for name in ("id", "x", "y") if name not in places]
    if not {"t", "frame"} & set(places):
        lacking.insert(1, "t or frame")
    if lacking:
        raise asked.error(f"lacks a column for {', '.join(lacking)}; its header is {shown(list(header))}.")
    if {"t", "frame"} <= set(places):
        del places["frame"]  # both say the same; times need no rate
    if len(units) > 1 or units - set(UNITS):
        raise asked.error(f"has places in {', '.join(sorted(units))}; expected one of {', '.join(UNITS)}.")
    return places, next(iter(units), None)


def _without_header(first: Sequence[str], asked: Asked) -> dict[str, int]:
    if len(first) not in (4, 5):
        raise asked.error(
            f"has no header, and {len(first)} columns; expected id, t, x, y, or a header that names them."
        )
    return {"id": 0, "t" if asked.frame_rate is None else "frame": 1, "x": 2, "y": 3}


def _picked(row: Sequence[str], places: dict[str, int], asked: Asked, lines: _Lines, number: int) -> list[str]:
    try:
        return [row[place] for place in places.values()]
    except IndexError:
        raise asked.error(
            f"has a row with too few columns in line {lines.of(number)}: {shown(list(row))}; expected at least "
            f"{max(places.values()) + 1}."
        ) from None


def _numbers(column: Sequence[str], name: str, asked: Asked, lines: _Lines) -> FloatArray:
    try:
        numbers = np.array(column, dtype=np.float64)
        wrong = int(np.argmin(np.isfinite(numbers))) if not np.isfinite(numbers).all() else -1
    except ValueError:
        wrong = next(i for i, text in enumerate(column) if not _is_number(text))
    if wrong >= 0:
        raise asked.error(
            f"has {shown(column[wrong])} in the column {name} of line {lines.of(wrong)}; expected a finite number."
        )
    return numbers


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _identity(text: str) -> Hashable:
    """An id: a whole number where it is one, else the text."""
    text = text.strip()
    return identity(float(text)) if _is_number(text) and np.isfinite(float(text)) else text
