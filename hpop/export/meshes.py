"""A scene as triangles: prisms with their holes, cells, people, landmarks, zones and the floor.

Metres in the world's frame, z up. Corners are not shared between faces, so that each face has its normal; triangles
are counter-clockwise seen from outside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely

from hpop.base.arrays import FloatArray
from hpop.base.text import printable

if TYPE_CHECKING:
    from hpop.view.ride.scene import Cells, Part, Plate, Scene
    from hpop.world.content.people import Person

Colour = tuple[int, int, int]
ROUND = 16  # sides of what is round
ABOVE = 0.004  # m: zones lie on the floor


class Mesh(NamedTuple):
    """Triangles of one colour.

    corners  (T, 3, 3)  m
    normals  (T, 3)     unit
    colour              red, green, blue in sRGB, 0 to 255
    person              who it is a part of, without futures; the corners are where the person is at time 0
    """

    name: str
    corners: FloatArray
    normals: FloatArray
    colour: Colour
    person: Person | None = None


def meshes_of(scene: Scene) -> Iterator[Mesh]:
    """What there is to see, piece by piece; empty ones are left out."""
    from hpop.view.ride import surfaces

    flat = [_flat(rings, 0.0) for rings in scene.floor]
    yield from _mesh("floor", flat, surfaces.FLOOR)
    for area in scene.areas:
        yield from _mesh(f"zone {area.zone.name}", [_flat(rings, ABOVE) for rings in area.polygons], area.colour)
    for prism in scene.prisms:
        yield from _mesh(prism.name or "obstacle", [extruded(prism.rings, prism.low, prism.high)], prism.colour)
    if scene.cells is not None:
        yield from _mesh("cells", [_boxes(scene.cells)], scene.cells.colour)
    for figure in scene.figures:
        for weight, person in figure.person.hypotheses:
            called = f"person {person.name}" + f" ({weight:.0%})" * bool(figure.person.futures)
            for i, part in enumerate(figure.parts):
                name = called if i == 0 else f"{called} {i}"
                for mesh in _mesh(name, [_round(part, person.x, person.y)], part.colour):
                    yield mesh._replace(person=person)
    for plate in scene.plates:
        yield from _mesh(f"landmark {plate.landmark.name}", [_plate(plate)], plate.colour)


def extruded(rings: Sequence[FloatArray], low: float, high: float) -> FloatArray:
    """Triangles (T, 3, 3) of an upright prism: outer ring counter-clockwise, holes clockwise, none closed."""
    top = _flat(rings, high)
    bottom = _flat(rings, low)[:, ::-1]
    sides = [_walls(ring[None], low, high) for ring in rings]
    return np.concatenate([top, bottom, *sides])


def _flat(rings: Sequence[FloatArray], z: float) -> FloatArray:
    """Triangles (T, 3, 3) of a polygon that lies level, seen from above."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:])))
    rounds = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    ahead, aside = rounds[:, 1] - rounds[:, 0], rounds[:, 2] - rounds[:, 0]
    clockwise = ahead[:, 0] * aside[:, 1] < ahead[:, 1] * aside[:, 0]
    rounds[clockwise] = rounds[clockwise][:, ::-1]
    return np.dstack([rounds, np.full(rounds.shape[:2], z)])


def _walls(rings: FloatArray, low: float, high: float) -> FloatArray:
    """Triangles (2 B K, 3, 3) of the sides above rings (B, K, 2), seen from their right."""
    a = rings.reshape(-1, 2)
    b = np.roll(rings, -1, axis=1).reshape(-1, 2)
    corners = [np.column_stack([place, np.full(len(a), z)]) for place, z in ((a, low), (b, low), (b, high), (a, high))]
    quads = np.stack(corners, axis=1)  # (B K, 4, 3)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _boxes(cells: Cells) -> FloatArray:
    """Triangles of boxes: walls and tops, with bottoms that are seen from a camera below."""
    rings = cells.corners
    level = [np.dstack([rings, np.full(rings.shape[:2], z)]) for z in (cells.low, cells.high)]
    bottom, top = level[0][:, ::-1], level[1]
    faces = [quads[:, order] for quads in (bottom, top) for order in ([0, 1, 2], [0, 2, 3])]
    return np.concatenate([*faces, _walls(rings, cells.low, cells.high)])


def _round(part: Part, x: float, y: float) -> FloatArray:
    """Triangles of a cylinder or an ellipsoid round the vertical through (x, y)."""
    angles = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    if part.shape == "cylinder":
        return extruded([circle * part.radius + (x, y)], part.low, part.high)
    middle, half = 0.5 * (part.low + part.high), 0.5 * (part.high - part.low)
    lifts = np.linspace(-0.5 * np.pi, 0.5 * np.pi, ROUND // 2 + 1)
    places = np.stack(
        [np.column_stack([circle * part.radius * np.cos(lift) + (x, y), np.full(ROUND, middle + half * np.sin(lift))])
         for lift in lifts]
    )  # fmt: skip
    a, b = places[:-1], places[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    triangles = np.concatenate([np.stack([a, d, c], axis=2), np.stack([a, c, b], axis=2)]).reshape(-1, 3, 3)
    return triangles[_areas(triangles) > 0.0]  # at the poles some are lines


def _plate(plate: Plate) -> FloatArray:
    """Triangles of an upright plate, both sides; of one without a facing two plates across each other."""
    mark = plate.landmark
    facings = [mark.facing] if mark.facing is not None else [0.0, 0.5 * np.pi]
    several = []
    for facing in facings:
        aside = 0.5 * plate.width * np.array([-np.sin(facing), np.cos(facing)])
        place = np.array([mark.x, mark.y])
        line = np.array([place - aside, place + aside])
        one = _walls(line[None], mark.z - 0.5 * plate.height, mark.z + 0.5 * plate.height)  # there and back
        several.append(one)
    return np.concatenate(several)


def _mesh(name: str, parts: Sequence[FloatArray], colour: Colour) -> Iterator[Mesh]:
    """A mesh of triangles that have an area."""
    corners = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
    areas = _areas(corners)
    corners = corners[areas > 0.0]
    if len(corners):
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        yield Mesh(printable(name).strip(), corners, normals, colour)


def _areas(corners: FloatArray) -> FloatArray:
    """Areas (T,) of triangles, m²."""
    found: FloatArray = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return 0.5 * found
