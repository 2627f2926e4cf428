"""Hinges: the flat part of a worst moment such as ``(enough - d)₊``, on which a solver cannot tell where the bound is.

Where a maximum is bounded sample by sample, ``max(e, 0) <= z`` with z >= 0 says no more than ``e <= z``. The first has
no gradient on one side: of fifteen bounds on the clearance in the museum, eleven did not converge; of the second, none
failed.
"""

from __future__ import annotations

from typing import Any


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
