"""Start and goal on a map: a letter in a circle at each; a goal at the start is a ring round it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from hpop.goals import GoalSet
from hpop.problem import Problem
from hpop.view.style import GOAL, START, mapped

CIRCLE = 12.0  # points across
RING = 19.0  # points across
LOOKS = {"start": ("S", START), "goal": ("G", GOAL)}
Place = Sequence[float]


class EndPose(NamedTuple):
    """Where a robot is at an end: m, m, rad; None where its yaw is free."""

    x: float
    y: float
    yaw: float | None


def end_poses(problem: Problem) -> tuple[EndPose, tuple[EndPose, ...]]:
    """Where a problem starts, and all places where it may end, if its goal lists them."""
    space, poses = problem.model.space, []
    for values in (problem.start, *(problem.goals if isinstance(problem.target, GoalSet) else ())):
        pose = mapped(problem.model, space.state(values, free=space.angles))
        x, y, yaw = (float(column[0]) for column in (pose.x, pose.y, pose.yaw))
        if not math.isnan(x + y):
            poses.append(EndPose(x, y, None if math.isnan(yaw) else yaw))
    return poses[0], tuple(poses[1:])


def draw_ends(axes: Axes, start: Place, goals: Sequence[Place], words: tuple[str, str] = ("", "")) -> list[Line2D]:
    """Draw a letter at each; returns the legend entries, which may say more."""
    handles = []
    for (name, (letter, fill)), places, more in zip(LOOKS.items(), ([start], goals), words, strict=True):
        look: dict[str, Any] = {"marker": "o", "markerfacecolor": fill, "markeredgecolor": "black"}
        for x, y in places:
            ring = name == "goal" and (x, y) == tuple(start)
            size = RING if ring else CIRCLE
            axes.plot([x], [y], linestyle="none", markersize=size, zorder=7.9 if ring else 8, gid=name, **look)
            if not ring:
                axes.text(x, y, letter, ha="center", va="center_baseline", fontsize=7.5, weight="bold", zorder=9)
        handles.append(Line2D([], [], linestyle="none", markersize=8, label=f"{letter}: {name}{more}", **look))
    return handles
