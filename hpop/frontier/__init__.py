"""Pareto fronts of any objects: keep non-dominated points, choose from them, measure and save them.

The package works on arrays of costs and on items of any type, and knows nothing of robots. All costs are minimised.
Functions take arrays (n, k) of n points and k criteria. An :class:`ItemFront` holds costs together with the items that
have these costs. ``Front`` and ``Point`` are the deprecated names of ItemFront and ItemPoint.

>>> import hpop.frontier
>>> Y = [[1.0, 9.0], [3.0, 3.0], [9.0, 1.0], [9.0, 9.0]]
>>> hpop.frontier.filter(Y).tolist(), hpop.frontier.knee(Y), round(hpop.frontier.hypervolume(Y), 6)
([[1.0, 9.0], [3.0, 3.0], [9.0, 1.0]], 1, 49.44)
>>> hpop.frontier.ItemFront.of(Y, ["a", "b", "c", "d"]).knee()
<Point 1 of its front: f1 3, f2 3; 'b'>
"""

from __future__ import annotations

from hpop.base.lazy import on_first_use
from hpop.frontier.choosing import knee
from hpop.frontier.dominance import default_quanta, dominates, filter, is_nondominated, quantised
from hpop.frontier.front import ItemFront
from hpop.frontier.points import (
    FrontError,
    FrontFileError,
    ItemPoint,
    UnknownColumnError,
    additive_epsilon,
    default_reference,
    hypervolume,
    representative,
)

__all__ = [
    "FrontError",
    "FrontFileError",
    "ItemFront",
    "ItemPoint",
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

__getattr__ = on_first_use(__name__, {}, former={"Front": "ItemFront", "Point": "ItemPoint"})
