"""A session as pages see it: from the destination to the arrival, with two viewers and whoever should not be one."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from hpop.errors import OptionError
from hpop.live.record import read_record
from hpop.live.scene import video_origin
from hpop.live.server import LiveServer
from hpop.live.simulator import WATCHDOG, LiveRobot, SimulatorOptions
from hpop.live.viewer import BURST, MOST_BYTES, Audience, Viewer
from hpop.models import DifferentialDrive
from hpop.simulation import DriveLimits
from hpop.trajectories.trajectory import Trajectory
from tests.live.conftest import WAIT, Page, served


@pytest.fixture
def page(server: LiveServer) -> Iterator[Page]:
    page = Page(server.address())
    yield page
    page.close()
    while server.session.viewers:
        time.sleep(0.01)


def driven(page: Page) -> None:
    """Drive to a place in the room, until the robot moves."""
    page.until("state")  # after the messages of before
    page.say("go")
    page.say("destination", x=6.0, y=4.0)
    page.until("place", lambda place: place["status"] == "reachable")
    options = page.until("options", lambda options: options["present"] is None)
    page.say("take", option=options["cards"][0]["option"], asked=options["asked"])
    page.until("taken")
    page.until("state", lambda state: state["moving"])


def test_a_page_chooses_takes_pushes_and_stops(server: LiveServer, page: Page) -> None:
    scene = page.until("scene")
    assert (scene["role"], [c["name"] for c in scene["criteria"]]) == (
        "drive",
        ["obstruction", "exposure", "turns", "length"],
    )
    page.say("destination", x=6.0, y=4.0)
    assert page.until("place")["status"] == "reachable"
    options = page.until("options")
    page.say("take", option=options["cards"][0]["option"])
    assert page.until("taken")["by"] == "choice"
    page.until("state", lambda state: state["moving"] and state["x"] > 1.05)
    page.say("push", direction=0.5)
    assert page.until("pushed")["milliseconds"] < 5000
    page.say("stop")
    first = page.until("state", lambda state: not state["moving"])
    assert first["braked"] == "stopped"
    page.say("why", x=4.0, y=4.5)
    assert page.until("why")["sentence"]


def test_a_stopped_robot_drives_on_only_with_a_way_that_is_taken(server: LiveServer, page: Page) -> None:
    page.until("scene")
    driven(page)
    page.say("stop")
    page.until("state", lambda state: not state["moving"])
    page.say("take", option=9999)
    page.until("refused")
    assert page.until("state")["braked"] == "stopped"
    page.say("take", option=0, asked=-1)
    assert "not offered any more" in page.until("refused")["words"]
    page.say("destination", x=6.0, y=1.0)
    page.say("take", option=page.until("options")["cards"][0]["option"])
    page.until("taken")
    page.until("state", lambda state: state["moving"])


def test_a_second_hello_is_refused(page: Page) -> None:
    page.until("scene")
    page.say("hello", role="watch")
    page.until("refused")
    page.say("stop")
    page.until("state", lambda state: state["braked"] == "stopped")
    assert not any(message["type"] == "scene" for message in page.told[1:])


def test_watchers_leave_room_for_a_driver_and_a_session_that_fails_ends_its_server() -> None:
    class Fails(Audience):
        async def run(self) -> None:
            raise RuntimeError("disk full")

    session = Fails({"title": ""})
    while session.join(may_drive=False):
        pass
    assert session.join(may_drive=True)
    with LiveServer(session) as server, ThreadPoolExecutor(1) as pool:  # the main thread may have a browser's loop
        ended = pool.submit(server.serve_forever)
        with pytest.raises(RuntimeError, match="disk full"):
            ended.result(WAIT)


@pytest.mark.proof
def test_a_crash_of_the_planner_is_told_and_the_drive_can_go_on(server: LiveServer, page: Page) -> None:
    page.until("scene")
    driven(page)
    page.say("close", corners=[[6.5, 0.2], [6.8, 0.2], [6.8, 0.5]], name="a corner")
    page.until("closed", lambda message: message["names"] == ["a corner"])
    os.kill(server.session.planner.pid or 0, signal.SIGKILL)
    page.until("note", lambda message: "is started again" in message["words"])
    page.until("state", lambda state: state["braked"] == "stopped")
    first = page.until("state", lambda state: not state["moving"])
    page.say("go")
    page.until("note", lambda message: "choose a way to go on" in message["words"])
    page.until("closed", lambda message: message["names"] == ["a corner"])
    again = page.until("options")
    assert again["commit"]["x"] == pytest.approx(first["x"], abs=0.01)
    still = page.until("state")
    assert (still["x"], still["y"]) == pytest.approx((first["x"], first["y"]), abs=1e-3)
    page.say("take", option=0)
    page.until("state", lambda state: state["moving"])


@pytest.mark.proof
def test_a_planner_that_hangs_is_ended_and_started_again(server: LiveServer, page: Page) -> None:
    page.until("scene")
    planner = server.session.planner
    page.say("stop")
    page.until("state", lambda state: not state["moving"])
    while planner.is_busy:
        time.sleep(0.02)
    planner.limit, pid = 1.0, planner.pid or 0
    os.kill(pid, signal.SIGSTOP)
    page.say("destination", x=6.0, y=4.0)
    page.until("note", lambda message: "did not answer" in message["words"])
    planner.limit = WAIT
    page.until("options")
    assert planner.pid != pid


DIES = """\
import os
from dataclasses import dataclass

import hpop
from hpop.live.planner import LivePlanner

@hpop.criterion("nothing", group="R", unit="1", aggregate="sum")
@dataclass(frozen=True)
class Nothing:
    def cost(self, motions):
        return 0.0 * motions.duration

before = LivePlanner._offer_goal

def offer(self, now, pose):
    if self.goal.place["y"] == 1.0:
        os._exit(3)
    return before(self, now, pose)

LivePlanner._offer_goal = offer
"""


@pytest.mark.proof
def test_a_destination_that_ends_the_planner_twice_is_dropped(tmp_path: Path) -> None:
    (tmp_path / "dies.py").write_text(DIES)
    with served(tmp_path, imports=[str(tmp_path / "dies.py")]) as server:
        page = Page(server.address())
        page.until("note", lambda message: message["words"] == "the map is prepared")
        page.say("destination", x=6.0, y=1.0)
        page.until("note", lambda message: "ended the planner twice" in message["words"])
        page.until("note", lambda message: message["words"] == "the map is prepared")
        page.say("destination", x=6.0, y=4.0)
        page.until("options")
        page.close()
    ends = [event for event in read_record(server.session.record.path) if "is started again" in str(event)]
    assert len(ends) == 2


def test_a_page_that_does_not_say_hello_is_sent_away(server: LiveServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "greeting", 0.3)
    with connect(server.address().replace("http", "ws", 1) + "socket") as silent:
        silent.send('{"type": "alive"}')
        with pytest.raises(ConnectionClosed, match="did not say hello"):
            silent.recv(timeout=WAIT)


def test_what_waits_for_a_viewer_is_bounded_in_bytes_and_one_large_message_is_let_through() -> None:
    viewer, large = Viewer(1, may_drive=False), {"type": "note", "words": "x" * MOST_BYTES}
    viewer.send(large)
    assert not viewer.gone
    viewer.next_text()
    for _ in range(3):
        viewer.send({"type": "note", "words": "x" * (MOST_BYTES // 2 - 100)})
    assert (viewer.gone, len(viewer.waiting)) == ("reads too slowly", 2)


def test_a_simulated_base_that_nobody_commands_brakes_by_itself() -> None:
    """As after Ctrl-Z of the server: the pause may be long, the way is that of the watchdog and of braking."""
    model = DifferentialDrive(radius=0.2)
    robot = LiveRobot.simulated(model, (0.0, 0.0, 0.0), SimulatorOptions())
    robot.follow(Trajectory.from_poses(model, [(0, 0, 0), (50, 0, 0)]), 0.0, arrives=True)
    for i in range(201):
        robot.advance(0.02 * i, brakes=False)
    before, v = robot.pose[0], robot.base.velocity.v
    assert v == pytest.approx(DriveLimits.of(model).speed, rel=1e-3)
    robot.advance(60.0, brakes=False)
    least = v * WATCHDOG + v**2 / (2.0 * DriveLimits.of(model).acceleration)
    assert robot.pose[0] - before == pytest.approx(least, rel=1e-6)
    assert robot.stands


def test_the_robot_brakes_when_the_driver_is_silent_and_the_next_viewer_drives(server: LiveServer, page: Page) -> None:
    page.until("scene", lambda scene: scene["role"] == "drive")
    other = Page(server.address())
    watcher = Page(server.address(drives=False))
    assert other.until("scene")["role"] == watcher.until("scene")["role"] == "watch"
    other.say("go")
    assert "another viewer drives" in other.until("refused")["words"]
    page.silent()
    page.until("state", lambda state: state["braked"] == "nobody drives")
    page.close()
    assert other.until("scene")["role"] == "drive"
    other.until("state", lambda state: state["braked"] == "stopped")
    other.close()
    watcher.until("state", lambda state: state["braked"] == "nobody drives")
    watcher.close()


BAD = ["[]", "{", "[" * 20_000, '{"type": "take", "option": -1}', '{"type": "push", "direction": NaN}',
       '{"type": "destination", "x": 1}', '{"type": "no such"}', '{"type": "close", "corners": [[0, 0]]}']  # fmt: skip


def test_bad_messages_are_refused_three_a_second_and_the_page_stays_connected(page: Page) -> None:
    page.until("scene")
    for text in BAD:
        page.socket.send(text)
    for _ in range(3):
        page.until("refused")
    page.say("stop")
    page.until("state", lambda state: state["braked"] == "stopped")
    assert 3 <= sum(message["type"] == "refused" for message in page.told) <= 5


def test_floods_large_messages_and_pages_of_others_are_sent_away(server: LiveServer, page: Page) -> None:
    address = server.address()
    for wrong, headers in (
        (address.replace(server.token, "no-such-token"), {}),
        (address, {"Origin": "https://evil.example"}),
        (address, {"Host": "evil.example"}),
    ):
        with pytest.raises(InvalidStatus):
            Page(wrong, additional_headers=headers)
    flood = Page(server.address(drives=False))
    with suppress(ConnectionClosed):
        for _ in range(50 * int(BURST)):
            flood.say("alive")
    with pytest.raises(ConnectionClosed):
        flood.until("arrived")
    large = Page(server.address(drives=False))
    large.socket.send(json.dumps({"type": "wish", "wish": "x" * 10**6}))
    with pytest.raises(ConnectionClosed):
        large.until("arrived")
    page.say("stop")
    page.until("state", lambda state: state["braked"] == "stopped")


def test_the_record_has_what_was_said_and_told_in_order(server: LiveServer, page: Page) -> None:
    page.until("scene")
    page.say("wish", wish="fewer cats")
    page.until("refused")
    events = read_record(server.session.record.path)
    assert events[0]["schema"] == "hpop-live-record"
    assert [event["at"] for event in events] == sorted(event["at"] for event in events)
    assert {"hello", "destination", "take", "push", "stop", "plan", "told", "state"} <= {e["event"] for e in events}
    states = [event["t"] for event in events if event["event"] == "state"]
    assert max(after - before for before, after in pairwise(states)) < 1.0


@pytest.mark.parametrize(
    "address",
    ["robot:8080", "ftp://robot/a", "http://", "http://a;b/", "http://a:x/", "http://user@robot/", "http://a'b/"],
)
def test_a_video_has_an_address_that_names_one_origin(address: str) -> None:
    assert video_origin("http://robot:8080/stream?key=1") == "http://robot:8080"
    assert video_origin("https://[fe80::1]/a") == "https://[fe80::1]"
    with pytest.raises(OptionError, match="video must be the address"):
        video_origin(address)
