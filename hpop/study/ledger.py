"""The answers of one participant on the disk, to which events are added one at a time; none is changed or removed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hpop.errors import StudyError
from hpop.study import documents
from hpop.study.design import Design
from hpop.study.session import MOST_BYTES, MOST_EVENTS, SCHEMA, VERSION, AnswersFile, Session

WHAT = "the answers of a participant"


@dataclass(frozen=True)
class Ledger:
    """A file of answers, which may not be there yet. What is on the disk is always a whole file that can be read.

    path         of the file
    design
    participant  id
    """

    path: Path
    design: Design
    participant: str

    @property
    def events(self) -> list[dict[str, Any]]:
        """All events so far, as the file has them; StudyError for a file that is none, or of another design."""
        return list(self._stored()["events"])

    def add(self, event: Mapping[str, Any], device: Mapping[str, Any]) -> bool:
        """Add an event; False for the last one come again, which its sender did not hear had arrived.

        Raises StudyError for an event that the design does not ask for or that is not later than the last one, and
        where it cannot be written; the file is then as it was.
        """
        stored = self._stored()
        events = stored["events"]
        if events and dict(event) == events[-1]:
            return False
        if len(events) >= MOST_EVENTS:
            raise StudyError(f"a session has at most {MOST_EVENTS:,} events; this one has them")
        longer = {**stored, "device": dict(device), "events": [*events, dict(event)]}
        checked = documents.checked("what was sent", longer, AnswersFile, WHAT)
        Session.of(checked, self.design)
        if len(checked.events) > 1 and checked.events[-1].t <= checked.events[-2].t:
            raise StudyError(f"time must rise: {checked.events[-1].t:g} s comes after {checked.events[-2].t:g} s")
        documents.write(self.path, longer)
        return True

    def _stored(self) -> dict[str, Any]:
        """The contents of the file, checked; those of a new one where there is none."""
        if not self.path.exists():
            known = {"schema": SCHEMA, "version": VERSION, "design": self.design.digest}
            return {**known, "participant": self.participant, "device": {}, "events": []}
        data = documents.parsed(self.path, documents.read_bytes(self.path, MOST_BYTES), WHAT)
        session = Session.of(documents.checked(self.path, data, AnswersFile, WHAT), self.design)
        if session.person.id != self.participant:
            raise StudyError(f"{self.path} holds answers of {session.person.id}; give it that name")
        found: dict[str, Any] = data
        return found
