"""Map of a front: its trajectories as lines over the obstacles, coloured by a cost, with the named ones on top."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import cycle

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

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import printable
from hpop.frontier.choosing import column_index
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.limits import LimitPassed
from hpop.trajectories.trajectory import Trajectory
from hpop.view.content import draw_content
from hpop.view.ground import Unresolved, View, draw_bare_floor, draw_field, draw_scale_bar, shaded_by, view_of
from hpop.view.marks import (
    CIRCLE,
    EndPose,
    Ends,
    draw_ends,
    draw_holds,
    draw_shared_holds,
    draw_stops,
    draw_targets,
    end_poses,
    goal_words,
    hold_entry,
    is_held,
    stop_places,
    targets_of,
)
from hpop.view.outlines import (
    corners_of,
    draw_map_obstacles,
    draw_robot,
    draw_sight,
    from_above,
    looks_aside,
    robot_outlines,
    sight_entry,
)
from hpop.view.page import (
    WHOLE,
    Bar,
    Handle,
    checked_axes,
    claim_of,
    draw_caption,
    lay_on,
    lay_out,
    new_figure,
    title_of,
)
from hpop.view.style import (
    DASHES,
    NORMAL,
    QUIET,
    SMALL,
    Heights,
    Mark,
    Quantity,
    camera_heights,
    drawn_rows,
    mapped_body,
    mapped_points,
    marks,
    path_points,
    plain,
    quantities,
    turns_in_place,
    whole_ticks,
)
from hpop.world import MeasuredField

WRAP = 60  # characters a line of costs in the legend
# Without the palest yellow, which is lost on a light ground.
COST_COLOURS: Colormap = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.92, 256)), name="cost")
Line = Callable[[Trajectory], FloatArray]  # points (N, 2) of a trajectory in a picture


def scale_of(front: Front, colour: str | None) -> Quantity:
    """Return the column whose values colour the trajectories: by default the length, else the first column."""
    columns = quantities(front)
    names = [column.name for column in columns]
    if colour is None:
        colour = "length" if "length" in names else names[0]
    return columns[column_index(colour, names)]


def draw_all(axes: Axes, front: Front, scale: Quantity, rows: IntArray, line: Line) -> list[Bar]:
    """Draw the trajectories in ``rows`` as thin lines coloured by ``scale``, the least value on top.

    Returns the colour bar in a list, which is empty if all values are equal.
    """
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
    """Draw the named trajectories as thick lines, and return their legend entries, which state their costs."""
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
    """Return a legend entry for each planner of a front, with the dashes of its trajectories; none for one planner."""
    counts = _counts(front)
    return [
        Line2D([], [], color=QUIET, linestyle=dashes, linewidth=1.2, label=printable(f"found by {name}: {count}"))
        for (name, count), dashes in zip(counts.items(), cycle(DASHES), strict=False)
        if len(counts) > 1
    ]


def _counts(front: Front) -> dict[str, int]:
    """Return how many trajectories each planner found, the largest number first."""
    return dict(Counter(str(origin.get("planner")) for origin in front.provenance).most_common())


@checked_arguments
@plain
def draw_map(
    problem: Problem,
    front: Front,
    *,
    chosen: Mapping[str, int] | None = None,
    colour: str | None = None,
    view: View | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a map with the trajectories of a front, the obstacles, and shading by how much obstacles obstruct the view.

    Parameters
    ----------
    problem : Problem
        World, model, start and goal. Its obstruction criterion gives the radius for the shading (2 m without one).
    front : Front
        Its trajectories, coloured by a criterion, the least on top. At most 2,000 are drawn, evenly over the front; the
        title then says so. The title of an empty front says why it is empty.
    chosen : mapping from label to row, optional
        Trajectories to draw thick and name; by default the knee and the best of each criterion.
    colour : str, optional
        The criterion or reported value that colours the trajectories; by default the length, else the first.
    view : View, optional
        The rectangle to show, m; by default all free space, or only the area of the trajectories if its longer side is
        less than two fifths of that (for a fixed robot: if it is smaller).
    ax : Axes, optional
        Axes to draw in, with a colour bar and only the named trajectories in the legend; their figure is returned. By
        default a new figure with all legends and the certificate.

    Raises
    ------
    UnknownColumnError
        If the front has no criterion or reported value called ``colour``.
    OptionError
        If a chosen row is not one of the front's.
    """
    model, named, rows = problem.model, marks(front, chosen), drawn_rows(front)
    picked = [front.trajectories[mark.row] for mark in named]
    shown = [front.trajectories[row] for row in sorted({*rows.tolist(), *(mark.row for mark in named)})]
    line = cache(path_points)
    robot = robot_outlines(picked, from_above)
    if view is None:
        more = [targets_of(problem)[:, :2], corners_of(robot)]
        view = view_of(problem, [*map(line, shown), *more] if shown else ())
    scale = scale_of(front, colour) if len(front) else None
    axes = new_figure(1.0, 1.0, layout=None).add_axes(WHOLE, label="map") if ax is None else checked_axes(ax)
    heights = camera_heights(problem, shown)
    symbols: list[Handle] = [
        *draw_map_obstacles(axes, problem, heights, view),
        *draw_content(axes, problem.world, view),
        *draw_robot(axes, robot, named),
        *draw_targets(axes, problem, from_above),
        *draw_stops(axes, problem),
    ]
    bars: list[Bar] = []
    if scale is not None:
        bars += draw_all(axes, front, scale, rows, line)
    try:
        bars += _draw_floor(axes, problem, view, heights)
    except LimitPassed as passed:
        draw_bare_floor(axes, problem.world)
        why = "its ball is smaller than a pixel" if isinstance(passed, Unresolved) else "it takes more than max_memory"
        symbols.append(Patch(color="none", label=f"obstructed fraction left out:\n{why}"))
    symbols += planner_entries(front)
    if looks_aside(model, picked):
        for layer, mark in enumerate(named):
            at, gid = 3.5 + 0.1 * layer, f"views of {mark.label}"
            draw_sight(
                axes, front.trajectories[mark.row], mark.colour, view, zorder=at, gid=gid, tour=problem.tour is not None
            )
        symbols.append(sight_entry(model, cones="base" not in model.provides))
    lines = draw_named(axes, front, named, line)
    turns = [_turn_places(trajectory) for trajectory in picked]
    for layer, (mark, (x, y)) in enumerate(zip(named, (places.T for places in turns), strict=True)):
        axes.add_line(turn_dot(mark.colour, x, y, zorder=5 + 0.1 * layer, gid=f"turns of {mark.label}"))
    ends = end_poses(problem, picked)
    if any(len(places) for places in turns):
        symbols.append(turn_dot(QUIET, label="turn in place" + _hidden_turns_note(np.concatenate(turns), ends, view)))
    taken = stop_places(problem)
    if problem.tour is not None:
        tours = {mark.label: (trajectory, mark.colour) for mark, trajectory in zip(named, picked, strict=True)}
        draw_shared_holds(axes, tours, view, taken)
    else:
        for mark, trajectory in zip(named, picked, strict=True):
            draw_holds(axes, trajectory, mark.colour, view, taken=taken, gid=f"holds of {mark.label}")
    symbols += [hold_entry()] * any(is_held(trajectory).any() for trajectory in picked)
    symbols += draw_headed_ends(axes, problem, ends, view)
    draw_frame(axes, view)
    if heights.vary or "base" not in model.provides:
        draw_caption(axes, f"From above: paths of the {mapped_body(model)}")
    if ax is not None:
        return lay_on(axes, front, bars=bars, lines=lines)
    said = {"title": title_of(front), "claim": claim_of(front)}
    return lay_out(axes, view, **said, bars=bars, lines=lines, symbols=symbols)


def _draw_floor(axes: Axes, problem: Problem, view: View, heights: Heights) -> list[Bar]:
    """Shade the floor by the field of a criterion, else by obstruction, and return the colour bar.

    Obstruction is shown at the camera's height at the start. For a fixed robot without such criteria the floor is
    white.
    """
    ball = shaded_by(problem)
    if ball is None:
        draw_bare_floor(axes, problem.world)
        return []
    if isinstance(ball, MeasuredField):
        return [Bar(draw_field(axes, problem.world, view, ball), printable(f"{ball.name} ({ball.unit})"), False)]
    centre = f", its centre {ball.z:.3g} m high" * heights.vary
    field = draw_field(axes, problem.world, view, ball)
    return [Bar(field, f"obstructed fraction φ (ball of {ball.radius:g} m{centre})", False, "max")]


def _turn_places(trajectory: Trajectory) -> FloatArray:
    """Return the positions (N, 2), m, at which the robot turns in place."""
    turns = turns_in_place(trajectory)
    return mapped_points(trajectory.model, trajectory.states)[1:][turns]


def turn_dot(colour: str, x: FloatArray | None = None, y: FloatArray | None = None, **more: object) -> Line2D:
    """Return dots that mark turns in place; without coordinates, the legend entry for them."""
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


def _hidden_turns_note(turns: FloatArray, ends: Ends, view: View) -> str:
    """Return a note for the legend if the letter at start or goal covers turns (N, 2), m; otherwise ""."""
    covered = CIRCLE / 2 * view.point  # m
    start, goals = ends
    under = [
        letter
        for letter, places in (("S", [start]), ("G", goals))
        if any((np.hypot(*(turns - (x, y)).T) < covered).any() for x, y, _ in places)
    ]
    return f", also under {' and '.join(under)}" if under else ""


def draw_headed_ends(axes: Axes, problem: Problem, ends: Ends, view: View) -> Sequence[Handle]:
    """Draw the letters of start and goals, with arrows along their headings; return the legend entries."""
    reach = 0.055 * max(view.width, view.height)
    start, goals = ends
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
    words = ("", "") if "base" not in problem.model.provides else (_headings([start]), _headings(goals))
    heading = words[1] if problem.target.listed else words[1].replace(", ", ",\n", 1)  # else too long
    said = words[0], goal_words(problem, len(goals)) + heading
    return draw_ends(axes, start[:2], [goal[:2] for goal in goals], said)


def _headings(ends: Sequence[EndPose]) -> str:
    """Return the legend's words for the headings at the start, or at the goals: free, or along the arrow."""
    free = [end.yaw is None for end in ends]
    return ", any heading" if all(free) else ", heading along the arrow" + ", if there is one" * any(free)


def draw_frame(axes: Axes, view: View) -> None:
    """Set up the axes of a map: limits of the view, labels in metres, and a scale bar."""
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=NORMAL)
    axes.set_ylabel("y (m)", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    for axis, side in ((axes.xaxis, view.width), (axes.yaxis, view.height)):  # few on a short side: labels need room
        whole_ticks(axis, False, most=min(9, max(1, int(27 * side / max(view.width, view.height)))))
    draw_scale_bar(axes, view)
