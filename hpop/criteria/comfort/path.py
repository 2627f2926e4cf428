"""Paths of base and camera: their lengths, and the angle between the directions of view and of motion.

The angle (heading mismatch) makes two criteria: its integral over time and its mean over time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import angle_between, hypot, is_symbolic, norm
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.convex import ConvexCost, ConvexPath
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, States


@criterion(
    "length",
    group="C",
    unit="m",
    aggregate="sum",
    requires=("base",),
    role="length",
    instead=("camera_length", "joint_length"),
)
@dataclass(frozen=True)
class Length:
    """Length of the base's path: D = ∫ sqrt(x'² + y'²) dt.

    Unit m; a sum over motions. Source: Becerra et al. 2020 (arXiv 2002.10696), who count it as comfort because a short
    path shortens the exposure to virtual reality.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.base.length

    def bound(self, start: States, goal: States) -> Column:
        """Return a lower bound (M,), m, on the length of any trajectory between two states: their distance."""
        return hypot(goal.x - start.x, goal.y - start.y)

    def convex(self, path: ConvexPath) -> ConvexCost:
        """Return the length of a polyline as a convex expression of cvxpy."""
        return ConvexCost(path.length, exact=True)


@criterion("camera_length", group="C", unit="m", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraLength:
    """Length of the camera's path in space: ∫ |v| dt.

    Unit m; a sum over motions. It is for the camera what ``length`` is for the base: a short path shortens the exposure
    to virtual reality (Becerra et al. 2020, arXiv 2002.10696). The two differ if the camera is on an arm, or away from
    the axis of its base, so that turns in place move it too.
    """

    def cost(self, m: Motions) -> Column:
        """Return the path length (M,), m."""
        return m.camera.length


PANELS = 16  # quadrature intervals in each phase of a turn in place; within a few degrees its speed passes ``slow``


@dataclass(frozen=True)
class _Mismatch:
    """Angle between the camera's view and its motion; below ``slow`` m/s it counts in proportion to the speed."""

    slow: float = 0.1  # m/s, below which the angle counts in proportion to the speed

    def __post_init__(self) -> None:
        set_reals(self, "slow", least=LEAST, most=MOST, kind="a speed in m/s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        if m.camera.stays:
            return 0.0 * m.duration  # a camera whose position does not change has no direction of motion

        def mismatch(s: Instants) -> Column:
            velocity = s.twist("camera").velocity
            counted = np.minimum(norm(velocity) / self.slow, 1.0)
            return counted * angle_between(s.camera.ahead, velocity)

        return _fine(m).integrate(mismatch)


def _fine(m: Motions) -> Motions:
    """Return motions with more quadrature intervals if they turn in place, where the camera's speed changes fast."""
    if not m.whole or m.panels is not None or m.law.quadrature == "adaptive" or {"x", "y"} & m.law.varies:
        return m
    if any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
        return m
    return replace(m, panels=PANELS)


@criterion("heading_mismatch", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class HeadingMismatch(_Mismatch):
    """Angle between the camera's view and its direction of motion, over time: ∫ γ min(|v|/slow, 1) dt.

    slow  m/s  below this speed the angle counts in proportion to the speed, since at rest there is no direction of
               motion

    γ is the angle in space between the camera's axis ahead and the velocity v of the camera. Unit rad s; a sum over
    motions. A camera that looks down at the floor while driving has a cost. So has a camera that a lift raises while it
    looks ahead (γ is then a right angle). Standing, turning about the camera, panning and tilting cost nothing. A turn
    of the base moves a camera that is not on the axis sideways, which has a cost. The integral is accurate to 0.2 %.

    Source: a user who looks in the direction of motion sees what comes, and unexpected vection best predicts sickness
    (studies of vection in virtual reality, of which only abstracts were read). A view that is turned back while the
    base turns saves rotation (Suomalainen et al., HRI 2022) but has this angle. The definition is this project's own.
    """


@criterion("mean_heading_mismatch", group="C", unit="rad", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class MeanHeadingMismatch(_Mismatch):
    """Angle between the camera's view and its direction of motion, as a mean: (1/T) ∫ γ min(|v|/slow, 1) dt.

    It is the integral of :class:`HeadingMismatch`, which defines γ, divided by the whole duration T, pauses included.
    Unit rad; a mean over time.
    """

    @property
    def integral(self) -> HeadingMismatch:
        """The criterion that searches minimise in place of the mean: its time integral."""
        return HeadingMismatch(self.slow)
