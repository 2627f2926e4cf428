"""The rate of each criterion on the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hpop
from hpop.view import draw_where
from hpop.world.content import Landmark

NAMES = ["obstruction", "turns", "length"]


@pytest.fixture
def problem(make_problem):
    return make_problem(NAMES)


@pytest.fixture
def trajectory(problem):
    return hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (1, 6, 0), (9, 6, 0), (9, 1, 0)])


def maps(figure):
    return [axes for axes in figure.axes if axes.get_xlabel() == "x (m)"]


def lines(axes):
    return next(c for c in axes.collections if c.get_gid() == "rate")


def test_there_is_one_map_a_criterion_with_its_cost(problem, trajectory):
    figure = draw_where(problem, trajectory, name="a test")
    titles = [axes.get_title() for axes in maps(figure)]
    assert [title.split(":")[0] for title in titles] == NAMES
    assert titles[1:] == ["turns: 4 in all", "length: 18.0 m in all"]
    assert titles[0].endswith("on average")
    assert "a test" in figure.get_suptitle()


def test_the_colours_are_the_rates_of_the_trace_where_the_robot_moves(problem, trajectory):
    trace = problem.trace(trajectory)
    moving = np.array([kind == "move" for kind in trace.trajectory.kinds])
    for column, axes in enumerate(maps(draw_where(problem, trajectory))):
        drawn = lines(axes)
        np.testing.assert_array_equal(drawn.get_array(), trace.rate[moving, column])
        assert drawn.norm.vmin == 0.0
        assert drawn.norm.vmax == (trace.rate[:, column].max() or 1.0)


def test_turns_in_place_are_dots_where_they_are_made(problem, trajectory):
    axes = maps(draw_where(problem, trajectory))[1]
    (dots,) = (c for c in axes.collections if c.get_gid() is None and len(c.get_offsets()) == 4)
    assert sorted(map(tuple, np.round(dots.get_offsets(), 9))) == [(1, 1), (1, 6), (9, 1), (9, 6)]


def test_a_trajectory_without_motions_can_be_drawn(problem):
    figure = draw_where(problem, hpop.Trajectory.from_poses(problem.model, [(1, 1, 0)]))
    figure.canvas.draw()
    assert len(maps(figure)) == 3


def test_the_floor_is_white_where_all_beyond_the_map_is_obstacle():
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[15:25, 18:22] = True
    world = hpop.World.from_cells(occupied, 0.25)
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (2, 2, 0), (8, 2, 0), ["length"])
    figure = draw_where(problem, hpop.Trajectory.from_poses(problem.model, [(2, 2, 0), (8, 2, 0)]))
    figure.canvas.draw()
    (axes,) = maps(figure)
    column, row = axes.transData.transform((2.0, 8.0)).astype(int)
    pixels = np.asarray(figure.canvas.buffer_rgba())
    assert pixels[pixels.shape[0] - row, column, :3].min() > 250


def test_landmarks_are_drawn_without_the_names_that_would_cover_each_other(problem, trajectory):
    side_by_side = [Landmark(3.0, 4.0, name="birds of paradise"), Landmark(3.5, 4.0, name="penguins")]
    furnished = replace(problem, world=problem.world.with_content(landmarks=side_by_side))
    for axes in maps(draw_where(furnished, trajectory)):
        assert sum(line.get_gid() == "landmark" for line in axes.lines) == 2
        assert {text.get_text() for text in axes.texts} == {"S", "G"}
