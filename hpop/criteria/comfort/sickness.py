"""Predicted motion sickness incidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import set_reals
from hpop.criteria.base import criterion
from hpop.criteria.comfort import visual_motion
from hpop.errors import CriterionError
from hpop.trajectories.history import History


@criterion("sickness", group="C", unit="%", aggregate="trajectory", requires=("camera",), smooth=False)
@dataclass(frozen=True)
class Sickness:
    """Share of people, %, whom the subjective-vertical-conflict model expects to have vomited at the end.

    vection  share of the seen motion that is taken for one's own, in [0, 1]; 1 is complete vection, the worst case

    The user sits still and sees the executed motion of the camera, in its own frame, its rotation about whatever axis;
    her own head stays upright. A robot's accelerations tilt the vertical that she expects, most about 0.2 Hz. See
    :mod:`hpop.criteria.comfort.svc` for the model (Wada and others), its constants and what is this project's reading.
    The answer builds up over tau_I = 12 minutes, so short drives give small numbers: compare them, and combine with
    ``rotation``, for a turn about the vertical leaves the vertical where it is and costs nothing here unless the camera
    is off the axis or still accelerating.

    Euler's steps of 0.01 s, as in the published simulations, make it too large: by 3 % as a rule, by 7 % at most among
    random drives with turns and holds.
    """

    vection: float = 1.0

    def __post_init__(self) -> None:
        set_reals(self, "vection", least=0, most=1, kind="a share", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the incidence (M,), %, at the end of each motion."""
        from hpop.criteria.comfort.svc import STEP, sicken  # importing numba takes half a second

        visual = visual_motion(m, STEP)
        sick = sicken(seen=visual.acceleration, seen_rotation=visual.rotation, vection=self.vection, step=visual.step)
        return m.at_motion_ends(visual.times, np.concatenate([[0.0], sick.incidence[:-1]]))
