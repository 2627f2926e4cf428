"""What is derived from a world and kept with it, bounded in bytes: what was used least recently goes first."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from itertools import count
from threading import RLock
from typing import Any
from weakref import WeakSet

import shapely
from shapely.geometry.base import BaseGeometry

LIMIT = 2_000_000_000
"""Bytes that a world keeps of what was derived from it."""


class Cache:
    """Values by key; beyond the limit, bytes, those used least recently are dropped, but never the newest.

    A cache ``beside`` another shares its limit and its lock, and is dropped, with all its values, by whoever holds it:
    what many worlds derive from one ground is kept once, and together they keep no more than one.

    >>> cache = Cache(limit=40)
    >>> for name in ("a", "b", "a", "c"):
    ...     _ = cache.get(name, lambda: (shapely.Point(0, 0),))
    >>> [cache.find(name) is not None for name in "abc"]
    [True, False, True]
    """

    def __init__(self, limit: int | None = None, *, beside: Cache | None = None) -> None:
        budget = _Budget(LIMIT if limit is None else limit) if beside is None else beside._budget
        self._budget: _Budget = budget
        self._values: dict[Hashable, tuple[int, Any]] = {}  # when it was used last, and the value
        self._budget.caches.add(self)

    @property
    def size(self) -> int:
        """Bytes of the values."""
        return sum(nbytes(value) for _, value in self._values.values())

    def get(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """The value of a key, made by one thread while others wait; ``make`` may ask for other keys."""
        with self._budget.lock:
            found = self.find(key)
            if found is None:
                found = make()
                self.keep(key, found)
            return found

    def find(self, key: Hashable) -> Any:
        """The value of a key, None where there is none."""
        with self._budget.lock:
            if key not in self._values:
                return None
            _, value = self._values[key]
            self._values[key] = next(self._budget.uses), value
            return value

    def keep(self, key: Hashable, value: Any) -> None:
        """Keep a value, and drop what there is no room for."""
        with self._budget.lock:
            self._values[key] = next(self._budget.uses), value
            self._budget.drop()


class _Budget:
    """What caches beside each other share: the limit, the lock, and the count by which the last use is known."""

    def __init__(self, limit: int) -> None:
        self.limit, self.lock, self.uses = limit, RLock(), count()
        self.caches: WeakSet[Cache] = WeakSet()

    def drop(self) -> None:
        """Drop what was used least recently, and takes room, until the rest is within the limit."""
        kept = [
            (used, key, nbytes(value), cache) for cache in self.caches for key, (used, value) in cache._values.items()
        ]
        total = sum(size for _, _, size, _ in kept)
        for _, key, size, cache in sorted(kept, key=lambda item: item[0])[:-1]:
            if total <= self.limit:
                break
            if size:
                total -= size
                del cache._values[key]


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
