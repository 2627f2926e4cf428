"""Record of a live session: a file with one JSON object a line, written at once.

Each line has ``at`` (a whole number: ms since 1970, UTC), ``t`` (s since the session began), ``event`` (its name), and
the values of this event. A killed process loses no line that was written. The last line may be incomplete; reading a
record leaves an incomplete last line out.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hpop.errors import OutputError

SCHEMA, VERSION = "hpop-live-record", 1


def state_of(
    t: float, pose: Sequence[float], people: Iterable[Sequence[float]], *, moving: bool, **more: Any
) -> dict[str, Any]:
    """Return the message "state" at time ``t``, s: pose of the robot, whether it moves, people, and values ``more``."""
    place = dict(zip(("x", "y", "theta"), (round(value, 4) for value in pose), strict=True))
    around = [[round(value, 3) for value in person] for person in people]
    return {"type": "state", "at": utc(), "t": round(t, 3), **place, "moving": moving, "people": around, **more}


def utc() -> int:
    """Return the present time, ms since 1970, UTC."""
    return time.time_ns() // 1_000_000


class Record:
    """File to which the events of a session are appended; OutputError if it cannot be written."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file: int | None = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except OSError as error:
            raise OutputError(
                f"the record cannot be written to {path}: {error.strerror or error}; choose another --out"
            ) from None
        self.add(0.0, "session", {"schema": SCHEMA, "version": VERSION, **about})

    def add(self, t: float, event: str, values: Mapping[str, Any]) -> None:
        """Append an event at ``t``, s; it is written when this returns. After :meth:`close` nothing is appended."""
        if self._file is None:
            return
        line = json.dumps({"at": utc(), "t": round(t, 3), "event": event, **values}, separators=(",", ":"))
        os.write(self._file, line.encode() + b"\n")

    def close(self) -> None:
        """Close the file; what comes later is not recorded."""
        if self._file is not None:
            os.close(self._file)
        self._file = None


def read_record(path: Path) -> list[dict[str, Any]]:
    """Return the events of a record; OutputError for any other file."""
    try:
        lines = path.read_bytes().split(b"\n")
    except OSError as error:
        raise OutputError(f"the record {path} cannot be read: {error.strerror or error}; check the path") from None
    events = []
    for i, line in enumerate(lines):
        try:
            events.append(json.loads(line))
        except ValueError:
            if i < len(lines) - 1:
                raise OutputError(f"{path}, line {i + 1}: expected JSON; give the record of a live session") from None
    if not events or not isinstance(events[0], dict) or events[0].get("schema") != SCHEMA:
        raise OutputError(f"{path} is not the record of a live session; give a file that `hpop live` wrote")
    return events
