"""Convex bodies as flat arrays: what the kernels of :mod:`hpop.models.collision.gjk` measure distances between.

A body is a Minkowski sum: the hull of points, a disc and a ball. A sphere is a point and a ball, a cylinder the two
ends of its axis and a disc, exactly; the disc of a box or a hull has no radius. So one support function serves all
shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.world.geometry.solids import Box, Cylinder, Hull, Solid, Sphere


class Bodies(NamedTuple):
    """B convex bodies, each in a frame of its own.

    points    (P, 3)     m, those of all bodies, one body's after another's
    first     (B + 1,)   where those of each body begin
    disc      (B,)       m, radius of the disc
    plane     (B, 2, 3)  unit vectors in the plane of the disc, one across the other
    ball      (B,)       m, radius of the ball
    centre    (B, 3)     of a sphere round each body
    reach     (B,)       m, its radius
    box       (B, 4, 3)  a box round each body: its three axes, rows, and its half sides, m, about the centre
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
    points: FloatArray
    disc: float
    ball: float
    box: FloatArray
    middle: FloatArray

    @property
    def reach(self) -> float:
        """Distance of its farthest point from the middle of its box."""
        if self.disc:  # a cylinder
            return float(np.hypot(self.box[3, 0], self.box[3, 2]))
        return float(np.linalg.norm(self.points - self.middle, axis=1).max() + self.ball)


def bodies_of(solids: Sequence[Solid]) -> Bodies:
    """The solids, each in the frame in which its pose is given."""
    bodies = [_body(solid) for solid in solids]
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


def _body(solid: Solid) -> _Body:
    """One of them: points and the box round it in axes of the shape, then placed."""
    points, disc, ball = _parts(solid)
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
    """Points in the shape's own frame, and the radii of disc and ball."""
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
