"""Pictures of robots whose camera rises, and of robots without a base: the view from the side, and the map."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure

import hpop
from hpop.goals import LookAt
from hpop.motions import Model, States
from hpop.view import draw_map, draw_side, draw_trace, draw_where, save_pictures
from hpop.view.outlines import Section
from hpop.view.style import camera_heights, camera_path, may_rise
from hpop.world import Box, Solid, Sphere, pose_at
from tests.view.robots import Lift, Reacher
from tests.view.test_map import legend_texts

SHELF, TABLE, BEAM = shapely.box(2, 0.5, 2.5, 2), shapely.box(4, 1, 5, 2), shapely.box(3, 0, 3.2, 2.5)
WALL = shapely.box(-0.5, 3, 7, 3.2)
ROOM = hpop.World.from_polygons(
    [(SHELF, (0.0, 1.4)), (TABLE, (0.0, 0.7)), (BEAM, (2.2, 2.4)), WALL, shapely.box(6.3, 0, 6.5, 2)],
    extent=shapely.box(-0.5, -0.5, 7, 3.2),
)
LIFTED = [(0.5, 1, 0, 0.2), (2.2, 1, 0, 1.1), (4.5, 1, 0, 0.4), (6, 1, 0, 0.4)]
LEVEL = [(*row[:3], 0.2) for row in LIFTED]
REACHED = [(-0.5, 0.2), (0.5, 0.8), (1.5, 0.2)]


def through(model: Model, rows: Sequence[tuple[float, ...]]) -> hpop.Trajectory:
    columns = np.array(rows, float).T
    return hpop.Trajectory.through(model, States(**dict(zip(model.space.names, columns, strict=True))))


def seen(model: Model, *ways: Sequence[tuple[float, ...]], **changes: Any) -> tuple[hpop.Problem, hpop.Front]:
    """Return a problem from the first to the last state of the paths, and a front of the paths."""
    given = {"world": ROOM, "start": ways[0][0], "goal": ways[0][-1], "criteria": ["duration", "rotation"]} | changes
    found = [through(model, rows) for rows in ways]
    costs = [(1.0 + i, 9.0 - i) for i in range(len(found))]
    front = hpop.Front.of(
        costs, found, names=["duration", "rotation"], units=["s", "rad"], quanta=[1e-6, 1e-6],
        status="complete", certificate="made by hand",
    )  # fmt: skip
    return hpop.Problem(model=model, **given), front


def axes_of(figure: Figure, label: str):
    return next(axes for axes in figure.axes if axes.get_label() == label)


def found(figure: Figure, label: str, gid: str) -> list[Any]:
    return [artist for artist in axes_of(figure, label).findobj() if artist.get_gid() == gid]


# The view from the side


def test_paths_are_drawn_where_the_camera_is_along_the_section_and_in_height():
    problem, front = seen(Lift(), LIFTED, LEVEL)
    figure = draw_side(problem, front)
    axes = axes_of(figure, "side")
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "height (m)")
    (lines,) = (c for c in axes.collections if c.get_label() == "trajectories")
    assert len(lines.get_segments()) == 2
    named = [line for line in axes.lines if "knee" in str(line.get_label()) or "least" in str(line.get_label())]
    corners = [(row[0], 0.8 + row[3]) for row in LIFTED]
    assert any(all(np.hypot(*(line.get_xydata() - corner).T).min() < 1e-9 for corner in corners) for line in named)
    assert found(figure, "side", "start")[0].get_xydata().tolist() == [[0.5, 1.0]]
    np.testing.assert_allclose(found(figure, "side", "goal")[0].get_xydata(), [[6.0, 1.2]])


def test_the_section_is_along_the_axis_in_which_paths_spread_most():
    def path(yaw: float, length: float, aside: float) -> np.ndarray:
        along, beside = np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])
        corners = np.array([0 * along, length * along, length * along + aside * beside, aside * beside])
        return np.column_stack([corners, np.linspace(0, 9, 4)])

    for yaw, degrees in ((0.0, 0), (90, 90), (-90, 90), (44, 45), (-31, -30), (8, 15), (170, -15)):
        assert Section.along([path(math.radians(yaw), 4.0, 0.3)]).degrees == degrees
    upright = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 2.0]])
    assert Section.along([upright]).degrees == 0
    np.testing.assert_allclose(Section(90).flattened(np.array([3.0, 4.0, 5.0])), [4.0, 5.0], atol=1e-12)


def test_obstacles_stand_at_their_heights_and_walls_beside_the_paths_do_not_hide_them():
    figure = draw_side(*seen(Lift(), LIFTED, LEVEL))
    (boxes,) = found(figure, "side", "silhouettes")
    assert isinstance(boxes, PolyCollection)
    extents = sorted(tuple(path.get_extents().extents.round(6)) for path in boxes.get_paths())
    assert extents == [(2.0, 0.0, 2.5, 1.4), (3.0, 2.2, 3.2, 2.4), (4.0, 0.0, 5.0, 0.7)]
    assert any(text.startswith("obstacle among the paths") for text in legend_texts(figure))
    low, high = axes_of(figure, "side").get_ylim()
    assert low < 0.0 < 2.4 < high  # the floor, and the beam above the camera


def test_solids_are_what_is_seen_of_them_from_the_side_and_from_above():
    turned = pose_at((0.5, 0.2, 0.4), rpy=(0.0, math.radians(45), 0.0))
    solids = [Solid(Box((0.2, 0.1, 0.2)), turned), Solid(Sphere(0.1), pose_at((0.3, 0.3, 0.8))),
              Solid(Box((0.1, 0.1, 0.1)), pose_at((9, 9, 0)))]  # fmt: skip
    flat = [(-0.6, 0.2), (0.6, 0.2)]
    problem, front = seen(Reacher(), flat, [flat[0], (0.0, 0.5), flat[1]], world=hpop.World.from_solids(solids))
    figure = draw_side(problem, front)
    assert axes_of(figure, "side").get_xlabel() == "y (m)"
    (shapes,) = found(figure, "side", "silhouettes")
    box, ball = (path.get_extents().extents for path in shapes.get_paths())  # not the one far away
    rise = 0.1 * math.sqrt(2)
    np.testing.assert_allclose(box, (0.15, 0.4 - rise, 0.25, 0.4 + rise))
    np.testing.assert_allclose(ball, (0.2, 0.7, 0.4, 0.9), atol=1e-3)
    assert not found(figure, "side", "floor")  # their world has none but what is given as one
    (above,) = found(draw_map(problem, front), "map", "silhouettes")
    assert len(above.get_paths()) == 3
    np.testing.assert_allclose(above.get_paths()[0].get_extents().extents, (0.5 - rise, 0.15, 0.5 + rise, 0.25))


def test_an_endless_wall_that_paths_go_round_reaches_from_the_floor_to_the_top():
    round_it = [(0.5, 1, 0, 0.2), (4, 2.5, 0, 0.8), (7.5, 1, 0, 0.2)]
    straight = [round_it[0], round_it[-1]]
    world = hpop.World.from_polygons([shapely.box(3.9, 0.4, 4.1, 1.5)], extent=shapely.box(0, 0, 8, 3))
    figure = draw_side(*seen(Lift(), round_it, straight, world=world))
    (boxes,) = found(figure, "side", "silhouettes")
    (box,) = (path.get_extents() for path in boxes.get_paths())
    low, high = axes_of(figure, "side").get_ylim()
    assert (box.x0, box.x1) == pytest.approx((3.9, 4.1))
    assert box.y0 < low < high < box.y1


@pytest.mark.parametrize(("yaw", "wide"), [(0.0, False), (math.pi / 2, True)])
def test_cones_are_as_high_as_the_camera_sees_and_from_behind_as_wide(yaw, wide):
    """Along the picture a view of 90 by 60 degrees is its reach long; into the picture it is as wide as it sees."""
    rows = [(x, y, yaw, lift) for x, y, _, lift in LIFTED]
    figure = draw_side(*seen(Lift(), rows, [rows[0], rows[-1]]))
    cones = next(c for c in found(figure, "side", "views of least rotation"))
    x0, y0, x1, y1 = cones.get_paths()[0].get_extents().extents
    height, width = y1 - y0, x1 - x0
    assert width / height == pytest.approx((2 * math.sin(math.pi / 4) if wide else 1.0) / (2 * math.sin(math.pi / 6)))
    assert any("90° wide and 60° high" in text for text in legend_texts(figure))


def test_flat_pictures_say_how_much_larger_heights_are_drawn():
    far = [(0.5, 1, 0, 0.2), (40, 1, 0, 0.8)]
    world = hpop.World.from_polygons([], extent=shapely.box(0, 0, 50, 2))
    figure = draw_side(*seen(Lift(), far, [far[0], (20, 1.2, 0, 0.9), far[1]], world=world))
    axes = axes_of(figure, "side")
    box = axes.get_window_extent()
    (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
    stretch = (box.height / (y1 - y0)) / (box.width / (x1 - x0))
    assert axes.get_ylabel() == f"height (m), drawn {stretch:.2g} times as large"
    assert stretch > 1.5


def test_a_goal_that_lists_no_states_is_where_trajectories_end():
    @dataclass(frozen=True)
    class Beyond:
        """All states beyond 5 m."""

        def states(self, problem, rng, count):
            raise NotImplementedError

        def reached(self, model, states):
            return states.x >= 5.0

        def describe(self):
            return "beyond"

    other = [*LEVEL[:-1], (5.5, 2.0, 0, 0.7)]
    problem, front = seen(Lift(), LIFTED, other, goal=Beyond())
    side, above = draw_side(problem, front), draw_map(problem, front)
    assert sorted(goal.get_xydata().tolist()[0] for goal in found(side, "side", "goal")) == [[5.5, 1.5], [6.0, 1.2]]
    assert sorted(goal.get_xydata().tolist()[0] for goal in found(above, "map", "goal")) == [[5.5, 2.0], [6.0, 1.0]]
    for figure in (side, above):
        assert any(text.startswith("G: goal, where trajectories end") for text in legend_texts(figure))


def test_what_criteria_and_the_goal_look_at_has_a_ring_in_every_view():
    can, cup = (0.6, 0.1, 0.4), (0.5, 0.3, 0.6)
    criteria = ["duration", {"look_at": {"target": can}}, {"view_distance": {"target": can}}]
    problem, front = seen(Reacher(), REACHED, criteria=criteria, goal=LookAt(cup, (0.1, 2.0)))
    for figure, label in ((draw_map(problem, front), "map"), (draw_side(problem, front), "side")):
        (rings,) = found(figure, label, "targets")
        assert len(rings.get_xydata()) == 2
        assert rings.get_ydata().tolist() == ([0.1, 0.3] if label == "map" else [0.4, 0.6])
        assert "target of look_at, view_distance, the goal" in legend_texts(figure)


def test_a_robot_that_says_where_its_parts_are_is_drawn_at_both_ends_of_the_first():
    class Seen(Reacher):
        def bodies(self, states):
            hand = self.pose("camera", states)
            return [(Sphere(0.1), np.array([pose_at(place) for place in zip(hand.x, hand.y, hand.z, strict=True)]))]

    over = [(-0.9, 0.2), (0.0, 0.8), (0.9, 0.2)]
    problem, front = seen(Seen(), over, [over[0], over[-1]])
    hands = camera_path(front.trajectories[0])[[0, -1]]
    for figure, label, places in ((draw_map(problem, front), "map", hands[:, :2]),
                                  (draw_side(problem, front), "side", hands[:, 1:])):  # fmt: skip
        (parts,) = found(figure, label, "robot")
        for path, (x, y) in zip(parts.get_paths(), places, strict=True):
            extents = (x - 0.1, y - 0.1, x + 0.1, y + 0.1)
            np.testing.assert_allclose(path.get_extents().extents, extents, atol=1e-6)
        assert "the robot at both ends: knee" in legend_texts(figure)
    assert axes_of(figure, "side").get_xlabel() == "y (m)"


# What is drawn of whom


@pytest.mark.proof
def test_of_who_rises_there_is_a_side(tmp_path):
    names = [path.name for path in save_pictures(*seen(Lift(), LIFTED, LEVEL), tmp_path, dpi=30)]
    assert names == ["map.png", "front.png", "trace.png", "where.png", "side.png", "states.png"]


def test_a_camera_on_a_base_of_one_height_is_known_by_its_twist():
    drive, lift = hpop.DifferentialDrive(), Lift()
    assert not may_rise(drive, drive.space.state((1, 1, 0)))
    assert may_rise(lift, lift.space.state((1, 1, 0, 0.2)))
    problem, front = seen(lift, LIFTED, LEVEL)
    assert camera_heights(problem, front.trajectories) == pytest.approx((1.0, 1.9))
    assert not camera_heights(problem, front.trajectories[1:]).vary


# The map of such robots


def test_a_map_says_at_which_of_the_cameras_heights_obstacles_are():
    problem, front = seen(Lift(), LIFTED, LEVEL)
    figure = draw_map(problem, front)
    texts = legend_texts(figure)
    assert {"obstacle at all heights of the camera (1 to 1.9 m)", "obstacle at some of them"} < set(texts)
    assert "obstacle below or above all" in texts
    looks = {
        str(patch.get_label()).split("\n")[0]: patch.get_path().get_extents().bounds
        for patch in axes_of(figure, "map").patches
    }
    assert looks["obstacle at some of them"] == pytest.approx((*SHELF.bounds[:2], 0.5, 1.5))
    x0, y0, width, height = looks["obstacle below or above all"]
    assert (x0, y0, x0 + width, y0 + height) == pytest.approx((3.0, 0.0, 5.0, 2.5))  # beam and table
    assert any("its centre 1 m high" in axes.get_label() for axes in figure.axes)
    where = " ".join(legend_texts(draw_where(problem, front.trajectories[0])))
    assert "obstacle at all heights of the camera (1 to 1.9 m)" in where


def test_the_hand_of_an_arm_goes_along_its_arc_on_the_map():
    problem, front = seen(Reacher(), REACHED, [REACHED[0], REACHED[-1]])
    figure = draw_map(problem, front)
    axes = axes_of(figure, "map")
    (lines,) = (c for c in axes.collections if c.get_label() == "trajectories")
    direct = lines.get_segments()[0]  # the shoulder stays, so that the hand keeps its distance
    np.testing.assert_allclose(np.hypot(*direct.T), 0.6 * math.cos(0.2))
    assert np.ptp(np.arctan2(*direct.T[::-1])) == pytest.approx(2.0)
    (caption,) = found(figure, "map", "caption")
    assert caption.get_text() == "From above: paths of the camera"
    assert not any("obstructed fraction" in each.get_label() for each in figure.axes)
    assert not found(figure, "map", "start heading")  # cones say where it looks
    assert {"S: start", "G: goal", "obstacle of any height"} < set(legend_texts(figure))
    assert any("60° wide and 45° high" in text for text in legend_texts(figure))


def test_where_costs_arise_is_along_the_arc_too():
    problem, front = seen(Reacher(), REACHED)
    figure = draw_where(problem, front.trajectories[0])
    for rate in (artist for axes in figure.axes for artist in axes.collections if artist.get_gid() == "rate"):
        assert isinstance(rate, LineCollection)
        pieces = len(problem.trace(front.trajectories[0]).rate)
        assert len(rate.get_segments()) == len(rate.get_array()) == pieces > 2
        whole = np.concatenate(rate.get_segments())
        np.testing.assert_allclose(whole[[0, -1]], camera_path(front.trajectories[0])[[0, -1], :2])
        assert np.hypot(*np.diff(whole, axis=0).T).max() < 0.1


def test_a_camera_seen_from_straight_above_looks_down_in_a_square():
    """The cones of a hand that looks almost straight down are as wide as high, whatever its yaw."""
    reacher = Reacher(field_of_view=(1.0, 1.0))
    down = -0.8  # 86 degrees below the horizon
    problem, front = seen(reacher, [(0.3, down), (0.3, 0.5)], [(0.3, down), (1.0, 0.2), (0.3, 0.5)], world=ROOM)
    cones = found(draw_map(problem, front), "map", "views of least rotation")[0].get_paths()[0].vertices
    hand = 0.6 * math.cos(down) * np.array([math.cos(0.3), math.sin(0.3)])
    np.testing.assert_allclose(cones[:-1].mean(axis=0), hand, atol=0.02)
    ahead = (cones - hand) @ np.array([math.cos(0.3), math.sin(0.3)])
    left = (cones - hand) @ np.array([-math.sin(0.3), math.cos(0.3)])
    assert np.ptp(ahead) == pytest.approx(np.ptp(left), rel=0.15)


def test_a_trace_shows_the_whole_rotation_of_a_camera_that_does_not_stay_upright():
    problem, front = seen(Reacher(), REACHED)
    labels = {axes.get_ylabel().replace("\n", " ") for axes in draw_trace(problem, front.trajectories[0]).axes}
    assert "camera rotation rate (rad/s)" in labels
    level, flat = seen(Reacher(), [(-0.5, 0.2), (1.5, 0.2)])
    labels = {axes.get_ylabel().replace("\n", " ") for axes in draw_trace(level, flat.trajectories[0]).axes}
    assert "camera yaw rate (rad/s)" in labels
