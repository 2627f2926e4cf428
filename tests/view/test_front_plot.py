from __future__ import annotations

import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from hpop.errors import OptionError
from hpop.view import draw_front
from hpop.view.style import quantities, value_text

SIX = ["turns", "length", "exposure", "rotation", "clearance", "duration"]


@pytest.fixture
def make(make_problem, make_front):
    """Return a front of k criteria and about n points, the first criterion a count."""

    def front(k: int, n: int = 40):
        rng = np.random.default_rng(k)
        away = np.abs(rng.normal(size=(n, k)))
        costs = 20.0 - 10.0 * away / np.linalg.norm(away, axis=1)[:, None]  # concave, so that all are non-dominated
        costs[:, 0] = np.round(costs[:, 0])
        return make_front(make_problem(SIX[:k]), costs=costs)

    return front


def panels(figure: Figure):
    return [axes for axes in figure.axes if axes.collections]


def marked(axes) -> dict[str, list[float]]:
    return {line.get_label(): line.get_xydata()[0].tolist() for line in axes.lines}


@pytest.mark.parametrize("k", [2, 3, 4])
def test_every_pair_of_criteria_has_a_panel_with_every_point(make, k):
    front = make(k)
    drawn = panels(draw_front(front))
    assert len(drawn) == k * (k - 1) // 2
    pairs = [(j, i) for i in range(1, k) for j in range(i)]
    for axes, (j, i) in zip(drawn, pairs, strict=True):
        points = next(c for c in axes.collections if c.get_label() == "trajectories").get_offsets()
        np.testing.assert_array_equal(points, front.costs[:, [j, i]])


@pytest.mark.parametrize("k", [2, 3, 4])
def test_marks_are_the_knee_and_the_bests_of_the_front(make, k):
    front = make(k)
    pairs = [(j, i) for i in range(1, k) for j in range(i)]
    for axes, (j, i) in zip(panels(draw_front(front)), pairs, strict=True):
        points = marked(axes)
        assert set(", ".join(points).split(", ")) == {"knee", *(f"least {name}" for name in front.names)}
        knee = next(at for label, at in points.items() if "knee" in label.split(", "))
        assert knee == front.costs[front.knee().index, [j, i]].tolist()
        least = next(at for label, at in points.items() if f"least {front.names[j]}" in label.split(", "))
        assert least[0] == front.costs[:, j].min()


def test_chosen_points_are_marked_instead(make):
    front = make(2)
    (axes,) = panels(draw_front(front, chosen={"mine": 3}))
    assert marked(axes) == {"mine": front.costs[3].tolist()}


def test_axes_have_names_and_units_and_counts_whole_ticks(make):
    figure = draw_front(make(3))
    figure.canvas.draw()
    labels = {label for axes in panels(figure) for label in (axes.get_xlabel(), axes.get_ylabel()) if label}
    assert labels == {"turns (count)", "length (m)", "exposure (s)"}
    ticks = panels(figure)[0].get_yticks(), panels(figure)[0].get_xticks()
    assert all(tick == round(tick) for tick in ticks[1])
    assert "less is better" in figure.get_suptitle()


@pytest.mark.cases("2", "4")
@pytest.mark.parametrize("k", [2, 3, 4, 5, 6])
def test_the_legend_gives_the_costs_and_covers_no_panel(make, k):
    front = make(k)
    figure = draw_front(front)
    figure.canvas.draw()
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    (legend,) = legends
    texts = [" ".join(text.get_text().split()) for text in legend.get_texts()]
    (knee,) = (text for text in texts if text.startswith("knee"))
    assert f"turns {front.knee().costs['turns']:.0f}" in knee
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_window_extent()) for axes in panels(figure))
    assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
    assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


@pytest.mark.cases("2", "6")
@pytest.mark.parametrize("k", [2, 3, 6])
def test_the_legend_tells_of_the_trajectories_without_a_mark_where_there_are_some(make, make_problem, make_front, k):
    two = make_front(
        make_problem(SIX[:k]), costs=np.array([[1.0, 2.0] + [1.0] * (k - 2), [2.0, 1.0] + [1.0] * (k - 2)])
    )
    for front, there in ((make(k), True), (two, False)):
        figure = draw_front(front)
        (legend,) = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
        entries = {
            text.get_text(): handle for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
        }
        assert ("one of the other trajectories" in entries) is there
        if there:
            drawn = next(c for axes in figure.axes for c in axes.collections if c.get_label() == "trajectories")
            colour = drawn.get_edgecolor()[0] if k == 6 else drawn.get_facecolor()[0]
            assert to_hex(colour) == to_hex(entries["one of the other trajectories"].get_color())


def test_what_two_criteria_dominate_is_shaded(make):
    front = make(2)
    (axes,) = panels(draw_front(front))
    (area,) = (c for c in axes.collections if c.get_label() == "dominated")
    path = area.get_paths()[0]
    lower_left = front.costs - 1e-6
    upper_right = front.costs + 1e-6
    assert not path.contains_points(lower_left).any()
    assert path.contains_points(upper_right).all()


@pytest.mark.parametrize("k", [5, 6])
def test_more_criteria_become_parallel_axes_with_the_least_at_the_bottom(make, k):
    front = make(k)
    figure = draw_front(front)
    (host,) = (axes for axes in figure.axes if axes.get_label() == "parallel")
    (lines,) = (c for c in host.collections if isinstance(c, LineCollection))
    heights = np.array(lines.get_segments())[:, :, 1]
    assert heights.shape == front.costs.shape
    scales = [next(a for a in figure.axes if a.get_label().startswith(name)) for name in front.names]
    for j, scale in enumerate(scales):
        low, high = scale.get_ylim()
        assert low < front.costs[:, j].min() < front.costs[:, j].max() < high
        np.testing.assert_allclose(low + heights[:, j] * (high - low), front.costs[:, j])
    assert [t.get_text() for t in host.get_xticklabels()][:2] == ["turns\n(count)", "length\n(m)"]
    assert all(tick == round(tick) for tick in scales[0].get_yticks())
    assert "best is at the bottom" in figure.get_suptitle()


@pytest.mark.cases("3")
@pytest.mark.parametrize("k", [2, 3, 6])
def test_a_criterion_that_is_constant_can_be_drawn(make_problem, make_front, k):
    front = make_front(make_problem(SIX[:k]), costs=np.arange(float(k))[None])
    figure = draw_front(front)
    figure.canvas.draw()
    assert f"{len(front)} non-dominated" in figure.get_suptitle()


def test_one_criterion_is_one_axis(make_problem, make_front):
    front = make_front(make_problem(["length"]))
    figure = draw_front(front)
    (host,) = (axes for axes in figure.axes if axes.get_label() == "parallel")
    assert host.lines[0].get_label() == "knee, least length"


def test_thousands_of_points_are_all_there(make):
    front = make(4, n=3000)
    assert len(front) > 2000
    figure = draw_front(front)
    assert len(panels(figure)[0].collections[0].get_offsets()) == len(front)


def test_an_empty_front_is_refused_with_its_status(make_problem, make_front):
    with pytest.raises(OptionError, match="no path"):
        draw_front(make_front(make_problem(), costs=np.zeros((0, 2)), status="no path"))


def test_rounding_noise_below_the_quantum_is_written_as_nothing(make_problem, make_front):
    front = make_front(make_problem(["exposure", "length"]), np.array([[3e-32, 8.0], [2e-6, 6.0]]))
    exposure, *_ = quantities(front)
    assert [value_text(value, "s", False) for value in exposure.values] == ["0 s", "2.00e-06 s"]
