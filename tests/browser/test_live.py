"""The page of a search that runs, in a real browser: what comes is shown, what was chosen stays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser

from benchmarks.seeded_fronts import front, problem
from hpop.cli.beside import LivePage
from tests.browser.explored import READY, bounds, selected, state, until, within


@pytest.mark.proof
def test_fronts_appear_as_they_are_found_and_bounds_and_pins_stay(browser: Browser, tmp_path: Path) -> None:
    whole = replace(front(120, 3), problem=problem(3).describe())
    found = np.arange(len(whole)) % 2 == 1
    complaints: list[str] = []
    asked: list[str] = []
    page = browser.new_page()
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    with LivePage(0, tmp_path) as live:
        page.goto(live.address)
        assert page.title() == "hpop: searching"
        whole[found].save(tmp_path / "front.json")
        live.saved()
        page.wait_for_selector("main.hpop")
        until(page, READY)
        assert state(page, "s.model.n") == found.sum()
        low, high = np.quantile(whole.costs[:, 0], [0.2, 0.7])
        name = whole.names[0]
        page.evaluate(f"(s => {{ s.bound(0, {{ low: {low}, high: {high} }}, true); s.pin(10); }})(window.hpop.state)")
        page.evaluate("window.notReloaded = true")
        whole.save(tmp_path / "front.json")
        live.saved()
        until(page, f"window.hpop.state.model.n === {len(whole)}")
        assert page.evaluate("window.notReloaded")
        assert bounds(page).keys() == {name}
        assert (selected(page) == within(whole, bounds(page))).all()
        (pinned,) = [row for row in state(page, "s.pins") if row is not None]
        assert (whole.costs[pinned] == whole[found].costs[10]).all()
        assert page.locator(".live").inner_text() == "live: the search is running"
    until(page, "document.querySelector('.live').textContent.startsWith('complete: the search has ended')")
    assert complaints == []
    assert {url.split("/")[2] for url in asked if not url.startswith("data:")} == {live.address.split("/")[2]}
    page.close()
