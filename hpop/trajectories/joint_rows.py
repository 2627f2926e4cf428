"""Values, speeds and accelerations of a robot's joints along a trajectory, sampled evenly in time, for controllers."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.errors import OptionError
from hpop.motions.bodies import JOINTS
from hpop.trajectories.poses import sample_times
from hpop.trajectories.trajectory import Trajectory


class JointRows(NamedTuple):
    """Motion of n joints at N times.

    names          names of the joints, from base to tip
    times          (N,)    s, from 0 to the end, strictly increasing
    positions      (N, n)  rad or m
    velocities     (N, n)  rad/s or m/s, 0 at both ends if the motion begins and ends at rest
    accelerations  (N, n)  rad/s² or m/s²; where they jump, those of the motion that begins
    """

    names: tuple[str, ...]
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    accelerations: FloatArray


def joint_rows(run: Trajectory, rate: float) -> JointRows:
    """Return the motion of the joints ``rate`` times a second, and at the end, of a planned or executed trajectory.

    Raises OptionError for an invalid rate, one that gives over a million rows, and for a robot without joints.
    """
    if JOINTS not in run.model.provides:
        raise OptionError(f"joints need a robot with joints, got {run.model.name}; give another body, such as camera")
    names = run.model.joints
    times = sample_times(run.duration, rate, "rows")
    sampled = (run.at(times), *run.rates(times))
    return JointRows(names, times, *(np.stack([getattr(row, name) for name in names], axis=1) for row in sampled))
