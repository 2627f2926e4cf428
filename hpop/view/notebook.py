"""The small pictures that notebooks show of worlds, problems and fronts, beside the tables of the core."""

from __future__ import annotations

from typing import Any

import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from hpop.base.table import PICTURES
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.view.canvas import new_figure, png_of
from hpop.view.content import draw_content
from hpop.view.ends import draw_ends, end_poses
from hpop.view.front_plot import draw_front
from hpop.view.ground import View, draw_scale_bar, outline
from hpop.view.style import SMALL, plain, whole_ticks
from hpop.world import World

SIDE = 4.5  # inches, of the longer side of a map
WORDS = 0.8  # inches round it
DPI = 72
ROOM = 0.02  # round a world, as a share of its longer side
SOLID: dict[str, Any] = {"facecolor": "#b3aa9a", "edgecolor": "#6f675a", "linewidth": 0.6}


@plain
def small_map(world: World, problem: Problem | None = None) -> Figure:
    """A world from above: obstacles of whatever height, people, landmarks, zones; of a problem start and goal too."""
    x0, y0, x1, y1 = shapely.total_bounds([world.extent, *(obstacle.polygon for obstacle in world.obstacles)]).tolist()
    room = ROOM * max(x1 - x0, y1 - y0)
    view = View(x0 - room, y0 - room, x1 + room, y1 + room)
    scale = SIDE / max(view.width, view.height)
    axes = new_figure(scale * view.width + WORDS, scale * view.height + WORDS).add_subplot(label="small map")
    _draw_ground(axes, world)
    draw_content(axes, world, view, small=True)
    if problem is not None:
        start, goals = end_poses(problem)
        draw_ends(axes, start[:2], [goal[:2] for goal in goals] if problem.target.listed else [])
    axes.set(xlim=(view.x_min, view.x_max), ylim=(view.y_min, view.y_max), aspect="equal")
    axes.set_xlabel("x (m)", fontsize=SMALL)
    axes.set_ylabel("y (m)", fontsize=SMALL)
    axes.tick_params(labelsize=SMALL)
    for axis in (axes.xaxis, axes.yaxis):
        whole_ticks(axis, False)
    draw_scale_bar(axes, view)
    axes.set_title(" ", fontsize=SMALL)  # room for it
    return axes.figure  # type: ignore[return-value]  # of a figure, not of a part of one


def _draw_ground(axes: Axes, world: World) -> None:
    solid = [*(obstacle.polygon for obstacle in world.obstacles), world.ground.raster_solid(), world.keep_out]
    outlines = [outline(geometry) for geometry in solid if not geometry.is_empty]
    axes.add_collection(PathCollection(outlines, zorder=1.0, gid="obstacles", **SOLID), autolim=False)
    axes.add_collection(PathCollection([outline(world.extent)], facecolor="none", edgecolor="#555555"), autolim=False)


def _front_png(front: Front) -> bytes | None:
    return png_of(draw_front(front), DPI) if len(front) else None


def provide() -> None:
    """Let worlds, problems and fronts show pictures."""
    PICTURES[World] = lambda world: png_of(small_map(world), DPI)
    PICTURES[Problem] = lambda problem: png_of(small_map(problem.world, problem), DPI)
    PICTURES[Front] = _front_png
