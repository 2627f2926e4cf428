"""How fast what a camera sees moves on the sphere round it, by rays in space."""

from __future__ import annotations

import math

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.models.camera import FieldOfView
from hpop.motions import Instants, Rate
from hpop.world.geometry.rays_in_space import Surfaces, over_sphere, rows
from hpop.world.sight.bearings import REACH


def rays_of_view(view: FieldOfView, bearings: int) -> FloatArray:
    """Unit vectors (K, 3), ahead, left and up, evenly over what a camera sees, as far apart as so many bearings."""
    width, height = view
    spacing = 2.0 * math.pi / bearings
    return over_sphere(max(bearings, round(width * 2.0 * math.sin(0.5 * height) / spacing**2)), width, height)


def flow_in_space(surfaces: Surfaces, view: FloatArray, nearest: float, *, largest: bool) -> Rate:
    """Rate of the mean, or the largest, flow along the rays (K, 3) of a view, in the camera's frame."""

    def rate(s: Instants) -> FloatArray:
        pose, twist, size = s.camera, s.twist("camera"), s.state.size
        place, velocity, rotation, *axes = (
            rows(vector, size)
            for vector in ((pose.x, pose.y, pose.z), twist.velocity, twist.rotation, pose.ahead, pose.left, pose.up)
        )
        return surfaces.flow(place, np.stack(axes, axis=1), velocity, rotation, view, REACH, nearest, largest=largest)

    return rate
