"""Replay of a live session from its record: viewers see what was told, at the times at which it was told."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence
from typing import Any

from hpop.live.viewer import Audience


class Replay(Audience):
    """A recorded session, which begins again when a viewer comes after its end.

    events  of the record (:func:`.record.read_record`)
    """

    def __init__(self, events: Sequence[Mapping[str, Any]]) -> None:
        super().__init__(events[0]["scene"])
        self.events = events[1:]
        self._comes = asyncio.Event()

    def greet(self, viewer: Any) -> None:
        """Send the scene to a viewer; the replay begins if it waited for one."""
        super().greet(viewer)
        self._comes.set()

    async def run(self) -> None:
        """Show the session until this task is cancelled; it begins when a viewer is there, and again after its end."""
        while True:
            self._comes.clear()
            if not any(viewer.greeted for viewer in self.viewers):
                await self._comes.wait()
            self.begin()
            self.newest.clear()
            for event in self.events:
                await asyncio.sleep(max(0.0, event["t"] - self.now))
                if (message := self._message(event)) is not None:
                    self.tell(message)
            self.note("the recorded session ends here; a viewer who comes now sees it from the beginning")
            self._comes.clear()
            await self._comes.wait()

    @staticmethod
    def _message(event: Mapping[str, Any]) -> Mapping[str, Any] | None:
        """Return the message that viewers got at an event of the record; None if they got none."""
        if event["event"] == "state":
            return {**event, "type": "state"}
        return event["message"] if event["event"] == "told" else None
