"""Inverse kinematics: states in which a body is where a region wants it, for many at once, of any model.

Damped least squares on the coordinates' distance to their bounds (Wampler 1986, doi 10.1109/TSMC.1986.289285), the
damping raised where a step does not help and lowered where it does (Marquardt 1963, doi 10.1137/0111030). Columns of
the Jacobian are the twists of the body at unit rates of one state each, so nothing is known here of joints. Where a
limit holds a state, its column is left out and the others take over.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import wrap
from hpop.motions import Model, States, StateSpace
from hpop.motions.states import LazyStates

if TYPE_CHECKING:
    from hpop.goals.region import Region
    from hpop.world import World

STEPS = 30  # of each descent
DONE = 1e-18  # square of m or rad: no more is left to do
DAMPING = 1e-2  # of the first step
EASED, RAISED = 0.2, 5.0
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e6  # a step with more is nothing: the best near by is found
APART = 1e-3  # m, as far as spaces measure: states nearer to each other are one


class Miss(NamedTuple):
    """By how much bodies (M,) are beyond the bounds of a region, m and rad."""

    metres: FloatArray
    radians: FloatArray


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """States of a space in which a model's body comes into a region."""

    model: Model
    space: StateSpace
    region: Region

    def states(self, rows: FloatArray) -> States:
        """States (M,) of rows (M, n)."""
        return States(**dict(zip(self.space.names, rows.T, strict=True)))

    def rows(self, states: States) -> FloatArray:
        """Rows (M, n) of states."""
        return np.stack([getattr(states, name) for name in self.space.names], axis=1)

    def excess(self, states: States, low: FloatArray, high: FloatArray) -> FloatArray:
        """By how much coordinates (M, k) are beyond bounds (M, k) or (k,), signed."""
        pose = self.model.pose(self.region.body, states)
        found = _stacked(self.region.coordinates(pose), states.size)
        return found - np.clip(found, low, high)

    def miss(self, states: States) -> Miss:
        """By how much each state (M,) misses the region."""
        low, high = self.region.bounds
        excess, lengths = self.excess(states, low, high), self.region.lengths
        return Miss(*(np.sqrt((excess[:, part] ** 2).sum(axis=1)) for part in (lengths, ~lengths)))

    def descended(self, rows: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Rows (M, n) from others, their coordinates as near to bounds (M, k) as a descent finds them."""
        least, most = self._limits
        rows, damping = rows.copy(), np.full(len(rows), DAMPING)
        excess = self.excess(self.states(rows), low, high)
        cost = (excess**2).sum(axis=1)
        going = np.flatnonzero(cost > DONE)
        for _ in range(STEPS):
            if not going.size:
                break
            here, left = rows[going], excess[going]
            jacobian = self._jacobian(self.states(here)) / self._weights
            jacobian[(left == 0.0) & (low < high)[going]] = 0.0  # within its bounds
            downhill = -np.einsum("mkn,mk->mn", jacobian, left)
            held = ((here <= least) & (downhill < 0.0)) | ((here >= most) & (downhill > 0.0))
            jacobian.transpose(0, 2, 1)[held] = 0.0
            step = self._step(jacobian, left, damping[going]) / self._weights
            there = np.clip(here + step, least, most)
            found = self.excess(self.states(there), low[going], high[going])
            better = (costs := (found**2).sum(axis=1)) < cost[going]
            took = going[better]
            rows[took], excess[took], cost[took] = there[better], found[better], costs[better]
            damping[going] = np.maximum(damping[going] * np.where(better, EASED, RAISED), LEAST_DAMPING)
            going = going[(cost[going] > DONE) & (damping[going] < MOST_DAMPING)]
        return self._wrapped(rows)

    def distinct(self, rows: FloatArray) -> FloatArray:
        """Rows (N, n) without those that are an earlier one again."""
        from scipy.spatial import KDTree  # on first use

        columns = []
        for name, weight, column in zip(self.space.names, self.space.weights, rows.T, strict=True):
            turning = name in self.space.turning
            columns += [weight * np.cos(column), weight * np.sin(column)] if turning else [weight * column]
        pairs = KDTree(np.stack(columns, axis=1)).query_pairs(APART, output_type="ndarray")
        kept = np.ones(len(rows), dtype=bool)
        kept[pairs.max(axis=1)] = False
        return rows[kept]

    def _step(self, jacobian: FloatArray, excess: FloatArray, damping: FloatArray) -> FloatArray:
        """Damped least squares steps (m, n) against what is left (m, k)."""
        square = jacobian @ jacobian.transpose(0, 2, 1) + damping[:, None, None] * np.eye(excess.shape[1])
        pull = np.linalg.solve(square, excess[:, :, None])
        return -(jacobian.transpose(0, 2, 1) @ pull)[:, :, 0]

    def _jacobian(self, states: States) -> FloatArray:
        """How fast the coordinates (m, k, n) change with each state."""
        pose = self.model.pose(self.region.body, states)
        columns = []
        for name in self.space.names:
            twist = self.model.twist(self.region.body, states, _unit_rates(states, name))
            columns.append(_stacked(self.region.rates(pose, twist), states.size))
        return np.stack(columns, axis=2)

    @cached_property
    def _limits(self) -> tuple[FloatArray, FloatArray]:
        """What states may be: anything where they turn."""
        turning = self._turning
        low, high = np.array(self.space.low, float), np.array(self.space.high, float)
        return np.where(turning, -np.inf, low), np.where(turning, np.inf, high)

    @cached_property
    def _weights(self) -> FloatArray:
        """Metres a unit of each state: steps are no longer than needed in the space's own measure."""
        weights = np.array(self.space.weights, float)
        return np.where(weights > 0.0, weights, 1.0)

    @cached_property
    def _turning(self) -> BoolArray:
        return np.array([name in self.space.turning for name in self.space.names], dtype=bool)

    def _wrapped(self, rows: FloatArray) -> FloatArray:
        return np.where(self._turning, wrap(rows), rows)


def sampled_space(model: Model, world: World) -> StateSpace:
    """The space in which states of a model are sought: of a base that x and y place, within the bounds of the world."""
    if not ({"base", "plane"} & model.provides and {"x", "y"} <= set(model.space.names)):
        return model.space
    x_min, y_min, x_max, y_max = world.bounds
    return model.space.bounded(x=(x_min, x_max), y=(y_min, y_max))


def _unit_rates(states: States, moving: str) -> States:
    """One state changes by 1 a second, the others stay."""

    def rate(name: str) -> Column:
        return np.full(states.size, float(name == moving))

    return LazyStates(states.names, states.size, rate, set())


def _stacked(columns: tuple[Column, ...], size: int) -> FloatArray:
    """Columns (size, k) of columns and numbers."""
    return np.stack([np.broadcast_to(np.asarray(column, float), (size,)) for column in columns], axis=1)
