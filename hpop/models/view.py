"""Robot model "view": another robot whose picture software turns back, wholly or to a level horizon, and restricts.

The body "camera" of this model is what the viewer sees. So all criteria of the camera, pictures, rides, videos and
exports follow the view. All else is the robot's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from hpop.base.arrays import Column
from hpop.base.math import smooth_abs
from hpop.base.options import MOST, Angle, Degrees, one_of, real, set_reals
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import model
from hpop.models.differential_drive import DifferentialDrive
from hpop.models.rigid import ALL, FieldOfView, checked_field_of_view
from hpop.motions import MODEL_DEFAULTS, Body, Model, Motions, Pose, States, Twist
from hpop.motions.states import LevelPose, Vector

if TYPE_CHECKING:
    from hpop.motions import Collision
    from hpop.trajectories.trajectory import Trajectory
    from hpop.world import World

Turning = Literal["fixed", "level", "unwound"]
STEEP = math.radians(120.0)
"""Tilt of the camera, rad, beyond which a level view may turn more than twice as fast as the camera."""
BETWEEN = 0.05
"""s between the moments of a trajectory at which the tilt is looked at."""
UPSIDE_DOWN = 1e-9  # least 1 + cos of the camera's tilt for which the yaw of a level view is defined
OF_ROBOT = (
    *("provides", "space", "laws", "parts", "platform", "mounts", "joints", "executed", "speed_classes", "paces"),
    "reverses",
    *(
        "notes",
        "links",
        "link_pose",
        "field_of_view",
        "bodies",
        "connect",
        "joinable",
        "judge",
        "judge_by",
        "execution",
    ),
    *("faults", "doubtful"),
)
"""Members of a model that a view takes from its robot."""


@dataclass(frozen=True)
class Restrictor:
    """Field of view that narrows while the view moves, so that less of the flow at its edges is seen.

    least   rad    angles (horizontal, vertical) of the view where it is narrowest
    speeds  m/s    (from, to): the view begins to narrow at the first speed of the camera and is narrowest at the
                   second; None if the speed does not matter
    rates   rad/s  (from, to): likewise for the angular speed of the view

    Between the two values the angles change linearly. Of speed and rate the one that narrows more counts.

    Source: Fernandes and Feiner 2016 narrow the view by speed and angular speed; the linear form is this project's.
    """

    least: FieldOfView
    speeds: tuple[float, float] | None = None
    rates: tuple[float, float] | None = (0.0, 1.0)

    def __post_init__(self) -> None:
        least = tuple(map(Degrees.in_radians, self.least)) if isinstance(self.least, list | tuple) else self.least
        object.__setattr__(self, "least", checked_field_of_view(least))
        for name in ("speeds", "rates"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, _checked_ramp(name, given))

    @classmethod
    def of(cls, given: Any) -> Restrictor | None:
        """Return a restrictor, given as an object, as its parameters by name, or as None; ModelError for others."""
        if given is None or isinstance(given, cls):
            return given
        known = [each.name for each in fields(cls)]
        if not isinstance(given, Mapping) or "least" not in given or not set(given) <= set(known):
            raise ModelError(
                f"restrictor must have the key least, and may have speeds and rates, but no others; got {shown(given)}"
            )
        return cls(**given)

    def angles(self, widest: FieldOfView, speed: Column, rate: Column) -> tuple[Column, Column]:
        """Return the angles of view (N,), rad, at speeds of the camera, m/s, and angular speeds of the view, rad/s.

        ``widest`` has the angles of the unrestricted view.
        """
        share: Column = 0.0
        for value, ramp in ((speed, self.speeds), (rate, self.rates)):
            if ramp is not None:
                share = np.maximum(share, np.minimum((value - ramp[0]) / (ramp[1] - ramp[0]), 1.0))
        across, up = (wide - share * max(0.0, wide - low) for wide, low in zip(widest, self.least, strict=True))
        return across, up

    def narrows(self, widest: FieldOfView) -> bool:
        """Return whether the restrictor ever narrows a view of angles ``widest``, rad."""
        moves = self.speeds is not None or self.rates is not None
        return moves and any(low < wide for low, wide in zip(self.least, widest, strict=True))


def _checked_ramp(name: str, given: Any) -> tuple[float, float]:
    """Check the option ``speeds`` or ``rates`` of a restrictor and return it as two rising floats."""
    try:
        low, high = (float(real(name, value, 0.0, MOST, "(from, to), each", error=ModelError)) for value in given)
    except (TypeError, ValueError) as error:
        if isinstance(error, ModelError):
            raise
        low = high = 0.0
    if not low < high:
        raise ModelError(f"{name} must be (from, to) with from below to, got {shown(given)}")
    return low, high


@dataclass(frozen=True)
class ViewPose(LevelPose):
    """Pose of a level view at the camera.

    camera  pose of the camera
    size    number N of states
    turned  rad, constant yaw of the view; None if it follows the camera
    flat    whether the camera never rolls, so that the view has the camera's own yaw
    """

    camera: Pose
    size: int
    turned: float | None
    flat: bool

    @property
    def x(self) -> Column:
        return self.camera.x

    @property
    def y(self) -> Column:
        return self.camera.y

    @property
    def z(self) -> Column:
        return self.camera.z

    @cached_property
    def yaw(self) -> Column:
        if self.turned is not None:
            return np.full(self.size, self.turned)
        if self.flat:
            return self.camera.yaw
        ahead, left = self.camera.ahead, self.camera.left
        return np.arctan2(ahead[1] - left[0], ahead[0] + left[1])


@dataclass(frozen=True)
class ViewTwist:
    """Velocity of the camera and angular velocity of a level view; or the time derivatives of both.

    camera  velocity of the camera, or its time derivative
    turn    rate (N,) of the view's yaw, rad/s, or its time derivative
    """

    camera: Twist
    turn: Column

    @property
    def velocity(self) -> Vector:
        return self.camera.velocity

    @property
    def rotation(self) -> Vector:
        return 0.0, 0.0, self.turn


class _OfRobot:
    """Base class whose members are those of ``self.model``."""


for _name in OF_ROBOT:
    setattr(_OfRobot, _name, property(attrgetter(f"model.{_name}")))


@model("view")
@dataclass(frozen=True)
class ViewModel(_OfRobot):
    """Robot with a 360-degree camera whose picture software turns back; its body "camera" is what the viewer sees.

    model       any robot with a camera; by default a differential drive
    turning     "unwound": the view never turns; its middle stays at the direction ``yaw`` of the world, on the horizon.
                "level": the horizon stays level, and the view turns with the camera about the vertical only. "fixed":
                the view turns with the camera
    yaw         rad, for "unwound": yaw of the middle of the view in the world
    restrictor  :class:`Restrictor` that narrows the field of view while the view moves, or its parameters by name

    A level view has the yaw of the camera after the smallest rotation that makes the camera upright. Without roll it is
    the camera's own yaw. For a camera that is upside down it is not defined, and near there the view may turn much
    faster than the camera: a note on the front tells of trajectories on which the camera tilts by over 120 degrees.

    Goals for the camera, such as ``look_at``, still ask for the robot's own camera. A restrictor that never narrows the
    view is dropped.

    Source: unwinding the rotations of a 360-degree camera on an arm lowered sickness (arXiv 2509.26439).
    """

    model: Model = field(default_factory=DifferentialDrive)
    turning: Turning = "unwound"
    yaw: Angle = 0.0
    restrictor: Restrictor | dict[str, Any] | None = None

    def __post_init__(self) -> None:
        robot: Any = self.model
        if isinstance(robot, type) or not isinstance(robot, Model) or "camera" not in robot.provides:
            raise ModelError(f"model must be a robot with a camera, such as DifferentialDrive(...), got {shown(robot)}")
        if robot.name == type(self).name:  # type: ignore[attr-defined]  # set by its decorator
            raise ModelError("model must be a robot, but it is a view itself; give the robot of that view")
        with_optional_members(robot, MODEL_DEFAULTS)
        one_of("turning", self.turning, get_args(Turning), error=ModelError)
        set_reals(self, "yaw", least=-MOST, most=MOST, kind="an angle in rad", error=ModelError)
        restrictor = Restrictor.of(self.restrictor)
        narrows = restrictor is not None and restrictor.narrows(robot.field_of_view or ALL)
        object.__setattr__(self, "restrictor", restrictor if narrows else None)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the robot that the protocol of models does not name, such as its wheels."""
        if name.startswith("_") or name == "model":
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.model, name)

    @property
    def carrier(self) -> Model:
        """Robot that carries the camera; its body "camera" is the real camera, not the view."""
        return self.model

    def with_scene(self, world: World) -> ViewModel:
        """Return the view of the robot with the objects that a planning scene attaches to its links."""
        return replace(self, model=self.model.with_scene(world))

    def collision(self, world: World) -> Collision:
        """Return the robot's collision test for planning."""
        return self.model.collision(world)

    def notes_on(self, trajectories: Sequence[Trajectory]) -> tuple[str, ...]:
        """Return the robot's notes on the trajectories of a front, and one on those that tilt a level view steeply."""
        robot: Any = with_optional_members(self.model, MODEL_DEFAULTS)
        notes: tuple[str, ...] = robot.notes_on(trajectories)
        if self.turning != "level" or "plane" in self.provides:
            return notes
        tilts = np.array([self._steepest(one) for one in trajectories])
        if not (tilts > STEEP).any():
            return notes
        most = float(tilts.max())
        faster = f"up to {1.0 / math.cos(most / 2):.0f} times as fast" if most < math.radians(179) else "at any speed"
        return (
            *notes,
            f"on {np.count_nonzero(tilts > STEEP):,} of {len(tilts):,} trajectories the camera tilts by over 120 "
            f"degrees, at most by {math.degrees(most):.0f}: there a level view may turn {faster} as the camera; "
            'look at a ride, or take turning "unwound"',
        )

    def _steepest(self, trajectory: Trajectory) -> float:
        """Return the largest tilt of the robot's camera on a trajectory, rad."""
        times = np.linspace(0.0, trajectory.duration, 2 + int(trajectory.duration / BETWEEN))
        up = self.model.pose("camera", trajectory.at(times)).up[2]
        return float(np.arccos(np.clip(np.min(up), -1.0, 1.0)))

    def _turns(self, body: str) -> bool:
        """Return whether software turns the pose of a body."""
        return body == "camera" and self.turning != "fixed"

    def pose(self, body: str, states: States) -> Pose:
        """Return the pose of a body, for "camera" that of the view."""
        pose = self.model.pose(body, states)
        if not self._turns(body):
            return pose
        return ViewPose(pose, states.size, self.yaw if self.turning == "unwound" else None, "plane" in self.provides)

    def twist(self, body: str, states: States, rates: States) -> Twist:
        """Return velocity and angular velocity of a body, for "camera" those of the view."""
        twist = self.model.twist(body, states, rates)
        if not self._turns(body):
            return twist
        return ViewTwist(twist, 0.0 if self.turning == "unwound" else self._turn_rate(states, twist))

    def _turn_rate(self, states: States, twist: Twist) -> Column:
        """Return the rate (N,) of a level view's yaw, rad/s.

        It is w . (z + u) / (1 + u_z), with w the rotation in ``twist``, u the camera's up, and z the vertical.
        """
        (wx, wy, wz), (ux, uy, uz) = twist.rotation, self.model.pose("camera", states).up
        return wz if "plane" in self.provides else wz + (wx * ux + wy * uy) / np.maximum(1.0 + uz, UPSIDE_DOWN)

    def twist_rate(self, body: str, states: States, rates: States, changes: States) -> Twist:
        """Return acceleration and angular acceleration of a body, for "camera" those of the view."""
        change = self.model.twist_rate(body, states, rates, changes)
        if not self._turns(body):
            return change
        if self.turning == "unwound":
            return ViewTwist(change, 0.0)
        turn = self._turn_rate(states, change)
        if "plane" not in self.provides:
            twist = self.model.twist(body, states, rates)
            (wx, wy, _), (ux, uy, uz) = twist.rotation, self.model.pose(body, states).up
            # z + u, the axis of the yaw, moves with u: u' = w x u is normal to w; only the divisor 1 + u_z changes.
            excess = self._turn_rate(states, twist)
            turn = turn - excess * (wx * uy - wy * ux) / np.maximum(1.0 + uz, UPSIDE_DOWN)
        return ViewTwist(change, turn)

    def extent(self, motions: Motions) -> tuple[Column, Column]:
        """Return upper bounds (M,), m and rad, on how far any body moves and turns in each motion.

        A level view can turn 1 / cos(tilt / 2) times as fast as a tilted camera. The bound allows a factor of 2, so it
        holds for tilts up to 120 degrees.
        """
        farthest, turned = self.model.extent(motions)
        return farthest, 2.0 * turned if self.turning == "level" and "plane" not in self.provides else turned

    def body(self, name: str, motions: Motions) -> Body:
        """Return how a body moves in each motion; a level view's rotation is integrated if the camera also tilts."""
        own = self.model.body(name, replace(motions, model=self.model))
        if not self._turns(name):
            return own
        start, end = (self.pose(name, states) for states in (motions.start, motions.end))
        if self.turning == "unwound":
            still = 0.0 * motions.duration
            return Body(start, end, own.length, still, still, (still,), stays=own.stays, steady=True, upright=True)
        turned, rotation, turns = own.turned, own.rotation, own.turns
        if not own.upright:
            turned = motions.integrate(lambda s: smooth_abs(s.twist(name).rotation[2]))
            rotation = motions.integrate(lambda s: s.twist(name).rotation[2])
            turns = (rotation,)
        return Body(start, end, own.length, turned, rotation, turns, own.stays, own.steady, upright=True)

    def describe(self) -> dict[str, Any]:
        """Return name and parameters for JSON, enough to build an equal model; the robot is described likewise."""
        own: dict[str, Any] = {"model": self.model.describe(), "turning": self.turning}
        if self.yaw:
            own["yaw"] = self.yaw
        if self.restrictor is not None:
            own["restrictor"] = {key: list(v) for key, v in vars(self.restrictor).items() if v is not None}
            own["restrictor"] |= {key: None for key in ("speeds", "rates") if getattr(self.restrictor, key) is None}
        return {"view": own}
