"""Charts of a front (scatter plots of its costs, a person's weights), and of a batch (box plots of each planner)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullLocator

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.files import replacing
from hpop.errors import OptionError
from hpop.preference import Preference
from hpop.problems.front import FOR_YOU, Front
from hpop.problems.problem import Problem
from hpop.view.map import draw_map
from hpop.view.page import figure_for, whole
from hpop.view.style import (
    COLOURS,
    HALO,
    LARGE,
    NORMAL,
    POINT,
    QUIET,
    SMALL,
    Mark,
    Quantity,
    drawn_rows,
    how_many_drawn,
    marks,
    plain,
    quantities,
    stacked,
    whole_ticks,
)

if TYPE_CHECKING:
    from hpop.batches import PlannerSummary

MOST_IN_MATRIX = 4
WRAP = 32  # characters a line in a legend beside each empty panel
WIDE = 110  # characters a line in a legend below
ROOM = 0.06  # share of an axis left free at both ends


@checked_arguments
@plain
def draw_front(front: Front, *, chosen: Mapping[str, int] | None = None, ax: Axes | None = None) -> Figure:
    """Draw the costs of a front: scatter plots of all pairs for two to four criteria, else parallel coordinates.

    At most 2,000 parallel lines are drawn, evenly over the front; the title then says so.

    Parameters
    ----------
    front : Front
        Any number of points, at least one.
    chosen : mapping from label to row, optional
        Points to mark and name, as on the map; by default the knee and the best of each criterion.
    ax : Axes, optional
        Axes of a grid, such as those of `plt.subplots`, to be replaced by the picture; their figure is returned. Use
        ``layout="constrained"``, so that texts have room. By default a new figure.

    Raises
    ------
    OptionError
        If the front has no points, or ``chosen`` names a row that it does not have.
    """
    if not len(front):
        raise OptionError(
            f"expected a front with at least one point, got none; its search ended with {front.status!r}, and "
            "hpop.view.draw_map draws the empty map"
        )
    columns = quantities(front)[: len(front.names)]
    named = marks(front, chosen)
    if 2 <= len(columns) <= MOST_IN_MATRIX:
        return whole(_scatter_matrix(columns, named, ax))
    return whole(_parallel(columns, named, drawn_rows(front), how_many_drawn(front), ax))


def limits(values: FloatArray) -> tuple[float, float]:
    """Return the limits of an axis that holds some values, with a margin; a constant gets a margin too.

    >>> limits(np.array([5.0, 5.0]))
    (4.5, 5.5)
    """
    low, high = float(values.min()), float(values.max())
    room = ROOM * (high - low) or 0.1 * abs(low) or 0.5
    return low - room, high + room


def _scatter_matrix(columns: Sequence[Quantity], named: Sequence[Mark], ax: Axes | None) -> FigureBase:
    """Draw a scatter plot of each pair of criteria, below the diagonal, with the legend in the empty corner."""
    size = len(columns) - 1
    figure = figure_for(ax, *((6.4, 5.6) if size == 1 else (2.7 * size + 1.2, 2.5 * size + 0.9)))
    panels = figure.subplots(size, size, squeeze=False)
    for i in range(size):
        for j in range(size):
            if j > i:
                panels[i, j].set_axis_off()
                continue
            x, y = columns[j], columns[i + 1]
            _scatter(panels[i, j], x, y, named)
            if size == 1:
                _staircase(panels[i, j], x, y)
            if i == size - 1:
                panels[i, j].set_xlabel(x.label, fontsize=NORMAL)
            else:
                panels[i, j].tick_params(labelbottom=False)
            if j == 0:
                panels[i, j].set_ylabel(y.label, fontsize=NORMAL)
            else:
                panels[i, j].tick_params(labelleft=False)
    figure.suptitle(_title(columns, "less is better on every axis: best is lower left"), fontsize=LARGE)
    if size == 1:
        _legend(figure, columns, named)
    else:
        handles = _handles(columns, named, WRAP * (size - 1))
        panels[0, 1].legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(-0.06, 1.04),
            fontsize=SMALL,
            frameon=False,
            handlelength=1.2,
        ).set_in_layout(False)
    return figure


def _scatter(axes: Axes, x: Quantity, y: Quantity, named: Sequence[Mark]) -> None:
    """Draw the scatter plot of one pair of criteria, with the named trajectories as larger markers."""
    count = x.values.size
    axes.scatter(
        x.values,
        y.values,
        s=np.clip(2000 / count, 5, 26),
        color=POINT,
        alpha=np.clip(15.0 / np.sqrt(count), 0.25, 0.9),
        linewidths=0,
        rasterized=count > 1000,
        label="trajectories",
        zorder=2,
    )
    for layer, mark in enumerate(named):
        axes.plot(
            x.values[mark.row],
            y.values[mark.row],
            linestyle="none",
            marker=mark.marker,
            markersize=max(6.5, 10.0 - layer),  # equal points show each other
            markerfacecolor=mark.colour,
            markeredgecolor="white",
            label=mark.label,
            zorder=3,
        )
    axes.set(xlim=limits(x.values), ylim=limits(y.values))
    whole_ticks(axes.xaxis, x.counts)
    whole_ticks(axes.yaxis, y.counts)
    axes.tick_params(labelsize=SMALL)
    axes.grid(color="#e4e4e4", linewidth=0.6)
    axes.set_axisbelow(True)


def _staircase(axes: Axes, x: Quantity, y: Quantity) -> None:
    """Shade the area of costs that are dominated by a point of a two-criteria front."""
    order = np.argsort(x.values, kind="stable")
    right, top = axes.get_xlim()[1], axes.get_ylim()[1]
    across = np.append(x.values[order], right)
    down = np.append(y.values[order], y.values[order][-1])
    axes.fill_between(across, down, top, step="post", color="#efefef", linewidth=0, zorder=0.4, label="dominated")
    axes.text(0.98, 0.97, "dominated", transform=axes.transAxes, ha="right", va="top", fontsize=SMALL, color=QUIET)


def _parallel(
    columns: Sequence[Quantity], named: Sequence[Mark], rows: IntArray, drawn: str, ax: Axes | None
) -> FigureBase:
    """Draw parallel coordinates: a vertical axis for each criterion, least at the bottom, and a line per trajectory.

    Only the trajectories in ``rows`` and the named ones are drawn; ``drawn`` says so in the title.
    """
    count = rows.size
    bounds = np.array([limits(column.values) for column in columns])  # (k, 2)
    table = np.stack([column.values for column in columns], axis=1)  # (n, k)
    scaled = (table - bounds[:, 0]) / (bounds[:, 1] - bounds[:, 0])
    figure = figure_for(ax, max(5.0, 1.55 * len(columns) + 1.0), 5.6)
    axes = figure.add_subplot(label="parallel")
    at = np.arange(len(columns))
    alpha = float(np.clip(60.0 / count, 0.03, 0.7))  # lines cover far more than points
    lines = [np.stack([at, row], axis=1) for row in scaled[rows]]
    axes.add_collection(
        LineCollection(
            lines,
            colors=POINT,
            linewidths=0.5 + alpha,
            alpha=alpha,
            rasterized=count > 1000,
            label="trajectories",
        )
    )
    for mark in named:
        axes.plot(
            at,
            scaled[mark.row],
            color=mark.colour,
            linestyle=mark.dashes,
            linewidth=2.0,
            marker=mark.marker,
            markersize=8,
            markeredgecolor="white",
            label=mark.label,
            zorder=3,
        )
    axes.set(xlim=(-0.3, len(columns) - 0.5), ylim=(0, 1), yticks=[])
    axes.set_xticks(at, [stacked(column.label) for column in columns], fontsize=NORMAL)
    axes.spines[:].set_visible(False)
    for j, column in enumerate(columns):
        scale = axes.twinx()
        scale.set_label(column.label)
        scale.spines[:].set_visible(False)
        scale.spines["right"].set(visible=True, position=("data", j), color=QUIET)
        scale.set_ylim(*bounds[j])
        whole_ticks(scale.yaxis, column.counts, most=6)
        scale.tick_params(labelsize=SMALL, color=QUIET)
        for text in scale.get_yticklabels():
            text.set_path_effects(list(HALO))
    figure.suptitle(_title(columns, "less is better on every axis: best is at the bottom", drawn), fontsize=LARGE)
    _legend(figure, columns, named)
    return figure


def _title(columns: Sequence[Quantity], reading: str, drawn: str = "") -> str:
    """Return the title of a chart: the number of trajectories, and how to read the axes."""
    count = columns[0].values.size
    return f"{count} non-dominated {'trajectory' if count == 1 else 'trajectories'}{drawn}\n{reading}"


def _legend(figure: FigureBase, columns: Sequence[Quantity], named: Sequence[Mark]) -> None:
    handles = _handles(columns, named, WIDE)
    figure.legend(handles=handles, loc="outside lower center", fontsize=SMALL, frameon=False, handlelength=4.0)


def _handles(columns: Sequence[Quantity], named: Sequence[Mark], width: int) -> list[Line2D]:
    """Return the legend entries: one for each named trajectory, with its costs, and one for all other trajectories."""
    points = 2 <= len(columns) <= MOST_IN_MATRIX
    entries = [
        Line2D(
            [],
            [],
            color=mark.colour,
            linestyle="none" if points else mark.dashes,
            marker=mark.marker,
            markersize=8,
            markeredgecolor="white",
            label=mark.legend(columns, width),
        )
        for mark in named
    ]
    if columns[0].values.size > len(named):
        look: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 4} if points else {"linewidth": 1.0}
        entries.append(Line2D([], [], color=POINT, label="one of the other trajectories", **look))
    return entries


LEVEL = 0.9  # probability of the intervals of the weights
WIDTH, HEIGHT = 13.0, 5.2


@checked_arguments
@plain
def draw_preference(problem: Problem, front: Front, person: Preference, *, ax: Axes | None = None) -> Figure:
    """Draw a person's weights of the costs with their 90 % intervals, and a map with the best trajectory and the knee.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories; at least one.
    person : Preference
        Preference learnt from this front, or from another with equal costs.
    ax : Axes, optional
        Axes of a grid, to be replaced by the picture; by default a new figure.

    Raises StudyError if the front lacks a cost of the preference.
    """
    best = person.best(front)
    figure = figure_for(ax, WIDTH, HEIGHT)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 2.4))
    _draw_shares(left, person)
    seen = "" if person.can_be_seen else "\nno preference can be seen"
    left.set_title(f"What counts ({person.question}, {len(person.answers)} answers){seen}", fontsize=SMALL + 1)
    chosen = {"knee": front.knee().index, FOR_YOU: best.row}
    draw_map(problem, front, chosen=chosen, ax=right)
    sure = f"best with probability {best.probability[best.row]:.2f}, expected regret {100 * best.regret:.1f} %"
    right.set_title(f"{FOR_YOU}: row {best.row}, {sure}", fontsize=SMALL + 1, pad=18)
    return whole(figure)


def _draw_shares(axes: Axes, person: Preference) -> None:
    """Draw the mean weight of each cost as a dot on a line, its 90 % interval, with the greatest weight at the top."""
    shares, intervals = person.weights, person.interval(LEVEL)
    names = sorted(shares, key=lambda name: shares[name])
    places = np.arange(len(names))
    low, high = np.array([intervals[name] for name in names]).T
    axes.hlines(places, low, high, color=COLOURS[2], linewidth=3, alpha=0.6)
    axes.plot([shares[name] for name in names], places, "o", color=COLOURS[2])
    axes.axvline(1 / len(names), color=QUIET, linewidth=0.8, linestyle=":")
    axes.set_yticks(places, names)
    axes.set_ylim(-0.7, len(names) - 0.3)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("weight of the cost, with its 90 % interval;\ndotted: equal weights", fontsize=SMALL)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


PANELS = (
    ("seconds", "planning time, s", "log"),
    ("points", "trajectories on the front", "log"),
    ("shares", "share of the joint hypervolume", "linear"),
)


@checked_arguments
def draw_batch(found: Sequence[PlannerSummary], path: Path) -> None:
    """Write box plots of planning time, front size and hypervolume for each planner to a PNG, PDF or SVG file.

    ``found`` is the result of :func:`hpop.batches.summaries`. Raises OptionError for another ending of ``path``.
    """
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise OptionError(f"expected a file name that ends in .png, .pdf or .svg, got {path.name!r}")
    figure = _figure(found)
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:].lower(), dpi=150)


def _figure(found: Sequence[PlannerSummary]) -> Figure:
    figure = Figure(figsize=(10.0, 1.4 + 0.5 * len(found)), layout="constrained")
    axes = figure.subplots(1, len(PANELS), sharey=True)
    labels = [each.planner for each in found]
    for axis, (name, heading, scale) in zip(axes, PANELS, strict=True):
        numbers = [np.asarray(getattr(each, name)) for each in found]
        if scale == "log":
            numbers = [values[values > 0] for values in numbers]
        axis.boxplot(numbers, orientation="horizontal", widths=0.6, medianprops={"color": "tab:red"})
        if not any(values.size for values in numbers):
            axis.text(0.5, 0.5, "nothing to compare", transform=axis.transAxes, ha="center", va="center")
        elif scale == "log":
            axis.set_xscale("log")
            axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.xaxis.set_major_formatter("{x:g}")
            axis.xaxis.set_minor_locator(NullLocator())
        axis.set_xlabel(heading)
        axis.set_yticks(range(1, len(labels) + 1), labels)
        axis.grid(visible=True, axis="x", color="0.9")
    axes[0].invert_yaxis()
    return figure
