"""Pictures of a robot that stands still: a clock where it does, with how long; the time is shaded."""

import numpy as np
import pytest

from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory
from hpop.view.map import draw_map
from hpop.view.marks import holds_of
from hpop.view.trace import draw_trace
from hpop.view.where import RATE_COLOURS, draw_where

CLOCKS = "stands still, for this time"
AWAY = np.array([0.05, 0.1, 0.15, 0.2])  # m from the upper border


@pytest.fixture(scope="module")
def problem(make_problem):
    return make_problem(["duration", "exposure"])


@pytest.fixture(scope="module")
def held(trajectory):
    """Once before the first move and twice at the corner behind it: at the end of the move, and after the turn."""
    return trajectory.with_hold(at=3, seconds=2.0).with_hold(at=2, seconds=1.0).with_hold(at=0, seconds=150.0)


def texts(artists):
    return [artist.get_text() for artist in artists]


def test_holds_on_one_spot_are_one_clock(held):
    assert [(round(h.x, 9), round(h.y, 9), h.seconds) for h in holds_of(held)] == [(1, 1, 150.0), (1, 6, 3.0)]


def test_maps_say_where_and_for_how_long(problem, trajectory, held):
    trajectories = [held, trajectory]
    costs = np.array([[1.0, 2.0], [2.0, 1.0]])
    declared = {"names": ["duration", "exposure"], "units": ["s", "s"], "quanta": [1e-6, 1e-6], "status": "complete"}
    front = Front.of(costs, trajectories, **declared, certificate="made by hand")
    row = front.trajectories.index(next(t for t in front.trajectories if "hold" in t.kinds))
    figure = draw_map(problem, front, chosen={"calm": row})
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    clocks = [line for line in axes.lines if line.get_gid() == "holds of calm"]
    places = [(float(line.get_xdata()[0]), float(line.get_ydata()[0])) for line in clocks]
    np.testing.assert_allclose(places, [(1, 1), (1, 6)], atol=1e-6)
    assert {"2.5 min", "3 s"} <= set(texts(axes.texts))
    legend = [text for legend in figure.legends for text in texts(legend.get_texts())]
    assert legend.count(CLOCKS) == 1
    figure.canvas.draw()
    nobody = draw_map(problem, front, chosen={"quick": 1 - row})
    assert CLOCKS not in [text for legend in nobody.legends for text in texts(legend.get_texts())]


def test_every_clock_lies_within_the_map(problem):
    """Clocks of the last of several trajectories, at the upper border: they stand below the place."""
    (_, _, _, top), model = problem.world.bounds, problem.model
    ways = [Trajectory.from_poses(model, [(1, y, 0), (3, y, 0)]).with_hold(at=1, seconds=3.0) for y in top - AWAY]
    declared = {"names": ["duration", "exposure"], "units": ["s", "s"], "quanta": [1e-6, 1e-6], "status": "complete"}
    costs = np.stack([np.arange(4.0), 3.0 - np.arange(4.0)], axis=1)
    front = Front.of(costs, ways, **declared, certificate="made by hand")
    figure = draw_map(problem, front, chosen={name: row for row, name in enumerate("abcd")})
    figure.canvas.draw()
    axes = next(axes for axes in figure.axes if axes.get_label() == "map")
    clocks = [line for line in axes.lines if str(line.get_gid()).startswith("holds of")]
    drawn = [line.get_transform().transform(line.get_xydata())[0] for line in clocks]
    assert len(drawn) == 4
    assert all(axes.bbox.contains(*place) for place in drawn)


@pytest.mark.parametrize("draw", ["map", "where"])
def test_clocks_of_spots_near_each_other_stand_side_by_side(problem, draw):
    """Two waits a step apart, as plans among people have them."""
    way = Trajectory.from_poses(problem.model, [(1, 1, 0), (1.25, 1, 0), (3, 1, 0)])
    waits = way.with_hold(at=1, seconds=10.5).with_hold(at=0, seconds=5.5)
    if draw == "where":
        figure = draw_where(problem, waits)
    else:
        declared = {"names": ["duration", "exposure"], "units": ["s", "s"], "quanta": [1e-6, 1e-6]}
        front = Front.of(np.ones((1, 2)), [waits], **declared, status="complete", certificate="made by hand")
        figure = draw_map(problem, front)
    figure.canvas.draw()
    for axes in figure.axes:
        boxes = [text.get_window_extent() for text in axes.texts if text.get_text() in ("10.5 s", "5.5 s")]
        assert len(boxes) in (0, 2)
        assert not boxes or not boxes[0].overlaps(boxes[1])


def test_traces_shade_the_time_of_holds(problem, trajectory, held):
    for drawn, count in ((held, 3), (trajectory, 0)):
        figure = draw_trace(problem, drawn)
        spans = [(p.get_x(), p.get_width()) for p in figure.axes[0].patches if p.get_gid() == "hold"]
        assert len(spans) == count
        if count:
            np.testing.assert_allclose(sorted(spans)[0], (0.0, 150.0))
        assert ("planned standing still" in texts(figure.legends[0].get_texts())) == bool(count)


def test_where_each_cost_arises_a_clock_has_the_colour_of_what_standing_there_costs(problem, held):
    figure = draw_where(problem, held)
    axes = next(axes for axes in figure.axes if axes.get_title().startswith("duration"))
    clocks = [line for line in axes.lines if line.get_gid() == "hold"]
    assert {line.get_markerfacecolor() for line in clocks} == {RATE_COLOURS(1.0)}  # each second costs a second
    assert CLOCKS in [text for legend in figure.legends for text in texts(legend.get_texts())]
    figure.canvas.draw()


def test_a_robot_that_only_stands_can_be_drawn(problem):
    stood = Trajectory.from_poses(problem.model, [(1, 1, 0)]).with_hold(at=0, seconds=3.0)
    traced, where = draw_trace(problem, stood), draw_where(problem, stood)
    traced.canvas.draw()
    where.canvas.draw()
    assert max(axes.get_xlim()[1] for axes in traced.axes) >= 3.0
    assert any(line.get_gid() == "hold" for axes in where.axes for line in axes.lines)
