"""Reading and writing of strict JSON: UTF-8, no key twice in an object, no NaN and no infinity.

Reading runs no code and checks tables column by column. Numbers are written in the shortest decimal form from which an
equal float64 is read. A list or object without nested ones is written on one line, so a table has one line per column.
An invalid table raises a ValueError that says what was expected and what was found.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any, NoReturn

import numpy as np

from hpop.base.text import python_value
from hpop.frontier.dominance import FloatArray, IntArray

SLICE = 2**16  # number of values of a long list that are written in one piece
SLICE_OF_ROWS = 2**9  # number of lists of whole numbers that are written in one piece
Kinds = dict[str, type | tuple[type, ...]]
"""Keys that an object must have, each with the type or types that its value may have."""


def of_numpy(value: Any) -> Any:
    """Return the Python value of a NumPy scalar, for JSON encoders; TypeError for anything else."""
    number = python_value(value)
    if number is value:
        raise TypeError(f"values must be JSON (lists, dicts, strings, numbers), got a {type(value).__name__}")
    return number


_encoded = json.JSONEncoder(allow_nan=False, ensure_ascii=False, separators=(", ", ": "), default=of_numpy).encode
_dense = json.JSONEncoder(allow_nan=False, ensure_ascii=False, separators=(",", ":"), default=of_numpy).encode


def pieces(value: Any, indent: int = 0) -> Iterator[str]:
    """Yield the JSON text of a value, piece by piece.

    Raises ValueError or TypeError for values that are not JSON, RecursionError for deep nesting.

    >>> print("".join(pieces({"turns": [1, 2], "paths": [[0.5], []]})))
    {
     "turns": [1,2],
     "paths": [
      [0.5],
      []
     ]
    }
    """
    if not isinstance(value, dict | list | tuple):
        yield _encoded(value)
        return
    keys = list(value) if isinstance(value, dict) else None
    entries = value.values() if isinstance(value, dict) else value
    if not all(isinstance(key, str) for key in keys or ()):
        raise TypeError(f"the keys of an object must be strings, got {keys!r:.80}")
    if not any(issubclass(kind, dict | list | tuple) for kind in set(map(type, entries))):
        yield from [_encoded(value)] if keys is not None else _line(value)
        return
    if keys is None and _is_table(value):
        yield from _rows(value, indent + 1)
        yield f"\n{' ' * indent}]"
        return
    yield "[" if keys is None else "{"
    for i, entry in enumerate(entries):
        yield f"{',' if i else ''}\n{' ' * (indent + 1)}"
        if keys is not None:
            yield f"{_encoded(keys[i])}: "
        yield from pieces(entry, indent + 1)
    yield f"\n{' ' * indent}{']' if keys is None else '}'}"


def _is_table(rows: Any) -> bool:
    """Return whether all entries of a list are lists of whole numbers, as the table of a front's trajectories is."""
    return set(map(type, rows)) == {list} and set(map(type, chain.from_iterable(rows))) <= {int}


def _rows(rows: Any, indent: int) -> Iterator[str]:
    """Yield the JSON text of a list of lists of whole numbers, many lines in one piece, without the last bracket."""
    line = f"\n{' ' * indent}"
    for begin in range(0, len(rows), SLICE_OF_ROWS):
        lines = _dense(rows[begin : begin + SLICE_OF_ROWS])[1:-1].replace("],[", f"],{line}[")
        yield f"{',' if begin else '['}{line}{lines}"


def _line(values: Any) -> Iterator[str]:
    """Yield the JSON text of a list without nested lists or objects, on one line."""
    yield "["
    for begin in range(0, len(values), SLICE):
        yield ("," if begin else "") + _dense(values[begin : begin + SLICE])[1:-1]
    yield "]"


def parse(data: bytes) -> Any:
    """Parse strict JSON; raise ValueError for invalid text, or RecursionError for brackets nested too deeply."""
    return json.loads(
        data.decode("utf-8"),
        object_pairs_hook=_object_without_duplicates,
        parse_float=_finite_float,
        parse_constant=_no_constant,
    )


def plain(value: Any) -> Any:
    """Return a copy of a value as plain JSON values, which are equal after saving and loading.

    Raises ValueError or TypeError for anything that JSON cannot hold.
    """
    text = json.dumps(value, allow_nan=False, sort_keys=True, default=of_numpy)
    return json.loads(text, parse_int=_bounded_int)  # all floats of this text are finite


def _object_without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return key-value pairs of a JSON object as a dict; ValueError if a key occurs twice."""
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice!r} twice in one object")
    return result


def _finite_float(text: str) -> float:
    """Parse a number; ValueError if it is too large for float64."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text:.40}, too large for float64")
    return value


def _bounded_int(text: str) -> int:
    """Parse a whole number; ValueError if it is too large for float64."""
    _finite_float(text)
    return int(text)


def _no_constant(text: str) -> NoReturn:
    """Raise ValueError for the constants NaN and Infinity, which JSON does not have."""
    raise ValueError(f"the constant {text}, which is not JSON")


def parts(table: Any, name: str, kinds: Kinds) -> list[Any]:
    """Check that an object has exactly the keys of ``kinds``, with values of these types, and return the values.

    They are in the order of ``kinds``. ``name`` says in a ValueError which object of the file it is.

    >>> parts({"a": [1], "b": {}}, "the file", {"a": list, "b": dict})
    [[1], {}]
    """
    if not isinstance(table, Mapping):
        raise ValueError(f"expected {name} to be an object, found {type(table).__name__}")
    if table.keys() != kinds.keys():
        missing, unknown = sorted(kinds.keys() - table.keys()), sorted(map(str, table.keys() - kinds.keys()))
        found = f"missing keys {missing}, unknown keys {unknown}"
        raise ValueError(f"expected {name} to have the keys {list(kinds)}, found {found:.200}")
    for key, kind in kinds.items():
        one_of = kind if isinstance(kind, tuple) else (kind,)
        if type(table[key]) not in one_of:
            words = " or ".join(expected.__name__ for expected in one_of)
            raise ValueError(f"expected {key!r} to be of type {words}, found {type(table[key]).__name__} in {name}")
    return [table[key] for key in kinds]


def numbers(values: list[Any], name: str, size: int, *, gaps: bool = False) -> FloatArray:
    """Check that a list of a JSON file has ``size`` numbers within float64's range, and return them as an array.

    With ``gaps``, null is allowed and becomes NaN. Raises ValueError for other values.

    >>> numbers([1, 0.5, None], "clock", 3, gaps=True)
    array([1. , 0.5, nan])
    """
    _check(values, name, size, {int, float, type(None)} if gaps else {int, float}, "numbers")
    try:
        column = np.array(values, dtype=np.float64)
    except OverflowError:
        column = np.array([np.inf])
    if np.isinf(column).any():
        raise ValueError(f"expected numbers within the range of float64 in {name}, found a larger one")
    return column


def row_numbers(values: list[Any], name: str, size: int, rows: int) -> IntArray:
    """Check that a list has ``size`` row numbers, 0 to ``rows`` - 1, of a table and return them as an array."""
    _check(values, name, size, {int}, "whole numbers")
    try:
        column = np.array(values, dtype=np.int64)
    except OverflowError:
        column = np.array([-1])
    if ((column < 0) | (column >= rows)).any():
        raise ValueError(f"expected row numbers from 0 to {rows - 1} in {name}, found one outside of this range")
    return column


def _check(values: list[Any], name: str, size: int, kinds: set[type], words: str) -> None:
    """Raise ValueError unless a list has ``size`` values of some types; ``words`` names them in the message."""
    found = set(map(type, values))
    if len(values) != size or not found <= kinds:
        types = ", ".join(sorted(kind.__name__ for kind in found)) or "nothing"
        raise ValueError(f"expected {size} {words} in {name}, found {len(values)} of type {types}")
