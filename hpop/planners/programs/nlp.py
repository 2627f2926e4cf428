"""What a nonlinear program needs of worlds, laws and motions: sparse derivatives, no cusps, maxima sample by sample.

Numbers never see any of this: fronts hold the exact costs of the exact laws.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

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

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ROUNDING = 0.02  # rad: the time of smaller turns is not believed


def require_ipopt(planner: str) -> None:
    """Raise OptionError where CasADi came without its solver."""
    import casadi

    if not casadi.has_nlpsol("ipopt"):
        raise OptionError(
            f"{planner} needs the solver IPOPT, which this installation of CasADi does not have; install CasADi's own "
            "wheel (pip install --force-reinstall casadi), or use planner 'lattice'"
        )


def vector(column: Column, size: int) -> Any:
    """A column of numbers, or of symbols (SX, MX), as a CasADi vector (size,)."""
    import casadi

    if isinstance(column, int | float | np.ndarray | np.generic):
        return casadi.DM(np.broadcast_to(np.asarray(column, float), (size,)).copy())
    return casadi.vec(column.to_casadi() if hasattr(column, "to_casadi") else column)


def reaches(problem: Problem) -> tuple[tuple[Heights, float], ...]:
    """Height ranges that see different obstacles, each with the largest reach of the robot's parts there, m."""
    found: dict[int, tuple[Heights, float]] = {}
    for part in problem.model.platform:
        z = (part.z_min, part.z_max)
        key = id(problem.world.free_space(z))
        found[key] = max(found.get(key, (z, 0.0)), (z, part.reach), key=lambda item: item[1])
    return tuple(found.values())


class SparseField(Field):
    """A field whose symbols have sparse derivatives and read it where they are: the rest of it is not even sampled."""

    @classmethod
    def of(cls, field: Field) -> Field:
        """The same samples."""
        sparse = object.__new__(cls)
        sparse.__dict__.update({**field.__dict__, "_field": field, "_lookups": {}})
        return sparse

    def __call__(self, x: Column, y: Column) -> Column:
        """The field itself at numbers."""
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
        """See the field."""
        return self._field.coefficients_at(u, v)

    def at(self, places: GridPoints) -> Any:
        if places.points is None:
            return super().at(places)
        size, lookups = places.u.numel(), self.__dict__["_lookups"]
        with interrupts_held():
            if size not in lookups:  # kept: CasADi holds no reference to what it calls in Python
                callback = Quadratics(self._field, size)
                lookups[size] = sparse_lookup(callback, size), callback
            return lift(lookups[size][0](places.points).T, places.shape)


class SparseWorld(World):
    """The same world, with fields that suit nonlinear programs.

    It keeps them itself, as their symbols need them: whoever has a program of these keeps this world.
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
class Rounded(LawDefaults):
    """A law of turns whose timing is that of ``sqrt(θ² + ROUNDING²)`` instead of |θ|.

    A turn from rest to rest lasts 2 sqrt(|θ|/α): no solver likes that cusp, and vertices where hardly a turn is left
    would be stuck on it.
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
    """Motions whose worst moment is looked for at one moment only, so that a slack can lie above each."""

    phase: int = 0
    at: float = 0.0

    def worst(self, rate: Rate, *, detail: float | None = None) -> Column:
        """The rate (M,) at that moment."""
        return rate(self._instants(self.phases[self.phase], self.at, None))


def moments(motions: Motions) -> list[Motions]:
    """The same motions seen at both ends and in the middle of each of their phases."""
    m = motions
    return [
        _Moment(m.world, m.model, m.law, m.start, m.end, panels=m.panels, phase=phase, at=at)
        for phase in range(len(m.phases))
        for at in (0.0, 0.5, 1.0)
    ]


# Where one is summed up, as in ``∫ (|α| - threshold)₊ dt``, and the cost rises with it, a variable lies above x and
# above 0 instead: the solver presses it onto one of them. So a criterion says that it may, by
# :func:`hpop.base.math.hinge`.
#
# Where a maximum is bounded sample by sample, ``max(e, 0) <= z`` with z >= 0 says no more than ``e <= z``. The first
# has no gradient on one side: of fifteen bounds on the clearance in the museum, eleven did not converge; of the second,
# none failed.


@dataclass(frozen=True)
class Slacks:
    """The hinges of formulas of scalar symbols (SX), in the order in which they were written.

    symbols  K scalars in their places
    below    K scalars x, one of the two that the symbol is to be above; the other is 0
    """

    symbols: list[Any] = field(default_factory=list)
    below: list[Any] = field(default_factory=list)

    def take(self, column: Column) -> Column:
        """Symbols in the place of the hinge of a column (M,)."""
        import casadi

        below = casadi.vec(column.to_casadi())
        symbols = casadi.SX.sym("slack", below.numel())
        self.symbols.extend(casadi.vertsplit(symbols))
        self.below.extend(casadi.vertsplit(below))
        return lift(symbols, below.numel())


@contextmanager
def slackened() -> Iterator[Slacks]:
    """Collect the hinges that are written inside."""
    slacks = Slacks()
    token = instead_of_hinges.set(slacks.take)
    try:
        yield slacks
    finally:
        instead_of_hinges.reset(token)


def unhinged(column: Any) -> Any:
    """What stands below the hinge of a CasADi vector ``max(e, 0)``: e, as a column; any other vector is returned.

    >>> import casadi
    >>> x = casadi.MX.sym("x", 3)
    >>> unhinged(casadi.fmax(1 - x, 0)), unhinged(casadi.sin(x))
    (MX((ones(3x1)-x)), MX(sin(x)))
    """
    import casadi

    op, shape = column.op(), column.shape
    if op in (casadi.OP_RESHAPE, casadi.OP_TRANSPOSE) and 1 in column.dep(0).shape:
        return casadi.vec(unhinged(column.dep(0)))
    if op == casadi.OP_IF_ELSE_ZERO:
        below = unhinged(column.dep(1))
        return casadi.if_else(column.dep(0), below, 0.0) if below.shape == column.dep(0).shape else column
    if op == casadi.OP_FMAX:
        for zero, rest in ((0, 1), (1, 0)):
            if column.dep(zero).is_zero() and column.dep(rest).shape == shape:
                return column.dep(rest)
    return column
