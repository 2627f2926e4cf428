"""Criteria of comfort of viewers and passengers, and the sampled motion of a body that several of them use."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.motions import Pose
from hpop.trajectories.history import History


class BodyMotion(NamedTuple):
    """Motion of a body, such as the camera: sampled at regular times, in the body's own frame (ahead, left, up).

    times         (N,)    s, from 0 to the end of the trajectory
    step                  s, between two samples
    acceleration  (N, 3)  m/s²
    rotation      (N, 3)  rad/s, angular velocity of the body
    vertical      (N, 3)  unit vector that points up in the world

    It is computed from the executed motion, in which the robot speeds up and slows down.
    """

    times: FloatArray
    step: float
    acceleration: FloatArray
    rotation: FloatArray
    vertical: FloatArray


def body_at(m: History, body: str, times: FloatArray) -> tuple[Pose, FloatArray]:
    """Return a body's poses (N,) and positions (N, 3), m, in the executed motion at times (N,), s.

    Before the start and after the end of the trajectory the body stands still.
    """
    pose = m.model.pose(body, m.executed.at(times))
    return pose, np.stack([pose.x, pose.y, pose.z], axis=1)


def body_motion(m: History, body: str, longest: float) -> BodyMotion:
    """Return the motion of a body along a trajectory, sampled every ``longest`` seconds or more often.

    The acceleration is a central difference of the body's positions. While the robot speeds up or slows down, its
    path is a parabola in time, for which this is exact. Where that begins or ends, the sample is the mean over a step.
    The angular velocity follows from the rotation that turns the body's axes one step before into those one step
    after.
    """
    return m.once(("body motion", body, longest), lambda: _body_motion(m, body, longest))


def _body_motion(m: History, body: str, longest: float) -> BodyMotion:
    duration = m.executed.duration
    count = max(2, int(np.ceil(duration / longest - 1e-9)) + 1)
    step = float(duration / (count - 1)) if duration > 0 else longest
    times = np.arange(-1, count + 1, dtype=np.float64) * step
    pose, position = body_at(m, body, times)
    acceleration = np.diff(position, n=2, axis=0) / step**2  # world frame
    axes = [
        np.stack([np.broadcast_to(column, times.shape) for column in axis], axis=1)
        for axis in (pose.ahead, pose.left, pose.up)
    ]  # (N + 2, 3) each
    rotation = _rotations([axis[:-2] for axis in axes], [axis[2:] for axis in axes]) / (2 * step)  # world frame
    vertical = np.stack([axis[1:-1, 2] for axis in axes], axis=1)
    return BodyMotion(times[1:-1], step, _in_frame(axes, acceleration), _in_frame(axes, rotation), vertical)


def _in_frame(axes: list[FloatArray], vectors: FloatArray) -> FloatArray:
    """Return the components (N, 3) of vectors (N, 3) along three axes.

    Each axis (N + 2, 3) has one more sample at each end, which is not used.
    """
    return np.stack([np.sum(vectors * axis[1:-1], axis=1) for axis in axes], axis=1)


def _rotations(before: list[FloatArray], after: list[FloatArray]) -> FloatArray:
    """Return the rotation vectors (N, 3), rad, that turn the axes ``before`` into the axes ``after``.

    Each of the two lists holds the unit vectors ahead, left and up, as arrays (N, 3).

    Rotations must be less than half a turn. For a rotation by the angle γ, half the sum of the cross products of the
    axes has the length sin γ, and the sum of their dot products is 1 + 2 cos γ.
    """
    pairs = list(zip(before, after, strict=True))
    normal = 0.5 * sum(np.cross(a, b) for a, b in pairs)
    sine, cosine = np.linalg.norm(normal, axis=1), 0.5 * (sum(np.sum(a * b, axis=1) for a, b in pairs) - 1.0)
    turns = sine > 0.0
    scale = np.where(turns, np.arctan2(sine, cosine) / np.where(turns, sine, 1.0), 1.0)
    rotations: FloatArray = normal * scale[:, None]
    return rotations
