"""Client of the planner's process (:mod:`hpop.cli.live_planner`), which is started again if it crashes."""

from __future__ import annotations

import asyncio
import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

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

Handler = Callable[[dict[str, Any]], None]


class PlannerProcess:
    """Client of the planner's process, which it starts again after a crash.

    command  arguments of the process after the interpreter
    tell     called with each message of the process; also with {"type": "ready"} once its graph is built, and with
             {"type": "crashed"} when it has ended by itself
    """

    def __init__(self, scenario: Path, imports: Sequence[str], tell: Handler) -> None:
        self.command = [sys.executable, "-P", "-m", "hpop.cli.live_planner", str(scenario), *imports]
        self.tell = tell
        self.is_ready = False
        self.took, self._sent = 0.0, 0.0  # s, of the last answer; time of the last request
        self.pid: int | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._number = 0
        self._running = 0  # number of the request that is being answered; 0 for none
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
        """Send the request that has waited longest, if the process is free; pushes first."""
        process = self._process
        if self._running or not self._waiting or not self.is_ready or process is None or process.stdin is None:
            return
        urgent = next((i for i, (kind, _) in enumerate(self._waiting) if kind == "push"), 0)
        kind, given = self._waiting.pop(urgent)
        self._number += 1
        self._running, self._sent = self._number, time.monotonic()
        values = {name: value() if callable(value) else value for name, value in given.items()}
        with suppress(OSError, RuntimeError):  # it is about to be seen that the process has ended
            process.stdin.write(json.dumps({"id": self._number, "kind": kind, **values}).encode() + b"\n")

    async def run(self) -> None:
        """Keep a process running until this task is cancelled."""
        loop, crashes = asyncio.get_running_loop(), 0
        try:
            while True:
                began = loop.time()
                await self._one()
                crashes = 1 if loop.time() - began > STEADY else crashes + 1
                self.tell({"type": "crashed"})
                await asyncio.sleep(PAUSES[min(crashes, len(PAUSES)) - 1])
        finally:
            self._end()

    async def _one(self) -> None:
        """Start a process, and hand on its messages until it ends."""
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
                    self._running, self.took = 0, time.monotonic() - self._sent
                else:
                    self.tell(message)
                self._next()
        finally:
            self.is_ready, self._running = False, 0
            self._waiting.clear()
            self._end()
            await process.wait()

    def _end(self) -> None:
        if self._process is not None and self._process.returncode is None:
            with suppress(ProcessLookupError):
                self._process.kill()
