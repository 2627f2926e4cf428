"""Each page passes the rules of axe, in light and in dark, on a phone. axe comes with `npm ci` in web/."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from hpop import study
from hpop.cli import serving
from hpop.cli.live_server import SEARCHING, WAITING
from hpop.cli.preferring import Asking
from hpop.preference import Preference
from hpop.study.folder import write_pages
from hpop.study.server import PAGE
from hpop.view import save_arm_page, save_ride
from tests.browser.explored import written
from tests.browser.rides import front_of, problem_of, room
from tests.browser.sessions import small_study
from tests.models.serial_arm.arms import arm6
from tests.view.explorer.fronts import seeded

AXE = Path(__file__).parents[2] / "web" / "node_modules" / "axe-core" / "axe.min.js"
VIOLATIONS = (
    "axe.run(document, {resultTypes: ['violations']}).then(r => r.violations.map(v => [v.id, v.nodes[0].html]))"
)


def explorer(folder: Path) -> str:
    return written(*seeded(30), folder / "front.html").read_text()


def ride(folder: Path) -> str:
    problem = problem_of(room())
    return save_ride(problem, front_of(problem), folder / "ride.html", rows=[0, 1]).read_text()


def arm(folder: Path) -> str:
    return save_arm_page(arm6(), folder / "arm.html").read_text()


def session(folder: Path) -> str:
    write_pages(small_study(folder, "ssq", "comfort"), folder, ["p01"])
    return (folder / "pages" / "p01.html").read_text()


def report(folder: Path) -> str:
    front = front_of(problem_of(room()))
    design = study.Design.of(front, [0, 1, "view"], participants=6, consent="Yes.", forms=("ssq", "comfort"))
    answers = study.simulate(design, dict.fromkeys(design.letters, 0.3), seed=1)
    return study.analyse(design, answers).save(folder / "report").read_text()


def sessions(folder: Path) -> str:
    return PAGE.format(language="en", title="Sessions", said="A page each.", rest="<nav><a href='/a/p01'>p01</a></nav>")


def searching(folder: Path) -> str:
    return WAITING.format(words=SEARCHING).replace('<meta http-equiv="refresh" content="1">', "")


def preferring(folder: Path) -> str:
    problem, front = seeded(30)
    return serving.page_of(Asking(Preference.fit(front, count=1_000), problem, front, folder / "p.json", most=2))


@pytest.mark.proof
@pytest.mark.skipif(not AXE.exists(), reason="axe is not installed: npm ci in web/")
@pytest.mark.parametrize("make", [explorer, ride, arm, session, report, sessions, searching, preferring])
def test_a_page_passes_the_rules_of_axe(browser: Browser, tmp_path: Path, make: Callable[[Path], str]) -> None:
    file = tmp_path / "page.html"
    file.write_text(make(tmp_path), encoding="utf-8")
    for scheme in ("light", "dark"):
        with browser.new_context(
            viewport={"width": 390, "height": 844}, color_scheme=scheme, bypass_csp=True
        ) as context:
            page = context.new_page()
            page.goto(file.as_uri())
            page.wait_for_selector("h1", state="attached")
            page.evaluate(AXE.read_text())
            assert page.evaluate(VIOLATIONS) == []
