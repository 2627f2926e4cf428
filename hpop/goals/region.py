"""Goals in space: states of any model in which a body is within bounds, found by inverse kinematics.

Such a goal is a task space region (Berenson, Srinivasa and Kuffner 2011, doi 10.1177/0278364910396389): coordinates of
a body's pose and bounds on them. To draw a state, a point within the bounds is sampled, and an optimisation (a
"descent") moves a random state until the body is at this point.

The descent is damped least squares on the coordinates' distance to their bounds (Wampler 1986, doi
10.1109/TSMC.1986.289285). The damping is raised where a step does not help and lowered where it does (Marquardt 1963,
doi 10.1137/0111030). Columns of the Jacobian are the twists of the body at unit rates of one state variable each, so
this code knows nothing of joints. A state variable that is held at its limit is left out, and the others take over.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, Column, FloatArray
from hpop.base.math import not_radians, wrap
from hpop.base.options import FARTHEST, MOST, real
from hpop.base.randomness import RNG
from hpop.base.text import shown
from hpop.errors import QueryError
from hpop.goals.base import REACHED, GoalDefaults, checked_count
from hpop.motions import Model, Pose, States, StateSpace, Twist, collision_of
from hpop.motions.states import LazyStates

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World

STEPS = 30  # most steps of each descent
DONE = 1e-18  # square of m or rad: a descent with a smaller error has arrived
DAMPING = 1e-2  # of the first step
EASED, RAISED = 0.2, 5.0
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e6  # steps with more damping are negligible: a local optimum
APART = 1e-3  # m, in the measure of a space: nearer states count as one
DEGREE = math.radians(1)
ROUNDS = 5  # draws without a new accepted state after which no more are tried
LEAST_SEEDS = 200  # random states from which descents begin together
Place = tuple[float, float, float]


class Miss(NamedTuple):
    """Error of a body (M,): its distance outside the bounds of a region, in lengths, m, and in angles, rad."""

    metres: FloatArray
    radians: FloatArray


@dataclass(frozen=True, eq=False)
class InverseKinematics:
    """Search for states in a model's state space that put one of its bodies into a region.

    also  a second region, for its own body, that the states must be in as well; None for none. Its coordinates follow
          those of ``region`` in all arrays
    """

    model: Model
    space: StateSpace
    region: Region
    also: Region | None = None

    @cached_property
    def _regions(self) -> tuple[Region, ...]:
        return (self.region,) if self.also is None else (self.region, self.also)

    def bounds(self, rows: int) -> tuple[FloatArray, FloatArray]:
        """Return the lower and the upper bounds (rows, k) of the coordinates of all regions, equal in each row."""
        sides = zip(*(region.bounds for region in self._regions), strict=True)
        low, high = (np.tile(np.concatenate(side), (rows, 1)) for side in sides)
        return low, high

    def states(self, rows: FloatArray) -> States:
        """Convert rows (M, n), with one column per state variable, to states (M,)."""
        return States(**dict(zip(self.space.names, rows.T, strict=True)))

    def rows(self, states: States) -> FloatArray:
        """Convert states (M,) to rows (M, n), with one column per state variable."""
        return np.stack([getattr(states, name) for name in self.space.names], axis=1)

    def excess(self, states: States, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return how far (M, k), with sign, coordinates of all regions are outside bounds (M, k) or (k,); 0 inside."""
        columns = [each.coordinates(self.model.carrier.pose(each.body, states)) for each in self._regions]
        found = _stacked(tuple(chain.from_iterable(columns)), states.size)
        return found - np.clip(found, low, high)

    def miss(self, states: States) -> Miss:
        """Return how far the body is outside ``region`` in each state (M,); ``also`` does not count."""
        low, high = self.bounds(states.size)
        lengths = self.region.lengths
        excess = self.excess(states, low, high)[:, : lengths.size]
        return Miss(*(np.sqrt((excess[:, part] ** 2).sum(axis=1)) for part in (lengths, ~lengths)))

    def descend(self, rows: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return states as rows (M, n), moved step by step from given rows until coordinates are within bounds (M, k).

        The given rows stay as they are. Some states may stop at a local optimum outside the bounds.
        """
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
        return np.where(self._turning, wrap(rows), rows)

    def distinct(self, rows: FloatArray) -> FloatArray:
        """Return rows (N, n) without near repetitions: a row nearer than `APART` to an earlier row is left out."""
        from scipy.spatial import KDTree  # slow to import

        columns = []
        for name, weight, column in zip(self.space.names, self.space.weights, rows.T, strict=True):
            turning = name in self.space.turning
            columns += [weight * np.cos(column), weight * np.sin(column)] if turning else [weight * column]
        pairs = KDTree(np.stack(columns, axis=1)).query_pairs(APART, output_type="ndarray")
        kept = np.ones(len(rows), dtype=bool)
        kept[pairs.max(axis=1)] = False
        return rows[kept]

    def _step(self, jacobian: FloatArray, excess: FloatArray, damping: FloatArray) -> FloatArray:
        """Return the damped least squares steps (m, n) that reduce the excess (m, k)."""
        square = jacobian @ jacobian.transpose(0, 2, 1) + damping[:, None, None] * np.eye(excess.shape[1])
        pull = np.linalg.solve(square, excess[:, :, None])
        return -(jacobian.transpose(0, 2, 1) @ pull)[:, :, 0]

    def _jacobian(self, states: States) -> FloatArray:
        """Return the derivatives (m, k, n) of the coordinates of all regions with respect to the state variables."""
        poses = [self.model.carrier.pose(each.body, states) for each in self._regions]
        columns = []
        for name in self.space.names:
            rates = _unit_rates(states, name)
            twists = [self.model.carrier.twist(each.body, states, rates) for each in self._regions]
            parts = zip(self._regions, poses, twists, strict=True)
            each = (region.rates(pose, twist) for region, pose, twist in parts)
            columns.append(_stacked(tuple(chain.from_iterable(each)), states.size))
        return np.stack(columns, axis=2)

    @cached_property
    def _limits(self) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper limits (n,) of the state variables, infinite for angles without limits."""
        turning = self._turning
        low, high = np.array(self.space.low, float), np.array(self.space.high, float)
        return np.where(turning, -np.inf, low), np.where(turning, np.inf, high)

    @cached_property
    def _weights(self) -> FloatArray:
        """Return metres per unit of each state variable (n,), so that steps are short in the metric of the space."""
        weights = np.array(self.space.weights, float)
        return np.where(weights > 0.0, weights, 1.0)

    @cached_property
    def _turning(self) -> BoolArray:
        return np.array([name in self.space.turning for name in self.space.names], dtype=bool)


def sampled_space(model: Model, world: World) -> StateSpace:
    """Return the state space in which states are sampled: the model's, with x and y of a base limited to the map."""
    if not ({"base", "plane"} & model.provides and {"x", "y"} <= set(model.space.names)):
        return model.space
    x_min, y_min, x_max, y_max = world.bounds
    return model.space.bounded(x=(x_min, x_max), y=(y_min, y_max))


def _unit_rates(states: States, moving: str) -> States:
    """Return rates (M,) of the states: 1 per second for the variable ``moving``, 0 for the others."""

    def rate(name: str) -> Column:
        return np.full(states.size, float(name == moving))

    return LazyStates(states.names, states.size, rate, set())


def _stacked(columns: tuple[Column, ...], size: int) -> FloatArray:
    """Stack columns and numbers as (size, k)."""
    return np.stack([np.broadcast_to(np.asarray(column, float), (size,)) for column in columns], axis=1)


@checked_arguments
class Region(GoalDefaults, ABC):
    """Base class of goals that put a body within bounds: frozen dataclasses with parameters as fields.

    A goal of your own defines ``body``, ``coordinates`` of its pose, their ``rates`` and ``bounds``, and ``lengths``
    (which coordinates are in m); :func:`hpop.goals.goal` registers it.
    """

    name: ClassVar[str]

    @property
    @abstractmethod
    def body(self) -> str:
        """Name of the body in the model, such as "camera"."""

    @property
    @abstractmethod
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds (k,) of the coordinates of the body's pose; equal for an exact value.

        A pose is drawn between them, and a random state is moved until the body has this pose.
        """

    @property
    @abstractmethod
    def lengths(self) -> BoolArray:
        """Return which coordinates (k,) are in m; the others are in rad."""

    @property
    def tolerances(self) -> tuple[float, float]:
        """Largest distances outside the bounds at which the goal is still reached: of lengths, m, and angles, rad."""
        return REACHED, REACHED

    @abstractmethod
    def coordinates(self, pose: Pose) -> tuple[Column, ...]:
        """Return the k coordinates of M poses of the body that ``bounds`` limits, as columns (M,), each in m or rad."""

    @abstractmethod
    def rates(self, pose: Pose, twist: Twist) -> tuple[Column, ...]:
        """Return the rate of change (M,) of each coordinate, given the twist (velocity, rotation rate) of the body."""

    @property
    def requires(self) -> frozenset[str]:
        """Return the capability that a model must provide: the body."""
        return frozenset({self.body})

    def states(self, problem: Problem, rng: RNG, count: int) -> States:
        """Return n distinct states of the goal, with columns (n,); n is at most ``count``, less if no others are found.

        Raises QueryError if none is found, with the distance of the nearest state, or why states were not accepted.
        """
        count = checked_count(count)
        model, rng = problem.model, np.random.default_rng(rng)
        kept = collision_of(model, problem.world).kept
        sought = InverseKinematics(model, sampled_space(model, problem.world), self, kept)
        found, nearest, fruitless = np.zeros((0, len(sought.space.names))), (np.inf, np.inf), 0
        refused = 0
        while len(found) < count:
            rows = self._descend_from(sought, rng, max(count, LEAST_SEEDS))
            metres, radians = sought.miss(sought.states(rows))
            best = int(np.argmin(metres + radians))
            nearest = min(nearest, (float(metres[best]), float(radians[best])), key=sum)
            known, there = len(found), (metres <= self.tolerances[0]) & (radians <= self.tolerances[1])
            admitted = self.admitted(problem, sought.states(rows[there]))
            refused += int((~admitted).sum())
            found = sought.distinct(np.concatenate([found, rows[there][admitted]]))
            fruitless += len(found) == known
            if fruitless and (fruitless >= ROUNDS or admitted.all()):
                break
        if not len(found) and refused:
            raise QueryError(f"the goal {self} cannot be reached: {self.why_refused(refused)}")
        if not len(found):
            off = f"{nearest[0]:.2g} m and {np.degrees(nearest[1]):.2g} degrees off"
            raise QueryError(
                f"the goal {self} cannot be reached: the nearest state found is {off}; move the goal, or widen its "
                f"{', '.join(self.widened)}"
            )
        return sought.states(found[:count])

    def admitted(self, problem: Problem, states: States) -> BoolArray:
        """Return which states (N,) within the bounds are accepted in the problem's world; here all."""
        return np.ones(states.size, dtype=bool)

    def why_refused(self, count: int) -> str:
        """Return a text: why ``count`` states within the bounds are not accepted; goals that refuse add a remedy."""
        return f"{count} states within its bounds are refused"

    @property
    def widened(self) -> tuple[str, ...]:
        """Return the names of the parameters that a user can increase to make the goal easier to reach."""
        return tuple(field.name for field in fields(self) if field.name.endswith("tolerance"))  # type: ignore[arg-type]

    def _descend_from(self, sought: InverseKinematics, rng: np.random.Generator, seeds: int) -> FloatArray:
        """Return random states as rows (seeds, n), each moved to a random point within the bounds.

        States for which this fails are moved towards any point within the bounds; some may still be outside. All are
        also moved into the region that the robot must keep, if there is one.
        """
        low, high = sought.bounds(seeds)
        own = self.lengths.size
        aims = rng.uniform(low[:, :own], high[:, :own])
        least, most = (np.hstack([aims, bound[:, own:]]) for bound in (low, high))
        rows = sought.descend(sought.rows(sought.space.sample(rng, seeds)), least, most)
        if sought.also is None and np.array_equal(low, high):
            return rows
        off = np.flatnonzero(~self.reached(sought.model, sought.states(rows)))
        rows[off] = sought.descend(rows[off], low[off], high[off])
        return rows

    def reached(self, model: Model, states: States) -> BoolArray:
        """Return which states (M,) have the body within the bounds, up to the tolerances."""
        metres, radians = InverseKinematics(model, model.space, self).miss(states)
        most_metres, most_radians = self.tolerances
        return np.asarray((metres <= most_metres) & (radians <= most_radians))

    def describe(self) -> dict[str, Any]:
        """Return the name and the parameters as JSON, without parameters that are None."""
        own = [(field, getattr(self, field.name)) for field in fields(self)]  # type: ignore[arg-type]
        given = {field.name: value for field, value in own if not (value is None is field.default)}
        return {self.name: {name: list(v) if isinstance(v, tuple) else v for name, v in given.items()}}


def checked_numbers(name: str, given: Any, count: int, form: str) -> tuple[float, ...]:
    """Return ``count`` numbers as floats; raise QueryError for other values. ``form`` describes them in the message."""
    many = given.tolist() if isinstance(given, np.ndarray) else given
    if not isinstance(many, Sequence) or isinstance(many, str) or len(many) != count:
        raise QueryError(f"{name} must be {form}, got {shown(given)}")
    return tuple(float(real(name, one, -FARTHEST, FARTHEST, f"{form}, each", error=QueryError)) for one in many)


def checked_place(name: str, given: Any) -> Place:
    """Return a position (x, y, z), m; raise QueryError for other values."""
    x, y, z = checked_numbers(name, given, 3, "(x, y, z) in m")
    return x, y, z


def checked_angle(name: str, given: Any) -> float:
    """Return an angle, rad, of at most two turns; raise QueryError for other values."""
    angle = float(real(name, given, -MOST, MOST, "an angle in rad", error=QueryError))
    if advice := not_radians(angle):
        raise QueryError(f"{name} {advice}")
    return angle


def written(place: Sequence[float]) -> str:
    """Return numbers as short text for messages.

    >>> written((0.5, 0.0, 1.25))
    '(0.5, 0, 1.25)'
    """
    return f"({', '.join(f'{value:.4g}' for value in place)})"
