"""A world from the lines and solid fills of a drawing, as DXF and PDF files have them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.apart.child import Answer
from hpop.apart.lines import said
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import one_of
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.geometry.outlines import check_joinable, check_widenable
from hpop.world.geometry.shapes import LARGEST, SMALLEST, Obstacle, check_inside, check_positive
from hpop.world.ground import Ground
from hpop.world.readers.placement import Placement
from hpop.world.readers.rooms import widened
from hpop.world.world import World

DoorArcs = Literal["closed", "open"]
RADII = (0.4, 1.6)
"""Least and greatest width of the leaf of a door, m."""
SWEEPS = (math.radians(55), math.radians(125))
"""Least and greatest angle by which it turns."""
ROUND = 0.01
"""How far points of an arc are from a circle, for each unit of its radius, at most."""
POINTS = (5, 200)
"""Fewest and most points of such a line."""
LINES_AT_ONCE = 1_000
"""Lines that are looked at between two looks at the limits."""
PLACES_TOLD = 3


class Arc(NamedTuple):
    """The arc of a door in a line.

    line         which
    first, last  its points in the line's array, both included
    radius       m
    middle       (x, y), m
    """

    line: int
    first: int
    last: int
    radius: float
    middle: tuple[float, float]


def door_arcs(points: FloatArray, starts: IntArray, lines: IntArray) -> Iterator[Arc]:
    """Yield the arcs of doors in lines of points (n, 2), m; a line may also hold the leaf, at either end of its arc."""
    sizes = starts[lines + 1] - starts[lines]
    for number, line in enumerate(lines[(sizes >= POINTS[0]) & (sizes <= POINTS[1])].tolist()):
        if number % LINES_AT_ONCE == 0:
            limits.check(READING)
        begin, end = int(starts[line]), int(starts[line + 1])
        for first, last in ((begin, end), (begin + 1, end), (begin, end - 1), (begin + 1, end - 1)):
            radius = _radius(points[first:last])
            if radius is not None:
                x, y = points[(first + last) // 2].tolist()
                yield Arc(line, first, last - 1, radius, (x, y))
                break


def _radius(arc: FloatArray) -> float | None:
    """The radius, m, of points (n, 2) that a door swings through; None where they are no such arc."""
    if len(arc) < POINTS[0]:
        return None
    a, b, c = arc[0], arc[len(arc) // 2], arc[-1]
    (ux, uy), (vx, vy) = b - a, c - a
    doubled = 2 * (ux * vy - uy * vx)
    if abs(doubled) < 1e-9:
        return None
    u, v = ux * ux + uy * uy, vx * vx + vy * vy
    centre = a + np.array([vy * u - uy * v, ux * v - vx * u]) / doubled
    spokes = arc - centre
    radius = float(np.hypot(*spokes[0]))
    if not RADII[0] <= radius <= RADII[1] or not (np.abs(np.hypot(*spokes.T) - radius) < ROUND * radius).all():
        return None
    turns = np.diff(np.unwrap(np.arctan2(spokes[:, 1], spokes[:, 0])))
    swept = abs(float(turns.sum()))
    return radius if SWEEPS[0] <= swept <= SWEEPS[1] and (turns > 0).all() | (turns < 0).all() else None


def said_of_doors(arcs: list[Arc], treated: DoorArcs) -> str:
    """Return a note on arcs of doors."""
    places = ", ".join(f"({arc.middle[0]:.2f}, {arc.middle[1]:.2f})" for arc in arcs[:PLACES_TOLD])
    radii = sorted(arc.radius for arc in arcs)
    size = f"{radii[0]:.2g}" if radii[-1] - radii[0] < 0.01 else f"{radii[0]:.2g} to {radii[-1]:.2g}"
    what = f"{len(arcs):,} arcs look like the swing of a door, {size} m wide, such as at {places}"
    if treated == "open":
        return f"{what}: they are left out"
    return f"{what}, and close passages; door_arcs: open leaves them out"


WALL_WIDTH = 0.05
"""Thickness of a wall along a line, m: drawings have walls as two lines, their faces."""
LONG = 400
"""Points of a line that may come near to itself so often that its strip cannot be made."""
BLOCK = 2_000
"""Lines that are widened between two looks at the limits."""


class Options(NamedTuple):
    """What every drawing is asked for.

    wall_width  m
    layers      names, or None for all that are shown
    inside      a point of the free space, m, or None
    door_arcs   whether arcs along which doors swing are walls, or left out
    """

    wall_width: float
    layers: list[str] | None
    inside: tuple[float, float] | None
    door_arcs: DoorArcs


def options(wall_width: Any, layers: Any, inside: Any, door_arcs: Any) -> Options:
    """The options checked, or `MapError`."""
    one_of("door_arcs", door_arcs, get_args(DoorArcs), error=MapError)
    return Options(check_positive("wall_width", wall_width), _names(layers), check_inside(inside), door_arcs)


def _names(layers: Any) -> list[str] | None:
    if layers is None:
        return None
    names = [layers] if isinstance(layers, str) else layers
    if not (isinstance(names, Sequence) and names and all(isinstance(name, str) and name for name in names)):
        raise MapError(f"layers must be a name, or a list of names, of layers of the drawing; got {shown(layers)}.")
    return list(names)


def build(path: str | Path, found: Answer, placement: Placement, asked: Options, *, nothing: str) -> World:
    """The world of a drawing's lines; what was left out is told in its notes.

    found      ``points`` (n, 2) of all lines, where each line ``starts`` (m + 1,), its ``layer`` (m,), and its ``area``
               (m,): lines of one number above 0 bound an area
    placement  from the drawing's units to metres
    nothing    what to do about a drawing without lines
    """
    words, arrays = found
    left = f"left out: {said(words['left_out'])}" if words["left_out"] else ""
    starts, area = arrays["starts"], arrays["area"]
    if len(starts) < 2:
        raise MapError(f"{path} has no lines{' on those layers' * (asked.layers is not None)}; {left or nothing}.")
    points = placement.placed(arrays["points"])
    width, height = np.ptp(points, axis=0)
    if not SMALLEST <= max(width, height) <= LARGEST:
        raise MapError(
            f"{path}: a scale of {placement.scale:g} m a unit makes it {width:.3g} x {height:.3g} m; expected a "
            "building. Give another scale."
        )
    wide = np.maximum(asked.wall_width, arrays["width"] * placement.scale)  # of lines that are so thick on paper
    thin = np.flatnonzero(area == 0)
    swings = list(door_arcs(points, starts, thin))
    if asked.door_arcs == "open":
        points, starts, wide, thin = _without(swings, points, starts, wide, thin)
    walls = _walls(points, starts, thin, wide, asked.wall_width, path)
    solid = [*walls, *_areas(points, starts, area, path)]
    if not solid:
        raise MapError(f"{path} has lines without length only; {left or nothing}.")
    limits.check(READING)
    by_layer = {words["layers"][layer]: count for layer, count in zip(*_counted(arrays["layer"]), strict=True)}
    try:
        check_joinable(solid, f"{path}")
    except MapError as error:
        raise MapError(f"{error} layers chooses which are read, such as those of walls: {said(by_layer)}.") from None
    limits.check(READING)
    union = shapely.disjoint_subset_union_all(solid)  # in a thirtieth of the time of union_all
    several = "lines and fills" if len(starts) > 2 else "line or fill"
    size = f"{len(starts) - 1:,} {several} of {width:.4g} x {height:.4g} m"
    notes = [f"{size}; lines are walls {asked.wall_width:g} m thick. Layers: {said(by_layer)}", left]
    if thick := words["wide"] + np.count_nonzero(wide > asked.wall_width):
        notes.append(f"lines as thick as they are drawn: {thick:,}")
    if swings:
        notes.append(said_of_doors(swings, asked.door_arcs))
    if asked.layers is None:
        notes.append("layers chooses which are read; doors that are drawn as lines are closed, so leave out theirs")
    extent = shapely.box(*union.bounds)
    if asked.inside is None:
        ground = Ground(tuple(Obstacle(part) for part in shapely.get_parts(union).tolist()), extent=extent)
    else:
        reached = _reached(shapely.difference(extent, union), asked.inside, extent, path)
        ground = Ground(extent=reached, outside_is_obstacle=True)
        x, y = asked.inside
        notes.append(f"what cannot be reached from inside ({x:g}, {y:g}) is solid, {reached.area:.4g} m² are free")
    return World(ground, notes=tuple(f"{path}: {note}." for note in notes if note))


def _counted(layer: IntArray) -> tuple[list[int], list[int]]:
    numbers, counts = np.unique(layer, return_counts=True)
    return numbers.tolist(), counts.tolist()


def _walls(
    points: FloatArray, starts: IntArray, lines: IntArray, widths: FloatArray, usual: float, path: str | Path
) -> list[BaseGeometry]:
    """Polygons along lines, each of its width, m; what is wider than usual ends where its line does."""
    walls: list[BaseGeometry] = []
    for begin in range(0, len(lines), BLOCK):
        limits.check(READING)
        some = lines[begin : begin + BLOCK]
        for width in np.unique(widths[some]).tolist():
            made = _linestrings(points, starts, some[widths[some] == width])
            for line in made[shapely.get_num_coordinates(made) > LONG].tolist():
                check_widenable(line, width / 2, f"a line of {path}")
            walls += widened(made, width, cap="square" if width == usual else "flat")
    return walls


def _without(
    arcs: Sequence[Arc], points: FloatArray, starts: IntArray, widths: FloatArray, lines: IntArray
) -> tuple[FloatArray, IntArray, FloatArray, IntArray]:
    """Points, starts, widths and lines without arcs; what a line has beside its arc is a line of its own."""
    pieces = [
        (points[begin:end], widths[arc.line])
        for arc in arcs
        for begin, end in ((starts[arc.line], arc.first + 1), (arc.last, starts[arc.line + 1]))
        if end - begin > 1
    ]
    ends = starts[-1] + np.cumsum([len(piece) for piece, _ in pieces], dtype=np.int64)
    kept = np.setdiff1d(lines, [arc.line for arc in arcs])
    added = len(starts) - 1 + np.arange(len(pieces))
    return (
        np.concatenate([points, *(piece for piece, _ in pieces)]),
        np.append(starts, ends),
        np.append(widths, [width for _, width in pieces]),
        np.append(kept, added).astype(np.int64),
    )


def _linestrings(points: FloatArray, starts: IntArray, lines: IntArray) -> NDArray[np.object_]:
    """Lines, those of no length left out."""
    sizes = starts[lines + 1] - starts[lines]
    owner = np.repeat(np.arange(len(lines)), sizes)
    place = np.arange(len(owner)) + np.repeat(starts[lines] - np.cumsum(sizes) + sizes, sizes)
    made: NDArray[np.object_] = shapely.linestrings(points[place], indices=owner)
    return made[shapely.length(made) > 0]


def _areas(points: FloatArray, starts: IntArray, area: IntArray, path: str | Path) -> list[BaseGeometry]:
    """Polygons that lines bound together: what lies within an odd number of them."""
    made: list[BaseGeometry] = []
    lines = np.flatnonzero(area)
    for some in np.split(lines, np.flatnonzero(np.diff(area[lines])) + 1):
        limits.check(READING)
        rings = [
            shapely.LineString([*line, line[0]]) for i in some if len(line := points[starts[i] : starts[i + 1]]) > 2
        ]
        check_joinable(rings, f"a fill of {path}")
        made += [part for part in shapely.get_parts(shapely.build_area(shapely.union_all(rings))).tolist() if part.area]
    return made


def _reached(free: BaseGeometry, inside: tuple[float, float], extent: BaseGeometry, path: str | Path) -> BaseGeometry:
    """The part of the free space in which a point lies, or `MapError`."""
    here = shapely.Point(inside)
    for part in shapely.get_parts(free).tolist():
        if shapely.intersects(part, here):
            return part  # type: ignore[no-any-return]
    x0, y0, x1, y1 = extent.bounds
    raise MapError(
        f"{path}: inside ({inside[0]:g}, {inside[1]:g}) is in a wall or beyond; expected a point of the free space of "
        f"a plan that spans x {x0:.2f} to {x1:.2f} m, y {y0:.2f} to {y1:.2f} m. Move it."
    )
