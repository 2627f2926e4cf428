"""Choosing in the explorer: the nearest to wishes is that of `front.nearest`; keys, pins, table, what is copied."""

from __future__ import annotations

import numpy as np
import pytest
from playwright.sync_api import Page, expect

import hpop
from benchmarks import seeded_fronts as seeded
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import brush, state

N, K = 400, 4


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    return seeded.front(N, K, seed=3)


@pytest.fixture(scope="module")
def shared(front: hpop.Front, opened_once: Watched, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = explored.written(seeded.problem(K), front, tmp_path_factory.mktemp("page") / "front.html")
    return opened_once(path, size=(1190, 700))


@pytest.fixture
def page(shared: Page) -> Page:
    explored.fresh(shared)
    return shared


@pytest.mark.parametrize("n", [20, pytest.param(200, marks=pytest.mark.proof)])
def test_wishes_pick_the_row_that_the_front_picks(page: Page, front: hpop.Front, n: int) -> None:
    rng = np.random.default_rng(7)
    columns = front.names + front.reported_names
    table = np.hstack([front.costs, front.reported])
    wishes = []
    for _ in range(n):
        some = rng.permutation(len(columns))[: rng.integers(1, len(columns) + 1)]
        low, high = table.min(axis=0), table.max(axis=0)
        value = low + (high - low) * rng.uniform(-0.3, 1.3, len(columns))
        value[1] = np.round(value[1])  # whole turns: many rows are as near, the others decide
        wishes.append({int(j): float(value[j]) for j in some})
    picked = page.evaluate(
        """all => all.map(wishes => {
          const { state } = window.hpop;
          for (const column of [...state.wishes.keys()]) state.wish(column, null);
          for (const [column, value] of Object.entries(wishes)) state.wish(Number(column), value);
          return state.nearest[0];
        })""",
        wishes,
    )
    expected = [front.nearest({columns[j]: value for j, value in wish.items()}).index for wish in wishes]
    assert len(set(expected)) > n // 4
    assert picked == expected


def test_a_wish_is_typed_and_the_nearest_within_the_bounds_is_told(page: Page, front: hpop.Front) -> None:
    wish = page.get_by_label("wished length")
    wish.fill("14.5")
    wish.press("Enter")
    nearest = front.nearest({"length": 14.5}).index
    page.evaluate(explored.FRAME)
    assert f"row {nearest}" in page.inner_text(".wish-result")
    assert state(page, "s.sorted[0]") == nearest
    brush(page, "length", 0.7, 1.1)
    first = int(state(page, "s.wished"))
    assert first != nearest
    assert front.costs[first, 0] == front.costs[explored.selected(page), 0].min()
    assert f"row {first}; of all: row {nearest}" in page.inner_text(".wish-result")


def test_keys_go_along_the_sorted_table_and_pin(page: Page, front: hpop.Front) -> None:
    page.get_by_role("columnheader", name="rotation").click()
    order = np.argsort(front.costs[:, 2], kind="stable")
    page.keyboard.press("Escape")
    page.locator(".grid").focus()
    for _ in range(3):
        page.keyboard.press("ArrowDown")
    assert state(page, "s.hovered") == [order[2]]
    page.keyboard.press("p")
    page.keyboard.press("End")
    assert state(page, "s.hovered") == [order[-1]]
    page.keyboard.press("c")
    assert state(page, "s.pins") == [order[2], None, order[-1]]
    focused = page.get_attribute(".grid", "aria-activedescendant")
    assert focused == f"hpop-row-{order[-1]}"
    assert page.locator(f"#{focused}").is_visible()
    page.keyboard.press("Home")
    page.keyboard.press("Enter")
    assert state(page, "s.pins") == [order[2], order[0], order[-1]]
    letters = page.locator(".card thead .chip").all_inner_texts()
    assert letters == ["A", "B", "C"]


@pytest.mark.proof
def test_the_table_holds_the_sorted_rows_and_few_in_the_document(page: Page, front: hpop.Front) -> None:
    head = page.get_by_role("columnheader", name="length")
    head.click()
    head.click()
    page.evaluate(explored.FRAME)
    assert head.get_attribute("aria-sort") == "descending"
    order = np.argsort(front.costs[:, 0], kind="stable")[::-1]
    shown = page.locator(".tr:visible")
    assert shown.count() <= 40
    assert [int(row) for row in shown.evaluate_all("rows => rows.map(row => row.dataset.row)")] == order[
        : shown.count()
    ].tolist()
    page.evaluate("document.querySelector('.grid').scrollTop = 24 * 200")
    page.evaluate(explored.FRAME)
    rows = page.evaluate(
        """[...document.querySelectorAll('.tr:not([hidden])')]
        .map(row => [row.getAttribute('aria-rowindex') - 2, Number(row.dataset.row), row.children[1].textContent])
        .sort((a, b) => a[0] - b[0])"""
    )
    assert rows[0][0] <= 200 < rows[-1][0]
    for place, row, text in rows:
        assert row == order[place]
        assert float(text) == pytest.approx(front.costs[row, 0], abs=5e-3)


def test_hover_on_axes_focuses_the_nearest_line_and_a_click_pins_it(page: Page, front: hpop.Front) -> None:
    best = front.best("length").index
    box = page.locator(".axis[aria-label^='length '] .strip").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] - 8
    page.mouse.move(x, y)
    assert state(page, "s.hovered") == [best]
    assert page.locator(".tr.hovered").get_attribute("data-row") == str(best)
    page.mouse.down()
    page.mouse.up()
    assert state(page, "s.pins") == [best, None, None]
    assert f"row {best}" in page.inner_text(".card")
    page.mouse.down()
    page.mouse.up()
    assert state(page, "s.pins") == [None, None, None]


@pytest.mark.proof
def test_axes_are_moved_flipped_stretched_and_dropped(page: Page) -> None:
    names = "s.shown.map(i => s.column(i).name)"
    before = state(page, names)
    first = page.locator(f".axis[aria-label^='{before[0]} '] .axis-name").bounding_box()
    last = page.locator(f".axis[aria-label^='{before[2]} '] .axis-name").bounding_box()
    assert first is not None
    assert last is not None
    page.mouse.move(first["x"] + 40, first["y"] + 10)
    page.mouse.down()
    page.mouse.move(last["x"] + 60, last["y"] + 10, steps=4)
    page.mouse.up()
    assert state(page, names) == [before[1], before[2], before[0], *before[3:]]
    page.locator(f".axis[aria-label^='{before[0]} '] .axis-name").focus()
    page.keyboard.press("Shift+ArrowLeft")
    assert state(page, names) == [before[1], before[0], *before[2:]]
    page.get_by_role("button", name=f"flip {before[0]}").click()
    best = int(state(page, "s.column(s.order[1]).values.indexOf(s.column(s.order[1]).low)"))
    box = page.locator(f".axis[aria-label^='{before[0]} '] .strip").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 15, box["y"] + 8)
    assert state(page, "s.hovered") == [best]
    page.get_by_role("button", name=f"remove the axis of {before[0]}").click()
    assert before[0] not in state(page, names)
    page.get_by_role("button", name=f"+ {before[0]}").click()
    assert before[0] in state(page, names)


def test_what_is_copied_chooses_the_same_again(page: Page, front: hpop.Front) -> None:
    page.evaluate("() => { const { state } = window.hpop; state.pin(5); state.pinAt(1, 11); state.wish(0, 13); }")
    for label, typed in (("least length", "11.5"), ("greatest turns", "18")):
        page.get_by_label(label).fill(typed)
        page.get_by_label(label).press("Enter")
    page.keyboard.press("y")
    python, commands = (page.locator("textarea").nth(i).input_value() for i in range(2))
    page.keyboard.press("Escape")
    here: dict[str, object] = {}
    code = python.replace("import hpop", "").replace('hpop.Front.load("out/front.json")', "given")
    exec(code, {"given": front}, here)
    a, b, chosen, nearest = (here[name] for name in ("a", "b", "chosen", "nearest"))
    assert (a.index, b.index) == (5, 11)
    assert nearest.index == front.nearest({"length": 13.0}).index == state(page, "s.nearest[0]")
    assert chosen.costs.tolist() == front.costs[explored.selected(page)].tolist()
    assert "hpop pick out --row 5\n" in commands
    assert here["nearest_chosen"].index == state(page, "s.wished")
    assert "--at-most turns=18 --wish length=13" in commands
    assert commands.splitlines()[-1].startswith("# bounds from below")
    page.keyboard.press("k")
    page.keyboard.press("y")
    python = page.locator("textarea").first.input_value()
    page.keyboard.press("Escape")
    exec(
        python.replace("import hpop", "").replace('hpop.Front.load("out/front.json")', "given"), {"given": front}, here
    )
    assert here["chosen"].costs.tolist() == chosen.costs.tolist()


def test_words_are_explained_until_they_are_closed_for_good(
    front: hpop.Front, opened: Watched, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = explored.written(seeded.problem(K), front, tmp_path_factory.mktemp("first") / "front.html")
    page = opened(path)
    hint = page.get_by_role("complementary", name="what the words on this page mean")
    expect(hint).to_be_visible()
    assert {"knee", "certificate"} <= set(hint.locator("dt").all_inner_texts())
    assert "proven" in (page.locator(".about summary").get_attribute("title") or "")
    page.get_by_role("button", name="Got it").click()
    assert not hint.is_visible()
    page.reload()
    page.wait_for_function("() => window.hpop !== undefined")
    assert not hint.is_visible()
    page.keyboard.press("?")
    assert page.get_by_role("dialog").locator("dt", has_text="knee").is_visible()
