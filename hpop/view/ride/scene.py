"""Visible things in a problem's world, in a form that panoramas and the ride page draw.

Metres, x right, y up in the plane, z height (REP-103), floor at z = 0. Obstacles are upright prisms. Other shapes are
drawn as their enclosing prisms, with a note in `ViewScene.notes`; `ViewScene.description` keeps their true shape.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.text import counted, printable
from hpop.problems.problem import Problem
from hpop.view.ride import surfaces
from hpop.view.ride.surfaces import Colour
from hpop.world import World
from hpop.world.content.content import Landmark, Person, Zone
from hpop.world.geometry.shapes import Raster
from hpop.world.geometry.solids import Solid

VERSION = 1
STOREY = 3.0
"""Drawn height of obstacles without an upper end, m."""
HEADROOM = 0.5
"""Height by which such obstacles rise above a camera that is higher, m."""
WALL_FROM = 2.5
"""Height from which an obstacle without a name looks like a wall, m."""
BORDER = 0.2
"""Thickness of the wall round a map whose outside is an obstacle, m."""
DIGITS = 4
"""Decimals of the corners of people's paths, m and s."""
PLATE = (0.8, 0.5)
"""Width and height of the plate that shows a landmark, m."""
BEFORE = 0.005
"""Distance by which a plate stands before its landmark, m, so that a wall behind the landmark does not hide it."""


@dataclass(frozen=True, eq=False)
class Prism:
    """Upright prism that represents an obstacle.

    rings   (K, 2)  m  corners, not closed: the outer ring counter-clockwise, then holes clockwise
    low, high       m  heights of its bottom and top, finite
    number          identifies the prism in ``Panorama.numbers``: 1, 2, ... in the order of ``ViewScene.prisms``
    colour          (red, green, blue), 0 to 255
    is_wall         whether it is drawn with a skirting (a dark strip at its foot)
    name            name of the obstacle, or ""
    solid           the true shape, if it is not upright
    """

    rings: tuple[FloatArray, ...]
    low: float
    high: float
    number: int
    colour: Colour
    is_wall: bool
    name: str = ""
    solid: Solid | None = None

    def description(self) -> dict[str, Any]:
        """Return the JSON description."""
        return {
            "rings": [ring.tolist() for ring in self.rings],
            "z": [self.low, self.high],
            "number": self.number,
            "colour": list(self.colour),
            "is_wall": self.is_wall,
            "name": self.name,
            **({} if self.solid is None else {"solid": self.solid.describe()}),
        }


@dataclass(frozen=True, eq=False)
class Cells:
    """Occupied cells of a raster map, merged to boxes.

    boxes   (B, 4)  x0, y0, x1, y1 in cells: first column and row, and last column and row plus 1
    raster          the map, which gives the position and size of cells
    low, high       m  heights of the bottom and top of all boxes
    number, colour  as in :class:`Prism`; all boxes have the same
    """

    boxes: IntArray
    raster: Raster
    low: float
    high: float
    number: int
    colour: Colour

    @property
    def corners(self) -> FloatArray:
        """Return the corners (B, 4, 2), m, of the boxes, counter-clockwise."""
        x0, y0, x1, y1 = self.boxes.T.astype(np.float64)
        x, y = self.raster.to_world(np.stack([x0, x1, x1, x0], axis=1), np.stack([y0, y0, y1, y1], axis=1))
        return np.stack([x, y], axis=2)

    def description(self) -> dict[str, Any]:
        """Return the JSON description: boxes in cells, and the cells' placement in the world."""
        return {
            "boxes": self.boxes.tolist(),
            "resolution": self.raster.resolution,
            "origin": list(self.raster.origin),
            "z": [self.low, self.high],
            "number": self.number,
            "colour": list(self.colour),
        }


@dataclass(frozen=True)
class BodyPart:
    """Body part of a drawn person, symmetric about a vertical axis: a cylinder or an ellipsoid.

    shape    "cylinder" or "ellipsoid"
    radius   m
    low, high  m
    colour   of its front half, and ``back`` of its back half
    """

    shape: str
    radius: float
    low: float
    high: float
    colour: Colour
    back: Colour


@dataclass(frozen=True, eq=False)
class Figure:
    """Person as drawn: legs, trunk and head, moving along the path of the likeliest hypothesis."""

    person: Person
    number: int
    parts: tuple[BodyPart, ...]

    def description(self) -> dict[str, Any]:
        """Return the JSON description."""
        person = self.person.likeliest
        return {
            "x": person.x,
            "y": person.y,
            "way": np.round(person.way(), DIGITS).tolist(),
            "there": [person.begin, person.until if person.afterwards == "gone" else None],
            "radius": person.radius,
            "name": person.name,
            "number": self.number,
            "parts": [
                {**vars(part), "colour": list(part.colour), "back": list(part.back)}  # shape, radius, low, high
                for part in self.parts
            ],
        }


@dataclass(frozen=True, eq=False)
class Plate:
    """Landmark as drawn: an upright plate that shows its name; if it has no name, the plate shows a picture.

    A plate without a facing turns towards the camera.
    """

    landmark: Landmark
    width: float
    height: float
    number: int
    colour: Colour

    def description(self) -> dict[str, Any]:
        """Return the JSON description."""
        mark = self.landmark
        return {
            "x": mark.x,
            "y": mark.y,
            "z": mark.z,
            "facing": mark.facing,
            "name": mark.name,
            "width": self.width,
            "height": self.height,
            "number": self.number,
            "colour": list(self.colour),
        }


@dataclass(frozen=True, eq=False)
class Area:
    """Zone as drawn on the floor: coloured polygons, each a list of rings as in `Prism`."""

    zone: Zone
    polygons: tuple[tuple[FloatArray, ...], ...]
    colour: Colour

    def description(self) -> dict[str, Any]:
        """Return the JSON description."""
        return {
            "kind": self.zone.kind,
            "name": self.zone.name,
            "polygons": [[ring.tolist() for ring in polygon] for polygon in self.polygons],
            "colour": list(self.colour),
        }


@dataclass(frozen=True, eq=False)
class ViewScene:
    """All visible things of a world.

    prisms   obstacles, in order, and a wall round the map if its outside is an obstacle
    cells    occupied cells of a raster map, or None
    figures  people
    plates   landmarks
    areas    zones
    floor    the extent, as polygons of rings
    storey   m  height of walls without an upper end
    notes    notes (texts to print) on shapes that are not drawn exactly
    """

    prisms: tuple[Prism, ...]
    cells: Cells | None
    figures: tuple[Figure, ...]
    plates: tuple[Plate, ...]
    areas: tuple[Area, ...]
    floor: tuple[tuple[FloatArray, ...], ...]
    storey: float
    notes: tuple[str, ...]

    @classmethod
    def of(cls, problem: Problem) -> ViewScene:
        """Return the visible things of a problem's world.

        Obstacles without an upper end are drawn 3 m high, or higher if needed to end half a metre above the camera at
        its start.
        """
        world = problem.world
        camera = problem.model.pose("camera", problem.model.space.state(problem.start))
        z = float(np.broadcast_to(camera.z, 1)[0])
        storey = max(STOREY, math.ceil(2.0 * (z + HEADROOM)) / 2.0)
        obstacles = [*_prisms(world, storey), *_border(world, storey)]
        prisms = [replace(prism, number=i) for i, prism in enumerate(obstacles, 1)]
        number = len(prisms) + 1
        cells = None
        if world.raster is not None:
            from hpop.view.ride.columns import boxes  # a kernel, see hpop.runtime.compiled

            low, high = _ends(world.raster.heights, storey)
            cells = Cells(boxes(world.raster.cells), world.raster, low, high, number, surfaces.WALL)
            number += 1
        people, landmarks = world.content.people, world.content.landmarks
        return cls(
            tuple(prisms),
            cells,
            tuple(_figure(person, number + i) for i, person in enumerate(people)),
            tuple(_plate(mark, number + len(people) + i) for i, mark in enumerate(landmarks)),
            tuple(Area(zone, _polygons(zone.area), surfaces.ZONES[zone.kind]) for zone in _zones(world)),
            _polygons(world.extent),
            storey,
            tuple(_notes(world, storey)),
        )

    def description(self) -> dict[str, Any]:
        """Return the scene as JSON, for a page that draws it alike; no number is NaN or infinite.

        Its names come from files of users, so the page must show them as plain text, not as HTML.
        """
        return {
            "version": VERSION,
            "storey": self.storey,
            "prisms": [prism.description() for prism in self.prisms],
            "cells": None if self.cells is None else self.cells.description(),
            "people": [figure.description() for figure in self.figures],
            "landmarks": [plate.description() for plate in self.plates],
            "zones": [area.description() for area in self.areas],
            "floor": [[ring.tolist() for ring in polygon] for polygon in self.floor],
            "surfaces": surfaces.description(),
            "notes": list(self.notes),
        }


def _prisms(world: World, storey: float) -> Iterator[Prism]:
    """Yield a prism for each obstacle, in order; they are numbered later."""
    for obstacle in world.obstacles:
        low, high = _ends(obstacle.heights, storey)
        is_wall = "wall" in obstacle.name.lower() if obstacle.name else high >= WALL_FROM
        tilted = obstacle.solid is not None and not obstacle.solid.is_upright
        colour = surfaces.WALL if is_wall else colour_of(obstacle.name or f"{obstacle.heights}")
        solid = obstacle.solid if tilted else None
        yield Prism(_rings(obstacle.polygon), low, high, 0, colour, is_wall, obstacle.name, solid)


def _border(world: World, storey: float) -> Iterator[Prism]:
    """Yield a wall round the extent, if the outside of the map is an obstacle."""
    if world.outside_is_obstacle:
        low, high = _ends((-math.inf, math.inf) if world.raster is None else world.raster.heights, storey)
        frame = shapely.buffer(world.extent, BORDER, join_style="mitre").difference(world.extent)
        for rings in _polygons(frame):
            yield Prism(rings, low, high, 0, surfaces.WALL, True, "border of the map")


def _ends(heights: tuple[float, float], storey: float) -> tuple[float, float]:
    """Return finite heights, m, of an obstacle.

    An unlimited lower end becomes the floor, or a storey below the upper end if that is lower. An unlimited upper end
    becomes a storey above the lower end or the floor, whichever is higher.
    """
    low = heights[0] if math.isfinite(heights[0]) else min(0.0, heights[1] - storey)
    high = heights[1] if math.isfinite(heights[1]) else max(low, 0.0) + storey
    return low, high


def colour_of(name: str) -> Colour:
    """Return an obstacle's colour by its name without digits at the ends, so "chair 1" and "chair 2" match."""
    name = name.strip(" _-0123456789") or name
    return surfaces.THINGS[zlib.crc32(name.encode("utf-8", "replace")) % len(surfaces.THINGS)]


SKIN, HAIR, TROUSERS = (224, 188, 160), (84, 64, 52), (70, 76, 92)
SHIRTS: tuple[Colour, ...] = ((176, 84, 72), (72, 120, 152), (108, 142, 84), (200, 158, 76), (128, 100, 150))


def _figure(person: Person, number: int) -> Figure:
    """Return the drawing of a person, 1.73 m tall. Its trunk has the radius from which robots keep their distance."""
    shirt = SHIRTS[number % len(SHIRTS)]
    parts = (
        BodyPart("cylinder", 0.55 * person.radius, 0.0, 0.92, TROUSERS, TROUSERS),
        BodyPart("ellipsoid", person.radius, 0.74, 1.50, shirt, shirt),
        BodyPart("ellipsoid", 0.10, 1.46, 1.73, SKIN, HAIR),
    )
    return Figure(person, number, parts)


PAPER: Colour = (248, 246, 240)


def _plate(mark: Landmark, number: int) -> Plate:
    """Return the plate that shows a landmark."""
    return Plate(_landmark_on_plate(mark), *PLATE, number, PAPER)


def _landmark_on_plate(mark: Landmark) -> Landmark:
    """Return a landmark moved to the position of its plate, which is slightly in front of it."""
    if mark.facing is None:
        return mark
    return replace(mark, x=mark.x + BEFORE * math.cos(mark.facing), y=mark.y + BEFORE * math.sin(mark.facing))


def _zones(world: World) -> Iterator[Zone]:
    """Yield the zones of a world, and its keep-out areas as zones."""
    yield from world.content.zones
    for part in shapely.get_parts(world.keep_out):
        if not part.is_empty:
            yield Zone("keep-out", part)


def _polygons(geometry: BaseGeometry) -> tuple[tuple[FloatArray, ...], ...]:
    """Return the polygons of a geometry, each as its rings; empty and other parts are left out."""
    parts = (part for part in shapely.get_parts(geometry) if part.geom_type == "Polygon" and not part.is_empty)
    return tuple(_rings(part) for part in parts)


def _rings(polygon: Any) -> tuple[FloatArray, ...]:
    """Return the open rings (K, 2), m, of a polygon: the outer one counter-clockwise, holes clockwise."""
    turned = shapely.orient_polygons(polygon)
    return tuple(shapely.get_coordinates(ring)[:-1, :2] for ring in (turned.exterior, *turned.interiors))


def _notes(world: World, storey: float) -> Iterator[str]:
    """Yield notes on shapes and people that are not drawn exactly."""
    unsure = sum(bool(person.futures) for person in world.content.people)
    if unsure:
        yield f"people with several hypotheses ({unsure}) are drawn at the positions of the likeliest one"
    endless = sum(math.isinf(obstacle.z_max) for obstacle in world.obstacles)
    if endless or (world.raster is not None and math.isinf(world.raster.z_max)):
        yield f"obstacles without an upper end are drawn {storey:g} m high"
    tilted = [o.name or "without a name" for o in world.obstacles if o.solid is not None and not o.solid.is_upright]
    if tilted:
        listed = ", ".join([*(printable(name)[:40] for name in tilted[:8]), *["..."] * (len(tilted) > 8)])
        are = "is" if len(tilted) == 1 else "are"
        yield f"pictures show upright prisms round {counted(len(tilted), 'solid')} that {are} not upright: {listed}"
    for mark in map(_landmark_on_plate, world.content.landmarks):
        inside = [
            o for o in world.obstacles if o.z_min < mark.z < o.z_max and o.polygon.covers(shapely.Point(mark.x, mark.y))
        ]
        if inside:
            name = printable(mark.name) or "without a name"
            yield f"landmark {name} is inside an obstacle, which hides it in this view"
