"""The states of a robot along time: how each joint moves along the trajectories that are named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import FARTHEST
from hpop.base.text import printable
from hpop.motions import Model, States, StateSpace
from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory
from hpop.view.canvas import figure_for, whole
from hpop.view.style import LARGE, NORMAL, QUIET, SMALL, Mark, marks, plain, whole_ticks

SAMPLES = 600  # along each trajectory, beside the ends of its motions
CHANGES = 1e-6  # m or rad: a state that varies by less stays
WIDTH, PANEL, WORDS = 7.2, 1.15, 1.2  # inches: of the picture, the height of a panel, what is above and below all
LEGEND_LINE = 0.2  # inches
LEGEND_COLUMNS = 2
DEGREES = "°"
PARTS_OF_TURNS = [1, 1.5, 3, 4.5, 6, 9, 10]  # steps of ticks, and ten times as large: 30, 45, 60, 90
PLANE = ("x", "y", "yaw")
LIMIT: dict[str, Any] = {"color": QUIET, "linestyle": (0, (4, 3)), "linewidth": 1.0}


class Column(NamedTuple):
    """One state as it is drawn: its name, its unit, and how many of these a unit of the space is."""

    name: str
    unit: str
    scale: float
    limits: tuple[float, ...]

    @classmethod
    def of(cls, space: StateSpace, name: str) -> Column:
        """Angles in degrees; what turns without end has no limits, nor what may be anywhere."""
        place = space.names.index(name)
        unit = space.units[place]
        scale = 180.0 / np.pi if unit == "rad" else 1.0
        ends = () if name in space.turning else (space.low[place], space.high[place])
        limits = tuple(scale * end for end in ends if abs(end) < FARTHEST)
        return cls(name, DEGREES if unit == "rad" else unit, scale, limits)


def changing(model: Model, trajectories: Sequence[Trajectory]) -> list[str]:
    """The states that change along some trajectories, and that maps do not show; none of a rigid robot in the plane."""
    names = [
        name
        for name in model.space.names
        if any(np.ptp(getattr(trajectory.states, name)) > CHANGES for trajectory in trajectories)
    ]
    if "plane" not in model.provides:
        return names
    return [name for name in names if name not in ("x", "y")] if set(names) - set(PLANE) else []


@checked_arguments
@plain
def draw_states(front: Front, *, chosen: Mapping[str, int] | None = None, ax: Axes | None = None) -> Figure:
    """Draw the states along time as they are planned, one panel each, with dashed lines at their limits.

    Angles are in degrees. Of a robot in the plane x and y, which the map shows, are left out; what never changes is
    named in the title.

    Parameters
    ----------
    front : Front
        At least one of its trajectories changes a state that the map does not show (:func:`changing`).
    chosen : mapping from label to row, optional
        Trajectories to draw; by default the knee and the best of each criterion.
    ax : Axes, optional
        Where to draw, one of a grid such as `plt.subplots` makes: the picture takes its place, and its figure is
        returned; by default a new figure that fits. Make yours with ``layout="constrained"``, and texts find room.
    """
    named = marks(front, chosen)
    trajectories = [front.trajectories[mark.row] for mark in named]
    model = trajectories[0].model
    names = changing(model, trajectories)
    figure = figure_for(ax, WIDTH, PANEL * len(names) + WORDS + LEGEND_LINE * -(-len(named) // LEGEND_COLUMNS))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    sampled = [_sampled(trajectory) for trajectory in trajectories]
    for axes, name in zip(panels, names, strict=True):
        _draw_column(axes, Column.of(model.space, name), named, sampled)
    panels[0].set_xlim(0.0, max(trajectory.duration for trajectory in trajectories) or 1.0)
    panels[-1].set_xlabel("time (s)", fontsize=NORMAL)
    figure.suptitle(_title(model, names), fontsize=LARGE)
    handles = [Line2D([], [], label=mark.label, **_look(mark)) for mark in named]
    if any(Column.of(model.space, name).limits for name in names):
        handles.append(Line2D([], [], label="limit", **LIMIT))
    place: dict[str, Any] = {"loc": "outside lower center", "ncols": LEGEND_COLUMNS}
    figure.legend(handles=handles, fontsize=SMALL, frameon=False, handlelength=4.0, **place)
    return whole(figure)


def _sampled(trajectory: Trajectory) -> tuple[FloatArray, States]:
    times = np.union1d(np.linspace(0.0, trajectory.duration, SAMPLES), trajectory.times)
    return times, trajectory.at(times)


def _draw_column(
    axes: Axes, column: Column, named: Sequence[Mark], sampled: Sequence[tuple[FloatArray, States]]
) -> None:
    for layer, (mark, (times, states)) in enumerate(zip(named, sampled, strict=True)):
        values = column.scale * getattr(states, column.name)
        at, gid = 3 + 0.1 * layer, f"{column.name} of {mark.label}"
        axes.plot(times, values, gid=gid, zorder=at, **_look(mark))
    for limit in column.limits:
        axes.axhline(limit, gid=f"limit of {column.name}", zorder=1, **LIMIT)
    name = printable(f"{column.name} ({column.unit})")  # above the panel: joints have long names
    axes.set_title(name, fontsize=NORMAL, loc="left", pad=3)
    axes.tick_params(labelsize=SMALL)
    axes.margins(y=0.08)
    axes.spines[["top", "right"]].set_visible(False)
    if column.unit == DEGREES:
        axes.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=PARTS_OF_TURNS))
    else:
        whole_ticks(axes.yaxis, False, most=4)


def _look(mark: Mark) -> dict[str, Any]:
    return {"color": mark.colour, "linestyle": mark.dashes, "linewidth": 1.8}


def _title(model: Model, names: Sequence[str]) -> str:
    shown = [*names, "x", "y"] if "plane" in model.provides else names
    still = [printable(name) for name in model.space.names if name not in shown]
    unchanged = f"; {', '.join(still)} {'does' if len(still) == 1 else 'do'} not change" if still else ""
    return f"The robot's states along time, as planned{unchanged}"
