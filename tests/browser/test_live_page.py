"""The live page in a real browser, with the real server: choose, drive, push, ask, and come back after a break."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, WebSocket, expect

from hpop.cli.living import server_of
from hpop.live.server import LiveServer
from tests.browser.test_accessibility import AXE, VIOLATIONS

pytestmark = pytest.mark.proof  # a planner of its own and a browser: seconds each

START = (1.0, 1.0, 0.0)
EYE = 1.2
ROOM = f"""\
world:
  polygons:
    extent: [[0, 0], [7, 0], [7, 5], [0, 5]]
    obstacles:
      - {{corners: [[2.6, 1.7], [3.4, 1.7], [3.4, 3.4], [2.6, 3.4]], height: [0, 1]}}
landmarks:
  - {{x: 6.9, y: 2.5, z: 1.3, name: clock, facing: 180 deg}}
zones:
  - {{kind: speed, limit: 0.6, name: corridor, area: [[2.6, 0.0], [3.4, 0.0], [3.4, 1.7], [2.6, 1.7]]}}
model:
  differential_drive: {{radius: 0.25, camera_height: {EYE}}}
start: [{START[0]}, {START[1]}, {START[2]}]
goal: [6, 4, any]
criteria: [obstruction, turns, length]
planner:
  lattice: {{step: 0.5}}
"""


class Guest:
    """A viewer: a page, and the messages that it sent and received."""

    room = (7.0, 5.0)  # m

    def __init__(self, browser: Browser, address: str, size: tuple[int, int] = (800, 600), **context: Any) -> None:
        width, height = size
        self.sent: list[dict[str, Any]] = []
        self.told: list[dict[str, Any]] = []
        self.complaints: list[str] = []
        self.page: Page = browser.new_context(viewport={"width": width, "height": height}, **context).new_page()
        self.page.set_default_timeout(30_000)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("websocket", self._listen)
        self.page.goto(address)
        self.page.locator("html[data-ready=yes]").wait_for(state="attached")

    def _listen(self, socket: WebSocket) -> None:
        socket.on("framesent", lambda text: self.sent.append(json.loads(text)))
        socket.on("framereceived", lambda text: self.told.append(json.loads(text)))

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.told if message["type"] == kind]

    def asked(self, kind: str) -> list[dict[str, Any]]:
        return [message for message in self.sent if message["type"] == kind]

    def until(self, true: Callable[[], bool], seconds: float = 90.0) -> None:
        """Wait until something is true of the messages."""
        for _ in range(int(20 * seconds)):
            if true():
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"not within {seconds:g} s; the last messages: {self.told[-3:]}")

    def prepared(self) -> None:
        """Wait until the planner has built its graph."""
        self.until(lambda: any("is prepared" in note["words"] for note in self.of("note")))

    def on_map(self, x: float, y: float) -> tuple[float, float]:
        """Return the pixel of a place on the map, which shows the room with a margin of 0.3 m, as large as fits."""
        box = self.page.locator("#map").bounding_box()
        assert box is not None
        wide, tall = self.room
        scale = min(box["width"] / (wide + 0.6), box["height"] / (tall + 0.6))
        middle_x, middle_y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        return middle_x + scale * (x - wide / 2), middle_y - scale * (y - tall / 2)

    def in_view(self, ahead: float, left: float, up: float) -> tuple[float, float]:
        """Return the pixel at which the camera sees a point, m, relative to the camera; it sees 1.2 rad."""
        box = self.page.locator("#seen").bounding_box()
        assert box is not None
        half = math.tan(0.6)
        tall = max(half, math.tan(1.15 / 2) * box["height"] / box["width"])
        scale = box["height"] / 2 / tall
        return box["x"] + box["width"] / 2 - scale * left / ahead, box["y"] + box["height"] / 2 - scale * up / ahead

    def choose(self, x: float, y: float) -> None:
        """Click on the map, and wait for the ways."""
        before = len(self.of("options"))
        self.page.mouse.click(*self.on_map(x, y))
        self.until(lambda: len(self.of("options")) > before)

    def close(self) -> None:
        self.page.context.close()


@contextmanager
def served(folder: Path, scenario: str = ROOM, port: int = 0, crowd: int = 0) -> Iterator[LiveServer]:
    """Serve a session from a thread."""
    file = folder / "room.yaml"
    file.write_text(scenario)
    tokens = {"driving": "driver", "watching": "watcher"}
    with server_of(file, folder / "out", (), {"crowd": crowd}, port=port, **tokens) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@pytest.fixture
def enter(browser: Browser) -> Iterator[Callable[..., Guest]]:
    """Let viewers in, whose pages must see no error."""
    guests: list[Guest] = []

    def one(address: str, **how: Any) -> Guest:
        guests.append(Guest(browser, address, **how))
        return guests[-1]

    yield one
    for guest in guests:
        guest.close()
        assert guest.complaints == []


Enter = Callable[..., Guest]


def test_a_viewer_chooses_on_the_map_takes_a_way_and_arrives_while_another_watches(
    tmp_path: Path, enter: Enter
) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        watcher = enter(server.address(drives=False), size=(400, 300))
        guest.prepared()
        guest.choose(2.0, 2.0)
        (asked,) = guest.asked("destination")
        assert math.dist((asked["x"], asked["y"]), (2.0, 2.0)) < 0.05
        expect(guest.page.locator("#place")).to_contain_text("Reachable")
        options = guest.of("options")[-1]
        cards = options["cards"]
        expect(guest.page.locator(".card:visible")).to_have_count(len(cards))
        for button, card in zip(guest.page.locator(".card:visible").all(), cards, strict=True):
            assert card["words"] in button.inner_text()
        guest.page.keyboard.press("1")
        guest.until(lambda: bool(guest.asked("take")))
        assert guest.asked("take")[0]["asked"] == options["asked"]
        guest.until(lambda: bool(guest.of("arrived")))
        last = guest.of("state")[-1]
        assert math.dist((last["x"], last["y"]), (2.0, 2.0)) < 0.1
        expect(guest.page.locator("#said")).to_contain_text("Arrived")
        watcher.until(lambda: bool(watcher.of("arrived")))
        assert {message["type"] for message in watcher.sent} == {"hello", "alive"}
        expect(watcher.page.locator("#bar")).to_contain_text("Watching")
        watcher.page.locator("#map").click()
        watcher.page.keyboard.press("ArrowLeft")
        watcher.page.wait_for_timeout(300)
        assert {message["type"] for message in watcher.sent} == {"hello", "alive"}


def test_a_point_of_the_floor_and_a_landmark_are_chosen_in_the_view_and_obstacles_hide_what_is_behind(
    tmp_path: Path, enter: Enter
) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        guest.prepared()
        guest.until(lambda: bool(guest.of("state")))
        guest.page.wait_for_timeout(300)
        guest.page.mouse.click(*guest.in_view(3.0, -0.3, -EYE))
        guest.until(lambda: len(guest.asked("destination")) == 1)
        asked = guest.asked("destination")[0]
        assert math.dist((asked["x"], asked["y"]), (START[0] + 3.0, START[1] - 0.3)) < 0.1
        guest.page.wait_for_timeout(500)
        guest.page.mouse.click(*guest.in_view(1.6, 1.0, 0.9 - EYE))  # the front of the counter; behind it is floor
        expect(guest.page.locator("#said")).to_contain_text("Something is in the way")
        assert len(guest.asked("destination")) == 1
        guest.page.wait_for_timeout(500)
        guest.page.mouse.click(*guest.in_view(5.9, 1.5, 1.3 - EYE))
        guest.until(lambda: len(guest.asked("destination")) == 2)
        assert guest.asked("destination")[1] == {"type": "destination", "landmark": "clock"}
        expect(guest.page.locator("#place")).to_contain_text("To see clock")


def test_the_keyboard_alone_chooses_takes_pushes_asks_stops_and_plans_a_tour(tmp_path: Path, enter: Enter) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        guest.prepared()
        keys = guest.page.keyboard
        for key in ("m", *["Shift+ArrowRight"] * 4, *["Shift+ArrowUp"] * 3, "ArrowLeft", "Enter"):
            keys.press(key)
        guest.until(lambda: bool(guest.of("options")))
        asked = guest.asked("destination")[0]
        assert (asked["x"], asked["y"]) == pytest.approx((START[0] + 3.75, START[1] + 3.0), abs=1e-3)
        keys.press("1")
        guest.until(lambda: bool(guest.of("taken")))
        keys.down("ArrowLeft")
        guest.until(lambda: bool(guest.of("pushed")))
        keys.up("ArrowLeft")
        assert guest.asked("push")[0]["direction"] == pytest.approx(math.pi / 2)
        expect(guest.page.locator("#said")).to_contain_text(guest.of("pushed")[-1]["words"])
        keys.press("Escape")
        guest.until(lambda: guest.of("state")[-1]["braked"] == "stopped" and not guest.of("state")[-1]["moving"])
        expect(guest.page.locator("#go")).to_have_text("▶ Go")
        keys.press("q")
        keys.press("m")
        keys.press("Shift+ArrowDown")
        keys.press("Enter")
        guest.until(lambda: bool(guest.of("why")))
        expect(guest.page.locator("#why")).to_contain_text(guest.of("why")[-1]["sentence"])
        keys.press("t")
        keys.press("Enter")
        keys.press("Shift+ArrowLeft")
        keys.press("Enter")
        guest.page.get_by_role("button", name="Plan the tour of 2 stops").press("Enter")
        guest.until(lambda: any("stops" in message for message in guest.asked("destination")))
        assert len(guest.asked("destination")[-1]["stops"]) == 2


def test_each_step_of_a_slider_picks_a_way_with_that_cost(tmp_path: Path, enter: Enter) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        guest.prepared()
        guest.choose(6.0, 4.0)
        options = guest.of("options")[-1]
        values = sorted({way["costs"]["length"] for way in options["all"]})
        assert len(values) > 1
        slider = guest.page.get_by_role("slider", name="length")
        slider.focus()
        for key, value in (("Home", values[0]), ("End", values[-1])):
            guest.page.keyboard.press(key)
            told, unit = (slider.get_attribute("aria-valuetext") or "").split()
            assert (float(told), unit) == (pytest.approx(value, rel=0.01), "m")
        guest.page.get_by_role("button", name="Take this way").click()
        guest.until(lambda: bool(guest.of("taken")))
        taken = guest.of("taken")[0]["option"]
        assert options["all"][taken]["costs"]["length"] == values[-1]


def test_a_hidden_page_brakes_the_robot_and_the_head_is_told_thirty_times_a_second(
    tmp_path: Path, enter: Enter
) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        guest.prepared()
        guest.choose(6.0, 4.0)
        guest.page.keyboard.press("1")
        guest.until(lambda: guest.of("state")[-1]["moving"])
        guest.until(lambda: len(guest.asked("head")) > 1)
        times = [sample[0] for batch in guest.asked("head") for sample in batch["samples"]]
        gaps = [after - before for before, after in pairwise(times)]
        assert sum(gaps) / len(gaps) >= 32.0  # ms: not more often
        guest.page.evaluate("Object.defineProperty(document, 'hidden', {get: () => true})")
        guest.until(lambda: guest.of("state")[-1]["braked"] == "nobody drives" and not guest.of("state")[-1]["moving"])
        expect(guest.page.locator("#alarm")).to_contain_text("nobody drives")


def test_the_page_comes_back_after_a_restart_of_the_server(tmp_path: Path, enter: Enter) -> None:
    (tmp_path / "first").mkdir()
    (tmp_path / "second").mkdir()
    with served(tmp_path / "first") as server:
        guest = enter(server.address())
        port = server.server_address[1]
    expect(guest.page.locator("#alarm")).to_contain_text("connection is lost")
    before = len(guest.of("scene"))
    with served(tmp_path / "second", port=port):
        guest.until(lambda: len(guest.of("scene")) > before)
        expect(guest.page.locator("#alarm")).to_be_hidden()
        guest.prepared()
        guest.choose(2.0, 2.0)
        expect(guest.page.locator("#place")).to_contain_text("Reachable")


def test_a_door_is_closed_and_opened_by_its_name(tmp_path: Path, enter: Enter) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address())
        guest.prepared()
        guest.page.get_by_label("Places of the map").select_option("corridor")
        guest.page.get_by_role("button", name="Close it").click()
        guest.choose(6.0, 1.0)
        lines = [way["line"] for way in guest.of("options")[-1]["all"]]
        assert all(max(y for _, y in line) > 3.4 for line in lines)  # round the counter, on its other side
        guest.page.get_by_role("button", name="Open it").click()
        guest.until(lambda: any(max(y for _, y in way["line"]) < 3.4 for way in guest.of("options")[-1]["all"]))


@pytest.mark.skipif(not AXE.exists(), reason="axe is not installed: npm ci in web/")
@pytest.mark.parametrize("size", [(1440, 900), (390, 844)])
def test_the_page_passes_the_rules_of_axe_and_is_as_wide_as_the_window(
    tmp_path: Path, enter: Enter, size: tuple[int, int]
) -> None:
    with served(tmp_path) as server:
        guest = enter(server.address(), size=size, bypass_csp=True)
        guest.prepared()
        guest.page.evaluate(AXE.read_text())
        assert guest.page.evaluate(VIOLATIONS) == []
        guest.choose(6.0, 4.0)
        assert guest.page.evaluate(VIOLATIONS) == []
        guest.page.keyboard.press("?")
        assert guest.page.evaluate(VIOLATIONS) == []
        assert guest.page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
