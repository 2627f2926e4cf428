"""Hinges ``max(x, 0)`` in nonlinear programs, where no solver that takes derivatives finds an end at the kink.

Where one is summed up, as in ``∫ (|α| - threshold)₊ dt``, and the cost rises with it, a variable lies above x and above
0 instead: the solver presses it onto one of them. So a criterion says that it may, by :func:`hpop.base.math.hinge`.

Where a maximum is bounded sample by sample, ``max(e, 0) <= z`` with z >= 0 says no more than ``e <= z``. The first has
no gradient on one side: of fifteen bounds on the clearance in the museum, eleven did not converge; of the second, none
failed.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from hpop.base.arrays import Column
from hpop.base.math import instead_of_hinges
from hpop.motions.symbolic import lift


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
