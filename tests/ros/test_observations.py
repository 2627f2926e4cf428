"""Transforms, grids, masks and people, as messages tell them."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

import hpop
from hpop.errors import RosError
from hpop.ros import Transforms, pose_message
from hpop.ros.messages import SECOND, header, transform
from hpop.ros.observations import MessageAge, OccupancyGrid, PeopleSeen, with_grid

PLACE = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))


def link(parent: str, child: str, pose: tuple[float, float, float], stamp: int = 0) -> dict:
    x, y, yaw = pose
    return transform(stamp, parent, child, (x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))


def matrix(pose: tuple[float, float, float]) -> np.ndarray:
    x, y, yaw = pose
    return np.array([[math.cos(yaw), -math.sin(yaw), x], [math.sin(yaw), math.cos(yaw), y], [0, 0, 1]])


@given(PLACE, PLACE, PLACE)
def test_transforms_are_composed_as_matrices(first, second, third):
    tree = Transforms()
    tree.hear({"transforms": [link("base", "laser", third), link("/map", "odom", first)]}, 5.0, static=True)
    tree.hear({"transforms": [link("odom", "base", second)]}, 7.0)
    pose, oldest = tree.pose("map", "laser")
    np.testing.assert_allclose(matrix(pose[:3]), matrix(first) @ matrix(second) @ matrix(third), atol=1e-9)
    assert oldest == 7.0
    assert tree.pose("odom", "map") is None
    assert tree.pose("map", "other") is None


def test_a_loop_of_transforms_ends_and_a_camera_that_looks_up_is_left_out():
    tree = Transforms()
    tree.hear({"transforms": [link("a", "b", (0, 0, 0)), link("b", "a", (0, 0, 0))]}, 0.0)
    assert tree.pose("map", "a") is None
    up = transform(0, "base", "camera", (0, 0, 1), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    tree.hear({"transforms": [up]}, 0.0)
    assert tree.pose("base", "camera") is None
    with pytest.raises(RosError, match="length 1"):
        tree.hear(
            {"transforms": [up | {"transform": {**up["transform"], "rotation": dict.fromkeys("xyzw", 1.0)}}]}, 0.0
        )


def test_a_late_message_is_old_whatever_the_clock_of_its_sender():
    for clock in (0.0, 1e6, -30.0):
        age, sent = MessageAge(), [int((1000.0 + clock + t) * SECOND) for t in (0.0, 1.0, 2.0)]
        assert age.of(1000.1, sent[0]) == pytest.approx(0.0, abs=1e-3)
        assert age.of(1001.05, sent[1]) == pytest.approx(0.0, abs=1e-3)
        assert age.of(1003.05, sent[2]) == pytest.approx(1.0, abs=5e-3)
    assert MessageAge().of(3.0, 0) == 0.0


def grid(cells: np.ndarray, pose=(0.0, 0.0, 0.0)) -> dict:
    info = {"resolution": 0.5, "width": cells.shape[1], "height": cells.shape[0], "origin": pose_message(*pose)["pose"]}
    return {"header": header(0, "map"), "info": info, "data": cells.ravel().tolist()}


def test_a_grid_is_read_updated_and_asked_by_position():
    cells = np.arange(12).reshape(3, 4)
    made = OccupancyGrid.of(grid(cells, (1.0, 2.0, math.pi / 2)), "map")
    assert made.value_at(1.0 - 0.75, 2.0 + 1.25) == cells[1, 2]  # turned by a quarter
    assert made.value_at(1.1, 2.1) == -1
    changed = made.updated({"x": 1, "y": 2, "width": 2, "height": 1, "data": [100, -1]})
    assert changed.cells.tolist() == [[0, 1, 2, 3], [4, 5, 6, 7], [8, 100, -1, 11]]
    assert made.cells.tolist() == cells.tolist()
    for wrong in ({"x": 3}, {"x": -1}, {"width": 0}, {"data": [1]}, {"data": "no"}, {"data": [1, 101]}, {"y": None}):
        with pytest.raises(RosError, match="map update"):
            made.updated({"x": 1, "y": 2, "width": 2, "height": 1, "data": [100, -1]} | wrong)


def test_a_map_closes_what_is_new_in_a_world_of_polygons_and_replaces_cells():
    wall = shapely.box(0, 0, 10, 1)
    world = hpop.World.from_polygons([(wall, (0.0, 2.0))], extent=shapely.box(0, 0, 10, 5))
    cells = np.zeros((10, 20), int)
    cells[:3] = 100  # the wall, one cell too thick
    cells[6, 10] = 100
    found = with_grid(world, OccupancyGrid.of(grid(cells), "map"), None)
    (zone,) = found.content.zones
    assert zone.area.equals(shapely.box(5.0, 3.0, 5.5, 3.5))
    assert found.obstacles == world.obstacles
    flat = hpop.World.from_cells(np.zeros((10, 20), np.bool_), 0.5)
    found = with_grid(flat, OccupancyGrid.of(grid(cells), "map"), OccupancyGrid.of(grid(np.full((10, 20), 100)), "map"))
    assert (found.raster.cells == (cells > 0)).all()
    assert found.content.zones[0].area.area == pytest.approx(50.0)
    wide = with_grid(flat, OccupancyGrid.of(grid(np.zeros((12, 20), int)), "map"), None)
    assert wide.raster.cells.shape == (12, 20)


def test_people_have_the_velocity_that_they_tell_or_that_their_places_show():
    tree, seen = Transforms(), PeopleSeen()
    tree.hear({"transforms": [link("map", "laser", (1.0, 2.0, math.pi / 2))]}, 0.0)
    ada = {"name": "Ada", "position": {"x": 1.0, "y": 0.0, "z": 0.0}, "velocity": {"x": 1.0, "y": 0.0, "z": 0.0}}
    (person,) = seen.heard({"header": header(0, "laser"), "people": [ada]}, "map", tree, 0.0)
    assert person.name == "Ada"
    assert (person.x, person.y) == pytest.approx((1.0, 3.0))
    assert person.velocity == pytest.approx((0.0, 1.0))
    walks = PeopleSeen()
    for now, x, velocity in ((0.0, 5.0, 0.0), (0.5, 5.25, 0.5), (1.0, 5.26, 0.0), (9.0, 5.5, 0.0), (9.1, 7.0, 0.0)):
        poses = [pose_message(x, 1.0, 0.0)["pose"]]
        (person,) = walks.heard({"header": header(0, "map"), "poses": poses}, "map", tree, now)
        assert person.velocity == pytest.approx((velocity, 0.0), abs=1e-9)


def test_a_frame_that_is_no_name_is_refused() -> None:
    with pytest.raises(RosError, match=r"the name of a frame must be text of at most .* got \{\}"):
        Transforms().pose("map", {})  # type: ignore[arg-type]


def test_only_static_transforms_outlive_a_clock_that_is_set_back():
    tree = Transforms()
    tree.hear({"transforms": [link("map", "odom", (1, 2, 0))]}, 100.0, static=True)
    tree.hear({"transforms": [link("odom", "base", (3, 0, 0), 100 * SECOND)]}, 100.0)
    tree.forget_moving()
    assert tree.pose("map", "base") is None
    tree.hear({"transforms": [link("odom", "base", (4, 0, 0), SECOND)]}, 1.0)
    pose, at = tree.pose("map", "base")
    assert pose[:2] == (5.0, 2.0)
    assert at == 1.0
