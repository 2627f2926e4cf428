"""Solids in space: what covers them from above, how high they are, what is refused, what survives saving."""

import json
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from hpop.errors import MapError
from hpop.world.geometry.solids import SAGITTA, Box, Cylinder, Hull, Solid, Sphere, pose_at

angles = st.tuples(*[st.floats(-3.2, 3.2)] * 3)
PYRAMID = np.array([(0.0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (1, 0.5, 3)])
WEDGE = np.array([(x, y, z) for z in (0.0, 4.0) for x, y in ((0, 0), (2, 0), (2, 1))])
SHAPES = [Box((0.4, 1.2, 0.1)), Cylinder(0.3, 0.9), Sphere(0.7), Hull(PYRAMID)]


def inside(shape, rng, count=400):
    """Points of a shape's surface and inside, in its own frame."""
    if isinstance(shape, Box):
        return rng.uniform(-0.5, 0.5, (count, 3)).round(1) * shape.size
    if isinstance(shape, Cylinder):
        turn, height = rng.uniform(-4, 4, count), rng.choice([-0.5, 0.5], count) * shape.length
        return np.c_[shape.radius * np.cos(turn), shape.radius * np.sin(turn), height]
    if isinstance(shape, Sphere):
        points = rng.normal(size=(count, 3))
        return shape.radius * points / np.linalg.norm(points, axis=1)[:, None]
    return rng.dirichlet(np.full(len(shape.points), 0.1), count) @ shape.points


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
@given(rpy=angles)
def test_no_point_of_a_solid_is_beyond_the_prism_round_it(shape, rpy):
    solid = Solid(shape, pose_at((3.0, -2.0, 1.0), rpy=rpy))
    points = inside(shape, np.random.default_rng(1)) @ solid.pose[:3, :3].T + solid.pose[:3, 3]
    outline = shapely.buffer(solid.outline, 1e-9)
    assert shapely.contains_xy(outline, points[:, 0], points[:, 1]).all()
    low, high = solid.bounds
    assert (points >= low - 1e-9).all()
    assert (points <= high + 1e-9).all()


@pytest.mark.parametrize("radius", [0.01, 0.03, 0.5, 1.0, 40.0])
def test_a_circles_outline_holds_the_circle_and_leaves_it_by_no_more_than_the_sagitta(radius):
    outline = Solid(Cylinder(radius, 1.0), pose_at()).outline
    corners = np.hypot(*np.array(outline.exterior.coords).T)
    assert corners.max() <= radius + SAGITTA * max(radius, 1.0) * (1 + 1e-9)
    assert outline.exterior.distance(shapely.Point(0, 0)) >= radius * (1 - 1e-12)
    assert len(corners) <= 80


def test_bounds_of_turned_shapes_are_those_of_geometry():
    turned = pose_at(rpy=(0.0, math.pi / 4, 0.0))
    root = math.sqrt(0.5)
    assert Solid(Box((1.0, 1.0, 1.0)), turned).heights == pytest.approx((-2 * root / 2, 2 * root / 2))
    assert Solid(Cylinder(0.5, 2.0), turned).heights == pytest.approx((-(root + root / 2), root + root / 2))
    assert Solid(Sphere(0.5), turned).heights == pytest.approx((-0.5, 0.5))
    assert Solid(Hull(PYRAMID), pose_at(rpy=(math.pi, 0, 0))).heights == pytest.approx((-3, 0), abs=1e-12)


@pytest.mark.parametrize(
    ("shape", "rpy", "upright"),
    [
        (Box((1, 2, 3)), (0, 0, 0.7), True),
        (Box((1, 2, 3)), (math.pi / 2, 0, 0), True),
        (Box((1, 2, 3)), (0.01, 0, 0), False),
        (Cylinder(1, 2), (math.pi, 0, 2.0), True),
        (Cylinder(1, 2), (math.pi / 2, 0, 0), False),
        (Sphere(1), (0, 0, 0), False),
        (Hull(PYRAMID), (0, 0, 0), False),
        (Hull(WEDGE), (0, 0, 0.3), True),
    ],
)
def test_what_is_upright_is_the_prism_round_it(shape, rpy, upright):
    assert Solid(shape, pose_at(rpy=rpy)).is_upright is upright


def test_an_upright_box_has_the_corners_of_its_rectangle():
    solid = Solid(Box((1.0, 0.5, 2.0)), pose_at((4.5, 1.25, 1.0)))
    assert solid.outline.equals(shapely.box(4.0, 1.0, 5.0, 1.5))
    assert len(solid.outline.exterior.coords) == 5
    assert solid.heights == (0.0, 2.0)


def test_a_hull_keeps_its_corners_and_its_faces_look_outwards():
    hull = Hull(np.concatenate([PYRAMID, [(1.0, 0.5, 1.0), (1.0, 0.5, 0.0)]]))
    assert hull.points.tolist() == PYRAMID.tolist()
    a, b, c = hull.points[hull.triangles.T]
    outward = np.einsum("ij,ij->i", np.cross(b - a, c - a), (a + b + c) / 3 - PYRAMID.mean(axis=0))
    assert (outward > 0).all()
    assert hull.volume == pytest.approx(2 * 1 * 3 / 3)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_a_solid_survives_its_description(shape):
    solid = Solid(shape, pose_at((1 / 3, -2.0, 1e5), rpy=(0.1, 0.2, 0.3)), "küche")
    again = Solid.build(json.loads(json.dumps(solid.describe())))
    assert again.describe() == solid.describe()
    assert (again.pose == solid.pose).all()


def test_a_pose_is_roll_pitch_yaw_or_a_quaternion():
    np.testing.assert_allclose(pose_at(rpy=(0, 0, math.pi / 2))[:3, :3] @ (1, 0, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(
        pose_at(rpy=(0.3, 0.2, math.pi / 2))[:3, :3] @ (1, 0, 0), (0, math.cos(0.2), -math.sin(0.2)), atol=1e-12
    )
    np.testing.assert_allclose(pose_at(quaternion=(0, 0, 2, 2)), pose_at(rpy=(0, 0, math.pi / 2)), atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Box((1, 2)), "a box's size must be 3 numbers"),
        (lambda: Box((1, 2, 0)), "a box's size must be a length in m"),
        (lambda: Box((1, 2, math.nan)), "a box's size must be a length in m from 1e-06 to 1,000,000, got nan"),
        (lambda: Solid(Box((1, 1, 1)), (0.5, 0.3, 0.2)), r"write pose_at\(\(0.5, 0.3, 0.2\)\)"),
        (lambda: Box(None), "a box's size must be 3 numbers"),
        (lambda: Cylinder(-1, 1), "a cylinder's radius must be a length"),
        (lambda: Cylinder(1, "2"), "a cylinder's length must be a length"),
        (lambda: Sphere(1e9), "a sphere's radius must be a length"),
        (lambda: Hull([(0, 0, 0)] * 4), "no volume"),
        (lambda: Hull([(0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 1)]), "no volume"),
        (lambda: Hull([(0, 0), (1, 1)]), r"points, an array \(V, 3\)"),
        (lambda: Hull("cube"), r"points, an array \(V, 3\)"),
        (lambda: Hull([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, math.inf)]), "finite"),
        (lambda: Solid("box", np.eye(4)), "Box, Cylinder, Sphere or Hull"),
        (lambda: Solid(Sphere(1), np.eye(3)), r"homogeneous matrix \(4, 4\)"),
        (lambda: Solid(Sphere(1), np.eye(4), 3), "name must be text"),
        (lambda: Solid(Sphere(1), 2 * np.eye(4), "ball"), "the pose of solid 'ball'"),
        (lambda: Solid(Sphere(1), np.diag([1.0, 2.0, 1.0, 1.0])), "rotation matrix"),
        (lambda: Solid(Sphere(1), np.diag([1.0, 1.0, -1.0, 1.0])), "right-handed"),
        (lambda: pose_at((1, 2)), "a position must be 3 numbers"),
        (lambda: pose_at(quaternion=(0, 0, 0, 0)), "must have a length from 1e-06 to 1,000,000"),
        (lambda: pose_at(rpy="up"), "roll, pitch and yaw must be 3 numbers"),
        (lambda: pose_at(rpy=(0, 0, 90)), "in radians.*write math.radians"),
        (lambda: pose_at((1, 2, 1e300)), "a position must be finite numbers"),
    ],
)
def test_what_is_no_solid_is_refused_with_what_was_expected(make, message):
    with pytest.raises(MapError, match=message):
        make()
