"""Coordinates of robots along a path, by which speed profiles are limited: distances, headings, and joints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.errors import UnsupportedModel
from hpop.models.ramps import SUFFIX, WAY, limits_of
from hpop.motions import Model, States, Wheeled
from hpop.motions.laws import CHANGE, CLOCK, PACE, SPEED
from hpop.planners.programs.spline.knots import LAW as SPLINE
from hpop.planners.programs.spline.knots import SplineLaw

DRIVE = "drive"  # kind of the law of curves of a base
STEERED = "clothoid_ramp"  # kind of the law of a car's execution, which drives clothoids at any speed
TURN_RATE = "turn_rate"
REST = 1e-6  # share of full speed below which a robot stands


class Coordinates(Protocol):
    """Coordinates (c,) of a robot along a path, and the law that can drive any speed profile along it."""

    def kind(self, executed: str) -> str:
        """Return the kind of the law that replaces an executed kind of motion, and drives it at any speed profile."""

    @property
    def unit(self) -> FloatArray:
        """Largest speed (c,) of each coordinate, by which lengths along the path are measured."""

    @property
    def joins(self) -> bool:
        """True if stretches in one straight direction become one, although the robot stands between them."""

    def rates(self, states: States, rates: States) -> FloatArray:
        """Return the rates (N, c) of the coordinates from the states (N,) and their rates."""

    def rates_of_states(self, states: States, rates: FloatArray, changes: FloatArray) -> tuple[States, States]:
        """Return first and second derivatives of the states (N,) from those of the coordinates.

        rates, changes  (N, c)  first and second derivatives of the coordinates
        """

    def knots(self, states: States, rates: FloatArray, clock: FloatArray) -> States:
        """Return states (N,) with all columns of the law, from the rates (N, c) of the coordinates and the time, s."""

    def limits(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the limits of a stretch with slopes dq/ds (N, c): rows (r, c), largest speeds and accelerations (r,).

        The combinations rows @ q of the coordinates q have these limits.
        """

    def quickening(self, states: States, rates: States, changes: States) -> FloatArray:
        """Return the factor (N,) by which motions may be faster, by limits beside `limits`, such as a steering rate.

        Below 1, motions must be slower; inf if there is no such limit.

        rates, changes  first and second derivatives of the states (N,)
        """


class Unsteered:
    """Base class of coordinates whose limits are all in ``limits``."""

    def quickening(self, states: States, rates: States, changes: States) -> FloatArray:
        return np.full(states.size, np.inf)


@dataclass(frozen=True)
class BaseCoordinates(Unsteered):
    """Distance driven, m, and heading, rad, of a base with two wheels."""

    model: Wheeled
    joins: bool = False

    def kind(self, executed: str) -> str:
        return DRIVE

    @property
    def unit(self) -> FloatArray:
        return np.array([self.model.speed, self.model.turn_rate])

    def rates(self, states: States, rates: States) -> FloatArray:
        ahead = rates.x * np.cos(states.yaw) + rates.y * np.sin(states.yaw)
        return np.stack([ahead, rates.yaw], axis=1)

    def rates_of_states(self, states: States, rates: FloatArray, changes: FloatArray) -> tuple[States, States]:
        cos, sin, (v, turn), (a, turn_change) = np.cos(states.yaw), np.sin(states.yaw), rates.T, changes.T
        zero = 0.0 * v
        first = {"x": v * cos, "y": v * sin, "yaw": turn, SPEED: a, TURN_RATE: turn_change, CLOCK: zero}
        second = {"x": a * cos - v * turn * sin, "y": a * sin + v * turn * cos, "yaw": turn_change}
        return States(**first), States(**second | dict.fromkeys((SPEED, TURN_RATE, CLOCK), zero))

    def knots(self, states: States, rates: FloatArray, clock: FloatArray) -> States:
        columns = {SPEED: rates[:, 0], TURN_RATE: rates[:, 1], CLOCK: clock}
        return States(x=states.x, y=states.y, yaw=states.yaw, **columns)

    def limits(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        model = self.model
        moves: BoolArray = np.any(np.abs(slopes) > REST * self.unit, axis=0)
        if moves.all():
            half, both = 0.5 * model.wheel_base, np.ones(2)
            rows = np.array([[1.0, -half], [1.0, half]])
            return rows, model.wheel_speed * both, model.wheel_acceleration * both
        if moves[1]:
            return np.array([[0.0, 1.0]]), np.array([model.turn_rate]), np.array([model.turn_acceleration])
        return np.array([[1.0, 0.0]]), np.array([model.speed]), np.array([model.acceleration])


@dataclass(frozen=True)
class JointCoordinates(Unsteered):
    """Joints of an arm, rad or m."""

    model: Model
    joins: bool = True

    def kind(self, executed: str) -> str:
        return SPLINE

    @property
    def law(self) -> SplineLaw:
        return cast(SplineLaw, self.model.laws[SPLINE])

    @property
    def unit(self) -> FloatArray:
        return np.array(self.law.speeds)

    def rates(self, states: States, rates: States) -> FloatArray:
        return np.stack([np.broadcast_to(getattr(rates, n), states.size) for n in self.law.names], axis=1)

    def rates_of_states(self, states: States, rates: FloatArray, changes: FloatArray) -> tuple[States, States]:
        zero = np.zeros(states.size)
        return self.law.knots([*rates.T], [*changes.T], zero), self.law.knots([*changes.T], [*0.0 * rates.T], zero)

    def knots(self, states: States, rates: FloatArray, clock: FloatArray) -> States:
        return self.law.knots([getattr(states, name) for name in self.law.names], [*rates.T], clock)

    def limits(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        return np.eye(len(self.law.names)), self.unit, np.array(self.law.accelerations)


@dataclass(frozen=True)
class MixedCoordinates(Unsteered):
    """Distance driven, m, heading, rad, and joints of a base that carries a head or an arm.

    Between two standstills, either the base moves straight ahead, or motions in place change some of the others.
    """

    model: Model
    joins: bool = True

    def kind(self, executed: str) -> str:
        name = self.model.executed
        fastest = {name.get(b, b): name.get(a, a) for pace in self.model.paces for a, b in pace.items()}
        return fastest.get(executed, executed) + SUFFIX

    @cached_property
    def _limits(self) -> dict[str, tuple[float, float]]:
        return limits_of(self.model)

    @cached_property
    def unit(self) -> FloatArray:
        return np.array([speed for speed, _ in self._limits.values()])

    def rates(self, states: States, rates: States) -> FloatArray:
        columns = {WAY: np.hypot(rates.x, rates.y)}
        rows = [np.broadcast_to(columns.get(n, getattr(rates, n, 0.0)), states.size) for n in self._limits]
        return np.stack(rows, axis=1)

    def rates_of_states(self, states: States, rates: FloatArray, changes: FloatArray) -> tuple[States, States]:
        cos, sin, names, derivatives = np.cos(states.yaw), np.sin(states.yaw), list(self._limits), list[States]()
        for columns in (rates, changes):  # nothing turns while the base moves
            named = dict(zip(names, columns.T, strict=True))
            way = named.pop(WAY)
            derivatives.append(States(**{"x": way * cos, "y": way * sin} | named))
        return derivatives[0], derivatives[1]

    def knots(self, states: States, rates: FloatArray, clock: FloatArray) -> States:
        pace = np.linalg.norm(rates / self.unit, axis=1)
        return States(**{n: getattr(states, n) for n in self.model.space.names}, **{PACE: pace, CLOCK: clock})

    def limits(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        moves: BoolArray = np.any(np.abs(slopes) > REST * self.unit, axis=0)
        accelerations = np.array([acceleration for _, acceleration in self._limits.values()])
        return np.eye(moves.size)[moves], self.unit[moves], accelerations[moves]


@dataclass(frozen=True)
class CarCoordinates(BaseCoordinates):
    """Distance driven, m, negative backwards, and heading, rad, of a car-like base."""

    model: Any  # Ackermann

    def kind(self, executed: str) -> str:
        return executed

    @property
    def unit(self) -> FloatArray:
        return np.array([self.model.speed, self.model.speed / self.model.radius])

    def knots(self, states: States, rates: FloatArray, clock: FloatArray) -> States:
        pace = np.abs(rates[:, 0]) / self.model.speed
        return States(x=states.x, y=states.y, yaw=states.yaw, **{PACE: pace, CLOCK: clock})

    def limits(self, slopes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        model = self.model
        speed = model.speed if slopes[:, 0].sum() >= 0 else model.reverse_speed
        return np.array([[1.0, 0.0]]), np.array([speed]), np.array([model.acceleration])

    def quickening(self, states: States, rates: States, changes: States) -> FloatArray:
        """Return the steering rate's limit divided by the steering rate."""
        model = self.model
        if model.steering_rate is None:
            return np.full(states.size, np.inf)
        cos, sin = np.cos(states.yaw), np.sin(states.yaw)
        v, a = rates.x * cos + rates.y * sin, changes.x * cos + changes.y * sin
        curvature, change = rates.yaw / v, (changes.yaw * v - rates.yaw * a) / v**2
        steering = model.wheelbase * np.abs(change) / (1.0 + (model.wheelbase * curvature) ** 2)
        return np.asarray(model.steering_rate / np.maximum(steering, REST))


def coordinates_of(model: Model) -> Coordinates:
    """Return the coordinates of a model; raise UnsupportedModel if no law of it leaves the speed free."""
    if SPLINE in model.laws and "spline" in model.provides:
        return JointCoordinates(model)
    if DRIVE in model.laws and {"wheels", "rigid"} <= model.provides:
        return BaseCoordinates(cast(Wheeled, model))
    if STEERED in model.laws:
        return CarCoordinates(model)
    mixed = MixedCoordinates(model)
    kinds = {mixed.kind(model.executed.get(kind, kind)) for kind in {*model.laws} - {*model.executed, CHANGE}}
    if "heading" in model.provides and {kind for kind in kinds if not kind.endswith(2 * SUFFIX)} <= {*model.laws}:
        return mixed
    raise UnsupportedModel(
        f"to retime a path, a model needs limits of its acceleration and laws with free speeds: {DRIVE} of a base "
        f"with wheels, {SPLINE} of an arm, {STEERED} of a car, or NAME{SUFFIX} for each executed law NAME of a base "
        f"with a heading. The model {model.name} has the laws {', '.join(model.laws)}; plan with a differential_drive, "
        "an ackermann, a pan_tilt or an arm"
    )
