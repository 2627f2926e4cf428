"""Bodies mounted on a base that moves in the plane: their poses, twists, and what they do along its motions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np

from hpop.arguments import checked_arguments
from hpop.arrays import Column
from hpop.math import hypot, norm, smooth_abs
from hpop.motions import Body, Curve, Law, Motions, States, is_curve
from hpop.motions.states import Vector


@checked_arguments
@dataclass(frozen=True)
class Mount:
    """Where a body is on the base: ahead and to the left of the axis, and above the floor, m.

    It looks where the base does, unless ``view`` is its yaw in the world, rad: of a picture turned back in software.
    """

    ahead: float = 0.0
    left: float = 0.0
    height: float = 0.0
    view: float | None = None

    @property
    def lever(self) -> float:
        """Distance from the axis, m."""
        return math.hypot(self.ahead, self.left)


@dataclass(frozen=True)
class RigidPose:
    """Pose of a body mounted level on a base with states x, y, yaw."""

    mount: Mount
    states: States

    @property
    def x(self) -> Column:
        if not self.mount.lever:
            return self.states.x
        return self.states.x + self.mount.ahead * np.cos(self.states.yaw) - self.mount.left * np.sin(self.states.yaw)

    @property
    def y(self) -> Column:
        if not self.mount.lever:
            return self.states.y
        return self.states.y + self.mount.ahead * np.sin(self.states.yaw) + self.mount.left * np.cos(self.states.yaw)

    @property
    def z(self) -> Column:
        return np.full(self.states.size, self.mount.height)

    @property
    def yaw(self) -> Column:
        return self.states.yaw if self.mount.view is None else np.full(self.states.size, self.mount.view)

    @property
    def pitch(self) -> Column:
        return np.zeros(self.states.size)

    @property
    def roll(self) -> Column:
        return np.zeros(self.states.size)

    @property
    def ahead(self) -> Vector:
        return np.cos(self.yaw), np.sin(self.yaw), 0.0

    @property
    def left(self) -> Vector:
        return -np.sin(self.yaw), np.cos(self.yaw), 0.0

    @property
    def up(self) -> Vector:
        return 0.0, 0.0, 1.0


@dataclass(frozen=True)
class RigidTwist:
    """How fast a mounted body moves and turns; what is not read is not computed."""

    mount: Mount
    states: States
    rates: States

    @property
    def velocity(self) -> Vector:
        if not self.mount.lever:
            return self.rates.x, self.rates.y, 0.0
        pose, turn_rate = RigidPose(self.mount, self.states), self.rates.yaw
        return (
            self.rates.x - turn_rate * (pose.y - self.states.y),
            self.rates.y + turn_rate * (pose.x - self.states.x),
            0.0,
        )

    @property
    def rotation(self) -> Vector:
        return 0.0, 0.0, self.rates.yaw if self.mount.view is None else 0.0


@dataclass(frozen=True)
class RigidTwistRate:
    """How fast the twist of a mounted body changes."""

    mount: Mount
    states: States
    rates: States
    changes: States

    @property
    def velocity(self) -> Vector:
        if not self.mount.lever:
            return self.changes.x, self.changes.y, 0.0
        pose, square = RigidPose(self.mount, self.states), self.rates.yaw * self.rates.yaw
        aside, beyond = pose.x - self.states.x, pose.y - self.states.y
        return (
            self.changes.x - self.changes.yaw * beyond - square * aside,
            self.changes.y + self.changes.yaw * aside - square * beyond,
            0.0,
        )

    @property
    def rotation(self) -> Vector:
        return 0.0, 0.0, self.changes.yaw if self.mount.view is None else 0.0


@runtime_checkable
class PlanarLaw(Law, Protocol):
    """A law of a base in the plane that knows the way and the rotation of its motions in closed form."""

    def travel(self, start: States, end: States, lever: float) -> Column:
        """Path length (M,), m, of a point ``lever`` metres from the axis; along curves no less than that."""

    def turned(self, start: States, end: States) -> Column:
        """Signed rotation (M,), rad."""


class PlanarCurve(PlanarLaw, Curve, Protocol):
    """A law of curves in the plane."""

    def swept(self, start: States, end: States) -> Column:
        """Absolute rotation (M,), rad."""


def farthest(motions: Motions, lever: float) -> tuple[Column, Column]:
    """How far (M,), m and rad, a point ``lever`` metres from the axis, or the axis, moves and turns at most."""
    m, law = motions, motions.law
    if isinstance(law, PlanarLaw):
        turned = cast(PlanarCurve, law).swept(m.start, m.end) if is_curve(law) else law.turned(m.start, m.end)
        return np.maximum(*(law.travel(m.start, m.end, arm) for arm in (0.0, lever))), smooth_abs(turned)
    turned = smooth_abs(m.end.yaw - m.start.yaw)
    return hypot(m.end.x - m.start.x, m.end.y - m.start.y) + lever * turned, turned


def rigid_body(name: str, mount: Mount, motions: Motions) -> Body:
    """What a mounted body does in each of the motions: it turns with the base, and its lever lengthens its way.

    On curves a body off the axis goes now a longer, now a shorter way than it: that is integrated.
    """
    m, law = motions, cast(PlanarLaw, motions.law)
    rotation = law.turned(m.start, m.end)
    turned: Column = smooth_abs(rotation)
    turns: tuple[Column, ...] = (rotation,)
    length = law.travel(m.start, m.end, mount.lever)
    if is_curve(law):
        curve = cast(PlanarCurve, law)
        turned, turns = curve.swept(m.start, m.end), m.turns or curve.bends(m.start, m.end)
        if mount.lever:
            length = m.integrate(lambda s: norm(s.twist(name).velocity))
    if mount.view is not None:
        rotation = turned = 0.0 * rotation
        turns = (rotation,)
    return Body(
        start=m.model.pose(name, m.start),
        end=m.model.pose(name, m.end),
        length=length,
        turned=turned,
        rotation=rotation,
        turns=turns,
        stays=not law.varies & {"x", "y"} and not (mount.lever and "yaw" in law.varies),
        steady="yaw" not in law.varies or mount.view is not None,
        upright=True,
    )
