"""Readers for floor plans in DXF and PDF: lines become walls, solid or dark fills become obstacles.

They need the extra ``plans`` (ezdxf and pypdfium2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.apart.child import ChildAnswer, counts_text
from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import one_of, whole
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.files import extract, file_source, read_bytes
from hpop.world.geometry.outlines import check_joinable, check_widenable
from hpop.world.geometry.shapes import LARGEST, SMALLEST, Obstacle, check_inside, check_positive
from hpop.world.ground import Ground
from hpop.world.readers.placement import Placement
from hpop.world.readers.rooms import Arc, DoorArcs, door_arcs, said_of_doors, widened
from hpop.world.world import World

MOST_BYTES = 100_000_000
"""Largest file, bytes: reading it takes about a minute."""
MOST_PAGES = 100_000
POINT = 0.0254 / 72
"""Length of a typographic point, the unit of a PDF page, m on paper."""
METRES = {
    1: ("inches", 0.0254),
    2: ("feet", 0.3048),
    4: ("millimetres", 0.001),
    5: ("centimetres", 0.01),
    6: ("metres", 1.0),
    10: ("yards", 0.9144),
    14: ("decimetres", 0.1),
    21: ("US survey feet", 1200 / 3937),
}
"""Name of a unit and its length, m, by the code ``$INSUNITS`` in the header of a drawing."""
WALL_WIDTH = 0.05
"""Default thickness of a wall along a line, m; drawings show both faces of a wall as lines."""
LONG = 400
"""Number of points above which a line is checked, because widening it may take very long if it is near to itself."""
BLOCK = 2_000
"""Lines that are widened between two checks of the time and memory limits."""


class DrawingOptions(NamedTuple):
    """Options shared by the readers of drawings.

    wall_width  m
    layers      names, or None for all visible layers
    inside      a point of the free space, m, or None
    door_arcs   "closed": the swing arcs of doors are walls; "open": they are left out
    """

    wall_width: float
    layers: list[str] | None
    inside: tuple[float, float] | None
    door_arcs: DoorArcs


def checked_options(wall_width: Any, layers: Any, inside: Any, door_arcs: Any) -> DrawingOptions:
    """Return the options of a reader of drawings.

    `MapError` if the width of walls is not above 0, `layers` is no name or list of names, `inside` no position (x, y),
    or `door_arcs` not one of DoorArcs.
    """
    one_of("door_arcs", door_arcs, get_args(DoorArcs), error=MapError)
    return DrawingOptions(check_positive("wall_width", wall_width), _names(layers), check_inside(inside), door_arcs)


def _names(layers: Any) -> list[str] | None:
    if layers is None:
        return None
    names = [layers] if isinstance(layers, str) else layers
    if not (isinstance(names, Sequence) and names and all(isinstance(name, str) and name for name in names)):
        raise MapError(f"layers must be a name, or a list of names, of layers of the drawing; got {shown(layers)}.")
    return list(names)


def build(
    path: str | Path, found: ChildAnswer, placement: Placement, options: DrawingOptions, *, nothing: str
) -> World:
    """Build a world from the lines of a drawing, with notes on everything left out.

    found      arrays: ``points`` (n, 2) of all lines; ``starts`` (m + 1,), the index of the first point of each line;
               ``layer``, ``width`` and ``area`` (m,) of each line. Lines with an equal area number above 0 bound a
               filled area. Points and widths are in units of the drawing; ``words``: see `hpop.apart.child`
    placement  conversion from the units of the drawing to metres
    nothing    text for the error about a drawing without lines
    """
    words, arrays = found
    left = f"left out: {counts_text(words['left_out'])}" if words["left_out"] else ""
    starts, area = arrays["starts"], arrays["area"]
    if len(starts) < 2:
        raise MapError(f"{path} has no lines{' on those layers' * (options.layers is not None)}; {left or nothing}.")
    points = placement.placed(arrays["points"])
    width, height = np.ptp(points, axis=0)
    if not SMALLEST <= max(width, height) <= LARGEST:
        raise MapError(
            f"{path}: a scale of {placement.scale:g} m per unit makes it {width:.3g} x {height:.3g} m; expected the "
            "size of a building. Give another scale."
        )
    wide = np.maximum(options.wall_width, arrays["width"] * placement.scale)  # thick lines on paper are thick walls
    thin = np.flatnonzero(area == 0)
    swings = list(door_arcs(points, starts, thin))
    if options.door_arcs == "open":
        points, starts, wide, thin = _without(swings, points, starts, wide, thin)
    walls = _walls(points, starts, thin, wide, options.wall_width, path)
    solid = [*walls, *_areas(points, starts, area, path)]
    if not solid:
        raise MapError(f"{path} has only lines of length 0; {left or nothing}.")
    limits.check(READING)
    by_layer = {words["layers"][layer]: count for layer, count in zip(*_counted(arrays["layer"]), strict=True)}
    try:
        check_joinable(solid, f"{path}")
    except MapError as error:
        raise MapError(
            f"{error} Use layers to choose which layers are read, such as those of walls; the drawing has "
            f"{counts_text(by_layer)}."
        ) from None
    limits.check(READING)
    union = shapely.disjoint_subset_union_all(solid)  # in a thirtieth of the time of union_all
    several = "lines and fills" if len(starts) > 2 else "line or fill"
    size = f"{len(starts) - 1:,} {several} of {width:.4g} x {height:.4g} m"
    notes = [f"{size}; lines are walls {options.wall_width:g} m thick. Layers: {counts_text(by_layer)}", left]
    if thick := words["wide"] + np.count_nonzero(wide > options.wall_width):
        notes.append(f"lines as thick as they are drawn: {thick:,}")
    if swings:
        notes.append(said_of_doors(swings, options.door_arcs))
    if options.layers is None:
        notes.append("layers chooses which are read; doors drawn as lines close passages, so leave out their layers")
    extent = shapely.box(*union.bounds)
    if options.inside is None:
        ground = Ground(tuple(Obstacle(part) for part in shapely.get_parts(union).tolist()), extent=extent)
    else:
        reached = _reached(shapely.difference(extent, union), options.inside, extent, path)
        ground = Ground(extent=reached, outside_is_obstacle=True)
        x, y = options.inside
        notes.append(f"all that cannot be reached from inside ({x:g}, {y:g}) is solid, {reached.area:.4g} m² are free")
    return World(ground, notes=tuple(f"{path}: {note}." for note in notes if note))


def _counted(layer: IntArray) -> tuple[list[int], list[int]]:
    numbers, counts = np.unique(layer, return_counts=True)
    return numbers.tolist(), counts.tolist()


def _walls(
    points: FloatArray, starts: IntArray, lines: IntArray, widths: FloatArray, usual: float, path: str | Path
) -> list[BaseGeometry]:
    """Return walls, as polygons along the lines with the numbers ``lines``; see `build` for points and starts.

    The walls are ``widths[lines]`` m wide. Lines as wide as ``usual`` get square ends, so that walls meet without a
    notch; others get flat ends.
    """
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
    """Return points, starts and widths (see `build`), and the numbers of the lines to read, without the given arcs.

    A line with an arc is left out; its parts before and after the arc are added as new lines at the end.
    """
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
    """Return the lines with the given numbers as shapely lines, except lines of length 0; see `build` for arrays."""
    sizes = starts[lines + 1] - starts[lines]
    owner = np.repeat(np.arange(len(lines)), sizes)
    index = np.arange(len(owner)) + np.repeat(starts[lines] - np.cumsum(sizes) + sizes, sizes)
    lines_of_points: NDArray[np.object_] = shapely.linestrings(points[index], indices=owner)
    return lines_of_points[shapely.length(lines_of_points) > 0]


def _areas(points: FloatArray, starts: IntArray, area: IntArray, path: str | Path) -> list[BaseGeometry]:
    """Return the filled areas as polygons; an area is all points inside an odd number of its lines.

    points  (P, 2)  points of all lines, line after line
    starts  (N+1,)  index of the first point of each line, and P
    area    (N,)    number of the area that each line bounds, 0 for none
    path            file of the drawing, named in messages

    Raises MapError if the lines of an area cross too often to be joined.
    """
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
    """Return the connected part of the free space that contains a point; `MapError` for a blocked point."""
    here = shapely.Point(inside)
    for part in shapely.get_parts(free).tolist():
        if shapely.intersects(part, here):
            return part  # type: ignore[no-any-return]
    x0, y0, x1, y1 = extent.bounds
    raise MapError(
        f"{path}: inside ({inside[0]:g}, {inside[1]:g}) is in a wall or outside the plan, which spans x {x0:.2f} to "
        f"{x1:.2f} m, y {y0:.2f} to {y1:.2f} m. Move the point into free space."
    )


def read_dxf(
    path: str | Path,
    *,
    scale: float | None = None,
    layers: str | Sequence[str] | None = None,
    wall_width: float = WALL_WIDTH,
    inside: tuple[float, float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
    door_arcs: DoorArcs = "closed",
) -> World:
    """Read the model space of a DXF drawing, ASCII or binary, as a `World`.

    Parameters
    ----------
    path : path of the file
    scale : float, optional
        Metres per unit of the drawing; without it the drawing's header must state its units (``$INSUNITS``).
    layers : name or names, optional
        The layers to read; default: all that are neither off nor frozen.
    wall_width : float
        Thickness of the walls along lines, m.
    inside : (x, y), optional
        A point in the free space, m. Areas that cannot be reached from there become solid, such as the inside of walls
        drawn as two lines, and everything outside the building. Without it nothing is filled, and the extent is the
        bounding box of walls and obstacles.
    origin : (x, y)
        The drawing's point that becomes (0, 0), in its units.
    door_arcs : "closed" or "open"
        "closed": arcs that look like the swing of a door (radius 0.4 to 1.6 m, about a quarter of a circle) are walls;
        "open": they are left out. ``world.notes`` say where they are.

    Lines, polylines, arcs, circles, ellipses, splines and MLINEs are walls, also in inserted blocks; wide polylines and
    filled shapes (solid hatches, SOLID, TRACE) are obstacles. Everything invisible, or on layers that are off or
    frozen, is left out. ``world.notes`` count by layer what was read and what was left out. Curves become polylines,
    accurate to 1/2000 of their size.

    Raises
    ------
    MapError
        If the file is missing or no drawing, states no units, lacks lines or the requested layers, or takes more time
        or memory than `hpop.world.files` allows.
    """
    checked = checked_options(wall_width, layers, inside, door_arcs)
    Placement(1.0 if scale is None else scale, origin)  # checked before the file is read
    content = read_bytes(path, "DXF drawing", limit=MOST_BYTES)
    found = extract("dxf", path, content, {"layers": checked.layers})
    elsewhere = found.words["elsewhere"]
    nothing = "its model space is empty" + f", {elsewhere:,} objects are on its layout sheets" * bool(elsewhere)
    unit, metres = ("units", scale) if scale is not None else _units(path, found)
    world = build(path, found, Placement(metres, origin), checked, nothing=nothing)
    note = f"{path}: drawn in {unit} of {metres:g} m{' by its header; give scale to change it' * (scale is None)}."
    options = {"scale": scale, **checked._asdict(), "origin": list(origin)}
    return World(world.ground, notes=(note, *world.notes)).read_from(file_source("dxf", path, options, content))


def _units(path: str | Path, found: ChildAnswer) -> tuple[str, float]:
    """Return the units that the header of a DXF drawing states, by name, and their length, m; MapError if none."""
    code = found.words["insunits"]
    if code in METRES:
        return METRES[code]
    if not len(found.arrays["points"]):
        return "no units", 1.0  # a drawing without lines is refused first
    width, height = np.ptp(found.arrays["points"], axis=0)
    says = "does not state its units ($INSUNITS is 0)" if code == 0 else f"has $INSUNITS {code}, no unit of a building"
    raise MapError(
        f"{path} {says}; it spans {width:.5g} x {height:.5g} units. Give scale, the metres per unit: 0.001 for "
        "millimetres, 0.01 for centimetres, 1 for metres, 0.0254 for inches."
    )


def read_pdf(
    path: str | Path,
    *,
    scale: float | None = None,
    ratio: float | None = None,
    page: int = 1,
    layers: str | Sequence[str] | None = None,
    wall_width: float = WALL_WIDTH,
    inside: tuple[float, float] | None = None,
    origin: tuple[float, float] = (0.0, 0.0),
    door_arcs: DoorArcs = "closed",
) -> World:
    """Read a page of a PDF with lines, as CAD programs export it, as a `World`; give either scale or ratio.

    Parameters
    ----------
    path : path of the file
    scale : float
        Metres per point of the page (1/72 inch on paper).
    ratio : float
        The scale stated on the plan: 100 for 1:100, if the page has its true size.
    page : int
        Number of the page, from 1.
    layers : name or names, optional
        The layers (optional content) to read; default: all that are on when the file is opened.
    wall_width, inside
        See `hpop.world.readers.drawing.read_dxf`.
    origin : (x, y)
        The point that becomes (0, 0), in points from the lower left corner of the page as it is shown.
    door_arcs : "closed" or "open"
        See `hpop.world.readers.drawing.read_dxf`.

    Dark lines are walls; lines thicker than 1 mm on paper are as thick as drawn. Dark fills are obstacles. Lighter
    fills colour rooms and are left out, as are texts, images, annotations, and everything outside the page or a clip
    path. ``world.notes`` count what was left out. A page's own unit (UserUnit) is respected.

    Raises
    ------
    MapError
        If the file is missing or no PDF, lacks the page, lines or the requested layers, or takes more time or memory
        than `hpop.world.files` allows.
    """
    checked = checked_options(wall_width, layers, inside, door_arcs)
    page = whole("page", page, 1, MOST_PAGES, error=MapError)
    if (scale is None) == (ratio is None):
        raise MapError(
            f"{path}: a PDF does not state its scale. Give either ratio, 100 for a plan at 1:100 whose page has its "
            f"true size, or scale, the metres per point (1/72 inch on paper); got {'none' if scale is None else 'both'}"
            " of them."
        )
    metres = check_positive("ratio", ratio) * POINT if scale is None else check_positive("scale", scale)
    placement = Placement(metres, origin)
    content = read_bytes(path, "PDF", limit=MOST_BYTES)
    found = extract("pdf", path, content, {"layers": checked.layers, "page": page})
    nothing = f"page {page} of {found.words['pages']:,} is empty"
    try:
        world = build(path, found, placement, checked, nothing=nothing)
    except MapError as error:
        if not found.words["left_out"].get("images") or len(found.arrays["points"]):
            raise
        raise MapError(
            f"{error} If the page is a scan, save it as an image, such as by pdftoppm -r 150 -gray -png, and read that "
            f"with the reader image and resolution {metres * 72 / 150:.4g}."
        ) from None
    options = {"scale": metres, "page": page, **checked._asdict(), "origin": list(origin)}
    if (unit := found.words["unit"]) != 1.0:
        note = f"{path}: the page {page} says (UserUnit) that its unit is {unit:g} points; this is applied."
        world = replace(world, notes=(note, *world.notes))
    return world.read_from(file_source("pdf", path, options, content))
