"""MoveIt's text format of scenes (.scene), in its two versions: the same solids as the YAML of the same objects."""

import numpy as np
import pytest

from hpop.errors import MapError
from hpop.world import Box, Cylinder, Hull, Sphere, World

NEW = """(noname)
* table top
1 2 0.5
0 0 0.7071067811865476 0.7071067811865476
2
box
1 0.5 0.1
0.1 0 0
0 0 0 1
0 0 0 0
cylinder
0.05 0.7
0 0 -0.35
0 0 0 1
0.5 0.5 0.5 1
1
handle
0 0 0
0 0 0 1
* ball
0 0 0
0 0 0 1
1
sphere
0.2
3 0 1
0 0 0 1
0 0 0 0
0
* wedge
0 0 0
0 0 0 1
1
mesh
4 4
0 0 0
1 0 0
0 1 0
0 0 1
0 2 1
0 1 3
1 2 3
0 3 2
0 0 5
0 0 0 1
0 0 0 0
0
.
"""
OLD = """scene of 2015
* ball
1
sphere
0.2
3 0 1
0 0 0 1
0 0 0 0
* box
1
box
1 2 3
0 0 4
0 0 0 1
0 0 0 0
.
"""


def read(folder, text):
    (folder / "kitchen.scene").write_text(text)
    return World.from_file(folder / "kitchen.scene")


def test_a_scene_is_read_with_the_poses_of_objects_and_of_shapes(tmp_path):
    world = read(tmp_path, NEW)
    board, leg, ball, wedge = world.bodies
    assert [solid.name for solid in world.bodies] == ["table top", "table top", "ball", "wedge"]
    assert (board.shape, leg.shape, ball.shape) == (Box((1.0, 0.5, 0.1)), Cylinder(0.05, 0.7), Sphere(0.2))
    np.testing.assert_allclose(board.pose[:3, 3], (1, 2.1, 0.5))  # 0.1 m along x, turned a quarter to the left
    np.testing.assert_allclose(leg.pose[:3, 3], (1, 2, 0.15))
    np.testing.assert_allclose(board.pose[:3, 0], (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(ball.pose[:3, 3], (3, 0, 1))
    assert isinstance(wedge.shape, Hull)
    np.testing.assert_allclose(wedge.bounds, [(0, 0, 5), (1, 1, 6)])
    assert [s.describe() for s in World.from_description(world.describe()).bodies] == [
        s.describe() for s in world.bodies
    ]


def test_a_scene_of_the_older_version_has_shapes_in_the_world(tmp_path):
    ball, box = read(tmp_path, OLD).bodies
    np.testing.assert_allclose(ball.pose[:3, 3], (3, 0, 1))
    assert box.shape == Box((1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (NEW[:-2], r"line \d+: expected \* before the name of an object, or a full stop at the end, got 'the end"),
        (NEW.replace("sphere", "torus"), "line 24: expected a shape, one of mesh, plane, box, .*, got 'torus'"),
        (NEW.replace("0.2\n", "wide\n"), "expected the sizes of a sphere, 1 number, got 'wide'"),
        (NEW.replace("4 4", "400000 4"), "expected the number of vertices, a whole number up to 100,000"),
        (NEW.replace("0 2 1\n", "0 2 9\n"), "must be the index of a vertex from 0 to 3, got 9"),
        (NEW.replace("* ball", "* table top"), "object 'table top' is there twice"),
        (NEW.replace("sphere\n0.2", "cone\n0.2 0.3"), "'ball': primitives 0: type must be one of box"),
        (NEW.replace("sphere\n0.2", "plane\n0 0 1 0"), "planes are infinite, .* replace each by a thin box"),
        (NEW.replace("\n1\nhandle", "\n-1\nhandle"), "expected the number of subframes"),
        ("name\n* a\n", "got 'the end of the file'"),
    ],
)
def test_a_scene_that_is_damaged_is_refused_with_the_line(tmp_path, text, said):
    with pytest.raises(MapError, match=said):
        read(tmp_path, text)
