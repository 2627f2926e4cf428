"""Background of a map: obstacles, keep-out zones, shading by the share of view that obstacles fill, and a scale bar."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, ListedColormap, Normalize, PowerNorm
from matplotlib.image import AxesImage
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.transforms import Affine2D
from matplotlib.typing import ColorType
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray
from hpop.criteria import Obstruction
from hpop.problems.problem import Problem
from hpop.runtime.limits import LimitPassed
from hpop.view.marks import end_poses
from hpop.view.style import HALO, MOST_HIGH, MOST_WIDE, QUIET, SMALL, Heights
from hpop.world import MeasuredField, World
from hpop.world.fields.measured import named_field
from hpop.world.geometry.shapes import Raster

OBSTACLE = "#4a4a4a"
AT_SOME = "#8a8a8a"
OFF_CAMERA = "#b4b4b4"
KEEP_OUT = "#8c4a6b"
# White to sand, one hue and evenly falling lightness: trajectories stand out on it.
FIELD_COLOURS = LinearSegmentedColormap.from_list("obstruction", ["#ffffff", "#dac69b"])
MOST_SEEN = 0.99  # quantile of the obstruction over free space at which the colours end
GROWTH = 0.6  # exponent by which the colours grow with the obstruction
PIXELS = 700  # points of the obstruction grid along the longer side of the map
CELLS = 2000  # most drawn cells of a raster along its longer side: more than a picture has pixels, 100 bytes for each
MARGIN = 0.4  # m round the free space
SURROUNDINGS = 0.2  # margin round paths that fill only a small part of the map, as a share of their longer side
LEAST_SURROUNDINGS = 4.0  # m
ROUND_A_HAND = 0.4  # m: as LEAST_SURROUNDINGS, for a fixed robot
SMALL_PART = 0.4  # share of the map's longer side below which only the surroundings of the paths are shown


@dataclass(frozen=True)
class View:
    """Rectangle of the world that a picture shows, m."""

    x_min: float
    y_min: float
    x_max: float
    y_max: float

    @property
    def width(self) -> float:
        """Return the extent along x, m."""
        return self.x_max - self.x_min

    @property
    def height(self) -> float:
        """Return the extent along y, m."""
        return self.y_max - self.y_min

    @property
    def point(self) -> float:
        """Return the length in the world, m, of a printer's point (1/72 inch) on a map."""
        return max(self.width / MOST_WIDE, self.height / MOST_HIGH) / 72


class Unresolved(LimitPassed):
    """Signal that the obstruction is not drawn, because its ball is smaller than a pixel of the map."""


@dataclass(frozen=True)
class Ball:
    """Ball round the camera in which obstruction is measured: its radius, and the height of its centre, m."""

    radius: float
    z: float


def view_of(problem: Problem, paths: Sequence[FloatArray] = ()) -> View:
    """Return the rectangle that a map shows: free space, start and goal, with a margin.

    Unknown surroundings of a map file are cut off. With paths (N, 2), m, only start, goal and paths are shown, with a
    margin, if the longer side is then less than 0.4 of the longer side of the whole map; for a fixed robot, if it is
    shorter at all.
    """
    start, goals = end_poses(problem)
    ends = shapely.MultiPoint([pose[:2] for pose in (start, *goals)])
    x0, y0, x1, y1 = shapely.total_bounds([_open_area(problem.world), ends])
    whole = View(x0 - MARGIN, y0 - MARGIN, x1 + MARGIN, y1 + MARGIN)
    if not len(paths):
        return whole
    x0, y0, x1, y1 = shapely.total_bounds([ends, shapely.MultiPoint(np.concatenate(paths))])
    drives = "base" in problem.model.provides
    border = max(SURROUNDINGS * max(x1 - x0, y1 - y0), LEAST_SURROUNDINGS if drives else ROUND_A_HAND)
    part = View(
        max(x0 - border, whole.x_min),
        max(y0 - border, whole.y_min),
        min(x1 + border, whole.x_max),
        min(y1 + border, whole.y_max),
    )
    share = SMALL_PART if drives else 1.0
    return part if max(part.width, part.height) < share * max(whole.width, whole.height) else whole


def ball_of(problem: Problem) -> Ball | None:
    """Return the ball in which the map measures obstruction, at the camera's height at the start.

    Its radius is that of the problem's first criterion with a ball, such as obstruction. Without such a criterion it is
    the default of obstruction, 2 m; but a fixed robot then has no ball (None), because its whole reach would be inside.
    """
    radius = next((c.ball_radius for c in problem.criteria if c.ball_radius is not None), None)
    if radius is None:
        if "base" not in problem.model.provides:
            return None
        radius = Obstruction().radius
    camera = problem.model.pose("camera", problem.model.space.state(problem.start))
    return Ball(radius, float(camera.z[0]))


def shaded_by(problem: Problem) -> Ball | MeasuredField | None:
    """Return the field of the problem's first criterion of a measured field; else the ball of :func:`ball_of`."""
    name = next((c.measured_field for c in problem.criteria if c.measured_field is not None), None)
    return ball_of(problem) if name is None else named_field(problem.world.fields, name)


def draw_field(axes: Axes, world: World, view: View, of: Ball | MeasuredField) -> AxesImage:
    """Shade the map by a measured field, or by obstruction: the share of the ball round the camera that obstacles fill.

    Colours of a field range over its values in free space. Those of obstruction range from 0 to the 99th percentile
    over free space, and grow faster at first, because corners of a room are several times more obstructed than paths.

    Raises LimitPassed if the computation exceeds a limit of the caller, and Unresolved if the ball is smaller than a
    pixel, because useful shading would then need too much memory.
    """
    pixel = max(view.width, view.height) / PIXELS
    if isinstance(of, Ball) and pixel > 2 * of.radius:
        raise Unresolved
    x = np.arange(view.x_min + pixel / 2, view.x_max, pixel)
    y = np.arange(view.y_min + pixel / 2, view.y_max, pixel)
    X, Y = np.meshgrid(x, y)  # (h, w)
    field = world.obstruction_field(of.radius, of.z) if isinstance(of, Ball) else of
    values: FloatArray = field(X.ravel(), Y.ravel()).reshape(X.shape)
    free = _open_area(world)
    shapely.prepare(free)
    seen = values[shapely.contains_xy(free, X, Y)]
    if isinstance(of, Ball):
        norm: Normalize = PowerNorm(GROWTH, 0.0, (float(np.quantile(seen, MOST_SEEN)) if seen.size else 0.0) or 1.0)
    else:
        norm = Normalize(*((seen.min(), seen.max()) if seen.size else (values.min(), values.max())))
    image = axes.imshow(
        values,
        cmap=FIELD_COLOURS,
        norm=norm,
        origin="lower",
        extent=(view.x_min, view.x_min + pixel * x.size, view.y_min, view.y_min + pixel * y.size),
        interpolation="bilinear",
        zorder=0,
    )
    image.set_clip_path(outline(world.extent), transform=axes.transData)
    return image


def draw_bare_floor(axes: Axes, world: World) -> None:
    """Draw the extent of the world white, without shading by obstruction."""
    axes.add_artist(PathPatch(outline(world.extent), facecolor="white", edgecolor="none", zorder=0))


def draw_obstacles(axes: Axes, world: World, heights: Heights, view: View) -> list[Patch]:
    """Draw obstacles and keep-out zones in a view of the map, and return their legend entries.

    Obstacles at the camera's height are dark; those above or below it are light and hatched. For a camera that rises,
    obstacles at some of its heights are in between.
    """
    axes.set_facecolor(OBSTACLE if world.outside_is_obstacle else "white")
    entries: list[Patch] = []
    for layer, patch in _obstacle_looks(heights).items():
        shapes = [o.polygon for o in world.obstacles if _layer(o.heights, heights) == layer]
        raster = world.raster
        if raster is not None and _layer(raster.heights, heights) == layer:
            _draw_raster(axes, raster, patch.get_facecolor(), view)
            entries.append(patch)
        if shapes:
            _fill(axes, shapely.union_all(shapes), patch, zorder=1.8 + 0.1 * layer)
            entries += [patch] * (patch not in entries)
    closed = shapely.union_all([world.keep_out, *(z.area for z in world.content.zones if z.kind == "keep-out")])
    if not closed.is_empty:
        zone = Patch(facecolor="none", edgecolor=KEEP_OUT, hatch=r"\\\\", label="keep-out zone")
        _fill(axes, closed, zone, zorder=1.6)
        entries.append(zone)
    border = PathPatch(outline(world.extent), facecolor="none", edgecolor=QUIET, linewidth=0.6, zorder=2.2)
    axes.add_artist(border)  # as a patch it would update the data limits: 50 us a point
    return entries


def _layer(obstacle: tuple[float, float], heights: Heights) -> int:
    """Classify an obstacle by its heights: 2 at all heights of the camera, 1 at some of them, 0 at none."""
    if obstacle[1] < heights.low or heights.high < obstacle[0]:
        return 0
    return 2 if obstacle[0] <= heights.low and heights.high <= obstacle[1] else 1


def _obstacle_looks(heights: Heights) -> dict[int, Patch]:
    """Return a legend entry, with the colours to draw in, for each class of `_layer`."""
    if not heights.vary:
        light = f"obstacle below or above\nthe camera (at {heights})"
        return {2: Patch(facecolor=OBSTACLE, label="obstacle"), 0: _hatched_patch(OFF_CAMERA, "////", light)}
    return {
        2: Patch(facecolor=OBSTACLE, label=f"obstacle at all heights\nof the camera ({heights})"),
        1: _hatched_patch(AT_SOME, "....", "obstacle at some of them"),
        0: _hatched_patch(OFF_CAMERA, "////", "obstacle below or above all"),
    }


def _hatched_patch(colour: str, hatch: str, label: str) -> Patch:
    """Return a legend entry with a colour and a hatch."""
    return Patch(facecolor=colour, edgecolor=OBSTACLE, hatch=hatch, label=label)


def draw_scale_bar(axes: Axes, view: View) -> None:
    """Draw a bar of a round length (1, 2 or 5 times a power of ten) above the map's upper right corner."""
    longest = view.width / 4
    power = 10.0 ** np.floor(np.log10(longest))
    length = power * max(step for step in (1, 2, 5) if step * power <= longest)
    right, above = view.x_max, axes.get_xaxis_transform()
    axes.plot(
        [right - length, right],
        [1.02, 1.02],
        transform=above,
        color="black",
        linewidth=2.5,
        solid_capstyle="butt",
        clip_on=False,
        gid="scale bar",
    )
    axes.text(
        right - length / 2, 1.03, f"{length:g} m", transform=above, ha="center", va="bottom", fontsize=SMALL
    ).set_path_effects(list(HALO))


def outline(geometry: BaseGeometry) -> Path:
    """Return the polygons of a geometry as a Matplotlib path.

    Holes run in the opposite direction, so they stay empty.
    """
    return Path.make_compound_path(*(Path(ring, closed=True) for ring in _rings(geometry)))


def _rings(geometry: BaseGeometry) -> Iterator[FloatArray]:
    """Yield the corners (N, 2), m, of each ring of a geometry: for each polygon its outline, then its holes."""
    for part in shapely.get_parts(shapely.orient_polygons(geometry)):
        if part.geom_type == "Polygon":
            yield from (shapely.get_coordinates(ring) for ring in (part.exterior, *part.interiors))


def _open_area(world: World) -> BaseGeometry:
    """Return the extent minus all obstacles, whatever their height; the whole extent if nothing remains."""
    rest = shapely.difference(world.extent, world.solid())
    return world.extent if rest.is_empty else rest


def _fill(axes: Axes, geometry: BaseGeometry, like: Patch, zorder: float) -> None:
    """Draw a geometry filled and hatched like a legend entry."""
    patch = PathPatch(outline(geometry), linewidth=0.5, zorder=zorder)
    patch.set_facecolor(like.get_facecolor())
    patch.set_edgecolor(like.get_edgecolor())
    patch.set_label(like.get_label())
    if like.get_hatch():
        patch.set_hatch(like.get_hatch())
        patch.set_hatch_linewidth(0.6)
    axes.add_artist(patch)


def _draw_raster(axes: Axes, raster: Raster, colour: ColorType, view: View) -> None:
    """Draw the occupied cells of a raster that are in view.

    If there are too many, they are merged to blocks; a block with an occupied cell is drawn as occupied.
    """
    to_world = (
        Affine2D().scale(raster.resolution).rotate(raster.origin[2]).translate(raster.origin[0], raster.origin[1])
    )
    corners = [(x, y) for x in (view.x_min, view.x_max) for y in (view.y_min, view.y_max)]
    in_view = to_world.inverted().transform(corners)
    most = raster.cells.shape[::-1]
    low, high = (
        np.clip(end, 0, most).astype(int) for end in (np.floor(in_view.min(axis=0)), np.ceil(in_view.max(axis=0)))
    )
    cells: BoolArray = raster.cells[low[1] : high[1], low[0] : high[0]]
    if not cells.size:
        return
    side = -(-max(cells.shape) // CELLS)
    for axis in (0, 1):
        cells = np.logical_or.reduceat(cells, np.arange(0, cells.shape[axis], side), axis=axis)
    rows, columns = cells.shape
    axes.imshow(
        np.ma.masked_equal(cells.astype(np.uint8), 0),
        cmap=ListedColormap([colour]),
        origin="lower",
        extent=(low[0], low[0] + side * columns, low[1], low[1] + side * rows),
        transform=to_world + axes.transData,
        interpolation="nearest",
        zorder=1.9,
    )
