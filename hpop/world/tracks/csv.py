"""Tracks of people as a text table: one row per person and time, with or without a header.

A header, which may be a comment, names the columns in any order: an id (id, person, track, agent, ...), a time (t,
time) or a frame (frame), x and y; it may state units (``x/cm``, ``x [cm]``, ``time/ms``). Without a header the columns
are id, t, x, y, where t is a frame if a frame rate is given. They are frame, id, x, y instead, as in common copies of
the ETH and UCY data, if people then walk in shorter steps. Ids may be words. Columns are separated by commas,
semicolons, tabs or blanks; decimal commas are allowed unless commas separate columns.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import chain, islice
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.world.tracks.table import MOST_ROWS, UNITS, TrackFile, Tracks, identity, tracks_of

NAMES = {
    "id": ("id", "person", "person_id", "personid", "persid", "pers_id", "track", "track_id", "trackid", "agent",
           "agent_id", "agentid", "ped", "ped_id", "pedestrian_id"),
    "t": ("t", "time", "seconds", "timestamp"),
    "frame": ("frame", "frame_id", "frameid", "frame_number", "fr"),
    "x": ("x", "pos_x", "x_pos"),
    "y": ("y", "pos_y", "y_pos"),
}  # fmt: skip
UPRIGHT = ("", "z", "pos_z", "z_pos")
"""Titles of columns that are ignored without a note: row numbers and heights."""
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
}
"""Names of units of time, with their length in s."""
UNIT = re.compile(r"^(.*?)\s*[/\[(]\s*(\w+)\s*[\])]?$")
SUFFIX = re.compile(rf"^(.+?)_({'|'.join([*SECONDS, *UNITS])})$")
RATE = re.compile(r"#+\s*(?:frame\s*rate|fps)\s*[:=]\s*([0-9.,e+-]+)", re.IGNORECASE)
SAID_UNIT = re.compile(r"#+\s*units?\s*[:=]\s*(mm|cm|m)\b", re.IGNORECASE)
UNITED = re.compile(r"\s*(?:/\s*(\w+)|[\[(]\s*(\w+)\s*[\])])")
"""Unit after a title, with or without a blank before it."""
HEAD = 20_000
"""Number of characters at the beginning of a file in which comments are searched."""
LONGEST = 500  # characters of a row of four columns and some more
CLOSER = 0.7
"""Factor by which people's steps must be shorter if the first column of a file without a header is read as frames."""


class Columns(NamedTuple):
    """Columns of a table of tracks, by their titles.

    places  column index of "id", "t" or "frame", "x" and "y"
    unit    of positions, as stated in the titles, or None
    second  length of the unit of times, s, as stated in the titles, or None
    unread  titles of all other columns
    """

    places: dict[str, int]
    unit: str | None
    second: float | None
    unread: tuple[str, ...]


def titled(titles: Sequence[str], source: TrackFile) -> Columns:
    """Find the columns by their titles; MapError if one is missing, repeated or in an unknown unit."""
    places, units = dict[str, int](), {"t": set[str](), "x": set[str]()}
    for place, title in enumerate(titles):
        kind, unit = _kind(title)
        if kind is None:
            continue
        if kind in places:
            raise source.error(
                f"has two columns for {kind}: {shown(titles[places[kind]])} and {shown(title)}; rename one of them."
            )
        places[kind] = place
        if unit is not None and kind != "id":
            units["t" if kind in ("t", "frame") else "x"].add(unit)
    lacking = [name for name in ("id", "x", "y") if name not in places]
    if not {"t", "frame"} & set(places):
        lacking.insert(1, "t or frame")
    if lacking:
        raise source.error(
            f"lacks a column for {', '.join(lacking)}; its header is {shown(list(titles))}. Name the columns id, t (or "
            "frame), x and y; other columns may stay."
        )
    if {"t", "frame"} <= set(places):
        del places["frame"]  # both are equivalent; times need no rate
    for what, known, given in (("positions", UNITS, units["x"]), ("times", SECONDS, units["t"])):
        if what == "times" and "frame" in places:
            continue  # a frame has no unit
        if unknown := sorted(given - set(known)):
            raise source.error(
                f"has {what} in an unknown unit: {', '.join(unknown)}; convert them to one of {', '.join(known)}, and "
                "change the titles of the columns."
            )
        if len(given) > 1:
            raise source.error(
                f"has {what} in several units: {', '.join(sorted(given))}; convert all to one of these, and change the "
                "titles of the columns."
            )
    unread = tuple(
        title.strip()
        for place, title in enumerate(titles)
        if _kind(title)[0] is None and title.strip().lower() not in UPRIGHT
    )
    second = next((SECONDS[unit] for unit in units["t"] if "t" in places), None)
    return Columns(places, next(iter(units["x"]), None), second, unread)


def are_titles(words: Sequence[str]) -> bool:
    """Return whether words can be the titles of a table of tracks: an id, a time or frame, x and y."""
    kinds = {_kind(word)[0] for word in words}
    return {"id", "x", "y"} <= kinds and bool({"t", "frame"} & kinds)


def _kind(title: str) -> tuple[str | None, str | None]:
    """Return the kind of a column (a key of NAMES) and its unit, by its title; None for unknown ones."""
    title = title.strip().lower()
    found = UNIT.match(title) or (None if _named(title) else SUFFIX.match(title))
    name, unit = (found.group(1).strip(), found.group(2)) if found else (title, None)
    return _named(name), unit


def _named(name: str) -> str | None:
    return next((kind for kind, names in NAMES.items() if name in names), None)


class Comments(NamedTuple):
    """Statements in comments (lines that begin with #) among the first `HEAD` characters of a track file.

    rate    frames a second, or None
    unit    of positions, in a comment such as ``# unit: cm``, or None
    titles  of the columns, or ()
    """

    rate: float | None
    unit: str | None
    titles: tuple[str, ...]


def comments_of(text: str, source: TrackFile) -> Comments:
    """Return frame rate, unit and titles stated in comments; MapError for a frame rate that is no number."""
    lines = [line for line in text[:HEAD].splitlines() if line.lstrip().startswith("#")]
    rate = next((found for line in lines if (found := RATE.match(line.strip()))), None)
    unit = next((found.group(1).lower() for line in lines if (found := SAID_UNIT.match(line.strip()))), None)
    split = [re.split(r"[\s,;]+", UNITED.sub(r"/\1\2", line.strip().lstrip("#").strip())) for line in lines]
    titles = next((words for words in reversed(split) if are_titles(words)), [])
    return Comments(_rate(rate.group(1), source) if rate else None, unit, tuple(titles))


def _rate(text: str, source: TrackFile) -> float:
    try:
        return float(text)
    except ValueError:
        raise source.error(
            f"has a comment with the frame rate {shown(text)}; expected a number with a decimal point, such as 12.5."
        ) from None


def tracks(text: str, source: TrackFile, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return the tracks of a CSV file by id, of all people or of the ``wanted`` ids; MapError for another format."""
    said, rows = comments_of(text, source), _rows(text, source)
    first = next(rows, None)
    if first is None:
        raise source.error("has no rows: expected rows of id, t, x, y.")
    header = not said.titles and not _is_number(first[-1])
    titles = first if header else said.titles
    columns = titled(titles, source) if titles else None
    places = _without_titles(first, source) if columns is None else columns.places
    lines = _Lines(text, header)
    table = _Table.of(rows if header else chain([first], rows), places, lines, source)
    unit, second = said.unit, None
    notes: tuple[str, ...] = ()
    if columns is None:
        table = table.ordered(frames=said.rate is not None)
        order = ",".join(table.cells)
        notes = (f"has no header, so its columns are taken as {order}; name them in a first line if they are others",)
        source = replace(source, hint=f" It {notes[0]}.")
    else:
        unit, second = columns.unit or unit, columns.second
        notes = (f"has columns that are not read: {', '.join(columns.unread)}",) if columns.unread else ()
    if "frame" in table.cells:
        times = table.numbers("frame") / source.rate(said.rate)
        second = 1.0
    elif source.frame_rate is not None:
        raise source.error("has times, not frames; leave frame_rate out.")
    else:
        times, second = table.times(second)
    x, y = (table.numbers(name) / source.a_metre(unit) for name in ("x", "y"))
    return tracks_of(source, table.ids(), times, x, y, wanted, second=second, notes=notes)


@dataclass(frozen=True)
class _Lines:
    """Text of a file, to find the line number of a faulty row for an error message.

    header  whether the first row has titles, and so is no row of the table
    """

    text: str
    header: bool

    def of(self, row: int) -> int:
        """Return the line number, from 1, of a row of the table, which is counted from 0."""
        lines = (number for number, line in enumerate(self.text.splitlines(), 1) if _has_a_row(line))
        return next(islice(lines, row + self.header, None), 0)


@dataclass(frozen=True)
class _Table:
    """Columns of a table by name, with its lines and its file for error messages."""

    cells: dict[str, list[str]]
    lines: _Lines
    source: TrackFile

    @classmethod
    def of(cls, rows: Iterable[Sequence[str]], places: dict[str, int], lines: _Lines, source: TrackFile) -> _Table:
        """Collect the columns from rows, ``places`` giving the index of each by name; MapError for a row too short."""
        cells: dict[str, list[str]] = {name: [] for name in places}
        columns = list(zip(cells.values(), places.values(), strict=True))
        for number, row in enumerate(islice(rows, MOST_ROWS + 1)):
            if len(row) <= max(places.values()):
                raise source.error(
                    f"has a row with too few columns in line {lines.of(number)}: {shown(list(row))}; expected at least "
                    f"{max(places.values()) + 1}."
                )
            for column, place in columns:
                column.append(row[place])
        return cls(cells, lines, source)

    def numbers(self, name: str) -> FloatArray:
        """Return a column as finite numbers (N,), with decimal points or commas; MapError otherwise."""
        column = self.cells[name]
        try:
            numbers = np.array(column, dtype=np.float64)
            wrong = int(np.argmin(np.isfinite(numbers))) if not np.isfinite(numbers).all() else -1
        except ValueError:
            pointed = [text.replace(",", ".") for text in column]
            wrong = next((i for i, text in enumerate(pointed) if not _is_number(text)), -1)
            if wrong < 0:
                return replace(self, cells={name: pointed}).numbers(name)
        if wrong >= 0:
            raise self.source.error(
                f"has {shown(column[wrong])} in the column {name} of line {self.lines.of(wrong)}; expected a finite "
                "number."
            )
        return numbers

    def times(self, second: float | None) -> tuple[FloatArray, float | None]:
        """Return the column t as numbers (N,), and the length of their unit, s, or None if it is unknown.

        The length is ``second``, as stated in the title. Dates (ISO 8601) become seconds since 1970, of length 1.
        """
        first = next(iter(self.cells["t"]), "")
        if second is not None or _is_number(first) or not first[:4].isdecimal():
            return self.numbers("t"), second
        seconds = []
        for number, text in enumerate(self.cells["t"]):
            try:
                moment = datetime.fromisoformat(text.strip())
            except ValueError:
                raise self.source.error(
                    f"has {shown(text)} in the column t of line {self.lines.of(number)}; expected a date and time."
                ) from None
            seconds.append((moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp())
        return np.array(seconds), 1.0

    def ids(self) -> list[Hashable]:
        """Return the ids, as int if they are whole numbers; MapError if one is missing."""
        ids = [_identity(text) for text in self.cells["id"]]
        if "" in ids:
            raise self.source.error(f"has no id in line {self.lines.of(ids.index(''))}; expected a number or a name.")
        return ids

    def ordered(self, *, frames: bool) -> _Table:
        """Return the table with its columns named, for a file without a header; names are guessed from the contents.

        ``frames`` says that times are frame numbers.
        """
        columns = list(self.cells.values())
        numbers = [_finite(column) for column in columns]
        if len(columns) == 5 and numbers[0] is not None and np.array_equal(numbers[0], np.arange(len(columns[0]))):
            columns, numbers = columns[1:], numbers[1:]  # a column of row numbers, as pandas writes it
        first, second, x, y = numbers[:4]
        clock = "frame" if frames or self.source.frame_rate is not None else "t"
        names = ("id", clock, "x", "y")
        if first is not None and second is not None and x is not None and y is not None and _are_whole(second):
            if not _are_whole(first):
                names = (clock, "id", "x", "y")
            elif _step(second, first, x, y) < CLOSER * _step(first, second, x, y):
                names = ("frame", "id", "x", "y")
        return replace(self, cells=dict(zip(names, columns[:4], strict=True)))


def _rows(text: str, source: TrackFile) -> Iterator[list[str]]:
    """Yield the cells of each line that is neither a comment nor empty."""
    lines = (line for line in text.splitlines() if _has_a_row(line))
    sample = next(lines, "")
    if not sample:
        return
    delimiter = _delimiter(sample)
    if not delimiter:
        yield from (line.split() for line in chain([sample], lines))
        return
    yield from csv.reader([sample[:LONGEST]], delimiter=delimiter)
    try:
        yield from csv.reader(lines, delimiter=delimiter, strict=True)
    except csv.Error as error:
        raise source.error(f"cannot be read as CSV: {error}.") from None


def _has_a_row(line: str) -> bool:
    """Return whether a line is neither a comment nor empty."""
    return bool(line.strip()) and not line.lstrip().startswith("#")


def _delimiter(line: str) -> str:
    """Return the character that separates the cells of a line; "" for blanks."""
    words = line.split()
    if len(words) > 3 and all(map(_is_number, words)):
        return "\t" if "\t" in line else ""  # with decimal commas or without
    most = max(";\t,", key=lambda each: (line.count(each) > 1, each != ",", line.count(each)))
    return most if most in line else ""


def _without_titles(first: Sequence[str], source: TrackFile) -> dict[str, int]:
    """Return {"0": 0, "1": 1, ...} for the columns of a file without titles; MapError unless there are 4 or 5."""
    if len(first) not in (4, 5):
        raise source.error(
            f"has no header, and {len(first)} columns; expected id, t, x, y, or a header that names them."
        )
    return {str(place): place for place in range(len(first))}


def _finite(column: Sequence[str]) -> FloatArray | None:
    """Return the numbers of a column, or None if a cell is no finite number."""
    try:
        numbers = np.array([text.replace(",", ".") for text in column], dtype=np.float64)
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None


def _are_whole(numbers: FloatArray) -> bool:
    return bool((numbers == np.floor(numbers)).all())


def _step(who: FloatArray, when: FloatArray, x: FloatArray, y: FloatArray) -> float:
    """Return the median distance between successive positions of a person; inf if each person has only one.

    ``who`` and ``when`` are the columns to be read as the person and the time of each row.
    """
    order = np.lexsort((when, who))
    goes_on = np.diff(who[order]) == 0
    steps = np.hypot(np.diff(x[order]), np.diff(y[order]))[goes_on]
    return float(np.median(steps)) if steps.size else np.inf


def _is_number(text: str) -> bool:
    """Return whether a cell is a number, with a decimal point or comma."""
    try:
        float(text.replace(",", "."))
    except ValueError:
        return False
    return True


def _identity(text: str) -> Hashable:
    """Return an id: a whole number if it is one, else the text."""
    text = text.strip()
    return identity(float(text)) if _is_number(text) and "," not in text and np.isfinite(float(text)) else text
