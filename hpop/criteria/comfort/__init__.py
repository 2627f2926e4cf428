"""Criteria of comfort, and the visual motion that several of them read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.motions import Pose
from hpop.trajectories.history import History


class VisualMotion(NamedTuple):
    """Executed motion of the camera at regular times, in the camera's own frame: ahead, left, up.

    times         (N,)    s, from 0 to the end
    step          s, between times
    acceleration  (N, 3)  m/s²
    rotation      (N, 3)  rad/s
    """

    times: FloatArray
    step: float
    acceleration: FloatArray
    rotation: FloatArray


def camera_at(m: History, times: FloatArray) -> tuple[Pose, FloatArray]:
    """Return executed poses (N,) and positions (N, 3), m, of the camera, which stands still outside the drive."""
    pose = m.model.pose("camera", m.executed.at(times))
    return pose, np.stack([pose.x, pose.y, pose.z], axis=1)


def visual_motion(m: History, longest: float) -> VisualMotion:
    """Return the visual motion sampled every ``longest`` seconds or more often.

    Derivatives are central differences of the camera's positions and axes. Executed ramps are parabolas, for which
    these are exact; where a ramp begins or ends the sample is the mean over a step. The rotation is the one that takes
    the axes one step before to those one step after, about any axis.
    """
    return m.once(("visual motion", longest), lambda: _visual_motion(m, longest))


def _visual_motion(m: History, longest: float) -> VisualMotion:
    duration = m.executed.duration
    count = max(2, int(np.ceil(duration / longest - 1e-9)) + 1)
    step = float(duration / (count - 1)) if duration > 0 else longest
    times = np.arange(-1, count + 1, dtype=np.float64) * step
    pose, position = camera_at(m, times)
    acceleration = np.diff(position, n=2, axis=0) / step**2  # world frame
    axes = [
        np.stack([np.broadcast_to(column, times.shape) for column in axis], axis=1)
        for axis in (pose.ahead, pose.left, pose.up)
    ]  # (N + 2, 3) each
    rotation = _rotations([axis[:-2] for axis in axes], [axis[2:] for axis in axes]) / (2 * step)  # world frame
    return VisualMotion(times[1:-1], step, _in_frame(axes, acceleration), _in_frame(axes, rotation))


def _in_frame(axes: list[FloatArray], vectors: FloatArray) -> FloatArray:
    """Return the components (N, 3) of vectors along three axes; axes (N + 2, 3) have a further sample at both ends."""
    return np.stack([np.sum(vectors * axis[1:-1], axis=1) for axis in axes], axis=1)


def _rotations(before: list[FloatArray], after: list[FloatArray]) -> FloatArray:
    """Return rotation vectors (N, 3), rad, less than half a turn long, between two sets of axes.

    Half the sum of the axes' cross products has the length of the sine; the sum of their dot products is 1 + 2 cosines.
    """
    pairs = list(zip(before, after, strict=True))
    normal = 0.5 * sum(np.cross(a, b) for a, b in pairs)
    sine, cosine = np.linalg.norm(normal, axis=1), 0.5 * (sum(np.sum(a * b, axis=1) for a, b in pairs) - 1.0)
    turns = sine > 0.0
    scale = np.where(turns, np.arctan2(sine, cosine) / np.where(turns, sine, 1.0), 1.0)
    rotations: FloatArray = normal * scale[:, None]
    return rotations
