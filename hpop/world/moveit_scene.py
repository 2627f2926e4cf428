"""Reader for planning scenes in YAML, as MoveIt has them and MotionBenchMaker writes them.

Of ``moveit_msgs/PlanningScene`` the objects of the world are read: boxes, cylinders, spheres and convex meshes. Points
are lists ``[x, y, z]`` or keys ``{x: ..}``, quaternions x, y, z, w. The robot and its states belong to the model.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hpop import limits
from hpop.arrays import FloatArray
from hpop.errors import MapError
from hpop.limits import READING
from hpop.options import MOST, real, whole
from hpop.text import shown
from hpop.world.files import file_source, named, read_bytes, read_text, read_yaml
from hpop.world.solids import MOST_POINTS, MOST_SOLIDS, Box, Cylinder, Hull, Shape, Solid, Sphere, pose_at
from hpop.world.world import World

MOST_BYTES = 5_000_000
"""Largest scene, bytes: some seconds."""
PARSED = 60
"""Bytes for each of a file, of Python's objects while it is read."""
DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2}
NUMBERED = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
"""Types of primitives as ``shape_msgs/SolidPrimitive`` counts them."""
CONVEX = 1e-4
"""Share of its hull's volume that a convex mesh may lack: rounding in files. The hull is what counts."""


class Part(NamedTuple):
    """A piece of a file, and where it is in words."""

    what: str
    given: Any

    def fault(self, expected: str) -> MapError:
        """What was expected of it, and what came."""
        return MapError(f"{self.what} must be {expected}; got {shown(self.given)}.")

    def get(self, key: str) -> Part:
        """What stands under a key of a mapping; None where there is none."""
        if not isinstance(self.given, dict):
            raise self.fault("a yaml mapping")
        return Part(f"{self.what}: {key}", self.given.get(key))

    def entries(self, most: int = MOST_SOLIDS) -> list[Part]:
        """The entries of a list; none of what is not given."""
        given = [] if self.given is None else self.given
        if not isinstance(given, list):
            raise self.fault("a list")
        if len(given) > most:
            raise MapError(f"{self.what} has {len(given):,} entries; at most {most:,} are read.")
        return [Part(f"{self.what} {place}", entry) for place, entry in enumerate(given)]

    def numbers(self, keys: str) -> tuple[float, ...]:
        """Numbers in a list, or by the names of axes."""
        given = self.given
        if isinstance(given, dict) and given.keys() == set(keys):
            given = [given[key] for key in keys]
        if not isinstance(given, list) or len(given) != len(keys):
            raise self.fault(f"[{', '.join(keys)}]")
        return tuple(float(real(self.what, value, -MOST, MOST, error=MapError)) for value in given)


def read(path: str | Path) -> World:
    """Read the collision objects of a scene's world as solids; a shape is named by the id of its object.

    The extent is the bounding box of the solids and 1 m more on each side. There is no floor but what is an object.
    Whatever would be solid and is not read is refused: other shapes, meshes that are not convex or in other files,
    planes, octomaps, and objects attached to the robot.

    Raises
    ------
    MapError
        If the file is missing or no scene, or an object cannot be read; names the object.
    """
    content = read_bytes(path, "scene file", limit=MOST_BYTES)
    limits.hold(READING, len(content), PARSED * len(content))
    text = read_text(content, path, "scene file")
    scene = Part(named(path), read_yaml(text, path))
    world = scene.get("world")
    if not isinstance(world.given, dict) or "collision_objects" not in world.given:
        raise MapError(
            f"{named(path)} must be a planning scene, with world: {{collision_objects: [...]}}; got "
            f"{shown(scene.given)}."
        )
    _refuse_unread(scene)
    solids: list[Solid] = []
    frames: dict[str, str] = {}
    for place, entry in enumerate(world.get("collision_objects").entries()):
        limits.check(READING)
        name = entry.get("id").given
        if not isinstance(name, str) or not name:
            raise entry.get("id").fault("the name of an object")
        thing = Part(f"{named(path)}: object {shown(name)}", entry.given)
        if name in frames:
            raise MapError(f"{thing.what} is there twice, the second time as number {place}; give each its own id.")
        frames[name] = _frame(thing)
        solids += [Solid(shape, pose, name) for shape, pose in _shapes(thing)]
    _check_frames(path, frames)
    if not solids:
        raise MapError(f"{named(path)} has no collision object with a shape: nothing to make a world of.")
    return World.from_solids(solids).read_from(file_source("moveit_scene", path, {}, content))


def _refuse_unread(scene: Part) -> None:
    """Refuse what would be solid beside the objects of the world."""
    octomap = scene.get("world").get("octomap")
    if isinstance(octomap.given, dict):
        inside = octomap.get("octomap")
        tree = inside.given if isinstance(inside.given, dict) else octomap.given
        if tree.get("data"):
            raise MapError(f"{octomap.what} has cells, which are not read. Save the scene without, or give boxes.")
    state = scene.get("robot_state")
    if isinstance(state.given, dict) and (attached := state.get("attached_collision_objects")).given:
        raise MapError(f"{attached.what} are not read: give what the robot holds as a part of the robot.")


def _frame(thing: Part) -> str:
    """The frame in which an object is given."""
    header = thing.get("header")
    frame = None if header.given is None else header.get("frame_id").given
    if not isinstance(frame, str | None):
        raise thing.get("header").get("frame_id").fault("the name of a frame")
    operation = thing.get("operation")
    if operation.given not in (None, 0, "add", "ADD"):
        raise operation.fault("0, add: a scene says what is there, not what changes")
    return frame or ""


def _check_frames(path: str | Path, frames: dict[str, str]) -> None:
    """All objects are given in one frame, which is the world's."""
    known: dict[str, str] = {}
    for name, frame in frames.items():
        known.setdefault(frame, name)
    if len(known) > 1:
        (one, first), (other, second) = list(known.items())[:2]
        raise MapError(
            f"{named(path)}: object {shown(first)} is given in frame {shown(one)}, object {shown(second)} in frame "
            f"{shown(other)}. Give all objects in one."
        )


def _shapes(thing: Part) -> Iterator[tuple[Shape, FloatArray]]:
    """Shapes of an object with their poses in the world."""
    if thing.get("planes").given:
        raise MapError(
            f"{thing.get('planes').what} have no end and are not read; give a thin box in the place of each."
        )
    at = _pose(thing.get("pose"))
    for kind, make in (("primitive", _primitive), ("mesh", _mesh)):
        shapes = thing.get("meshes" if kind == "mesh" else "primitives").entries()
        poses = thing.get(f"{kind}_poses").entries()
        if poses and len(poses) != len(shapes):
            raise MapError(
                f"{thing.what} has {len(shapes)} {kind} shapes and {len(poses)} {kind}_poses; give one each."
            )
        for place, shape in enumerate(shapes):
            limits.check(READING)
            within = _pose(poses[place]) if poses else np.eye(4)
            yield make(shape), at @ within


def _pose(part: Part) -> FloatArray:
    """A pose, of ``position`` and ``orientation``; what is left out is none. A quaternion of zeros is one left out."""
    if part.given is None:
        return np.eye(4)
    position, orientation = part.get("position"), part.get("orientation")
    quaternion = None if orientation.given is None else orientation.numbers("xyzw")
    try:
        return pose_at(
            (0.0, 0.0, 0.0) if position.given is None else position.numbers("xyz"),
            quaternion=quaternion if quaternion and any(quaternion) else None,
        )
    except MapError as error:
        raise error if part.what in str(error) else MapError(f"{part.what}: {error}") from None


def _primitive(part: Part) -> Shape:
    given = part.get("type").given
    kind = NUMBERED.get(given) if type(given) is int else given
    if not isinstance(kind, str) or kind not in DIMENSIONS:
        raise part.get("type").fault(f"one of {', '.join(DIMENSIONS)}, or a convex mesh be given instead")
    sizes = part.get("dimensions")
    if not isinstance(sizes.given, list) or len(sizes.given) != DIMENSIONS[kind]:
        form = {"box": "[x, y, z]", "sphere": "[radius]", "cylinder": "[height, radius]"}[kind]
        raise sizes.fault(f"{form} in m, of a {kind}")
    try:
        match kind:
            case "box":
                return Box(tuple(sizes.given))
            case "sphere":
                return Sphere(sizes.given[0])
        return Cylinder(radius=sizes.given[1], length=sizes.given[0])
    except MapError as error:
        raise MapError(f"{sizes.what}: {error}") from None


def _mesh(part: Part) -> Hull:
    """The hull of a mesh, which is convex: all its corners lie on it."""
    if part.get("resource").given is not None:
        raise part.get("resource").fault("left out, and the mesh's vertices and triangles be given: no file is read")
    vertices = np.array([v.numbers("xyz") for v in part.get("vertices").entries(MOST_POINTS)]).reshape(-1, 3)
    triangles = [_triangle(t, len(vertices)) for t in part.get("triangles").entries(2 * MOST_POINTS)]
    corners = vertices[np.array(triangles, dtype=np.int64).reshape(-1, 3)]
    try:
        hull = Hull(np.unique(corners.reshape(-1, 3), axis=0))
    except MapError as error:
        raise MapError(f"{part.what}: {error}") from None
    if not _is_convex(hull, corners):
        raise MapError(
            f"{part.what} is not convex, or its triangles are no closed surface that turns one way. Give its convex "
            "pieces as meshes of their own."
        )
    return hull


def _triangle(part: Part, count: int) -> list[int]:
    """Three places of vertices."""
    inner = part.get("vertex_indices") if isinstance(part.given, dict) else part
    if not isinstance(inner.given, list) or len(inner.given) != 3:
        raise inner.fault("three places of vertices")
    return [whole(inner.what, place, 0, count - 1, "a place of a vertex", error=MapError) for place in inner.given]


def _is_convex(hull: Hull, corners: FloatArray) -> bool:
    """Whether triangles (F, 3, 3) hold as much as their hull does: a closed surface, all turned the same way."""
    a, b, c = (corners - hull.points.mean(axis=0)).transpose(1, 0, 2)
    held = abs(float(np.einsum("ij,ij->", np.cross(a, b), c))) / 6
    return held >= (1 - CONVEX) * hull.volume
