"""Tracked vehicle with its camera at the end of a boom, which a lift raises and a hinge slews."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import hpop
from hpop.errors import ModelError
from hpop.models.base import Joint, Mount, Part, PlanarModel, plane_space
from hpop.models.laws import Move, Run, Spin, Turn, joint_laws
from hpop.motions import Law, StateSpace

MAST_RADIUS = 0.08  # m
BOOM_WIDTH = 0.06  # m, its height as well


@hpop.model("tracked")
@dataclass(frozen=True)
class Tracked(PlanarModel):
    """Tracks under a box; states x, y (m), yaw (rad), lift (m) and slew (rad).

    length, width  m      size of the box, which reaches from the floor up to ``height``
    track_width    m      distance between the middles of the tracks
    camera_height  m      height of the camera above the floor while the lift is down
    lift           m      largest rise of the lift
    boom           m      length of the boom, from the mast in the middle of the box to the camera
    slew           rad    largest turn of the boom to either side
    speed, acceleration, turn_rate, turn_acceleration  m/s, m/s², rad/s and rad/s²
    """

    length: float = 0.6
    width: float = 0.45
    height: float = 0.35
    track_width: float = 0.36
    camera_height: float = 0.8
    lift: float = 0.8
    boom: float = 0.4
    slew: float = math.pi / 2
    speed: float = 0.8
    acceleration: float = 0.8
    turn_rate: float = 1.0
    turn_acceleration: float = 2.0

    executed = {**PlanarModel.executed, "lift": "lift_run", "slew": "slew_run"}  # noqa: RUF012

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isinstance(value, int | float) and 0.0 < value < math.inf):
                raise ModelError(f"{name} must be a positive number, got {reprlib.repr(value)}")

    @cached_property
    def arm(self) -> tuple[Joint, ...]:
        """The joints that carry the boom, the one on the base first."""
        return (
            Joint("lift", "up", 0.0, self.lift, speed=0.2, acceleration=0.4),
            Joint("slew", "round", -self.slew, self.slew, speed=0.8, acceleration=1.6),
        )

    @cached_property
    def space(self) -> StateSpace:
        """Return the space of position, heading and joints."""
        return plane_space(self.speed / self.turn_rate, self.arm, self.speed)

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Moves and turns, as planned and as executed, and those of each joint."""
        loss = self.speed / self.acceleration
        return {
            "move": Move(self.speed),
            "turn": Turn(self.turn_rate, self.turn_acceleration, loss),
            "run": Run(self.speed, self.acceleration),
            "spin": Spin(self.turn_rate, self.turn_acceleration),
            **joint_laws(self.arm, loss),
        }

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The box, the mast, whose inner tube the lift carries, and the boom."""
        low, high = self.camera_height - 0.5 * BOOM_WIDTH, self.camera_height + 0.5 * BOOM_WIDTH
        return (
            Part(_box(-0.5 * self.length, 0.5 * self.length, self.width), 0.0, 0.0, self.height),
            Part(((0.0, 0.0),), MAST_RADIUS, 0.0, low),
            Part(((0.0, 0.0),), MAST_RADIUS, self.height, high, on=self.arm[:1]),
            Part(_box(0.0, self.boom, BOOM_WIDTH), 0.0, low, high, on=self.arm),
        )

    @cached_property
    def mounts(self) -> Mapping[str, Mount]:
        """Its bodies: the base, and the camera at the end of the boom."""
        return {"base": Mount(), "camera": Mount(self.boom, 0.0, self.camera_height, on=self.arm)}

    @property
    def provides(self) -> frozenset[str]:
        """Return the capabilities that follow from parts, laws and joints; it looks ahead, on two tracks."""
        return super().provides | {"heading", "wheels"}

    @property
    def wheel_base(self) -> float:
        """Between the tracks, m."""
        return self.track_width

    @property
    def wheel_speed(self) -> float:
        """Return the speed of a track, m/s, that moves and turns need."""
        return max(self.speed, 0.5 * self.track_width * self.turn_rate)

    @property
    def wheel_acceleration(self) -> float:
        """Return the acceleration of a track, m/s²."""
        return max(self.acceleration, 0.5 * self.track_width * self.turn_acceleration)


def _box(back: float, front: float, width: float) -> tuple[tuple[float, float], ...]:
    half = 0.5 * width
    return ((front, half), (back, half), (back, -half), (front, -half))
