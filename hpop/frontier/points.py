"""Points of a front: checked values, names and origins, and the errors of the package."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.scalars import python_value
from hpop.base.text import shown
from hpop.frontier.dominance import FloatArray, cost_matrix
from hpop.frontier.strict_json import plain

T = TypeVar("T")


class FrontError(ValueError):
    """Fronts that cannot be joined, or a choice without meaning."""


class UnknownColumnError(FrontError, LookupError):
    """The front has no criterion or reported value of this name."""


class FrontFileError(FrontError):
    """A front cannot be written as JSON, or a file does not hold one."""


def names_of(costs: ArrayLike, names: Sequence[str] | None, *, letter: str = "f") -> tuple[str, ...]:
    """Return the names of the columns: as given, those of a table of pandas, or "f1", "f2", ...

    >>> names_of([[1.0, 2.0]], None)
    ('f1', 'f2')
    """
    if names is not None:
        return (names,) if isinstance(names, str) else tuple(names)
    columns = getattr(costs, "columns", None)
    if columns is not None:
        return tuple(str(name) for name in columns)
    return tuple(f"{letter}{j + 1}" for j in range(cost_matrix(costs).shape[1]))


def minimised(
    matrix: FloatArray, names: tuple[str, ...], maximise: Sequence[str] | Sequence[bool]
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return costs and names with the columns to maximise negated: minus the value, under its name with a minus.

    >>> minimised(np.array([[1.0, 2.0]]), ("length", "view"), ["view"])
    (array([[ 1., -2.]]), ('length', '-view'))
    """
    given: Any = [maximise] if isinstance(maximise, str) else maximise
    try:
        values = [python_value(one) for one in given]
        flags = values if all(isinstance(one, bool) for one in values) else None
    except TypeError:
        flags, given = None, [maximise]
    if flags is None:
        strange = [one for one in given if one not in names]
        if strange:
            raise FrontError(
                f"maximise has names of costs, or a bool for each of {', '.join(names)}, got {shown(maximise)}"
            )
        flags = [name in given for name in names]
    if flags and len(flags) != len(names):
        raise FrontError(f"maximise has {len(flags)} bools for the {len(names)} costs {', '.join(names)}")
    if not any(flags):
        return matrix, names
    sign = np.where(flags, -1.0, 1.0)
    turned = tuple(f"-{name}" if flag else name for name, flag in zip(names, flags, strict=True))
    return matrix * sign + 0.0, turned


def floats(values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Copy as float64, with -0.0 as 0.0; an empty array takes the expected shape."""
    array = np.array(values, dtype=np.float64) + 0.0
    return array.reshape(shape) if array.size == 0 and 0 in shape else array


def origins(provenance: Sequence[Mapping[str, Any]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return copies of origins as plain JSON values, and their texts; equal origins become one object."""
    copies: dict[str, dict[str, Any]] = {}
    texts: list[str] = []
    known: dict[int, str] = {}
    for origin in provenance:
        text = known.get(id(origin))
        if text is None:
            copy = as_json("provenance", origin)
            text = known[id(origin)] = json.dumps(copy, sort_keys=True)
            copies.setdefault(text, copy)
        texts.append(text)
    return [copies[text] for text in texts], texts


def as_json(what: str, value: Mapping[str, Any]) -> dict[str, Any]:
    """Copy a mapping as plain JSON values, so that it is equal after saving and loading."""
    try:
        return cast(dict[str, Any], plain(dict(value)))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{what} must be a dict of JSON values, got {shown(value)} ({error})") from error


@dataclass(frozen=True, eq=False, repr=False)
class Point(Generic[T]):
    """One point of a front, with all its values.

    index       row in the front
    costs       value by criterion, in the front's units
    reported    further values by name, not optimised
    item        what the costs are of
    provenance  how the point was found
    """

    index: int
    costs: dict[str, float]
    reported: dict[str, float]
    item: T
    provenance: dict[str, Any]

    def __repr__(self) -> str:
        costs, reported = (
            ", ".join(f"{name} {value:.6g}" for name, value in values.items()) for values in (self.costs, self.reported)
        )
        return f"<Point {self.index}: {costs}{f' (reported: {reported})' if reported else ''}; {shown(self.item)}>"
