"""Exact search where costs depend on when an arc is taken: :mod:`.timed_paths`."""

from hpop.search.timed.graph import Steps, TimedGraph, TimedPaths
from hpop.search.timed.timed_paths import timed_paths

__all__ = ["Steps", "TimedGraph", "TimedPaths", "timed_paths"]
