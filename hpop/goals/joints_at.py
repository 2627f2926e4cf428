"""Goal of joints at given values, each within a tolerance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST, Angle, real
from hpop.base.randomness import RNG
from hpop.base.text import shown
from hpop.errors import QueryError, did_you_mean
from hpop.goals.base import REACHED, GoalDefaults, checked_count, goal
from hpop.goals.region import InverseKinematics, Region, sampled_space
from hpop.motions import Model, States, collision_of
from hpop.motions.states import StateSpace

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@goal("joints_at")
@dataclass(frozen=True)
class JointsAt(GoalDefaults):
    """Goal of joints at given values, each within a tolerance; joints that are not named may have any value.

    values     rad or m  value of each joint, by name
    tolerance  rad or m  largest difference from the value: one number for all joints, or by name one for each
    """

    name: ClassVar[str]

    values: dict[str, Angle]
    tolerance: Angle | dict[str, Angle] = 0.01

    def __post_init__(self) -> None:
        if not isinstance(self.values, Mapping) or not self.values:
            raise QueryError(f"values must map joints to values, as {{'elbow': 0.5}}, got {shown(self.values)}")
        kind = "a value in rad or m"
        values = {
            name: float(real(f"values of {name}", value, -MOST, MOST, kind, error=QueryError))
            for name, value in self.values.items()
        }
        object.__setattr__(self, "values", values)
        given = self.tolerance
        if isinstance(given, Mapping):
            if set(given) != set(values):
                raise QueryError(
                    f"tolerance must be one number, or name each joint of values ({', '.join(values)}), got "
                    f"{shown(given)}"
                )
            checked: Any = {name: self._checked(f"tolerance of {name}", given[name]) for name in values}
        else:
            checked = self._checked("tolerance", given)
        object.__setattr__(self, "tolerance", checked)

    @staticmethod
    def _checked(name: str, value: Any) -> float:
        return float(real(name, value, 0, MOST, "rad or m", error=QueryError))

    def __str__(self) -> str:
        """Return the values with their tolerances as short text for messages."""
        each = (f"{name} {value:.4g} ± {self._tolerance(name):.4g}" for name, value in self.values.items())
        return f"joints_at {', '.join(each)}"

    @property
    def requires(self) -> frozenset[str]:
        """Return the capability that a model must provide: joints."""
        return frozenset({"joints"})

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Return at most ``count`` states (n,): first one at the values themselves, then others within the tolerances.

        If the robot must keep an orientation, states are moved within the tolerances until they keep it, if possible.
        Raises QueryError for an unknown joint, and for a value that is beyond its joint's limits by over the tolerance.
        """
        count, rng = checked_count(count), np.random.default_rng(rng)
        space = sampled_space(problem.model, problem.world)
        low, high = self._bounds(space)
        drawn = space.sample(rng, count)
        columns = {name: getattr(drawn, name) for name in space.names}
        for name, value in self.values.items():
            some: FloatArray = rng.uniform(low[name], high[name], count)
            some[:1] = min(max(value, low[name]), high[name])
            columns[name] = some
        if (kept := collision_of(problem.model, problem.world).kept) is not None:
            columns = self._inside(problem.model, space.bounded(**{n: (low[n], high[n]) for n in low}), kept, columns)
        rows = np.unique(np.stack(list(columns.values()), axis=1), axis=0, return_index=True)[1]
        return States(**{name: column[np.sort(rows)] for name, column in columns.items()})

    def _inside(
        self, model: Model, space: StateSpace, kept: Region, columns: dict[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Move states towards those with the orientation that the problem requires, and return their columns.

        ``kept`` is the region of states with this orientation. States stay within the limits in ``space``. A state that
        would leave the tolerances of the goal is not moved. Some returned states may still be outside the region.
        """
        sought = InverseKinematics(model, space, kept)
        given = States(**columns)
        moved = sought.states(sought.descend(sought.rows(given), *sought.bounds(given.size)))
        return {n: np.where(self.reached(model, moved), getattr(moved, n), column) for n, column in columns.items()}

    def reached(self, model: Model, states: States) -> BoolArray:
        """Return which states (M,) have all named joints within their tolerances, up to 1e-6 rad or m."""
        self._bounds(model.space)
        open_state = States(**{name: np.array([self.values.get(name, np.nan)]) for name in model.space.names})
        found = np.ones(states.size, dtype=bool)
        for name, off in model.space.differences(open_state, states).items():
            if name in self.values:
                found &= np.abs(off) <= self._tolerance(name) + REACHED
        return found

    def describe(self) -> dict[str, Any]:
        """Return name and parameters as JSON."""
        tolerance = dict(self.tolerance) if isinstance(self.tolerance, Mapping) else self.tolerance
        return {self.name: {"values": dict(self.values), "tolerance": tolerance}}

    def _tolerance(self, name: str) -> float:
        return float(self.tolerance[name] if isinstance(self.tolerance, Mapping) else self.tolerance)

    def _bounds(self, space: StateSpace) -> tuple[dict[str, float], dict[str, float]]:
        """Return the lowest and highest value of each named joint; raise QueryError for one that cannot be reached."""
        low, high = {}, {}
        for name, value in self.values.items():
            if name not in space.names:
                hint = did_you_mean(name, space.names)
                raise QueryError(
                    f"values must name joints of the robot, got {shown(name)}.{hint} Name {', '.join(space.names)}"
                )
            index, tolerance = space.names.index(name), self._tolerance(name)
            low[name], high[name] = value - tolerance, value + tolerance
            if name not in space.turning:
                low[name], high[name] = max(low[name], space.low[index]), min(high[name], space.high[index])
            if low[name] > high[name]:
                raise QueryError(
                    f"the goal {self} cannot be reached: {name} is limited to {space.low[index]:.4g} to "
                    f"{space.high[index]:.4g}; give a value between these, or a larger tolerance"
                )
        return low, high
