"""Moments within motions: what the rate of a criterion is a function of."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.arrays import Column
from hpop.errors import UnsupportedCriterion
from hpop.motions.states import LazyStates, Pose

if TYPE_CHECKING:
    from hpop.motions.batch import Motions


class Instants:
    """Moments within motions: what a rate is a function of.

    ``s.camera`` and ``s.base`` are poses; ``s.speed``, ``s.turn_rate``, ``s.acceleration``, ``s.turn_acceleration`` and
    ``s.camera_velocity`` say how fast they change; ``s.state`` has the states and ``s.t`` the time.

    Columns are computed when they are first read, and what was read is remembered: a rate that reads nothing that
    changes during a motion is constant, and is then evaluated once.
    """

    def __init__(
        self,
        motions: Motions,
        size: int,
        t: Column,
        column: Callable[[str], Column],
        derivatives: Callable[[str], tuple[Column, Column]],
    ) -> None:
        self._motions = motions
        self._t = t
        self._derivatives = derivatives
        self.read: set[str] = set()
        self.state = LazyStates(motions.start.names, size, column, self.read)

    @property
    def t(self) -> Column:
        """Time of each moment, s, from the start of the trajectory."""
        self.read.add("t")
        if self._motions.t0 is None:
            raise UnsupportedCriterion("it asks for the time, which edges of a graph without time do not have")
        return self._t

    @cached_property
    def base(self) -> Pose:
        """Pose of the base."""
        return self._motions.model.pose("base", self.state)

    @cached_property
    def camera(self) -> Pose:
        """Pose of the camera."""
        return self._motions.model.pose("camera", self.state)

    @cached_property
    def speed(self) -> Column:
        """Speed of the base along its heading, m/s."""
        return self._ahead(0)

    @cached_property
    def turn_rate(self) -> Column:
        """Yaw rate, rad/s."""
        return self._derivative("yaw", 0)

    @cached_property
    def acceleration(self) -> Column:
        """Acceleration of the base along its heading, m/s²; a planned move begins and ends at cruise speed."""
        return self._ahead(1)

    @cached_property
    def turn_acceleration(self) -> Column:
        """Angular acceleration, rad/s²."""
        return self._derivative("yaw", 1)

    @cached_property
    def camera_velocity(self) -> tuple[Column, Column]:
        """Velocity (x, y) of the camera in the world frame, m/s."""
        return self.velocity(self.camera)

    def velocity(self, body: Pose) -> tuple[Column, Column]:
        """Velocity (x, y) of a body that is rigidly mounted on the base, m/s, world frame."""
        x, y, rate = (self._derivative(name, 0) for name in ("x", "y", "yaw"))
        return x - rate * (body.y - self.base.y), y + rate * (body.x - self.base.x)

    def _ahead(self, order: int) -> Column:
        yaw = self.base.yaw
        return self._derivative("x", order) * np.cos(yaw) + self._derivative("y", order) * np.sin(yaw)

    def _derivative(self, name: str, order: int) -> Column:
        self.read.add("velocity")
        return self._derivatives(name)[order]


Rate = Callable[[Instants], Column]
