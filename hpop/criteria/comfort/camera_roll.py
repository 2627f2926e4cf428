"""Camera roll: how much the horizon slants in the picture."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import angle_between, hypot
from hpop.criteria.base import criterion
from hpop.motions import Motions, Pose


@criterion("camera_roll", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraRoll:
    """∫ |ρ| cos ε dt, ρ the angle by which the picture is turned against the upright, ε the camera's pitch.

    "Zero roll" is one of the objectives by which Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019) move a camera in a
    robot's hand: people lose their bearings where up is not up. ρ is π in a picture upside down.

    Deviation: they weigh roll against other objectives, at each moment. Here it is weighted by cos ε, the length of the
    vertical in the picture: a camera that looks straight down or up shows no horizon and has no roll, and close to that
    roll changes by leaps that nobody sees.
    """

    def cost(self, m: Motions) -> Column:
        """Time integral (M,), rad s."""
        if m.camera.upright:  # turns about the vertical leave it as it is
            return _slant(m.camera.start) * m.duration
        return m.integrate(lambda s: _slant(s.camera))


def _slant(camera: Pose) -> Column:
    """|ρ| cos ε: the picture's vertical has a part along its left, and one along its up."""
    aside, along = camera.left[2], camera.up[2]
    return hypot(aside, along) * angle_between((0.0, 1.0, 0.0), (aside, along, 0.0))
