"""What is derived from a world and kept with it, bounded in bytes: what was used least recently goes first."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from threading import RLock
from typing import Any

import shapely
from shapely.geometry.base import BaseGeometry

LIMIT = 2_000_000_000
"""Bytes that a world keeps of what was derived from it."""


class Cache:
    """Values by key; beyond the limit, bytes, those used least recently are dropped, but never the newest.

    >>> cache = Cache(limit=40)
    >>> for name in ("a", "b", "a", "c"):
    ...     _ = cache.get(name, lambda: (shapely.Point(0, 0),))
    >>> [cache.find(name) is not None for name in "abc"]
    [True, False, True]
    """

    def __init__(self, limit: int | None = None) -> None:
        self._limit = LIMIT if limit is None else limit
        self._values: dict[Hashable, Any] = {}  # the least recently used first
        self._lock = RLock()

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The value of a key, made by one thread while others wait; ``make`` may ask for other keys."""
        with self._lock:
            found = self.find(key)
            if found is None:
                found = make()
                self.keep(key, found)
            return found

    def find(self, key: Hashable) -> Any:
        """The value of a key, None where there is none."""
        with self._lock:
            if key not in self._values:
                return None
            self._values[key] = self._values.pop(key)
            return self._values[key]

    def keep(self, key: Hashable, value: Any) -> None:
        """Keep a value, and drop what there is no room for."""
        with self._lock:
            self._values[key] = value
            sizes = {key: nbytes(value) for key, value in self._values.items()}
            total = sum(sizes.values())
            for oldest in list(self._values)[:-1]:
                if total <= self._limit:
                    break
                if sizes[oldest]:
                    total -= sizes[oldest]
                    del self._values[oldest]


def nbytes(value: Any) -> int:
    """Bytes of the arrays and coordinates in a value, its attributes and its items."""
    if isinstance(value, BaseGeometry):
        return 16 * int(shapely.get_num_coordinates(value))
    size = getattr(value, "nbytes", None)
    if isinstance(size, int):
        return size
    if isinstance(value, tuple | list):
        return sum(map(nbytes, value))
    if isinstance(value, dict):
        return sum(map(nbytes, value.values()))
    if type(value).__module__.startswith("hpop."):
        return sum(map(nbytes, vars(value).values()))
    return 0
