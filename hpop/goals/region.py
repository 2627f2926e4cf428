"""Goals in space: states in which a body is within bounds, found by inverse kinematics, of any model.

A task space region of Berenson, Srinivasa and Kuffner 2011 (doi 10.1177/0278364910396389): coordinates of a body's pose
and bounds on them, from which states are drawn by sampling the bounds and descending to each sample.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import not_radians
from hpop.base.options import FARTHEST, MOST, real
from hpop.base.randomness import RNG
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.base import REACHED, GoalDefaults, checked_count
from hpop.goals.inverse_kinematics import InverseKinematics, sampled_space
from hpop.motions import Model, Pose, States, Twist

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

DEGREE = math.radians(1)
LEAST_SEEDS = 200  # random states from which a descent begins, at once
Place = tuple[float, float, float]


@checked_arguments
class Region(GoalDefaults, ABC):
    """A body within bounds: a frozen dataclass, whose fields are its parameters, gives what is abstract here.

    A goal of your own needs ``body``, ``coordinates`` of its pose, their ``rates`` and ``bounds``;
    :func:`hpop.goals.goal` registers it.
    """

    name: ClassVar[str]

    @property
    @abstractmethod
    def body(self) -> str:
        """The body, as the model calls it."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Between what coordinates (k,) shall be; equal where a value is wanted. States are drawn within these."""

    @property
    @abstractmethod
    def lengths(self) -> BoolArray:
        """Which coordinates (k,) are in m; the others are in rad."""

    @property
    def tolerances(self) -> tuple[float, float]:
        """By how much a state that reaches the goal may be beyond the bounds, m and rad."""
        return REACHED, REACHED

    @abstractmethod
    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Columns, k of them, m or rad, of a pose of the body."""

    @abstractmethod
    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """How fast each of them changes, given how fast the body moves and turns."""

    @property
    def requires(self) -> frozenset[str]:
        """The body."""
        return frozenset({self.body})

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Distinct states (n,), at most ``count``, fewer where descents from ever new random states find no others.

        Raises QueryError, which says how far the nearest is off, where none is found.
        """
        count = checked_count(count)
        model, rng = problem.model, np.random.default_rng(rng)
        sought = InverseKinematics(model, sampled_space(model, problem.world), self)
        found, nearest = np.zeros((0, len(sought.space.names))), (np.inf, np.inf)
        while len(found) < count:
            rows = self._descended(sought, rng, max(count, LEAST_SEEDS))
            metres, radians = sought.miss(sought.states(rows))
            best = int(np.argmin(metres + radians))
            nearest = min(nearest, (float(metres[best]), float(radians[best])), key=sum)
            known, there = len(found), (metres <= self.tolerances[0]) & (radians <= self.tolerances[1])
            found = sought.distinct(np.concatenate([found, rows[there]]))
            if len(found) == known:
                break
        if not len(found):
            off = f"{nearest[0]:.2g} m and {np.degrees(nearest[1]):.2g} degrees off"
            raise QueryError(
                f"the goal {self} cannot be reached: the nearest state that was found is {off}; move it, or widen its "
                f"{', '.join(self.widened)}"
            )
        return sought.states(found[:count])

    @property
    def widened(self) -> tuple[str, ...]:
        """Names of the parameters that leave it more room."""
        return tuple(field.name for field in fields(self) if field.name.endswith("tolerance"))  # type: ignore[arg-type]

    def _descended(self, sought: InverseKinematics, rng: np.random.Generator, seeds: int) -> FloatArray:
        """Rows (seeds, n) that descend to samples of the bounds; those that do not get there, to any point of these."""
        low, high = (np.broadcast_to(bound, (seeds, len(bound))) for bound in self.bounds)
        aims = rng.uniform(low, high)
        rows = sought.descended(sought.rows(sought.space.sample(rng, seeds)), aims, aims)
        if np.array_equal(low, high):
            return rows
        off = np.flatnonzero(~self.reached(sought.model, sought.states(rows)))
        rows[off] = sought.descended(rows[off], low[off], high[off])
        return rows

    def reached(self, model: Model, states: States) -> BoolArray:
        """Which states (M,) have the body within the bounds and their tolerances."""
        metres, radians = InverseKinematics(model, model.space, self).miss(states)
        most_metres, most_radians = self.tolerances
        return np.asarray((metres <= most_metres) & (radians <= most_radians))

    def describe(self) -> dict[str, Any]:
        """Name and parameters, without those that are not given."""
        own = [(field, getattr(self, field.name)) for field in fields(self)]  # type: ignore[arg-type]
        given = {field.name: value for field, value in own if not (value is None is field.default)}
        return {self.name: {name: list(v) if isinstance(v, tuple) else v for name, v in given.items()}}


def checked_numbers(name: str, given: Any, count: int, form: str) -> tuple[float, ...]:
    """So many coordinates, or a QueryError that says what they are."""
    many = given.tolist() if isinstance(given, np.ndarray) else given
    if not isinstance(many, Sequence) or isinstance(many, str) or len(many) != count:
        raise QueryError(f"{name} is {form}, got {shown(given)}")
    return tuple(float(real(name, one, -FARTHEST, FARTHEST, f"{form}, each", error=QueryError)) for one in many)


def checked_place(name: str, given: Any) -> Place:
    """Three coordinates, m."""
    x, y, z = checked_numbers(name, given, 3, "(x, y, z) in m")
    return x, y, z


def checked_angle(name: str, given: Any) -> float:
    """An angle in rad, within two turns."""
    angle = float(real(name, given, -MOST, MOST, "an angle in rad", error=QueryError))
    if advice := not_radians(angle):
        raise QueryError(f"{name} {advice}")
    return angle


def written(place: Sequence[float]) -> str:
    """Numbers in few characters.

    >>> written((0.5, 0.0, 1.25))
    '(0.5, 0, 1.25)'
    """
    return f"({', '.join(f'{value:.4g}' for value in place)})"
