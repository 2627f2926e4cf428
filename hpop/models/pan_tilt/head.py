"""The camera on a pan-tilt head: where it looks, and how fast that changes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hpop.base.arrays import Column
from hpop.models.rigid import RigidPose, RigidTwist, RigidTwistRate
from hpop.motions import Vector


@dataclass(frozen=True)
class HeadPose(RigidPose):
    """Pose of a camera where the axes of the head meet, on a base with states x, y, yaw; pan and tilt turn it."""

    @property
    def yaw(self) -> Column:
        return self.states.yaw + self.states.pan

    @property
    def pitch(self) -> Column:
        return self.states.tilt

    @property
    def ahead(self) -> Vector:
        level = np.cos(self.pitch)
        return level * np.cos(self.yaw), level * np.sin(self.yaw), np.sin(self.pitch)

    @property
    def up(self) -> Vector:
        rise = np.sin(self.pitch)
        return -rise * np.cos(self.yaw), -rise * np.sin(self.yaw), np.cos(self.pitch)


@dataclass(frozen=True)
class HeadTwist(RigidTwist):
    """How fast the camera moves, with the base alone, and turns: about the vertical, and tilting up about its right.

    With ψ = yaw + pan its right is (sin ψ, -cos ψ, 0), always level.
    """

    @property
    def rotation(self) -> Vector:
        yaw, tilt_rate = self.states.yaw + self.states.pan, self.rates.tilt
        return tilt_rate * np.sin(yaw), -tilt_rate * np.cos(yaw), self.rates.yaw + self.rates.pan


@dataclass(frozen=True)
class HeadTwistRate(RigidTwistRate):
    """How fast the twist of the camera changes; the axis of the tilt is carried round by the other two."""

    @property
    def rotation(self) -> Vector:
        yaw, turn_rate = self.states.yaw + self.states.pan, self.rates.yaw + self.rates.pan
        cos, sin, carried, change = np.cos(yaw), np.sin(yaw), self.rates.tilt * turn_rate, self.changes.tilt
        return change * sin + carried * cos, carried * sin - change * cos, self.changes.yaw + self.changes.pan
