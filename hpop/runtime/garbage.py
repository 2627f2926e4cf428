"""Garbage collection: rare in commands, and none when they end.

Python's collector searches new objects for unused cycles and, when the process ends, searches all objects several
times.
Nearly all objects of a command live to its end, so these searches find little, but took an eighth of the total time.
"""

from __future__ import annotations

import atexit
import gc
import sys
from functools import cache

from hpop.base.registry import criteria, goals, models, planners, readers

COUNTING = "ompl"  # a library that counts its remaining objects as Python ends, and prints the number
OBJECTS = 300_000  # new objects between two searches: all imports and four pictures make fewer


@cache
def collect_rarely() -> None:
    """Collect garbage rarely in this process, and not as it ends."""
    gc.set_threshold(OBJECTS)
    atexit.register(stop_collecting)  # registered first, called last


def stop_collecting() -> None:
    """Exclude all objects from further collection; the system frees the memory when the process ends.

    Two cases keep collecting. A file that a user's registered code left open may hold lines that are written only when
    the file is collected. And some libraries print the number of uncollected objects.
    """
    has_plugins = any(registry.own() for registry in (criteria, goals, models, planners, readers))
    if not has_plugins and COUNTING not in sys.modules:
        gc.freeze()
