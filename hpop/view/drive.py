"""A drive in pictures: a map for each event, with the ways from which there was to choose then."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, PathPatch

from hpop.base.arguments import checked_arguments
from hpop.base.text import printable
from hpop.criteria.others.robot import reach
from hpop.drive.closings import Closing
from hpop.drive.execution import Execution
from hpop.drive.script import Happening
from hpop.errors import OptionError
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.canvas import new_figure
from hpop.view.content import INK, SKIN
from hpop.view.ground import KEEP_OUT, View, draw_bare_floor, outline, view_of
from hpop.view.paths import camera_heights, path_points
from hpop.view.silhouettes import draw_map_obstacles
from hpop.view.style import COLOURS, LARGE, NORMAL, POINT, QUIET, SMALL, mapped_points, plain
from hpop.world import Person

COLUMNS = 3
MOST = 12  # maps
WIDE = 3.4  # inches, a map
DRIVEN, PLANNED, TAKEN = COLOURS[0], COLOURS[1], COLOURS[2]


@checked_arguments
@plain
def draw_drive(drive: Execution, happenings: Sequence[Happening]) -> Figure:
    """Draw what happened on a drive: a map an event, the first twelve of them, and one of what was driven in the end.

    On each there are the way driven until then, the plan as it was before, all options, and the one that was taken.

    Raises OptionError without any happening.
    """
    if not happenings:
        raise OptionError("nothing happened on this drive that could be drawn")
    shown = happenings[:MOST]
    problem = drive.problem
    ways = [path_points(option.item) for happening in shown for option in happening.options]
    view = view_of(problem, [path_points(drive.plan), *ways])
    rows = -(-(len(shown) + 1) // COLUMNS)
    figure = new_figure(COLUMNS * WIDE, rows * (WIDE * view.height / view.width + 0.55) + 0.9)
    panels = np.ravel(figure.subplots(rows, COLUMNS, sharey=True, squeeze=False))
    for number, (axes, happening) in enumerate(zip(panels, shown, strict=False), start=1):
        _draw_map(axes, problem, view, drive.plan, happening.closed, happening.people)
        _draw_options(axes, happening)
        _draw_robot(axes, problem, happening)
        axes.set_title(f"{number}  {happening.event.at:.1f} s: {printable(str(happening.event))}", fontsize=NORMAL)
    last = panels[len(shown)]
    there = drive.surroundings
    ended = max(0.0, drive.begin + drive.plan.duration - there.since)
    people = [person.later(ended) for person in there.people]
    _draw_map(last, problem, view, drive.plan, there.closings, people)
    last.plot(*path_points(drive.plan).T, color=DRIVEN, linewidth=2.4, zorder=4, gid="driven")
    arrives = drive.plan.duration >= drive.announced.duration
    end = f"driven in {drive.plan.duration:.1f} s" if arrives else "it stands before what is closed"
    last.set_title(f"in the end: {end}", fontsize=NORMAL)
    for axes in panels[len(shown) + 1 :]:
        axes.remove()
    more = f", the first {MOST} of {len(happenings)} events" if len(happenings) > MOST else ""
    figure.suptitle(f"A drive and what could be chosen on its way{more}", fontsize=LARGE)
    disc = {"linestyle": "none", "marker": "o", "markersize": 8}
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=DRIVEN, label="robot", **disc),  # type: ignore[arg-type]
        Line2D([], [], color=DRIVEN, linewidth=2.4, label="driven"),
        Line2D([], [], color=PLANNED, linewidth=1.6, linestyle=(0, (4, 2)), label="plan until then"),
    ]
    if any(len(happening.options) for happening in shown):
        handles.append(Line2D([], [], color=POINT, linewidth=0.8, label="option"))
    if any(happening.taken is not None for happening in shown):
        handles.append(Line2D([], [], color=TAKEN, linewidth=2.4, label="option taken"))
    if any(happening.closed for happening in shown):
        handles.append(Patch(facecolor="none", edgecolor=KEEP_OUT, hatch=r"\\\\", label="closed"))
    if any(happening.people for happening in shown):
        look = {"markerfacecolor": SKIN, "markeredgecolor": INK, **disc}
        handles.append(Line2D([], [], label="person", **look))  # type: ignore[arg-type]
    figure.legend(handles=handles, loc="outside lower center", ncols=7, fontsize=SMALL, frameon=False)
    return figure


def _draw_map(
    axes: Axes, problem: Problem, view: View, plan: Trajectory, closed: Sequence[Closing], people: Sequence[Person]
) -> None:
    """The map with what is closed, and who is there."""
    draw_bare_floor(axes, problem.world)
    draw_map_obstacles(axes, problem, camera_heights(problem, [plan]), view)
    for closing in closed:
        patch = PathPatch(outline(closing.area), facecolor="none", edgecolor=KEEP_OUT, hatch=r"\\\\", zorder=2.5)
        patch.set_gid("closed")
        axes.add_patch(patch)
    for person in people:
        if any(float(one.there(np.float64(0.0))) > 0 for _, one in person.hypotheses):
            body = Circle((person.x, person.y), person.radius, facecolor=SKIN, edgecolor=INK, zorder=6)
            body.set_gid("person")
            axes.add_patch(body)
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=SMALL)
    if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
        axes.set_ylabel("y (m)", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)


def _draw_options(axes: Axes, happening: Happening) -> None:
    options = happening.options
    for option in options:
        axes.plot(*path_points(option.item).T, color=POINT, linewidth=0.8, zorder=3, gid="option")
    axes.plot(*path_points(happening.before).T, color=PLANNED, linewidth=1.6, linestyle=(0, (4, 2)), zorder=3.5)
    if happening.taken is not None:
        axes.plot(*path_points(happening.taken.item).T, color=TAKEN, linewidth=2.4, zorder=4, gid="taken")


def _draw_robot(axes: Axes, problem: Problem, happening: Happening) -> None:
    driven = mapped_points(problem.model, happening.driven.states)
    axes.plot(*driven.T, color=DRIVEN, linewidth=2.4, zorder=4.1)
    x, y = driven[-1]
    axes.add_patch(Circle((x, y), max(reach(problem.model, None), 0.05), facecolor=DRIVEN, edgecolor=QUIET, zorder=5))
