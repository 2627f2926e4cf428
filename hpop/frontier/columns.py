"""Columns of a front's file, checked: each is a list of numbers or of places in a table, nothing else.

What is wrong is a ValueError that says what was expected and what was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hpop.frontier.dominance import FloatArray, IntArray

Kinds = dict[str, type | tuple[type, ...]]
"""Keys of an object, each with the types that its value may have."""


def parts(table: Any, name: str, kinds: Kinds) -> list[Any]:
    """The values of an object that must have certain keys and no others, each of its type.

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
            words = " or ".join(each.__name__ for each in one_of)
            raise ValueError(f"expected {key!r} to be of type {words}, found {type(table[key]).__name__} in {name}")
    return [table[key] for key in kinds]


def numbers(values: list[Any], name: str, size: int, *, gaps: bool = False) -> FloatArray:
    """A column of so many finite numbers; null, where there may be gaps, is NaN.

    >>> numbers([1, 0.5, None], "clock", 3, gaps=True)
    array([1. , 0.5, nan])
    """
    _check(values, name, size, {int, float, type(None)} if gaps else {int, float}, "numbers")
    try:
        column = np.array(values, dtype=np.float64)
    except OverflowError:
        column = np.array([np.inf])
    if np.isinf(column).any():
        raise ValueError(f"expected float64 numbers in {name}, found a larger one")
    return column


def places(values: list[Any], name: str, size: int, rows: int) -> IntArray:
    """A column of so many places in a table of some rows, counted from 0."""
    _check(values, name, size, {int}, "whole numbers")
    try:
        column = np.array(values, dtype=np.int64)
    except OverflowError:
        column = np.array([-1])
    if ((column < 0) | (column >= rows)).any():
        raise ValueError(f"expected places in a table of {rows} rows in {name}, found one outside of it")
    return column


def _check(values: list[Any], name: str, size: int, kinds: set[type], words: str) -> None:
    found = set(map(type, values))
    if len(values) != size or not found <= kinds:
        types = ", ".join(sorted(kind.__name__ for kind in found)) or "nothing"
        raise ValueError(f"expected {size} {words} in {name}, found {len(values)} of type {types}")
