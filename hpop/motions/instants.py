"""Moments within motions: what the rate of a criterion is a function of."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column
from hpop.base.math import norm
from hpop.errors import UnsupportedCriterion
from hpop.motions.states import LazyStates, Pose, Twist, Vector

if TYPE_CHECKING:
    from hpop.motions.laws import Model


@checked_arguments
class Instants:
    """Moments within motions: what a rate is a function of.

    ``s.camera`` and ``s.base`` are poses; ``s.twist("camera")`` says how fast a body moves and turns, and
    ``s.twist_rate("camera")`` how fast that changes; ``s.speed``, ``s.turn_rate``, ``s.acceleration`` and
    ``s.turn_acceleration`` are the base's. ``s.state`` has the states and ``s.t`` the time.

    Columns are computed when they are first read, and what was read is remembered: a rate that reads nothing that
    changes during a motion is constant, and is then evaluated once.
    """

    def __init__(
        self,
        model: Model,
        names: tuple[str, ...],
        size: int,
        t: Column,
        column: Callable[[str], Column],
        derivatives: Callable[[str], tuple[Column, Column]],
    ) -> None:
        self._model = model
        self._t = t
        self.read = read = set[str]()  # functions that refer to it, not to these moments, let them be freed at once
        self.state = LazyStates(names, size, column, read)

        def first(name: str) -> Column:
            read.add(first_derivative(name))
            return derivatives(name)[0]

        def second(name: str) -> Column:
            read.add(second_derivative(name))
            return derivatives(name)[1]

        self.rates = LazyStates(names, size, first, set())
        self.changes = LazyStates(names, size, second, set())

    @property
    def t(self) -> Column:
        """Time of each moment, s, from the start of the trajectory."""
        self.read.add("t")
        if self._t is None:
            raise UnsupportedCriterion(
                "it asks for the time, which the motions of a planner without time do not have; where people move, "
                "plan by 'lattice' or 'roadmap', which have a clock"
            )
        return self._t

    @cached_property
    def base(self) -> Pose:
        """Pose of the base."""
        return self._model.pose("base", self.state)

    @cached_property
    def camera(self) -> Pose:
        """Pose of the camera."""
        return self._model.pose("camera", self.state)

    def twist(self, body: str) -> Twist:
        """How fast a body moves, m/s, and turns, rad/s: three columns each, world frame."""
        return self._model.twist(body, self.state, self.rates)

    def twist_rate(self, body: str) -> Twist:
        """Acceleration, m/s², and angular acceleration, rad/s², of a body; a planned move begins at cruise speed."""
        return self._model.twist_rate(body, self.state, self.rates, self.changes)

    @cached_property
    def speed(self) -> Column:
        """Speed of the base, m/s: along its heading, where it has wheels (backwards it is negative)."""
        velocity = self.twist("base").velocity
        return self._along_heading(velocity) if self._on_wheels else norm(velocity)

    @cached_property
    def turn_rate(self) -> Column:
        """Yaw rate of the base, rad/s."""
        return self.twist("base").rotation[2]

    @cached_property
    def acceleration(self) -> Column:
        """Rate at which the speed of the base changes, m/s²; a planned move begins and ends at cruise speed."""
        acceleration = self.twist_rate("base").velocity
        if self._on_wheels:
            return self._along_heading(acceleration)
        along = sum(v * a for v, a in zip(self.twist("base").velocity, acceleration, strict=True))
        return np.where(self.speed > 0, along / np.where(self.speed > 0, self.speed, 1.0), 0.0)

    @cached_property
    def turn_acceleration(self) -> Column:
        """Angular acceleration of the base about the vertical, rad/s²."""
        return self.twist_rate("base").rotation[2]

    @cached_property
    def camera_velocity(self) -> tuple[Column, Column]:
        """Velocity (x, y) of the camera in the world frame, m/s."""
        return self.twist("camera").velocity[:2]

    @property
    def _on_wheels(self) -> bool:
        return "wheels" in self._model.provides

    def _along_heading(self, vector: Vector) -> Column:
        yaw = self.base.yaw
        return vector[0] * np.cos(yaw) + vector[1] * np.sin(yaw)


def first_derivative(name: str) -> str:
    """How the first derivative of a state by time is called among what a rate has read."""
    return f"{name}'"


def second_derivative(name: str) -> str:
    """How the second derivative of a state by time is called among what a rate has read."""
    return f"{name}''"


Rate = Callable[[Instants], Column]
