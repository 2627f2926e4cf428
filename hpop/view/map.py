"""The map: where the trajectories of a front lead."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from textwrap import fill as wrapped
from typing import Literal, cast

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.transforms import Bbox

from hpop.arrays import FloatArray, IntArray
from hpop.front import Front
from hpop.frontier.choosing import column_index
from hpop.frontier.union import JOINT
from hpop.problem import Problem
from hpop.status import Status
from hpop.text import printable
from hpop.trajectory import Trajectory
from hpop.view.content import draw_content
from hpop.view.ends import CIRCLE, EndPose, draw_ends, end_poses
from hpop.view.ground import View, ball_of, draw_bare_floor, draw_field, draw_obstacles, draw_scale_bar, view_of
from hpop.view.sheet import MOST_HIGH, MOST_WIDE, Sheet
from hpop.view.sight import draw_sight, looks_aside, sight_entry
from hpop.view.style import (
    DASHES,
    LARGE,
    NORMAL,
    QUIET,
    SMALL,
    Mark,
    Quantity,
    drawn_rows,
    how_many_drawn,
    mapped_points,
    marks,
    new_figure,
    plain,
    quantities,
    turns_in_place,
    whole_ticks,
)
from hpop.world.limits import LimitPassed

WRAP = 60  # characters a line of costs in the legend
CLAIM_WRAP = 118  # characters a line of what is claimed
CURVE_PIECES = 12  # a motion that moves and turns at once is drawn as so many straight pieces
# Without the palest yellow, which is lost on a light ground.
COST_COLOURS: Colormap = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.92, 256)), name="cost")
Handle = Line2D | Patch
Corner = Literal["upper left", "upper center"]


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour bar to come: what it explains, in which words."""

    of: ScalarMappable
    words: str
    counts: bool
    extend: str = "neither"


@plain
def draw_map(
    problem: Problem,
    front: Front,
    *,
    chosen: Mapping[str, int] | None = None,
    colour: str | None = None,
    view: View | None = None,
    figure: Figure | None = None,
) -> Figure:
    """Draw a front's trajectories over the obstacles and the obstructed fraction.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal; the ball of its obstruction criterion (2 m without one) gives the field.
    front : Front
        Its trajectories, coloured by a criterion, the least on top: of more than 2,000 so many, evenly over the front,
        which the title says. Without any, the title says that and why.
    chosen : mapping from label to row, optional
        Trajectories to draw thick and name; by default the knee and the best of each criterion.
    colour : str, optional
        The criterion or reported value that colours the trajectories; by default the length, else the first.
    view : View, optional
        The rectangle to show, m; by default all free space, or where the trajectories lead if that is less than
        two fifths of it along the longer side.
    figure : Figure, optional
        Where to draw; by default a new figure that fits the map.

    Raises
    ------
    UnknownColumnError
        If the front has no criterion or reported value called ``colour``.
    OptionError
        If a chosen row is not one of the front's.
    """
    ball = ball_of(problem)
    named, rows = marks(front, chosen), drawn_rows(front)
    if view is None:
        lead = {*rows.tolist(), *(mark.row for mark in named)}
        view = view_of(problem, [path_points(front.trajectories[row]) for row in sorted(lead)])
    scale = _scale(front, colour) if len(front) else None
    own = figure is None
    figure = new_figure(1.0, 1.0, layout=None) if figure is None else figure
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), label="map")
    symbols: list[Handle] = [
        *draw_obstacles(axes, problem.world, ball.z, view),
        *draw_content(axes, problem.world, view),
    ]
    bars: list[Bar] = []
    if scale is not None:
        bars += _draw_all(axes, front, scale, rows)
    try:
        field = draw_field(axes, problem.world, view, ball)
        bars.append(Bar(field, f"obstructed fraction φ (ball of {ball.radius:g} m)", False, "max"))
    except LimitPassed:
        draw_bare_floor(axes, problem.world)
        symbols.append(Patch(color="none", label="obstructed fraction left out:\nit takes more than max_memory"))
    symbols += _planners(front)
    if looks_aside(problem.model, [front.trajectories[mark.row] for mark in named]):
        for layer, mark in enumerate(named):
            at, gid = 3.5 + 0.1 * layer, f"views of {mark.label}"
            draw_sight(axes, front.trajectories[mark.row], mark.colour, view, zorder=at, gid=gid)
        symbols.append(sight_entry(problem.model))
    lines, claim = _draw_named(axes, front, named), _claim(front)
    turns = np.concatenate([np.zeros((0, 2)), *(_turn_places(front.trajectories[mark.row]) for mark in named)])
    if len(turns):
        symbols.append(turn_dot(QUIET, label="turn in place" + _hidden(turns, problem, view)))
    symbols += _draw_headed_ends(axes, problem, view)
    _draw_frame(axes, view)
    drawn = [_draw_bar(figure, bar) for bar in bars]
    sheet = Sheet.of(
        view,
        words=[_width_of_words(figure, cax) for cax in drawn],
        lines=max(height_of(lines), height_of(symbols)),
        claim=claim.count("\n") + 1,
    )
    if own:
        figure.set_size_inches(sheet.width, sheet.height)
    axes.set_position(sheet.map_box())
    for place, cax in enumerate(drawn):
        cax.set_position(sheet.bar_box(place))
    figure.suptitle(_title(front, scale), x=sheet.title[0], y=sheet.title[1], va="top", fontsize=LARGE)
    if lines:
        _draw_legend(figure, lines, sheet.legends[0], "upper left")
        _draw_legend(figure, symbols, sheet.legends[1], "upper left")
    else:
        _draw_legend(figure, symbols, (0.5, sheet.legends[0][1]), "upper center")
    figure.text(*sheet.claim, claim, fontsize=SMALL, color=QUIET, va="bottom", gid="claim")
    return figure


def path_points(trajectory: Trajectory) -> FloatArray:
    """Points (N, 2), m, of the base's path: ends of motions, and more where one moves and turns at once."""
    curved = np.array([{"x", "yaw"} <= trajectory.model.laws[kind].varies for kind in trajectory.kinds], dtype=bool)
    states = trajectory.states
    if curved.any():
        pieces = np.where(curved, CURVE_PIECES, 1)
        owner = np.repeat(np.arange(len(trajectory)), pieces)
        share = np.concatenate([np.arange(count) / count for count in pieces])
        times = trajectory.times[owner] + share * trajectory.durations[owner]
        states = trajectory.at(np.append(times, trajectory.duration))
    return mapped_points(trajectory.model, states)


def _turn_places(trajectory: Trajectory) -> FloatArray:
    """Where (N, 2), m, the base turns without moving."""
    turns = turns_in_place(trajectory)
    return mapped_points(trajectory.model, trajectory.states)[1:][turns]


def _scale(front: Front, colour: str | None) -> Quantity:
    """Find the column that colours the trajectories."""
    columns = quantities(front)
    names = [column.name for column in columns]
    if colour is None:
        colour = "length" if "length" in names else names[0]
    return columns[column_index(colour, names)]


def _draw_all(axes: Axes, front: Front, scale: Quantity, rows: IntArray) -> list[Bar]:
    """Draw the trajectories of some rows, the least on top; returns the colour bar, or none where all are alike."""
    order = rows[np.argsort(-scale.values[rows], kind="stable")]
    norm = Normalize(float(scale.values.min()), float(scale.values.max()))
    alpha = float(np.clip(7.0 / np.sqrt(rows.size), 0.15, 0.9))
    styles = dict(zip(_counts(front), cycle(DASHES), strict=False))
    axes.add_collection(
        LineCollection(
            [path_points(front.trajectories[row]) for row in order],
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


def _counts(front: Front) -> dict[str, int]:
    """How many trajectories are of each planner, the one with most first."""
    return dict(Counter(str(origin.get("planner")) for origin in front.provenance).most_common())


def _planners(front: Front) -> list[Handle]:
    """Who found what, where several planners share a front: each has its own dashes."""
    counts = _counts(front)
    return [
        Line2D([], [], color=QUIET, linestyle=dashes, linewidth=1.2, label=printable(f"found by {name}: {count}"))
        for (name, count), dashes in zip(counts.items(), cycle(DASHES), strict=False)
        if len(counts) > 1
    ]


def _draw_bar(figure: Figure, bar: Bar) -> Axes:
    """Draw a colour bar that has no place yet."""
    cax = figure.add_axes((0.0, 0.0, 0.1, 1.0), label=bar.words)
    drawn = figure.colorbar(bar.of, cax=cax, extend=bar.extend, extendfrac=0.025)
    drawn.set_label(bar.words, fontsize=NORMAL)
    cax.tick_params(labelsize=SMALL)
    whole_ticks(cax.yaxis, bar.counts, most=8)
    return cax


def _width_of_words(figure: Figure, cax: Axes) -> float:
    """Width of what stands beside a colour bar, ticks and label, inches."""
    box = cast(Bbox, cax.get_tightbbox())
    return float(box.x1 - cax.bbox.x1) / figure.dpi


def _draw_legend(figure: Figure, handles: Sequence[Handle], at: tuple[float, float], corner: Corner) -> None:
    figure.legend(
        handles=list(handles),
        loc=corner,
        bbox_to_anchor=at,
        fontsize=SMALL,
        frameon=False,
        handlelength=4.0,
        borderaxespad=0.0,
    )


def height_of(handles: Sequence[Handle]) -> int:
    """Lines of text in a legend."""
    return sum(1 + str(handle.get_label()).count("\n") for handle in handles)


def _draw_named(axes: Axes, front: Front, named: Sequence[Mark]) -> list[Handle]:
    handles: list[Handle] = []
    for layer, mark in enumerate(named):
        trajectory = front.trajectories[mark.row]
        x, y = path_points(trajectory).T
        (line,) = axes.plot(
            x,
            y,
            color=mark.colour,
            linestyle=mark.dashes,
            linewidth=2.2,
            label=mark.legend(quantities(front)[: len(front.names)], WRAP),
            zorder=4 + 0.1 * layer,
            solid_capstyle="round",
        )
        line.set_path_effects([withStroke(linewidth=3.8, foreground="white")])
        x, y = _turn_places(trajectory).T
        axes.add_line(turn_dot(mark.colour, x, y, zorder=5 + 0.1 * layer, gid=f"turns of {mark.label}"))
        handles.append(line)
    return handles


def turn_dot(colour: str, x: FloatArray | None = None, y: FloatArray | None = None, **more: object) -> Line2D:
    """Points where a trajectory turns; without coordinates the legend entry for them."""
    nowhere = np.zeros(0)
    return Line2D(
        nowhere if x is None else x,
        nowhere if y is None else y,
        linestyle="none",
        marker="o",
        markersize=5,
        markerfacecolor=colour,
        markeredgecolor="white",
        markeredgewidth=0.8,
        **more,  # type: ignore[arg-type]
    )


def _hidden(turns: FloatArray, problem: Problem, view: View) -> str:
    """Say under which of start and goal some of the turns (N, 2) are: whoever counts the dots misses them."""
    covered = CIRCLE / 2 / 72 * max(view.width / MOST_WIDE, view.height / MOST_HIGH)  # m
    start, goals = end_poses(problem)
    under = [
        letter
        for letter, places in (("S", [start]), ("G", goals))
        if any((np.hypot(*(turns - (x, y)).T) < covered).any() for x, y, _ in places)
    ]
    return f", also under {' and '.join(under)}" if under else ""


def _draw_headed_ends(axes: Axes, problem: Problem, view: View) -> Sequence[Handle]:
    """Start and goal, with an arrow along the heading."""
    reach = 0.055 * max(view.width, view.height)
    start, goals = end_poses(problem)
    for name, (x, y, yaw) in (("start", start), *(("goal", goal) for goal in goals)):
        if yaw is not None:
            tip = (x + reach * np.cos(yaw), y + reach * np.sin(yaw))
            arrow = axes.annotate(
                "",
                tip,
                (x, y),
                arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.6},
                zorder=7,
                annotation_clip=False,  # near the border too
            )
            arrow.set_gid(f"{name} heading")
    return draw_ends(axes, start[:2], [goal[:2] for goal in goals], (_headings([start]), _headings(goals)))


def _headings(ends: Sequence[EndPose]) -> str:
    """What a legend says of the heading at the start, or at the goals."""
    free = [end.yaw is None for end in ends]
    said = ", any heading" if all(free) else ", heading along the arrow" + ", if there is one" * any(free)
    return f", any of {len(ends)}" * (len(ends) > 1) + said


def _draw_frame(axes: Axes, view: View) -> None:
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=NORMAL)
    axes.set_ylabel("y (m)", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    whole_ticks(axes.xaxis, False, most=9)
    whole_ticks(axes.yaxis, False, most=9)
    draw_scale_bar(axes, view)


def _claim(front: Front) -> str:
    """What is claimed, a paragraph for each planner: a picture is passed on without its front."""
    return "\n".join(wrapped(printable(part), CLAIM_WRAP) for part in front.certificate.split(JOINT))


def _title(front: Front, scale: Quantity | None) -> str:
    if scale is None:
        if front.status == Status.NO_PATH:
            return "No path from start to goal"
        return f"No path found: the search ended with {printable(front.status)!r}"
    ended = "" if front.status == Status.COMPLETE else f" (search ended: {printable(front.status)})"
    if Status.UNFINISHED in front.status:
        ended = " (the search goes on)"
    count = f"{len(front)} trajectories{ended}{how_many_drawn(front)}, none better than another in all of"
    if len(front) == 1:
        count = f"1 trajectory{ended}, none found is better in any of"
    criteria = ", ".join(column.label for column in quantities(front)[: len(front.names)])
    return f"{count}\n{criteria}"
