"""View from the side: the heights of the camera along the trajectories of a front, among nearby obstacles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.motions.states import Values
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory
from hpop.view.content import INK, MOST_NAMES, STAR, write_name
from hpop.view.ground import View
from hpop.view.map import draw_all, draw_named, planner_entries, scale_of
from hpop.view.marks import draw_ends, draw_stops, draw_targets, end_positions, goal_words, targets_of
from hpop.view.outlines import (
    PathSurroundings,
    Section,
    corners_of,
    draw_cones,
    draw_outlines,
    draw_robot,
    draw_silhouettes,
    ends_of,
    outlines_at,
    robot_outlines,
    sight_entry,
)
from hpop.view.page import (
    WHOLE,
    Handle,
    checked_axes,
    claim_of,
    draw_caption,
    lay_on,
    lay_out,
    new_figure,
    stretch_of,
    title_of,
)
from hpop.view.style import NORMAL, SMALL, Heights, camera_path, drawn_rows, marks, plain, whole_ticks
from hpop.world.content.content import Landmark

BORDER = 0.1  # round the paths, as a share of the longer side of the picture
LEAST_BORDER = 0.15  # m
NEAR = 0.4  # m above and below the paths, to which obstacles are shown
STRETCHED = 1.05  # ratio of vertical to horizontal scale above which the label of the axis says so
EARTH = "#8a7a5c"


@checked_arguments
@plain
def draw_side(
    problem: Problem,
    front: Front,
    *,
    chosen: Mapping[str, int] | None = None,
    colour: str | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw the camera paths of a front from the side, with the obstacles near them.

    The direction of view is horizontal, at right angles to the direction in which the paths spread most. Lines and
    colours are those of the map (:func:`hpop.view.draw_map`).

    Parameters
    ----------
    problem : Problem
        World, model, start and goal.
    front : Front
        Its trajectories, at least one; at most 2,000 are drawn, evenly over the front.
    chosen : mapping from label to row, optional
        Trajectories to draw thick and name; by default the knee and the best of each criterion.
    colour : str, optional
        The criterion or reported value that colours the trajectories; by default the length, else the first.
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
    named, rows, drives = marks(front, chosen), drawn_rows(front), "base" in problem.model.provides
    picked = [front.trajectories[mark.row] for mark in named]
    path = cache(camera_path)
    paths = [path(front.trajectories[row]) for row in sorted({*rows.tolist(), *(mark.row for mark in named)})]
    start, goals = end_positions(problem, picked)
    section = Section.along(paths)
    around = PathSurroundings.of(paths)
    solid = around.silhouettes(problem.world, section)
    landmarks = problem.world.content.landmarks
    marked = np.array([*((mark.x, mark.y, mark.z) for mark in landmarks), *targets_of(problem)]).reshape(-1, 3)
    near = marked[shapely.intersects_xy(around.beside, marked[:, 0], marked[:, 1])]
    robot = robot_outlines(picked, section.flattened)
    points = section.flattened(np.concatenate([*paths, [start], goals, near]))
    view = _view(np.concatenate([points, corners_of(robot)]), ends_of(solid), drives)

    def line(trajectory: Trajectory) -> FloatArray:
        return section.flattened(path(trajectory))

    axes = new_figure(1.0, 1.0, layout=None).add_axes(WHOLE, label="side") if ax is None else checked_axes(ax)
    symbols: list[Handle] = [
        *draw_silhouettes(axes, solid, view),
        *(_draw_floor(axes, view) if drives else ()),
        *_draw_landmarks(axes, landmarks, section, view),
        *draw_robot(axes, robot, named),
        *draw_targets(axes, problem, section.flattened),
        *draw_stops(axes, problem, section.flattened),
        *planner_entries(front),
    ]
    bars = draw_all(axes, front, scale_of(front, colour), rows, line)
    for layer, mark in enumerate(named):
        at, gid = 3.5 + 0.1 * layer, f"views of {mark.label}"
        trajectory = front.trajectories[mark.row]
        draw_cones(axes, trajectory, mark.colour, view, section.flattened, zorder=at, gid=gid)
    symbols.append(sight_entry(problem.model, cones=True))
    lines = draw_named(axes, front, named, line)
    places = [tuple(place) for place in section.flattened(goals).tolist()]
    symbols += draw_ends(axes, section.flattened(start).tolist(), places, ("", goal_words(problem, len(goals))))
    _draw_frame(axes, view, section)
    draw_caption(axes, "From the side: paths of the camera")
    if ax is not None:
        return lay_on(axes, front, bars=bars, lines=lines)
    said = {"title": title_of(front), "claim": claim_of(front)}
    return lay_out(axes, view, **said, bars=bars, lines=lines, symbols=symbols)


@plain
def draw_side_of_ends(problem: Problem, title: str) -> Figure:
    """Draw a robot with a body in space, such as an arm, from the side before planning: at the start and listed goals.

    The direction of view is horizontal, at right angles to the line from the camera's start to goals and targets.
    """
    model, space = problem.model, problem.model.space
    states = [space.state(problem.start), *(space.state(goal, free=space.angles) for goal in _whole_goals(problem))]
    start, goals = end_positions(problem)
    ends = np.concatenate([[start], goals, np.reshape(targets_of(problem), (-1, 3))])
    section = Section.along([ends])
    placed = np.concatenate([pose[:, :3, 3] for state in states for _, pose in model.bodies(state)])
    around = PathSurroundings.of([ends, placed])
    solid, drives = around.silhouettes(problem.world, section), "base" in model.provides
    robots = [each for state in states for each in outlines_at(model, state, section.flattened)]
    working = [each for state in states for each in outlines_at(model, state, section.flattened, watched=True)]
    view = _view(np.concatenate([section.flattened(ends), corners_of([*robots, *working])]), ends_of(solid), drives)
    axes = new_figure(1.0, 1.0, layout=None).add_axes(WHOLE, label="side")
    at_goals = " and the goals" if len(states) > 1 else ""
    symbols: list[Handle] = [
        *draw_silhouettes(axes, solid, view, "obstacle, in front of the robot or behind"),
        *(_draw_floor(axes, view) if drives else ()),
        *_draw_landmarks(axes, problem.world.content.landmarks, section, view),
        *draw_outlines(axes, robots, f"the robot at the start{at_goals}"),
        *draw_outlines(axes, working, f"the working arm at the start{at_goals}", watched=True),
        *draw_targets(axes, problem, section.flattened),
        *draw_stops(axes, problem, section.flattened),
    ]
    places = [tuple(place) for place in section.flattened(goals).tolist()]
    symbols += draw_ends(axes, section.flattened(start).tolist(), places, ("", goal_words(problem, len(goals))))
    _draw_frame(axes, view, section)
    draw_caption(axes, f"From the side, with the camera at S{' and G' if len(goals) else ''}")
    return lay_out(axes, view, title=title, claim="", bars=(), lines=(), symbols=symbols)


def _whole_goals(problem: Problem) -> Iterator[Values]:
    """Yield the listed goals without free values."""
    for goal in problem.goals if problem.target.listed else ():
        if None not in goal:
            yield goal


def _view(points: FloatArray, solid: Heights, drives: bool) -> View:
    """Return the rectangle of a side view: along the plane and height, m.

    It holds the points (N, 2) with a border. It reaches up to obstacles (``solid``) that end close above them, and down
    to the floor; for a fixed robot (not ``drives``) only to obstacles that end close below them.
    """
    (a, low), (b, high) = points.min(axis=0), points.max(axis=0)
    border = max(BORDER * max(b - a, high - low), LEAST_BORDER)
    near = max(2.0 * border, NEAR)
    bottom = min(low, 0.0 if drives else max(solid.low, low - near))
    top = max(high, min(solid.high, high + near))
    return View(float(a - border), float(bottom - 0.5 * border), float(b + border), float(top + border))


def _draw_floor(axes: Axes, view: View) -> Iterator[Handle]:
    """Draw the floor at height 0, hatched below; yield the legend entry."""
    axes.axhspan(view.y_min - 1.0, 0.0, facecolor="white", edgecolor=EARTH, hatch="////", linewidth=0.0, zorder=1.1)
    axes.axhline(0.0, color=EARTH, linewidth=1.4, zorder=2.0, gid="floor")
    yield Patch(facecolor="none", edgecolor=EARTH, hatch="////", label="below the floor (height 0)")


def _draw_landmarks(axes: Axes, landmarks: Sequence[Landmark], section: Section, view: View) -> Iterator[Handle]:
    """Draw landmarks in view as stars at their heights, with names; yield the legend entry."""
    look: dict[str, Any] = {"marker": "*", "markerfacecolor": STAR, "markeredgecolor": INK, "markeredgewidth": 0.7}
    shown = 0
    for mark in landmarks:
        along, z = section.flattened(np.array([mark.x, mark.y, mark.z])).tolist()
        if view.x_min < along < view.x_max and view.y_min < z < view.y_max:
            shown += 1
            axes.plot([along], [z], linestyle="none", markersize=11, zorder=5.7, gid="landmark", **look)
            if len(landmarks) <= MOST_NAMES:
                write_name(axes, mark.name, along, z, view)
    if shown:
        yield Line2D([], [], linestyle="none", markersize=9.5, label="landmark", **look)


def _draw_frame(axes: Axes, view: View, section: Section) -> None:
    """Set up the axes of a side view: limits, labels and caption."""
    stretch = stretch_of(view)
    larger = f", drawn {stretch:.2g} times as large" if stretch > STRETCHED else ""
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="auto")
    axes.set_xlabel(section.label, fontsize=NORMAL)
    axes.set_ylabel(f"height (m){larger}", fontsize=NORMAL)
    axes.tick_params(labelsize=SMALL)
    whole_ticks(axes.xaxis, False, most=9)
    whole_ticks(axes.yaxis, False, most=6)
