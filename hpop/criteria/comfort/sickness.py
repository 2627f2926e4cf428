"""Predicted incidence of motion sickness: the share of people who would have vomited."""

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
    """Share of people expected to have vomited by the end, by the subjective-vertical-conflict model.

    vection  share of the seen motion that users take for their own motion, in [0, 1]; 1 is the worst case

    Unit %; a criterion of the whole trajectory. The model's user is seated, keeps the head upright, and sees the
    executed motion of the camera, including rotations about any axis. Accelerations of the robot tilt the vertical that
    the user expects, most at about 0.2 Hz. A turn about the vertical does not tilt it, and costs nothing unless the
    camera is away from the axis or still accelerating. Sickness builds up over tau_I = 12 minutes, so short drives give
    small numbers: use them for comparison, and combine the criterion with ``rotation``.

    Source: :mod:`hpop.criteria.comfort.svc` has the model (Wada and others), its constants, and this project's reading
    of it. Euler steps of 0.01 s, as in the published simulations, make the value too large: usually by 3 %, and by at
    most 7 % among random drives with turns and holds.
    """

    vection: float = 1.0

    def __post_init__(self) -> None:
        set_reals(self, "vection", least=0, most=1, kind="a share", error=CriterionError)

    def cost(self, m: History) -> FloatArray:
        """Return the share of people (M,), %, who would have vomited by the end of each motion."""
        from hpop.criteria.comfort.svc import STEP, sicken  # importing numba takes half a second

        visual = visual_motion(m, STEP)
        sick = sicken(seen=visual.acceleration, seen_rotation=visual.rotation, vection=self.vection, step=visual.step)
        return m.at_motion_ends(visual.times, np.concatenate([[0.0], sick.incidence[:-1]]))
