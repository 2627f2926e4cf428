"""Pareto fronts of anything: keep what is not dominated, choose from it, measure it, save it.

The package knows cost arrays and opaque items, nothing of robots. Everything is minimised.
"""

from __future__ import annotations

from hpop.frontier.dominance import dominates, is_nondominated, quantised
from hpop.frontier.errors import FrontError, FrontFileError, UnknownColumnError
from hpop.frontier.front import Front
from hpop.frontier.indicators import additive_epsilon, hypervolume
from hpop.frontier.point import Point

__all__ = [
    "Front",
    "FrontError",
    "FrontFileError",
    "Point",
    "UnknownColumnError",
    "additive_epsilon",
    "dominates",
    "hypervolume",
    "is_nondominated",
    "quantised",
]
