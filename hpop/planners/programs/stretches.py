"""Path of a trajectory, cut into stretches between standstills, each on a grid of path positions.

Let q be the coordinates of a robot: the distance driven and the heading of a base, and the joints that it carries; or
the joints of an arm. A stretch has a path coordinate s, which grows by the length of dq with each coordinate divided by
its largest speed. So the unit of s is the second, and ds/dt is about 1 at full speed. Between two neighbouring grid
positions, dq/ds is quadratic in s.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.errors import OptionError, UnsupportedModel
from hpop.models.ramps import SUFFIX, WAY, limits_of
from hpop.motions import HOLD, Model, States, Wheeled, is_curve, laws_of
from hpop.motions.laws import CHANGE, CLOCK, PACE, SPEED
from hpop.planners.programs.spline.knots import LAW as SPLINE
from hpop.planners.programs.spline.knots import SplineLaw
from hpop.trajectories.trajectory import Trajectory

DRIVE = "drive"  # kind of the law of curves of a base
TURN_RATE = "turn_rate"
INTERVAL, FEWEST, MOST = 0.1, 16, 400  # s: length of a grid interval at the input's speed; intervals in each phase
CURVED = 600  # intervals in all motions of a stretch of curves
REST = 1e-6  # share of full speed below which a robot stands
BEFORE = 1e-7  # share of an interval: how long before a grid position its rates may be taken
STRAIGHT = 1e-9  # difference of unit directions that is a rounding error
PARALLEL = 1e-6  # difference of unit directions that counts as none


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


@dataclass(frozen=True)
class BaseCoordinates:
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
class JointCoordinates:
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
class MixedCoordinates:
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


def coordinates_of(model: Model) -> Coordinates:
    """Return the coordinates of a model; raise UnsupportedModel if no law of it leaves the speed free."""
    if SPLINE in model.laws and "spline" in model.provides:
        return JointCoordinates(model)
    if DRIVE in model.laws and {"wheels", "rigid"} <= model.provides:
        return BaseCoordinates(cast(Wheeled, model))
    mixed = MixedCoordinates(model)
    kinds = {mixed.kind(model.executed.get(kind, kind)) for kind in {*model.laws} - {*model.executed, CHANGE}}
    if "heading" in model.provides and {kind for kind in kinds if not kind.endswith(2 * SUFFIX)} <= {*model.laws}:
        return mixed
    raise UnsupportedModel(
        f"to retime a path, a model needs limits of its acceleration and laws with free speeds: {DRIVE} of a base "
        f"with wheels, {SPLINE} of an arm, or NAME{SUFFIX} for each executed law NAME of a base with a heading. The "
        f"model {model.name} has the laws {', '.join(model.laws)}; plan with a differential_drive, a pan_tilt or an arm"
    )


@dataclass(frozen=True, eq=False)
class PathStretch:
    """Part of a path between two standstills, on a grid of n + 1 positions.

    kind           kind of the motion law that drives the stretch at any speed profile, such as "drive" or "spline"
    steps          (n,)           differences of the path coordinate s, all positive
    states         (n+1,)         states of the model
    slopes         (n+1, c)       dq/ds
    bends          (2, n, c)      d²q/ds² at the start and at the end of each interval, linear between them
    pace           (n+1,)         ds/dt of the trajectory from which the stretch was made, 0 at both ends
    middle         (n,)           states in the middles of the intervals
    rows           (r, c)         combinations rows @ q of the coordinates that have limits
    speeds         (r,)           their largest speeds
    accelerations  (r,)           their largest accelerations
    """

    kind: str
    steps: FloatArray
    states: States
    slopes: FloatArray
    bends: FloatArray
    pace: FloatArray
    middle: States
    rows: FloatArray
    speeds: FloatArray
    accelerations: FloatArray

    @property
    def in_middle(self) -> tuple[FloatArray, FloatArray]:
        """Slopes and bends (n, c) in the middles of the intervals."""
        turn = np.diff(self.bends, axis=0)[0] * self.steps[:, None] / 8.0
        return 0.5 * (self.slopes[1:] + self.slopes[:-1]) - turn, 0.5 * self.bends.sum(axis=0)

    def followed_by(self, other: PathStretch) -> PathStretch:
        """Return both stretches as one; the other one must begin at the end of this one, in its direction."""
        names = self.states.names
        joined = {n: np.concatenate([getattr(self.states, n), getattr(other.states, n)[1:]]) for n in names}
        middle = {n: np.concatenate([getattr(self.middle, n), getattr(other.middle, n)]) for n in names}
        steps = np.concatenate([self.steps, other.steps])
        slopes = np.concatenate([self.slopes, other.slopes[1:]])
        bends = np.concatenate([self.bends, other.bends], axis=1)
        limits = (self.rows, self.speeds, self.accelerations)
        pace = np.concatenate([self.pace, other.pace[1:]])
        pace[self.steps.size] = 0.5 * (pace[self.steps.size - 1] + pace[self.steps.size + 1])
        return PathStretch(self.kind, steps, States(**joined), slopes, bends, pace, States(**middle), *limits)

    def continues(self, before: PathStretch) -> bool:
        """Return whether the robot need not stand between stretch ``before`` and this one.

        This holds if both are straight and have the same direction.
        """
        if before.kind != self.kind or before.bends.any() or self.bends.any():
            return False
        return float(np.abs(before.slopes[-1] - self.slopes[0]).max()) < PARALLEL * float(np.abs(self.slopes[0]).max())


def stretches_of(run: Trajectory, coordinates: Coordinates) -> list[PathStretch | float]:
    """Return, in order of time, the stretches of an executed trajectory and, as floats, the seconds of its holds.

    coordinates  coordinates of the robot, by which standstills are found and lengths are measured

    If ``coordinates.joins``, stretches in one straight direction without a hold between them become one: for example,
    reaches of an arm.
    """
    parts: list[PathStretch | float] = []
    motions: list[int] = []
    lasts = run.durations
    for i, kind in enumerate(run.kinds):
        if lasts[i] <= 0.0:
            continue
        if kind == HOLD.kind:
            parts.append(float(lasts[i]))
            continue
        motions.append(i)
        if i + 1 < len(run) and not _stands(run, run.times[i + 1], coordinates) and run.kinds[i + 1] != HOLD.kind:
            continue
        stretch = _stretch(run, motions, coordinates)
        motions = []
        before = parts[-1] if parts else None
        if coordinates.joins and isinstance(before, PathStretch) and stretch.continues(before):
            parts[-1] = before.followed_by(stretch)
        else:
            parts.append(stretch)
    return parts


def _stands(run: Trajectory, t: float, coordinates: Coordinates) -> bool:
    """Return whether the robot stands at time t, s."""
    return bool(np.abs(coordinates.rates(run.at(t), run.rates(t)[0]) / coordinates.unit).max() < REST)


def _stretch(run: Trajectory, motions: Sequence[int], coordinates: Coordinates) -> PathStretch:
    """Return the stretch of some motions, on a grid with the borders of all their phases."""
    times = _grid(run, motions)
    middles = 0.5 * (times[1:] + times[:-1])
    states, middle = run.at(times), run.at(middles)
    rates, between = (
        coordinates.rates(s, run.rates(t)[0]) / coordinates.unit for s, t in ((states, times), (middle, middles))
    )
    rates[[0, -1]] = 0.0  # at the end, `rates` are those of the next motion
    unknown = np.flatnonzero(~rates.any(axis=1))[1:-1]  # in a phase of no duration, between speed-up and slow-down
    if unknown.size:
        before = times[unknown] - BEFORE * np.diff(times)[unknown - 1]
        rates[unknown] = coordinates.rates(run.at(before), run.rates(before)[0]) / coordinates.unit
    pace, within = np.linalg.norm(rates, axis=1), np.linalg.norm(between, axis=1)
    steps = np.diff(times) * (pace[:-1] + 4.0 * within + pace[1:]) / 6.0  # Simpson's rule
    if (steps <= 0.0).any() or (pace[1:-1] < REST).any():
        raise OptionError(
            f"the robot stands somewhere within motions {motions[0]} to {motions[-1]} of the trajectory, so its path "
            "has no direction there; split the motion at that place"
        )
    half = np.diff(times) * (5.0 * pace[:-1] + 8.0 * within - pace[1:]) / 24.0 / steps  # share of a step at its middle
    slopes, halfway = np.zeros_like(rates), between / within[:, None]
    slopes[1:-1] = rates[1:-1] / pace[1:-1, None]
    slopes[0] = halfway[0] - (slopes[1] - halfway[0]) * half[0] / (1.0 - half[0])  # at rest: linear
    slopes[-1] = halfway[-1] + (halfway[-1] - slopes[-2]) * (1.0 - half[-1]) / half[-1]
    if np.abs(slopes - slopes[1]).max() < STRAIGHT:
        slopes[:] = slopes[1]
        bends = np.zeros((2, steps.size, slopes.shape[1]))
    else:  # of the quadratic through both ends and the middle
        first = (halfway - slopes[:-1]) / (half * steps)[:, None]
        last = (slopes[1:] - halfway) / ((1.0 - half) * steps)[:, None]
        third = (last - first) / steps[:, None]
        bends = np.stack([first - third * (half * steps)[:, None], last + third * ((1.0 - half) * steps)[:, None]])
    unit = coordinates.unit
    slopes, bends = slopes * unit, bends * unit
    kind = coordinates.kind(run.kinds[motions[0]])
    return PathStretch(kind, steps, states, slopes, bends, pace, middle, *coordinates.limits(slopes))


def _grid(run: Trajectory, motions: Sequence[int]) -> FloatArray:
    """Return times, s, that cut each phase of some motions (given by index) evenly; they become grid positions."""
    laws = laws_of(run.model)
    fewest = CURVED // len(motions) if is_curve(laws[run.kinds[motions[0]]]) else FEWEST
    pieces = [run.times[motions[0] : motions[0] + 1]]
    for i in motions:
        start, end = run.states.take([i]), run.states.take([i + 1])
        begin = float(run.times[i])
        for phase in laws[run.kinds[i]].phases(start, end):
            lasts = float(np.ravel(phase.duration)[0])
            if lasts > REST * run.durations[i]:
                count = int(np.clip(np.ceil(lasts / INTERVAL), max(fewest, FEWEST), MOST))
                pieces.append(begin + lasts * np.arange(1, count + 1) / count)
                begin += lasts
        pieces[-1][-1] = run.times[i + 1]
    return np.concatenate(pieces)
