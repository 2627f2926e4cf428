"""Differences of directions and orientations as angles, and how fast they change as a body moves and turns.

Both are the logarithm of the rotation that is left, whose derivative is known in closed form (Solà, Deray and Atchuthan
2018, arXiv 1812.01537); so a search that follows them is exact wherever it stops, not only where nothing is left.
"""

from __future__ import annotations

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import cross, dot, norm
from hpop.motions import Pose, Twist, Vector

ALIGNED = 1e-7  # rad: below, the sine of an angle is the angle to the last bit
LEAST = 1e-12  # m or rad: what is divided by is no less


def off_axis(pose: Pose, offset: Vector) -> tuple[Column, Column]:
    """Angles (M,), rad, by which an offset is to the left of a body's axis ahead and above it; their norm is all.

    What is straight behind is half a turn to the left.
    """
    ahead, left, up = (dot(axis, offset) for axis in (pose.ahead, pose.left, pose.up))
    sine = norm((left, up))
    left = np.where((sine < LEAST) & (ahead < 0.0), LEAST, left)
    sine = np.maximum(sine, LEAST)
    share = np.arctan2(sine, ahead) / sine
    return share * left, share * up


def off_axis_rates(pose: Pose, twist: Twist, offset: Vector, change: Vector) -> tuple[Column, Column]:
    """How fast these angles change, rad/s, as the offset changes by so much and the body turns."""
    length = np.maximum(norm(offset), LEAST)
    turned = _less(change, cross(twist.rotation, offset))
    ahead, left, up = (dot(axis, offset) / length for axis in (pose.ahead, pose.left, pose.up))
    growth = dot(offset, change) / length
    ahead_rate, left_rate, up_rate = (
        (dot(axis, turned) - part * growth) / length
        for axis, part in zip((pose.ahead, pose.left, pose.up), (ahead, left, up), strict=True)
    )
    sine = np.maximum(norm((left, up)), LEAST)
    sine_rate = (left * left_rate + up * up_rate) / sine
    some = sine > ALIGNED
    share = np.arctan2(sine, ahead) / sine
    share_rate = np.where(some, (ahead * sine_rate - sine * ahead_rate - share * sine_rate) / sine, 0.0)
    return share * left_rate + share_rate * left, share * up_rate + share_rate * up


def roll_of(pose: Pose) -> Column:
    """Angle (M,), rad, by which a body is rolled to the right; any where it looks straight up or down."""
    return np.arctan2(pose.left[2], pose.up[2])


def roll_rate(pose: Pose, twist: Twist) -> Column:
    """How fast that changes, rad/s."""
    left, up = pose.left[2], pose.up[2]
    left_rate, up_rate = (cross(twist.rotation, axis)[2] for axis in (pose.left, pose.up))
    return (up * left_rate - left * up_rate) / np.maximum(left * left + up * up, LEAST)


Axes = tuple[Vector, Vector, Vector]


def turn_to(pose: Pose, axes: Axes) -> Vector:
    """The rotation vector, rad, world frame, that takes a body to an orientation, given by its axes ahead, left, up.

    Of half a turn the length is right, and the axis x.
    """
    normal, sine, cosine = _turn(pose, axes)
    some = sine > ALIGNED
    share = np.where(some, np.arctan2(sine, cosine) / np.maximum(sine, LEAST), 1.0)
    return np.where(some | (cosine > 0.0), share * normal[0], np.pi), share * normal[1], share * normal[2]


def turn_to_rates(pose: Pose, twist: Twist, axes: Axes) -> Vector:
    """How fast it changes as the body turns, rad/s: the inverse of the right Jacobian of SO(3), times -ω."""
    vector = turn_to(pose, axes)
    _, sine, cosine = _turn(pose, axes)
    angle = np.maximum(np.arctan2(sine, cosine), LEAST)
    bend = 1.0 / angle**2 - (1.0 + cosine) / (2.0 * angle * np.maximum(sine, LEAST))
    bend = np.where(angle > 1e-3, bend, 1.0 / 12.0)  # its limit; nearer, the difference loses more than it is off
    once = cross(vector, twist.rotation)
    twice = cross(vector, once)
    x, y, z = (-w - 0.5 * a - bend * b for w, a, b in zip(twist.rotation, once, twice, strict=True))
    return x, y, z


def _turn(pose: Pose, axes: Axes) -> tuple[Vector, Column, Column]:
    """Axis of the rotation that is left, as long as its sine; its sine and its cosine."""
    own = (pose.ahead, pose.left, pose.up)
    normals = [cross(one, other) for one, other in zip(own, axes, strict=True)]
    normal = tuple(0.5 * sum(part) for part in zip(*normals, strict=True))
    trace = sum(dot(one, other) for one, other in zip(own, axes, strict=True))
    return (normal[0], normal[1], normal[2]), norm(normal), 0.5 * (trace - 1.0)


def _less(one: Vector, other: Vector) -> Vector:
    x, y, z = (a - b for a, b in zip(one, other, strict=True))
    return x, y, z
