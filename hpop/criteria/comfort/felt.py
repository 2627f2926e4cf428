"""Motion that a passenger on a seat feels: doses of ISO 2631-1, jerk, load in curves, and motion sickness.

The robot needs a body "seat" (option ``seat`` of a model). Each criterion uses the motion of the seat itself: on a seat
off the axis of the base, turns add accelerations. Only what the robot's own motion causes is felt; floors are flat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import smooth_abs
from hpop.base.options import MOST, set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import body_motion
from hpop.criteria.comfort.motion import squared_jerk
from hpop.criteria.comfort.sickness import W_D, W_F, W_K, sickness_dose
from hpop.errors import CriterionError
from hpop.motions import Instants, Motions
from hpop.trajectories.history import History

VIBRATION_STEP = 0.002  # s: 500 Hz; sampling lowers the weightings by 2 % at 40 Hz, where little is left to weigh


@criterion(
    "felt_msdv",
    group="C",
    unit="m/s^1.5",
    aggregate="trajectory",
    requires=("seat",),
    smooth=False,
)
@dataclass(frozen=True)
class FeltMSDV:
    """Motion sickness dose value at the seat: sqrt(∫ a_w² dt), a_w the acceleration weighted by the filter Wf.

    The three components in the seat's frame (ahead, left, up) are filtered, and their squares added and integrated
    until the robot arrives. Unit m/s^1.5; a criterion of the whole trajectory.

    Source: ISO 2631-1:1997, whose dose is that of the vertical component; a third of it is the percentage of adults who
    may vomit. Deviation: the horizontal components count too. Accelerations along all three axes make people about
    equally sick, most near 0.2 Hz (doi 10.1177/09574271261446596, of which only the abstract was read).
    """

    dose: ClassVar = ("seat", W_F)

    def cost(self, m: History) -> FloatArray:
        """Return the dose (M,), m/s^1.5, up to the end of each motion."""
        return sickness_dose(m, "seat")


def _weighted(m: History) -> tuple[FloatArray, float, FloatArray]:
    """Return times (N,), s, their step, and the weighted accelerations (N, 3), m/s², at the seat.

    Components ahead and left are weighted by Wd, the component up by Wk.
    """
    felt = body_motion(m, "seat", VIBRATION_STEP)
    level = W_D.apply(felt.acceleration[:, :2], felt.step)
    return felt.times, felt.step, np.hstack([level, W_K.apply(felt.acceleration[:, 2:], felt.step)])


@criterion("ride_comfort", group="C", unit="m/s²", aggregate="trajectory", requires=("seat",), smooth=False)
@dataclass(frozen=True)
class RideComfort:
    """Weighted root mean square of the acceleration at the seat: sqrt((1/T) ∫ |a_w|² dt), T the duration.

    a_w has the components ahead and left, weighted by the filter Wd, and up, weighted by Wk. Each of them counts once
    (factors k = 1). Unit m/s²; a criterion of the whole trajectory. A slow or long ride lowers a mean: read it beside
    ``duration``, or use ``vibration_dose``, which only grows.

    Source: ISO 2631-1:1997, comfort of seated persons. Its annex C calls 0.315 m/s² the limit of "not uncomfortable" in
    public transport. Rotations and vibrations of the backrest and the feet, which the standard may add, do not count.
    """

    def cost(self, m: History) -> FloatArray:
        """Return the root mean square (M,), m/s², from the start to the end of each motion."""
        times, step, weighted = _weighted(m)
        squares = np.cumsum(np.sum(weighted**2, axis=1)) * step
        return m.at_motion_ends(times, np.sqrt(squares / np.maximum(times, step)))


@criterion("vibration_dose", group="C", unit="m/s^1.75", aggregate="trajectory", requires=("seat",), smooth=False)
@dataclass(frozen=True)
class VibrationDose:
    """Vibration dose value (VDV) at the seat: (∫ Σ a_w⁴ dt)^(1/4), with the sum over ahead, left and up.

    The accelerations are weighted as in :class:`RideComfort`. The fourth power makes jolts count more than a long even
    vibration. Unit m/s^1.75; a criterion of the whole trajectory. Source: ISO 2631-1:1997, for each direction; the sum
    over directions is that of BS 6841:1987.
    """

    def cost(self, m: History) -> FloatArray:
        """Return the dose (M,), m/s^1.75, up to the end of each motion."""
        times, step, weighted = _weighted(m)
        return m.at_motion_ends(times, (np.cumsum(np.sum(weighted**4, axis=1)) * step) ** 0.25)


@criterion("felt_jerk", group="C", unit="m²/s⁵", aggregate="trajectory", requires=("seat",), smooth=False)
@dataclass(frozen=True)
class FeltJerk:
    """Squared jerk of the seat's executed motion, over time: ∫ |p'''|² dt, at a bandwidth of ``1/smoothing``.

    smoothing  time, s, over which the motion is smoothed; by default 0.1 (10 Hz)

    It is for the seat what ``jerk`` is for the camera; smoothing is explained there.
    Unit m²/s⁵; a criterion of the whole trajectory.
    """

    smoothing: float = 0.1

    def __post_init__(self) -> None:
        set_reals(self, "smoothing", least=0.001, most=MOST, kind="a time in s", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the integral (M,), m²/s⁵, of the squared jerk up to the end of each motion."""
        return squared_jerk(m, "seat", self.smoothing)


@criterion("lateral_load", group="C", unit="m/s²", aggregate="max", requires=("seat",), smooth=False)
@dataclass(frozen=True)
class LateralLoad:
    """Largest acceleration of the seat to either side, in the frame of the seat: max |a_left|.

    A curve of curvature k at the speed v has the load k v². Turns in place load a seat that is off the axis.
    Accelerations to the front and back do not count. Unit m/s²; the worst moment of the planned motions. A plan has no
    speed ramps: on a seat off the axis, a ramp in a curve may load the executed ride more than the plan.

    Source: this project. Lateral acceleration is what planners of road vehicles limit for comfort.
    """

    def cost(self, m: Motions) -> Column:
        """Return the largest absolute acceleration (M,), m/s², to the left or right in each motion."""

        def load(s: Instants) -> Column:
            (ax, ay, az), (lx, ly, lz) = s.twist_rate("seat").velocity, s.pose("seat").left
            return smooth_abs(ax * lx + ay * ly + az * lz)

        return m.worst(load)


@criterion("ride_sickness", group="C", unit="%", aggregate="trajectory", requires=("seat",), smooth=False)
@dataclass(frozen=True)
class RideSickness:
    """Share of passengers expected to have vomited by the end, by the model that ``sickness`` uses, with felt motion.

    vision  share of the motion that the passenger sees outside, in [0, 1]: 0 for reading, 1 for looking ahead

    The passenger's head moves with the seat: its acceleration and rotation are felt, and ``vision`` times both are seen
    as well. Seeing the motion lets the brain expect it, so vision makes a passenger less sick. For a viewer at rest who
    only sees the motion, use ``sickness``. Unit %; a criterion of the whole trajectory. Sickness builds up over
    tau_I = 12 minutes: compare short rides by it, do not predict.

    Source: :mod:`hpop.criteria.comfort.sickness` has the model, its constants, its reading of vision, and its accuracy.
    """

    vision: float = 0.0

    def __post_init__(self) -> None:
        set_reals(self, "vision", least=0, most=1, kind="a share", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the share of people (M,), %, who would have vomited by the end of each motion."""
        from hpop.criteria.comfort.sickness import GRAVITY, STEP, sicken  # importing numba takes half a second

        felt = body_motion(m, "seat", STEP)
        force = felt.acceleration + GRAVITY * (felt.vertical - np.array([0.0, 0.0, 1.0]))
        sick = sicken(
            felt=force,
            felt_rotation=felt.rotation,
            seen=felt.acceleration,
            seen_rotation=felt.rotation,
            vection=self.vision,
            step=felt.step,
        )
        return m.at_motion_ends(felt.times, np.concatenate([[0.0], sick.incidence[:-1]]))
