"""Motions whose states are CasADi symbols, so that criteria can be used inside nonlinear programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from hpop.base.arrays import Column, FloatArray
from hpop.base.symbols import lift
from hpop.motions.batch import Motions
from hpop.motions.states import States

__all__ = ["SymbolicMotions", "lift", "sparse_lookup"]


def sparse_lookup(quadratics: Any, size: int) -> Any:
    """Return a CasADi function that looks up a field at many positions, with sparse derivatives.

    It takes positions (2, size) and returns values (1, size). Each value depends on its own position only, so the
    Hessian is block-diagonal. CasADi by itself would treat it as dense; the Hessian of a polyline of 12 segments then
    takes twice the time.

    quadratics  function from positions (2, size) to second-order expansions (8, size) of the field; see
                :mod:`hpop.world.fields.symbols`
    """
    table, column = casadi.MX.sym("table", 2, size), np.arange(size)
    _, _, value, *rest = casadi.vertsplit(quadratics(table))
    slopes, (second, mixed, other) = casadi.vertcat(*rest[:2]), rest[2:]
    starts = 2 * np.arange(2 * size + 1)
    within = 2 * column.repeat(4) + np.tile(np.arange(2), 2 * size)
    blocks = casadi.Sparsity(2 * size, 2 * size, starts.tolist(), within.tolist())
    lines = casadi.Sparsity(size, 2 * size, list(range(2 * size + 1)), column.repeat(2).tolist())

    def with_jacobian(name: str, values: Any, sparsity: Any, entries: Any) -> Any:
        nominal: Any = casadi.MX.sym("nominal", *values.shape)
        inputs: list[Any] = [table, nominal]
        outputs: list[Any] = [casadi.MX(sparsity, casadi.vec(entries))]
        jacobian = casadi.Function(f"jac_{name}", inputs, outputs, ["i0", "out_o0"], ["jac_o0_i0"])
        options: dict[str, Any] = {"enable_forward": False, "enable_reverse": False, "custom_jacobian": jacobian}
        options["never_inline"] = True  # otherwise CasADi inlines the function and loses the custom Jacobian
        return casadi.Function(name, [table], [values], ["i0"], ["o0"], options)

    gradient = with_jacobian("gradient", slopes, blocks, casadi.vertcat(second, mixed, mixed, other))
    return with_jacobian("lookup", value, lines, gradient(table))


@dataclass(frozen=True, eq=False)
class SymbolicMotions:
    """Batch of motions whose start and end states are CasADi symbols.

    vector   all symbols as one MX vector: first the columns of the start states, then those of the end states
    motions  the batch of motions on these symbols
    point    (2 k M,) for k state columns: the numbers for which the symbols stand, in the order of ``vector``
    """

    vector: Any
    motions: Motions
    point: FloatArray

    @classmethod
    def of(cls, motions: Motions) -> SymbolicMotions:
        """Return a copy of a numeric batch, with symbols in place of the numbers of its states."""
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
        """Return a CasADi function of the symbols: its values are a column (M,), such as a cost, and its Jacobian."""
        expression = casadi.MX(column) if not isinstance(column, np.ndarray) else casadi.MX(casadi.DM(column))
        return casadi.Function("f", [self.vector], [expression, casadi.jacobian(expression, self.vector)])

    def values_and_jacobian(self, column: Column) -> tuple[FloatArray, FloatArray]:
        """Return the numeric value (M,) of a symbolic column and its Jacobian (M, 2 k M) at ``point``."""
        value, jacobian = self.function(column)(self.point)
        return np.array(value).ravel(), np.array(jacobian)
