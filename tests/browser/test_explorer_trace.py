"""The explorer's trace: whose course is shown, and a cursor along time that map and trace share."""

from __future__ import annotations

import pytest
from playwright.sync_api import Page

import hpop
from benchmarks import seeded_fronts as seeded
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import state

LEFT, RIGHT = 44, 12  # CSS pixels beside a strip


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    return seeded.front(60, 3)


@pytest.fixture(scope="module")
def shared(front: hpop.Front, opened_once: Watched, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = explored.written(seeded.problem(3), front, tmp_path_factory.mktemp("trace") / "front.html")
    return opened_once(path)


@pytest.fixture
def page(shared: Page) -> Page:
    explored.fresh(shared)
    shared.mouse.move(2, 2)
    shared.evaluate("window.hpop.state.at(null)")
    shared.evaluate(explored.FRAME)
    return shared


def traced(page: Page) -> list[int]:
    """Rows whose course is shown."""
    page.evaluate(explored.FRAME)
    shown = page.get_attribute(".trace .plot", "data-traced") or ""
    return [int(row) for row in shown.split(",") if row]


def stored(page: Page) -> list[int]:
    return sorted(state(page, "[...s.model.traces.keys()]"))


def test_pinned_and_focused_rows_are_traced_and_those_without_a_trace_are_named(page: Page, front: hpop.Front) -> None:
    rows = stored(page)
    without = next(row for row in range(len(front)) if row not in rows)
    page.evaluate(f"window.hpop.state.pin({rows[1]}); window.hpop.state.hover([{rows[2]}])")
    assert traced(page) == [rows[1], rows[2]]
    assert f"A: row {rows[1]}" in page.inner_text(".trace .hint")
    page.evaluate(f"window.hpop.state.hover([{without}])")
    assert traced(page) == [rows[1]]
    said = page.inner_text(".trace .hint")
    assert f"No trace is stored of row {without}" in said
    assert ", ".join(map(str, rows)) in said
    page.evaluate("window.hpop.state.hover([])")
    assert traced(page) == [rows[1]]
    assert "No trace" not in page.inner_text(".trace .hint")


def test_with_nothing_pinned_the_row_last_at_the_focus_stays(page: Page) -> None:
    rows = stored(page)
    page.evaluate(f"window.hpop.state.hover([{rows[3]}])")
    page.evaluate("window.hpop.state.hover([])")
    assert traced(page) == [rows[3]]


def test_the_pointer_sets_the_time_and_the_map_shows_where_the_camera_is_then(page: Page, front: hpop.Front) -> None:
    row = stored(page)[0]
    page.evaluate(f"window.hpop.state.pin({row})")
    page.evaluate(explored.FRAME)
    box = page.locator(".trace .plot").bounding_box()
    assert box is not None
    columns = 2  # strips side by side: turns and length, in a plot that is wider than high
    wide = float(page.eval_on_selector(".trace .plot", "e => e.clientWidth")) / columns
    x = round(box["x"] + LEFT + 0.6 * (wide - LEFT - RIGHT))
    page.mouse.move(x, box["y"] + 40)
    trajectory = front.trajectories[row]
    end = float(state(page, f"s.model.traces.get({row}).t.at(-1)"))
    assert end == pytest.approx(trajectory.duration, abs=1e-3)
    time = float(state(page, "s.time"))
    assert time == pytest.approx((x - box["x"] - LEFT) / (wide - LEFT - RIGHT) * end, rel=1e-6)

    planned = trajectory.at(time)
    there = [float(planned.x[0]), float(planned.y[0])]
    js = """([x, y]) => {
      const e = document.querySelector(".map .overlay"), world = window.hpop.state.model.world.view;
      const [wide, high] = [e.clientWidth - 28, e.clientHeight - 28];
      const scale = Math.min(wide / (world[2] - world[0]), high / (world[3] - world[1]));
      const px = e.clientWidth / 2 + scale * (x - (world[0] + world[2]) / 2);
      const py = e.clientHeight / 2 - scale * (y - (world[1] + world[3]) / 2);
      const c = e.getContext("2d");
      const at = (x, y) => [...c.getImageData(x, y, 1, 1).data];
      const round = [...Array(12).keys()].map(k => [4.5, 5.5, 6.5].map(
        r => at(px + r * Math.cos(k * Math.PI / 6), py + r * Math.sin(k * Math.PI / 6))));
      return [at(px, py), ...round];
    }"""
    middle, *ring = page.evaluate(js, there)
    assert middle[:3] == [255, 255, 255]  # of the disc
    # The colour of A round it, whichever way the camera looks.
    assert sum(any(red > 150 and blue < 110 for red, _, blue, _ in pixels) for pixels in ring) >= 10
    page.mouse.move(2, 2)
    assert state(page, "s.time") is None


def test_keys_go_along_time(page: Page) -> None:
    row = stored(page)[0]
    page.evaluate(f"window.hpop.state.pin({row})")
    page.evaluate(explored.FRAME)
    end = float(state(page, f"s.model.traces.get({row}).t.at(-1)"))
    page.focus(".trace .plot")
    page.keyboard.press("End")
    assert state(page, "s.time") == pytest.approx(end)
    page.keyboard.press("ArrowLeft")
    assert state(page, "s.time") == pytest.approx(0.99 * end)
    assert state(page, "s.hovered") == []  # the keys of the table are not meant
    page.keyboard.press("Home")
    assert state(page, "s.time") == 0
    assert page.get_attribute(".trace .plot", "aria-valuetext") == "0.0 s"
    page.keyboard.press("Escape")
    assert state(page, "s.time") is None


def test_moving_the_cursor_draws_no_base_anew(page: Page) -> None:
    page.evaluate(f"window.hpop.state.pin({stored(page)[0]})")
    page.evaluate(explored.FRAME)
    drawn = page.evaluate("window.hpop.counters.base.length")
    box = page.locator(".trace .plot").bounding_box()
    assert box is not None
    for x in (80, 120, 160):
        page.mouse.move(box["x"] + x, box["y"] + 40)
        page.evaluate(explored.FRAME)
    assert page.evaluate("window.hpop.counters.base.length") == drawn
