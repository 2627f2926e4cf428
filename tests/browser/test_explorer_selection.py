"""The explorer selects the rows that NumPy selects; steps are undone; a link restores the selection."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page

import hpop
from benchmarks import seeded_fronts as seeded
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import bounds, brush, selected, state, until, within

N, K = 158, 5


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    return seeded.front(N, K)


@pytest.fixture(scope="module")
def shared(front: hpop.Front, opened_once: Watched, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """One page for all claims of this file."""
    path = explored.written(seeded.problem(K), front, tmp_path_factory.mktemp("page") / "front.html")
    return opened_once(path, size=(1190, 700))


@pytest.fixture
def page(shared: Page) -> Page:
    explored.fresh(shared)
    return shared


def counted(page: Page) -> int:
    """Return the count in the header."""
    page.evaluate(explored.FRAME)
    return int(page.inner_text(".counts strong").replace(",", ""))


@pytest.mark.parametrize(
    ("name", "begin", "end"),
    [
        ("turns", 0.4, 1.2),
        pytest.param("length", 0.1, 0.63, marks=pytest.mark.proof),
        pytest.param("duration", 0.2, 0.5, marks=pytest.mark.proof),
    ],
)
def test_a_brush_selects_what_numpy_selects(page: Page, front: hpop.Front, name: str, begin: float, end: float) -> None:
    brush(page, name, begin, end)
    asked = bounds(page)
    assert list(asked) == [name]
    expected = within(front, asked)
    assert 0 < expected.sum() < len(front)
    assert selected(page).tolist() == expected.tolist()
    assert counted(page) == expected.sum() == int(page.get_attribute(".grid", "aria-rowcount") or 0) - 1
    column = (front.names + front.reported_names).index(name)
    values = np.hstack([front.costs, front.reported])[:, column]
    low, high = values.min(), values.max()
    shares = (values - low) / (high - low)
    pixel = 1.5 / 180
    assert selected(page)[(shares > min(begin, end) + pixel) & (shares < max(begin, end) - pixel)].all()
    if max(begin, end) > 1:  # the end value is not lost
        assert selected(page)[values == high].all()


@pytest.mark.proof
def test_brushes_of_several_axes_all_hold_and_each_is_cleared_by_a_click(page: Page, front: hpop.Front) -> None:
    brush(page, "length", 0.0, 0.8)
    brush(page, "rotation", 0.2, 1.1)
    asked = bounds(page)
    assert set(asked) == {"length", "rotation"}
    assert selected(page).tolist() == within(front, asked).tolist()
    page.locator(".axis[aria-label^='length '] .strip").click()
    assert set(bounds(page)) == {"rotation"}
    page.locator(".axis[aria-label^='rotation '] .strip").click()
    assert counted(page) == len(front)


@pytest.mark.proof
def test_a_brush_is_moved_at_its_middle_and_resized_at_its_end(page: Page) -> None:
    brush(page, "length", 0.2, 0.4)
    low, high = bounds(page)["length"]
    brush(page, "length", 0.3, 0.5)
    moved = bounds(page)["length"]
    span = 1.5 * 10 / 180  # m a pixel, of a range of some 10 m
    assert moved[0] > low + span
    assert moved[1] - moved[0] == pytest.approx(high - low, abs=2 * span)
    brush(page, "length", 0.6, 0.9)
    resized = bounds(page)["length"]
    assert resized[0] == pytest.approx(moved[0], abs=span)
    assert resized[1] > moved[1] + span


def test_bounds_are_typed_as_numbers(page: Page, front: hpop.Front) -> None:
    most = page.get_by_label("greatest turns")
    most.fill("16")
    most.press("Enter")
    assert bounds(page) == {"turns": (-np.inf, 16.0)}
    assert counted(page) == (front.costs[:, front.names.index("turns")] <= 16).sum()
    assert selected(page).sum() == len(front.where({"turns": "<=16"}))
    most.fill("many")
    most.press("Enter")
    assert bounds(page) == {"turns": (-np.inf, 16.0)}
    most.fill("")
    most.press("Enter")
    assert bounds(page) == {}


@pytest.mark.proof
def test_a_bound_between_two_steps_excludes_the_next_step(page: Page, front: hpop.Front) -> None:
    most = page.get_by_label("greatest turns")
    most.fill("15.7")
    most.press("Enter")
    assert counted(page) == len(front.where({"turns": "<=15.7"})) == len(front.where({"turns": "<=15"}))


@pytest.mark.proof
def test_keep_exclude_back_and_forward(page: Page, front: hpop.Front) -> None:
    brush(page, "length", 0.5, -0.2)
    short = selected(page)
    page.keyboard.press("k")
    assert bounds(page) == {}
    assert selected(page).tolist() == short.tolist()
    brush(page, "rotation", 0.5, -0.2)
    calm = within(front, bounds(page))
    page.keyboard.press("x")
    assert selected(page).tolist() == (short & ~calm).tolist()
    for expected in (short & calm, short, short, np.ones(len(front), dtype=bool)):
        page.keyboard.press("Alt+ArrowLeft")
        assert selected(page).tolist() == expected.tolist()
    assert page.get_by_role("button", name="Back").is_disabled()
    for _ in range(4):
        page.keyboard.press("Alt+ArrowRight")
    assert selected(page).tolist() == (short & ~calm).tolist()
    page.keyboard.press("0")
    assert counted(page) == len(front)


@pytest.mark.proof
def test_a_link_restores_what_was_chosen(page: Page, front: hpop.Front) -> None:
    brush(page, "length", 0.1, 0.8)
    page.keyboard.press("k")
    brush(page, "turns", 0.0, 0.7)
    page.evaluate("""() => {
      const { state } = window.hpop;
      state.pin(7); state.pin(70); state.unpin(0); state.pinAt(2, 3);
      state.wish(0, 12.5); state.flip(2); state.log(3); state.show(4, false); state.move(1, 0); state.sortBy(0, true);
    }""")
    chosen = [
        "s.selected.join('')", "s.pins", "[...s.wishes]", "s.order", "[...s.flipped]", "[...s.logs]", "[...s.hidden]",
        "s.sort", "s.shown", "[...s.sorted]",
    ]  # fmt: skip
    before = [state(page, part) for part in chosen]
    until(page, "location.hash.includes('hide=')")
    link = page.evaluate("location.hash")
    explored.fresh(page)
    until(page, "location.hash === ''")
    assert [state(page, part) for part in chosen] != before
    page.evaluate("link => { location.hash = link }", link)
    until(page, "window.hpop.state.wishes.size > 0")
    assert [state(page, part) for part in chosen] == before


@pytest.mark.proof
def test_a_link_by_hand_as_the_documents_have_it(page: Page, front: hpop.Front) -> None:
    page.evaluate("location.hash = '#b=turns:0-16,nothing:1-2&pin=7,70,99999&order=turns&wish=length:,rotation:x'")
    until(page, "window.hpop.state.filter.bounds.size > 0")
    assert bounds(page) == {"turns": (0.0, 16.0)}
    assert counted(page) == len(front.where({"turns": "<=16"}))
    assert state(page, "s.pins") == [7, 70, None]
    assert state(page, "s.column(s.shown[0]).name") == "turns"
    assert state(page, "s.wishes.size") == 0
    page.evaluate("location.hash = '#pin=7,7'")
    until(page, "window.hpop.state.filter.bounds.size === 0")
    assert state(page, "s.pins") == [7, None, None]


@pytest.mark.proof
def test_other_data_keep_bounds_pins_and_axes(page: Page, front: hpop.Front) -> None:
    problem = seeded.problem(K)
    brush(page, "length", 0.5, -0.2)
    page.evaluate("() => { window.hpop.state.pin(20); window.hpop.state.flip(1); window.hpop.state.wish(0, 11); }")
    asked, costs = bounds(page), front.costs[20]
    more = front | seeded.front(N, K, seed=1)
    assert len(more) != len(front)
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, more))
    row = int(np.flatnonzero((more.costs == costs).all(axis=1))[0])
    assert state(page, "s.pins") == [row, None, None]
    assert bounds(page) == asked
    assert selected(page).tolist() == within(more, asked).tolist()
    assert state(page, "[...s.flipped]") == [1]
    assert state(page, "s.nearest[0]") == more.nearest({"length": 11.0}).index
    assert page.inner_text(".counts").endswith(f"of {len(more)} trajectories")
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, front))


def test_many_changes_are_one_redraw_and_hover_and_wishes_redraw_no_densities(page: Page, front: hpop.Front) -> None:
    base, overlay = "window.hpop.counters.base.length", "window.hpop.counters.overlay.length"
    for _ in range(2):  # nothing of the test before is left to draw
        page.evaluate(explored.FRAME)
    drawn = page.evaluate(f"[{base}, {overlay}]")
    page.evaluate("() => { for (let i = 0; i < 50; i++) window.hpop.state.bound(0, { low: 10, high: 20 - i / 10 }); }")
    page.evaluate(explored.FRAME)
    assert page.evaluate(f"[{base}, {overlay}]") == [drawn[0] + 1, drawn[1] + 1]
    page.evaluate("() => { for (let row = 0; row < 50; row++) window.hpop.state.hover([row]); }")
    page.evaluate(explored.FRAME)
    page.evaluate("window.hpop.state.wish(0, 12)")
    page.evaluate(explored.FRAME)
    page.evaluate("window.hpop.state.pin(3)")
    page.evaluate(explored.FRAME)
    assert page.evaluate(f"[{base}, {overlay}]") == [drawn[0] + 1, drawn[1] + 4]


@pytest.mark.proof
def test_brushes_and_wishes_of_eight_thousand_rows(browser: Browser, tmp_path: Path) -> None:
    large = seeded.front(8_000, 8)
    watched = Watched(browser)
    page = watched(explored.written(seeded.problem(8), large, tmp_path / "front.html"))
    explored.fresh(page)
    for name, begin, end in (("length", 0.2, 0.9), ("social_force", 0.9, 0.3), ("duration", 0.1, 0.8)):
        brush(page, name, begin, end)
        assert selected(page).tolist() == within(large, bounds(page)).tolist()
    assert 0 < counted(page) < len(large)
    page.evaluate("() => { window.hpop.state.wish(0, 15.5); window.hpop.state.wish(4, 17.25); }")
    assert state(page, "s.nearest[0]") == large.nearest({"length": 15.5, "exposure": 17.25}).index
    assert (tmp_path / "front.html").stat().st_size <= 2_000_000
    watched.close()
    assert watched.errors == []


@pytest.mark.proof
def test_fewer_rows_come_while_some_are_kept(page: Page, front: hpop.Front) -> None:
    problem = seeded.problem(K)
    brush(page, "length", 0.9, -0.2)
    page.keyboard.press("k")
    assert selected(page).sum() > 40
    brush(page, "turns", 0.8, -0.2)
    asked, fewer = bounds(page), seeded.front(40, K, seed=2)
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, fewer))
    assert selected(page).tolist() == within(fewer, asked).tolist()
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, front))


def test_numbers_of_any_size_are_shown(page: Page, front: hpop.Front) -> None:
    problem = seeded.problem(K)
    for scale in (1e-300, 1e300):
        odd = hpop.Front.of(
            np.array([[1.0, 3.0], [2.0, 2.0], [3.0, 1.0]]) * scale,
            front.trajectories[:3],
            names=("a", "b"),
            units=("m", "m"),
            groups="PP",
            quanta=(1e-6 * scale,) * 2,
            status="complete",
            certificate="exact",
        )
        page.evaluate("given => window.hpop.update(given)", explored.payload(problem, odd))
        assert state(page, "s.column(0).high") == 3.0 * scale
        assert page.locator(".grid .td").filter(has_text=f"{2 * scale:g}".replace("-", "\u2212")).count() == 2
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, front))


def test_a_bound_holds_where_the_front_says_so(page: Page, front: hpop.Front) -> None:
    """Halves of a step, bounds of no size, values that differ by their last digits."""
    odd = hpop.Front.of(
        [[1.5, 9.0], [2.5, 8.0], [3.5, 7.0], [0.0, 10.0]],
        front.trajectories[:4],
        names=("a", "b"),
        units=("m", "m"),
        groups="PP",
        quanta=(1.0, 1.0),
        reported=[[1.0], [1.0 + 20 * np.finfo(float).eps], [2.0], [0.0]],
        reported_names=["c"],
        reported_units=["s"],
        status="complete",
        certificate="exact",
    )
    page.evaluate("given => window.hpop.update(given)", explored.payload(seeded.problem(K), odd))
    for name, low, high in (("a", 0, 3.0), ("a", 3.0, 4.0), ("a", 1e-20, 2.5), ("c", 0.0, 1.0), ("c", 1.5, 2.0)):
        place = ("a", "b", "c").index(name)
        asked = state(page, f"(s.clear(), s.bound({place}, {{low: {low}, high: {high}}}), [...s.selected])")
        expected = odd.where({name: f">={low}"}).where({name: f"<={high}"})
        assert odd.costs[np.array(asked) == 1].tolist() == expected.costs.tolist()
    page.evaluate("given => window.hpop.update(given)", explored.payload(seeded.problem(K), front))


@pytest.mark.proof
def test_a_step_back_shows_the_axis_that_it_bounds(page: Page) -> None:
    brush(page, "length", 0.2, 0.6)
    asked = bounds(page)
    page.evaluate("() => window.hpop.state.show(0, false)")
    assert bounds(page) == {}
    page.keyboard.press("Alt+ArrowLeft")
    assert bounds(page) == asked
    assert page.locator(".axis[aria-label^='length ']").is_visible()


def test_keys_do_what_buttons_do_and_nothing_where_these_are_off(page: Page) -> None:
    for key in "kx0":
        page.keyboard.press(key)
    page.evaluate(explored.FRAME)
    assert page.get_by_role("button", name="Back").is_disabled()
