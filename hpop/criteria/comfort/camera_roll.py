"""Camera roll: how much the horizon is slanted in the picture."""

from __future__ import annotations

from dataclasses import dataclass

from hpop.base.arrays import Column
from hpop.base.math import angle_between, hypot
from hpop.criteria.base import criterion
from hpop.motions import Motions, Pose


@criterion("camera_roll", group="C", unit="rad s", aggregate="sum", requires=("camera",))
@dataclass(frozen=True)
class CameraRoll:
    """Slant of the camera's picture, over time: ∫ |ρ| cos ε dt, where ρ is the camera's roll and ε its pitch.

    ρ is 0 in an upright picture and π in one that is upside down. Unit rad s; a sum over motions.

    Source: "zero roll" is one of the objectives by which Rakita, Mutlu and Gleicher (HRI 2018; RSS 2019) move a camera
    on a robot's arm, because people lose their bearings in a slanted picture.

    Deviation: the weight cos ε, which is the length of the world's vertical in the picture. A camera that looks
    straight down or up shows no horizon, and near these directions the roll jumps although the picture hardly changes.
    """

    def cost(self, m: Motions) -> Column:
        """Return the time integral of the slant (M,), rad s."""
        if m.camera.upright:  # the camera turns about the vertical only, which does not change the slant
            return _slant(m.camera.start) * m.duration
        return m.integrate(lambda s: _slant(s.camera))


def _slant(camera: Pose) -> Column:
    """Return |ρ| cos ε, rad, from the components of the world's vertical along the camera's axes left and up."""
    aside, along = camera.left[2], camera.up[2]
    return hypot(aside, along) * angle_between((0.0, 1.0, 0.0), (aside, along, 0.0))
