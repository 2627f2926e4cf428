"""A picture of two moments of the session that docs/session.py makes, in a browser: chromium, as the tests use it."""

import datetime
import runpy
import shutil
import sys
from pathlib import Path
from threading import Thread

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from hpop.study.server import StudyServer

BEGIN = datetime.datetime(2026, 11, 23, 9, 30, tzinfo=datetime.UTC)
DESK, PHONE, BETWEEN = (780, 844), (390, 844), 24  # pixels
RIDDEN = 9_000  # ms
ANSWERS = (0, 1, 0, 2, 0)  # to the first questions
OUT = Path("out")
# The view is drawn by the processor: the same picture on every machine.
DRAWING = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def opened(browser: Browser, address: str, size: tuple[int, int]) -> Page:
    """Open a session whose clock stands still."""
    page = browser.new_context(viewport={"width": size[0], "height": size[1]}).new_page()
    page.clock.install(time=BEGIN)
    page.clock.pause_at(BEGIN + datetime.timedelta(seconds=1))
    page.goto(address)
    page.locator("html[data-ready=yes]").wait_for(state="attached")
    return page


def questionnaire(browser: Browser, address: str) -> None:
    """Draw the first questions, some of them answered."""
    page = opened(browser, address, DESK)
    page.locator("#agree").check()
    page.get_by_role("button", name="Begin the session").click()
    questions = page.locator("fieldset").all()
    for question, answer in zip(questions, ANSWERS, strict=False):
        question.locator("label").nth(answer).click()
    page.evaluate("document.activeElement.blur(); scrollTo(0, 0)")
    page.get_by_text("Saved", exact=True).wait_for()
    page.screenshot(path=OUT / "questionnaire.png")
    for question in questions[len(ANSWERS) :]:
        question.locator("label").first.click()
    page.locator("#continue").click()
    page.get_by_text("Saved", exact=True).wait_for()
    page.context.close()


def ride(browser: Browser, address: str) -> None:
    """Draw the ride that comes after them, under way."""
    page = opened(browser, address, PHONE)
    page.frame_locator("iframe").locator("#start").click()
    page.get_by_text("Saved", exact=True).wait_for()
    page.clock.fast_forward(RIDDEN)
    page.clock.run_for(200)
    page.screenshot(path=OUT / "ride.png")
    page.context.close()


runpy.run_path(str(Path(__file__).with_name("session.py")))
chromium = shutil.which("chromium") or shutil.which("chromium-browser")
if chromium is None:
    sys.exit("the picture of a session is made in a browser: apt-get install chromium")
with StudyServer(OUT / "session") as server, sync_playwright() as playwright:
    Thread(target=server.serve_forever, daemon=True).start()
    browser = playwright.chromium.launch(executable_path=chromium, args=DRAWING)
    questionnaire(browser, f"{server.address()}p01")
    ride(browser, f"{server.address()}p01")
    browser.close()
    server.shutdown()
both = Image.new("RGB", (DESK[0] + BETWEEN + PHONE[0], DESK[1]), "white")
both.paste(Image.open(OUT / "questionnaire.png"), (0, 0))
both.paste(Image.open(OUT / "ride.png"), (DESK[0] + BETWEEN, 0))
both.save(OUT / "session.png", optimize=True)
