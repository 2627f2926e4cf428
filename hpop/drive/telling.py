"""What a drive is told, in order of time, and the record of it."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from hpop.base.options import MOST, real
from hpop.drive.plan import SAME
from hpop.errors import DriveError
from hpop.frontier import strict_json


class Telling:
    """The record of what was told from a beginning on.

    begin   s, when the robot leaves
    record  what was told, as JSON
    """

    def __init__(self, begin: float) -> None:
        """Begin, with nothing told."""
        self.begin = real("begin", begin, -MOST, MOST, "a time in s", error=DriveError)
        self.record: list[dict[str, Any]] = []
        self._last = -np.inf  # s, when it was last told anything

    def _time(self, now: float) -> float:
        return float(real("now", now, -MOST, MOST, "a time in s", error=DriveError))

    def _in_order(self, now: float) -> float:
        """A time at which something is told or asked; DriveError where something was told later."""
        now = self._time(now)
        if now < self._last - SAME:
            raise DriveError(f"it was {self._last:.3f} s already, now it is {now:.3f} s: tell events in order of time")
        return max(now, self._last)

    def _told(self, now: float) -> float:
        """The same, and that it is told now."""
        self._last = self._in_order(now)
        return self._last

    def _now(self) -> float:
        """When it was last told anything, s."""
        return max(self._last, self.begin)

    def _note(self, event: str, now: float, **what: Any) -> None:
        """Write into the record."""
        told = json.dumps({"event": event, "now": now, **what}, allow_nan=False, default=strict_json.of_numpy)
        self.record.append(json.loads(told))


def deadline_of(seconds: float) -> float:
    """A deadline, s; DriveError for what is none."""
    return float(real("deadline", seconds, 0, MOST, "a time in s", error=DriveError))
