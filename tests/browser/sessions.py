"""A small study on the disk, its server, and what a participant does on the page."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Any

import shapely
from playwright.sync_api import Browser, FrameLocator, Page, expect

import hpop
from hpop import study
from hpop.study.page import ride_page
from hpop.study.server import StudyServer
from tests.browser.rides import front_of, problem_of

BEGIN = datetime.datetime(2026, 11, 23, 9, 30, tzinfo=datetime.UTC)
REST = 20  # s
PATIENCE = 10  # s by the page's clock after which it gives up a request (web/src/study/recorder.ts)
WAYS = {"straight": [(1, 1), (2, 1)], "round": [(1, 1), (1, 1.5), (2, 1.5), (2, 1)]}
SIZE = (480, 400)  # a view of few pixels is drawn soon


def small_study(folder: Path, *forms: str, kind: str = "ride") -> study.Design:
    """Two short ways beside a box, and the still view; as videos, without it, files of one byte."""
    world = hpop.World.from_polygons([shapely.box(1.3, 0.2, 1.7, 0.6)], extent=shapely.box(0, 0, 10, 8))
    problem = problem_of(world)
    front = front_of(problem, WAYS)
    design = study.Design.of(
        front,
        [0, 1, "view"] if kind == "ride" else [0, 1],
        participants=6,
        consent="You will be shown three views.\n\nIt takes ten minutes.",
        forms=forms,
        kind=kind,
        protocol=study.Protocol(rest_s=REST),
    )
    design.save(folder)
    if kind == "ride":
        study.save_stimuli(problem, front, design.conditions, folder / "stimuli")
        return design
    for condition in design.conditions:
        file = folder / condition.stimulus
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(bytes(1))
        ridden = front.trajectories[condition.row or 0]
        file.with_suffix(".html").write_text(ride_page(problem, ridden, condition.id, video=condition.stimulus))
    return design


@contextmanager
def served(folder: Path, port: int = 0) -> Iterator[StudyServer]:
    """Serve the study from a thread."""
    with StudyServer(folder, port=port) as server:
        thread = Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def too_small(page: Page) -> list[str]:
    """Return the buttons and links of a page below 44 x 44 pixels, and its fields without a name.

    Numbers of a scale stand in one row: 24 pixels wide will do.
    """
    found = page.evaluate(
        """() => [...document.querySelectorAll("button, a, summary, input:not([type=hidden]), textarea")]
          .map((e) => [e, (e.closest("label") ?? e).getBoundingClientRect()])
          .filter(([e, box]) => box.width > 0
            && (Math.min(box.width + (e.closest(".numbered") ? 20 : 0), box.height) < 44
            || (e.matches("input, textarea") && !e.labels.length)))
          .map(([e]) => e.outerHTML)"""
    )
    return [str(one) for one in found]


class Participant:
    """A participant of a session. The page's clock stands still except where a test lets time pass."""

    def __init__(self, browser: Browser, address: str, size: tuple[int, int] = SIZE) -> None:
        width, height = size
        self.page: Page = browser.new_context(viewport={"width": width, "height": height}).new_page()
        self.page.set_default_timeout(30_000)
        self.complaints: list[str] = []
        self.asked: list[str] = []
        self.page.on("console", lambda said: self.complaints.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.asked.append(request.url))
        self.page.clock.install(time=BEGIN)
        self.page.clock.pause_at(
            BEGIN + datetime.timedelta(minutes=5)
        )  # ahead of a clock that runs while a machine is busy
        self.page.goto(address)
        self.ready()

    def ready(self) -> None:
        self.page.locator("html[data-ready=yes]").wait_for(state="attached")

    def press(self, name: str) -> None:
        self.page.get_by_role("button", name=name, exact=True).click()

    def agree(self) -> None:
        self.page.locator("#agree").check()
        self.press("Begin the session")

    def heading(self) -> str:
        return self.page.locator("h1").inner_text()

    def answer(self, values: Mapping[str, Any]) -> None:
        """Choose by the words of the question and of the choice."""
        for question, choice in values.items():
            group = self.page.get_by_role("group", name=question, exact=True)
            group.locator("label", has_text=re.compile(rf"^{re.escape(str(choice))}(,|$)")).click()

    def ride(self) -> FrameLocator:
        """Return the view that waits to be started."""
        frame = self.page.frame_locator("iframe")
        frame.locator("#start").wait_for()
        return frame

    def begin_ride(self) -> None:
        self.ride().locator("#start").click()
        self.page.wait_for_function("document.activeElement.tagName === 'IFRAME'")

    def let_pass(self, seconds: float) -> None:
        """Let time pass, in jumps that no request takes for its patience's end: what is on its way arrives between."""
        while seconds > 0:
            jump = min(seconds, PATIENCE - 1)
            expect(self.page.locator("header .saved")).not_to_have_text("Saving …")
            self.page.clock.fast_forward(round(1000 * jump))
            seconds -= jump

    def sit_out(self, seconds: float) -> None:
        """Let a ride pass at once, its end as well: hardly a picture is drawn."""
        for part in (seconds, 1.0):
            self.let_pass(part)
        self.press("Continue")

    def watch(self, seconds: float) -> None:
        """Look at a view in which nothing moves, at sixty pictures a second."""
        self.page.clock.run_for(round(1000 * (seconds + 0.6)))

    def rest(self) -> None:
        self.let_pass(REST)
        self.press("Continue")

    def overflow(self) -> int:
        """Pixels by which the page is wider than the window."""
        return int(self.page.evaluate("document.documentElement.scrollWidth - window.innerWidth"))

    def close(self) -> None:
        self.page.context.close()
