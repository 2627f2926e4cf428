"""Explorer of a front: a web page in one file, on which a person chooses a trajectory.

Here are the data of the page as JSON, ``hpop-page`` version 1; web/src/explorer/payload.ts reads them.

Costs are the floats of front.json, bit for bit. Lengths are whole millimetres from an origin. A page of 8,000
trajectories takes 2 MB at most.

Outlines of all areas are in one table of rings (closed polygons), and an area is a range of rings. Outlines are
counter-clockwise and holes clockwise, so that the nonzero rule fills the union of overlapping areas. Occupied cells of
a raster map are outlined too. If a map has too many cells, neighbouring cells are merged, with a note.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.criteria.base import Criterion
from hpop.errors import MapError
from hpop.frontier.choices import Preferring
from hpop.frontier.points import JOINT
from hpop.problems.front import Front
from hpop.problems.named_rows import stop_visits, visit_order
from hpop.problems.problem import Problem
from hpop.runtime.limits import Status
from hpop.view.explorer import along
from hpop.view.explorer.along import MILLIMETRES, Packer, corners, millimetres
from hpop.view.ground import View, shaded_by, view_of
from hpop.view.marks import camera_ends, targets_by_name
from hpop.view.style import Heights, marks, quantities
from hpop.world import World
from hpop.world.content.content import Person, Zone
from hpop.world.fields.measured import MeasuredField
from hpop.world.files import by_names
from hpop.world.geometry.shapes import Raster

MOST_CELLS = 2000  # most cells along the longer side of a raster
FIELD_POINTS = 200  # of a measured field, along the longer side of the map
MOST_CORNERS = 60_000  # of the outlines of a raster: some 100 kB


class _Rings:
    """Table of the rings (closed polygons) of all areas on the page."""

    def __init__(self) -> None:
        self._rings: list[FloatArray] = []

    def area(self, *geometries: BaseGeometry) -> dict[str, int]:
        """Add the polygons of some geometries to the table, and return the range of their rings."""
        first = len(self._rings)
        for part in shapely.orient_polygons(shapely.get_parts(shapely.get_parts(list(geometries)))):
            if part.geom_type == "Polygon" and not part.is_empty:
                self._rings += [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
        return {"first": first, "count": len(self._rings) - first}

    def packed(self, packer: Packer, origin: tuple[float, float]) -> dict[str, Any]:
        """Add the columns of the table to ``packer``, and return the position of each column there.

        x, y    corners of all rings, one ring after the other, in whole mm from ``origin`` (x, y), m
        counts  number of corners of each ring
        """
        points = np.concatenate([np.zeros((0, 2)), *self._rings])
        x, y = (packer.integers(column, order=1) for column in millimetres(points, origin).T)
        return {"x": x, "y": y, "counts": packer.integers([len(ring) for ring in self._rings])}


def bounds_of(world: World, points: Sequence[FloatArray]) -> View:
    """Return the rectangle that holds everything to draw: the world's extent, and points (N, 2), m."""
    places = np.concatenate([np.array(world.bounds).reshape(2, 2), *points])
    places = places[np.isfinite(places).all(axis=1)]
    return View(*places.min(axis=0).tolist(), *places.max(axis=0).tolist())


def world_payload(
    problem: Problem, front: Front, paths: FloatArray, heights: Heights, packer: Packer, origin: tuple[float, float]
) -> tuple[dict[str, Any], list[str]]:
    """Return the world in the form of the page's JSON, and notes on details that the page's map leaves out.

    paths  (P, 2) m, corners of the trajectories' paths
    """
    world, rings, notes = problem.world, _Rings(), list[str]()
    obstacles = [rings.area(o.polygon) | {"z": _open_ended(o.heights)} for o in world.obstacles]
    if world.raster is not None:
        cells, side = _outlines(world.raster)
        obstacles.append(rings.area(cells) | {"z": _open_ended(world.raster.heights)})
        if side > 1:
            notes.append(
                f"the map is drawn in cells of {side * world.raster.resolution:g} m, occupied where one of "
                f"{side} x {side} is; the search uses all cells"
            )
    start, goals = camera_ends(problem, front.trajectories)
    content = world.content
    found = {
        "extent": rings.area(world.extent),
        "closed": rings.area(world.keep_out),
        "zones": [_zone(zone, rings) for zone in content.zones],
        "obstacles": obstacles,
        "outside": bool(world.outside_is_obstacle),
        "people": [_person(person) for person in content.people],
        "groups": [list(group) for group in content.groups],
        "landmarks": [
            {"x": mark.x, "y": mark.y, "z": mark.z, "facing": mark.facing, "name": printable(mark.name)}
            for mark in content.landmarks
        ],
        "targets": [{"x": x, "y": y, "name": printable(name)} for name, (x, y, _) in targets_by_name(problem)],
        "start": start._asdict(),
        "goals": [goal._asdict() for goal in goals],
        "heights": [heights.low, heights.high],
        "caption": _caption(problem, heights),
        "field": _field(problem, bounds_of(world, [paths]), packer),
    }
    shown = view_of(problem, [paths] if len(paths) else ())
    corners = [np.array([goal[:2] for goal in (start, *goals)])]
    for name, view in (("view", shown), ("bounds", bounds_of(world, [paths, *corners]))):
        found[name] = [view.x_min, view.y_min, view.x_max, view.y_max]
    found["rings"] = rings.packed(packer, origin)
    return found, notes


def _field(problem: Problem, view: View, packer: Packer) -> Mapping[str, Any] | None:
    """Return the measured field of the problem's first criterion that has one, on a grid over a view; else None.

    Values are whole thousandths of the range over free space, row by row from the lowest y.
    """
    field = shaded_by(problem)
    if not isinstance(field, MeasuredField):
        return None
    step = max(view.width, view.height) / FIELD_POINTS
    columns, rows = (max(1, round(side / step)) for side in (view.width, view.height))
    x = view.x_min + view.width * (np.arange(columns) + 0.5) / columns
    y = view.y_min + view.height * (np.arange(rows) + 0.5) / rows
    X, Y = (at.ravel() for at in np.meshgrid(x, y))
    values = field(X, Y)
    free = shapely.contains_xy(problem.world.extent, X, Y)
    low, high = (float(end(values[free] if free.any() else values)) for end in (np.min, np.max))
    shares = np.clip((values - low) / ((high - low) or 1.0), 0.0, 1.0)
    box = [view.x_min, view.y_min, view.x_max, view.y_max]
    about = {"name": printable(field.name), "unit": printable(field.unit), "low": low, "high": high}
    return about | {"box": box, "width": columns, "values": packer.short(np.rint(1000.0 * shares))}


def _person(person: Person) -> Mapping[str, Any]:
    """Return a person as JSON, at the position where the person first appears; of several hypotheses the likeliest."""
    first = person.likeliest
    now = np.float64(first.begin)
    (x, y), velocity = first.at(now), first.velocity_at(now)
    return {
        "x": float(x),
        "y": float(y),
        "yaw": float(first.yaw_at(now)),
        "velocity": [float(part) for part in velocity],
        "radius": person.radius,
        "name": printable(person.name),
    }


def _zone(zone: Zone, rings: _Rings) -> Mapping[str, Any]:
    """Return a zone as JSON; its polygons are added to the table of rings."""
    return {
        "kind": zone.kind,
        "area": rings.area(zone.area),
        "limit": zone.limit,
        "path": None if zone.path is None else shapely.get_coordinates(zone.path).ravel().tolist(),
        "name": printable(zone.name),
    }


def _outlines(raster: Raster) -> tuple[BaseGeometry, int]:
    """Return the outlines, m, of a raster's occupied cells, and the side of a merged block, in cells.

    The side is 1 unless the map has too many cells or corners; a block is occupied if one of its cells is.
    """
    side = -(-max(raster.cells.shape) // MOST_CELLS)
    while True:
        cells = raster.cells
        for axis in (0, 1):
            cells = np.logical_or.reduceat(cells, np.arange(0, cells.shape[axis], side), axis=axis)
        coarse = replace(raster, cells=cells, resolution=side * raster.resolution, contrasts=None)
        try:
            found = coarse.solid()
        except MapError:  # too many corners
            found = None
        if found is not None and shapely.get_num_coordinates(found) <= MOST_CORNERS:
            return found, side
        side *= 2


def _open_ended(heights: tuple[float, float]) -> list[float | None]:
    """Return a range of heights for JSON: None for an infinite end."""
    return [height if math.isfinite(height) else None for height in heights]


def _caption(problem: Problem, heights: Heights) -> str:
    """Return the caption of the page's map: its paths are those of the camera, and it does not show varying heights."""
    if not heights.vary:
        return "Seen from above: paths of the camera"
    carried = "" if "base" in problem.model.provides else "; the arm itself is not drawn"
    return f"Seen from above: paths of the camera, whose height, {heights}, the map does not show{carried}"


SCHEMA = "hpop-page"
VERSION = 1
SCRIPT = "explorer.js"  # reads the payload


def payload(
    problem: Problem,
    front: Front,
    *,
    title: str | None = None,
    saved: str | None = None,
    preference: Preferring | None = None,
) -> dict[str, Any]:
    """Return all data of the explorer page for a front, as a dict for JSON.

    title       of the page; by default the costs that are traded off
    saved       file of the front, for the Python code that the page offers
    preference  of a person; the best trajectory for that person is marked
    """
    packer = Packer()
    origin = math.floor(problem.world.bounds[0]), math.floor(problem.world.bounds[1])
    drawn = corners(front.trajectories, origin)
    named = marks(front, preference=preference)
    start = float(problem.model.pose("camera", problem.model.space.state(problem.start)).z[0])
    heights = Heights(min(start, drawn.heights[0]), max(start, drawn.heights[1]))
    paths = {
        "x": packer.integers(drawn.places[:, 0], order=1),
        "y": packer.integers(drawn.places[:, 1], order=1),
        "corners": packer.integers(drawn.corners),
        "counts": packer.integers(drawn.counts),
    }
    ground, left_out = world_payload(
        problem, front, drawn.places / MILLIMETRES + np.array(origin), heights, packer, origin
    )
    criteria = along.columns_of(problem, front)
    rows = along.traced_rows(front, [mark.row for mark in named])
    visits = [] if problem.tour is None else [stop_visits(front, row) for row in rows]
    return {
        "schema": SCHEMA,
        "version": VERSION,
        "title": printable(title if title is not None else _title(front)),
        "status": printable(front.status),
        "complete": front.status == Status.COMPLETE,
        "certificate": [printable(claim) for claim in front.certificate.split(JOINT)],
        "notes": [printable(by_names(note)) for note in dict.fromkeys((*front.notes, *problem.world.notes, *left_out))],
        "count": len(front),
        "columns": _columns(front, criteria, packer),
        "marks": [
            {"names": list(mark.names), "row": mark.row, "colour": mark.colour, "dashes": list(mark.dashes[1])}
            for mark in named
        ],
        "saved": None if saved is None else printable(saved),
        "origin": list(origin),
        "paths": paths,
        "world": ground,
        "tour": _tour(problem, front, packer),
        "traces": [
            {**each, "visits": visits[rows.index(each["row"])] if visits else []}
            for each in along.traces(problem, front, criteria, rows, packer, origin)
        ],
        "data": packer.text(),
    }


def _tour(problem: Problem, front: Front, packer: Packer) -> dict[str, Any] | None:
    """Return the stops of a tour and the order in which each trajectory visits them; None without a tour.

    Orders are texts such as "2 1 3", each listed once; each trajectory refers to its order by the index in this list.
    """
    if problem.tour is None:
        return None
    found = [visit_order(front, row) for row in range(len(front))]
    orders = sorted(set(found), key=lambda order: (order.count(" "), order))
    return {
        "stops": [
            {
                "name": printable(stop.name),
                "place": stop.place(problem.world),
                "within": stop.within if stop.at is not None else None,
            }
            for stop in problem.tour.stops
        ],
        "orders": orders,
        "order": packer.integers([orders.index(order) for order in found]),
    }


def _title(front: Front) -> str:
    """Return the default title of the page: the costs that are traded off, or that no path was found."""
    if not len(front):
        return "No path from start to goal" if front.status == Status.NO_PATH else "No path found"
    *several, last = front.names
    return f"Trade-offs between {', '.join(several)} and {last}" if several else f"The least {last}"


def _about(criterion: Criterion) -> str:
    """Return the first paragraph of a criterion's docstring, without markup."""
    first = " ".join((type(criterion).__doc__ or "").strip().split("\n\n")[0].split())
    return printable(re.sub(r":\w+:`~?([^`]+)`|`", r"\1", first))


def _columns(front: Front, criteria: Sequence[Criterion | None], packer: Packer) -> list[dict[str, Any]]:
    """Return the page's table columns: one for each criterion, then one for each reported value."""
    quanta = [*front.quanta.tolist(), *[0.0] * len(front.reported_names)]
    groups = [*front.groups, *[""] * len(front.reported_names)]
    table, evaluated = np.hstack([front.costs, front.reported]), front.evaluated
    return [
        {
            "name": column.name,
            "label": column.label,
            "unit": column.unit,
            "about": "" if criterion is None else _about(criterion),
            "group": group if group in "PCRO" else "",
            "quantum": quantum,
            "counts": bool(column.counts),
            "reported": place >= len(front.names),
            "evaluated": column.name in evaluated,
            "along": None if criterion is None else along.words(criterion),
            "adds": "sum" if criterion is None else along.ADDS.get(criterion.aggregate, "sum"),
            "values": packer.floats(table[:, place]),
        }
        for place, (column, quantum, group, criterion) in enumerate(
            zip(quantities(front), quanta, groups, criteria, strict=True)
        )
    ]
