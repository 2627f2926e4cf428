"""The notebook's module in a real browser, with a model that keeps what it is told."""

from __future__ import annotations

import base64

import numpy as np
from playwright.sync_api import Browser, Frame

from benchmarks.seeded_fronts import front, problem
from hpop.view import widget
from hpop.view.single_page import bundle
from tests.browser.explored import READY, until

MODEL = """
window.model = {
  traits: { page: given.page, height: 700 }, saved: [], heard: {},
  get(name) { return this.traits[name]; },
  set(name, value) { this.traits[name] = value; },
  save_changes() { const { page, ...others } = this.traits; this.saved.push(structuredClone(others)); },
  on(event, heard) { (this.heard[event] ??= []).push(heard); },
  off(event, heard) { this.heard[event] = this.heard[event].filter((one) => one !== heard); },
};
"""


def test_what_is_done_in_the_page_is_set_in_the_model_and_saved(browser: Browser) -> None:
    whole = front(60, 3)
    shown = widget(problem(3), whole)
    page = browser.new_page()
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    module = "data:text/javascript;base64," + base64.b64encode(bundle("widget.js").encode()).decode()
    page.evaluate(
        f"async (given) => {{ {MODEL} const module = await import(given.module); window.same = module.default.render;"
        "window.away = module.render({ model: window.model, el: document.body }); }",
        {"page": shown.page, "module": module},
    )
    assert page.evaluate("typeof window.same") == "function"
    assert page.locator("iframe").bounding_box()["height"] == 700  # type: ignore[index]
    frame: Frame = page.frames[1]
    frame.wait_for_selector("main.hpop")
    until(frame, READY)  # type: ignore[arg-type]  # which evaluates as a page does
    low, high = np.quantile(whole.costs[:, 0], [0.3, 0.6])
    frame.evaluate(
        f"(s => {{ s.bound(0, {{ low: {low}, high: {high} }}, true); s.hover([7]); s.pin(9); }})(window.hpop.state)"
    )
    until(page, "window.model.saved.some((one) => one.pinned)")
    expected = np.flatnonzero((whole.costs[:, 0] >= low) & (whole.costs[:, 0] <= high)).tolist()
    assert page.evaluate("window.model.saved.at(-1)") == {
        "height": 700, "selected": expected, "hovered": 7, "pinned": [9],
    }  # fmt: skip
    page.evaluate("() => { model.traits.height = 500; model.heard['change:height'].forEach((heard) => heard()); }")
    assert page.locator("iframe").bounding_box()["height"] == 500  # type: ignore[index]
    page.evaluate("() => window.away()")
    assert page.evaluate("[document.body.children.length, Object.values(window.model.heard).flat().length]") == [0, 0]
    assert complaints == []
    page.close()
    shown.close()
