from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria.base import make_criterion
from hpop.criteria.costs import trajectory_cost
from hpop.motions import States
from hpop.problems.evaluation import trace
from hpop.view import draw_trace
from hpop.view.trace import camera_rates
from tests.models.serial_arm.arms import arm6

NAMES = ["obstruction", "turns", "length", "clearance", "exposure", "rotation", "duration"]


@pytest.fixture
def problem(make_problem):
    return make_problem(NAMES)


@dataclass(frozen=True)
class Moves:
    """The number of motions that are moves: cutting a move in two would change it."""

    name = "moves"
    group = "R"
    unit = "1"
    aggregate = "sum"
    requires = ()
    smooth = False
    quantum = 1.0

    def cost(self, m):
        return np.full(len(m), float(m.kind == "move"))


@dataclass(frozen=True)
class Elapsed:
    """The time so far: a criterion with memory."""

    name = "elapsed"
    group = "R"
    unit = "s"
    aggregate = "trajectory"
    requires = ()
    smooth = False
    quantum = 1e-6

    def cost(self, m):
        return m.t0 + m.duration


def row(figure, name):
    return next(axes for axes in figure.axes if axes.get_ylabel().startswith(name + "\n"))


def curve(axes):
    return axes.lines[0].get_xydata()


@pytest.mark.cases(2)
@pytest.mark.parametrize("name", NAMES)
def test_a_running_value_ends_at_the_cost_of_the_trajectory(problem, trajectory, name):
    criterion = make_criterion(name)
    values = trace([criterion], trajectory, problem.world).running[:, 0]
    assert values[-1] == pytest.approx(trajectory_cost(criterion, trajectory, problem.world))
    drawn = curve(row(draw_trace(problem, trajectory), name))
    assert drawn[-1] == pytest.approx([trajectory.duration, values[-1]], rel=1e-3)


@pytest.mark.cases(1)
@pytest.mark.cases("turns", "clearance")
@pytest.mark.parametrize("name", ["turns", "length", "exposure", "clearance"])
def test_totals_and_worst_values_never_fall(problem, trajectory, name):
    drawn = curve(row(draw_trace(problem, trajectory), name))
    assert (np.diff(drawn, axis=0) >= 0).all()


def test_a_running_mean_at_any_end_of_a_motion_is_the_mean_until_then(problem, trajectory):
    criterion = make_criterion("obstruction")
    traced = trace([criterion], trajectory, problem.world)
    values, alone, weights = traced.running[:, 0], traced.rate[:, 0], np.diff(traced.times)
    np.testing.assert_allclose(values, np.cumsum(alone * weights) / np.cumsum(weights))


def test_each_row_has_a_unit_and_its_cost_at_the_end(problem, trajectory):
    figure = draw_trace(problem, trajectory)
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels[:3] == ["obstruction\n(share)", "turns\n(count)", "length\n(m)"]
    assert labels[-2:] == ["camera speed\n(m/s)", "camera yaw rate\n(rad/s)"]
    assert [text.get_text() for text in row(figure, "length").texts] == ["18.0 m"]
    assert figure.axes[-1].get_xlabel() == "time (s)"


def test_rows_share_the_time_axis_up_to_the_later_end(problem, trajectory):
    figure = draw_trace(problem, trajectory)
    assert {axes.get_xlim() for axes in figure.axes} == {
        (0.0, max(trajectory.duration, trajectory.execution().duration))
    }


def test_planned_turns_are_shaded_in_every_row(problem, trajectory):
    figure = draw_trace(problem, trajectory)
    turns = [i for i, kind in enumerate(trajectory.kinds) if kind == "turn"]
    for axes in figure.axes:
        spans = [patch.get_extents() for patch in axes.patches if patch.get_gid() == "turn"]
        boxes = [span.transformed(axes.transData.inverted()) for span in spans]
        np.testing.assert_allclose([box.x0 for box in boxes], trajectory.times[turns], atol=1e-9)
        np.testing.assert_allclose([box.x1 for box in boxes], trajectory.times[np.add(turns, 1)], atol=1e-9)


def test_planned_and_executed_speeds_cover_the_same_path(problem, trajectory):
    for line in row(draw_trace(problem, trajectory), "camera speed").lines:
        times, speed = line.get_xydata().T
        assert np.trapezoid(speed, times) == pytest.approx(18.0, rel=1e-3)
    for line in row(draw_trace(problem, trajectory), "camera yaw rate").lines:
        times, rate = line.get_xydata().T
        assert np.trapezoid(np.abs(rate), times) == pytest.approx(2 * np.pi, rel=1e-3)


def test_a_camera_off_the_axis_moves_in_turns():
    model = hpop.DifferentialDrive(camera_offset=(0.3, 0.4))
    trajectory = hpop.Trajectory.from_poses(model, [(0, 0, 0), (2, 0, 2.0)]).execution()
    times = np.linspace(0.0, trajectory.duration, 20001)
    camera = model.pose("camera", trajectory.at(times))
    measured = np.hypot(np.gradient(camera.x, times), np.gradient(camera.y, times))
    speed, rate, _ = camera_rates(trajectory, times)
    np.testing.assert_allclose(speed, measured, atol=2e-3)
    assert rate.max() == pytest.approx(model.turn_rate)
    assert speed.max() == pytest.approx(max(model.speed, 0.5 * model.turn_rate))


def test_a_criterion_that_counts_motions_is_drawn_motion_by_motion(make_problem, trajectory):
    problem = make_problem([Moves(), "length"])
    assert curve(row(draw_trace(problem, trajectory), "moves"))[-1] == pytest.approx([trajectory.duration, 3.0])
    assert len(curve(row(draw_trace(problem, trajectory), "length"))) > 100


def test_a_criterion_with_memory_shows_its_running_value(make_problem, trajectory):
    drawn = curve(row(draw_trace(make_problem([Elapsed()]), trajectory), "elapsed"))
    np.testing.assert_allclose(drawn[:, 0], drawn[:, 1], atol=1e-9)


def test_a_trajectory_without_motions_can_be_drawn(problem):
    still = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0)])
    figure = draw_trace(problem, still, name="standing still")
    figure.canvas.draw()
    assert figure.get_suptitle() == "Along standing still: planned 0.0 s, executed 0.0 s"


def test_the_legend_tells_of_turns_in_place_only_where_there_are_some(problem, trajectory):
    straight = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (9, 1, 0)])
    for drawn, there in ((trajectory, True), (straight, False)):
        (legend,) = draw_trace(problem, drawn).legends
        assert ("planned turn in place" in [text.get_text() for text in legend.get_texts()]) is there


def test_what_is_executed_as_it_is_planned_is_one_line():
    model = arm6()
    ends = States(**{name: np.array([0.1, 0.6]) for name in model.space.names})
    world = hpop.World.from_polygons([], extent=shapely.box(-1, -1, 1, 1))
    reach = hpop.Trajectory.through(model, ends)
    goal = model.space.values(ends.take(slice(1, None)))
    figure = draw_trace(hpop.Problem(world, model, (0.1,) * 6, goal, ["duration"]), reach)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["planned and executed"]
    assert figure.get_suptitle().endswith("s, executed as planned")
    assert len(row(figure, "camera speed").lines) == 1
