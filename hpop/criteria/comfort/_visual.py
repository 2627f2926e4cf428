"""What a user who looks through the camera sees herself do: the visual motion, in the camera's frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.history import History
from hpop.motions import Pose


class VisualMotion(NamedTuple):
    """Executed motion of the camera at regular times, in its own frame: ahead, left, up.

    times         (N,)    s, from 0 to the end
    step          s, between them
    acceleration  (N, 3)  m/s²
    rotation      (N, 3)  rad/s
    """

    times: FloatArray
    step: float
    acceleration: FloatArray
    rotation: FloatArray


def camera_at(m: History, times: FloatArray) -> tuple[Pose, FloatArray]:
    """Camera poses (N,) and positions (N, 3), m, of what is executed; before the start and after the end it stands."""
    pose = m.model.pose("camera", m.executed.at(times))
    return pose, np.stack([pose.x, pose.y, pose.z], axis=1)


def visual_motion(m: History, longest: float) -> VisualMotion:
    """Sample every ``longest`` seconds at most, by central differences of the camera's positions and angles.

    Executed ramps are parabolas, of which these are exact; where a ramp begins or ends the sample is the mean over a
    step. Yaw turns about the vertical, pitch about the camera's left, roll about its view.
    """
    duration = m.executed.duration
    count = max(2, int(np.ceil(duration / longest - 1e-9)) + 1)
    step = float(duration / (count - 1)) if duration > 0 else longest
    times = np.arange(-1, count + 1, dtype=np.float64) * step
    pose, position = camera_at(m, times)
    acceleration = np.diff(position, n=2, axis=0) / step**2  # world frame
    axes = [
        np.stack([np.broadcast_to(column, times.shape)[1:-1] for column in axis], axis=1)
        for axis in (pose.ahead, pose.left, pose.up)
    ]  # (N, 3) each
    yaw, pitch, roll = (np.unwrap(angle) for angle in (pose.yaw, pose.pitch, pose.roll))
    turn_rate, tilt_rate, roll_rate = ((angle[2:] - angle[:-2]) / (2 * step) for angle in (yaw, pitch, roll))
    rotation = np.stack([turn_rate * axis[:, 2] for axis in axes], axis=1)
    rotation[:, 0] += roll_rate
    rotation[:, 1] -= tilt_rate * np.cos(roll[1:-1])
    rotation[:, 2] += tilt_rate * np.sin(roll[1:-1])
    seen = np.stack([np.sum(acceleration * axis, axis=1) for axis in axes], axis=1)
    return VisualMotion(times[1:-1], step, seen, rotation)
