"""Picture of a problem before planning: the map, the robot's free space, and whether start and goals can be used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hpop.motions import States
from hpop.planners.graphs.tour_stops import reasons_not_visited
from hpop.planners.needs import FreeMap, elsewhere, nearest_free
from hpop.problems.problem import Problem
from hpop.view.content import draw_content
from hpop.view.ground import View, view_of
from hpop.view.map import draw_frame, draw_headed_ends
from hpop.view.marks import draw_stops, draw_targets, end_poses
from hpop.view.outlines import draw_map_obstacles, draw_outlines, from_above, outlines_at
from hpop.view.page import WHOLE, Handle, lay_out, new_figure, paragraphs
from hpop.view.side import draw_side_of_ends
from hpop.view.style import camera_heights, plain

SEEN = 0.05  # share of the map's longer side: a smaller robot would be hidden by the letter at its start
REACHED, APART, NARROW = "#cfe8cf", "#fbd9a5", "#e6e6ea"
BETTER: dict[str, Any] = {
    "linestyle": "none",
    "marker": "P",
    "markerfacecolor": "#2ca02c",
    "markeredgecolor": "white",
    "markersize": 11,
}


class MapLook(NamedTuple):
    """Picture of a problem before planning, with a verdict on its start and goals.

    figure   the picture
    side     view from the side, with heights, for a robot with bodies in space, such as an arm; else None
    refused  reasons why the start or a goal is blocked, with the nearest free position; empty if all are free
    notes    how much of the map is free, which goals are cut off, and which stops of a tour may be impossible to visit
    no_way   whether start and goals are free, but no goal is in the same part of free space as the start
    """

    figure: Figure
    side: Figure | None
    refused: tuple[str, ...]
    notes: tuple[str, ...]
    no_way: bool


WORSE: dict[str, Any] = BETTER | {"marker": "X", "markerfacecolor": "#d62728"}


@plain
def _map_figure(
    problem: Problem,
    title: str,
    free: FreeMap | None,
    text: Sequence[str],
    better: Sequence[States],
    doubtful: Sequence[tuple[float, float]],
) -> Figure:
    """Draw the picture of `look`, with ``text`` below.

    better    nearest free states to blocked ones
    doubtful  positions, m, of stops that a plan may refuse
    """
    view = view_of(problem)
    axes = new_figure(1.0, 1.0, layout=None).add_axes(WHOLE, label="look")
    axes.set_facecolor("white")
    symbols: list[Handle] = [
        *_draw_free(axes, problem, free),
        *draw_map_obstacles(axes, problem, camera_heights(problem, ()), view),
        *draw_content(axes, problem.world, view),
        *_draw_robot(axes, problem, view),
        *draw_targets(axes, problem, from_above),
        *draw_stops(axes, problem),
        *draw_headed_ends(axes, problem, end_poses(problem), view),
    ]
    for state in better:
        axes.plot(state.x, state.y, zorder=8.5, gid="usable", **BETTER)
    if better:
        symbols.append(Line2D([], [], label="nearest collision-free position", **BETTER))
    for x, y in doubtful:
        axes.plot(x, y, zorder=8.5, gid="doubtful stop", **WORSE)
    if doubtful:
        symbols.append(Line2D([], [], label="stop that a plan may refuse", **WORSE))
    draw_frame(axes, view)
    half = (len(symbols) + 1) // 2
    return lay_out(
        axes, view, title=title, claim=paragraphs(text), bars=(), lines=symbols[:half], symbols=symbols[half:]
    )


def look(problem: Problem, title: str) -> MapLook:
    """Draw the map of a problem before planning, and check whether start and goals are free and connected.

    The picture shows free space, start, goals, people, landmarks and zones. A robot with bodies in space, such as an
    arm, is also drawn from the side.

    Parameters
    ----------
    title : title of the picture
    """
    model, world = problem.model, problem.world
    ends = _ends(problem)
    collision = model.collision(world)
    refused, better = [], list[States]()
    for what, state in ends.items():
        reason = collision.why_blocked(States(**{name: np.nan_to_num(getattr(state, name)) for name in state.names}))
        place = nearest_free(model, world, state) if reason else None
        if not reason or (place is not None and np.hypot(place.x[0] - state.x[0], place.y[0] - state.y[0]) < 1e-9):
            continue  # another heading of this goal may be free
        where = ", ".join(f"{float(getattr(state, name)[0]):.4g}" for name in ("x", "y") if name in state.names)
        refused.append(
            f"the {what}{f' ({where})' * bool(where)} is not usable: {reason}.{elsewhere(model, world, state)}"
        )
        better += [] if place is None else [place]
    free = FreeMap.of(model, world)
    apart = [] if free is None or refused else _apart(free, ends)
    notes = [] if free is None else _notes(free, apart)
    reasons = reasons_not_visited(problem)
    notes += [f"a plan may refuse this tour: {reason}" for reason in reasons.values()]
    stops = () if problem.tour is None else problem.tour.stops
    doubtful = [at for i in reasons if (at := stops[i].place(world)) is not None]
    no_way = 0 < len(apart) == len(ends) - 1
    figure = _map_figure(problem, title, free, [*refused, *notes], better, doubtful)
    side = draw_side_of_ends(problem, title) if model.bodies(ends["start"]) else None
    return MapLook(figure, side, tuple(refused), tuple(notes), no_way)


def _ends(problem: Problem) -> dict[str, States]:
    """Return states of start and listed goals by name: "start", "goal" (or "goal 0", ...); free values are NaN."""
    space = problem.model.space
    ends = {"start": space.state(problem.start)}
    if problem.target.listed:
        several = len(problem.goals) > 1
        for i, goal in enumerate(problem.goals):
            ends[f"goal {i}" if several else "goal"] = space.state(goal, free=space.angles)
    return ends


def _apart(free: FreeMap, ends: dict[str, States]) -> list[str]:
    """Return the names of goals that lie in another part of the free space than the start."""
    parts = {what: free.part_at(float(state.x[0]), float(state.y[0])) for what, state in ends.items()}
    return [what for what, part in parts.items() if part != parts["start"]]


def _notes(free: FreeMap, apart: Sequence[str]) -> list[str]:
    """Return notes on the size of the free space, and on goals that are cut off from the start."""
    if not free.main:
        return ["the robot is free nowhere on this map: check the map's scale and the robot's size"]
    whole = float(free.areas.sum())
    largest = float(free.areas.max())
    many = int((free.areas > 0.0).sum())
    notes = [f"the robot is free on {_area(whole)}, sampled every {free.pitch:.2g} m"]
    if many > 1:
        notes[0] += f", in {many} parts between which it cannot go; the largest has {_area(largest)}"
    if apart:
        notes.append(
            f"no path seems to lead from the start to the {' or the '.join(apart)}: they are in separate free areas"
        )
    return notes


def _area(area: float) -> str:
    """Format an area with its unit, m², to three figures."""
    return f"{area:,.0f} m²" if area >= 100 else f"{area:.3g} m²"


def _draw_free(axes: Axes, problem: Problem, free: FreeMap | None) -> list[Patch]:
    """Colour the robot's free space: the start's part (the largest, if the start is blocked), and other parts.

    Return the legend entries.
    """
    if free is None:
        return []
    start = problem.model.space.state(problem.start)
    own = free.part_at(float(start.x[0]), float(start.y[0]))
    part = own or free.main
    kinds = np.where(free.parts == part, 1, 2) * free.free  # 0 where it is not free
    half = free.pitch / 2
    axes.imshow(
        kinds,
        cmap=ListedColormap([NARROW, REACHED, APART]),
        vmin=-0.5,
        vmax=2.5,
        origin="lower",
        extent=(free.x[0] - half, free.x[-1] + half, free.y[0] - half, free.y[-1] + half),
        interpolation="nearest",
        zorder=0.5,
        gid="free space",
    )
    looks = {
        0: Patch(facecolor=NARROW, edgecolor="none", label="outside, or too near to an obstacle or border"),
        1: Patch(
            facecolor=REACHED,
            edgecolor="none",
            label="free, and within reach of the start" if own else "where the robot is free",
        ),
        2: Patch(facecolor=APART, edgecolor="none", label="free, but cut off from the start"),
    }
    return [patch for kind, patch in looks.items() if (kinds == kind).any()]


def _draw_robot(axes: Axes, problem: Problem, view: View) -> list[Patch]:
    """Draw the robot at its start, to scale, unless it would be hidden by the letter there; return the legend entry."""
    model, start = problem.model, problem.model.space.state(problem.start)
    outlines = outlines_at(model, start, from_above)
    if not outlines and model.platform:
        hulls = [
            shapely.convex_hull(shapely.MultiPoint(part.placed(start)[0])).buffer(part.radius) for part in model.parts
        ]
        outlines = [shapely.union_all(hulls)]
    across = max((max(x1 - x0, y1 - y0) for x0, y0, x1, y1 in shapely.bounds(outlines).reshape(-1, 4)), default=0.0)
    if across < SEEN * max(view.width, view.height):
        return []
    working = outlines_at(model, start, from_above, watched=True)
    return [
        *draw_outlines(axes, outlines, "the robot at the start, to scale", zorder=7.5),
        *draw_outlines(axes, working, "the working arm at the start", watched=True, zorder=7.4),
    ]
