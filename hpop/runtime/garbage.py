"""Garbage: how seldom a command looks for it, and that it does not as it ends.

Python looks for cycles that nobody uses among the objects that are new, and, as it ends, several times among all. What
a command imports and draws stays to its end, so there is next to nothing to find: it took an eighth of the whole time.
"""

from __future__ import annotations

import atexit
import gc
import sys
from functools import cache

from hpop.base.registry import criteria, goals, models, planners, readers

COUNTING = "ompl"  # a library that counts what is left of its objects as Python ends, and prints it
OBJECTS = 300_000  # new ones between two searches: what is imported, and four pictures


@cache
def seldom() -> None:
    """Look for garbage seldom in this process, and not as it ends."""
    gc.set_threshold(OBJECTS)
    atexit.register(leave)  # the first to register is the last to be called


def leave() -> None:
    """Keep what there is from being looked through any more: the system takes it back as a whole.

    Where somebody else's code is registered all goes on as ever: a file that it has left open may hold lines that are
    written only when it is collected. So it does where a library would print what is not collected.
    """
    theirs = any(registry.own() for registry in (criteria, goals, models, planners, readers))
    if not theirs and COUNTING not in sys.modules:
        gc.freeze()
