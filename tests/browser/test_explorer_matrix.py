"""The explorer's scatter matrix: points where NumPy puts them, the nearest picked, rectangles that bound columns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page

import hpop
from benchmarks import seeded_fronts as seeded
from hpop.base.arrays import FloatArray
from tests.browser import explored
from tests.browser.conftest import Watched
from tests.browser.explored import bounds, selected, state, within

N, K = 300, 3
# Layout of the plot, CSS pixels: left of all cells, below all, between and round them, within a cell round its points.
LEFT, BOTTOM, GAP, PAD = 64, 36, 8, 6


@pytest.fixture(scope="module")
def front() -> hpop.Front:
    return seeded.front(N, K)


@pytest.fixture(scope="module")
def shared(front: hpop.Front, opened_once: Watched, tmp_path_factory: pytest.TempPathFactory) -> Page:
    path = explored.written(seeded.problem(K), front, tmp_path_factory.mktemp("matrix") / "front.html")
    return opened_once(path)


@dataclass
class Matrix:
    """The lower triangle of all columns of a front, or one pair of them."""

    page: Page
    values: FloatArray  # (n, k)

    def cell(self, across: int, up: int, columns: int) -> tuple[float, float, float, float]:
        """Left, top, width and height of a cell of the triangle, pixels of the plot."""
        width, height = self.page.eval_on_selector(".matrix .plot", "e => [e.clientWidth, e.clientHeight]")
        wide = (width - LEFT - GAP) / (columns - 1) - GAP
        high = (height - BOTTOM - GAP) / (columns - 1) - GAP
        return LEFT + across * (wide + GAP), GAP + (up - 1) * (high + GAP), wide, high

    def points(self, across: int, up: int, box: tuple[float, float, float, float]) -> FloatArray:
        """Return the pixels (n, 2) of the rows on the plot."""
        low, high = self.values.min(axis=0), self.values.max(axis=0)
        share = (self.values - low) / (high - low)
        left, top, wide, tall = box
        x = left + PAD + share[:, across] * (wide - 2 * PAD)
        return np.stack([x, top + PAD + (1 - share[:, up]) * (tall - 2 * PAD)], axis=1)

    def corner(self) -> FloatArray:
        """Upper left corner of the plot on the screen."""
        box = self.page.locator(".matrix .plot").bounding_box()
        assert box is not None
        return np.array([box["x"], box["y"]])

    def pixels(self) -> FloatArray:
        """Red, green, blue and opacity (height, width, 4) of the base."""
        return explored.pixels(self.page, ".matrix .base")


@pytest.fixture
def matrix(shared: Page, front: hpop.Front) -> Matrix:
    explored.fresh(shared)
    shared.mouse.move(2, 2)
    return Matrix(shared, np.hstack([front.costs, front.reported]))


def coloured(pixels: FloatArray) -> FloatArray:
    """Return a mask of the pixels in the colour of selected rows."""
    return np.asarray(pixels[:, :, 2] - pixels[:, :, 0] > 25, dtype=np.float64)


def test_every_pair_has_a_cell_and_every_row_a_point_in_it(matrix: Matrix) -> None:
    drawn = coloured(matrix.pixels())
    columns = matrix.values.shape[1]
    for across, up in combinations(range(columns), 2):
        left, top, wide, tall = box = matrix.cell(across, up, columns)
        x, y = np.floor(matrix.points(across, up, box)).astype(int).T
        assert drawn[y, x].mean() > 0.99  # a float of the page may fall into the next pixel
        part = drawn[round(top) + 2 : round(top + tall) - 2, round(left) + 2 : round(left + wide) - 2]
        mask = np.zeros_like(drawn)
        for dy in range(-3, 4):
            for dx in range(-3, 4):
                mask[y + dy, x + dx] = 1
        inside = mask[round(top) + 2 : round(top + tall) - 2, round(left) + 2 : round(left + wide) - 2]
        assert (part * (1 - inside)).sum() == 0  # and nowhere else


@pytest.mark.proof
def test_hover_takes_the_nearest_point_and_every_view_shows_that_row(matrix: Matrix) -> None:
    page, rng = matrix.page, np.random.default_rng(5)
    columns = matrix.values.shape[1]
    drawn = page.evaluate("window.hpop.counters.base.length")
    for across, up in combinations(range(columns), 2):
        box = matrix.cell(across, up, columns)
        points = matrix.points(across, up, box)
        spot = points[rng.integers(len(points))] + rng.uniform(-2, 2, size=2)
        spot = np.clip(spot, [box[0] + 1, box[1] + 1], [box[0] + box[2] - 1, box[1] + box[3] - 1])
        page.mouse.move(*(matrix.corner() + spot).tolist())
        distance = np.hypot(*(points - spot).T)
        focus = state(page, "s.focus")
        assert distance[focus] <= distance.min() + 0.05  # of a page in whole pixels and single precision
        assert set(state(page, "s.hovered")) <= set(np.flatnonzero(distance <= distance.min() + 0.7).tolist())
        assert page.get_attribute(".map .plot", "data-highlighted") == ",".join(map(str, state(page, "s.hovered")))
        assert page.get_attribute(".trace .plot", "data-focus") == str(focus)
    assert page.evaluate("window.hpop.counters.base.length") == drawn
    page.mouse.move(2, 2)
    assert state(page, "s.hovered") == []


@pytest.mark.cases("2-3-True")
@pytest.mark.parametrize(("across", "up", "flipped"), [(0, 2, False), (0, 1, False), (2, 3, True)])
def test_a_rectangle_selects_the_points_that_numpy_finds_in_it(
    matrix: Matrix, front: hpop.Front, across: int, up: int, flipped: bool
) -> None:
    page = matrix.page
    if flipped:
        page.evaluate(f"window.hpop.state.flip({across})")
        page.evaluate(explored.FRAME)
        matrix = Matrix(page, matrix.values * np.where(np.arange(4) == across, -1, 1))
    box = matrix.cell(across, up, matrix.values.shape[1])
    begin = matrix.corner() + np.array([box[0] + 0.25 * box[2], box[1] + 0.2 * box[3]])
    end = matrix.corner() + np.array([box[0] + 0.8 * box[2], box[1] + 0.7 * box[3]])
    begin, end = np.round(begin), np.round(end)
    page.mouse.move(*begin.tolist())
    page.mouse.down()
    page.mouse.move(*((begin + end) / 2).tolist())
    page.mouse.move(*end.tolist())
    page.mouse.up()
    asked = bounds(page)
    names = front.names + front.reported_names
    assert set(asked) == {names[across], names[up]}
    expected = within(front, asked)
    assert selected(page).tolist() == expected.tolist()
    # The bounds are those of the rectangle: points well within it are selected, points well outside are not. Turns
    # come in whole steps, of which the rectangle takes in those that it comes near to.
    points = matrix.points(across, up, box) + matrix.corner()
    slack = 3.0
    assert expected[np.all((points > begin + slack) & (points < end - slack), axis=1)].all()
    assert not expected[np.any((points < begin - slack) | (points > end + slack), axis=1)].any()
    assert 5 < expected.sum() < len(front) - 5
    assert state(page, "s.history.canBack")
    page.evaluate("window.hpop.state.back()")
    assert state(page, "s.count") == len(front)  # one step back: the rectangle was one


def test_a_click_beside_all_points_frees_the_two_columns(matrix: Matrix) -> None:
    page = matrix.page
    box = matrix.cell(0, 2, matrix.values.shape[1])
    page.evaluate("for (const i of [0, 1, 2]) window.hpop.state.bound(i, { low: 12, high: 13 })")
    points = matrix.points(0, 2, box)[selected(matrix.page)]
    corners = [np.array([box[0] + a, box[1] + b]) for a in (3, box[2] - 3) for b in (3, box[3] - 3)]
    spot = max(corners, key=lambda corner: np.hypot(*(points - corner).T).min(initial=99))
    page.mouse.click(*(matrix.corner() + spot).tolist())
    assert list(bounds(page)) == ["turns"]


def test_pins_have_marks_of_different_shapes(matrix: Matrix) -> None:
    matrix.page.evaluate("for (const row of [3, 40, 77]) window.hpop.state.pin(row)")
    matrix.page.evaluate(explored.FRAME)
    box = matrix.cell(0, 1, matrix.values.shape[1])
    points = matrix.points(0, 1, box)[[3, 40, 77]]
    js = "(e, [x, y]) => [...e.getContext('2d').getImageData(x, y, 1, 1).data.slice(0, 3)]"
    found = [matrix.page.eval_on_selector(".matrix .overlay", js, np.floor(point).tolist()) for point in points]
    assert found == [[213, 94, 0], [0, 114, 178], [204, 121, 167]]


@pytest.mark.proof
def test_more_columns_than_a_triangle_has_room_for_are_a_chosen_pair(
    opened: Callable[..., Page], tmp_path: Path
) -> None:
    front = seeded.front(200, 7)
    page = opened(explored.written(seeded.problem(7), front, tmp_path / "front.html"))
    explored.until(page, explored.READY)
    assert page.is_visible(".matrix .pair")
    page.select_option(".matrix select >> nth=0", label="exposure")
    page.select_option(".matrix select >> nth=1", label="rotation")
    page.evaluate(explored.FRAME)
    matrix = Matrix(page, np.hstack([front.costs, front.reported]))
    width, height = page.eval_on_selector(".matrix .plot", "e => [e.clientWidth, e.clientHeight]")
    box = (LEFT, GAP, width - LEFT - 2 * GAP, height - BOTTOM - 2 * GAP)
    points = matrix.points(front.names.index("exposure"), front.names.index("rotation"), box)
    spot = points[17] + 0.3
    page.mouse.move(*(matrix.corner() + spot).tolist())
    focus = state(page, "s.focus")
    distance = np.hypot(*(points - spot).T)
    assert distance[focus] <= distance.min() + 0.05


@pytest.mark.proof
def test_one_column_has_no_pairs_and_says_so(opened: Callable[..., Page], tmp_path: Path) -> None:
    page = opened(explored.written(seeded.problem(2), seeded.front(20, 2), tmp_path / "front.html"))
    explored.until(page, explored.READY)
    assert not page.is_visible(".matrix .note")
    page.evaluate("for (const i of [0, 1]) window.hpop.state.show(i, false)")
    page.evaluate(explored.FRAME)
    assert page.is_visible(".matrix .note")
