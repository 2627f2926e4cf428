"""Charts over time: criteria and camera speeds along one trajectory, and the robot's joints along several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import ScaledTranslation

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.math import norm
from hpop.base.options import FARTHEST
from hpop.base.text import printable
from hpop.criteria.visits import all_visits, missed_weights
from hpop.motions import Model, ModelInTime, States, StateSpace
from hpop.problems.evaluation import Trace
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.marks import STOP, is_held
from hpop.view.page import figure_for, whole
from hpop.view.style import (
    COLOURS,
    HALO,
    LARGE,
    NORMAL,
    QUIET,
    SMALL,
    Mark,
    label,
    marks,
    plain,
    stacked,
    turns_in_place,
    value_text,
    whole_ticks,
)

SAMPLES = 3000  # of the speeds
PLANNED, EXECUTED = COLOURS[2], COLOURS[1]
TURN, HELD = "#e6e6e6", "#cfe3d4"
NAME = 13  # letters of a stop's name that fit into the height of a panel
DIGIT, GAP = 0.64 * SMALL, 11.0  # points: width of a digit at a tick, and other space between a panel and its name


@checked_arguments
@plain
def draw_trace(
    problem: Problem, trajectory: Trajectory, *, name: str = "the trajectory", ax: Axes | None = None
) -> Figure:
    """Draw, over time along one trajectory, each criterion, and the camera's speed and rotation.

    Speed and rotation are shown as planned and as executed. For a sum, the line is the running total; for a criterion
    of the whole trajectory, its value up to then. For a time-mean or a maximum, a line shows the running mean or
    maximum, and an area the value at the time. Planned turns in place and waits are shaded; the robot executes them at
    slightly different times. On a tour, each visit has the number and name of its stop.

    Parameters
    ----------
    problem : Problem
        World and criteria.
    trajectory : Trajectory
        A planned trajectory of the problem's model.
    name : str
        Name in the title.
    ax : Axes, optional
        Axes in a grid, such as those of `plt.subplots`. They are removed, the picture takes their place, and this part
        of the figure is returned. Make the grid with ``layout="constrained"``, so that texts have room. By default, the
        picture is a new figure.
    """
    executed = trajectory.execution()
    rows = len(problem.criteria) + 2
    figure = figure_for(ax, 7.2, 1.25 * rows + 1.3)
    panels = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
    trace = problem.trace(trajectory)
    for column, axes in enumerate(panels[:-2]):
        _draw_criterion(axes, trace, column)
    as_planned = executed is trajectory
    looks = [(trajectory, _look(PLANNED, 2.4)), *([] if as_planned else [(executed, _look(EXECUTED, 1.2))])]
    rates = [camera_rates(motion, _moments(motion)) for motion, _ in looks]
    upright = all(each.upright for each in rates)
    for (motion, look), each in zip(looks, rates, strict=True):
        panels[-2].plot(_moments(motion), each.speed, **look)
        panels[-1].plot(_moments(motion), each.yaw_rate if upright else each.rotation_rate, **look)
    _name_row(panels[-2], "camera speed (m/s)", "")
    _name_row(panels[-1], "camera yaw rate (rad/s)" if upright else "camera rotation rate (rad/s)", "")
    for axes in panels:
        _shade(axes, trajectory, turns_in_place(trajectory), TURN, "turn")
        _shade(axes, trajectory, is_held(trajectory), HELD, "hold")
        axes.tick_params(labelsize=SMALL)
    _name_visits(panels.tolist(), problem, trajectory)
    panels[0].set_xlim(0.0, max(trajectory.duration, executed.duration) or 1.0)
    panels[-1].set_xlabel("time (s)", fontsize=NORMAL)
    _align_names(figure, panels.tolist())
    lasts = f"planned {trajectory.duration:.1f} s, executed {executed.duration:.1f} s"
    if as_planned:
        lasts = f"{value_text(trajectory.duration, 's', False)}, executed as planned"
    figure.suptitle(f"Along {name}: {lasts}", fontsize=LARGE)
    shades = [
        Patch(color=colour, label=f"planned {what}")
        for what, colour, motions in (
            ("turn in place", TURN, turns_in_place(trajectory)),
            ("standing still", HELD, is_held(trajectory)),
        )
        if motions.any()
    ]
    labels = ["planned and executed"] if as_planned else ["planned", "executed, from rest to rest"]
    handles = [*shades, *(Line2D([], [], label=text, **look) for text, (_, look) in zip(labels, looks, strict=True))]
    figure.legend(
        handles=handles, loc="outside lower center", ncols=4 if len(shades) > 1 else 3, fontsize=SMALL, frameon=False
    )
    return whole(figure)


class CameraRates(NamedTuple):
    """Speed and rotation of a camera at N times.

    speed          (N,)  m/s
    yaw_rate       (N,)  rad/s  counter-clockwise
    rotation_rate  (N,)  rad/s  about any axis, unsigned
    """

    speed: FloatArray
    yaw_rate: FloatArray
    rotation_rate: FloatArray

    @property
    def upright(self) -> bool:
        """Return whether the camera rotates about the vertical only."""
        return bool((np.abs(self.yaw_rate) == self.rotation_rate).all())


def camera_rates(trajectory: Trajectory, times: FloatArray) -> CameraRates:
    """Compute the camera's speed, m/s, and yaw rate and total rate of rotation, rad/s, at times (N,), s."""
    rates, _ = trajectory.rates(times)
    twist = trajectory.model.twist("camera", trajectory.at(times), rates)
    columns = (norm(twist.velocity), twist.rotation[2], norm(twist.rotation))
    return CameraRates(*(np.broadcast_to(column, times.shape) for column in columns))


def _draw_criterion(axes: Axes, trace: Trace, column: int) -> None:
    """Draw one criterion over time in a panel."""
    criterion, cost = trace.criteria[column], float(trace.cost[column])
    values, alone = trace.running[:, column], trace.rate[:, column]
    counts = criterion.unit == "1" and criterion.quantum == 1.0
    words = {"sum": "running total", "time-mean": "running mean", "max": "running worst"}
    text = words.get(criterion.aggregate, "running value")
    if criterion.aggregate in ("sum", "trajectory"):
        falls = bool((np.diff(values) < 0).any())  # as stops_missed, which begins with all stops
        highest, values = 0.0, np.concatenate([values[:1] if falls else [0.0], values])
    else:
        highest = alone.max(initial=0.0)
        values = np.concatenate([values[:1], values]) if values.size else np.zeros(1)
        axes.stairs(alone, trace.times, fill=True, color="#9ecae9", linewidth=0, zorder=1.5)
        text = f"line: {text}, area: value at the time"
    axes.plot(
        trace.times,
        values,
        color="black",
        linewidth=1.6,
        drawstyle="steps-post" if counts else "default",
        zorder=2.5,
        clip_on=False,  # else a last step at the right end is half as thick
    )
    final = value_text(cost, criterion.unit, counts)
    axes.set_ylim(0.0, 1.18 * max(values.max(), highest) or 1.0)
    axes.annotate(
        final, (1.0, cost), xycoords=("axes fraction", "data"), xytext=(4, 0), textcoords="offset points",
        fontsize=SMALL, va="center", annotation_clip=False,
    )  # fmt: skip
    _name_row(axes, label(criterion.name, criterion.unit, counts, criterion.quantity), text, counts=counts)


def _name_row(axes: Axes, words: str, text: str, *, counts: bool = False) -> None:
    """Write the label, name and unit, and the explanation of a panel."""
    axes.set_ylabel(stacked(words), fontsize=NORMAL)
    axes.set_title(text, fontsize=SMALL, color=QUIET, loc="left", pad=2)
    whole_ticks(axes.yaxis, counts, most=4)
    axes.spines[["top", "right"]].set_visible(False)


def _align_names(figure: Figure | SubFigure, panels: Sequence[Axes]) -> None:
    """Align the names of the panels in one column; faster than Matplotlib's `align_ylabels`."""
    ticks = [axes.yaxis.get_major_formatter().format_ticks(axes.yaxis.get_majorticklocs().tolist()) for axes in panels]
    room = GAP + DIGIT * max(len(text) for texts in ticks for text in texts)
    beside = ScaledTranslation(-room / 72.0, 0.0, figure.dpi_scale_trans)
    for axes in panels:
        axes.yaxis.set_label_coords(0.0, 0.5, transform=axes.transAxes + beside)


def _shade(axes: Axes, trajectory: Trajectory, motions: BoolArray, colour: str, gid: str) -> None:
    """Shade the times of the motions (n,) that a mask selects."""
    for i in np.flatnonzero(motions):
        axes.axvspan(trajectory.times[i], trajectory.times[i + 1], color=colour, linewidth=0, zorder=0.5, gid=gid)


def _name_visits(panels: Sequence[Axes], problem: Problem, trajectory: Trajectory) -> None:
    """Write number and name of each visited stop into the panel of the speed, which is 0 during a dwell.

    A visit without dwell is a line in all panels.
    """
    if problem.tour is None:
        return
    (found,) = all_visits(problem.tour, problem.world, [trajectory], missed_weights(problem.criteria))
    for visit in found.visits:
        if visit.begin == visit.end:
            for axes in panels:
                axes.axvline(visit.begin, color=STOP, linestyle=":", linewidth=0.9, zorder=0.6, gid="visit")
        name = printable(f"{visit.stop + 1} {problem.tour.names[visit.stop]}")
        panels[-2].text(
            0.5 * (visit.begin + visit.end), 0.96, name if len(name) <= NAME else f"{name[: NAME - 1].rstrip()}…",
            transform=panels[-2].get_xaxis_transform(), rotation=90, ha="center", va="top", gid="visit",
            fontsize=SMALL, color=STOP, path_effects=HALO, zorder=4,
        )  # fmt: skip


def _moments(trajectory: Trajectory) -> FloatArray:
    """Return evenly spaced times (N,), s, and times just before and after the ends of motions, where speeds jump."""
    ends = trajectory.times
    near = 1e-6 * max(trajectory.duration, 1.0)
    even = np.linspace(0.0, trajectory.duration, SAMPLES)
    return np.unique(np.clip(np.concatenate([even, ends - near, ends + near]), 0.0, trajectory.duration))


def _look(colour: str, width: float) -> dict[str, Any]:
    return {"color": colour, "linewidth": width}


STATE_SAMPLES = 600  # along each trajectory, beside the ends of its motions
CHANGES = 1e-6  # m or rad: a state that varies by less stays
WIDTH, PANEL, WORDS = 7.2, 1.15, 1.2  # inches: width of the picture, height of a panel and of the texts outside
LEGEND_LINE = 0.2  # inches
LEGEND_COLUMNS = 2
DEGREES = "°"
PARTS_OF_TURNS = [1, 1.5, 3, 4.5, 6, 9, 10]  # steps of ticks, and ten times as large: 30, 45, 60, 90
PLANE = ("x", "y", "yaw")
LIMIT: dict[str, Any] = {"color": QUIET, "linestyle": (0, (4, 3)), "linewidth": 1.0}


class StateColumn(NamedTuple):
    """Robot state to draw over time: its name, its unit, the factor from the model's unit, and its limits."""

    name: str
    unit: str
    scale: float
    limits: tuple[float, ...]

    @classmethod
    def of(cls, space: StateSpace, name: str) -> StateColumn:
        """Describe a state of the robot by its name, with angles in degrees; no limits if unbounded or turning."""
        place = space.names.index(name)
        unit = space.units[place]
        scale = 180.0 / np.pi if unit == "rad" else 1.0
        ends = () if name in space.turning else (space.low[place], space.high[place])
        limits = tuple(scale * end for end in ends if abs(end) < FARTHEST)
        return cls(name, DEGREES if unit == "rad" else unit, scale, limits)


def changing(model: Model, trajectories: Sequence[Trajectory]) -> list[str]:
    """Return the names of the states that change along some trajectories, to be drawn by :func:`draw_states`.

    For a robot in the plane, x and y are left out, because maps show them; if only x, y and yaw change, the list is
    empty.
    """
    names = [
        name
        for name in _own_names(model)
        if any(np.ptp(getattr(trajectory.states, name)) > CHANGES for trajectory in trajectories)
    ]
    if "plane" not in model.provides:
        return names
    return [name for name in names if name not in ("x", "y")] if set(names) - set(PLANE) else []


@checked_arguments
@plain
def draw_states(front: Front, *, chosen: Mapping[str, int] | None = None, ax: Axes | None = None) -> Figure:
    """Draw the planned states of the robot over time, one panel each, with dashed lines at their limits.

    Angles are in degrees. For a robot in the plane x and y are left out, because the map shows them. The title names
    the states that stay constant.

    Parameters
    ----------
    front : Front
        At least one of its trajectories changes a state that the map does not show (:func:`changing`).
    chosen : mapping from label to row, optional
        Trajectories to draw; by default the knee and the best of each criterion.
    ax : Axes, optional
        Axes in a grid, such as those of `plt.subplots`. They are removed, the picture takes their place, and this part
        of the figure is returned. Make the grid with ``layout="constrained"``, so that texts have room. By default, the
        picture is a new figure.
    """
    named = marks(front, chosen)
    trajectories = [front.trajectories[mark.row] for mark in named]
    model = trajectories[0].model
    names = changing(model, trajectories)
    figure = figure_for(ax, WIDTH, PANEL * len(names) + WORDS + LEGEND_LINE * -(-len(named) // LEGEND_COLUMNS))
    panels = figure.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
    sampled = [_sampled(trajectory) for trajectory in trajectories]
    for axes, name in zip(panels, names, strict=True):
        _draw_column(axes, StateColumn.of(model.space, name), named, sampled)
    panels[0].set_xlim(0.0, max(trajectory.duration for trajectory in trajectories) or 1.0)
    panels[-1].set_xlabel("time (s)", fontsize=NORMAL)
    figure.suptitle(_title(model, names), fontsize=LARGE)
    handles = [Line2D([], [], label=mark.label, **_look_of(mark)) for mark in named]
    if any(StateColumn.of(model.space, name).limits for name in names):
        handles.append(Line2D([], [], label="limit", **LIMIT))
    place: dict[str, Any] = {"loc": "outside lower center", "ncols": LEGEND_COLUMNS}
    figure.legend(handles=handles, fontsize=SMALL, frameon=False, handlelength=4.0, **place)
    return whole(figure)


def _sampled(trajectory: Trajectory) -> tuple[FloatArray, States]:
    """Return evenly spaced times (T,), s, together with the ends of motions, and the states at these times."""
    times = np.union1d(np.linspace(0.0, trajectory.duration, STATE_SAMPLES), trajectory.times)
    return times, trajectory.at(times)


def _draw_column(
    axes: Axes, column: StateColumn, named: Sequence[Mark], sampled: Sequence[tuple[FloatArray, States]]
) -> None:
    """Draw one state of the named trajectories over time in a panel, with its limits."""
    for layer, (mark, (times, states)) in enumerate(zip(named, sampled, strict=True)):
        values = column.scale * getattr(states, column.name)
        at, gid = 3 + 0.1 * layer, f"{column.name} of {mark.label}"
        axes.plot(times, values, gid=gid, zorder=at, **_look_of(mark))
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


def _own_names(model: Model) -> tuple[str, ...]:
    """Return the names of a model's states; for a model with time as a state, those of the model without time."""
    return (cast(ModelInTime, model).timeless if "time" in model.provides else model).space.names


def _look_of(mark: Mark) -> dict[str, Any]:
    return {"color": mark.colour, "linestyle": mark.dashes, "linewidth": 1.8}


def _title(model: Model, names: Sequence[str]) -> str:
    """Return the title, which names the states that do not change."""
    shown = [*names, "x", "y"] if "plane" in model.provides else names
    still = [printable(name) for name in _own_names(model) if name not in shown]
    unchanged = f"; {', '.join(still)} {'does' if len(still) == 1 else 'do'} not change" if still else ""
    return f"The robot's states along time, as planned{unchanged}"
