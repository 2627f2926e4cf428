"""What the pieces of a spline cost, and how that changes with their knots: criteria on symbols, one piece for all."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.errors import UnsupportedCriterion
from hpop.motions import Model, Motions
from hpop.motions.symbolic import lift
from hpop.planners.programs.criteria import on_symbols
from hpop.planners.programs.spline.knots import LAW, Knots, SplineLaw
from hpop.world import World

PANELS = 3  # of a piece, for what criteria integrate


class Slopes(NamedTuple):
    """Costs and how they change.

    costs      (k,)
    gradients  (k, N, 4 n + 1)  by what each piece depends on (:meth:`.knots.Knots.columns`)
    """

    costs: FloatArray
    gradients: FloatArray


class Pieces:
    """Costs of the pieces of splines in k criteria with gradients; built once, for splines of any number of pieces.

    A criterion that takes the worst moment costs the worst of its pieces; its gradient is that of this piece.
    """

    def __init__(self, world: World, model: Model, criteria: Sequence[Criterion]) -> None:
        self.world, self.model, self.criteria = world, model, tuple(criteria)

    @classmethod
    def with_gradients(cls, world: World, model: Model, criteria: Sequence[Criterion]) -> tuple[Pieces, dict[int, str]]:
        """Pieces in those criteria that have a gradient, and why each, by its place, has none; "" where it has one."""
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
        pieces.__dict__["_written"] = costs
        return pieces, reasons

    @property
    def law(self) -> SplineLaw:
        """The model's law."""
        return cast(SplineLaw, self.model.laws[LAW])

    @cached_property
    def _symbols(self) -> tuple[list[Any], Motions]:
        """The columns of a piece and its share, and the motion that they are."""
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
    def _written(self) -> list[Any]:
        """Costs of a piece, one a criterion, in its symbols."""
        return [on_symbols(criterion, self._symbols[1]) for criterion in self.criteria]

    @cached_property
    def _functions(self) -> tuple[Any, Any]:
        """Costs of a piece, and those with their Jacobian, as CasADi functions of its columns and its share."""
        import casadi

        symbols, costs = self._symbols[0], casadi.vertcat(*self._written)
        jacobian = casadi.densify(casadi.jacobian(costs, symbols[0]))
        return casadi.Function("costs", symbols, [costs]), casadi.Function("slopes", symbols, [costs, jacobian])

    def build(self) -> Pieces:
        """Build the functions now."""
        _ = self._functions
        return self

    def costs(self, knots: Knots) -> FloatArray:
        """Costs (k,) of a spline."""
        return self._total(self._functions[0].map(knots.shares.size)(knots.columns(), knots.shares[None]).full())

    def slopes(self, knots: Knots) -> Slopes:
        """Costs of a spline and how they change."""
        count, width = knots.shares.size, 4 * len(self.law.names) + 1
        costs, gradients = self._functions[1].map(count)(knots.columns(), knots.shares[None])
        each = costs.full()
        # The norm of what does not move has no gradient; 0 is a subgradient.
        change = np.nan_to_num(gradients.full().reshape(-1, count, width))
        for j, criterion in enumerate(self.criteria):
            if criterion.aggregate == "max":
                change[j, np.arange(count) != each[j].argmax()] = 0.0
        return Slopes(self._total(each), change)

    def _total(self, each: FloatArray) -> FloatArray:
        """Costs (k,) from those of the pieces (k, N)."""
        worst = np.array([criterion.aggregate == "max" for criterion in self.criteria])
        return np.asarray(np.where(worst, each.max(axis=1), each.sum(axis=1)))
