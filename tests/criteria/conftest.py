"""Fixtures of criteria: a robot that also drives arcs of circles."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest

from hpop.models import DifferentialDrive
from hpop.motions import Phase, States
from hpop.trajectories.trajectory import Trajectory


class Arc:
    """An arc at cruise speed; its length is that of the circle through both ends."""

    kind = "arc"
    varies = frozenset({"x", "y", "yaw"})

    def travel(self, start, end, lever):
        chord, angle = np.hypot(end.x - start.x, end.y - start.y), end.yaw - start.yaw
        return chord / np.sinc(angle / (2 * np.pi))  # chord (angle/2) / sin(angle/2)

    def turned(self, start, end):
        return end.yaw - start.yaw

    def phases(self, start, end):
        duration = self.travel(start, end, 0.0)
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)

    def interpolate(self, name, start, end, share):
        begin = getattr(start, name)
        return begin + (getattr(end, name) - begin) * share


@dataclass(frozen=True)
class Curvy(DifferentialDrive):
    @cached_property
    def laws(self):
        return {**DifferentialDrive().laws, "arc": Arc()}


def chained(lengths, rotations):
    """Return a trajectory of consecutive arcs from (0, 0, 0); a length of 0 turns in place."""
    x, y, yaw = [0.0], [0.0], [0.0]
    for length, rotation in zip(lengths, rotations, strict=True):
        middle = yaw[-1] + rotation / 2
        chord = length * np.sinc(rotation / (2 * np.pi))
        x.append(x[-1] + chord * np.cos(middle))
        y.append(y[-1] + chord * np.sin(middle))
        yaw.append(yaw[-1] + rotation)
    kinds = tuple("arc" if length else "turn" for length in lengths)
    return Trajectory(Curvy(), States(x=np.array(x), y=np.array(y), yaw=np.array(yaw)), kinds)


@pytest.fixture(scope="session")
def arcs():
    """Build a trajectory of arcs from their lengths, m, and rotations, rad."""
    return chained
