"""Where along a trajectory each criterion is incurred: its rate on the map."""

from __future__ import annotations

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from hpop.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.problem import Problem
from hpop.trace import Trace
from hpop.trajectory import Trajectory
from hpop.view.content import draw_content
from hpop.view.ground import ball_of, draw_obstacles, outline, view_of
from hpop.view.map import path_points
from hpop.view.style import LARGE, NORMAL, SMALL, label, new_figure, turns_in_place, whole_ticks, written

COLUMNS = 2
WIDTH, MAP_WIDTH = 4.6, 3.5  # inches of one map, with and without its axes and colour bar
RATE_COLOURS: Colormap = ListedColormap(colormaps["magma_r"](np.linspace(0.12, 1.0, 256)), name="rate")


def draw_where(problem: Problem, trajectory: Trajectory, *, name: str = "the trajectory") -> Figure:
    """Draw one small map a criterion, the trajectory coloured by the criterion's rate: dark is where it is incurred.

    A sum shows its cost a second, a time-mean and a worst moment their value on the spot, a criterion with memory how
    fast it grows. Turns in place are dots.

    Parameters
    ----------
    problem : Problem
        World and criteria.
    trajectory : Trajectory
        A planned trajectory of the problem's model.
    name : str
        What the title calls it.
    """
    trace = problem.trace(trajectory)
    view = view_of(problem, [path_points(trajectory)])
    columns = min(COLUMNS, len(trace.criteria))
    rows = math.ceil(len(trace.criteria) / columns)
    height = np.clip(MAP_WIDTH * view.height / view.width, 1.5, 2.0 * MAP_WIDTH) + 0.8
    figure = new_figure(WIDTH * columns, height * rows + 0.5)
    maps = figure.subplots(rows, columns, squeeze=False).ravel()
    for place, axes in enumerate(maps):
        if place >= len(trace.criteria):
            axes.set_axis_off()
            continue
        floor = PathPatch(outline(problem.world.extent), facecolor="white", linewidth=0.0, zorder=0.1)
        axes.add_patch(floor)
        draw_obstacles(axes, problem.world, ball_of(problem).z)
        draw_content(axes, problem.world, view, names=False)
        _draw_rate(figure, axes, trace, place)
        axes.set_xlim(view.x_min, view.x_max)
        axes.set_ylim(view.y_min, view.y_max)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=SMALL)
        axes.set_xlabel("x (m)", fontsize=SMALL)
        axes.set_ylabel("y (m)", fontsize=SMALL)
    figure.suptitle(f"Where {name} incurs what: dark is much", fontsize=LARGE)
    return figure


def _draw_rate(figure: Figure, axes: Axes, trace: Trace, column: int) -> None:
    criterion, rate = trace.criteria[column], trace.rate[:, column]
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    points = np.stack([trace.states.x, trace.states.y], axis=1)
    norm = Normalize(0.0, float(rate.max(initial=0.0)) or 1.0)
    turning = turns_in_place(trace.trajectory)
    pieces = np.stack([points[:-1], points[1:]], axis=1)[~turning]  # (moves, 2, 2)
    axes.add_collection(
        LineCollection(
            list(pieces), array=rate[~turning], cmap=RATE_COLOURS, norm=norm, linewidths=3.0, zorder=4, gid="rate"
        )
    )
    x, y = points[:-1][turning].T
    axes.scatter(x, y, c=rate[turning], cmap=RATE_COLOURS, norm=norm, s=42, edgecolors="white", zorder=5)
    _draw_ends(axes, points)
    beside = axes.inset_axes((1.02, 0.0, 0.035, 1.0))
    bar = figure.colorbar(ScalarMappable(norm, RATE_COLOURS), cax=beside)
    bar.ax.tick_params(labelsize=SMALL)
    bar.set_label(rate_label(criterion), fontsize=SMALL)
    whole_ticks(bar.ax.yaxis, False, most=5)
    total = written(float(trace.cost[column]), criterion.unit, counts)
    words = {"time-mean": "on average", "max": "at worst"}.get(criterion.aggregate, "in all")
    axes.set_title(f"{criterion.name}: {total} {words}", fontsize=NORMAL)


def _draw_ends(axes: Axes, points: FloatArray) -> None:
    for place, letter in ((0, "S"), (-1, "G")):
        axes.annotate(
            letter, points[place], fontsize=SMALL, fontweight="bold", ha="center", va="center", zorder=6,
            bbox={"boxstyle": "circle,pad=0.25", "facecolor": "white", "linewidth": 1.0},
        )  # fmt: skip


def rate_label(criterion: Criterion) -> str:
    """Words for a criterion's rate.

    >>> from hpop.criteria import Clearance, Length, Turns
    >>> rate_label(Length()), rate_label(Turns()), rate_label(Clearance())
    ('m a second', 'count a second', 'clearance (m) on the spot')
    """
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    if criterion.aggregate in ("time-mean", "max"):
        return f"{label(criterion.name, criterion.unit, counts)} on the spot"
    unit = ("count" if counts else "share") if criterion.unit == "1" else criterion.unit
    return f"{unit} a second"
