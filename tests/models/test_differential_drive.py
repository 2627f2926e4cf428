"""The differential drive: its parameters, its camera, its collision geometry."""

import math
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.base.registry import make_model
from hpop.errors import ModelError
from hpop.models import DifferentialDrive
from hpop.models.collision import Part, convex_parts
from hpop.motions import States

LENGTHS = [
    "radius",
    "body_height",
    "camera_height",
    "mast_radius",
    "speed",
    "acceleration",
    "turn_rate",
    "turn_acceleration",
    "wheel_base",
]
SQUARE = ((0.4, 0.3), (-0.4, 0.3), (-0.4, -0.3), (0.4, -0.3))
L_SHAPE = ((0.5, 0.2), (-0.2, 0.2), (-0.2, -0.6), (0.1, -0.6), (0.1, -0.2), (0.5, -0.2))


@pytest.mark.parametrize("name", LENGTHS)
@pytest.mark.parametrize("value", [0, -1.0, math.nan, math.inf, "1", None, True])
def test_every_length_and_limit_must_be_a_positive_number(name, value):
    with pytest.raises(ModelError, match=name):
        DifferentialDrive(**{name: value})


@pytest.mark.parametrize("name", ["radius", "body_height", "camera_height", "mast_radius", "wheel_base"])
def test_a_length_in_centimetres_is_refused(name):
    with pytest.raises(ModelError, match=f"{name} must be a positive length in m from .* to 20, got 120"):
        DifferentialDrive(**{name: 120})


@pytest.mark.parametrize("number", [1, np.int64(1), np.float32(1)])
def test_numbers_may_come_from_numpy(number):
    robot = DifferentialDrive(speed=number)
    assert robot == DifferentialDrive(speed=1.0)
    assert type(robot.describe()["differential_drive"]["speed"]) is float


@pytest.mark.parametrize("offset", [3, "ab", None, (1,), (1, 2, 3), (math.nan, 0), (0, math.inf), ("a", "b")])
def test_a_camera_offset_is_two_finite_lengths(offset):
    with pytest.raises(ModelError, match="camera_offset"):
        DifferentialDrive(camera_offset=offset)


@pytest.mark.parametrize(
    ("corners", "message"),
    [
        (3, "at least three corners"),
        ("abc", "at least three corners"),
        (((0, 0), (1, 1)), "at least three corners"),
        (((math.nan, 0), (1, 1), (0, 1)), "finite"),
        (((math.inf, 0), (1, 1), (0, 1)), "finite"),
        (((-1, -1), (1, 1), (2, 2)), "a polygon that does not cross itself"),
        (((1, 1), (-1, -1), (1, -1), (-1, 1)), "a polygon that does not cross itself"),
        (((1, 1), (2, 1), (2, 2)), "must contain the axis"),
    ],
)
def test_a_footprint_is_a_simple_polygon_round_the_axis(corners, message):
    with pytest.raises(ModelError, match=message):
        DifferentialDrive(footprint=corners)


def test_models_are_values():
    robot = DifferentialDrive(footprint=[list(c) for c in SQUARE], camera_offset=[0.1, 0.0])
    assert robot == DifferentialDrive(footprint=SQUARE, camera_offset=(0.1, 0.0))
    assert hash(robot) == hash(pickle.loads(pickle.dumps(robot)))
    assert make_model(robot.describe()) == robot


def test_the_camera_stands_where_the_base_turns_it():
    robot = DifferentialDrive(camera_offset=(0.3, 0.1), camera_height=1.5)
    states = States(x=np.array([1.0, 1.0]), y=np.array([2.0, 2.0]), yaw=np.array([0.0, np.pi / 2]))
    camera = robot.pose("camera", states)
    assert camera.x == pytest.approx([1.3, 0.9])
    assert camera.y == pytest.approx([2.1, 2.3])
    assert camera.z.tolist() == [1.5, 1.5]

    assert robot.pose("base", states).x.tolist() == [1.0, 1.0]
    with pytest.raises(ModelError, match="must be one of base, camera, got 'arm'"):
        robot.pose("arm", states)


def test_a_round_robot_has_a_disc_and_a_mast():
    body, mast = DifferentialDrive(radius=0.25, body_height=0.3, camera_height=1.4, camera_offset=(0.1, 0)).parts
    assert body == Part(((0.0, 0.0),), 0.25, 0.0, 0.3)
    assert mast == Part(((0.1, 0.0),), 0.05, 0.0, 1.4)
    assert body.on_axis
    assert not mast.on_axis
    assert mast.reach == pytest.approx(0.15)


def test_a_convex_footprint_is_one_part_and_another_is_its_triangles():
    assert len(convex_parts(SQUARE, 0, 1)) == 1
    pieces = convex_parts(L_SHAPE, 0, 1)
    assert len(pieces) > 1


@given(st.lists(st.tuples(st.floats(0.1, 1.0), st.booleans()), min_size=4, max_size=9))
def test_parts_cover_the_footprint_exactly_and_are_convex(spokes):
    angles = np.linspace(0, 2 * np.pi, len(spokes), endpoint=False)
    outline = tuple((r * np.cos(a), r * np.sin(a)) for (r, _), a in zip(spokes, angles, strict=True))
    pieces = [shapely.Polygon(part.corners) for part in convex_parts(outline, 0, 1)]
    for piece in pieces:
        assert piece.area == pytest.approx(piece.convex_hull.area, rel=1e-9)
    whole = shapely.Polygon(outline)
    assert shapely.union_all(pieces).symmetric_difference(whole).area < 1e-9
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area)


def test_corners_are_placed_by_position_and_yaw():
    part = Part(SQUARE, 0.0, 0.0, 1.0)
    placed = part.placed(States(x=np.array([1.0]), y=np.array([2.0]), yaw=np.array([np.pi / 2])))
    assert placed[0] == pytest.approx(np.array([(0.7, 2.4), (0.7, 1.6), (1.3, 1.6), (1.3, 2.4)]))
    assert part.reach == pytest.approx(0.5)
