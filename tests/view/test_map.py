from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

import hpop
from hpop.errors import OptionError
from hpop.frontier import UnknownColumnError
from hpop.models.driven import driven
from hpop.models.laws import Move
from hpop.motions import States
from hpop.view import draw_map
from hpop.view.ground import FIELD_COLOURS, outline
from hpop.view.style import path_points


def part(figure: Figure, label: str):
    return next(axes for axes in figure.axes if axes.get_label() == label)


def by_gid(figure: Figure, gid: str):
    return next(artist for artist in part(figure, "map").findobj(lambda a: a.get_gid() == gid))


def claim(figure: Figure):
    (text,) = [text for text in figure.texts if text.get_gid() == "claim"]
    return text


def legend_texts(figure: Figure) -> list[str]:
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    return [" ".join(text.split()) for text in texts]


def trajectories_of(figure: Figure) -> LineCollection:
    (lines,) = (c for c in part(figure, "map").collections if c.get_label() == "trajectories")
    assert isinstance(lines, LineCollection)
    return lines


@pytest.fixture
def problem(make_problem):
    return make_problem(["exposure", "turns", "length"])


def test_every_trajectory_of_the_front_is_drawn_the_least_on_top(problem, make_front):
    front = make_front(problem)
    segments = trajectories_of(draw_map(problem, front, colour="turns")).get_segments()
    assert len(segments) == len(front) >= 3
    order = np.argsort(-front.costs[:, 1], kind="stable")
    for segment, row in zip(segments, order, strict=True):
        states = front.trajectories[row].states
        np.testing.assert_array_equal(segment, np.stack([states.x, states.y], axis=1))


@pytest.mark.parametrize(
    ("colour", "label"),
    [(None, "length (m)"), ("turns", "turns (count)"), ("obstruction", "obstruction (share)")],
)
def test_the_colour_bar_spans_the_values_of_the_criterion(problem, make_front, colour, label):
    front = make_front(problem)
    figure = draw_map(problem, front, colour=colour)
    bar = part(figure, f"{label} of a trajectory")
    values = np.hstack([front.costs, front.reported])[:, [*front.names, "obstruction"].index(label.split()[0])]
    assert bar.get_ylim() == (values.min(), values.max())
    assert bar.get_ylabel() == f"{label} of a trajectory"


def test_long_ticks_of_a_colour_bar_leave_room_for_what_stands_beside_it(problem, make_front):
    costs = np.array([[0.123456, 3.0, 8.0], [0.123458, 2.0, 8.0], [0.12346, 1.0, 8.0]])
    figure = draw_map(problem, make_front(problem, costs=costs), colour="exposure")
    figure.canvas.draw()
    one, other = (axes.get_tightbbox() for axes in figure.axes if axes.get_label() != "map")
    assert part(figure, "map").get_window_extent().x1 < one.x0 < one.x1 < other.x0 < other.x1 <= figure.bbox.x1


def test_counts_have_whole_ticks(problem, make_front):
    figure = draw_map(problem, make_front(problem), colour="turns")
    ticks = part(figure, "turns (count) of a trajectory").get_yticks()
    np.testing.assert_array_equal(ticks, np.round(ticks))


def test_trajectories_that_cost_the_same_need_no_colour_bar(make_problem, make_front):
    problem = make_problem(["length"])
    front = make_front(problem)
    assert len(front) == 1
    assert [axes.get_label() for axes in draw_map(problem, front).figure.axes if "length" in axes.get_label()] == []


def test_the_knee_and_the_best_of_each_criterion_are_drawn_and_named_with_their_costs(problem, make_front):
    front = make_front(problem)
    figure = draw_map(problem, front)
    texts = legend_texts(figure)
    expected = {"knee": front.knee().index} | {f"least {name}": front.best(name).index for name in front.names}
    for name, row in expected.items():
        (text,) = (text for text in texts if name in text.split(":")[0].split(", "))
        assert f"turns {front.costs[row, 1]:.0f}" in text
        (line,) = (line for line in part(figure, "map").lines if " ".join(str(line.get_label()).split()) == text)
        np.testing.assert_array_equal(line.get_xydata(), path_points(front.trajectories[row]))


def test_a_row_with_two_names_is_one_line(problem, make_front):
    front = make_front(problem)
    texts = legend_texts(draw_map(problem, front, chosen={"mine": 1, "yours": 1, "other": 0}))
    assert sum(text.startswith("mine, yours: exposure") for text in texts) == 1
    assert sum(text.startswith("other: exposure") for text in texts) == 1


def test_named_trajectories_differ_in_colour_and_in_line_style(problem, make_front):
    figure = draw_map(problem, make_front(problem), chosen={"a": 0, "b": 1, "c": 2})
    named = [line for line in part(figure, "map").lines if ":" in str(line.get_label())]
    assert len({line.get_color() for line in named}) == len(named) == 3
    assert len({str(line._dash_pattern) for line in named}) == 3


def test_dots_mark_the_places_where_a_named_trajectory_turns(problem, make_front):
    front = make_front(problem)
    row = int(front.costs[:, 1].argmax())
    trajectory = front.trajectories[row]
    dots = by_gid(draw_map(problem, front, chosen={"mine": row}), "turns of mine")
    turning = [i for i, kind in enumerate(trajectory.kinds) if kind == "turn"]
    assert len(turning) == front.costs[row, 1] > 0
    np.testing.assert_array_equal(dots.get_xdata(), trajectory.states.x[turning])
    np.testing.assert_array_equal(dots.get_ydata(), trajectory.states.y[turning])


def test_the_legend_says_that_turns_are_hidden_by_start_or_goal(make_problem):
    problem = make_problem()
    for poses, entry in (
        ([(1, 1, 0), (5, 1, 0), (9, 1, 0)], ""),
        ([(1, 1, 0), (3, 1, 0), (3, 4, 0), (6, 1, 0), (9, 1, 0)], "turn in place"),
        ([(1, 1, 0), (1.1, 1, 0), (3, 4, 0), (6, 1, 0), (9, 1, 0)], "turn in place, also under S"),
        ([(1, 1, 0), (5, 6, 0), (9, 1, 0)], "turn in place, also under S and G"),
    ):
        way = hpop.Trajectory.from_poses(problem.model, poses)
        front = hpop.Front.of(
            [[1.0, 1.0]], [way], names=["turns", "length"], units=["1", "m"], quanta=[1, 1e-6],
            status="complete", certificate="made by hand",
        )  # fmt: skip
        told = [text for text in legend_texts(draw_map(problem, front)) if "turn in place" in text]
        assert told == [entry] * bool(entry)


def test_start_and_goal_stand_where_the_problem_says(make_problem, make_front):
    problem = make_problem(start=(1, 1, np.pi / 2), goal=(9, 1, None))
    figure = draw_map(problem, make_front(problem))
    assert by_gid(figure, "start").get_xydata().tolist() == [[1.0, 1.0]]
    assert by_gid(figure, "goal").get_xydata().tolist() == [[9.0, 1.0]]
    arrow = by_gid(figure, "start heading")
    along = np.subtract(arrow.xy, (1.0, 1.0))
    assert along[0] == pytest.approx(0.0, abs=1e-12)
    assert along[1] > 0
    with pytest.raises(StopIteration):
        by_gid(figure, "goal heading")
    assert "G: goal, any heading" in legend_texts(figure)


def test_the_heading_of_a_goal_at_the_border_is_there(make_problem, make_front):
    problem = make_problem(goal=(9.9, 1, 0))
    figure = draw_map(problem, make_front(problem))
    arrow = by_gid(figure, "goal heading")
    assert arrow.xy[0] > part(figure, "map").get_xlim()[1]
    figure.canvas.draw()
    with_arrow = np.array(figure.canvas.buffer_rgba())
    arrow.set_visible(False)
    figure.canvas.draw()
    assert (with_arrow != np.asarray(figure.canvas.buffer_rgba())).any()


def test_the_axes_are_metres_with_one_scale_and_a_bar_of_round_length(problem, make_front):
    figure = draw_map(problem, make_front(problem))
    axes = part(figure, "map")
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x (m)", "y (m)", 1.0)
    ends = by_gid(figure, "scale bar").get_xdata()
    assert ends[1] - ends[0] == pytest.approx(2.0)
    assert "2 m" in [text.get_text() for text in axes.texts]


def test_low_and_overhead_obstacles_are_hatched_apart_from_those_at_the_camera(problem, make_front):
    figure = draw_map(problem, make_front(problem))
    patches = [p for p in part(figure, "map").patches if isinstance(p, PathPatch)]
    light = next(p for p in patches if "below or above" in str(p.get_label()))
    dark = next(p for p in patches if p.get_label() == "obstacle")
    zone = next(p for p in patches if p.get_label() == "keep-out zone")
    assert light.get_hatch()
    assert zone.get_hatch()
    assert not dark.get_hatch()
    assert light.get_path().get_extents().bounds == (2.0, 3.0, 6.0, 3.0)
    assert dark.get_path().get_extents().bounds == (4.0, 1.5, 2.0, 3.0)
    assert zone.get_path().get_extents().bounds == (0.0, 7.5, 2.0, 0.5)
    assert {"obstacle", "keep-out zone"} <= set(legend_texts(figure))


@pytest.mark.parametrize(("criteria", "radius"), [(["turns", "length"], 2), ([{"exposure": {"radius": 1.5}}], 1.5)])
def test_the_field_is_the_obstruction_of_the_problem(make_problem, make_front, criteria, radius):
    problem = make_problem(criteria)
    figure = draw_map(problem, make_front(problem))
    part(figure, f"obstructed fraction φ (ball of {radius:g} m)")
    (image,) = part(figure, "map").images
    values = image.get_array()
    rows, columns = values.shape
    left, right, bottom, top = image.get_extent()
    x = left + (right - left) * (columns // 3 + 0.5) / columns
    y = bottom + (top - bottom) * (rows // 4 + 0.5) / rows
    phi = problem.world.obstruction_field(radius, problem.model.camera_height)(np.array([x]), np.array([y]))
    assert values[rows // 4, columns // 3] == pytest.approx(phi[0])
    assert 0 < image.norm.vmax <= values.max()


def test_lightness_of_the_field_falls_evenly():
    weights = np.array([0.2126, 0.7152, 0.0722])
    light = (FIELD_COLOURS(np.linspace(0, 1, 11))[:, :3] ** 2.2 @ weights) ** (1 / 3)  # CIE lightness but for scale
    steps = -np.diff(light)
    assert (steps > 0).all()
    assert steps.max() < 1.2 * steps.min()


def test_cells_of_a_turned_raster_lie_where_the_world_has_them(make_front):
    cells = np.zeros((20, 40), dtype=bool)
    cells[8:12, 30:34] = True
    world = hpop.World.from_cells(cells, 0.5, origin=(3.0, -2.0, 0.6))
    x, y = world.raster.to_world(np.array([10.0, 20.0]), np.array([4.0, 10.0]))
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (x[0], y[0], 0), (x[1], y[1], None), ["turns", "length"])
    figure = draw_map(problem, make_front(problem))
    raster = next(image for image in part(figure, "map").images if image.get_array().shape == cells.shape)
    to_data = raster.get_transform() - part(figure, "map").transData
    corner = np.stack(world.raster.to_world(30.0, 8.0))
    np.testing.assert_allclose(to_data.transform((30.0, 8.0)), corner, atol=1e-9)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())
    places = np.array(
        [world.raster.to_world(32.0, 10.0), world.raster.to_world(27.0, 10.0), world.raster.to_world(32.0, 14.0)]
    )
    columns, rows = part(figure, "map").transData.transform(places).round().astype(int).T
    grey = pixels[pixels.shape[0] - 1 - rows, columns, :3].mean(axis=1)
    assert grey[0] < 100 < 180 < grey[1:].min()


def test_holes_of_a_polygon_stay_open():
    ring = shapely.box(0, 0, 3, 3).difference(shapely.box(1, 1, 2, 2))
    path = outline(shapely.MultiPolygon([ring, shapely.box(5, 0, 6, 1)]))
    signed = [np.sum(a[:-1, 0] * a[1:, 1] - a[1:, 0] * a[:-1, 1]) / 2 for a in path.to_polygons()]
    assert sorted(signed) == [-1.0, 1.0, 9.0]


@pytest.mark.parametrize(
    ("status", "title"),
    [("no path", "No path from start to goal"), ("time limit", "No path found: the search ended with 'time limit'")],
)
def test_an_empty_front_shows_start_and_goal_and_says_why(problem, make_front, status, title):
    figure = draw_map(problem, make_front(problem, costs=np.zeros((0, 3)), status=status))
    assert figure.get_suptitle() == title
    assert by_gid(figure, "start").get_xydata().tolist() == [[1.0, 1.0]]
    assert by_gid(figure, "goal").get_xydata().tolist() == [[9.0, 1.0]]
    assert not part(figure, "map").collections


def test_the_title_says_when_the_search_did_not_end(problem, make_front):
    assert "time limit" in draw_map(problem, make_front(problem, status="time limit")).get_suptitle()
    assert "ended" not in draw_map(problem, make_front(problem)).get_suptitle()


def test_one_trajectory_is_not_called_the_best_whatever_is_claimed_and_the_claim_is_there(problem, make_front):
    for status in ("complete", "time limit", "unfinished"):
        figure = draw_map(problem, make_front(problem, costs=np.ones((1, 3)), status=status))
        assert figure.get_suptitle().startswith("1 trajectory")
        assert "best" not in figure.get_suptitle()
        assert claim(figure).get_text() == "made by hand"


def test_legends_and_title_lie_outside_the_map_and_inside_the_page(problem, make_front):
    figure = draw_map(problem, make_front(problem))
    figure.canvas.draw()
    page, inner = figure.bbox, part(figure, "map").get_window_extent()
    boxes = [legend.get_window_extent() for legend in figure.legends] + [figure._suptitle.get_window_extent()]
    boxes.append(claim(figure).get_window_extent())
    for i, box in enumerate(boxes):
        assert not box.overlaps(inner)
        assert page.x0 <= box.x0 < box.x1 <= page.x1
        assert page.y0 <= box.y0 < box.y1 <= page.y1
        assert not any(box.overlaps(other) for other in boxes[i + 1 :])


def test_wrong_names_and_rows_are_refused(problem, make_front):
    front = make_front(problem)
    with pytest.raises(UnknownColumnError, match="turns"):
        draw_map(problem, front, colour="turn")
    with pytest.raises(OptionError, match=r"chosen\['mine'\] must be a row"):
        draw_map(problem, front, chosen={"mine": len(front)})


def test_a_start_that_is_the_goal_is_drawn(make_problem):
    problem = make_problem(goal=(1, 1, 0))
    still = hpop.Trajectory.from_poses(problem.model, [(1, 1, 0)])
    front = hpop.Front.of(
        [[0.0, 0.0]], [still], names=["turns", "length"], units=["1", "m"], quanta=[1, 1e-6],
        status="complete", certificate="made by hand",
    )  # fmt: skip
    figure = draw_map(problem, front)
    assert len(trajectories_of(figure).get_segments()) == 1
    assert by_gid(figure, "goal").get_markersize() > by_gid(figure, "start").get_markersize()  # neither hides the other
    assert by_gid(figure, "goal").get_zorder() < by_gid(figure, "start").get_zorder()


def test_of_several_planners_each_has_its_dashes_and_its_count(problem, make_front):
    front = make_front(problem)
    assert not any("found by" in text for text in legend_texts(draw_map(problem, front)))
    names = ["second", *["first"] * (len(front) - 1)]
    shared = replace(front, provenance=[{"planner": name} for name in names])
    figure = draw_map(problem, shared)
    told = [text for text in legend_texts(figure) if "found by" in text]
    assert told == [f"found by first: {len(front) - 1}", "found by second: 1"]
    # By decreasing length on the map, so that the least is on top.
    lengths = shared.costs[:, shared.names.index("length")]
    drawn = [names[row] for row in np.argsort(-lengths, kind="stable")]
    dashed = [bool(dashes) for _, dashes in trajectories_of(figure).get_linestyle()]
    assert dashed == [name == "second" for name in drawn]


@dataclass(frozen=True)
class Quarter(Move):
    """A quarter circle of 1 m to the left, as a law that moves and turns at once."""

    kind: str = "quarter"
    varies = frozenset({"x", "y", "yaw"})

    def interpolate(self, name: str, start: States, end: States, share: np.ndarray) -> np.ndarray:
        angle = share * np.pi / 2
        return getattr(start, name) + {"x": np.sin(angle), "y": 1 - np.cos(angle), "yaw": angle}[name]


class Curving(hpop.DifferentialDrive):
    @cached_property
    def laws(self):
        return {"move": Move(1.0), "quarter": Quarter(1.0)}


def test_a_motion_that_moves_and_turns_is_drawn_as_a_curve():
    model = Curving()
    states = States(x=np.array([0.0, 1.0, 1.0]), y=np.array([0.0, 1.0, 3.0]), yaw=np.array([0.0, 1.0, 1.0]) * np.pi / 2)
    points = path_points(hpop.Trajectory(model, states, ("quarter", "move")))
    np.testing.assert_allclose(points[[0, -2, -1]], [[0, 0], [1, 1], [1, 3]], atol=1e-12)
    np.testing.assert_allclose(np.hypot(points[:-1, 0], points[:-1, 1] - 1), 1.0)
    assert len(points) > 8


def test_a_driven_trajectory_is_drawn_along_its_curves():
    circle = [(0.0, 1.0, 1.0), *[(0.0, 0.0, 1.5)] * 3]  # then 1 m/s at 1 rad/s: a circle of 1 m
    goes = driven(hpop.DifferentialDrive(), (0, 0, 0), circle, speed=1.0)
    s, points = goes.states, path_points(goes)
    centre = s.x[1] - np.sin(s.yaw[1]), s.y[1] + np.cos(s.yaw[1])
    there = points[np.argmin(np.hypot(points[:, 0] - s.x[1], points[:, 1] - s.y[1])) :]
    np.testing.assert_allclose(np.hypot(there[:, 0] - centre[0], there[:, 1] - centre[1]), 1.0, atol=1e-6)
    assert np.hypot(*np.diff(points, axis=0).T).max() < 0.2


def test_each_goal_of_a_set_is_drawn_and_the_legend_says_that_any_will_do(make_problem) -> None:
    problem = make_problem(goal=[(9, 1, 0), (9, 3, None), (1, 1, None)])
    figure = draw_map(problem, problem.solve("lattice", step=1.0))
    drawn = [line.get_xydata().tolist() for line in part(figure, "map").lines if line.get_gid() == "goal"]
    assert drawn == [[[9.0, 1.0]], [[9.0, 3.0]], [[1.0, 1.0]]]
    legend = " ".join(text.get_text() for legend in figure.legends for text in legend.get_texts())
    assert "G: goal, any of 3, heading along the arrow, if there is one" in legend


@pytest.mark.parametrize("size", [(120.0, 7.0), (7.0, 120.0)])
def test_labels_of_ticks_do_not_overlap_on_a_long_thin_map(size: tuple[float, float]) -> None:
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, *size))
    problem = hpop.Problem(world, hpop.DifferentialDrive(), (3, 3, 0), (size[0] - 3, size[1] - 3, None), ["length"])
    figure = draw_map(problem, problem.solve("lattice", step=1.0))
    figure.canvas.draw()
    axes = part(figure, "map")
    for axis in (axes.xaxis, axes.yaxis):
        low, high = sorted(axis.get_view_interval())
        ticks = zip(axis.get_majorticklocs(), axis.get_majorticklabels(), strict=True)
        boxes = [label.get_window_extent() for at, label in ticks if low <= at <= high]
        assert not any(box.overlaps(other) for i, box in enumerate(boxes) for other in boxes[i + 1 :])
        assert boxes
