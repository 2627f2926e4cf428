"""Holonomic base on omnidirectional wheels, which slides in any direction and may turn on its way."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

import hpop
from hpop.base.arrays import Column
from hpop.base.math import hypot, smooth_abs
from hpop.errors import ModelError
from hpop.models.base import Mount, Part, PlanarModel, plane_space
from hpop.models.laws import rest_to_rest
from hpop.motions import Law, Leg, Phase, States, StateSpace

MAST_RADIUS = 0.05  # m
STILL = 1e-9  # m, distance up to which two states count as equal


@dataclass(frozen=True)
class Slide:
    """Law of straight motion in any direction at cruise speed, with an even rotation or none.

    The slower of the two, the path or the rotation, sets the duration. Time for stopping at corners is only in the
    execution.
    """

    speed: float  # m/s
    turn_rate: float  # rad/s
    kind: str = "slide"
    varies = frozenset({"x", "y", "yaw"})

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase at constant speed."""
        duration = self.metres(start, end) / self.speed
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "cruise"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Every state in proportion to the share done."""
        begin = getattr(start, name)
        return begin + (getattr(end, name) - begin) * share

    def metres(self, start: States, end: States) -> Column:
        """Return the distance (M,), m, at cruise speed in the time that a move and its turn take."""
        turned = smooth_abs(end.yaw - start.yaw)
        return np.maximum(hypot(end.x - start.x, end.y - start.y), turned * (self.speed / self.turn_rate))


@dataclass(frozen=True)
class Glide(Slide):
    """A slide as it is executed, from rest to rest."""

    acceleration: float = 1.0  # m/s²
    kind: str = "glide"

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Speed up, cruise, slow down."""
        return rest_to_rest(self.metres(start, end), self.speed, self.acceleration)


@hpop.model("holonomic")
@dataclass(frozen=True)
class Holonomic(PlanarModel):
    """A box on omnidirectional wheels with a 360-degree camera on a mast in its middle; states x, y (m), yaw (rad).

    length, width  m      of the box, which reaches from the floor up to ``height``
    camera_height  m      of the camera above the floor; its mast reaches up to it
    speed          m/s    cruise speed in any direction
    acceleration   m/s²   as it is executed; turns speed up in proportion
    turn_rate      rad/s  at which it turns at most, on its way or in place
    """

    length: float = 0.7
    width: float = 0.5
    height: float = 0.4
    camera_height: float = 1.2
    speed: float = 1.0
    acceleration: float = 1.0
    turn_rate: float = 1.5

    executed = {"slide": "glide"}  # noqa: RUF012

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (isinstance(value, int | float) and 0.0 < value < math.inf):
                raise ModelError(f"{name} must be a positive number, got {reprlib.repr(value)}")

    @cached_property
    def space(self) -> StateSpace:
        """Return the space of position and heading; a radian counts as the distance driven in the time of that turn."""
        return plane_space(self.speed / self.turn_rate)

    @cached_property
    def laws(self) -> Mapping[str, Law]:
        """Slides, as planned and as executed."""
        return {
            "slide": Slide(self.speed, self.turn_rate),
            "glide": Glide(self.speed, self.turn_rate, acceleration=self.acceleration),
        }

    @cached_property
    def parts(self) -> tuple[Part, ...]:
        """The box, and the mast that carries the camera."""
        ahead, left = 0.5 * self.length, 0.5 * self.width
        corners = ((ahead, left), (-ahead, left), (-ahead, -left), (ahead, -left))
        mast = Part(((0.0, 0.0),), MAST_RADIUS, 0.0, self.camera_height)
        return (Part(corners, 0.0, 0.0, self.height), mast)

    @cached_property
    def mounts(self) -> Mapping[str, Mount]:
        """Its bodies: the base, and the camera on its mast."""
        return {"base": Mount(), "camera": Mount(height=self.camera_height)}

    def connect(self, a: States, b: States) -> list[Leg]:
        """One slide; where b leaves the yaw open, that of a stays."""
        to = self.space.onward(a, b)
        to = States(x=to.x, y=to.y, yaw=np.where(np.isnan(to.yaw), a.yaw, to.yaw))
        return [Leg("slide", to, self.space.apart(a, to) > STILL)]
