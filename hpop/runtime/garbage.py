"""Rare garbage collection in commands, and none at their end.

Python searches new objects for unused cycles and, as it ends, all objects several times. Nearly everything that a
command imports and draws lives to its end, so little is found: the searches took an eighth of the total time.
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
def seldom() -> None:
    """Collect garbage rarely in this process, and not as it ends."""
    gc.set_threshold(OBJECTS)
    atexit.register(leave)  # registered first, called last


def leave() -> None:
    """Exclude all objects from further collection; the system frees the memory when the process ends.

    Where a user's code is registered, collection goes on: a file that it has left open may hold lines that are written
    only when the file is collected. It also goes on for a library that would print the number of uncollected objects.
    """
    has_plugins = any(registry.own() for registry in (criteria, goals, models, planners, readers))
    if not has_plugins and COUNTING not in sys.modules:
        gc.freeze()
