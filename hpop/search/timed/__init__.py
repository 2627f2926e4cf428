"""Exact search if arcs take time and their costs depend on when they are taken (:mod:`.timed_paths`)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.base.lazy import homes_of, on_first_use
from hpop.search.timed.graph import PathSteps, TimedGraph, TimedPaths
from hpop.search.timed.timed_paths import timed_paths

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.timed import best_paths as best_paths
    from hpop.search.timed import bounds as bounds
    from hpop.search.timed import calm as calm
    from hpop.search.timed import search as search
    from hpop.search.timed import solutions as solutions
    from hpop.search.timed import tables as tables

__all__ = ["PathSteps", "TimedGraph", "TimedPaths", "timed_paths"]

__getattr__ = on_first_use(__name__, homes_of(__name__))
