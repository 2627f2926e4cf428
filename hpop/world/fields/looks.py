"""Looks into fields from formulas of scalar symbols, where a field has no formula.

While a formula is written down on CasADi's scalar symbols (SX), each look into a field becomes a quadratic around a
place, and the eight numbers of the quadratic are new symbols. Whoever evaluates the formula first evaluates the places,
then asks :func:`quadratics` for these numbers: values and first and second derivatives are then exactly the field's.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hpop.world.fields.field import Field

NUMBERS = 8  # of a quadratic: place (2), value, gradient (2), curvature (3)


@dataclass(frozen=True)
class Looks:
    """The looks of one formula, in the order in which they were taken.

    fields   K
    places   K columns (2,) of SX, grid steps
    numbers  K columns (NUMBERS,) of SX
    """

    fields: list[Field] = field(default_factory=list)
    places: list[Any] = field(default_factory=list)
    numbers: list[Any] = field(default_factory=list)

    def take(self, into: Field, u: Any, v: Any) -> Any:
        """The value of a field at a place, in grid steps; all SX scalars."""
        import casadi

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
    """Collect the looks that are taken inside."""
    looks = Looks()
    token = _OPEN.set(looks)
    try:
        yield looks
    finally:
        _OPEN.reset(token)


def look(into: Field, u: Any, v: Any) -> Any:
    """The values (M, 1), SX, of a field at places (M, 1) in grid steps."""
    import casadi

    looks = _OPEN.get()
    if looks is None:
        raise TypeError("a field on scalar symbols is read inside hpop.world.fields.looks.looking()")
    return casadi.vertcat(*(looks.take(into, u[i], v[i]) for i in range(u.numel())))


def quadratics(field: Field, size: int) -> Any:
    """CasADi function from places (2, size), in grid steps inside the grid, to quadratics (NUMBERS, size).

    CasADi holds no reference to it: whoever uses it in an expression keeps it.
    """
    from hpop.world.fields._quadratics import Quadratics

    return Quadratics(field, size)
