"""Bodies, such as a camera, mounted on a base that moves in the plane: their poses and motions; fields of view."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Protocol, TypeGuard, cast, runtime_checkable

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import hypot, is_symbolic, norm, smooth_abs
from hpop.base.options import LEAST, Angle, real
from hpop.base.text import shown
from hpop.errors import CriterionError, ModelError, UnsupportedCriterion
from hpop.models.joints import Joint, carried_point, joint_sum, reach_of
from hpop.motions import Body, Curve, Instants, Law, Model, Motions, States, integrated, is_curve
from hpop.motions.laws import follows
from hpop.motions.states import LevelPose, Vector


@checked_arguments
@dataclass(frozen=True)
class Mount:
    """Position of a body on the base, m: ahead and to the left of the axis, and above the floor.

    on    joints that carry the body, from the base outwards; the position is given for joint values of 0
    """

    ahead: float = 0.0
    left: float = 0.0
    height: float = 0.0
    on: tuple[Joint, ...] = ()

    @property
    def lever(self) -> float:
        """Horizontal distance from the axis of the base, m; for a body carried by joints, an upper bound on it."""
        return reach_of((self.ahead, self.left), self.on)


Position = tuple[float, float, float]
FARTHEST_MOUNT = 20.0  # m: more must be a mistake in the unit


def checked_seat(seat: Any) -> Position | None:
    """Check a model's option ``seat``: (ahead, left, height) of a passenger's seat, m, or None; return it as floats.

    Raises ModelError for any other value.
    """
    if seat is None:
        return None
    try:
        ahead, left, height = seat
    except (TypeError, ValueError):
        raise ModelError(f"seat must be (ahead, left, height) in m, or None for no seat, got {shown(seat)}") from None
    kind, most = "(ahead, left, height) in m, or None for no seat, each", FARTHEST_MOUNT
    ahead, left = (float(real("seat", value, -most, most, kind, error=ModelError)) for value in (ahead, left))
    return ahead, left, float(real("seat", height, 0.0, most, kind, error=ModelError))


@dataclass(frozen=True)
class RigidPose(LevelPose):
    """Pose of a body mounted level on a base with states x, y, yaw."""

    mount: Mount
    states: States

    @cached_property
    def size(self) -> int:
        return self.states.size

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
        return np.full(self.size, self.mount.height)

    @property
    def yaw(self) -> Column:
        return self.states.yaw


@dataclass(frozen=True)
class RigidTwist:
    """Velocity and angular velocity of a body mounted on the base; components are computed when they are read."""

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
        return 0.0, 0.0, self.rates.yaw


@dataclass(frozen=True)
class RigidTwistRate:
    """Acceleration and angular acceleration of a body mounted on the base."""

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
        return 0.0, 0.0, self.changes.yaw


@dataclass(frozen=True)
class CarriedPose(RigidPose):
    """Pose of a body that joints of the base carry."""

    @cached_property
    def _place(self) -> tuple[Column, Column]:
        return carried_point((self.mount.ahead, self.mount.left), self.mount.on, self.states).place

    @property
    def x(self) -> Column:
        return self._place[0]

    @property
    def y(self) -> Column:
        return self._place[1]

    @property
    def z(self) -> Column:
        return super().z + joint_sum(self.mount.on, "up", self.states)

    @property
    def yaw(self) -> Column:
        return super().yaw + joint_sum(self.mount.on, "round", self.states)


@dataclass(frozen=True)
class CarriedTwist(RigidTwist):
    """Velocity and angular velocity of a body that joints of the base carry."""

    @property
    def velocity(self) -> Vector:
        mount = self.mount
        found = carried_point((mount.ahead, mount.left), mount.on, self.states, self.rates)
        return *found.velocity, joint_sum(mount.on, "up", self.rates)

    @property
    def rotation(self) -> Vector:
        return 0.0, 0.0, super().rotation[2] + joint_sum(self.mount.on, "round", self.rates)


@dataclass(frozen=True)
class CarriedTwistRate(RigidTwistRate):
    """Acceleration and angular acceleration of a body that joints of the base carry."""

    @property
    def velocity(self) -> Vector:
        mount = self.mount
        found = carried_point((mount.ahead, mount.left), mount.on, self.states, self.rates, self.changes)
        return *found.acceleration, joint_sum(mount.on, "up", self.changes)

    @property
    def rotation(self) -> Vector:
        return 0.0, 0.0, super().rotation[2] + joint_sum(self.mount.on, "round", self.changes)


@runtime_checkable
class PlanarLaw(Law, Protocol):
    """Motion law of a base in the plane that gives path length and rotation of its motions in closed form."""

    def travel(self, start: States, end: States, lever: Column) -> Column:
        """Return the path length (M,), m, of a point ``lever`` m from the base's axis; on curves an upper bound."""

    def turned(self, start: States, end: States) -> Column:
        """Return the signed rotation (M,) of the base, rad."""


class PlanarCurve(PlanarLaw, Curve, Protocol):
    """Motion law of curves in the plane, with path length and rotation in closed form."""

    def swept(self, start: States, end: States) -> Column:
        """Return the absolute rotation (M,) of the base, rad; turns left and turns right both count."""

    def pieces(self, start: States, end: States, reach: float, bulge: float) -> Column:
        """Return the number (M,) of equal shares into which curves must be cut for collision tests.

        No point within ``reach``, m, of the axis then leaves the chord of its path by more than ``bulge``, m.
        """


def is_planar(law: Law) -> TypeGuard[PlanarLaw]:
    """Return whether a law follows :class:`PlanarLaw`: it gives path length and rotation in closed form."""
    return follows(law, PlanarLaw)


def motion_bounds(motions: Motions, lever: float) -> tuple[Column, Column]:
    """Return upper bounds (M,) on path length, m, of points within ``lever`` m of the base axis, and on turns, rad."""
    m, law = motions, motions.law
    if is_planar(law):
        turned = cast(PlanarCurve, law).swept(m.start, m.end) if is_curve(law) else law.turned(m.start, m.end)
        return np.maximum(*(law.travel(m.start, m.end, arm) for arm in (0.0, lever))), smooth_abs(turned)
    turned = smooth_abs(m.end.yaw - m.start.yaw)
    return hypot(m.end.x - m.start.x, m.end.y - m.start.y) + lever * turned, turned


def rigid_body(name: str, mount: Mount, motions: Motions) -> Body:
    """Return how a body mounted on the base moves in each motion, in closed form.

    It turns with the base, and moves on an arc if it is off the axis. On curves the path length of a body off the axis
    has no closed form and is integrated numerically.
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
    return Body(
        start=m.model.pose(name, m.start),
        end=m.model.pose(name, m.end),
        length=length,
        turned=turned,
        rotation=rotation,
        turns=turns,
        stays=not law.varies & {"x", "y"} and not (mount.lever and "yaw" in law.varies),
        steady="yaw" not in law.varies,
        upright=True,
    )


def turned_body(name: str, motions: Motions) -> Body:
    """Return how the body ``name``, which joints carry, moves in each of ``motions``.

    In these motions the joints rest, and the base moves straight or turns in place.
    """
    m, law = motions, cast(PlanarLaw, motions.law)
    start, rotation = m.model.pose(name, m.start), law.turned(m.start, m.end)
    lever = hypot(start.x - m.start.x, start.y - m.start.y)
    end, length, turned = m.model.pose(name, m.end), law.travel(m.start, m.end, lever), smooth_abs(rotation)
    return Body(start, end, length, turned, rotation, (rotation,))


def carried_body(name: str, mount: Mount, motions: Motions) -> Body:
    """Return how a body carried by joints moves in each motion.

    Its path is integrated numerically if a joint moves or the base drives a curve, and has a closed form otherwise.
    """
    law, joints = motions.law, {joint.name: joint.along for joint in mount.on}
    turning = {"yaw", *(joint for joint, along in joints.items() if along == "round")}
    if is_planar(law) and not is_curve(law) and not law.varies & joints.keys():
        body = turned_body(name, motions)
    else:
        body = integrated(name, motions)
    return replace(
        body,
        upright=True,
        stays=not law.varies & {"x", "y", "yaw", *joints},
        steady=not law.varies & turning,
    )


POSTURES = 16  # number of random states in which heights of the camera are compared
LEVEL = 1e-6  # m: tolerance for equal heights
ROUND_OFF = 1e-3  # rad by which a rounded pi, such as 3.142, may exceed pi
ALL = (2 * math.pi, math.pi)
FieldOfView = tuple[Angle, Angle]


def height_varies(model: Model) -> bool:
    """Return whether the camera's height depends on the state, as on an arm or a lift."""
    declared = vars(type(model)).get("__dataclass_params__")
    if declared is not None and declared.frozen:
        with suppress(TypeError):  # a field that cannot be hashed
            return _height_varies_on(cast(Any, model))
    return _height_varies(model)


def _height_varies(model: Model) -> bool:
    states = model.space.sample(np.random.default_rng(0), POSTURES)
    return bool(np.ptp(model.pose("camera", states).z + np.zeros(POSTURES)) > LEVEL)


_height_varies_on = lru_cache(maxsize=64)(_height_varies)


def camera_height(m: Motions) -> float:
    """Return the height of the camera above the floor, m, if it is constant over a batch of motions.

    Raises UnsupportedCriterion if it is not.
    """
    ends = m.camera.start.z, m.camera.end.z
    if any(map(is_symbolic, ends)) or np.ptp(np.concatenate(ends)) > LEVEL:
        raise UnsupportedCriterion(
            "the criterion needs a camera at a constant height, but this robot moves its camera up and down; leave the "
            "criterion out"
        )
    return float(np.round(ends[0][0], 6))


def field_of_view(model: Model, fov: float | None = None) -> FieldOfView:
    """Return the horizontal and vertical angle, rad, of the camera's view; (2 pi, pi) if the model sets none.

    fov  horizontal angle, rad, that replaces the model's, with a vertical angle of pi; None for the model's
    """
    if fov is not None:
        return fov, ALL[1]
    return model.field_of_view or ALL


def view_angles(s: Instants, model: Model, fov: float | None = None) -> tuple[Column, Column]:
    """Return the angles of view (N,), rad, at moments, as :func:`field_of_view`; narrowed by the model's restrictor.

    ``fov`` replaces the model's view, restrictor included.
    """
    widest = field_of_view(model, fov)
    if fov is not None or model.restrictor is None:
        return widest
    twist = s.twist("camera")
    narrowed: tuple[Column, Column] = model.restrictor.angles(widest, norm(twist.velocity), norm(twist.rotation))
    return narrowed


def checked_fov(fov: float | None) -> float | None:
    """Check a criterion's option ``fov`` (horizontal angle of view, rad, or None for the model's) and return it.

    Raises CriterionError for any other value.
    """
    if fov is None:
        return None
    kind = "None for the model's, or an angle of view in rad"
    return real("fov", fov, LEAST, ALL[0] + ROUND_OFF, kind, error=CriterionError)


def checked_field_of_view(angles: Any) -> FieldOfView | None:
    """Check a model's option ``field_of_view``: angles (horizontal, vertical), rad, or None for all round.

    Raises ModelError for any other value.
    """
    if angles is None:
        return None
    try:
        h, v = angles
    except (TypeError, ValueError):
        raise ModelError(
            f"field_of_view must be (horizontal, vertical) in rad, or None for all round, got {shown(angles)}"
        ) from None
    kind = "(horizontal, vertical) in rad, each an angle"
    limits = zip((h, v), ALL, strict=True)
    hint = "degrees are written as '60 deg' in a scenario, math.radians(60) in Python"
    h, v = (float(real("field_of_view", a, LEAST, m + ROUND_OFF, kind, hint=hint, error=ModelError)) for a, m in limits)
    return h, v
