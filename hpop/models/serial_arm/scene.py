"""Convex bodies of an arm and its surroundings, as flat arrays for compiled kernels.

A body is stored as a Minkowski sum of three sets: the convex hull of points, a disc and a ball. A sphere is a point
plus a ball. A cylinder is the two ends of its axis plus a disc. Boxes and hulls have points only (radii 0). These are
exact, and one support function serves all shapes (:mod:`hpop.models.serial_arm.gjk`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.models.serial_arm.chain import ArmPart, Chain
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere


class Bodies(NamedTuple):
    """Arrays of B convex bodies, each in its own frame: Minkowski sums of a hull of points, a disc and a ball.

    points    (P, 3)     m, points of all bodies, body after body
    first     (B + 1,)   index of each body's first point, and P
    disc      (B,)       m, radius of the disc; 0 for none
    plane     (B, 2, 3)  two orthogonal unit vectors in the plane of the disc
    ball      (B,)       m, radius of the ball; 0 for none
    centre    (B, 3)     m, centre of the bounding sphere and of the bounding box
    reach     (B,)       m, radius of the bounding sphere
    box       (B, 4, 3)  bounding box: unit vectors of its three axes as rows, then its half sides, m
    """

    points: FloatArray
    first: IntArray
    disc: FloatArray
    plane: FloatArray
    ball: FloatArray
    centre: FloatArray
    reach: FloatArray
    box: FloatArray


class _Body(NamedTuple):
    """One convex body: the fields of :class:`Bodies` for a single solid; ``middle`` is its centre."""

    points: FloatArray
    disc: float
    ball: float
    box: FloatArray
    middle: FloatArray

    @property
    def reach(self) -> float:
        """Distance, m, of the body's farthest point from the centre of its bounding box."""
        if self.disc:  # a cylinder
            return float(np.hypot(self.box[3, 0], self.box[3, 2]))
        return float(np.linalg.norm(self.points - self.middle, axis=1).max() + self.ball)


def bodies_of(solids: Sequence[Solid], balls: Sequence[float] = ()) -> Bodies:
    """Return solids as convex bodies; each body is in the frame in which its solid's pose is given.

    balls  m, radii of balls by which the last ``len(balls)`` solids grow, in the order of the solids
    """
    added = [*(0.0 for _ in solids[len(balls) :]), *balls]
    bodies = [_body(solid, ball) for solid, ball in zip(solids, added, strict=True)]
    sizes = [len(body.points) for body in bodies]
    return Bodies(
        points=np.concatenate([np.zeros((0, 3)), *(body.points for body in bodies)]),
        first=np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)]).astype(np.int64),
        disc=np.array([body.disc for body in bodies], float),
        plane=np.array([body.box[:2] for body in bodies], float).reshape(-1, 2, 3),
        ball=np.array([body.ball for body in bodies], float),
        centre=np.array([body.middle for body in bodies], float).reshape(-1, 3),
        reach=np.array([body.reach for body in bodies], float),
        box=np.array([body.box for body in bodies], float).reshape(-1, 4, 3),
    )


def _body(solid: Solid, added: float) -> _Body:
    """Return a solid plus a ball (radius ``added``, m) as a convex body, with a bounding box along its shape's axes."""
    points, disc, ball = _parts(solid)
    ball += added
    rotation, shift = solid.pose[:3, :3], solid.pose[:3, 3]
    grown = np.array([disc, disc, 0.0]) + ball
    low, high = points.min(axis=0) - grown, points.max(axis=0) + grown
    return _Body(
        points=points @ rotation.T + shift,
        disc=disc,
        ball=ball,
        box=np.vstack([rotation.T, (high - low) / 2]),
        middle=rotation @ ((low + high) / 2) + shift,
    )


def _parts(solid: Solid) -> tuple[FloatArray, float, float]:
    """Return three sets whose Minkowski sum is a solid's shape: points (P, 3), radius of a disc, radius of a ball, m.

    The points are in the frame of the shape; the disc is perpendicular to its z axis.
    """
    match solid.shape:
        case Box(size=size):
            signs = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
            return signs * np.array(size), 0.0, 0.0
        case Cylinder(radius=radius, length=length):
            return np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]]), radius, 0.0
        case Sphere(radius=radius):
            return np.zeros((1, 3)), 0.0, radius
        case Hull(points=points):
            return np.asarray(points, float), 0.0, 0.0


class ArmScene(NamedTuple):
    """An arm of n joints and its surroundings, as arrays for kernels.

    origins  (n, 3, 4)  frame of each joint at value 0, in the frame before it; frames are turned so that z is the axis
    sliding  (n,)       True for prismatic joints
    bodies              B convex bodies, of the arm and the world, each in its frame
    frames   (B,)       frame of each body: 0 is fixed, frame i moves with joint i
    levers   (B, n)     m, upper bound on the distance of a body's points from the axis of each turning joint that
                        carries it, with slides between them at 0; 0 for other joints
    pairs    (P, 2)     pairs of bodies to be tested for collision; the body with the lower frame comes first
    """

    origins: FloatArray
    sliding: BoolArray
    bodies: Bodies
    frames: IntArray
    levers: FloatArray
    pairs: IntArray


def scene_of(
    chain: Chain, parts: Sequence[ArmPart], solids: Sequence[Solid], enlarged: Sequence[ArmPart] = ()
) -> ArmScene:
    """Return the arrays of an arm and its surroundings: bodies of parts, of the world's solids, of enlarged parts.

    The padding of an enlarged part is a ball to be added to its solid; that of other parts is ignored. Pairs to be
    tested are not set yet (:func:`paired`).
    """
    aligned = [np.eye(4), *map(along_z, chain.axes)]
    origins = np.array(
        [before.T @ origin @ after for before, origin, after in zip(aligned, chain.origins, aligned[1:], strict=False)]
    ).reshape(-1, 4, 4)
    frames = np.array(
        [*(part.frame for part in parts), *(0 for _ in solids), *(part.frame for part in enlarged)], np.int64
    )
    placed, larger = (
        [replace(part.solid, pose=aligned[part.frame].T @ part.solid.pose) for part in some]
        for some in (parts, enlarged)
    )
    bodies = bodies_of([*placed, *solids, *larger], [part.padding for part in enlarged])
    return ArmScene(
        origins=np.ascontiguousarray(origins[:, :3]),
        sliding=np.array(chain.sliding, np.bool_),
        bodies=bodies,
        frames=frames,
        levers=_levers(origins, bodies, frames),
        pairs=np.zeros((0, 2), np.int64),
    )


def paired(scene: ArmScene, pairs: Sequence[tuple[int, int]]) -> ArmScene:
    """Return the scene with these pairs of bodies to be tested, first those with most joints between their bodies.

    Pairs whose bodies are in the same frame are left out, because they never move relative to each other.
    """
    rows = [sorted(pair, key=lambda b: int(scene.frames[b])) for pair in pairs]
    rows = [row for row in rows if scene.frames[row[0]] != scene.frames[row[1]]]
    rows.sort(key=lambda row: int(scene.frames[row[0]] - scene.frames[row[1]]))
    return scene._replace(pairs=np.array(rows, np.int64).reshape(-1, 2))


def within_reach(scene: ArmScene, chain: Chain, near: float) -> BoolArray:
    """Return a matrix (B, B): whether body i can get within ``near`` m of body j; only valid if body j is fixed.

    It is False only if the joint limits and link lengths rule that out.
    """
    slides = np.where(chain.sliding, np.maximum(np.abs(chain.low), np.abs(chain.high)), 0.0)
    steps = np.append(slides[:1], np.linalg.norm(scene.origins[1:, :, 3], axis=1) + slides[1:])
    lengths = np.append(0.0, np.cumsum(steps))  # lengths[i]: from the origin of the first joint to that of frame i
    reach = lengths[scene.frames] + np.linalg.norm(scene.bodies.centre, axis=1) + scene.bodies.reach
    offs = scene.origins[0, :, 3] - scene.bodies.centre
    outside = np.abs(np.einsum("bij,bj->bi", scene.bodies.box[:, :3], offs)) - scene.bodies.box[:, 3]
    return np.asarray(np.linalg.norm(np.maximum(0.0, outside), axis=1) <= reach[:, None] + near)


def along_z(axis: FloatArray) -> FloatArray:
    """Return a rotation (4, 4) that turns the z axis to a given axis; the identity for the z axis itself."""
    if axis[2] == 1.0:
        return np.eye(4)
    other = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, other) / np.linalg.norm(np.cross(axis, other))
    rotation = np.eye(4)
    rotation[:3, :3] = np.column_stack([across, np.cross(axis, across), axis])
    return rotation


def _levers(origins: FloatArray, bodies: Bodies, frames: IntArray) -> FloatArray:
    """Return ``ArmScene.levers`` (B, n), m: bounds on the distances of a body's points from the joint axes.

    The distance of the next joint's origin from the axis is exact (its x and y); lengths of later links are added.
    """
    count = len(origins)
    offsets = origins[:, :3, 3]
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(offsets, axis=1))])  # lengths[k]: of offsets 0 to k - 1
    levers = np.zeros((frames.size, count))
    for b, frame in enumerate(frames.tolist()):
        points = bodies.points[bodies.first[b] : bodies.first[b + 1]]
        grown = bodies.disc[b] + bodies.ball[b]
        for k in range(frame - 1):
            between = lengths[frame] - lengths[k + 2]
            levers[b, k] = np.hypot(*offsets[k + 1, :2]) + between + np.linalg.norm(points, axis=1).max() + grown
        if frame:
            levers[b, frame - 1] = np.hypot(*points[:, :2].T).max() + grown
    return levers
