"""Markers of Lab Streaming Layer (LSL), which align a study's events with eye trackers, EEG and other devices.

LSL programs such as LabRecorder record the stream "hpop" with the others. Needs the extra ``lab`` (pylsl).
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from datetime import datetime
from typing import Any

from hpop.errors import StudyError

NAME, TYPE = "hpop", "Markers"
OLDEST = 3600.0
"""Largest age of an event, s, that is believed."""


class Markers:
    """Stream of text markers, one for each event of a session, at the time at which the event happened.

    A marker is a JSON object: participant, kind, at (UTC) and, if the event has them, place, condition, item and value.
    The ``samples`` of a value, such as those of a slider, are left out. Raises StudyError if pylsl is missing.
    """

    def __init__(self, source: str) -> None:
        try:
            import pylsl
        except (ImportError, RuntimeError) as error:  # RuntimeError: its library liblsl is missing
            raise StudyError(
                f"LSL markers need pylsl, which cannot be used ({error}): pip install 'hpop[lab]'"
            ) from None
        info = pylsl.StreamInfo(NAME, TYPE, 1, pylsl.IRREGULAR_RATE, pylsl.cf_string, source)
        self._clock = pylsl.local_clock
        self._outlet = pylsl.StreamOutlet(info)

    def push(self, participant: str, event: Mapping[str, Any], now: object = None) -> None:
        """Send an event; ``now`` is the time, ms, on the clock of the page that dated it, when it sent the event.

        Only the age of the event is taken from that clock, so the clock need not agree with this machine's.
        """
        sent = now / 1000.0 if isinstance(now, int | float) else time.time()
        age = sent - datetime.fromisoformat(str(event["at"])).timestamp()
        value = event.get("value")
        short = {name: part for name, part in value.items() if name != "samples"} if isinstance(value, dict) else value
        told = {name: event[name] for name in ("kind", "at", "place", "condition", "form", "item") if name in event}
        text = json.dumps({"participant": participant, **told, "value": short})
        self._outlet.push_sample([text], self._clock() - min(max(age, -1.0), OLDEST))
