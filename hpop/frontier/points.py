"""Points of a front, checks of a front's values, names and provenance, and the errors of this package."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.lazy import on_first_use
from hpop.base.text import python_value, shown
from hpop.frontier.dominance import FloatArray, cost_matrix
from hpop.frontier.strict_json import plain

T = TypeVar("T")


class FrontError(ValueError):
    """Error for fronts that cannot be joined, and for invalid choices of a point."""


class UnknownColumnError(FrontError, LookupError):
    """Error for a name that is neither a criterion nor a reported value of the front."""


class FrontFileError(FrontError):
    """Error for a front that cannot be written as JSON, and for a file that is not a saved front."""


def names_of(costs: ArrayLike, names: Sequence[str] | None, *, letter: str = "f") -> tuple[str, ...]:
    """Return the names of columns of costs: the given names, those of a pandas table, or "f1", "f2", ...

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
    """Return costs and names in which columns that are to be maximised are negated and named "-name".

    maximise  names of these columns, or a bool for each column

    >>> minimised(np.array([[1.0, 2.0]]), ("length", "view"), ["view"])
    (array([[ 1., -2.]]), ('length', '-view'))
    """
    choices: Any = [maximise] if isinstance(maximise, str) else maximise
    try:
        values = [python_value(choice) for choice in choices]
        flags = values if all(isinstance(value, bool) for value in values) else None
    except TypeError:
        flags, choices = None, [maximise]
    if flags is None:
        strange = [choice for choice in choices if choice not in names]
        if strange:
            raise FrontError(
                f"maximise must be names of costs, or a bool for each of {', '.join(names)}, got {shown(maximise)}"
            )
        flags = [name in choices for name in names]
    if flags and len(flags) != len(names):
        raise FrontError(f"maximise must have one bool for each of {', '.join(names)}, got {len(flags)} bools")
    if not any(flags):
        return matrix, names
    sign = np.where(flags, -1.0, 1.0)
    signed_names = tuple(f"-{name}" if flag else name for name, flag in zip(names, flags, strict=True))
    return matrix * sign + 0.0, signed_names


def floats(values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Return a copy of an array as float64, with 0.0 for -0.0; an empty array gets the expected shape."""
    array = np.array(values, dtype=np.float64) + 0.0
    return array.reshape(shape) if array.size == 0 and 0 in shape else array


def origins(provenance: Sequence[Mapping[str, Any]]) -> tuple[list[dict[str, Any]], list[str]]:
    """Return provenance entries (how each point was found) as plain JSON values, and as texts of JSON.

    Equal entries become one object, which saves memory.
    """
    copies: dict[str, dict[str, Any]] = {}
    texts: list[str] = []
    text_of: dict[int, str] = {}
    for origin in provenance:
        text = text_of.get(id(origin))
        if text is None:
            copy = as_json("provenance", origin)
            text = text_of[id(origin)] = json.dumps(copy, sort_keys=True)
            copies.setdefault(text, copy)
        texts.append(text)
    return [copies[text] for text in texts], texts


def as_json(name: str, value: Mapping[str, Any]) -> dict[str, Any]:
    """Return a copy of a mapping as plain JSON values, which are equal after saving and loading.

    Raises ValueError, which calls the mapping ``name``, for anything that JSON cannot hold.
    """
    try:
        return cast(dict[str, Any], plain(dict(value)))
    except (TypeError, ValueError, RecursionError) as error:
        raise ValueError(f"{name} must be a dict of JSON values, got {shown(value)} ({error}); convert it") from error


@dataclass(frozen=True, eq=False, repr=False)
class ItemPoint(Generic[T]):
    """Point of a front: its costs, and the item that has them.

    index       row in the front
    costs       cost by the name of each criterion, in the units of the front
    reported    further values by name, which were not optimised
    item        object that has these costs, such as a trajectory
    provenance  how the point was found, as JSON
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
        more = f" (reported: {reported})" if reported else ""
        return f"<Point {self.index} of its front: {costs}{more}; {shown(self.item)}>"


__getattr__ = on_first_use(__name__, {}, former={"Point": "ItemPoint"})  # former name, in pickles
