"""The trajectories of a front as lines: all of them coloured by a cost, and those that are named on top."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import cycle

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import printable
from hpop.frontier.choosing import column_index
from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory
from hpop.view.page import Bar, Handle
from hpop.view.style import DASHES, QUIET, Mark, Quantity, quantities

WRAP = 60  # characters a line of costs in the legend
# Without the palest yellow, which is lost on a light ground.
COST_COLOURS: Colormap = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.92, 256)), name="cost")
Line = Callable[[Trajectory], FloatArray]  # points (N, 2) of a trajectory in a picture


def scale_of(front: Front, colour: str | None) -> Quantity:
    """Find the column that colours the trajectories: the length, else the first, where none is named."""
    columns = quantities(front)
    names = [column.name for column in columns]
    if colour is None:
        colour = "length" if "length" in names else names[0]
    return columns[column_index(colour, names)]


def draw_all(axes: Axes, front: Front, scale: Quantity, rows: IntArray, line: Line) -> list[Bar]:
    """Draw the trajectories of some rows, the least on top; returns the colour bar, or none where all are alike."""
    order = rows[np.argsort(-scale.values[rows], kind="stable")]
    norm = Normalize(float(scale.values.min()), float(scale.values.max()))
    alpha = float(np.clip(7.0 / np.sqrt(rows.size), 0.15, 0.9))
    styles = dict(zip(_counts(front), cycle(DASHES), strict=False))
    axes.add_collection(
        LineCollection(
            [line(front.trajectories[row]) for row in order],
            colors=COST_COLOURS(norm(scale.values[order])),
            linewidths=0.6 + alpha,
            linestyles=[styles[str(front.provenance[row].get("planner"))] for row in order],
            alpha=alpha,
            capstyle="round",
            zorder=3,
            label="trajectories",
        ),
        autolim=False,
    )
    if norm.vmin == norm.vmax:
        return []
    return [Bar(ScalarMappable(norm, COST_COLOURS), f"{scale.label} of a trajectory", scale.counts)]


def draw_named(axes: Axes, front: Front, named: Sequence[Mark], line: Line) -> list[Handle]:
    """Draw trajectories thick; returns their legend entries, with what they cost."""
    handles: list[Handle] = []
    for layer, mark in enumerate(named):
        x, y = line(front.trajectories[mark.row]).T
        (drawn,) = axes.plot(
            x,
            y,
            color=mark.colour,
            linestyle=mark.dashes,
            linewidth=2.2,
            label=mark.legend(quantities(front)[: len(front.names)], WRAP),
            zorder=4 + 0.1 * layer,
            solid_capstyle="round",
        )
        drawn.set_path_effects([withStroke(linewidth=3.8, foreground="white")])
        handles.append(drawn)
    return handles


def planner_entries(front: Front) -> list[Handle]:
    """Who found what, where several planners share a front: each has its own dashes."""
    counts = _counts(front)
    return [
        Line2D([], [], color=QUIET, linestyle=dashes, linewidth=1.2, label=printable(f"found by {name}: {count}"))
        for (name, count), dashes in zip(counts.items(), cycle(DASHES), strict=False)
        if len(counts) > 1
    ]


def _counts(front: Front) -> dict[str, int]:
    """How many trajectories are of each planner, the one with most first."""
    return dict(Counter(str(origin.get("planner")) for origin in front.provenance).most_common())
