"""Pareto fronts of anything: keep what is not dominated, choose from it, measure it, save it.

The package knows cost arrays and opaque items, nothing of robots. Everything is minimised.
"""

from __future__ import annotations

from hpop.frontier.choosing import UnknownColumnError
from hpop.frontier.dominance import dominates, is_nondominated, quantised
from hpop.frontier.front import Front
from hpop.frontier.indicators import additive_epsilon, hypervolume
from hpop.frontier.point import Point
from hpop.frontier.storage import FrontFileError

__all__ = [
    "Front",
    "FrontFileError",
    "Point",
    "UnknownColumnError",
    "additive_epsilon",
    "dominates",
    "hypervolume",
    "is_nondominated",
    "quantised",
]
