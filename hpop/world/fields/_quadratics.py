"""The quadratics of a field as a CasADi function: many times as fast as three of CasADi's own splines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from hpop.runtime.limits import LimitPassed, check
from hpop.world.fields._spline import quadratics

if TYPE_CHECKING:
    from hpop.world.fields.field import Field


class Quadratics(casadi.Callback):
    """From places (2, size) to second-order expansions (8, size), see :func:`hpop.world.fields._spline.quadratics`.

    Not a number where a limit is passed: CasADi would print an error, and solvers end where nothing is a number.
    CasADi holds no reference to it: whoever uses it in an expression keeps it.
    """

    def __init__(self, field: Field, size: int) -> None:
        casadi.Callback.__init__(self)
        self._field, self._size = field, size
        self.construct("quadratics", {})

    def get_n_in(self) -> int:
        return 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, _: int) -> Any:
        return casadi.Sparsity.dense(2, self._size)

    def get_sparsity_out(self, _: int) -> Any:
        return casadi.Sparsity.dense(8, self._size)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        places = np.frombuffer(arguments[0], dtype=np.float64).reshape(self._size, 2)
        found = np.frombuffer(results[0], dtype=np.float64).reshape(self._size, 8)
        try:
            check("a field was read")
            coefficients = self._field.coefficients_at(*places.T)
        except LimitPassed:
            found[:] = np.nan
        else:
            quadratics(coefficients, places, found)
        return 0
