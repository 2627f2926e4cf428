"""Pareto fronts of any objects: keep non-dominated points, choose from them, measure and save them.

The package works on arrays of costs and on items of any type, and knows nothing of robots. All costs are minimised.
Functions take arrays (n, k) of n points and k criteria. A :class:`Front` holds costs together with the items that have
these costs.

>>> import hpop.frontier
>>> Y = [[1.0, 9.0], [3.0, 3.0], [9.0, 1.0], [9.0, 9.0]]
>>> hpop.frontier.filter(Y).tolist(), hpop.frontier.knee(Y), round(hpop.frontier.hypervolume(Y), 6)
([[1.0, 9.0], [3.0, 3.0], [9.0, 1.0]], 1, 49.44)
>>> hpop.frontier.Front.of(Y, ["a", "b", "c", "d"]).knee()
<Point 1: f1 3, f2 3; 'b'>
"""

from __future__ import annotations

from hpop.frontier.choosing import knee
from hpop.frontier.dominance import default_quanta, dominates, filter, is_nondominated, quantised
from hpop.frontier.front import Front
from hpop.frontier.points import FrontError, FrontFileError, Point, UnknownColumnError
from hpop.frontier.representative import representative
from hpop.frontier.union import additive_epsilon, default_reference, hypervolume

__all__ = [
    "Front",
    "FrontError",
    "FrontFileError",
    "Point",
    "UnknownColumnError",
    "additive_epsilon",
    "default_quanta",
    "default_reference",
    "dominates",
    "filter",
    "hypervolume",
    "is_nondominated",
    "knee",
    "quantised",
    "representative",
]
