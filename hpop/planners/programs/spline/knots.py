"""Splines given by knots, which quadratic programs move, and the costs of their pieces.

A spline has N pieces between N + 1 knots; each piece takes a fixed share of the total time T. Let u, from 0 to 1, be
the elapsed share of T. The joints q pass through knots at given u, on a cubic Hermite curve from each knot to the next,
with slopes m = dq/du at the knots. Then speeds are q' = (dq/du) / T and accelerations are q'' = (d²q/du²) / T². So the
limits

    |dq/du| <= v T,    |d²q/du²| <= a T²

are linear in knots and slopes at any u. In T the first is linear and the second is convex, so its tangent is
conservative. The limits would not be linear in speeds and in durations of pieces, so these are no variables.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple, Protocol, cast

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.criteria.base import Criterion
from hpop.errors import UnsupportedCriterion
from hpop.motions import Curve, Model, Motions, States, is_curve
from hpop.motions.symbolic import lift
from hpop.planners.programs.nlp import on_symbols
from hpop.trajectories.trajectory import Trajectory
from hpop.world import World

LAW = "spline"
SHORT = 1e-6  # share of a motion: shorter phases have no piece


class SplineLaw(Curve, Protocol):
    """Interface of the motion law "spline" of robot models: cubic curves from knot to knot.

    names          names of the n joints
    speeds         (n,)  largest speed of each joint
    accelerations  (n,)  largest acceleration of each joint
    """

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def speeds(self) -> tuple[float, ...]: ...
    @property
    def accelerations(self) -> tuple[float, ...]: ...

    def knots(self, values: Sequence[Column], rates: Sequence[Column], clock: Column) -> States:
        """Return N states from columns of numbers or symbols: n joint values, n joint speeds, and the time, s."""


@dataclass(frozen=True, eq=False)
class Knots:
    """Spline of N cubic pieces for n joints, given by its knots.

    values    (N + 1, n)  joint values at the knots, rad or m
    slopes    (N + 1, n)  their derivatives by the share of the total time
    shares    (N,)        share of the total time that each piece takes
    duration  s           total time
    """

    values: FloatArray
    slopes: FloatArray
    shares: FloatArray
    duration: float

    @classmethod
    def along(cls, trajectory: Trajectory, law: SplineLaw, count: int, *, evenly: bool = False) -> Knots:
        """Return a spline of about ``count`` pieces through states of a trajectory, with its speeds there.

        Knots are at the borders of the phases of motions (such as speeding up and braking), and between them. With
        ``evenly``, motions are halved instead of split into phases. Straight motions with constant accelerations and
        splines keep their timing, other motions only their path. The duration is the least that the limits allow.
        """
        lasts = trajectory.durations
        motions = np.flatnonzero(lasts > 0)
        goes_on = np.array([is_curve(trajectory.model.laws[trajectory.kinds[i]]) for i in motions])
        phases = [np.full(2, 0.5 * lasts[i]) if evenly else _phases(trajectory, i) for i in motions.tolist()]
        each = np.concatenate(phases)
        pieces = np.maximum(1, np.round(count * each / lasts.sum()).astype(np.int64))
        shares = np.repeat(each / pieces, pieces) / each.sum()
        times = np.concatenate([[0.0], np.cumsum(shares)]) * lasts.sum()
        times[-1] = trajectory.duration
        states, rates = trajectory.at(times), trajectory.rates(times)[0]
        values = np.stack([getattr(states, name) for name in law.names], axis=1)
        slopes = np.stack([np.broadcast_to(getattr(rates, name), times.shape) for name in law.names], axis=1)
        slopes = slopes * trajectory.duration
        ends = np.concatenate([[0], np.cumsum(pieces)])[
            np.concatenate([[0], np.cumsum([len(phase) for phase in phases])])
        ]
        slopes[ends[:-1][~goes_on]] = slopes[ends[1:][~goes_on]] = 0.0  # at rest
        return cls(values, slopes, shares, 0.0).quickest(law)

    @property
    def secants(self) -> FloatArray:
        """Mean slope (N, n) of each piece: change of the joints divided by the share of the time."""
        return np.diff(self.values, axis=0) / self.shares[:, None]

    @property
    def bends(self) -> tuple[FloatArray, FloatArray]:
        """Second derivatives by the share of the time, (N, n) at the start and (N, n) at the end of each piece.

        They are linear between both ends.
        """
        width, secants, first, last = self.shares[:, None], self.secants, self.slopes[:-1], self.slopes[1:]
        return (6.0 * secants - 4.0 * first - 2.0 * last) / width, (-6.0 * secants + 2.0 * first + 4.0 * last) / width

    @property
    def peaks(self) -> tuple[FloatArray, FloatArray]:
        """Fraction (N, n) of each piece at which the slope of a joint is extreme, and the slope (N, n) there.

        If a slope is extreme only at the ends of the piece, the fraction is 0.5.
        """
        begin, end = self.bends
        changes = begin * end < 0
        at = np.where(changes, begin / np.where(changes, begin - end, 1.0), 0.5)
        return at, self.slopes[:-1] + self.shares[:, None] * at * (begin + 0.5 * at * (end - begin))

    def quickest(self, law: SplineLaw) -> Knots:
        """Return the same curve with the least duration that the limits of speeds and accelerations allow."""
        (begin, end), (_, peak) = self.bends, self.peaks
        speeds, accelerations = np.array(law.speeds), np.array(law.accelerations)
        by_speed = max((np.abs(slopes) / speeds).max() for slopes in (self.slopes, peak))
        by_acceleration = max((np.abs(bends) / accelerations).max() for bends in (begin, end))
        return Knots(self.values, self.slopes, self.shares, float(max(by_speed, np.sqrt(by_acceleration))))

    def within(self, low: FloatArray, high: FloatArray) -> bool:
        """Return whether the control points of all pieces, and therefore the curve, lie within limits of the joints."""
        reach = self.shares[:, None] / 3.0
        points = (self.values, self.values[:-1] + reach * self.slopes[:-1], self.values[1:] - reach * self.slopes[1:])
        return all(bool(((low <= point) & (point <= high)).all()) for point in points)

    def columns(self) -> FloatArray:
        """Return the variables on which the cost of each piece depends, as columns (4 n + 1, N).

        They are values and slopes at the start of the piece, values and slopes at its end, and the total time.
        """
        rows = (self.values[:-1].T, self.slopes[:-1].T, self.values[1:].T, self.slopes[1:].T)
        return np.concatenate([*rows, np.full((1, self.shares.size), self.duration)])

    def at(self, fraction: float) -> FloatArray:
        """Return the joint values (N, n) at a fraction (0 to 1) of each piece."""
        ends = (self.values[:-1], self.slopes[:-1], self.values[1:], self.slopes[1:])
        joints = np.zeros_like(ends[0])
        for weight, column in zip(hermite(fraction, self.shares[:, None]), ends, strict=True):
            joints += weight * column
        return joints

    def moved(self, values: FloatArray, slopes: FloatArray, law: SplineLaw) -> Knots:
        """Return the spline with inner knots and their slopes changed by (N - 1, n) each, with the least duration."""
        moved, sloped = self.values.copy(), self.slopes.copy()
        moved[1:-1] += values
        sloped[1:-1] += slopes
        return Knots(moved, sloped, self.shares, 0.0).quickest(law)

    def lasting(self, duration: float) -> Knots:
        """Return the same curve with another duration, s."""
        return replace(self, duration=duration)

    def trajectory(self, model: Model, law: SplineLaw) -> Trajectory:
        """Return the spline as a trajectory, with a motion for each piece."""
        clock = np.concatenate([[0.0], np.cumsum(self.shares)]) * self.duration
        return Trajectory(
            model, law.knots([*self.values.T], [*self.slopes.T / self.duration], clock), (LAW,) * self.shares.size
        )


def _phases(trajectory: Trajectory, motion: int) -> FloatArray:
    """Return the durations of the phases of a motion (such as speeding up), s, without negligible ones."""
    start, end = (trajectory.states.take([state]) for state in (motion, motion + 1))
    phases = trajectory.model.laws[trajectory.kinds[motion]].phases(start, end)
    seconds = np.array([np.broadcast_to(phase.duration, 1)[0] for phase in phases])
    return np.asarray(seconds[seconds > SHORT * seconds.sum()])


def hermite(fraction: Column, width: FloatArray) -> tuple[FloatArray, ...]:
    """Return the four cubic Hermite weights at a fraction (0 to 1) of pieces with given widths (shares of the time).

    They multiply value and slope at the start, and value and slope at the end of the piece, in this order.
    """
    remaining, ones = 1.0 - fraction, np.ones_like(width)
    return (
        remaining * remaining * (1.0 + 2.0 * fraction) * ones,
        fraction * remaining * remaining * width,
        fraction * fraction * (3.0 - 2.0 * fraction) * ones,
        -fraction * fraction * remaining * width,
    )


PANELS = 3  # panels into which a piece is split for the integrals of criteria


class Slopes(NamedTuple):
    """Costs of a spline and their gradients.

    costs      (k,)             of the whole spline
    gradients  (k, N, 4 n + 1)  derivatives by the variables of each piece, as :meth:`.knots.Knots.columns` lists them
    """

    costs: FloatArray
    gradients: FloatArray


class PieceCosts:
    """Functions for the costs and gradients of splines in k smooth criteria.

    CasADi functions of one piece are built once, and serve any number of pieces. The cost and gradient of a criterion
    that is a maximum are those of the worst piece.
    """

    def __init__(self, world: World, model: Model, criteria: Sequence[Criterion]) -> None:
        self.world, self.model, self.criteria = world, model, tuple(criteria)

    @classmethod
    def with_gradients(
        cls, world: World, model: Model, criteria: Sequence[Criterion]
    ) -> tuple[PieceCosts, dict[int, str]]:
        """Return cost functions for the criteria that have a gradient on symbols.

        The second value has for each criterion, by index, the reason why it has no gradient, or "".
        """
        pieces, reasons = cls(world, model, ()), dict[int, str]()
        costs = []
        for j, criterion in enumerate(criteria):
            reasons[j] = "" if criterion.smooth else "it has no gradient"
            try:
                if criterion.smooth:
                    costs.append(on_symbols(criterion, pieces._symbols[1]))
            except UnsupportedCriterion as error:
                reasons[j] = str(error)
        pieces.criteria = tuple(criteria[j] for j, reason in reasons.items() if not reason)
        pieces.__dict__["_formulas"] = costs
        return pieces, reasons

    @property
    def law(self) -> SplineLaw:
        """The law "spline" of the robot model."""
        return cast(SplineLaw, self.model.laws[LAW])

    @cached_property
    def _symbols(self) -> tuple[list[Any], Motions]:
        """Symbols for the variables and for the share of one piece, and the motion that they describe."""
        import casadi

        n = len(self.law.names)
        columns, share = casadi.SX.sym("columns", 4 * n + 1), casadi.SX.sym("share")
        numbers = casadi.vertsplit(columns)
        duration = numbers[-1]

        def knot(first: int, clock: Any) -> Any:
            values = [lift(value, 1) for value in numbers[first : first + n]]
            rates = [lift(slope / duration, 1) for slope in numbers[first + n : first + 2 * n]]
            return self.law.knots(values, rates, lift(clock, 1))

        start, end = knot(0, 0.0 * duration), knot(2 * n, share * duration)
        return [columns, share], Motions(self.world, self.model, self.law, start, end, panels=PANELS)

    @cached_property
    def _formulas(self) -> list[Any]:
        """Symbolic cost of one piece for each criterion."""
        return [on_symbols(criterion, self._symbols[1]) for criterion in self.criteria]

    @cached_property
    def _functions(self) -> dict[str, Any]:
        """CasADi functions of the variables and the share of one piece, by name.

        costs   costs (k,)
        slopes  costs (k,) and Jacobian (k, 4 n + 1)
        """
        import casadi

        symbols, costs = self._symbols[0], casadi.cse(casadi.vertcat(*self._formulas))
        jacobian = casadi.densify(casadi.jacobian(costs, symbols[0]))
        return {
            "costs": casadi.Function("costs", symbols, [costs]),
            "slopes": casadi.Function("slopes", symbols, [costs, jacobian]),
        }

    @cached_property
    def _mapped(self) -> dict[tuple[str, int], Any]:
        """Cache of functions for several pieces at once, by name and count; CasADi would build them at each call."""
        return {}

    def _at_pieces(self, name: str, count: int, *columns: FloatArray) -> Any:
        """Evaluate one of the functions, by ``name``, at ``count`` pieces, given by columns (., count)."""
        if (name, count) not in self._mapped:
            self._mapped[name, count] = self._functions[name].map(count)
        return self._mapped[name, count](*columns)

    def build(self) -> PieceCosts:
        """Build the CasADi functions now instead of at the first use."""
        _ = self._functions
        return self

    def costs(self, knots: Knots) -> FloatArray:
        """Return the costs (k,) of a spline."""
        return self._total(self._at_pieces("costs", knots.shares.size, knots.columns(), knots.shares[None]).full())

    def slopes(self, knots: Knots) -> Slopes:
        """Return the costs of a spline, and their gradients by the variables of each piece.

        These variables are the values and slopes at the start and the end of the piece, and the total time.
        """
        count, width = knots.shares.size, 4 * len(self.law.names) + 1
        costs, gradients = self._at_pieces("slopes", count, knots.columns(), knots.shares[None])
        each = costs.full()
        # The norm of a velocity has no gradient at 0; 0 is a subgradient.
        change = np.nan_to_num(gradients.full().reshape(-1, count, width))
        for j, criterion in enumerate(self.criteria):
            if criterion.aggregate == "max":
                change[j, np.arange(count) != each[j].argmax()] = 0.0
        return Slopes(self._total(each), change)

    def curvature(self, knots: Knots, weights: FloatArray, rounded: float) -> FloatArray:
        """Return the convex part of the Hessian of a weighted sum of costs for each piece, (N, 4 n + 1, 4 n + 1).

        Second derivatives are differences of gradients at points ``rounded`` apart (rad, m, or share of the greatest
        speed and of the time), so that a kink counts as a bend of that width. Negative eigenvalues are replaced by 0.
        """
        count, n, columns = knots.shares.size, len(self.law.names), knots.columns()
        width = len(columns)
        slopes = np.array(self.law.speeds) * knots.duration
        units = np.concatenate([np.ones(n), slopes, np.ones(n), slopes, [knots.duration]])
        moved = columns[:, None] + rounded * np.hstack([np.zeros((width, 1)), np.diag(units)])[:, :, None]
        many = count * (width + 1)
        result = self._at_pieces("slopes", many, moved.reshape(width, many), np.tile(knots.shares, width + 1)[None])
        each = result[0].full().reshape(-1, width + 1, count)
        gradients = np.nan_to_num(result[1].full().reshape(-1, width + 1, count, width))
        for j, criterion in enumerate(self.criteria):
            if criterion.aggregate == "max":
                gradients[j, :, np.arange(count) != each[j, 0].argmax()] = 0.0
        summed = np.tensordot(weights, gradients, axes=1)  # (width + 1, N, width)
        bends = np.moveaxis((summed[1:] - summed[0]) / rounded, 0, 1) * units  # by units in both directions
        values, vectors = np.linalg.eigh(0.5 * (bends + np.swapaxes(bends, 1, 2)))
        vectors = vectors / units[:, None]
        return np.asarray((vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2))

    def _total(self, each: FloatArray) -> FloatArray:
        """Return the costs (k,) of a spline from the costs of its pieces (k, N): their sum, or the largest."""
        worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
        return np.asarray(np.where(worst, each.max(axis=1), each.sum(axis=1)))
