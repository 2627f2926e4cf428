"""Duration of the trajectory, and energy of the drive motors of a differential drive."""

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


@criterion("duration", group="R", unit="s", aggregate="sum", role="duration")
@dataclass(frozen=True)
class Duration:
    """Duration of the trajectory: T = ∫ dt.

    Unit s; a sum over motions. Each is timed by its motion law, which on a graph is that of planned motions.
    """

    def cost(self, m: Motions) -> Column:
        """Return the duration (M,), s."""
        return m.duration


@criterion("energy", group="R", unit="J", aggregate="sum", requires=("wheels",), instead=("joint_energy",))
@dataclass(frozen=True)
class Energy:
    """Energy of both drive motors: ∫ P dt with P = (c1 a² + c2 v² + c3 v + c4 + c5 a + c6 v a)₊ for each wheel.

    v and a are the speed and acceleration of a wheel. For a base with speed V, acceleration A, turn rate ω, angular
    acceleration α and wheel base b they are V ± ω b/2 and A ± α b/2. Unit J; a sum over motions.

    Source: the power of a direct-current motor, from Tokekar, Karnad and Isler, "Energy-optimal trajectory planning for
    car-like robots", Autonomous Robots 37, 2014.

    The constants must be calibrated on each robot. The defaults were not measured; they are placeholders of a plausible
    size for 30 kg on two wheels (c6 is the mass on a wheel divided by an efficiency of 0.75). Use them to compare
    trajectories, not to predict how long a battery lasts.

    Deviations: a wheel that turns backwards takes as much power as forwards, with c3 |v| and c5 a sign(v). Energy from
    braking is lost, so P counts only where it is positive. Planned moves are at cruise speed throughout. Speeding up
    and braking appear only in the cost of the executed motion, which is reported beside the planned one.
    """

    c1: float = 1.0  # W s⁴/m²
    c2: float = 2.0  # W s²/m²
    c3: float = 5.0  # W s/m
    c4: float = 2.0  # W, at rest
    c5: float = 1.0  # W s²/m
    c6: float = 20.0  # W s³/m², which is kg

    def __post_init__(self) -> None:
        names = (field.name for field in fields(self))
        set_reals(self, *names, least=0, most=MOST, kind="a number", error=CriterionError)

    def cost(self, m: Motions) -> Column:
        """Return the energy (M,), J."""
        half = 0.5 * cast(Wheeled, m.model).wheel_base

        def power(s: Instants) -> Column:
            v, a, turn, change = s.speed, s.acceleration, half * s.turn_rate, half * s.turn_acceleration
            return self._wheel(v - turn, a - change) + self._wheel(v + turn, a + change)

        if not m.whole or m.law.varies != {"yaw"} or is_symbolic(m.base.rotation):
            return m.integrate(power)
        # Turns in place differ only in their angles, and a graph has many turns but few different angles.
        _, first, inverse = np.unique(m.base.turned, return_index=True, return_inverse=True)
        different = replace(m, start=m.start.take(first), end=m.end.take(first), t0=None)
        return different.integrate(power)[inverse]

    def _wheel(self, v: Column, a: Column) -> Column:
        """Return the power (M,) of one wheel, W."""
        even = self.c1 * a * a + self.c2 * v * v + self.c3 * np.abs(v) + self.c4
        return hinge(even + self.c5 * a * np.sign(v) + self.c6 * v * a)
