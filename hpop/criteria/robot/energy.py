"""Energy that the drive motors of a differential drive take."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import cast

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import hinge, is_symbolic
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions, Wheeled


@criterion("energy", group="R", unit="J", aggregate="sum", requires=("wheels",), instead=("joint_energy",))
@dataclass(frozen=True)
class Energy:
    """∫ P dt over both wheels, P = (c1 a² + c2 v² + c3 v + c4 + c5 a + c6 v a)₊ for a wheel at speed v, acceleration a.

    Tokekar, Karnad and Isler, "Energy-optimal trajectory planning for car-like robots", Autonomous Robots 37, 2014: the
    power of a direct-current motor. The wheels of a base with wheel base b have speeds v ± ω b/2 and accelerations
    a ± α b/2.

    The constants belong to one robot and are calibrated on it. The defaults are placeholders of a plausible size for
    30 kg on two wheels (c6 is the mass a wheel carries over an efficiency of 0.75), from no measurement: good for
    comparing trajectories, not for saying how long a battery lasts.

    Deviations: a wheel may turn backwards, and then takes what it takes forwards: c3 |v| and c5 a sign(v). Power that
    braking would give back is lost, so P counts where it is positive only. Planned moves are at cruise speed all
    along: speeding up and braking are in the executed cost only, which stands beside the planned one.
    """

    c1: float = 1.0  # W s⁴/m²
    c2: float = 2.0  # W s²/m²
    c3: float = 5.0  # W s/m
    c4: float = 2.0  # W, standing
    c5: float = 1.0  # W s²/m
    c6: float = 20.0  # W s³/m², or kg

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        set_reals(self, *names, least=0, most=MOST, kind="a number", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Energy (M,), J."""
        half = 0.5 * cast(Wheeled, m.model).wheel_base

        def power(s: Instants) -> Column:
            v, a, turn, change = s.speed, s.acceleration, half * s.turn_rate, half * s.turn_acceleration
            return self._wheel(v - turn, a - change) + self._wheel(v + turn, a + change)

        if not m.whole or m.law.varies != {"yaw"} or is_symbolic(m.base.rotation):
            return m.integrate(power)
        # Turns in place differ in their angles only, and a graph has many turns of few angles.
        _, first, place = np.unique(m.base.turned, return_index=True, return_inverse=True)
        different = replace(m, start=m.start.take(first), end=m.end.take(first), t0=None)
        return different.integrate(power)[place]

    def _wheel(self, v: Column, a: Column) -> Column:
        """Power (M,) that one wheel takes, W."""
        even = self.c1 * a * a + self.c2 * v * v + self.c3 * np.abs(v) + self.c4
        return hinge(even + self.c5 * a * np.sign(v) + self.c6 * v * a)
