"""Tracks as JuPedSim writes them from version 1.0 on: an SQLite database (https://www.jupedsim.org, sqlite writer).

Table ``trajectory_data`` has a row an agent and frame (frame, id, pos_x m, pos_y m), table ``metadata`` the frames a
second under the key ``fps``. Nothing of the database is run: triggers and views stay unread.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Hashable, Sequence
from contextlib import closing

import numpy as np

from hpop.base.text import shown
from hpop.world.tracks.table import MOST_ROWS, Asked, Tracks, identity, tracks_of

MAGIC = b"SQLite format 3\x00"
EXPECTED = "expected JuPedSim's tables trajectory_data (frame, id, pos_x, pos_y) and metadata (key, value), with fps"
LONGEST = 10_000  # bytes of a cell


def is_jupedsim(data: bytes) -> bool:
    """Whether a file is an SQLite database."""
    return data.startswith(MAGIC)


def tracks(data: bytes, asked: Asked, wanted: Sequence[Hashable] | None = None) -> Tracks:
    """Return tracks by id; MapError for a database that has none."""
    try:
        with closing(sqlite3.connect(":memory:")) as base:
            base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(LONGEST, len(data)))
            base.deserialize(data)
            base.execute("PRAGMA trusted_schema = OFF")
            known = {name for (name,) in base.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")}
            if lacking := {"trajectory_data", "metadata"} - known:
                raise asked.error(f"lacks the table {', '.join(sorted(lacking))}: {EXPECTED}.")
            said = base.execute("SELECT value FROM metadata WHERE key = 'fps'").fetchone()
            found = base.execute("SELECT id, frame, pos_x, pos_y FROM trajectory_data").fetchmany(MOST_ROWS + 1)
    except (sqlite3.Error, UnicodeDecodeError, MemoryError) as error:
        raise asked.error(f"cannot be read as SQLite ({error}): {EXPECTED}.") from None
    if not found:
        raise asked.error("has no rows: expected one a person and time.")
    try:
        rate = None if said is None else float(said[0])
        rows = np.array(found, dtype=np.float64)
    except (TypeError, ValueError):
        raise asked.error(f"has cells that are no numbers: {EXPECTED}.") from None
    if not np.isfinite(rows).all():
        raise asked.error(
            f"has cells that are no numbers, such as {shown(found[int(np.argmin(np.isfinite(rows).all(1)))])}."
        )
    a_metre = asked.a_metre("m")
    ids = [identity(one) for one in rows[:, 0].tolist()]
    return tracks_of(asked, ids, rows[:, 1] / asked.rate(rate), rows[:, 2] / a_metre, rows[:, 3] / a_metre, wanted)
