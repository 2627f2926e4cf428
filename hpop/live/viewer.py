"""Viewers of a live session: pages that are connected, with bounds on what they send and on what waits for them."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hpop.live.messages import checked

MOST_WAITING = 256
"""Messages that may wait for a viewer; one who reads more slowly is sent away."""
MOST_BYTES = 16 * 2**20
"""Bytes that may wait for a viewer; a message larger than that is sent alone."""
MOST_MESSAGES, BURST = 60.0, 120.0
"""Messages a second that a viewer may send in the long run, and messages that it may send at once."""
MOST_REFUSALS = 3.0
"""Refusals a second that a viewer is sent."""
MOST_VIEWERS = 32
"""Viewers who may drive. As many again may only watch; they are counted apart, so that they keep no driver out."""
KEPT = ("place", "options", "taken")
"""Types of messages of which a viewer who comes later is sent the newest."""


class Viewer:
    """A page that is connected: its outgoing messages, and its bounds.

    may_drive   whether its token lets it drive
    wants       whether it asked to drive
    greeted     whether it has said hello
    alive       s, time of the session at which it last said "hello" or "alive"
    seen        whether it was sent the scene
    gone        why it is sent away; "" while it is not
    """

    def __init__(self, number: int, *, may_drive: bool) -> None:
        self.number, self.may_drive, self.wants, self.greeted = number, may_drive, False, False
        self.alive, self.gone, self.seen = -math.inf, "", False
        self.waiting: deque[str] = deque()
        self._bytes = 0
        self.state = ""
        self.wakes = asyncio.Event()
        self._budget, self._refusals, self._counted = BURST, MOST_REFUSALS, time.monotonic()

    def send(self, message: Mapping[str, Any]) -> None:
        """Queue a message; a newer state replaces one that still waits."""
        text = json.dumps(message, allow_nan=False, separators=(",", ":"))
        if message["type"] == "state":
            self.state = text
        elif len(self.waiting) < MOST_WAITING and (not self.waiting or self._bytes + len(text) <= MOST_BYTES):
            self.waiting.append(text)
            self._bytes += len(text)
        else:
            self.gone = "reads too slowly"
        self.wakes.set()

    def next_text(self) -> str:
        """Remove and return the message that waits longest: as JSON, which is ASCII."""
        text = self.waiting.popleft()
        self._bytes -= len(text)
        return text

    def counts(self) -> bool:
        """Count a message that came; return whether the viewer keeps to `MOST_MESSAGES` and `BURST`."""
        now = time.monotonic()
        passed, self._counted = now - self._counted, now
        self._budget = min(BURST, self._budget + passed * MOST_MESSAGES) - 1.0
        self._refusals = min(MOST_REFUSALS, self._refusals + passed * MOST_REFUSALS)
        return self._budget >= 0.0

    def refuse(self, words: str) -> None:
        """Send the viewer why its message was refused, but at most `MOST_REFUSALS` times a second."""
        if self._refusals >= 1.0:
            self._refusals -= 1.0
            self.send({"type": "refused", "words": words})


class Audience:
    """The viewers of a session, who are told what happens; a subclass does what they ask for.

    scene   message "scene" without the role
    newest  newest message of each type of `KEPT`
    record_path  file in which the session is recorded; None if it is not
    """

    record_path: Path | None = None

    def __init__(self, scene: Mapping[str, Any]) -> None:
        self.scene = dict(scene)
        self.viewers: list[Viewer] = []
        self.newest: dict[str, Mapping[str, Any]] = {}
        self._numbers, self._began = 0, 0.0

    @property
    def now(self) -> float:
        """Time of the session, s."""
        return asyncio.get_running_loop().time() - self._began

    def begin(self) -> None:
        """Let the time of the session begin."""
        self._began = asyncio.get_running_loop().time()

    async def run(self) -> None:
        """Hold the session until this task is cancelled."""
        raise NotImplementedError

    async def explorer(self) -> dict[str, Any] | None:
        """Return the data of the explorer's page for the front of the ways that were offered last; None for none."""
        return None

    def join(self, *, may_drive: bool) -> Viewer | None:
        """Return a new viewer; None if there are too many."""
        if sum(viewer.may_drive == may_drive for viewer in self.viewers) >= MOST_VIEWERS:
            return None
        self._numbers += 1
        viewer = Viewer(self._numbers, may_drive=may_drive)
        self.viewers.append(viewer)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """Forget a viewer who has gone."""
        self.viewers.remove(viewer)

    def tell(self, message: Mapping[str, Any]) -> None:
        """Send a message to all viewers who have said hello."""
        if message["type"] in KEPT:
            self.newest[message["type"]] = message
        for viewer in self.viewers:
            if viewer.greeted:
                viewer.send(message)

    def note(self, words: str) -> None:
        """Send a note to all viewers."""
        self.tell({"type": "note", "words": words})

    def receive(self, viewer: Viewer, text: str) -> None:
        """Check a message of a viewer, and act on it."""
        now = self.now
        if not viewer.counts():
            viewer.gone = "sends too many messages"
            viewer.wakes.set()
            return
        try:
            kind, values = checked(json.loads(text))
        except RecursionError:
            viewer.refuse("expected JSON that is not nested")
        except ValueError as error:
            viewer.refuse("expected JSON" if isinstance(error, json.JSONDecodeError) else str(error))
        else:
            if kind == "alive":
                viewer.alive = now
            elif kind == "hello" and viewer.greeted:  # the scene is large
                viewer.refuse("hello was said already; connect anew for another role")
            elif kind == "hello":
                viewer.greeted, viewer.wants, viewer.alive = True, values["role"] == "drive", now
                self.greet(viewer)
            elif viewer.greeted:
                self.act(viewer, kind, values)
            else:
                viewer.refuse("say hello first")

    def greet(self, viewer: Viewer) -> None:
        """Send the scene and the messages of `newest` to a viewer who has said hello."""
        viewer.send(self.scene_for(viewer))
        viewer.seen = True
        for message in self.newest.values():
            viewer.send(message)

    def scene_for(self, viewer: Viewer) -> dict[str, Any]:
        """Return the message "scene" for a viewer, with the role."""
        return {**self.scene, "role": "watch", "settings": {}}

    def act(self, viewer: Viewer, kind: str, values: dict[str, Any]) -> None:
        """Do what a viewer asks for; by default nothing is done for those who watch."""
        if kind != "head":
            viewer.refuse("this page watches")


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
