"""Convex bodies as triangles: what the ride draws of solids that are not upright, and of a robot's own links."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from hpop.base.arrays import FloatArray, IntArray
from hpop.motions import Model, States
from hpop.trajectories.poses import on_one_side, quaternions_of
from hpop.view.ride.scene import Scene
from hpop.view.ride.surfaces import Colour
from hpop.world.geometry.solids import Shape, Sphere

LINKS: tuple[Colour, ...] = ((206, 208, 210), (120, 128, 138))
"""Of the links of a robot, in turns."""
DIRECTIONS = 120
"""Points on a sphere."""
DIGITS = 4
"""Of coordinates, m: tenths of millimetres."""


class Body(NamedTuple):
    """Triangles of a convex body.

    points     (V, 3)  m
    triangles  (T, 3)  corners, counter-clockwise as seen from outside
    """

    points: FloatArray
    triangles: IntArray

    def description(self, number: int, colour: Colour) -> dict[str, Any]:
        """As JSON."""
        return {
            "points": np.round(self.points, DIGITS).tolist(),
            "triangles": self.triangles.tolist(),
            "number": number,
            "colour": list(colour),
        }


def body_of(shape: Shape, pose: FloatArray | None = None) -> Body:
    """The triangles of a shape, placed by a pose (4, 4), where one is given.

    >>> from hpop.world.geometry.solids import Box
    >>> len(body_of(Box((1.0, 2.0, 3.0))).triangles)
    12
    """
    points = _on_sphere(shape.radius) if isinstance(shape, Sphere) else np.asarray(shape.corners)
    if pose is not None:
        points = points @ pose[:3, :3].T + pose[:3, 3]
    hull = ConvexHull(points)
    kept = np.unique(hull.simplices)
    triangles = np.searchsorted(kept, hull.simplices)
    points = points[kept]
    a, b, c = (points[triangles[:, k]] for k in range(3))
    inwards = np.einsum("ti,ti->t", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return Body(points, triangles)


def tilted_solids(scene: Scene) -> list[dict[str, Any]]:
    """As JSON, the solids of a scene of which its prisms are only the upright hull."""
    return [
        body_of(prism.solid.shape, prism.solid.pose).description(prism.number, prism.colour)
        for prism in scene.prisms
        if prism.solid is not None
    ]


def links_of(model: Model, states: States) -> list[dict[str, Any]]:
    """As JSON, the shapes of a robot's links, each in its own frame; none of a robot that says of none."""
    placed = model.bodies(states.take(slice(0, 1)))
    return [body_of(shape).description(0, LINKS[i % len(LINKS)]) for i, (shape, _) in enumerate(placed)]


def link_poses(model: Model, states: States) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Where each link is in each of N states: positions (N, 3), m, and quaternions (N, 4), x, y, z, w."""
    for _, poses in model.bodies(states):
        all_of_them = np.broadcast_to(poses, (states.size, 4, 4))
        yield all_of_them[:, :3, 3], on_one_side(quaternions_of(all_of_them[:, :3, :3]))


def _on_sphere(radius: float) -> FloatArray:
    """Points (DIRECTIONS, 3), m, spread evenly over a sphere, along a spiral."""
    k = np.arange(DIRECTIONS) + 0.5
    up = 1.0 - 2.0 * k / DIRECTIONS
    turned = math.pi * (1.0 + math.sqrt(5.0)) * k
    wide = np.sqrt(1.0 - up * up)
    return radius * np.stack([wide * np.cos(turned), wide * np.sin(turned), up], axis=1)
