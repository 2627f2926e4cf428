"""The explorer at the sizes of a desk, a small screen and a phone; with no row, one row, many criteria, odd names."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdfium2 as pdfium
import pytest
from playwright.sync_api import Page

import hpop
from benchmarks import seeded_fronts as seeded
from tests.browser import explored
from tests.browser.explored import overlapping, until

SIZES = [(1440, 900), (1024, 768), (390, 844)]
ODD = "</script><b id=odd>bold</b><!-- <script>"
Opened = Callable[..., Page]


def shown(opened: Opened, path: Path, front: hpop.Front, k: int, **how: object) -> Page:
    page = opened(explored.written(seeded.problem(k), front, path / "front.html"), **how)
    until(page, explored.READY)
    page.evaluate(explored.FRAME)
    return page


@pytest.mark.proof
def test_nothing_overlaps_at_any_size(opened: Opened, tmp_path: Path) -> None:
    page = shown(opened, tmp_path, seeded.front(60, 8), 8, fragment="#pin=3,7,9&wish=length:12&b=turns:10-18")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate(explored.FRAME)
        assert overlapping(page, ".hpop > *") == []
        assert overlapping(page, ".header-line > *, .about") == []
        assert overlapping(page, ".axis") == []
        assert overlapping(page, ".axis:first-of-type > *, .axis:nth-of-type(3) > *") == []
        assert overlapping(page, ".wish > *") == []
        assert overlapping(page, ".th") == []
        assert page.evaluate("document.documentElement.scrollWidth") == width  # no scrolling sideways but in the parts
        if width > 1180:
            assert page.evaluate("document.documentElement.scrollHeight") == height
        clipped = page.eval_on_selector_all(
            ".hpop > .panel", "all => all.filter(e => e.scrollHeight > e.clientHeight + 1).map(e => e.className)"
        )
        assert clipped == []


@pytest.mark.parametrize(
    ("n", "k"), [(0, 3), pytest.param(1, 1, marks=pytest.mark.proof), pytest.param(40, 20, marks=pytest.mark.proof)]
)
def test_fronts_of_no_row_of_one_and_of_many_criteria(n: int, k: int, opened: Opened, tmp_path: Path) -> None:
    front = seeded.front(n, k)
    page = shown(opened, tmp_path, front, k)
    assert page.inner_text(".counts strong") == str(len(front))
    assert page.evaluate("document.documentElement.scrollWidth") == SIZES[0][0]
    assert front.certificate in page.evaluate("document.querySelector('.claims').textContent")
    if not n:
        assert page.locator(".map").is_visible()
        assert page.locator(".claims").is_visible()
        assert not page.locator(".axes").is_visible()
        return
    page.keyboard.press("ArrowDown")
    page.keyboard.press("p")
    assert explored.state(page, "s.pins[0]") == 0
    scroll = page.locator(".axes-scroll")
    width, room = scroll.evaluate("e => [e.scrollWidth, e.clientWidth]")
    assert width > room + 100 if k == 20 else width <= room
    assert page.locator(".axis").count() == k + 1


@pytest.mark.proof
def test_values_that_are_equal_lie_in_the_middle_and_reported_axes_are_dashed(opened: Opened, tmp_path: Path) -> None:
    front = seeded.front(30, 3)
    front = replace(front, reported=np.full((len(front), 1), 7.25))
    page = shown(opened, tmp_path, front, 3)
    axis = page.locator(".axis.reported")
    assert axis.get_attribute("aria-label") == "duration (s)"
    assert axis.locator(".axis-name").evaluate("e => getComputedStyle(e).borderBottomStyle") == "dashed"
    strip = axis.locator(".strip").bounding_box()
    assert strip is not None
    page.mouse.move(strip["x"] + 15, strip["y"] + strip["height"] / 2)
    assert len(explored.state(page, "s.hovered")) == 1
    page.mouse.move(strip["x"] + 15, strip["y"] + strip["height"] / 4)
    assert explored.state(page, "s.hovered") == []


@pytest.mark.proof
def test_names_of_markup_stay_names(opened: Opened, tmp_path: Path) -> None:
    front = seeded.front(20, 3)
    front = replace(
        front, names=(ODD, *front.names[1:]), status="complete", certificate=f"claims {ODD}", runs=({"notes": [ODD]},)
    )
    page = shown(opened, tmp_path, front, 3, fragment="#pin=1")
    assert page.locator("#odd").count() == 0
    assert page.locator(".axis-name").first.inner_text().replace("\n", "").endswith(ODD + " (m)")
    assert ODD in page.locator(".card").inner_text().replace("\n", "")
    assert ODD in page.evaluate("document.querySelector('.claims').textContent")
    page.get_by_label(f"greatest {ODD}").fill("15")
    page.get_by_label(f"greatest {ODD}").press("Enter")
    assert explored.selected(page).tolist() == (front.costs[:, 0] <= 15).tolist()
    until(page, "location.hash.includes('b=')")
    link = page.evaluate("location.hash")
    explored.fresh(page)
    page.evaluate("link => { location.hash = link }", link)
    until(page, "window.hpop.state.filter.bounds.size === 1")
    assert explored.selected(page).tolist() == (front.costs[:, 0] <= 15).tolist()


@pytest.mark.proof
def test_dark_colours_and_a_printed_page_with_the_whole_table_after_it(opened: Opened, tmp_path: Path) -> None:
    page = shown(opened, tmp_path, seeded.front(60, 5), 5, color_scheme="dark", fragment="#pin=3,7")
    paper = "getComputedStyle(document.querySelector('.panel')).backgroundColor"
    dark = [int(part) for part in re.findall(r"\d+", page.evaluate(paper))]
    assert max(dark) < 60
    pdf = page.pdf(prefer_css_page_size=True, print_background=True)
    printed = pdfium.PdfDocument(pdf)
    first, *others = (printed[i] for i in range(len(printed)))
    seen = np.asarray(first.render(scale=1).to_pil().convert("L"))
    height, width = seen.shape
    assert (seen[int(0.27 * height) : int(0.45 * height)] < 120).any(
        axis=0
    ).sum() > 0.4 * width  # lines across the axes
    listed = [line.split()[0] for page_of in others for line in lines_of(page_of) if line[:1].isdigit()]
    assert len(listed) >= 60 - 12  # all rows but those that a sign precedes, which have names
    page.evaluate(explored.FRAME)
    assert page.evaluate("document.querySelector('.printing')") is None
    assert page.evaluate("document.documentElement.scrollHeight") == 900


def lines_of(page: pdfium.PdfPage) -> list[str]:
    return str(page.get_textpage().get_text_range()).splitlines()


@pytest.mark.proof
def test_a_finger_looks_first_and_pins_then(opened: Opened, tmp_path: Path) -> None:
    page = shown(opened, tmp_path, seeded.front(60, 3), 3, size=(390, 844), has_touch=True)
    row = page.locator(".tr").nth(2)
    row.tap()
    at = int(row.get_attribute("data-row") or -1)
    assert explored.state(page, "[s.hovered, s.pins]") == [[at], [None, None, None]]
    row.tap()
    assert explored.state(page, "s.pins") == [at, None, None]
    assert page.locator(".axis-tools").first.evaluate("e => getComputedStyle(e).opacity") == "1"
