"""Excess of the camera's angular acceleration over the threshold of the semicircular canals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hinge, norm
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Motions

FELT = float(np.deg2rad(1.0))  # rad/s², threshold of perception; see AngularAcceleration


@criterion("angular_acceleration", group="C", unit="rad/s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class AngularAcceleration:
    """Angular acceleration of the camera above the threshold of perception: ∫ (|α| - α_th)₊ dt.

    threshold  α_th, rad/s²; 1 deg/s² by default

    A seated user sees this acceleration, but does not feel it: the semicircular canals, which would perceive it in a
    real turn, report nothing. Unit rad/s; a sum over motions. A turn from rest to rest that reaches the turn rate ω
    costs 2 ω (1 - α_th/α), so few and gentle turns are cheap.

    Source of the threshold: Grabherr et al. 2008 measured yaw thresholds as the peak velocity v of one cycle of
    sinusoidal acceleration at frequency f, with the peak acceleration π f v: 0.51 deg/s² for the 0.71 deg/s at 0.23 Hz
    where the plateau begins, 0.44 deg/s² for the 2.8 deg/s at 0.05 Hz. The default, twice that, is this project's
    choice.

    The cost is exact for cameras on a base or a pan-tilt head, because α is then constant within each phase of a motion
    and along each curve. For an arm, whose joints turn one another's axes, it is integrated numerically.
    """

    threshold: float = FELT

    def __post_init__(self) -> None:
        set_reals(self, "threshold", least=0, most=MOST, kind="an angular acceleration in rad/s²", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the time integral (M,), rad/s, of the excess of the angular acceleration over the threshold."""
        return m.integrate(lambda s: hinge(norm(s.twist_rate("camera").rotation) - self.threshold))
