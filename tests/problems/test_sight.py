"""Invisible things are noted: targets behind walls, landmarks that obstacles enclose."""

import numpy as np
import pytest
import shapely

import hpop
from hpop.world import World
from hpop.world.content.content import Landmark

WALL = shapely.box(4.9, 0, 5.1, 4)
HALL = World.from_polygons([WALL], extent=shapely.box(0, 0, 10, 6))
ROBOT = hpop.DifferentialDrive(radius=0.3, camera_height=1.2)


def notes(target: tuple[float, float, float]) -> list[str]:
    goal = {"look_at": {"target": target, "distance": [0.8, 1.2]}}
    front = hpop.Problem(HALL, ROBOT, (1, 3, 0), goal, ["length"]).solve({"roadmap": {"samples": 60}})
    assert len(front)
    return [note for note in front.notes if "obstacle hides the target" in note]


@pytest.mark.proof
def test_a_target_in_the_open_is_not_noted():
    assert not notes((3.0, 2.0, 1.2))


def test_a_target_within_an_obstacle_is_noted():
    (note,) = notes((5.0, 2.0, 1.2))
    assert "obstacle hides the target (5, 2, 1.2) of look_at at the end of all trajectories" in note


def marked(world: World, *marks: Landmark, criteria: tuple[str, ...] = ("landmark_visibility", "length")) -> str:
    problem = hpop.Problem(world.with_content(landmarks=marks), ROBOT, (1, 5, 0), (9, 5, None), list(criteria))
    return " ".join(note for note in problem.notes if "obstacles enclose" in note)


def test_a_white_letter_on_a_dark_pedestal_is_noted_and_what_stands_in_the_open_is_not():
    cells = np.zeros((60, 100), bool)
    cells[20:30, 40:50] = True
    cells[24:26, 44:46] = False  # the letter
    world = World.from_cells(cells, 0.1)
    letter, free = Landmark(4.5, 2.5, name="A"), Landmark(7.0, 2.0, name="picture")
    found = marked(world, letter, free)
    assert "'A' at (4.5, 2.5)" in found
    assert "picture" not in found
    assert marked(world, free) == ""
    assert marked(world, letter, criteria=("length",)) == ""  # nobody asks for landmarks


def test_a_landmark_above_low_walls_is_seen():
    """A ring 1 m high hides nothing of what hangs above it from a camera above it, and all of what lies within."""
    ring = shapely.box(4, 2, 6, 4).difference(shapely.box(4.2, 2.2, 5.8, 3.8))
    world = World.from_polygons([(ring, (0.0, 1.3))], extent=shapely.box(0, 0, 10, 6))
    low, high = Landmark(5, 3, z=1.0, name="low"), Landmark(5, 3, z=1.5, name="high")
    found = marked(world, low, high)
    assert "'low'" in found
    assert "'high'" not in found
