"""Export format glb: the world and an animated camera as binary glTF.

The world consists of triangles: prisms with their holes, cells, people, landmarks, zones and the floor. They are in
metres in the frame of the world, z up. Faces do not share corners, so that each face has its own normal; triangles are
counter-clockwise as seen from outside.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.export.base import PROGRAM, Exported, export_format, product

if TYPE_CHECKING:
    from hpop.view.ride.scene import BodyPart, Cells, Plate, ViewScene
    from hpop.world.content.people import Person

Colour = tuple[int, int, int]
ROUND = 16  # sides of cylinders
ABOVE = 0.004  # m: height at which zones are drawn above the floor, so that they are visible


class TriangleMesh(NamedTuple):
    """Mesh of triangles that have the same colour.

    corners  (T, 3, 3)  m
    normals  (T, 3)     unit vectors
    colour              red, green, blue in sRGB, 0 to 255
    person              one hypothesis of the person that the mesh shows, at its position at time 0; or None
    """

    name: str
    corners: FloatArray
    normals: FloatArray
    colour: Colour
    person: Person | None = None


def meshes_of(scene: ViewScene) -> Iterator[TriangleMesh]:
    """Yield the meshes of all things in a scene, leaving out empty ones."""
    from hpop.view.ride import surfaces  # hpop.view imports Matplotlib

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
    """Return the triangles (T, 3, 3) of an upright prism, between two heights.

    rings : outline and holes of its base (K, 2), not closed: the outline counter-clockwise, holes clockwise
    """
    top = _flat(rings, high)
    bottom = _flat(rings, low)[:, ::-1]
    sides = [_walls(ring[None], low, high) for ring in rings]
    return np.concatenate([top, bottom, *sides])


def _flat(rings: Sequence[FloatArray], z: float) -> FloatArray:
    """Return the triangles (T, 3, 3) of a horizontal polygon at a height, facing up."""
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(rings[0], rings[1:])))
    rounds = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3]
    ahead, aside = rounds[:, 1] - rounds[:, 0], rounds[:, 2] - rounds[:, 0]
    clockwise = ahead[:, 0] * aside[:, 1] < ahead[:, 1] * aside[:, 0]
    rounds[clockwise] = rounds[clockwise][:, ::-1]
    return np.dstack([rounds, np.full(rounds.shape[:2], z)])


def _walls(rings: FloatArray, low: float, high: float) -> FloatArray:
    """Return the triangles (2 B K, 3, 3) of vertical walls along the edges of rings (B, K, 2), between two heights.

    A wall faces to the right of its edge.
    """
    a = rings.reshape(-1, 2)
    b = np.roll(rings, -1, axis=1).reshape(-1, 2)
    corners = [np.column_stack([place, np.full(len(a), z)]) for place, z in ((a, low), (b, low), (b, high), (a, high))]
    quads = np.stack(corners, axis=1)  # (B K, 4, 3)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _boxes(cells: Cells) -> FloatArray:
    """Return the triangles (T, 3, 3), m, of upright boxes over the occupied cells of a raster map."""
    rings = cells.corners
    level = [np.dstack([rings, np.full(rings.shape[:2], z)]) for z in (cells.low, cells.high)]
    bottom, top = level[0][:, ::-1], level[1]
    faces = [quads[:, order] for quads in (bottom, top) for order in ([0, 1, 2], [0, 2, 3])]
    return np.concatenate([*faces, _walls(rings, cells.low, cells.high)])


def _round(part: BodyPart, x: float, y: float) -> FloatArray:
    """Return the triangles of a person's body part, a cylinder or an ellipsoid round the vertical through (x, y)."""
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
    """Return the triangles (T, 3, 3), m, of a landmark's upright plate; without a facing, of two crossed."""
    mark = plate.landmark
    facings = [mark.facing] if mark.facing is not None else [0.0, 0.5 * np.pi]
    several = []
    for facing in facings:
        aside = 0.5 * plate.width * np.array([-np.sin(facing), np.cos(facing)])
        place = np.array([mark.x, mark.y])
        line = np.array([place - aside, place + aside])
        sides = _walls(line[None], mark.z - 0.5 * plate.height, mark.z + 0.5 * plate.height)  # there and back
        several.append(sides)
    return np.concatenate(several)


def _mesh(name: str, parts: Sequence[FloatArray], colour: Colour) -> Iterator[TriangleMesh]:
    """Yield one mesh of all triangles that have an area; yield nothing if there are none."""
    corners = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
    areas = _areas(corners)
    corners = corners[areas > 0.0]
    if len(corners):
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        yield TriangleMesh(printable(name).strip(), corners, normals, colour)


def _areas(corners: FloatArray) -> FloatArray:
    """Return the areas (T,) of triangles, m²."""
    found: FloatArray = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return 0.5 * found


AXES = (
    "right-handed, x right, y up, z towards the viewer (glTF), m; the world's (x, y, z) is (x, z, -y); "
    "rotations x, y, z, w; the camera looks along its -z, its y is up; times in s from the start, float32"
)
FLOAT, WHOLE = 5126, 5125  # float32 and uint32, as glTF counts them
VERTICES, INDICES = 34962, 34963
SEEN = (math.radians(90.0), math.radians(60.0))  # field of view in a viewer, for an all-round camera
NEAR = 0.05  # m
Y_UP = np.array([-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])  # quaternion that turns z up into y up
OUT_OF_CAMERA = np.array([0.5, -0.5, -0.5, 0.5])  # axes of a glTF camera (right, up, back) in those of a body


@export_format("glb", suffix=".glb", axes=AXES, world=True)
def glb(given: Exported) -> bytes:
    """Return the world and an animated camera as binary glTF 2.0, for Blender, three.js and other viewers.

    Axes are right-handed with y up, in m: a point (x, y, z) of the world becomes (x, z, -y).

    - Camera: the node ``camera_link`` has the poses as translation and rotation (quaternion x, y, z, w). Between two
      poses they are interpolated. The camera in this node looks along -z. If a body other than the camera is exported,
      the node has that body's frame (x ahead, y left, z up) and no camera.
    - Times are float32 seconds from the start, and always increase. Of several poses with equal float32 times, only
      the last is kept.
    - Obstacles are prisms. Walls without an upper end are a storey high.
    - People: each predicted future of a walking person is an animated node, named with the weight of this future.
      Its size is 0 while the person is absent.
    - Costs, visits of a tour's stops, and notes on inexact shapes are in ``asset.extras``.
    """
    file = _File()
    seen, body = given.poses, given.frames.of(given.body)
    times = seen.times.astype(np.float32)
    last = np.append(np.diff(times) > 0.0, True)
    turned = np.tile(Y_UP, (len(seen), 1))
    rotations = product(turned, seen.quaternions)
    is_camera = given.body == "camera"
    if is_camera:
        rotations = product(rotations, np.tile(OUT_OF_CAMERA, (len(seen), 1)))
    places, rotations = y_up(seen.positions)[last], rotations[last]
    node: dict[str, Any] = {"name": body, "translation": places[0].tolist(), "rotation": rotations[0].tolist()}
    if is_camera:
        node["camera"] = 0
        file.document["cameras"] = [_camera(given)]
    file.document["nodes"].append(node)
    clock = file.accessor(times[last][:, None], "SCALAR", bounds=True)
    file.animate(0, clock, "translation", file.accessor(places, "VEC3"))
    file.animate(0, clock, "rotation", file.accessor(rotations, "VEC4"))
    notes: list[str] = []
    if given.problem is not None:
        from hpop.view.ride.scene import ViewScene  # hpop.view imports Matplotlib

        scene = ViewScene.of(given.problem)
        notes = list(scene.notes)
        _add(file, list(meshes_of(scene)), float(times[-1]))
    file.document["animations"][0]["name"] = given.title
    extras = {
        "statement": given.statement(AXES),
        "costs": dict(given.costs),
        "units": dict(given.units),
        "notes": notes,
        **({"visits": given.told_visits} if given.visits else {}),
    }
    file.document["asset"] = {"version": "2.0", "generator": PROGRAM, "extras": extras}
    file.document["scenes"] = [{"name": given.title, "nodes": list(range(len(file.document["nodes"])))}]
    return file.written()


def y_up(vectors: FloatArray) -> FloatArray:
    """Convert points and directions (..., 3) from the frame of the world, z up, to that of glTF, y up."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([x, z, -y], axis=-1) + 0.0  # no -0.0


def linear(colour: tuple[int, int, int]) -> list[float]:
    """Convert an sRGB colour, 0 to 255, to linear red, green and blue from 0 to 1, with an alpha of 1, as in glTF."""
    stored = np.array(colour) / 255.0
    light = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    return [*np.round(light, 6).tolist(), 1.0]


def _camera(given: Exported) -> dict[str, Any]:
    """Return the glTF description of the camera, with its field of view, at most 170 degrees.

    A camera that sees all round gets 90 by 60 degrees.
    """
    across, upwards = given.trajectory.model.field_of_view or SEEN
    across, upwards = (min(angle, math.radians(170.0)) for angle in (across, upwards))
    ratio = math.tan(0.5 * across) / math.tan(0.5 * upwards)
    perspective = {"yfov": upwards, "znear": NEAR, "aspectRatio": ratio}
    return {"name": given.frames.camera, "type": "perspective", "perspective": perspective}


def _add(file: _File, meshes: list[TriangleMesh], lasts: float) -> None:
    """Add meshes to a glTF file, each as a node; nodes of people who move are animated for ``lasts`` s."""
    document, colours = file.document, dict[tuple[int, int, int], int]()
    document["meshes"], document["materials"] = [], []
    for mesh in meshes:
        if mesh.colour not in colours:
            colours[mesh.colour] = len(document["materials"])
            look = {"baseColorFactor": linear(mesh.colour), "metallicFactor": 0.0, "roughnessFactor": 0.9}
            document["materials"].append({"pbrMetallicRoughness": look})
        corners = y_up(mesh.corners).reshape(-1, 3)
        attributes = {
            "POSITION": file.accessor(corners, "VEC3", target=VERTICES, bounds=True),
            "NORMAL": file.accessor(np.repeat(y_up(mesh.normals), 3, axis=0), "VEC3", target=VERTICES),
        }
        primitive = {"attributes": attributes, "material": colours[mesh.colour]}
        document["nodes"].append({"name": mesh.name, "mesh": len(document["meshes"])})
        document["meshes"].append({"name": mesh.name, "primitives": [primitive]})
        if mesh.person is not None and mesh.person.moves and lasts > 0.0:
            _walk(file, len(document["nodes"]) - 1, mesh.person, lasts)
    for empty in [key for key in ("meshes", "materials") if not document[key]]:
        del document[empty]


def _walk(file: _File, node: int, person: Person, lasts: float) -> None:
    """Animate a node along the predicted path of a person, for ``lasts`` s; its size is 0 while the person is away."""
    times = [0.0, lasts, *([] if person.until is None else [person.until])]
    if person.track is not None:
        times += person.track.times.tolist()
    moments = np.unique(np.clip(times, 0.0, lasts))
    keys = moments.astype(np.float32)
    last = np.append(np.diff(keys) > 0.0, True)
    keys, moments = keys[last], moments[last]  # exact times, since a person may leave at one
    x, y = (np.broadcast_to(column, keys.shape) for column in person.at(moments))
    way = np.stack([x - person.x, y - person.y, np.zeros(keys.size)], axis=1)
    clock = file.accessor(keys[:, None], "SCALAR", bounds=True)
    if way.any():
        file.animate(node, clock, "translation", file.accessor(y_up(way), "VEC3"))
    there = np.broadcast_to(np.asarray(person.there(moments), float), keys.shape)
    if not there.all():
        sizes = file.accessor(np.repeat(there[:, None], 3, axis=1), "VEC3")
        file.animate(node, clock, "scale", sizes, interpolation="STEP")


class _File:
    """Binary glTF file under construction: its JSON document, and the numbers in its buffer."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {},
            "scene": 0,
            "scenes": [],
            "nodes": [],
            "accessors": [],
            "bufferViews": [],
            "animations": [{"channels": [], "samplers": []}],
        }
        self._buffer = bytearray()

    def accessor(self, values: NDArray[Any], kind: str, *, target: int | None = None, bounds: bool = False) -> int:
        """Add rows (N, k) to the buffer as float32, and return the index of their glTF accessor.

        kind    glTF type of a row, such as "VEC3"
        target  glTF number of the use as vertices or indices; None for keyframes
        bounds  whether the accessor states the smallest and the largest value of each column
        """
        numbers = np.ascontiguousarray(values, dtype="<f4")
        view: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._buffer), "byteLength": numbers.nbytes}
        if target is not None:
            view["target"] = target
        self._buffer += numbers.tobytes()
        self.document["bufferViews"].append(view)
        made: dict[str, Any] = {
            "bufferView": len(self.document["bufferViews"]) - 1,
            "componentType": FLOAT,
            "count": len(numbers),
            "type": kind,
        }
        if bounds:
            made |= {"min": numbers.min(axis=0).tolist(), "max": numbers.max(axis=0).tolist()}
        self.document["accessors"].append(made)
        return len(self.document["accessors"]) - 1

    def animate(self, node: int, times: int, path: str, values: int, *, interpolation: str = "LINEAR") -> None:
        """Animate a property of a node (``path``, such as "translation").

        ``times`` and ``values`` are indices of accessors.
        """
        (animation,) = self.document["animations"]
        animation["channels"].append({"sampler": len(animation["samplers"]), "target": {"node": node, "path": path}})
        animation["samplers"].append({"input": times, "output": values, "interpolation": interpolation})

    def written(self) -> bytes:
        """Return the bytes of the file: header, JSON chunk and binary chunk, each padded to four bytes."""
        self.document["buffers"] = [{"byteLength": len(self._buffer)}]
        text = json.dumps(self.document, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(self._buffer), b"BIN\0") + bytes(self._buffer)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
