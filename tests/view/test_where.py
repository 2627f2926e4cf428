"""The rate of each criterion on the map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

import hpop
from hpop.criteria import make_criterion
from hpop.models.driven import driven
from hpop.motions import States
from hpop.problems.evaluation import trace
from hpop.view import draw_where
from hpop.view.where import shown_along
from hpop.world.content.content import Landmark, Person

NAMES = ["obstruction", "turns", "length"]
ENTRIES = {  # of what is drawn with a gid or a label
    "rate": "a test",
    "turns": "turn in place, a ring round S and G",
    "start": "S: start",
    "goal": "G: goal",
    "obstacle": "obstacle",
    "obstacle below or above the camera (at 1.2 m)": "obstacle below or above the camera (at 1.2 m)",
    "keep-out zone": "keep-out zone",
    "landmark": "landmark, tick: its front",
    "facing": "landmark, tick: its front",
    "person": "person, tick: heading",
    "heading": "person, tick: heading",
    "conversation": "conversation",
}


@pytest.fixture
def problem(make_problem):
    return make_problem(NAMES)


def maps(figure):
    return [axes for axes in figure.axes if axes.get_xlabel() == "x (m)"]


def lines(axes):
    return next(c for c in axes.collections if c.get_gid() == "rate")


def dots(axes):
    return next(c for c in axes.collections if c.get_gid() == "turns")


def legend_texts(figure):
    return [" ".join(text.get_text().split()) for text in figure.legends[0].get_texts()]


def test_there_is_one_map_a_criterion_with_its_cost(problem, trajectory):
    figure = draw_where(problem, trajectory, name="a test")
    titles = [axes.get_title() for axes in maps(figure)]
    assert [title.split(":")[0] for title in titles] == NAMES
    assert titles[1:] == ["turns: 4 in all", "length: 18.0 m in all"]
    assert titles[0].endswith("on average")
    assert "a test" in figure.get_suptitle()


def test_the_colours_are_the_rates_of_the_trace_where_the_robot_moves(problem, trajectory):
    trace = problem.trace(trajectory)
    moving = np.array([kind == "move" for kind in trace.pieces.kinds])
    figure = draw_where(problem, trajectory)
    for name in ("obstruction", "length"):
        drawn, rate = lines(maps(figure)[NAMES.index(name)]), trace.rate[:, NAMES.index(name)]
        np.testing.assert_array_equal(drawn.get_array(), rate[moving])
        assert drawn.norm.vmin == 0.0
        assert drawn.norm.vmax == pytest.approx(rate.max() or 1.0)


def test_a_slanting_way_of_one_rate_has_one_colour(problem):
    slanting = hpop.Trajectory.from_poses(problem.model, [(1, 6, np.arctan2(3, 8)), (9, 9, np.arctan2(3, 8))])
    figure = draw_where(problem, slanting)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())
    share = np.linspace(0.2, 0.8, 500)[:, None]
    spots = maps(figure)[NAMES.index("length")].transData.transform([1, 6] + share * [8, 3])
    columns, rows = np.floor(spots).astype(int).T
    assert len(np.unique(pixels[len(pixels) - 1 - rows, columns], axis=0)) == 1


def turns_by_place(axes):
    places = map(tuple, dots(axes).get_offsets().tolist())
    return sorted(zip(places, dots(axes).get_array().tolist(), strict=True))


def test_each_turn_in_place_counts_one_however_long_it_lasts_and_turns_on_one_spot_add_up(problem):
    bent = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (1, 6, 0), (9, 1, 0)])
    assert np.ptp(bent.durations[[kind == "turn" for kind in bent.kinds]]) > 0.5
    axes = maps(draw_where(problem, bent))[1]
    assert axes.get_title() == "turns: 4 in all"
    assert turns_by_place(axes) == [((1, 1), 1), ((1, 6), 2), ((1, 6), 2), ((9, 1), 1)]
    assert dots(axes).norm.vmax == 2
    assert set(lines(axes).get_array()) == {0.0}
    assert "count on the spot" in [axes.get_ylabel() for axes in axes.child_axes]


def test_turns_on_a_spot_that_is_passed_again_add_up(problem):
    twice = hpop.Trajectory.from_poses(problem.model, [(1, 6, 0), (9, 6, np.pi), (1, 6, 0), (9, 6, np.pi)])
    assert set(turns_by_place(maps(draw_where(problem, twice))[1])) == {((1, 6), 1), ((9, 6), 2)}


def test_a_turn_along_a_curve_colours_the_motion_in_which_it_ends(problem):
    curve = driven(hpop.DifferentialDrive(), (2, 2, 0), [(0.0, 1.0, 2.0), (0.5, 0.0, 3.0), (0.0, -1.0, 2.0)], speed=0.5)
    trace, turns = problem.trace(curve), NAMES.index("turns")
    shown = shown_along(trace, turns)
    where = (trace.times[:-1, None] >= curve.times[:-1] - 1e-9) & (trace.times[1:, None] <= curve.times[1:] + 1e-9)
    assert where.any(axis=0).all()
    each = [set(shown[inside]) for inside in where.T]
    assert all(len(values) == 1 for values in each)
    assert sum(values.pop() for values in each) == trace.cost[turns] > 0


def test_turns_in_place_are_dots_where_they_are_made(problem, trajectory):
    (axes, *_) = maps(draw_where(problem, trajectory))
    assert sorted(map(tuple, np.round(dots(axes).get_offsets(), 9))) == [(1, 1), (1, 6), (9, 1), (9, 6)]


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


def test_what_is_drawn_is_in_the_legend_and_nothing_else(problem, trajectory):
    talk = problem.world.with_content(
        people=[Person(3.0, 6.5), Person(4.0, 6.5)], groups=[(0, 1)], landmarks=[Landmark(6.0, 3.0, facing=0.0)]
    )
    figure = draw_where(replace(problem, world=talk), trajectory, name="a test")
    for axes in maps(figure):
        artists = [*axes.lines, *axes.patches, *axes.collections, *axes.texts]
        drawn = {" ".join((artist.get_gid() or str(artist.get_label())).split()) for artist in artists}
        assert {ENTRIES[what] for what in drawn if not what.startswith("_") and what} == set(legend_texts(figure))
    assert len(set(legend_texts(figure))) == len(legend_texts(figure)) == len(set(ENTRIES.values()))


def test_nothing_is_in_the_legend_that_is_not_there(problem):
    empty = hpop.World.from_polygons([], extent=shapely.box(0, 0, 10, 8))
    straight = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (9, 1, 0)])
    assert legend_texts(draw_where(replace(problem, world=empty), straight)) == [
        "the trajectory",
        "S: start",
        "G: goal",
    ]


@pytest.mark.cases(1)
@pytest.mark.parametrize("criteria", [["turns"], NAMES])
def test_legend_and_title_lie_outside_the_maps_and_inside_the_page(make_problem, trajectory, criteria):
    figure = draw_where(make_problem(criteria), trajectory, name="a trajectory")
    figure.canvas.draw()
    for box in (figure.legends[0].get_window_extent(), figure._suptitle.get_window_extent()):
        assert not any(box.overlaps(axes.get_tightbbox()) for axes in maps(figure))
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1


def test_letters_stand_at_the_ends_and_a_turn_made_there_is_a_ring_round_one(problem, trajectory):
    for axes in maps(draw_where(problem, trajectory)):
        letters = {text.get_text(): text.get_position() for text in axes.texts}
        assert letters == {"S": (1.0, 1.0), "G": (9.0, 1.0)}
        circles = [line for line in axes.lines if line.get_gid() in ("start", "goal")]
        assert {tuple(line.get_xydata()[0]) for line in circles} == set(letters.values())
        ends = [tuple(place) in letters.values() for place in dots(axes).get_offsets().tolist()]
        across = np.sqrt(dots(axes).get_sizes())
        assert sum(ends) == 2
        assert across[ends].min() > max(line.get_markersize() for line in circles) + 4
        assert across[np.invert(ends)].max() < min(line.get_markersize() for line in circles)


def test_a_turn_round_a_goal_at_the_start_is_a_ring_round_both(problem):
    there_and_back = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0), (1, 6, 0), (1, 1, 0)])
    for axes in maps(draw_where(problem, there_and_back)):
        assert {text.get_text() for text in axes.texts} == {"S"}
        goal = next(line for line in axes.lines if line.get_gid() == "goal")
        assert np.sqrt(dots(axes).get_sizes().max()) > goal.get_markersize() + 4


def test_a_head_that_pans_on_the_spot_has_one_colour_there_the_mean_of_its_rate():
    """Its pieces are drawn over each other: the last alone would be seen."""
    model = hpop.PanTilt()
    columns = zip(model.space.names, np.array([[1, 1, 0, 0, 0], [1, 1, 0, 1.5, 0], [3, 1, 0, 1.5, 0]]).T, strict=True)
    goes = hpop.Trajectory.through(model, States(**{name: np.array(column, float) for name, column in columns}))
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 5, 5))
    found = trace([make_criterion("rotation")], goes, world)
    pans = np.array(found.pieces.kinds) == "pan"
    assert np.ptp(found.rate[pans, 0]) > 0.5
    np.testing.assert_allclose(shown_along(found, 0)[pans], 1.5 / goes.durations[0])
    np.testing.assert_array_equal(shown_along(found, 0)[~pans], found.rate[~pans, 0])
