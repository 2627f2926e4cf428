"""Heading mismatch: the angle between the camera's view and its motion, as an integral and as a mean over time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import angle_between, is_symbolic, norm
from hpop.base.options import LEAST, MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions

PANELS = 16  # of each phase in place, where the speed passes ``slow`` within a few degrees


@dataclass(frozen=True)
class _Mismatch:
    """Angle between view and motion of the camera; below ``slow`` m/s it counts in proportion to the speed."""

    slow: float = 0.1  # m/s, below which the angle counts in proportion to the speed

    def __post_init__(self) -> None:
        set_reals(self, "slow", least=LEAST, most=MOST, kind="a speed in m/s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the angle (M,), rad s."""
        if m.camera.stays:
            return 0.0 * m.duration  # a camera that does not translate has no direction of motion

        def mismatch(s: Instants) -> Column:
            velocity = s.twist("camera").velocity
            counted = np.minimum(norm(velocity) / self.slow, 1.0)
            return counted * angle_between(s.camera.ahead, velocity)

        return _fine(m).integrate(mismatch)


def _fine(m: Motions) -> Motions:
    """Return motions with more quadrature panels if they turn in place, where the camera's speed has steep ramps."""
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
    motions. A head that looks down at the floor while driving has a cost, and so has a camera that a lift raises while
    it looks ahead (a right angle). Standing, turning about the camera, panning and tilting cost nothing. A turn moves a
    camera that is off the axis sideways, which counts. The integral is within .2 %, ramps included.

    Source: a user who looks in the direction of motion sees what comes, and unexpected vection is what best predicts
    sickness (studies of vection in virtual reality, read as abstracts). A view that is turned back while the base turns
    saves rotation (Suomalainen et al., HRI 2022) at the price of this angle. The definition is this project's own.
    """


@criterion("mean_heading_mismatch", group="C", unit="rad", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class MeanHeadingMismatch(_Mismatch):
    """Angle between the camera's view and its direction of motion, as a mean: (1/T) ∫ γ min(|v|/slow, 1) dt.

    It is :class:`HeadingMismatch`, which defines γ, divided by the whole duration T, with pauses. Unit rad; a mean over
    time.
    """

    @property
    def integral(self) -> HeadingMismatch:
        """Time integral, which searches minimise in place of the mean."""
        return HeadingMismatch(self.slow)
