"""Where things are in a camera's view: bearings off its yaw, elevations, and what is within its angles of view."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hypot, smooth_abs, smooth_step
from hpop.world.content.content import Landmark

if TYPE_CHECKING:
    from hpop.motions import Pose

ALL_ROUND = 2 * math.pi - 1e-3
"""Angles of view from here on, rad, are all round: 6.283 is meant for 2 pi."""
BEHIND = -2.0
"""Cosine of half an angle of view that is all round: none is less, whatever the rounding."""
UP_AND_DOWN = math.pi - 1e-3
"""Vertical angles of view from here on, rad, hold all from straight down to straight up."""


def bearing(pose: Pose, x: float, y: float) -> Column:
    """Angle (M,), rad in (-pi, pi], by which a point is to the left of the camera's yaw; 0 where the camera is."""
    dx, dy, ahead, left = x - pose.x, y - pose.y, np.cos(pose.yaw), np.sin(pose.yaw)
    apart = dx * dx + dy * dy > 0
    along, aside = ahead * dx + left * dy, ahead * dy - left * dx
    return np.arctan2(np.where(apart, aside, 0.0), np.where(apart, along, 1.0))


def elevation(pose: Pose, x: float, y: float, z: float) -> Column:
    """Angle (M,), rad in [-pi/2, pi/2], by which a point is above the camera's height; 0 where the camera is."""
    dx, dy, rise = x - pose.x, y - pose.y, z - pose.z
    flat = hypot(dx, dy)
    return np.arctan2(rise, np.where(flat + np.abs(rise) > 0, flat, 1.0))


def in_view(pose: Pose, landmark: Landmark, fov: float, vertical: float) -> Column:
    """1 (M,) where a landmark is within the angles of view, rad, about the camera's yaw and pitch, else 0.

    On symbols these edges are smoothed.
    """
    inside: Column = 1.0
    if fov < ALL_ROUND:
        inside = smooth_step(0.5 * fov - smooth_abs(bearing(pose, landmark.x, landmark.y)))
    if vertical < UP_AND_DOWN:
        above = elevation(pose, landmark.x, landmark.y, landmark.z) - pose.pitch
        inside = smooth_step(0.5 * vertical - smooth_abs(above)) * inside
    return inside
