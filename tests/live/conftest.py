"""A live session that is really served, and pages that are connected with it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from hpop.cli.living import server_of
from hpop.live.server import LiveServer
from tests.worlds import TWO_WALLS

ROOM = TWO_WALLS.replace("step: 0.25", "step: 0.5")
WAIT = 20.0


class Page:
    """A page that says it is there, and keeps what it is told."""

    def __init__(self, address: str, role: str = "drive", **options: Any) -> None:
        url = address.replace("http", "ws", 1) + "socket"
        self._open = ExitStack()
        self.socket: ClientConnection = self._open.enter_context(connect(url, max_size=None, **options))
        self.told: list[dict[str, Any]] = []
        self._silent = Event()
        self.say("hello", role=role)
        Thread(target=self._live, daemon=True).start()

    def _live(self) -> None:
        while not self._silent.wait(0.1):
            try:
                self.say("alive")
            except Exception:
                return

    def silent(self) -> None:
        self._silent.set()

    def say(self, kind: str, **values: Any) -> None:
        self.socket.send(json.dumps({"type": kind, **values}))

    def until(self, kind: str, holds: Callable[[dict[str, Any]], bool] = lambda message: True) -> dict[str, Any]:
        """Wait for a message of a kind that satisfies a condition."""
        last = time.monotonic() + WAIT
        while time.monotonic() < last:
            message: dict[str, Any] = json.loads(self.socket.recv(timeout=WAIT))
            self.told.append(message)
            if message["type"] == kind and holds(message):
                return message
        raise AssertionError(f"no {kind}: {[str(m)[:200] for m in self.told if m['type'] != 'state'][-5:]}")

    def close(self) -> None:
        self.silent()
        self._open.close()


@contextmanager
def served(folder: Path, scenario: str = ROOM, imports: Sequence[str] = (), **robot: Any) -> Iterator[LiveServer]:
    file = folder / "room.yaml"
    file.write_text(scenario)
    with server_of(file, folder / "out", imports, robot) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[LiveServer]:
    with served(tmp_path_factory.mktemp("live")) as running:
        while not running.session.planner.is_ready:
            time.sleep(0.02)
        yield running
