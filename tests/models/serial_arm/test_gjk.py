"""Distances of convex bodies: bounds that hold whatever happens and meet; closed forms, python-fcl and coal."""

import math

import fcl
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hpop.models.serial_arm.gjk import distance
from hpop.models.serial_arm.scene import bodies_of
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere, pose_at

HERE = np.eye(4)[:3]
FCL_PRECISION = 3e-3  # relative, of what python-fcl calls the distance of round shapes


def bounds(a, b, *, near=0.0, enough=math.inf, gap=1e-12, direction=(0.0, 0.0, 0.0)):
    bodies = bodies_of([a, b])
    return distance(bodies, 0, 1, HERE, np.array(direction), np.zeros((4, 3)), near, enough, enough, gap)


def box(size, at=(0.0, 0.0, 0.0), **turned):
    return Solid(Box(size), pose_at(at, **turned))


def drawn_shape(rng):
    """Return a shape of sizes between 1 mm and 1 m, flat and thin ones among them."""
    sizes = (10.0 ** rng.uniform(-3, 0, 3)).tolist()
    return (
        lambda: Box(tuple(sizes)),
        lambda: Cylinder(*sizes[:2]),
        lambda: Sphere(sizes[0]),
        lambda: Hull(rng.normal(size=(rng.integers(4, 60), 3)) * sizes),
    )[rng.integers(4)]()


def drawn(rng, spread=0.6):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(rng.normal(size=4)).as_matrix()
    pose[:3, 3] = rng.normal(size=3) * spread
    return Solid(drawn_shape(rng), pose)


def of_fcl(solid):
    shape = solid.shape
    if isinstance(shape, Hull):
        faces = np.column_stack([np.full(len(shape.triangles), 3), shape.triangles])
        geometry = fcl.Convex(np.array(shape.points), len(faces), faces.ravel())
    elif isinstance(shape, Box):
        geometry = fcl.Box(*shape.size)
    else:
        geometry = fcl.Sphere(shape.radius) if isinstance(shape, Sphere) else fcl.Cylinder(shape.radius, shape.length)
    return fcl.CollisionObject(geometry, fcl.Transform(solid.pose[:3, :3], solid.pose[:3, 3]))


@pytest.mark.seeds(1, of=20)
def test_bounds_meet_at_the_distance_that_python_fcl_finds(seed):
    rng = np.random.default_rng(seed)
    touching = 0
    for _ in range(400):
        a, b = drawn(rng), drawn(rng)
        lower, upper = bounds(a, b)
        assert abs(upper - lower) <= 1e-9
        one, other = of_fcl(a), of_fcl(b)
        if fcl.collide(one, other, fcl.CollisionRequest(), fcl.CollisionResult()):
            touching += 1
            assert lower <= 1e-6
        else:
            found = fcl.distance(one, other, fcl.DistanceRequest(), fcl.DistanceResult())
            assert abs(found - upper) <= FCL_PRECISION * upper + 1e-5
    assert touching > 5


@pytest.mark.seeds(1, of=20)
def test_bounds_meet_at_the_distance_that_coal_finds(seed):
    coal = pytest.importorskip("coal", reason="coal comes with pin, a dependency of tests of arms")
    rng = np.random.default_rng(seed)

    def of_coal(solid):
        shape = solid.shape
        if isinstance(shape, Hull):
            points = coal.StdVec_Vec3s()
            points.extend([*shape.points])
            geometry = coal.Convex.convexHull(points, True, "Qt")
        elif isinstance(shape, Box):
            geometry = coal.Box(*shape.size)
        else:
            geometry = (
                coal.Sphere(shape.radius) if isinstance(shape, Sphere) else coal.Cylinder(shape.radius, shape.length)
            )
        return geometry, coal.Transform3s(solid.pose[:3, :3], solid.pose[:3, 3])

    request = coal.DistanceRequest()
    request.gjk_tolerance = 1e-8
    for _ in range(400):
        a, b = drawn(rng), drawn(rng)
        lower, upper = bounds(a, b)
        found = coal.distance(*of_coal(a), *of_coal(b), request, coal.DistanceResult())
        assert lower - 1e-6 <= max(found, 0.0) <= upper + 1e-6


def test_spheres_are_apart_by_their_centres_less_their_radii():
    a, b = Solid(Sphere(0.1), pose_at((1.0, 2.0, 3.0))), Solid(Sphere(0.2), pose_at((1.0, 2.0, 5.0)))
    assert bounds(a, b) == pytest.approx((1.7, 1.7), abs=1e-12)


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.floats(0.01, 0.5), st.floats(0.01, 0.5), st.floats(0.01, 0.5))
@example((0.0, 1e-7, -1.234375), 0.046875, 0.5, 0.5)  # the distance is known to the last bit before the direction is
def test_a_sphere_and_a_cylinder_are_apart_by_the_closed_form(at, radius, length, ball):
    x, y, z = at
    off = math.hypot(max(math.hypot(x, y) - radius, 0.0), max(abs(z) - length / 2, 0.0))
    turned = {"rpy": (0.3, 1.2, -0.4)}
    pose = pose_at((0.5, -1.0, 2.0), **turned)
    found = bounds(Solid(Cylinder(radius, length), pose), Solid(Sphere(ball), pose @ pose_at(at)))
    assert found == pytest.approx(2 * [max(off - ball, 0.0)], abs=1e-9)


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.tuples(*[st.floats(0.001, 1.0)] * 6))
def test_parallel_boxes_are_apart_by_their_gaps_along_the_axes(at, sizes):
    """Their faces and edges are parallel: whole regions of points are as near as each other."""
    gaps = [max(abs(x) - (p + q) / 2, 0.0) for x, p, q in zip(at, sizes[:3], sizes[3:], strict=True)]
    turned = pose_at((0.3, 0.2, 0.1), rpy=(1.0, -0.5, 2.0))
    a, b = Solid(Box(sizes[:3]), turned), Solid(Box(sizes[3:]), turned @ pose_at(at))
    assert bounds(a, b) == pytest.approx(2 * [math.hypot(*gaps)], abs=1e-9)


@pytest.mark.parametrize(
    "shape", [Box((0.1, 1.0, 1e-3)), Cylinder(0.3, 0.2), Sphere(0.2), Hull(np.eye(4)[:, :3])], ids=type
)
def test_a_body_touches_itself(shape):
    solid = Solid(shape, pose_at((3.0, -2.0, 1.0), rpy=(0.1, 0.2, 0.3)))
    assert bounds(solid, solid) == (0.0, 0.0)


def test_boxes_that_share_a_face_touch():
    lower, upper = bounds(box((1, 1, 1)), box((1, 1, 1), (1.0, 0.25, 0.0)))
    assert lower == pytest.approx(0.0, abs=1e-12)
    assert upper == pytest.approx(0.0, abs=1e-12)


def test_the_lower_bound_stays_below_the_distance_of_cylinders_end_to_end():
    """Whole discs are nearest; the direction is that of the axis, where rounding alone says where on the rim."""
    for turned in np.random.default_rng(1).uniform(-3, 3, (50, 3)):
        pose = pose_at((0.1, 0.2, 0.3), rpy=turned)
        lower, upper = bounds(
            Solid(Cylinder(0.5, 0.2), pose), Solid(Cylinder(0.1, 0.4), pose @ pose_at((0.2, 0.1, 0.8)))
        )
        assert lower <= 0.5 + 1e-12
        assert (lower, upper) == pytest.approx((0.5, 0.5), abs=1e-9)


@given(st.integers(0, 10**6), st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(0.0, 1.0), st.floats(0.0, 2.0))
def test_bounds_hold_from_any_direction_and_however_soon_they_are_enough(seed, direction, near, enough):
    rng = np.random.default_rng(seed)
    a, b = drawn(rng), drawn(rng)
    exact, _ = bounds(a, b)
    lower, upper = bounds(a, b, near=near, enough=enough, gap=0.3, direction=direction)
    assert lower <= exact + 1e-9
    assert upper >= exact - 1e-9
    assert lower >= enough or upper < near or upper - lower <= 0.3 * upper + 1e-9


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 3))
def test_flat_sticks_and_points_given_many_times_are_bodies_too(seed, of_a, of_b):
    """Bodies of one to three corners, each given twice and their middles too: all simplices are degenerate."""
    rng = np.random.default_rng(seed)
    corners = [rng.integers(-2, 3, (count, 3)).astype(float) for count in (of_a, of_b)]
    some = [np.concatenate([c, c, c.mean(axis=0, keepdims=True)]) for c in corners]
    other = bodies_of([box((1, 1, 1))])._replace(
        points=np.concatenate(some), first=np.cumsum([0, *map(len, some)]), disc=np.zeros(2), ball=np.zeros(2)
    )
    other = other._replace(plane=np.repeat(other.plane, 2, axis=0))
    lower, upper = distance(other, 0, 1, HERE, np.zeros(3), np.zeros((4, 3)), 0.0, math.inf, math.inf, 1e-12)
    assert upper - lower <= 1e-7
    assert lower - 1e-7 <= least_distance(*corners) <= upper + 1e-7


def least_distance(a, b):
    """Return the distance of two hulls of few corners, by a quadratic program over their weights."""
    from scipy.optimize import nnls

    big = 1e4
    matrix = np.block(
        [
            [a.T, -b.T],
            [big * np.ones((1, len(a))), np.zeros((1, len(b)))],
            [np.zeros((1, len(a))), big * np.ones((1, len(b)))],
        ]
    )
    weights, _ = nnls(matrix, np.array([0.0, 0.0, 0.0, big, big]))
    p, q = weights[: len(a)], weights[len(a) :]
    return float(np.linalg.norm(a.T @ (p / p.sum()) - b.T @ (q / q.sum())))


def test_a_pose_between_frames_places_the_second_body():
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = drawn(rng), drawn(rng)
        frame = np.linalg.inv(a.pose) @ b.pose
        bodies = bodies_of([Solid(a.shape, np.eye(4)), Solid(b.shape, np.eye(4))])
        arguments = (np.zeros(3), np.zeros((4, 3)), 0.0, math.inf, math.inf, 1e-12)
        assert distance(bodies, 0, 1, frame[:3].copy(), *arguments) == pytest.approx(bounds(a, b), abs=1e-9)


@pytest.mark.seeds(1, of=10)
def test_spheres_and_boxes_round_bodies_hold_them(seed):
    rng = np.random.default_rng(seed)
    solids = [drawn(rng) for _ in range(30)]
    bodies = bodies_of(solids)
    for i, solid in enumerate(solids):
        directions = np.vstack([rng.normal(size=(200, 3)), bodies.box[i, :3], -bodies.box[i, :3]])
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        reach = solid.shape.support(directions @ solid.pose[:3, :3]) + directions @ solid.pose[:3, 3]
        middle = directions @ bodies.centre[i]
        assert (reach <= middle + bodies.reach[i] + 1e-9).all()
        assert (reach <= middle + np.abs(directions @ bodies.box[i, :3].T) @ bodies.box[i, 3] + 1e-9).all()
