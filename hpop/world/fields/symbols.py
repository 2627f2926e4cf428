"""Fields in CasADi formulas: a look into a field becomes a quadratic, and a CasADi function gives its numbers.

While a formula is written on CasADi's scalar symbols (SX), each look into a field becomes a quadratic round a place,
and the eight numbers of the quadratic are new symbols. To evaluate the formula, evaluate the places first, and pass
them to :class:`Quadratics` for these numbers. Values and first and second derivatives are then exactly the field's.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from hpop.runtime.interrupts import interrupts_held
from hpop.runtime.limits import LimitPassed, check
from hpop.world.fields import _kernels

if TYPE_CHECKING:
    from hpop.world.fields.field import Field

NUMBERS = 8  # of a quadratic: place (2), value, gradient (2), curvature (3)


@dataclass(frozen=True)
class Looks:
    """Looks of one formula into fields, in the order in which they were taken.

    fields   K
    places   K columns (2,) of SX, grid steps
    numbers  K columns (NUMBERS,) of SX
    """

    fields: list[Field] = field(default_factory=list)
    places: list[Any] = field(default_factory=list)
    numbers: list[Any] = field(default_factory=list)

    def take(self, into: Field, u: Any, v: Any) -> Any:
        """Return the value of a field at a place, in grid steps; all are SX scalars."""
        number = casadi.SX.sym("look", NUMBERS)
        self.fields.append(into)
        self.places.append(casadi.vertcat(u, v))
        self.numbers.append(number)
        at_u, at_v, value, gu, gv, huu, huv, hvv = casadi.vertsplit(number)
        du, dv = u - at_u, v - at_v
        return value + gu * du + gv * dv + 0.5 * (huu * du * du + hvv * dv * dv) + huv * du * dv


_OPEN: ContextVar[Looks | None] = ContextVar("looks", default=None)


@contextmanager
def looking() -> Iterator[Looks]:
    """Collect the looks that are taken inside the context."""
    looks = Looks()
    token = _OPEN.set(looks)
    try:
        yield looks
    finally:
        _OPEN.reset(token)


def look(into: Field, u: Any, v: Any) -> Any:
    """Return the values (M, 1), SX, of a field at places (M, 1) in grid steps."""
    looks = _OPEN.get()
    if looks is None:
        raise TypeError("a field on scalar symbols is read inside hpop.world.fields.symbols.looking()")
    return casadi.vertcat(*(looks.take(into, u[i], v[i]) for i in range(u.numel())))


class Quadratics(casadi.Callback):
    """CasADi function from places (2, size), in grid steps, to quadratics (NUMBERS, size).

    Many times as fast as three of CasADi's own splines; see :func:`hpop.world.fields._kernels.quadratics`. The result
    is not a number where a limit is passed: CasADi would print an error, and solvers end where nothing is a number.
    CasADi holds no reference to the function: keep it as long as an expression uses it.
    """

    def __init__(self, field: Field, size: int) -> None:
        casadi.Callback.__init__(self)
        self._field, self._size = field, size
        with interrupts_held():
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
            _kernels.quadratics(coefficients, places, found)
        return 0
