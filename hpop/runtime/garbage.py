"""Rare garbage collection in commands, and none when they end, to save time.

Python's collector searches new objects for unused cycles. When the process ends, it searches all objects several times.
Nearly all objects of a command live to its end, so these searches find little, but they took an eighth of the time.
"""

from __future__ import annotations

import atexit
import gc
import sys
from functools import cache

from hpop.base.registry import criteria, goals, models, planners, readers

COUNTING = "ompl"  # a library that prints the number of its remaining objects when Python ends
OBJECTS = 300_000  # number of new objects between two searches; all imports and four pictures make fewer


@cache
def collect_rarely() -> None:
    """Let Python collect garbage rarely in this process, and not when it ends."""
    gc.set_threshold(OBJECTS)
    atexit.register(stop_collecting)  # registered first, called last


def stop_collecting() -> None:
    """Exclude all objects from garbage collection when the process ends; the system frees their memory.

    There are two exceptions. A file that a user's plugin has left open may have lines that are written only when the
    file object is collected. And the library ``COUNTING`` would print the number of objects that were not collected.
    """
    has_plugins = any(registry.own() for registry in (criteria, goals, models, planners, readers))
    if not has_plugins and COUNTING not in sys.modules:
        gc.freeze()
