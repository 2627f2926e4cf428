"""Free space in parts: areas in closed form, and distant positions that a planner joins."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

import hpop
from hpop.planners.needs import FreeMap

ARM = Path(__file__).parents[2] / "examples" / "arm" / "arm6.urdf"
ROBOT = hpop.DifferentialDrive(radius=0.25)
HALL = shapely.box(0, 0, 10, 6)
WALL = shapely.box(4, 0, 4.2, 6)


def world(*obstacles):
    return hpop.World.from_polygons(list(obstacles), extent=HALL)


def image(pixels):
    return hpop.World.from_cells(np.flipud(np.array(pixels, dtype=bool)), 0.1)


def test_the_free_area_is_that_of_the_hall_less_the_robots_reach():
    free = FreeMap.of(ROBOT, world())
    assert free.areas.sum() == pytest.approx(9.5 * 5.5, rel=0.01)
    assert len(free.areas) == 2  # no part, and one
    block = shapely.box(4, 2, 6, 4)
    taken = block.buffer(0.25).area
    assert FreeMap.of(ROBOT, world(block)).areas.sum() == pytest.approx(9.5 * 5.5 - taken, rel=0.01)


def test_a_wall_makes_two_parts_and_a_door_joins_them_if_the_robot_fits():
    whole, door = FreeMap.of(ROBOT, world(WALL)), shapely.box(3.9, 2, 4.3, 2.6)
    assert whole.part_at(1.0, 1.0) != whole.part_at(8.0, 1.0)
    assert whole.part_at(8.0, 1.0) == whole.main  # the larger one
    assert whole.part_at(4.1, 3.0) == 0  # in the wall
    opened = world(shapely.difference(WALL, door))
    assert FreeMap.of(ROBOT, opened).part_at(1.0, 1.0) == FreeMap.of(ROBOT, opened).part_at(8.0, 1.0)
    wide = FreeMap.of(hpop.DifferentialDrive(radius=0.35), opened)
    assert wide.part_at(1.0, 1.0) != wide.part_at(8.0, 1.0)


def test_the_places_are_far_apart_by_the_way_between_them():
    """Round a wall that leaves a door at the top, the lower corners are farther from each other than any others."""
    free = FreeMap.of(ROBOT, world(shapely.box(4.9, 0, 5.1, 5)))
    (x0, y0), (x1, y1) = free.far_apart()
    assert x0 < 1.5 < 8.5 < x1
    assert max(y0, y1) < 1.5
    assert world().clearance(np.array([x0, x1]), np.array([y0, y1])).min() >= 0.25 + 0.4  # room about them


def test_places_far_apart_are_joined_by_the_lattice():
    hall = world(WALL.difference(shapely.box(3.9, 4, 4.3, 5)))
    start, goal = FreeMap.of(ROBOT, hall).far_apart()
    front = hpop.Problem(hall, ROBOT, (*start, 0.0), (*goal, None), ["length"]).solve("lattice")
    assert len(front) == 1
    assert front.best("length").costs["length"] > math.dist(start, goal)


def test_a_robot_that_is_nowhere_free_has_no_part():
    assert FreeMap.of(hpop.DifferentialDrive(radius=3.5), world()).main == 0


def test_places_may_be_asked_of_a_part():
    free = FreeMap.of(ROBOT, world(WALL))
    assert max(x for x, _ in free.far_apart(free.part_at(1.0, 1.0))) < 4.0 < min(x for x, _ in free.far_apart())


def test_a_long_robot_is_free_where_one_heading_is():
    long = hpop.DifferentialDrive(footprint=[(-0.6, -0.1), (0.6, -0.1), (0.6, 0.1), (-0.6, 0.1)])
    corridor = hpop.World.from_polygons([], extent=shapely.box(0, 0, 6, 0.5))
    assert FreeMap.of(long, corridor).areas.sum() == pytest.approx((6 - 1.2) * (0.5 - 0.2), rel=0.05)


def test_of_a_drawing_with_a_margin_what_is_indoors_is_taken():
    pixels = np.zeros((80, 100), dtype=int)
    pixels[20:60, 20:80] = 1
    pixels[22:58, 22:78] = 0  # a room of 5.6 x 3.6 m on a sheet of 10 x 8 m
    free = FreeMap.of(ROBOT, image(pixels))
    assert free.part_at(5.0, 4.0) == free.main
    assert free.areas[free.main] < free.areas.max()
    (x0, y0), (x1, y1) = free.far_apart()
    assert shapely.box(2, 2, 8, 6).contains(shapely.MultiPoint([(x0, y0), (x1, y1)]))


def test_an_arm_has_no_such_map():
    arm = hpop.SerialArm.from_urdf(ARM, tip="tool", acceleration=6.0)
    assert FreeMap.of(arm, world()) is None
