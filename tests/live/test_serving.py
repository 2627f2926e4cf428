"""Serving of sessions: tokens that stay, other machines over https, a crowd, and slow readers."""

from __future__ import annotations

import asyncio
import hashlib
import json
import math
import os
import signal
import ssl
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread

import pytest
from click.testing import Result
from websockets.exceptions import ConnectionClosed, WebSocketException

from hpop.cli.living import server_of
from hpop.errors import MapError, OptionError
from hpop.live.server import LiveServer
from hpop.live.viewer import Audience
from tests.cli.conftest import run as run  # a fixture
from tests.live.conftest import ROOM, WAIT, Page

TOKEN = "a-secret-of-the-room"
LARGE = "x" * 2**20


@contextmanager
def command(folder: Path, *options: str) -> Iterator[dict[str, str]]:
    """Run `hpop live`, and yield its first lines as a dictionary."""
    (folder / "room.yaml").write_text(ROOM)
    words = [sys.executable, "-P", "-m", "hpop", "live", "room.yaml", "--port", "0", *options]
    environment = os.environ | {"HPOP_LIVE_TOKEN": TOKEN}
    with subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines = [process.stdout.readline().strip() for _ in range(4 if "--network" in options else 3)]
        try:
            yield {key: words for key, _, words in (line.partition(": ") for line in lines)}
        finally:
            process.send_signal(signal.SIGINT)
            process.stdout.read()


@pytest.mark.proof
def test_tokens_stay_over_a_restart_and_another_machine_connects_over_https(tmp_path: Path) -> None:
    with command(tmp_path, "--out", "a") as first:
        pass
    with command(tmp_path, "--out", "b", "--network") as told:
        paths = [{key: words[key].split("/")[3] for key in ("drive", "watch")} for words in (first, told)]
        assert paths[0] == paths[1]
        assert paths[0]["drive"] == TOKEN != paths[0]["watch"]
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        page = Page(told["drive"], ssl=context)
        assert told["drive"].startswith("https://")
        assert page.until("scene")["role"] == "drive"
        der = page.socket.socket.getpeercert(binary_form=True)
        (line,) = (key for key in told if key.startswith("the browser warns"))
        assert hashlib.sha256(der).hexdigest().upper() == line.split()[-1].replace(":", "")
        page.close()
        plain = told["drive"].replace("https", "http")
        with pytest.raises((WebSocketException, OSError)):
            Page(plain)


def test_short_tokens_and_options_of_another_robot_are_refused(run: Callable[..., Result], tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(ROOM)
    for options, words in (
        (
            ("--token", "short"),
            "--token must have 12 to 100 letters (a to z, A to Z), digits, - and _, got 5 characters;",
        ),
        (("--token", "open, sesame"), "got 12 characters, 2 of them not allowed; choose a random one"),
        (("--map-topic", "/map"), "--map-topic is for a robot over rosbridge"),
        (("--robot", "ws://localhost:9", "--crowd", "3"), "--crowd is for the simulated robot"),
        (("--robot", "localhost:9090"), "url must be the address of a bridge"),
        (("--video", "camera"), "video must be the address"),
    ):
        result = run("live", tmp_path / "room.yaml", "--out", tmp_path / "out", "--port", "0", *options)
        assert result.exit_code == OptionError.exit_code
        assert words in " ".join(result.stderr.split())


def test_a_crowd_walks_about_in_place_of_the_people_of_the_scenario(tmp_path: Path) -> None:
    pytest.importorskip("jupedsim")
    (tmp_path / "room.yaml").write_text(ROOM + "people: [{waypoints: [[0, 6, 1], [9, 6, 4]]}]\n")
    with server_of(tmp_path / "room.yaml", tmp_path / "out", (), {"crowd": 2}) as server:
        pedestrians, robot = server.session._pedestrians, (1.0, 1.0, 0.0)
        begin = pedestrians.advance(0.0, robot)
        for i in range(1, 201):
            people = pedestrians.advance(0.02 * i, robot)
            assert all(math.dist(person[:2], robot[:2]) > 0.25 + pedestrians.radius for person in people)
        assert len(people) == 2
        assert all(math.dist(a[:2], b[:2]) > 0.3 for a, b in zip(begin, people, strict=True))
    with pytest.raises(MapError, match="1000 people do not fit on the map"):  # placed before a session begins
        server_of(tmp_path / "room.yaml", tmp_path / "out", (), {"crowd": 1000})


class Telling(Audience):
    """A session that tells its viewers large notes once it is asked to."""

    def __init__(self) -> None:
        super().__init__({"type": "scene", "title": ""})
        self.tells = Event()

    async def run(self) -> None:
        self.begin()
        while not self.tells.is_set():
            await asyncio.sleep(0.01)
        for _ in range(40):
            self.note(LARGE)
            await asyncio.sleep(0.002)
        self.note("the last")
        await asyncio.Event().wait()


def test_a_viewer_who_does_not_read_is_sent_away_and_holds_up_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hpop.live.server.READS", 0.2)
    session = Telling()
    with LiveServer(session) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        slow, quick = (
            Page(server.address(drives=False), role="watch", max_queue=1, ping_interval=None, compression=None)
            for _ in range(2)
        )
        for page in (slow, quick):
            page.until("scene")
        session.tells.set()
        quick.until("note", lambda note: note["words"] == "the last")
        last = time.monotonic() + WAIT
        while len(session.viewers) > 1:
            assert time.monotonic() < last
            time.sleep(0.01)
        with pytest.raises(ConnectionClosed):
            slow.until("note", lambda note: note["words"] == "the last")
        assert sum(json.dumps(message).count(LARGE) for message in slow.told) < 40
        for page in (slow, quick):
            page.close()
        server.shutdown()
        thread.join()
