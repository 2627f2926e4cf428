"""Tracks as PeTrack writes them (Boltes and Seyfried, Neurocomputing 100, 2013; also the pedestrian data archive).

Text: comments with the frame rate, such as ``# framerate: 25 fps``, then a row a person and frame, ``id frame x y z``,
separated by blanks. The unit stands in the comment with the names of the columns (``x/cm``); without one it is m.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence

from hpop.text import shown
from hpop.world.tracks.numbers import read_numbers
from hpop.world.tracks.table import Asked, identity, tracks_of
from hpop.world.tracks.track import Track

RATE = re.compile(r"^#\s*frame\s*rate\s*[:=]\s*([0-9.,e+-]+)", re.IGNORECASE | re.MULTILINE)
COLUMNS = re.compile(r"^#.*\bx\s*[/\[(]\s*(mm|cm|m)\b", re.IGNORECASE | re.MULTILINE)
HEADER = 20_000  # characters in which comments are looked for


def is_petrack(text: str) -> bool:
    """Whether a file begins as PeTrack's do: with comments and a row of numbers separated by blanks."""
    rows = [line for line in text[:HEADER].splitlines() if line.strip() and not line.lstrip().startswith("#")]
    return text.lstrip().startswith("#") and bool(rows) and "," not in rows[0] and len(rows[0].split()) in (4, 5)


def tracks(text: str, asked: Asked, wanted: Sequence[Hashable] | None = None) -> dict[Hashable, Track]:
    """Tracks by id; MapError for what is no such file."""
    head = text[:HEADER]
    rate, unit = RATE.search(head), COLUMNS.search(head)
    rows = read_numbers(text, asked, (4, 5), "id frame x y z")
    x, y = rows[:, 2:4].T / asked.a_metre(unit.group(1).lower() if unit else None)
    times = rows[:, 1] / asked.rate(_number(rate.group(1), asked) if rate else None)
    return tracks_of(asked, [identity(one) for one in rows[:, 0].tolist()], times, x, y, wanted)


def _number(text: str, asked: Asked) -> float:
    try:
        return float(text)
    except ValueError:
        raise asked.error(
            f"says that there are {shown(text)} frames a second; expected a number, such as 12.5."
        ) from None
