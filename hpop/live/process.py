"""Client of the planner's process (:mod:`hpop.cli.live_planner`), which is started again if it crashes."""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

LONGEST = 64 * 2**20
"""Largest size of a message, bytes."""
PAUSES = (0.1, 0.5, 2.0, 10.0)
"""Times, s, before the first and further restarts after crashes in a row."""
STEADY = 60.0
"""Time, s, after which a crash counts as the first again."""
KEPT = ("close", "open")
"""Kinds of requests that are all sent: a newer one does not replace an older one that waits."""
MOST_WAITING = 64
"""Requests that may wait."""
MOST_SECONDS = 60.0
"""Time, s, after which a process that has not answered a request is ended, and another one is started."""

Handler = Callable[[dict[str, Any]], None]


class _Running(NamedTuple):
    """A request that is being answered: whether it is a push, when it was sent, and what ends a process that hangs."""

    is_push: bool
    sent: float
    watch: asyncio.TimerHandle


class PlannerProcess:
    """Client of the planner's process, which it starts again after a crash, or if it does not answer.

    command  arguments of the process after the interpreter
    tell     called with each message of the process; also with {"type": "ready"} once its graph is built, and with
             {"type": "crashed", "hung": ...} when it has ended by itself, or was ended as it did not answer
    limit    s, after which a request counts as not answered
    """

    def __init__(self, scenario: Path, imports: Sequence[str], tell: Handler, limit: float = MOST_SECONDS) -> None:
        self.command = [sys.executable, "-P", "-m", "hpop.cli.live_planner", str(scenario), *imports]
        self.tell, self.limit = tell, limit
        self.is_ready, self._hangs = False, False
        self.took = 0.0  # s, of the last answer
        self.pid: int | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._number = 0
        self._running = dict[int, _Running]()  # requests that are being answered, by number
        self._waiting: list[tuple[str, dict[str, Any]]] = []

    @property
    def is_busy(self) -> bool:
        """Return whether a request is being answered, or waits."""
        return bool(self._running or self._waiting)

    def ask(self, kind: str, **values: Any) -> None:
        """Send a request once those before it are answered; an older one of its kind that still waits is dropped.

        Values that are functions are called as the request is sent. Changes of areas are not dropped, unless
        `MOST_WAITING` wait.
        """
        if kind not in KEPT:
            self._waiting = [waiting for waiting in self._waiting if waiting[0] != kind]
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append((kind, values))
        self._next()

    def _next(self) -> None:
        """Send the push and the other request that have waited longest, each unless one like it is being answered.

        At most one push and one other request are under way: the process answers a push beside the other if it can.
        """
        process = self._process
        if not self.is_ready or process is None or process.stdin is None:
            return
        for kind, given in [*self._waiting]:
            if any((kind == "push") == each.is_push for each in self._running.values()):
                continue
            self._waiting.remove((kind, given))
            self._number += 1
            watch = asyncio.get_running_loop().call_later(self.limit, self._hung)
            self._running[self._number] = _Running(kind == "push", time.monotonic(), watch)
            values = {name: value() if callable(value) else value for name, value in given.items()}
            with suppress(OSError, RuntimeError):  # the process has ended, which `_one` will notice
                process.stdin.write(json.dumps({"id": self._number, "kind": kind, **values}).encode() + b"\n")

    def _done(self, number: int) -> None:
        """Forget a request that is answered."""
        request = self._running.pop(number)
        request.watch.cancel()
        if not request.is_push:
            self.took = time.monotonic() - request.sent

    def _hung(self) -> None:
        self._hangs = True
        self._end()

    async def run(self) -> None:
        """Keep a process running until this task is cancelled."""
        loop, crashes = asyncio.get_running_loop(), 0
        try:
            while True:
                began = loop.time()
                await self._one()
                crashes = 1 if loop.time() - began > STEADY else crashes + 1
                self.tell({"type": "crashed", "hung": self._hangs})
                await asyncio.sleep(PAUSES[min(crashes, len(PAUSES)) - 1])
        finally:
            self._end()

    async def _one(self) -> None:
        """Start a process, and hand on its messages until it ends."""
        self._hangs = False
        self._process = process = await asyncio.create_subprocess_exec(
            *self.command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            limit=LONGEST,
            start_new_session=True,  # Ctrl-C on the terminal does not reach it
        )
        self.pid = process.pid
        assert process.stdout is not None
        try:
            while line := await process.stdout.readline():
                message = json.loads(line)
                if message["type"] == "ready":
                    self.is_ready = True
                if message["type"] == "done":
                    self._done(message["id"])
                else:
                    self.tell(message)
                self._next()
        finally:
            self.is_ready = False
            for request in self._running.values():
                request.watch.cancel()
            self._running.clear()
            self._waiting.clear()
            self._end()
            await process.wait()

    def _end(self) -> None:
        if self._process is not None and self._process.returncode is None:
            with suppress(ProcessLookupError):
                self._process.kill()
