"""Worlds, laws and motions for nonlinear programs: sparse derivatives, smooth timing, maxima bounded by samples.

Only programs use these; fronts have the exact costs of the exact laws.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.math import instead_of_hinges, is_symbolic
from hpop.errors import OptionError
from hpop.models.rigid import PlanarLaw
from hpop.motions import LawDefaults, Motions, Phase, Rate, States
from hpop.motions.symbolic import lift, sparse_lookup
from hpop.runtime.interrupts import interrupts_held
from hpop.world import World
from hpop.world.fields.field import Field, GridPoints
from hpop.world.fields.symbols import Quadratics
from hpop.world.ground import WHOLE, Heights

ROUNDING = 0.02  # rad: below this angle the timing of turns is smoothed


def require_ipopt(planner: str) -> None:
    """Raise OptionError if this installation of CasADi does not have IPOPT."""
    import casadi

    if not casadi.has_nlpsol("ipopt"):
        raise OptionError(
            f"{planner} needs the solver IPOPT, which this installation of CasADi does not have; install CasADi's own "
            "wheel (pip install --force-reinstall casadi), or use planner 'lattice'"
        )


def vector(column: Column, size: int) -> Any:
    """Return a column of numbers, or of symbols (SX, MX), as a CasADi vector (size,)."""
    import casadi

    if isinstance(column, int | float | np.ndarray | np.generic):
        return casadi.DM(np.broadcast_to(np.asarray(column, float), (size,)).copy())
    return casadi.vec(column.to_casadi() if hasattr(column, "to_casadi") else column)


class SparseField(Field):
    """Field with sparse symbolic derivatives, sampled only at the positions that the symbols read."""

    @classmethod
    def of(cls, field: Field) -> Field:
        """Return a field with the same samples."""
        sparse = object.__new__(cls)
        sparse.__dict__.update({**field.__dict__, "_field": field, "_lookups": {}})
        return sparse

    def __call__(self, x: Column, y: Column) -> Column:
        """Return the values at positions, which are numbers or symbols."""
        return self._field(x, y) if not (is_symbolic(x) or is_symbolic(y)) else super().__call__(x, y)

    @property
    def _field(self) -> Field:
        field: Field = self.__dict__["_field"]
        return field

    @property
    def values(self) -> FloatArray:
        """All samples (H, W)."""
        return self._field.values

    def coefficients_at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """Return the coefficients of the field (:meth:`hpop.world.fields.field.Field.coefficients_at`)."""
        return self._field.coefficients_at(u, v)

    def at(self, places: GridPoints) -> Any:
        if places.points is None:
            return super().at(places)
        size, lookups = places.u.numel(), self.__dict__["_lookups"]
        with interrupts_held():
            if size not in lookups:  # stored, as CasADi holds no reference to Python callbacks
                callback = Quadratics(self._field, size)
                lookups[size] = sparse_lookup(callback, size), callback
            return lift(lookups[size][0](places.points).T, places.shape)


class SparseWorld(World):
    """World with sparse fields for nonlinear programs.

    It stores the fields, which their symbols need, so the owner of a program must keep this world.
    """

    def clearance_field(self, *, z: Heights = WHOLE) -> Field:
        return self._sparse(("clearance", self.ground.layer(z)), World.clearance_field(self, z=z))

    def obstruction_field(self, radius: float, z: float = 0.0) -> Field:
        return self._sparse(("obstruction", radius, z), World.obstruction_field(self, radius, z))

    def _sparse(self, key: tuple[Any, ...], field: Field) -> Field:
        fields: dict[tuple[Any, ...], Field] = self.__dict__.setdefault("_sparse_fields", {})
        if key not in fields:
            fields[key] = SparseField.of(field)
        return fields[key]


@dataclass(frozen=True)
class SmoothedTurn(LawDefaults):
    """Law of turns with the timing of ``sqrt(θ² + ROUNDING²)`` instead of |θ|.

    A turn from rest to rest lasts 2 sqrt(|θ|/α). At the cusp of this function, at small angles, solvers get stuck.
    """

    exact: PlanarLaw

    @property
    def kind(self) -> str:
        return self.exact.kind

    @property
    def varies(self) -> frozenset[str]:
        return self.exact.varies

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        turned = end.yaw - start.yaw
        yaw = start.yaw + np.sqrt(turned * turned + ROUNDING**2)
        return self.exact.phases(start, States(x=end.x, y=end.y, yaw=yaw))

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        return self.exact.interpolate(name, start, end, share)

    def travel(self, start: States, end: States, lever: Column) -> Column:
        return self.exact.travel(start, end, lever)

    def turned(self, start: States, end: States) -> Column:
        return self.exact.turned(start, end)


@dataclass(frozen=True, eq=False)
class _Moment(Motions):
    """Motions with a maximum evaluated at one moment only, so that a slack can bound each sample."""

    phase: int = 0
    at: float = 0.0

    def worst(self, rate: Rate, *, detail: float | None = None) -> Column:
        """Return the rate (M,) at that moment."""
        return rate(self._instants(self.phases[self.phase], self.at, None))


def moments(motions: Motions) -> list[Motions]:
    """Return copies of motions that evaluate a maximum at the ends and the middle of each phase."""
    m = motions
    return [
        _Moment(m.world, m.model, m.law, m.start, m.end, panels=m.panels, phase=phase, at=at)
        for phase in range(len(m.phases))
        for at in (0.0, 0.5, 1.0)
    ]


# A hinge ``max(x, 0)`` in an integral, as in ``∫ (|α| - threshold)₊ dt``, with which the cost rises, is replaced by a
# slack variable that is at least x and at least 0; minimising presses it onto the larger. A criterion permits this by
# :func:`hpop.base.math.hinge`.
#
# Where a maximum is bounded sample by sample, ``max(e, 0) <= z`` with z >= 0 is equivalent to ``e <= z``. The first has
# no gradient on one side: in the museum 11 of 15 bounds on the clearance did not converge; with the second, all did.


@dataclass(frozen=True)
class Slacks:
    """Slack variables in place of the hinges of formulas of scalar symbols (SX), in the order of the formulas.

    symbols  K slack variables
    below    K scalars x: each slack is to be at least x and at least 0
    """

    symbols: list[Any] = field(default_factory=list)
    below: list[Any] = field(default_factory=list)

    def take(self, column: Column) -> Column:
        """Return slack variables that replace the hinges of a column (M,)."""
        import casadi

        below = casadi.vec(column.to_casadi())
        symbols = casadi.SX.sym("slack", below.numel())
        self.symbols.extend(casadi.vertsplit(symbols))
        self.below.extend(casadi.vertsplit(below))
        return lift(symbols, below.numel())


@contextmanager
def slackened() -> Iterator[Slacks]:
    """Replace the hinges of formulas in this context by slack variables, and collect them."""
    slacks = Slacks()
    token = instead_of_hinges.set(slacks.take)
    try:
        yield slacks
    finally:
        instead_of_hinges.reset(token)


def below_hinge(column: Any) -> Any:
    """Return e, as a column, if a CasADi vector is ``max(e, 0)``; return any other vector unchanged.

    >>> import casadi
    >>> x = casadi.MX.sym("x", 3)
    >>> below_hinge(casadi.fmax(1 - x, 0)), below_hinge(casadi.sin(x))
    (MX((ones(3x1)-x)), MX(sin(x)))
    """
    import casadi

    op, shape = column.op(), column.shape
    if op in (casadi.OP_RESHAPE, casadi.OP_TRANSPOSE) and 1 in column.dep(0).shape:
        return casadi.vec(below_hinge(column.dep(0)))
    if op == casadi.OP_IF_ELSE_ZERO:
        below = below_hinge(column.dep(1))
        return casadi.if_else(column.dep(0), below, 0.0) if below.shape == column.dep(0).shape else column
    if op == casadi.OP_FMAX:
        for zero, inner in ((0, 1), (1, 0)):
            if column.dep(zero).is_zero() and column.dep(inner).shape == shape:
                return column.dep(inner)
    return column
