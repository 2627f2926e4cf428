"""Pages of a tour: the explorer selects rows by the order of visits, and a ride names the stop where it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

import hpop
from hpop.view import save_ride
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import selected, state, until
from tests.browser.rides import ready
from tests.tours import STOPS, tour_front, tour_problem

NAMES = ["east", "north", "vase", "passed"]


@pytest.fixture(scope="module")
def problem() -> hpop.Problem:
    return tour_problem()


@pytest.fixture(scope="module")
def front(problem: hpop.Problem) -> hpop.Front:
    return tour_front(problem)


@pytest.fixture(scope="module")
def orders(front: hpop.Front) -> list[str]:
    """Return the order of each row, by the recorded visits."""
    return [
        " ".join(str(NAMES.index(v["stop"]) + 1) for v in sorted(origin["visits"], key=lambda v: v["begin"]))
        for origin in front.provenance
    ]


@pytest.fixture(scope="module")
def shared(problem: hpop.Problem, front: hpop.Front, opened_once: Watched, tmp_path_factory: Any) -> Page:
    path = explored.written(problem, front, tmp_path_factory.mktemp("page") / "front.html")
    return opened_once(path, size=(1440, 900))


@pytest.fixture
def page(shared: Page) -> Page:
    explored.fresh(shared)
    return shared


def test_an_order_of_stops_selects_its_rows_and_is_undone(page: Page, orders: list[str]) -> None:
    order = max(set(orders), key=orders.count)
    expected = [one == order for one in orders]
    page.get_by_label("order of stops").select_option(order)
    assert selected(page).tolist() == expected
    cells = page.locator(".tr:visible .td:nth-child(2)").all_inner_texts()
    assert set(cells) == {order}
    page.keyboard.press("Alt+ArrowLeft")
    assert selected(page).all()
    assert page.get_by_label("order of stops").input_value() == ""


def test_orders_to_choose_say_which_stops_they_miss_and_how_many_rows_they_have(page: Page, orders: list[str]) -> None:
    texts = page.get_by_label("order of stops").locator("option").all_inner_texts()
    assert texts[0] == "any"
    assert len(texts) == 1 + len(set(orders))
    for text in texts[1:]:
        numbers, _, count = text.partition(" (")
        visited, _, missed = numbers.partition(", without ")
        order = visited.replace(" → ", " ")
        assert int(count.rstrip(")")) == orders.count(order)
        assert sorted([*order.split(), *missed.split()]) == list("1234")


@pytest.mark.proof
def test_bounds_and_an_order_both_hold_and_a_link_restores_both(page: Page, front: hpop.Front, orders: Any) -> None:
    order = max(set(orders), key=orders.count)
    page.get_by_label("order of stops").select_option(order)
    turns = front.costs[:, front.names.index("turns")]
    most = int(np.median(turns[[one == order for one in orders]]))
    field = page.get_by_label("greatest turns")
    field.fill(str(most))
    field.press("Enter")
    expected = ((turns <= most) & np.array([one == order for one in orders])).tolist()
    assert selected(page).tolist() == expected
    assert 0 < sum(expected) < orders.count(order)
    until(page, f"['turns:', 'stops={order.replace(' ', '-')}'].every(part => location.hash.includes(part))")
    link = page.evaluate("location.hash")
    explored.fresh(page)
    page.evaluate("link => { location.hash = link }", link)
    letters = "".join("1" if one else "0" for one in expected)
    until(page, f"window.hpop.state.selected.join('') === '{letters}'")  # in a later frame than the filter


def test_kept_rows_stay_when_the_order_is_let_go_and_python_code_lists_the_rows(page: Page, orders: Any) -> None:
    order = min(set(orders), key=orders.count)
    rows = [row for row, one in enumerate(orders) if one == order]
    page.get_by_label("order of stops").select_option(order)
    page.get_by_role("button", name="Copy…").click()
    assert f"front[np.isin(np.arange(len(front)), {rows})]" in page.get_by_label("Python").input_value()
    page.locator("dialog[open] .close").click()
    page.get_by_role("button", name="Keep").click()
    assert np.flatnonzero(selected(page)).tolist() == rows  # waits for a frame
    assert page.get_by_label("order of stops").input_value() == ""


def test_rows_are_sorted_by_their_order(page: Page, orders: list[str]) -> None:
    page.locator(".thead button", has_text="stops").first.click()
    found = [orders[row] for row in state(page, "[...s.sorted]")]
    assert sorted(found, key=lambda order: (len(order), order)) == found
    assert len(found) == len(orders)


def test_the_legend_names_the_numbers_and_the_chart_says_what_is_shaded(page: Page, front: hpop.Front) -> None:
    legend = page.inner_text(".map .legend")
    assert all(f"stop: {name}" in legend for name in NAMES)
    row = int(front.knee().index)
    page.evaluate(f"window.hpop.state.pin({row})")
    page.evaluate(explored.FRAME)
    visits = sorted(front.provenance[row]["visits"], key=lambda v: v["begin"])
    listed = ", ".join(f"{NAMES.index(v['stop']) + 1} {v['stop']}" for v in visits)
    assert f"at stop {listed}" in page.inner_text(".trace .hint")


def test_a_front_without_a_tour_has_no_orders_to_choose(page: Page, front: hpop.Front, problem: hpop.Problem) -> None:
    plain = hpop.Problem(problem.world, problem.model, problem.start, (2, 4, None), ["turns", "length"])
    page.get_by_label("order of stops").select_option(index=1)
    page.evaluate("given => window.hpop.update(given)", explored.payload(plain, plain.solve("lattice", step=1.0)))
    page.evaluate(explored.FRAME)
    assert page.get_by_label("order of stops").is_hidden()
    assert selected(page).all()
    assert "stops" not in page.inner_text(".thead")
    page.evaluate("given => window.hpop.update(given)", explored.payload(problem, front))


@pytest.mark.proof
@pytest.mark.parametrize("blind", [False, True])
def test_a_ride_names_the_stop_at_which_it_stands_unless_it_is_blind(
    blind: bool, problem: hpop.Problem, front: hpop.Front, opened: Watched, tmp_path: Path
) -> None:
    path = save_ride(problem, front, tmp_path / "ride.html", rows=[0], blind=blind)
    page = ready(opened(path, "#check", size=(720, 420)))
    run = front.trajectories[0].execution()
    x, y = STOPS[0]["at"]  # type: ignore[misc]
    moments = np.linspace(0.0, run.duration, 1000)
    near = np.hypot(run.at(moments).x - x, run.at(moments).y - y) <= 0.6  # type: ignore[operator]
    still = np.abs(run.rates(moments)[0].x) + np.abs(run.rates(moments)[0].y) + np.abs(run.rates(moments)[0].yaw) == 0.0
    middle = float(np.median(moments[near & still]))
    for time, is_there in ((middle, not blind), (0.0, False)):
        page.locator("#scrub").fill(str(1000 * time / run.duration))
        page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        assert ("stop 1: east" in page.inner_text("#seen")) == is_there
    assert ("vase" in path.read_text(encoding="utf-8").split('id="payload"')[1].split('"tracks"')[1]) == (
        not blind and any(v["stop"] == "vase" for v in front.provenance[0]["visits"])
    )
