"""Every picture can be drawn in a figure of the user's own."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure

import hpop
from hpop.criteria.costs import trajectory_costs
from hpop.errors import OptionError
from hpop.view import draw_front, draw_map, draw_side, draw_states, draw_trace, draw_where
from tests.test_table import HEAD, PANNED

DRAWN = {
    "map": lambda problem, front, ax: draw_map(problem, front, ax=ax),
    "side": lambda problem, front, ax: draw_side(problem, front, ax=ax),
    "front": lambda problem, front, ax: draw_front(front, ax=ax),
    "trace": lambda problem, front, ax: draw_trace(problem, front.trajectories[0], ax=ax),
    "where": lambda problem, front, ax: draw_where(problem, front.trajectories[0], ax=ax),
}
ON_AXES = ("map", "side")


@pytest.fixture(scope="module")
def problem(make_problem):
    return make_problem()


@pytest.fixture(scope="module")
def front(problem, make_front):
    return make_front(problem, np.array([[0.0, 20.0], [2.0, 14.0], [4.0, 9.0]]))


@pytest.mark.cases("map", "front", "where")
@pytest.mark.parametrize("name", DRAWN)
def test_a_picture_keeps_to_its_half_of_a_figure_and_leaves_the_rest(problem, front, name):
    figure = Figure(figsize=(16, 7), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [1, 0])
    before = tuple(figure.get_size_inches())
    assert DRAWN[name](problem, front, right) is figure
    figure.canvas.draw()
    assert tuple(figure.get_size_inches()) == before
    drawn = [axes for part in (figure, *figure.subfigs) for axes in part.axes if axes is not left]
    assert drawn
    border = left.get_window_extent().x1
    assert border < 0.55 * figure.bbox.width
    assert all(axes.get_window_extent().x0 > border for axes in drawn)
    assert len(left.lines) == 1
    assert (right in figure.axes) == (name in ON_AXES)


def test_the_map_on_axes_names_its_trajectories_and_has_its_bars(problem, front):
    figure = Figure(figsize=(9, 8), layout="constrained")
    axes = figure.subplots()
    draw_map(problem, front, ax=axes)
    named = {text.get_text().partition(":")[0] for text in axes.get_legend().get_texts()}
    assert any("knee" in name for name in named)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    assert any("length" in bar.get_ylabel() for bar in figure.axes if bar is not axes)
    assert axes.get_title().startswith(f"{len(front)} trajectories")


def test_states_take_the_place_of_axes_too():
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 8, 8))
    ends = [PANNED.model.space.values(PANNED.states.take([place])) for place in (0, -1)]
    problem = hpop.Problem(world, HEAD, *ends, criteria=["length"])
    front = hpop.Front.of(
        trajectory_costs(problem.criteria, [PANNED], world), [PANNED], names=["length"], units=["m"], quanta=[1e-6],
        status="complete", certificate="by hand",
    )  # fmt: skip
    figure = Figure(figsize=(12, 5), layout="constrained")
    _, right = figure.subplots(1, 2)
    assert draw_states(front, ax=right) is figure
    figure.canvas.draw()
    assert [panel.get_title(loc="left") for panel in figure.subfigs[0].axes] == ["yaw (°)", "pan (°)"]


@pytest.mark.parametrize("name", DRAWN)
def test_what_are_no_axes_is_refused(problem, front, name):
    with pytest.raises(OptionError, match=r"ax must be axes of Matplotlib"):
        DRAWN[name](problem, front, Figure())


def test_panels_need_axes_of_a_grid(front):
    figure = Figure()
    with pytest.raises(OptionError, match=re.escape("ax must be axes in a grid, such as plt.subplots(1, 2)")):
        draw_front(front, ax=figure.add_axes((0.1, 0.1, 0.8, 0.8)))
