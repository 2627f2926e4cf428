"""Columns of a track file by their titles: which one is the id, the time or the frame, x and y, and their units."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from hpop.base.text import shown
from hpop.world.tracks.table import UNITS, Asked

NAMES = {
    "id": ("id", "person", "person_id", "personid", "persid", "pers_id", "track", "track_id", "trackid", "agent",
           "agent_id", "agentid", "ped", "ped_id", "pedestrian_id"),
    "t": ("t", "time", "seconds", "timestamp"),
    "frame": ("frame", "frame_id", "frameid", "frame_number", "fr"),
    "x": ("x", "pos_x", "x_pos"),
    "y": ("y", "pos_y", "y_pos"),
}  # fmt: skip
UPRIGHT = ("", "z", "pos_z", "z_pos")
"""Titles that nobody misses: a count of rows, and heights, for people stand upright."""
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
}
"""Units of times, s."""
UNIT = re.compile(r"^(.*?)\s*[/\[(]\s*(\w+)\s*[\])]?$")
SUFFIX = re.compile(rf"^(.+?)_({'|'.join([*SECONDS, *UNITS])})$")
RATE = re.compile(r"#+\s*(?:frame\s*rate|fps)\s*[:=]\s*([0-9.,e+-]+)", re.IGNORECASE)
UNITED = re.compile(r"\s*(?:/\s*(\w+)|[\[(]\s*(\w+)\s*[\])])")
"""A unit behind a title, with or without a blank before it."""
HEAD = 20_000
"""Characters in which comments are looked for."""


class Columns(NamedTuple):
    """Where the columns of a table are.

    places  of "id", "t" or "frame", "x" and "y"
    unit    of places, as the titles say it, or None
    second  the unit of times, s, as the titles say it, or None
    unread  titles of all other columns
    """

    places: dict[str, int]
    unit: str | None
    second: float | None
    unread: tuple[str, ...]


def titled(titles: Sequence[str], asked: Asked) -> Columns:
    """Return where the columns are; MapError where one is lacking, named twice or in a strange unit."""
    places, units = dict[str, int](), {"t": set[str](), "x": set[str]()}
    for place, title in enumerate(titles):
        kind, unit = _kind(title)
        if kind is None:
            continue
        if kind in places:
            raise asked.error(f"has two columns for {kind}: {shown(titles[places[kind]])} and {shown(title)}.")
        places[kind] = place
        if unit is not None and kind != "id":
            units["t" if kind in ("t", "frame") else "x"].add(unit)
    lacking = [name for name in ("id", "x", "y") if name not in places]
    if not {"t", "frame"} & set(places):
        lacking.insert(1, "t or frame")
    if lacking:
        raise asked.error(f"lacks a column for {', '.join(lacking)}; its header is {shown(list(titles))}.")
    if {"t", "frame"} <= set(places):
        del places["frame"]  # both say the same; times need no rate
    for what, known, given in (("places", UNITS, units["x"]), ("times", SECONDS, units["t"])):
        if what == "times" and "frame" in places:
            continue  # a frame has no unit
        if len(given) > 1 or given - set(known):
            raise asked.error(f"has {what} in {', '.join(sorted(given))}; expected one of {', '.join(known)}.")
    unread = tuple(
        title.strip()
        for place, title in enumerate(titles)
        if _kind(title)[0] is None and title.strip().lower() not in UPRIGHT
    )
    second = next((SECONDS[unit] for unit in units["t"] if "t" in places), None)
    return Columns(places, next(iter(units["x"]), None), second, unread)


def are_titles(words: Sequence[str]) -> bool:
    """Whether words name the columns of a table of tracks."""
    kinds = {_kind(word)[0] for word in words}
    return {"id", "x", "y"} <= kinds and bool({"t", "frame"} & kinds)


def _kind(title: str) -> tuple[str | None, str | None]:
    """What a column is, and its unit, as its title says."""
    title = title.strip().lower()
    found = UNIT.match(title) or (None if _named(title) else SUFFIX.match(title))
    name, unit = (found.group(1).strip(), found.group(2)) if found else (title, None)
    return _named(name), unit


def _named(name: str) -> str | None:
    return next((kind for kind, names in NAMES.items() if name in names), None)


class Comments(NamedTuple):
    """What the comments (lines that begin with #) above the first row of a track file say.

    rate    frames a second, or None
    titles  of the columns, or none
    """

    rate: float | None
    titles: tuple[str, ...]


def comments_of(text: str, asked: Asked) -> Comments:
    """Return what the comments above the rows say; MapError for a frame rate that is no number."""
    lines = [line for line in text[:HEAD].splitlines() if line.lstrip().startswith("#")]
    rate = next((found for line in lines if (found := RATE.match(line.strip()))), None)
    split = [re.split(r"[\s,;]+", UNITED.sub(r"/\1\2", line.strip().lstrip("#").strip())) for line in lines]
    titles = next((words for words in reversed(split) if are_titles(words)), [])
    return Comments(_rate(rate.group(1), asked) if rate else None, tuple(titles))


def _rate(text: str, asked: Asked) -> float:
    try:
        return float(text)
    except ValueError:
        raise asked.error(
            f"says that there are {shown(text)} frames a second; expected a number, such as 12.5."
        ) from None
