"""Maps show where a camera looks that does not see all, or not where the base looks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import hpop
from hpop.motions import States
from hpop.view import draw_map
from hpop.view.ground import View
from hpop.view.outlines import APART, REACH
from tests.view.test_map import legend_texts, part

WIDE = math.radians(110)
HEAD = hpop.PanTilt(hpop.DifferentialDrive(), field_of_view=(WIDE, 1.0))
VIEW = View(0.0, 0.0, 10.0, 8.0)


def trajectory(model: hpop.PanTilt, tilt: float = 0.0) -> hpop.Trajectory:
    """Ahead, a turn back of the base alone, ahead to the left."""
    rows = [(1, 1, 0, 0, tilt), (9, 1, 0, 0, tilt), (9, 1, math.pi / 2, -math.pi / 2, tilt)]
    rows.append((9, 6, math.pi / 2, -math.pi / 2, tilt))
    columns = np.array(rows, float).T
    kinds = ("move", "unwind", "move")
    return hpop.Trajectory(model, States(**dict(zip(model.space.names, columns, strict=True))), kinds)


def front_of(problem: hpop.Problem, way: hpop.Trajectory) -> hpop.Front:
    costs = np.array([list(problem.evaluate(way).values())])
    names, units, quanta = zip(*((c.name, c.unit, c.quantum) for c in problem.criteria), strict=True)
    return hpop.Front.of(costs, [way], names=names, units=units, quanta=quanta, status="complete", certificate="made")


def drawn(model, way, world):
    ends = [tuple(float(getattr(way.states, name)[i]) for name in model.space.names) for i in (0, -1)]
    problem = hpop.Problem(world, model, *ends, ["length", "rotation"])
    figure = draw_map(problem, front_of(problem, way), view=VIEW)
    return figure, [c for c in part(figure, "map").collections if str(c.get_gid()).startswith("views of")]


def test_a_head_has_a_wedge_where_it_looks_as_wide_as_it_sees(world):
    way = trajectory(HEAD)
    figure, (views,) = drawn(HEAD, way, world)
    reach = REACH * VIEW.width
    assert any("where the camera looks, 110° wide" in text for text in legend_texts(figure))
    apart = 13.0 / (APART * reach)
    assert len(views.get_paths()) == round(apart) + 1
    for path in views.get_paths():
        low, high = path.get_extents().min, path.get_extents().max
        # It looks along x all the way: from its tip to its reach, and to both sides alike.
        assert high[0] - low[0] == pytest.approx(reach, rel=1e-3)
        assert high[1] - low[1] == pytest.approx(2 * reach * math.sin(WIDE / 2), rel=1e-3)
        assert low[0] == pytest.approx(9.0) or 0.5 * (low[1] + high[1]) == pytest.approx(1.0)


def test_a_camera_that_looks_up_has_shorter_wedges(world):
    lengths = []
    for tilt in (0.0, 0.5):
        _, (views,) = drawn(HEAD, trajectory(HEAD, tilt), world)
        lengths.append(np.ptp(views.get_paths()[0].vertices[:, 0]))
    assert lengths[1] == pytest.approx(lengths[0] * math.cos(0.5), rel=1e-6)


def test_a_wedge_where_all_is_seen_is_a_pointer_and_says_no_width(world):
    head = replace(HEAD, field_of_view=None)
    figure, (views,) = drawn(head, trajectory(head), world)
    assert "where the camera looks" in legend_texts(figure)
    assert np.ptp(views.get_paths()[0].vertices[:, 1]) < 0.3 * REACH * VIEW.width


def test_a_camera_that_sees_all_and_looks_where_the_base_does_needs_no_wedge(make_problem, make_front):
    for model, shown in ((hpop.DifferentialDrive(), False), (hpop.DifferentialDrive(field_of_view=(2.0, 1.0)), True),
                         (hpop.ViewModel(yaw=1.0), True)):  # fmt: skip
        problem = make_problem(model=model)
        figure = draw_map(problem, make_front(problem))
        found = [c for c in part(figure, "map").collections if str(c.get_gid()).startswith("views of")]
        assert bool(found) == shown
        assert any("where the camera looks" in text for text in legend_texts(figure)) == shown
