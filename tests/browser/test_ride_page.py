"""The page of a ride: comparing, scrubbing, playing, and blind mode, on screens of several sizes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

import hpop
from hpop.view import save_ride
from tests.browser.rides import MARKUP, front_of, problem_of, ready, room

Open = Callable[..., Page]
SMALL = (720, 420)
LEVER = 0.5  # m a radian, of progress


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    return front_of(problem_of(room()))


@pytest.fixture(scope="module")
def only_page(opened_once: Open, front: hpop.Front, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Open a page where A is row 1, which goes round, and B is row 0, straight."""
    path = save_ride(problem_of(room()), front, tmp_path_factory.mktemp("ride") / "ride.html", rows=[1, 0])
    return ready(opened_once(path, "#check", size=SMALL))


@pytest.fixture
def page(only_page: Page) -> Page:
    """At the start of A; each test leaves the rest as it found it."""
    press(only_page, "1")
    press(only_page, "Home")
    assert only_page.locator("#together").inner_text() == "at equal time"
    assert only_page.locator("#play").inner_text() == "▶ Play"
    assert "row 1" in only_page.locator("#seen").inner_text()
    return only_page


def progress(run: hpop.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return times and the share of the path done by then: metres, and radians times the lever."""
    times = np.linspace(0.0, run.duration, 4001)
    states = run.at(times)
    steps = np.hypot(np.diff(states.x), np.diff(states.y)) + LEVER * np.abs(np.diff(states.yaw))
    done = np.append(0.0, np.cumsum(steps))
    return times, done / done[-1]


def place(page: Page) -> list[float]:
    return page.evaluate("hpopRide.pose().position.slice(0, 2)")


def seek(page: Page, share: float) -> None:
    page.locator("#scrub").fill(str(1000 * share))
    frame(page)


def press(page: Page, key: str) -> None:
    page.keyboard.press(key)
    frame(page)


def frame(page: Page) -> None:
    """Lets the page draw."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")


@pytest.mark.proof
def test_one_scrubs_and_compares_at_equal_time_and_at_equal_progress(page: Page, front: hpop.Front) -> None:
    round_, straight = (front.trajectories[row].execution() for row in (1, 0))

    for share in (0.0, 0.3, 0.62, 1.0):
        seek(page, share)
        there = round_.at(share * round_.duration)
        assert np.allclose(place(page), [there.x[0], there.y[0]], atol=1e-3)

    seek(page, 0.2)
    press(page, "2")  # B, at the same time
    there = straight.at(0.2 * round_.duration)
    assert np.allclose(place(page), [there.x[0], there.y[0]], atol=1e-3)
    seek(page, 1.0)
    press(page, "1")  # and back: A is not at its end when B is
    there = round_.at(straight.duration)
    assert np.allclose(place(page), [there.x[0], there.y[0]], atol=1e-3)

    press(page, "t")
    assert page.locator("#together").inner_text() == "at equal progress"
    for share in (0.0, 0.17, 0.5, 0.83, 1.0):
        page.evaluate("hpopRide.at(0, 0)")
        seek(page, share)
        press(page, "x")
        times, done = progress(round_)
        of_b, done_b = progress(straight)
        there = straight.at(np.interp(np.interp(share * round_.duration, times, done), done_b, of_b))
        assert np.allclose(place(page), [there.x[0], there.y[0]], atol=0.02), share
    press(page, "t")


def test_it_plays_to_the_end_fades_and_begins_again(page: Page) -> None:
    page.locator("#speed").select_option("4")
    seek(page, 0.99)
    press(page, " ")
    page.get_by_text("The end of the ride").wait_for()
    assert page.locator("#play").inner_text() == "↺ Again"
    press(page, " ")
    page.get_by_text("The end of the ride").wait_for(state="hidden")
    frame(page)
    assert place(page) != [1, 1] or page.locator("#scrub").input_value() != "0"
    press(page, " ")
    page.locator("#speed").select_option("1")


def test_looking_around_turns_the_view_and_not_the_rig(page: Page) -> None:
    before = page.evaluate("hpopRide.pose()")
    view = page.locator("#view canvas")
    first = view.screenshot()
    view.drag_to(view, source_position={"x": 100, "y": 100}, target_position={"x": 250, "y": 110})
    assert page.evaluate("hpopRide.pose()") == before
    assert view.screenshot() != first
    press(page, "r")
    assert view.screenshot() == first


def test_blind_shows_no_numbers_and_no_names(page: Page) -> None:
    seeing = page.locator("#ride").inner_text()
    assert {"row 1", "turns", "length", "obstruction"} <= set(re.findall(r"row \d|turns|length|obstruction", seeing))
    press(page, "n")
    blind = page.locator("#ride").inner_text()
    assert not re.search(r"\d|row|turns|length|obstruction|least|knee", blind), blind
    assert page.locator("#seen").inner_text() == "A"
    press(page, "x")
    assert page.locator("#seen").inner_text() == "B"
    press(page, "n")
    assert "row 0" in page.locator("#seen").inner_text()


def test_a_name_of_markup_stays_a_name(page: Page) -> None:
    assert page.evaluate("JSON.parse(document.getElementById('payload').textContent).scene.landmarks[0].name") == MARKUP
    assert page.query_selector("b") is None


def test_options_that_change_what_is_seen_are_off_and_logged(page: Page, tmp_path: Path) -> None:
    press(page, "?")
    boxes = page.locator("dialog input[type=checkbox]")
    assert [boxes.nth(i).is_checked() for i in range(boxes.count())] == [False, False]
    boxes.nth(0).check()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save the log").click()
    saved.value.save_as(tmp_path / "log.json")
    log = json.loads((tmp_path / "log.json").read_text())
    assert ("option vignette", True) in [(entry["what"], entry["value"]) for entry in log["entries"]]
    at = [entry["at"] for entry in log["entries"]]
    assert at == sorted(at)
    boxes.nth(0).uncheck()
    page.get_by_role("button", name="Close").click()


@pytest.mark.cases("390x844")
@pytest.mark.parametrize("size", [(1440, 900), (1024, 768), (390, 844)], ids=lambda size: f"{size[0]}x{size[1]}")
def test_nothing_overlaps_and_nothing_is_cut_off(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    frame(page)
    parts = "#view, #plan, #rates, #bar button:not([hidden]), #bar select, #scrub, #time"
    boxes = page.locator(parts).evaluate_all(
        "all => all.map((e) => { const b = e.getBoundingClientRect(); "
        "return [e.id || e.textContent, b.left, b.top, b.right, b.bottom, e.scrollWidth - e.clientWidth]; })"
    )
    assert len(boxes) >= 12
    for name, left, top, right, bottom, hidden in boxes:
        assert 0 <= left < right <= size[0], name
        assert 0 <= top < bottom <= size[1], name
        assert hidden <= 1, name
    for one, other in combinations(boxes, 2):
        apart = (
            one[3] <= other[1] + 0.5 or other[3] <= one[1] + 0.5 or one[4] <= other[2] + 0.5 or other[4] <= one[2] + 0.5
        )
        assert apart, (one, other)
    view = next(box for box in boxes if box[0] == "view")
    assert (view[3] - view[1]) * (view[4] - view[2]) > 0.35 * size[0] * size[1]
