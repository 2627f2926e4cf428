"""Heading mismatch: whether a user looks where she is driven, as an integral that adds up and as a mean over time."""

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
    """A user who looks ahead through the camera; below ``slow`` m/s a motion counts in proportion to its speed."""

    slow: float = 0.1  # m/s, below which a motion counts in proportion to its speed

    def __post_init__(self) -> None:
        set_reals(self, "slow", least=LEAST, most=MOST, kind="a speed in m/s", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Time integral (M,) of the angle, rad s."""
        if m.camera.stays:
            return 0.0 * m.duration  # what stays in its place moves in no direction

        def mismatch(s: Instants) -> Column:
            velocity = s.twist("camera").velocity
            counted = np.minimum(norm(velocity) / self.slow, 1.0)
            return counted * angle_between(s.camera.ahead, velocity)

        return _fine(m).integrate(mismatch)


def _fine(m: Motions) -> Motions:
    """Return motions with enough panels for ramps of turns that swing the camera round."""
    if not m.whole or m.panels is not None or m.law.quadrature == "adaptive" or {"x", "y"} & m.law.varies:
        return m
    if any(is_symbolic(getattr(m.start, name)) for name in m.start.names):
        return m
    return replace(m, panels=PANELS)


@criterion("heading_mismatch", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class HeadingMismatch(_Mismatch):
    """∫ γ min(|v|/slow, 1) dt, γ the angle between the camera's view and its velocity v, while the camera moves.

    slow  m/s  a motion slower than this counts in proportion to its speed: at rest there is no direction to look in

    Who looks where she is driven sees what comes, and vection that one does not foresee is what predicts sickness best
    (studies of vection in virtual reality, by their abstracts). A view turned back as the base turns spares rotation
    (Suomalainen et al., HRI 2022) and is paid for by this angle. The measure itself is this project's definition.

    γ is the angle in space between the camera's axis ahead and the velocity of the camera itself: a head that looks
    down at the floor while it drives does not look where it goes either, a lift that looks ahead is off by a right
    angle, and an arm has no base to ask. Who stands, turns about the camera, pans or tilts has nothing to look at on
    the way, and pays nothing; a camera off the axis that a turn swings round does move, sideways, and counts.
    That is within .2 % of the integral, ramps included.
    """


@criterion("mean_heading_mismatch", group="C", unit="rad", aggregate="time-mean", requires=("camera",))
@dataclass(frozen=True)
class MeanHeadingMismatch(_Mismatch):
    """(1/T) ∫ γ min(|v|/slow, 1) dt, rad: :class:`HeadingMismatch` over the whole duration, what stands included."""

    @property
    def integral(self) -> HeadingMismatch:
        """Integral of the mismatch, which adds up along a path."""
        return HeadingMismatch(self.slow)
