"""Visibility and openness for a camera of changing height, by rays against solids in space.

:mod:`hpop.world.sight.visibility`, in contrast, samples fields at one height. Here each line of sight is tested, so
that the borders of shadows and of the view are sharp, and the view tilts and rolls with the camera. In both modules the
body that contains a landmark does not hide it, and floor and ceiling hide nothing.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.world.content.content import Landmark
from hpop.world.geometry.rays_in_space import over_sphere, rows, surfaces_of
from hpop.world.sight.bearings import ALL_ROUND, UP_AND_DOWN, is_whole
from hpop.world.sight.visibility import RAYS

if TYPE_CHECKING:
    from hpop.motions import Pose
    from hpop.world.world import World


def landmarks_unseen(
    world: World, pose: Pose, size: int, *, near: float, far: float, fov: Column, vertical: Column
) -> FloatArray:
    """Return the unseen share (N,) of the landmarks, in [0, 1]: 1 - their weighted mean visibility.

    In contrast to :func:`hpop.world.sight.visibility.landmarks_unseen`, the height of the camera may change, each line
    of sight is tested against solids, and the view rolls with the camera.

    size           number N of poses
    near, far      m: a landmark counts in full up to ``near``, then linearly less, and not at all beyond ``far``
    fov, vertical  rad, horizontal and vertical angles of view
    """
    landmarks = world.content.landmarks
    seen, total = np.zeros(size), 0.0
    for landmark in landmarks:
        offset = _from_landmark(pose, landmark, size)
        distance = np.linalg.norm(offset, axis=1)
        value = _in_front(offset, landmark) * np.clip((far - distance) / (far - near), 0.0, 1.0)
        value = value * in_view(pose, landmark, size, fov, vertical)
        near_enough = np.flatnonzero(value > 0.0)
        seen[near_enough] += landmark.weight * value[near_enough] * _free(world, landmark, offset[near_enough])
        total += landmark.weight
    return np.asarray(np.clip(1.0 - seen / total, 0.0, 1.0))


def sees(world: World, pose: Pose, landmark: Landmark, size: int, *, far: float) -> FloatArray:
    """Return 1 (N,) for camera poses in front of a landmark, within ``far`` m, with a free line to it, else 0.

    The camera may look in any direction; :func:`in_view` tests its view. ``size`` is the number N of poses.
    """
    offset = _from_landmark(pose, landmark, size)
    close = (np.linalg.norm(offset, axis=1) <= far) & (_in_front(offset, landmark) > 0.0)
    seen = np.zeros(size)
    seen[close] = _free(world, landmark, offset[close])
    return seen


def in_view(pose: Pose, landmark: Landmark, size: int, fov: Column, vertical: Column) -> FloatArray:
    """Return 1 (N,) where a landmark is within the angles of view, rad, about the axes of the camera, else 0.

    Obstacles are ignored. ``size`` is the number N of poses.
    """
    offset = -_from_landmark(pose, landmark, size)
    along, aside, above = (np.sum(offset * rows(axis, size), axis=1) for axis in (pose.ahead, pose.left, pose.up))
    inside = np.ones(size, dtype=bool)
    if not is_whole(fov, ALL_ROUND):
        inside &= np.abs(np.arctan2(aside, along)) <= 0.5 * fov
    if not is_whole(vertical, UP_AND_DOWN):
        inside &= np.abs(np.arctan2(above, np.hypot(along, aside))) <= 0.5 * vertical
    return inside.astype(np.float64)


def openness(world: World, pose: Pose, size: int, radius: float) -> FloatArray:
    """Return the fraction (N,), 0 to 1, of a horizontal disc around each camera that obstacles do not hide.

    An obstacle that contains a camera hides nothing from it.

    pose    poses of the N cameras, m and rad
    size    number N of cameras
    radius  m, radius of the disc
    """
    directions = over_sphere(RAYS, height=0.0)
    place = rows((pose.x, pose.y, pose.z), size)
    distances = surfaces_of(world).first_hits(place, np.broadcast_to(directions, (size, *directions.shape)), radius)
    return np.asarray(np.mean((distances / radius) ** 2, axis=1))


def _from_landmark(pose: Pose, landmark: Landmark, size: int) -> FloatArray:
    """Return the offset from a landmark to the camera (N, 3), m."""
    return rows((pose.x - landmark.x, pose.y - landmark.y, pose.z - landmark.z), size)


def _in_front(offset: FloatArray, landmark: Landmark) -> FloatArray:
    """Return the cosine (N,), at least 0, of the plane angle between a landmark's front and the offset to the camera.

    Offsets are (N, 3), m. The cosine is 1 for a landmark without a front.
    """
    if landmark.facing is None:
        return np.ones(len(offset))
    flat = np.hypot(offset[:, 0], offset[:, 1])
    along = offset[:, 0] * math.cos(landmark.facing) + offset[:, 1] * math.sin(landmark.facing)
    return np.where(flat > 0, np.clip(along / np.where(flat > 0, flat, 1.0), 0.0, 1.0), 1.0)


def _free(world: World, landmark: Landmark, offset: FloatArray) -> FloatArray:
    """Return 1 (N,) where the line from a landmark to the camera, an offset (N, 3), m, enters no obstacle, else 0."""
    distance = np.linalg.norm(offset, axis=1)
    some = distance > 0.0
    directions = offset / np.where(some, distance, 1.0)[:, None]
    places = np.broadcast_to([landmark.x, landmark.y, landmark.z], offset.shape)
    reach = float(distance.max(initial=0.0)) + 1.0
    hits = surfaces_of(world).first_hits(places, directions[:, None], reach)[:, 0]
    return np.where(some & (hits < distance), 0.0, 1.0)
