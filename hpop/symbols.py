"""Motions on CasADi symbols: the same criteria, inside nonlinear programs.

CasADi's array interface is young, so all that touches it is here; see the docstring of :func:`lift`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.arrays import Column, FloatArray
from hpop.motions import Motions, States


def lift(vector: Any, size: int) -> Column:
    """A CasADi vector (size,) as a column that NumPy functions accept.

    Works in CasADi's default mode; ``setNumpyMode`` is process-wide and stays untouched.
    """
    import casadi

    return casadi.ArrayInterface.MX(vector, shape=(size,))


@dataclass(frozen=True, eq=False)
class SymbolicMotions:
    """A batch of motions whose start and end states are symbols.

    vector   MX of all states, start columns then end columns, in the model's order
    motions  the batch on those symbols
    point    (2 * states * M,) the numbers that the symbols stand for
    """

    vector: Any
    motions: Motions
    point: FloatArray

    @classmethod
    def of(cls, motions: Motions) -> SymbolicMotions:
        """Symbols in place of the states of a numeric batch."""
        import casadi

        names, size = motions.model.state_names, len(motions)
        numbers = [getattr(states, name) for states in (motions.start, motions.end) for name in names]
        vector = casadi.MX.sym("states", 2 * len(names) * size)
        columns = [lift(part, size) for part in casadi.vertsplit(vector, size)]
        start, end = columns[: len(names)], columns[len(names) :]
        symbolic = Motions(
            motions.world,
            motions.model,
            motions.law,
            States(**dict(zip(names, start, strict=True))),
            States(**dict(zip(names, end, strict=True))),
            t0=motions.t0,
            panels=motions.panels,
        )
        return cls(vector, symbolic, np.concatenate(numbers))

    def values_and_jacobian(self, column: Column) -> tuple[FloatArray, FloatArray]:
        """A column (M,) computed from the symbols, and its Jacobian (M, 2 * states * M), at the numbers."""
        import casadi

        expression = casadi.MX(column) if not isinstance(column, np.ndarray) else casadi.MX(casadi.DM(column))
        function = casadi.Function("f", [self.vector], [expression, casadi.jacobian(expression, self.vector)])
        value, jacobian = function(self.point)
        return np.array(value).ravel(), np.array(jacobian)
