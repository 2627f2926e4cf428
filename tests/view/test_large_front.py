"""The picture of a large front draws a fixed selection of its lines, and says so."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import hpop
from hpop.view import draw_front, draw_map
from hpop.view.style import MOST_LINES, drawn_rows

CRITERIA = ["turns", "length", "exposure", "rotation", "clearance"]


@pytest.fixture(scope="module")
def problem(make_problem) -> hpop.Problem:
    return make_problem(CRITERIA)


@pytest.fixture(scope="module")
def large(problem, make_front) -> hpop.Front:
    """Return a front of more points than lines are drawn."""
    away = np.abs(np.random.default_rng(0).normal(size=(MOST_LINES + 500, len(CRITERIA))))
    costs = 20.0 - 10.0 * away / np.linalg.norm(away, axis=1)[:, None]  # concave, so that all are non-dominated
    front = make_front(problem, costs=costs)
    assert len(front) > MOST_LINES
    return front


def lines(figure: Figure):
    return [c for axes in figure.axes for c in axes.collections if c.get_label() == "trajectories"]


def test_parallel_lines_are_those_of_rows_evenly_over_the_front(large):
    figure = draw_front(large)
    (drawn,) = lines(figure)
    assert len(drawn.get_segments()) == MOST_LINES
    assert f"{len(large)} non-dominated trajectories, {MOST_LINES:,} of them drawn" in figure.get_suptitle()
    rows = drawn_rows(large)
    assert (rows[0], rows[-1], len(set(rows.tolist()))) == (0, len(large) - 1, MOST_LINES)
    assert np.diff(rows).max() <= np.ceil(len(large) / MOST_LINES)


def test_the_map_says_how_many_it_draws_and_draws_all_that_are_marked(problem, large):
    figure = draw_map(problem, large)
    (drawn,) = lines(figure)
    assert len(drawn.get_segments()) == MOST_LINES
    assert f"{len(large)} trajectories, {MOST_LINES:,} of them drawn" in figure.get_suptitle()
    named = " ".join(text.get_text() for legend in figure.legends for text in legend.get_texts()).split()
    assert all(name in named for name in ("knee:", "least", *CRITERIA))


def test_every_point_of_a_scatter_is_drawn(make_problem, make_front):
    turns = np.arange(MOST_LINES + 500.0)
    front = make_front(make_problem(CRITERIA[:2]), costs=np.stack([turns, turns[::-1]], axis=1))
    assert sum(len(c.get_offsets()) for c in lines(draw_front(front))) == len(front)
