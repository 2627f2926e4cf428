"""What a user who looks through the camera sees herself do: the visual motion, in the camera's frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.arrays import FloatArray
from hpop.history import History
from hpop.motions import Pose


class VisualMotion(NamedTuple):
    """Executed motion of the camera at regular times, seen along its heading; pitch is not applied.

    times         (N,)    s, from 0 to the end
    step          s, between them
    acceleration  (N, 3)  m/s², ahead, left, up
    turn_rate     (N,)    rad/s, about the vertical, counter-clockwise
    tilt_rate     (N,)    rad/s, upwards
    """

    times: FloatArray
    step: float
    acceleration: FloatArray
    turn_rate: FloatArray
    tilt_rate: FloatArray


def camera_at(m: History, times: FloatArray) -> tuple[Pose, FloatArray]:
    """Camera poses (N,) and positions (N, 3), m, of what is executed; before the start and after the end it stands."""
    pose = m.model.pose("camera", m.executed.at(times))
    return pose, np.stack([pose.x, pose.y, pose.z], axis=1)


def visual_motion(m: History, longest: float) -> VisualMotion:
    """Sample every ``longest`` seconds at most, by central differences of the camera's positions and yaw.

    Executed ramps are parabolas, of which these are exact; where a ramp begins or ends the sample is the mean over a
    step.
    """
    duration = m.executed.duration
    count = max(2, int(np.ceil(duration / longest - 1e-9)) + 1)
    step = float(duration / (count - 1)) if duration > 0 else longest
    times = np.arange(-1, count + 1, dtype=np.float64) * step
    pose, position = camera_at(m, times)
    acceleration = np.diff(position, n=2, axis=0) / step**2  # world frame
    cos, sin = np.cos(pose.yaw[1:-1]), np.sin(pose.yaw[1:-1])
    ahead = cos * acceleration[:, 0] + sin * acceleration[:, 1]
    left = cos * acceleration[:, 1] - sin * acceleration[:, 0]
    turn_rate, tilt_rate = ((angle[2:] - angle[:-2]) / (2 * step) for angle in (pose.yaw, pose.pitch))
    return VisualMotion(times[1:-1], step, np.stack([ahead, left, acceleration[:, 2]], axis=1), turn_rate, tilt_rate)
