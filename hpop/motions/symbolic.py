"""Motions on CasADi symbols: the same criteria, inside nonlinear programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from hpop.arrays import Column, FloatArray
from hpop.motions import Motions, States
from hpop.symbols import lift

__all__ = ["SymbolicMotions", "elementwise", "lift"]


def elementwise(function: Any, size: int) -> Any:
    """``function.map(size)`` of a CasADi function of d numbers, (d, size) -> (1, size), whose derivatives stay sparse.

    They are given as block-diagonal matrices, each block evaluated once. CasADi by itself takes products of mapped
    functions for dense: the Hessian of a polyline of 12 segments then costs twice the time.
    """
    import casadi

    d = function.numel_in(0)
    one = casadi.MX.sym("one", d)
    second, first = casadi.hessian(function(one), one)
    slopes = casadi.Function("slopes", [one], [casadi.densify(first)]).map(size)
    curvatures = casadi.Function("curvatures", [one], [casadi.vec(casadi.densify(second))]).map(size)
    table, column = casadi.MX.sym("table", d, size), np.arange(size)
    starts = d * np.arange(d * size + 1)
    within = d * column.repeat(d * d) + np.tile(np.arange(d), d * size)
    blocks = casadi.Sparsity(d * size, d * size, starts.tolist(), within.tolist())
    lines = casadi.Sparsity(size, d * size, list(range(d * size + 1)), column.repeat(d).tolist())

    def with_jacobian(name: str, values: Any, sparsity: Any, entries: Any) -> Any:
        nominal: Any = casadi.MX.sym("nominal", *values.shape)
        inputs: list[Any] = [table, nominal]
        outputs: list[Any] = [casadi.MX(sparsity, casadi.vec(entries))]
        jacobian = casadi.Function(f"jac_{name}", inputs, outputs, ["i0", "out_o0"], ["jac_o0_i0"])
        options: dict[str, Any] = {"enable_forward": False, "enable_reverse": False, "custom_jacobian": jacobian}
        return casadi.Function(name, [table], [values], ["i0"], ["o0"], options)

    gradient = with_jacobian("gradient", slopes(table), blocks, curvatures(table))
    return with_jacobian("each", function.map(size)(table), lines, gradient(table))


@dataclass(frozen=True, eq=False)
class SymbolicMotions:
    """A batch of motions whose start and end states are symbols.

    vector   MX of all states, start columns then end columns, in the order of their names
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

        names, size = motions.start.names, len(motions)
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
            turns=motions.turns,
        )
        return cls(vector, symbolic, np.concatenate(numbers))

    def function(self, column: Column) -> Any:
        """CasADi function of numbers for the symbols: a column (M,) computed from them, and its Jacobian."""
        import casadi

        expression = casadi.MX(column) if not isinstance(column, np.ndarray) else casadi.MX(casadi.DM(column))
        return casadi.Function("f", [self.vector], [expression, casadi.jacobian(expression, self.vector)])

    def values_and_jacobian(self, column: Column) -> tuple[FloatArray, FloatArray]:
        """A column (M,) computed from the symbols, and its Jacobian (M, 2 * states * M), at the numbers."""
        value, jacobian = self.function(column)(self.point)
        return np.array(value).ravel(), np.array(jacobian)
