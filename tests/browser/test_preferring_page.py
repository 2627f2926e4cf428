"""The page of `hpop prefer --web` in a real browser: what is clicked is what the file holds."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import numpy as np
from playwright.sync_api import Browser, Page, expect

import hpop
from hpop.cli import serving
from hpop.cli.preferring import Asking
from hpop.preference import Preference
from tests.browser.sessions import too_small
from tests.view.explorer.fronts import seeded

SIZES = [(390, 844), (1300, 900)]


def test_answers_in_the_file_are_what_was_clicked(browser: Browser, tmp_path: Path) -> None:
    """The first question on a phone, the second on a desk; an answer is of the pair that the page shows."""
    problem, front = seeded(30)
    file = tmp_path / "preference.json"
    asking = Asking(Preference.fit(front, ties=True, seed=3), problem, front, file, most=2)
    said, told = list[str](), threading.Event()

    def say(line: str) -> None:
        said.append(line)
        told.set()

    server = threading.Thread(target=serving.serve, args=(asking, 0, say), daemon=True)
    server.start()
    assert told.wait(30)
    page = browser.new_context().new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    shown: list[tuple[int, ...]] = []
    page.set_viewport_size({"width": SIZES[0][0], "height": SIZES[0][1]})
    page.goto(re.findall(r"http://\S+", said[0])[0])
    for number, (label, size) in enumerate(zip(["I prefer b", "No difference"], SIZES, strict=True), 1):
        page.set_viewport_size({"width": size[0], "height": size[1]})
        expect(page.locator("h1")).to_contain_text(f"{number}. Which of the two")
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert too_small(page) == []
        choice = page.get_by_role("button", name=label, exact=True)
        box = choice.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] <= size[1]  # to be pressed without scrolling
        assert page.get_by_role("img", name="Map of both trajectories, a and b").is_visible()
        shown.append(tuple(row_of(page, front, column) for column in (1, 2)))
        choice.focus()
        page.keyboard.press("Enter")
    expect(page.locator("h1")).to_have_text("Thank you")
    page.context.close()
    server.join(30)
    assert not server.is_alive()
    assert complaints == []

    answers = [(answer.first, answer.second, answer.chosen) for answer in Preference.load(file).answers]
    assert answers == [(*shown[0], shown[0][1]), (*shown[1], None)]


def row_of(page: Page, front: hpop.Front, column: int) -> int:
    """Return the row of the front with the costs in a column of the page's table."""
    costs = [float(text) for text in page.locator(f"tr td:nth-child({column + 1})").all_inner_texts()]
    (row,) = np.flatnonzero(np.isclose(front.costs, costs, rtol=1e-3).all(axis=1))
    return int(row)
