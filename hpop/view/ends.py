"""Start and goal on a map: a letter in a circle at each; a goal at the start is a ring round it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hpop.view.style import GOAL, START

CIRCLE = 12.0  # points across
RING = 19.0  # points across
LOOKS = {"start": ("S", START), "goal": ("G", GOAL)}
Place = Sequence[float]


def draw_ends(axes: Axes, start: Place, goal: Place, words: tuple[str, str] = ("", "")) -> list[Line2D]:
    """Draw a letter at each; returns the legend entries, which may say more."""
    handles = []
    for (name, (letter, fill)), (x, y), more in zip(LOOKS.items(), (start, goal), words, strict=True):
        look: dict[str, Any] = {"marker": "o", "markerfacecolor": fill, "markeredgecolor": "black"}
        ring = name == "goal" and tuple(start) == tuple(goal)
        size = RING if ring else CIRCLE
        axes.plot([x], [y], linestyle="none", markersize=size, zorder=7.9 if ring else 8, gid=name, **look)
        if not ring:
            axes.text(x, y, letter, ha="center", va="center_baseline", fontsize=7.5, weight="bold", zorder=9)
        handles.append(Line2D([], [], linestyle="none", markersize=8, label=f"{letter}: {name}{more}", **look))
    return handles
