"""Small maps that show where along a trajectory each criterion's cost arises."""

from __future__ import annotations

import math
from textwrap import fill

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.text import printable
from hpop.criteria.base import Criterion
from hpop.problems.evaluation import Trace
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.content import draw_content
from hpop.view.ground import View, outline, view_of
from hpop.view.map import turn_dot
from hpop.view.marks import (
    CIRCLE,
    RING,
    Colour,
    Held,
    draw_ends,
    draw_holds,
    draw_stops,
    draw_targets,
    hold_entry,
    is_held,
    stop_places,
)
from hpop.view.outlines import draw_map_obstacles, from_above
from hpop.view.page import LINE, Handle, figure_for, height_of, whole
from hpop.view.style import (
    LARGE,
    NORMAL,
    QUIET,
    SMALL,
    camera_heights,
    label,
    mapped_body,
    mapped_points,
    path_points,
    plain,
    turns_in_place,
    value_text,
    whole_ticks,
)

COLUMNS = 2  # of maps
ENTRIES = 3  # of the legend in a row, below two maps
WIDTH, MAP_WIDTH = 4.6, 3.45  # inches of one map, with and without its axes and colour bar
WORDS = 0.7  # inches above and below it
DOT = 6.5  # points across, of a turn
BEYOND = 5.5  # points by which a turn at an end is larger than the letter that covers its middle
SPOT = 6  # decimals of m to which the positions of turns are compared
DIGITS = 10  # of the largest rate; further digits are rounding errors, which would shift ticks
TITLE_WIDTH = 45  # characters a line of the title over one map
RATE_COLOURS: Colormap = ListedColormap(colormaps["magma_r"](np.linspace(0.12, 1.0, 256)), name="rate")


@checked_arguments
@plain
def draw_where(
    problem: Problem, trajectory: Trajectory, *, name: str = "the trajectory", ax: Axes | None = None
) -> Figure:
    """Draw a small map for each criterion, with the trajectory coloured by the cost that arises there; dark is high.

    Colours show the cost per second of a sum, the local value of a time-mean or a maximum, and the change per second of
    a criterion of the whole trajectory. For a count, such as turns, they show the number counted in each motion; turns
    in place at one position are added up. Turns in place are dots, or rings round the letters S and G at start and
    goal. A wait is a clock in the colour of its cost.

    Parameters
    ----------
    problem : Problem
        World and criteria.
    trajectory : Trajectory
        A planned trajectory of the problem's model.
    name : str
        Name in the title.
    ax : Axes, optional
        Axes of a grid, such as those of `plt.subplots`, to be replaced by the picture; their figure is returned. Use
        ``layout="constrained"``, so that texts have room. By default a new figure.
    """
    trace = problem.trace(trajectory)
    view, ends = view_of(problem, [path_points(trajectory)]), path_points(trajectory)[[0, -1]].tolist()
    heights = camera_heights(problem, [trajectory])
    drawn = name if mapped_body(problem.model) == "base" else f"{name}: path of the camera"
    columns = min(COLUMNS, len(trace.criteria))
    rows = math.ceil(len(trace.criteria) / columns)
    height = np.clip(MAP_WIDTH * view.height / view.width, 1.0, 2.0 * MAP_WIDTH) + WORDS
    figure = figure_for(ax, WIDTH * columns, height * rows + 0.35, layout="compressed")
    maps = figure.subplots(rows, columns, squeeze=False).ravel()
    handles: list[Handle] = []
    for place, axes in enumerate(maps):
        if place >= len(trace.criteria):
            axes.set_axis_off()
            continue
        floor = PathPatch(outline(problem.world.extent), facecolor="white", linewidth=0.0, zorder=0.1)
        axes.add_artist(floor)
        _draw_shown(figure, axes, problem, trace, place, view)
        handles = [
            Line2D([], [], color=RATE_COLOURS(0.5), linewidth=3.0, label=drawn),
            *_turn_entry(trajectory),
            *[hold_entry()] * bool(is_held(trajectory).any()),
            *draw_ends(axes, ends[0], ends[1:]),
            *draw_map_obstacles(axes, problem, heights, view),
            *draw_content(axes, problem.world, view, small=True),
            *draw_targets(axes, problem, from_above),
            *draw_stops(axes, problem),
        ]
        axes.set_xlim(view.x_min, view.x_max)
        axes.set_ylim(view.y_min, view.y_max)
        axes.set_aspect("equal")
        axes.tick_params(labelsize=SMALL)
        axes.set_xlabel("x (m)", fontsize=SMALL)
        axes.set_ylabel("y (m)", fontsize=SMALL)
        whole_ticks(axes.xaxis, False, most=7)
        whole_ticks(axes.yaxis, False)
    abreast = ENTRIES if columns > 1 else 1
    figure.legend(handles=handles, loc="outside lower center", ncols=abreast, fontsize=SMALL, frameon=False)
    if isinstance(figure, Figure):
        width, height = figure.get_size_inches()
        figure.set_size_inches(width, height + LINE * (height_of(handles) / abreast + 1))
    title = f"Where along {name} each cost arises: dark is much"
    figure.suptitle(fill(title, TITLE_WIDTH * columns), fontsize=LARGE)
    return whole(figure)


def shown_along(trace: Trace, column: int) -> FloatArray:
    """Return the values (n,) that colour the pieces of a trace: the criterion's rate, or the events that it counts.

    Pieces at one position are drawn over each other. So pieces of a motion in place show the motion's mean rate, or its
    maximum. If the criterion counts events (turns), each piece shows the number in its whole motion; for turns in
    place, the number in all of them at that position.
    """
    criterion, trajectory, owner = trace.criteria[column], trace.pieces.trajectory, trace.pieces.owner
    points = mapped_points(trajectory.model, trace.states)
    if not _counts(criterion) or criterion.aggregate in ("time-mean", "max"):
        rate, each = trace.rate[:, column], np.zeros(len(trajectory))
        if criterion.aggregate == "max":
            np.maximum.at(each, owner, rate)
        else:
            np.add.at(each, owner, rate * trace.pieces.durations)
            each = np.divide(each, trajectory.durations, out=np.zeros_like(each), where=trajectory.durations > 0)
        moves = np.zeros(len(trajectory), dtype=bool)
        np.logical_or.at(moves, owner, (points[1:] != points[:-1]).any(axis=1))
        return np.where(moves[owner], rate, each[owner])
    grown = np.diff(trace.running[:, column], prepend=0.0)  # (n,)
    number = np.zeros(len(trajectory))
    np.add.at(number, owner, grown)
    turning = turns_in_place(trajectory)
    turned_at = mapped_points(trajectory.model, trajectory.states)[1:][turning]
    _, spots = np.unique(np.round(turned_at, SPOT), axis=0, return_inverse=True)
    spots = spots.reshape(-1)
    number[turning] = np.bincount(spots, number[turning])[spots]
    return number[owner]


def _draw_shown(figure: FigureBase, axes: Axes, problem: Problem, trace: Trace, column: int, view: View) -> None:
    """Draw the coloured trajectory of one criterion, its turns and waits, and the colour bar."""
    criterion, trajectory = trace.criteria[column], trace.pieces.trajectory
    shown = shown_along(trace, column)
    points = mapped_points(trajectory.model, trace.states)
    norm = Normalize(0.0, float(f"{shown.max(initial=0.0):.{DIGITS}g}") or 1.0)
    turning = turns_in_place(trajectory)
    moving = ~turning[trace.pieces.owner]
    axes.add_collection(
        LineCollection(
            list(np.stack([points[:-1], points[1:]], axis=1)[moving]),
            array=shown[moving],
            cmap=RATE_COLOURS,
            norm=norm,
            linewidths=3.0,
            capstyle="projecting",  # pieces that only touch leave seams, which pale the colour of a slanting way
            zorder=4,
            gid="rate",
        )
    )
    turns = mapped_points(trajectory.model, trajectory.states)[:-1][turning]
    each = shown[np.cumsum(trace.pieces.counts)[turning] - 1]
    at_start, at_goal = _turns_at_ends(points, turns).values()
    letter = RING if (points[0] == points[-1]).all() else CIRCLE
    sizes = np.where(at_start | at_goal, letter + BEYOND, DOT) ** 2
    x, y = turns.T
    axes.scatter(x, y, c=each, cmap=RATE_COLOURS, norm=norm, s=sizes, edgecolors="white", zorder=5, gid="turns")
    of_motion = shown[np.cumsum(trace.pieces.counts) - 1] if len(trajectory) else shown

    def face(held: Held) -> Colour:
        """Return the colour that shows the cost of a wait."""
        return RATE_COLOURS(float(norm(of_motion[list(held.motions)].max())))

    draw_holds(axes, trajectory, QUIET, view, taken=stop_places(problem), face=face)
    beside = axes.inset_axes((1.02, 0.0, 0.035, 1.0))
    bar = figure.colorbar(ScalarMappable(norm, RATE_COLOURS), cax=beside)
    bar.ax.tick_params(labelsize=SMALL)
    bar.set_label(shown_label(criterion), fontsize=SMALL)
    whole_ticks(bar.ax.yaxis, _counts(criterion))
    total = value_text(float(trace.cost[column]), criterion.unit, _counts(criterion))
    words = {"time-mean": "on average", "max": "at worst"}.get(criterion.aggregate, "in all")
    axes.set_title(printable(f"{criterion.name}: {total} {words}"), fontsize=NORMAL)


def _turns_at_ends(points: FloatArray, turns: FloatArray) -> dict[str, BoolArray]:
    """Return masks (m,) of the turns (m, 2) that are at the start ("S") and at the goal ("G") of a path (n, 2)."""
    return {letter: (turns == end).all(axis=1) for letter, end in (("S", points[0]), ("G", points[-1]))}


def _turn_entry(trajectory: Trajectory) -> list[Handle]:
    """Return the legend entry for turns in place, in a list; an empty list if there are none."""
    points = mapped_points(trajectory.model, trajectory.states)
    turns = points[1:][turns_in_place(trajectory)]
    if not len(turns):
        return []
    letters = [letter for letter, here in _turns_at_ends(points, turns).items() if here.any()]
    ring = f",\na ring round {' and '.join(letters)}" if letters else ""
    return [turn_dot(QUIET, label="turn in place" + ring)]


def shown_label(criterion: Criterion) -> str:
    """Return the label of the colour bar of a criterion.

    >>> from hpop.criteria import Clearance, Length, LookAtCriterion, Turns
    >>> shown_label(Length()), shown_label(Turns()), shown_label(Clearance())
    ('m a second', 'count on the spot', 'shortfall, m on the spot')
    >>> shown_label(LookAtCriterion(target=(0.0, 0.0, 1.0)))  # rad s, added up
    'rad on the spot'
    """
    if _counts(criterion):
        return "count on the spot"
    unit = label("", criterion.unit, counts=False, what=criterion.quantity).strip(" ()")
    if criterion.aggregate == "sum" and unit.endswith(" s"):
        return f"{unit.removesuffix(' s')} on the spot"
    return f"{unit} on the spot" if criterion.aggregate in ("time-mean", "max") else f"{unit} a second"


def _counts(criterion: Criterion) -> bool:
    """Return whether a criterion counts something, in whole numbers."""
    return criterion.unit == "1" and criterion.quantum == 1.0
