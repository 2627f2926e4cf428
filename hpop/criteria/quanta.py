"""Quanta of one problem: at what resolution its costs are compared, where that is not what the criteria declare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from typing import Any, TypeVar

from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.criteria.base import Criterion
from hpop.errors import CriterionError, did_you_mean

FINEST = 1e-12  # in the unit; exact searches refuse what makes sums of it overflow
C = TypeVar("C", bound=Criterion)


def with_quanta(criteria: Sequence[C], quanta: Mapping[str, Any] | None) -> tuple[C, ...]:
    """Criteria that compare costs at other resolutions, by name; a mean's also by the name of what stands in for it.

    Raises CriterionError for a name that is none of theirs, what is no positive number, and another one for a count.

    >>> from hpop.criteria.comfort.length import Length
    >>> with_quanta([Length()], {"length": 0.001})[0].quantum, Length().quantum
    (0.001, 1e-06)
    """
    if not quanta:
        return tuple(criteria)
    if not isinstance(quanta, Mapping):
        raise CriterionError(
            f"quanta gives steps by the names of costs, such as {{'length': 0.01}}, got {shown(quanta)}"
        )
    stand_ins = [criterion.integral for criterion in criteria if criterion.integral is not None]
    by_name: dict[str, Criterion] = {**{c.name: c for c in criteria}, **{c.name: c for c in stand_ins}}
    for name, quantum in quanta.items():
        if name not in by_name:
            raise CriterionError(
                f"quanta has {shown(name)}, which is no cost here.{did_you_mean(name, by_name)} "
                f"These are {', '.join(by_name)}"
            )
        unit = by_name[name].unit
        real(f"the quantum of {name}", quantum, FINEST, MOST, f"a number, in {unit!r}", error=CriterionError)
        if by_name[name].quantum == 1.0 != quantum and not by_name[name].smooth:
            raise CriterionError(f"{name} is a count: its quantum is 1, got {shown(quantum)}; leave it out")
    return tuple(_with_quantum(criterion, quanta) for criterion in criteria)


def stand_in_of(mean: Criterion) -> Criterion | None:
    """What adds up in the place of a time-mean, where that names it, at the resolution that was asked for."""
    if mean.integral is None or mean.stand_in_quantum is None:
        return mean.integral
    return _set(mean.integral, "quantum", mean.stand_in_quantum)


def stated(criteria: Sequence[Criterion], quanta: Mapping[str, float]) -> str:
    """The quanta of those costs for which some were set, as the end of a certificate.

    >>> from hpop.criteria.comfort.length import Length
    >>> stated(with_quanta([Length()], {"length": 0.001}), {"length": 0.001}), stated([Length()], {})
    ('; quanta as set: length 0.001 m', '')
    """
    own = [f"{c.name} {c.quantum:g}{f' {c.unit}' if c.unit != '1' else ''}" for c in criteria if c.name in quanta]
    return f"; quanta as set: {', '.join(own)}" if own else ""


def _with_quantum(criterion: C, quanta: Mapping[str, float]) -> C:
    stand_in = criterion.integral
    if stand_in is not None and stand_in.name in quanta:
        criterion = _set(criterion, "stand_in_quantum", quanta[stand_in.name])
    return _set(criterion, "quantum", quanta[criterion.name]) if criterion.name in quanta else criterion


def _set(criterion: C, name: str, quantum: float) -> C:
    """A copy with an attribute that hides what its class declares."""
    made = copy(criterion)
    try:
        object.__setattr__(made, name, float(quantum))
    except AttributeError:
        raise CriterionError(
            f"{criterion.name} takes no other quantum, for its class {type(criterion).__name__} has slots; declare it "
            "without"
        ) from None
    return made
