"""Exact search if arcs take time and their costs depend on when they are taken (:mod:`.timed_paths`)."""

from hpop.search.timed.graph import PathSteps, TimedGraph, TimedPaths
from hpop.search.timed.timed_paths import timed_paths

__all__ = ["PathSteps", "TimedGraph", "TimedPaths", "timed_paths"]
