"""Tracks as PeTrack writes them (Boltes and Seyfried, Neurocomputing 100, 2013; also the pedestrian data archive).

Text: comments with the frame rate, such as ``# framerate: 25 fps``, then a row a person and frame, ``id frame x y z``,
separated by blanks. The unit stands in the comment with the names of the columns (``x/cm``); without one it is m.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence

from hpop.world.tracks.columns import HEAD, comments_of, titled
from hpop.world.tracks.numbers import read_numbers
from hpop.world.tracks.table import Asked, Tracks, identity, tracks_of

COLUMNS = re.compile(r"^#.*\bx\s*[/\[(]\s*(mm|cm|m)\b", re.IGNORECASE | re.MULTILINE)
ORDER = ("id", "frame", "x", "y")


def is_petrack(text: str, asked: Asked) -> bool:
    """Whether a file begins as PeTrack's do: with comments and a row of numbers separated by blanks."""
    rows = [line for line in text[:HEAD].splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not text.lstrip().startswith("#") or not rows or "," in rows[0] or len(rows[0].split()) not in (4, 5):
        return False
    titles = comments_of(text, asked).titles
    return not titles or tuple(titled(titles, asked).places) == ORDER


def tracks(text: str, asked: Asked, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks by id; MapError for what is no such file."""
    unit, rate = COLUMNS.search(text[:HEAD]), comments_of(text, asked).rate
    rows = read_numbers(text, asked, (4, 5), "id frame x y z")
    x, y = rows[:, 2:4].T / asked.a_metre(unit.group(1).lower() if unit else None)
    times = rows[:, 1] / asked.rate(rate)
    return tracks_of(asked, [identity(one) for one in rows[:, 0].tolist()], times, x, y, wanted)
