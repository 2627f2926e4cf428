"""What the camera is to look at, or a body to be at: the places that criteria and the goal name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hpop.base.arrays import FloatArray
from hpop.problems.problem import Problem

RING: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none", "markeredgecolor": "#d62728"}
SIZE, WIDTH = 14.0, 2.0  # points: round the star of a landmark that is the target


def targets_of(problem: Problem) -> FloatArray:
    """The places (n, 3), m, each once."""
    places = dict.fromkeys(place for _, place in _named(problem))
    return np.array(list(places), float).reshape(-1, 3)


def targets_by_name(problem: Problem) -> list[tuple[str, tuple[float, float, float]]]:
    """The places, m, each once, with all that name it."""
    names: dict[tuple[float, float, float], list[str]] = {}
    for name, place in _named(problem):
        names.setdefault(place, []).append(name)
    return [(", ".join(dict.fromkeys(several)), place) for place, several in names.items()]


def draw_targets(axes: Axes, problem: Problem, flatten: Callable[[FloatArray], FloatArray]) -> list[Line2D]:
    """Draw a ring round each, where ``flatten`` has it in the picture; returns the legend entry."""
    places = targets_of(problem)
    if not len(places):
        return []
    axes.plot(*flatten(places).T, markersize=SIZE, markeredgewidth=WIDTH, zorder=5.8, gid="targets", **RING)
    names = ", ".join(dict.fromkeys(name for name, _ in _named(problem)))
    return [Line2D([], [], markersize=0.7 * SIZE, markeredgewidth=WIDTH, label=f"target of {names}", **RING)]


def _named(problem: Problem) -> list[tuple[str, tuple[float, float, float]]]:
    """Who names a place, and which."""
    named = [(criterion.name, place) for criterion in problem.criteria for place in criterion.places]
    return [*named, *(("the goal", place) for place in problem.target.places)]
