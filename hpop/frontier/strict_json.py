"""Strict JSON: read without running anything, written so that a person can read it.

UTF-8, no key twice in an object, no NaN, no infinity. Numbers are written in the shortest decimal form that reads back
as the same float64. What holds only numbers and words is one line, so a table is a line a column.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from itertools import chain
from typing import Any, NoReturn

from hpop.base.scalars import python_value

SLICE = 2**16  # values of a long list that are written at once
SLICE_OF_ROWS = 2**9  # lists of whole numbers


def of_numpy(value: Any) -> Any:
    """Return the Python value of a NumPy scalar, for encoders of JSON; TypeError for anything else."""
    number = python_value(value)
    if number is value:
        raise TypeError(f"a {type(value).__name__} is no JSON value")
    return number


_encoded = json.JSONEncoder(allow_nan=False, ensure_ascii=False, separators=(", ", ": "), default=of_numpy).encode
_dense = json.JSONEncoder(allow_nan=False, ensure_ascii=False, separators=(",", ":"), default=of_numpy).encode


def pieces(value: Any, indent: int = 0) -> Iterator[str]:
    """The text of a value, piece by piece.

    Raises ValueError or TypeError for what is no JSON, RecursionError for what is nested too deeply.

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
        raise TypeError(f"the keys of an object are words, got {keys!r:.80}")
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
    """Whether all entries are lists of whole numbers, of which a front has one a trajectory."""
    return set(map(type, rows)) == {list} and set(map(type, chain.from_iterable(rows))) <= {int}


def _rows(rows: Any, indent: int) -> Iterator[str]:
    """A list of lists of whole numbers but for its last bracket, many lines at once."""
    line = f"\n{' ' * indent}"
    for begin in range(0, len(rows), SLICE_OF_ROWS):
        several = _dense(rows[begin : begin + SLICE_OF_ROWS])[1:-1].replace("],[", f"],{line}[")
        yield f"{',' if begin else '['}{line}{several}"


def _line(values: Any) -> Iterator[str]:
    """A list that holds no lists or objects."""
    yield "["
    for begin in range(0, len(values), SLICE):
        yield ("," if begin else "") + _dense(values[begin : begin + SLICE])[1:-1]
    yield "]"


def parse(data: bytes) -> Any:
    """The value of a text; raises ValueError, or RecursionError for brackets nested too deeply."""
    return json.loads(
        data.decode("utf-8"),
        object_pairs_hook=_object_without_duplicates,
        parse_float=_finite_float,
        parse_constant=_no_constant,
    )


def plain(value: Any) -> Any:
    """A copy as plain JSON values, the same after it is written and read; raises ValueError or TypeError."""
    text = json.dumps(value, allow_nan=False, sort_keys=True, default=of_numpy)
    return json.loads(text, parse_int=_bounded_int, parse_float=_finite_float)


def _object_without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Build an object, refusing one that says the same key twice."""
    result = dict(pairs)
    if len(result) != len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice!r} twice in one object")
    return result


def _finite_float(text: str) -> float:
    """Parse a number, refusing one too large for float64."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"the number {text:.40}, too large for float64")
    return value


def _bounded_int(text: str) -> int:
    """Parse a whole number, refusing one that no float64 comes near."""
    _finite_float(text)
    return int(text)


def _no_constant(text: str) -> NoReturn:
    """Refuse NaN and Infinity, which JSON does not have."""
    raise ValueError(f"the constant {text}, which is not JSON")
