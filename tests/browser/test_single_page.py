"""Pages in one file: names stay text, nothing is asked of a network, no script but the page's own runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Browser

from hpop.view import single_page

ODD = "</script><b id=odd>bold</b><!-- <script>"


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Write a page whose script records its payload."""
    code = """
    document.documentElement.dataset.given = JSON.parse(document.getElementById("payload").textContent).name;
    const other = document.createElement("script");
    other.textContent = "document.documentElement.dataset.other = 'ran'";
    document.head.append(other);
    try { eval("document.documentElement.dataset.evaluated = 'yes'"); } catch { /* as it should be */ }
    """
    monkeypatch.setattr(single_page, "bundle", lambda _: code)
    path = tmp_path / "page.html"
    path.write_text(single_page.single_page("a.js", ODD, {"name": ODD}), encoding="utf-8")
    return path


def test_a_name_of_markup_stays_text_and_no_other_script_runs(page: Path, browser: Browser) -> None:
    opened = browser.new_page()
    opened.goto(page.as_uri())
    assert opened.title() == ODD
    assert opened.evaluate("({...document.documentElement.dataset})") == {"given": ODD}
    assert opened.query_selector("#odd") is None
    opened.close()
