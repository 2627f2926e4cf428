"""Fields in CasADi formulas: each evaluation becomes a quadratic, whose coefficients a CasADi function computes.

While a formula is built from CasADi's scalar symbols (SX), each evaluation of a field becomes a quadratic expansion
about a point, with eight new symbols: the point and the coefficients. To evaluate the formula, first compute the
points, then let :class:`Quadratics` compute the coefficients there. Then the value and its first and second derivatives
equal those of the field.
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

if TYPE_CHECKING:
    from hpop.world.fields.field import Field

NUMBERS = 8  # of a quadratic: point (2), value, gradient (2), curvature (3)


@dataclass(frozen=True)
class Looks:
    """Record of the K evaluations of fields in one formula, in order.

    fields   the field of each evaluation
    places   the point (2,) of each, SX expressions in grid steps
    numbers  the symbols (NUMBERS,) of each quadratic, SX
    """

    fields: list[Field] = field(default_factory=list)
    places: list[Any] = field(default_factory=list)
    numbers: list[Any] = field(default_factory=list)

    def take(self, into: Field, u: Any, v: Any) -> Any:
        """Record an evaluation at (u, v), in grid steps, and return its value: a quadratic with new SX symbols."""
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
    """Open a context; the record that it yields gets all evaluations of fields with scalar symbols (SX) inside it."""
    looks = Looks()
    token = _OPEN.set(looks)
    try:
        yield looks
    finally:
        _OPEN.reset(token)


def look(into: Field, u: Any, v: Any) -> Any:
    """Return the values (M, 1), SX, of a field at points (M, 1) in grid steps."""
    looks = _OPEN.get()
    if looks is None:
        raise TypeError(
            "a field can be evaluated with scalar CasADi symbols (SX) only inside the context "
            "hpop.world.fields.symbols.looking(); use that, or MX symbols"
        )
    return casadi.vertcat(*(looks.take(into, u[i], v[i]) for i in range(u.numel())))


class Quadratics(casadi.Callback):
    """CasADi function from points (2, size), in grid steps, to quadratic expansions of a field (NUMBERS, size).

    It is much faster than three CasADi splines; see :func:`hpop.world.fields._kernels.quadratics`. When the time or
    memory limit of the plan is exceeded, it returns NaN, on which solvers stop; an exception would only make CasADi
    print an error. CasADi does not keep the function alive: keep a reference as long as an expression uses it.
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
            self._field.quadratics(places, found)
        except LimitPassed:
            found[:] = np.nan
        return 0
