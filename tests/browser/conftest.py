"""A real browser, headless: Debian's chromium. Where there is none, what needs it is skipped and says so.

Every page is watched: an error on its console, or a request for anything but itself, fails the test.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

# No look-ups of its own at every start; the network of a test machine may be closed.
QUIET = ["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"]
QUIET += ["--disable-component-update", "--disable-sync"]
# Views in three dimensions are drawn by the processor: the same picture on every machine.
DRAWING = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
    "--disable-gpu-rasterization",
    "--disable-accelerated-2d-canvas",
]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One browser a worker; each test has pages and contexts of its own."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("no chromium here: apt-get install chromium")
    expect.set_options(timeout=30_000)  # ms: a loaded machine is slow
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=[*QUIET, *DRAWING])
        yield browser
        browser.close()


class Watched:
    """Opens pages and keeps what they complain of and ask for."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._pages: list[Page] = []
        self.errors: list[str] = []
        self.requests: list[str] = []

    def __call__(
        self, path: Path, fragment: str = "", *, size: tuple[int, int] = (1440, 900), **context: object
    ) -> Page:
        """Open a file of the disk in a window of its own."""
        width, height = size
        page = self._browser.new_context(viewport={"width": width, "height": height}, **context).new_page()
        page.on("console", lambda message: self.errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.goto(path.resolve().as_uri() + fragment)
        self._pages.append(page)
        return page

    def close(self) -> None:
        for page in self._pages:
            page.context.close()


@contextmanager
def watching(browser: Browser) -> Iterator[Watched]:
    watched = Watched(browser)
    yield watched
    watched.close()
    assert watched.errors == []
    others = [url for url in watched.requests if not url.startswith(("file:", "data:", "blob:"))]
    assert others == []
    files = {url.split("#")[0] for url in watched.requests if url.startswith("file:")}
    assert len(files) <= len(watched._pages)


@pytest.fixture
def opened(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Open a page: ``opened(path, "#fragment", size=(390, 844))``; it may request nothing and report no error."""
    with watching(browser) as watched:
        yield watched


@pytest.fixture(scope="module")
def opened_once(browser: Browser) -> Iterator[Callable[..., Page]]:
    """Open a page that several tests of a module share, under the rules of ``opened``."""
    with watching(browser) as watched:
        yield watched
