"""Rays in space: closed forms, python-fcl by bisection, and the share of a ball against balls and half-spaces."""

import math

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from hpop.world.geometry.rays_in_space import Surfaces, over_disc, over_sphere, stacked_poses
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere

REACH = 9.0


def posed(shape, rng):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=rng.integers(2**31)).as_matrix()
    pose[:3, 3] = rng.uniform(-1, 1, 3)
    return Solid(shape, pose)


def drawn(rng):
    """One of each shape, anywhere."""
    hull = Hull(rng.normal(size=(20, 3)) * 0.3)
    shapes = Box((0.4, 0.7, 1.1)), Cylinder(0.3, 0.8), Sphere(0.5), hull
    return [posed(shape, rng) for shape in shapes]


def contains(solid, points):
    """Return a mask of the points (N, 3) inside a solid, by the definition of each shape."""
    local = (points - solid.pose[:3, 3]) @ solid.pose[:3, :3]
    match solid.shape:
        case Box(size=size):
            return (np.abs(local) <= 0.5 * np.array(size)).all(axis=1)
        case Cylinder(radius=radius, length=length):
            return (np.hypot(local[:, 0], local[:, 1]) <= radius) & (np.abs(local[:, 2]) <= length / 2)
        case Sphere(radius=radius):
            return np.linalg.norm(local, axis=1) <= radius
    hull = ConvexHull(solid.shape.points)
    return (local @ hull.equations[:, :3].T + hull.equations[:, 3] <= 1e-12).all(axis=1)


def rays_to_ball(origins, centre, radius, count):
    """Return unit vectors (N, K, 3) to a disc in the ball that faces each origin, and their lengths (N, K), m."""
    offsets = centre - origins
    aside = np.eye(3)[np.argmin(np.abs(offsets), axis=1)]  # of the axes, the most perpendicular
    u = np.cross(offsets, aside)
    u *= radius / np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(offsets, u) / np.linalg.norm(offsets, axis=1, keepdims=True)
    s, t = over_disc(count).T
    lines = offsets[:, None] + s[:, None] * u[:, None] + t[:, None] * v[:, None]
    lines /= np.linalg.norm(lines, axis=2, keepdims=True)
    along = np.einsum("nkx,nx->nk", lines, offsets)
    beside = np.sum(offsets**2, axis=1)[:, None] - along**2
    reach = along - np.sqrt(np.maximum(radius**2 - beside, 0.0))
    return lines, np.where(np.linalg.norm(offsets, axis=1)[:, None] > radius, reach, 0.0)


STILL = np.empty((0, 1, 4, 4))  # poses of no bodies in one posture


@pytest.mark.parametrize("which", range(4))
def test_a_ray_ends_where_points_along_it_are_inside_for_the_first_time(which):
    rng = np.random.default_rng(which)
    steps = np.arange(1, 6000) * 1e-3
    hits = 0
    for _ in range(40):
        solid = drawn(rng)[which]
        origin, direction = rng.uniform(-3, 3, 3), rng.normal(size=3)
        direction = solid.pose[:3, 3] + 0.5 * direction - origin
        direction /= np.linalg.norm(direction)
        if contains(solid, origin[None])[0]:
            continue
        inside = contains(solid, origin + steps[:, None] * direction)
        found = Surfaces.of([solid]).first_hits(origin[None], direction[None, None], REACH)[0, 0]
        if inside.any():
            assert steps[np.argmax(inside)] - 1e-3 <= found <= steps[np.argmax(inside)]
            hits += 1
        else:  # a corner thinner than a step may be cut
            assert found == REACH or not contains(solid, origin + (found + 1e-3) * direction[None])[0]
    assert hits > 10


def test_rays_agree_with_solids_of_python_fcl():
    """Collision of a thin needle from the origin to before the hit, and to beyond it."""
    fcl = pytest.importorskip("fcl")
    rng = np.random.default_rng(5)
    for _ in range(20):
        for solid in drawn(rng)[:3]:
            shape = solid.shape
            match shape:
                case Box(size=size):
                    geometry = fcl.Box(*size)
                case Cylinder(radius=radius, length=length):
                    geometry = fcl.Cylinder(radius, length)
                case Sphere(radius=radius):
                    geometry = fcl.Sphere(radius)
            there = fcl.CollisionObject(geometry, fcl.Transform(solid.pose[:3, :3], solid.pose[:3, 3]))
            origin = solid.pose[:3, 3] + 3.0 * over_sphere(100)[rng.integers(100)]
            direction = solid.pose[:3, 3] + rng.uniform(-0.15, 0.15, 3) - origin
            direction /= np.linalg.norm(direction)
            found = Surfaces.of([solid]).first_hits(origin[None], direction[None, None], REACH)[0, 0]
            assert found < REACH
            for length, meets in ((found - 2e-3, False), (found + 2e-3, True)):
                turn, _ = Rotation.align_vectors(direction[None], [[0.0, 0.0, 1.0]])
                needle = fcl.CollisionObject(
                    fcl.Cylinder(1e-4, length), fcl.Transform(turn.as_matrix(), origin + 0.5 * length * direction)
                )
                assert (fcl.collide(needle, there, fcl.CollisionRequest(), fcl.CollisionResult()) > 0) == meets


def test_many_bodies_and_rays_are_the_nearest_of_each_alone():
    rng = np.random.default_rng(7)
    solids = drawn(rng) + drawn(rng)
    origins, directions = rng.uniform(-3, 3, (30, 3)), np.tile(over_sphere(40), (30, 1, 1))
    together = Surfaces.of(solids).first_hits(origins, directions, 4.0)
    alone = [Surfaces.of([solid]).first_hits(origins, directions, 4.0) for solid in solids]
    np.testing.assert_array_equal(together, np.minimum.reduce(alone))
    assert (together < 4.0).any()


@pytest.mark.parametrize("spread", [0.0, 0.05, 0.6])
def test_bundles_of_rays_meet_what_each_ray_meets(spread):
    rng = np.random.default_rng(8)
    surfaces = Surfaces.of(drawn(rng) + drawn(rng))
    origins = rng.uniform(-3, 3, (200, 3))
    ahead = rng.normal(size=(200, 1, 3)) - origins[:, None]
    directions = ahead / np.linalg.norm(ahead, axis=2, keepdims=True) + spread * rng.uniform(-1, 1, (200, 9, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    together = surfaces.first_hits(origins, directions, 5.0)
    alone = surfaces.first_hits(np.repeat(origins, 9, axis=0), directions.reshape(-1, 1, 3), 5.0)
    everywhere = np.concatenate([directions, -directions], axis=1)  # no bundle at all
    np.testing.assert_array_equal(together.ravel(), alone.ravel())
    np.testing.assert_array_equal(together, surfaces.first_hits(origins, everywhere, 5.0)[:, :9])
    assert 0.05 < (together < 5.0).mean() < 0.95


@pytest.mark.parametrize("radius", [0.01, 0.3, 1.2])
def test_the_share_of_blocked_rays_is_that_of_first_hits_of_solids_wherever_they_are(radius):
    rng = np.random.default_rng(9)
    fixed, moving = drawn(rng), [drawn(rng) for _ in range(60)]  # one set of solids for each origin
    own = Surfaces.of([Solid(solid.shape, np.eye(4)) for solid in moving[0]])
    moving = [[Solid(a.shape, b.pose) for a, b in zip(moving[0], there, strict=True)] for there in moving]
    poses = np.stack([[solid.pose for solid in there] for there in moving], axis=1)
    origins, centres = rng.uniform(-3, 3, (60, 3)), rng.uniform(-3, 3, (60, 3))
    directions, reach = rays_to_ball(origins, centres, radius, 25)
    found = Surfaces.of(fixed).blocked(own, poses, origins, centres, radius, 25)
    for n, there in enumerate(moving):
        hits = Surfaces.of(fixed + there).first_hits(origins[n : n + 1], directions[n : n + 1], 9.0)
        assert found[n] == pytest.approx(np.mean(hits < reach[n]))
    assert 0.1 < found.mean() < 0.9


@pytest.mark.seeds(3, of=40)
def test_hulls_of_the_robot_block_rays_from_beside_them_as_first_hits_say(seed):
    """Rays begin on, just off and far off the faces of hulls, and end before, in and behind hulls."""
    rng = np.random.default_rng(seed)
    hulls = [Hull(rng.normal(size=(60, 3)) * rng.uniform(0.05, 0.5, 3) + rng.normal(size=3) * 0.4) for _ in range(3)]
    own = Surfaces.of([Solid(hull, np.eye(4)) for hull in hulls])
    corners = hulls[0].points[hulls[0].triangles]
    shares = []
    for _ in range(6):
        faces = corners[rng.integers(len(corners), size=30)]
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        off = rng.choice([0.0, 1e-7, 3e-6, 1e-3, 0.3], size=(30, 1))
        origins = np.einsum("nc,ncx->nx", rng.dirichlet((1, 1, 1), 30), faces) + off * normals
        centre, radius = rng.normal(size=3) * rng.choice([0.3, 1.5]), rng.choice([0.01, 0.1, 0.4])
        directions, reach = rays_to_ball(origins, centre, radius, 20)
        hits = own.first_hits(origins, directions, 9.0)
        found = Surfaces.of([]).blocked(own, np.tile(np.eye(4), (3, 30, 1, 1)), origins, centre, radius, 20)
        np.testing.assert_array_equal(found, np.mean(hits < reach, axis=1))
        shares.append(found.mean())
    assert 0.1 < np.mean(shares) < 0.9


def beyond_half_spaces(equations, pose, origin, directions, reach):
    """Return which rays (K,) enter the body of half-spaces in less than ``reach``; None if it may contain the origin.

    Each half-space bounds the part of a line that is inside it (Cyrus and Beck 1978).
    """
    here, turned = pose[:3, :3].T @ (origin - pose[:3, 3]), directions @ pose[:3, :3]
    gap, slant = equations[:, :3] @ here + equations[:, 3], turned @ equations[:, :3].T
    if gap.max() < 1e-3:
        return None
    with np.errstate(divide="ignore"):
        cross = -gap / slant
    low = np.where(slant < 0, cross, -np.inf).max(axis=1)
    high = np.where(slant > 0, cross, np.inf).min(axis=1)
    return (low <= high) & (low > 0) & (low < reach)


def box_and_hull(rng):
    """Return a hull and a box, each with its half-spaces and its corners."""
    points, half = rng.normal(size=(40, 3)) * rng.uniform(0.05, 0.5, 3), rng.uniform(0.05, 0.5, 3)
    corners = np.array(np.meshgrid(*np.stack([-half, half], axis=1))).reshape(3, 8).T
    return [(Hull(points), ConvexHull(points)), (Box(tuple(2 * half)), ConvexHull(corners))]


def turned(rng):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix()
    pose[:3, 3] = rng.uniform(-1, 1, 3)
    return pose


@pytest.mark.parametrize("spread", [1e-4, 0.02, 0.2])
def test_narrow_cones_of_rays_enter_boxes_and_hulls_as_their_half_spaces_say(spread):
    rng = np.random.default_rng(12)
    shares = []
    for _ in range(60):
        for shape, known in box_and_hull(rng):
            pose, origin = turned(rng), rng.uniform(-3, 3, 3)
            ahead = pose[:3, 3] + rng.uniform(-0.4, 0.4, 3) - origin
            length = rng.choice([1.0, 2.0, 6.0])
            centre, radius = origin + length * ahead / np.linalg.norm(ahead), spread * length
            directions, reach = rays_to_ball(origin[None], centre, radius, 37)
            expected = beyond_half_spaces(known.equations, pose, origin, directions[0], reach[0])
            if expected is None:
                continue
            moving = Surfaces.of([Solid(shape, np.eye(4))])
            found = Surfaces.of([]).blocked(moving, pose[None, None], origin[None], centre, radius, 37)
            fixed = Surfaces.of([Solid(shape, pose)]).blocked(Surfaces.of([]), STILL, origin[None], centre, radius, 37)
            assert found[0] == fixed[0] == np.mean(expected)
            shares.append(found[0])
    assert {0.0, 1.0} <= set(shares) or spread > 0.1
    assert np.mean([0.0 < share < 1.0 for share in shares]) > 0.03 or spread < 0.01


@pytest.mark.seeds(2, of=20)
def test_rays_that_graze_a_body_are_blocked_only_if_a_larger_body_blocks_them(seed):
    """Rays to corners, to points on edges and faces, and beside them: at least as many as a smaller body blocks."""
    rng = np.random.default_rng(seed)
    undecided = 0
    for _ in range(30):
        for shape, known in box_and_hull(rng):
            pose, origin = turned(rng), rng.uniform(-2, 2, 3)
            corners = known.points[rng.choice(known.simplices)]
            weights = rng.permutation(rng.choice([(1.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.2, 0.3, 0.5)]))
            at = pose[:3, :3] @ (weights @ corners) + pose[:3, 3]
            centre, radius = origin + rng.choice([1.0, 3.0]) * (at - origin), rng.choice([1e-9, 1e-3, 0.2])
            rays = rng.choice([1, 7])
            directions, reach = rays_to_ball(origin[None], centre, radius, rays)
            apart = 1e-7 * np.array([0.0, 0.0, 0.0, 1.0])
            smaller, larger = (
                beyond_half_spaces(known.equations + by * apart, pose, origin, directions[0], reach[0] - by * 1e-7)
                for by in (1.0, -1.0)
            )
            if smaller is None or larger is None:
                continue
            found = Surfaces.of([Solid(shape, pose)]).blocked(
                Surfaces.of([]), STILL, origin[None], centre, radius, int(rays)
            )
            assert smaller.mean() - 1e-12 <= found[0] <= larger.mean() + 1e-12
            undecided += smaller.mean() < larger.mean()
    assert undecided > 3


def test_what_a_posture_blocks_does_not_depend_on_the_postures_before_it_or_on_other_rays():
    """Sides and bodies that decided the last posture are tried first in the next one."""
    rng = np.random.default_rng(21)
    shapes = [Hull(rng.normal(size=(40, 3)) * 0.3), Box((0.3, 0.5, 0.2)), Hull(rng.normal(size=(30, 3)) * 0.2)]
    own, fixed = Surfaces.of([Solid(shape, np.eye(4)) for shape in shapes]), Surfaces.of(drawn(rng))
    steps = np.linspace(0.0, 1.0, 200)[:, None]
    origins = np.array([2.0, -2.0, 0.5]) + steps * (-4.0, 1.0, 0.0)
    poses = np.stack([[turned(rng) for _ in range(20)] for _ in shapes]).repeat(10, axis=1)
    poses[..., :3, 3] += 0.1 * steps
    offsets, together = rng.uniform(-2, 2, 3) * (1.0 + 0.2 * steps) - origins, fixed.joined(own)

    def answers(order, mask):
        rays = np.where(mask, np.int8(2), np.int8(0))[order]
        asked = np.ascontiguousarray(rays)
        together.find_blocked(len(fixed), poses[:, order], origins[order], offsets[order], 0.2, asked)
        out = np.empty_like(asked)
        out[order] = asked
        return out

    everything, forwards = np.ones((200, 37), dtype=bool), np.arange(200)
    expected = answers(forwards, everything)
    np.testing.assert_array_equal(answers(rng.permutation(200), everything), expected)
    for mask in (
        rng.random((200, 37)) < 0.2,
        rng.random((200, 37)) < 0.9,
        np.arange(37) == rng.integers(37, size=(200, 1)),
    ):
        np.testing.assert_array_equal(answers(forwards, mask), np.where(mask, expected, 0))
    assert 0.1 < expected.mean() < 0.9


def test_nothing_blocks_rays_in_an_empty_world_from_within_the_ball_or_from_within_a_body():
    nothing, here, centre = Surfaces.of([]), np.array([[0.3, -0.2, 0.1]]), (1.0, 0.2, 0.0)
    assert nothing.blocked(nothing, STILL, here, centre, 0.1, 37) == 0.0
    around, before = np.eye(4), np.eye(4)
    around[:3, 3] = here[0]
    before[:3, 3] = here[0] + (0.3, 0.0, 0.0)
    wall = Surfaces.of([Solid(Box((0.1, 9.0, 9.0)), before)])
    assert wall.blocked(nothing, STILL, here, centre, 0.1, 37) == 1.0
    assert wall.blocked(nothing, STILL, here, centre, 0.9, 37) == 0.0  # the camera is in the ball
    hull = Hull(np.random.default_rng(2).normal(size=(40, 3)))
    for shape in (Box((0.4, 0.3, 0.2)), hull, Sphere(0.2), Cylinder(0.2, 0.4)):
        case = Surfaces.of([Solid(shape, around)])
        assert case.blocked(nothing, STILL, here, centre, 0.1, 37) == 0.0
        assert nothing.blocked(Surfaces.of([Solid(shape, np.eye(4))]), around[None, None], here, centre, 0.1, 37) == 0.0


def test_what_contains_the_origin_is_left_and_not_entered():
    eye = np.eye(4)
    shell = Surfaces.of([Solid(Sphere(1.0), eye), Solid(Box((1.0, 1.0, 1.0)), np.array(eye + np.eye(4, k=3) * 3.0))])
    assert shell.first_hits(np.zeros((1, 3)), np.array([[[1.0, 0, 0], [0, 1, 0]]]), REACH).tolist() == [[2.5, REACH]]


def test_nothing_is_hit_where_nothing_is():
    nothing = Surfaces.of([])
    assert nothing.first_hits(np.zeros((2, 3)), np.ones((2, 1, 3)), 5.0).tolist() == [[5.0], [5.0]]
    assert nothing.filled(np.zeros((2, 3)), 1.0, 50).tolist() == [0.0, 0.0]


def test_the_share_of_a_ball_beyond_a_wall_is_that_of_the_cap():
    """(r - d)² (2 r + d) / (4 r³), the cap of a ball of radius r beyond a wall at distance d."""
    wall = np.eye(4)
    wall[:3, :3] = Rotation.from_euler("xyz", [0.3, -0.4, 0.9]).as_matrix()
    normal = wall[:3, 0]
    wall[:3, 3] = 50.0 * normal
    bodies, r = Surfaces.of([Solid(Box((98.0, 900.0, 900.0)), wall)]), 2.0  # its face is 1 m away
    offsets = np.array([-2.0, -0.5, 0.0, 0.3, 0.8])
    expected = [(r - d) ** 2 * (2 * r + d) / (4 * r**3) if d < r else 0.0 for d in 1.0 - offsets]
    np.testing.assert_allclose(bodies.filled(offsets[:, None] * normal, r, 500), expected, atol=2e-3)


def test_what_two_bodies_fill_counts_once():
    can, ball = Solid(Cylinder(0.4, 0.6), np.eye(4)), Solid(Sphere(0.7), np.eye(4))
    share = Surfaces.of([can, ball, ball]).filled(np.zeros((1, 3)), 1.0, 50)[0]
    assert share == pytest.approx(0.7**3, rel=1e-12)  # the can is inside the ball


def test_poses_are_stacked_in_their_order_whether_they_are_rows_of_one_array_or_not():
    whole = np.random.default_rng(3).normal(size=(3, 5, 4, 4))
    rows = list(whole)
    for poses in (rows, rows[::-1], rows[:2], [rows[0]] * 3, [row.copy() for row in rows], list(whole[:, ::-1])):
        np.testing.assert_array_equal(stacked_poses(poses, 5), np.stack(poses))
    assert stacked_poses([], 5).shape == (0, 5, 4, 4)


def test_points_of_spirals_are_even():
    disc, sphere = over_disc(2000), over_sphere(2000)
    assert np.mean(np.hypot(*disc.T)) == pytest.approx(2 / 3, abs=1e-3)
    np.testing.assert_allclose(disc.mean(axis=0), 0.0, atol=2e-3)
    np.testing.assert_allclose(np.linalg.norm(sphere, axis=1), 1.0)
    np.testing.assert_allclose(sphere.T @ sphere / 2000, np.eye(3) / 3, atol=2e-3)
    view = over_sphere(500, 1.2, 0.6)
    assert (np.abs(np.arctan2(view[:, 1], view[:, 0])) < 0.6).all()
    assert (np.abs(np.arcsin(view[:, 2])) < 0.3).all()
    ahead = math.sin(0.6) / 0.6 * (0.3 + 0.5 * math.sin(0.6)) / (2 * math.sin(0.3))  # ∫∫ cos² over the view
    assert view.mean(axis=0) == pytest.approx([ahead, 0.0, 0.0], abs=2e-3)
