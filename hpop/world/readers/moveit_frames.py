"""Shapes of objects in planning scenes, and their frames: the world, links of the robot, and others.

A reader knows no robot, so it keeps the frame of each object. A problem, or the collision test of an arm, places the
objects by the links of its robot.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real, whole
from hpop.base.text import shown
from hpop.errors import MapError, did_you_mean
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.bodies import LinkRules
from hpop.world.geometry.solids import MOST_POINTS, Box, Cylinder, Hull, Shape, Sphere, pose_at
from hpop.world.readers.moveit_parts import (
    MOST_NAMES,
    SceneEntry,
)

if TYPE_CHECKING:
    from hpop.motions import Model
    from hpop.world.world import World

DIMENSIONS = {"box": 3, "sphere": 1, "cylinder": 2}
NUMBERED = {1: "box", 2: "sphere", 3: "cylinder", 4: "cone"}
"""Names of primitives by their number in ``shape_msgs/SolidPrimitive``."""
CONVEX = 1e-4
"""Largest difference between a convex mesh and its hull, by rounding in files, as a share of the hull's volume."""

WORLD_FRAMES = ("", "world")
"""Names of frames that are the frame of the world."""


def joint_values(state: SceneEntry) -> dict[str, float]:
    """Return the values, rad or m, of the joints in the state of a robot; MapError for a malformed state."""
    if state.given is None or state.get("joint_state").given is None:
        return {}
    given = state.get("joint_state")
    names = [part.name("a joint") for part in given.get("name").entries(MOST_NAMES)]
    values = given.get("position").entries(MOST_NAMES)
    if len(names) != len(values):
        raise MapError(f"{given.what} must have a position for each name; got {len(values)} for {len(names)} names.")
    read = (float(real(each.what, each.given, -MOST, MOST, error=MapError)) for each in values)
    return dict(zip(names, read, strict=True))


def frame_notes(rules: LinkRules) -> Iterator[str]:
    """Yield a note on objects that are not given in the frame of the world, and that no robot has placed there yet."""
    if others := {frame: name for name, frame in rules.frames.items() if frame not in WORLD_FRAMES}:
        frame, name = next(iter(others.items()))
        yield (
            f"the scene gives objects in other frames than the world, such as {shown(name)} in {shown(frame)}: a "
            "problem places them by the links of its robot; until then, their poses are taken as in the world"
        )


def placed_scene(world: World, model: Model) -> World:
    """Return a world in which the objects that a planning scene gives in frames of links are placed in the world.

    MoveIt does so too: an object stands where the frame is in the scene's state of the robot. A single other frame
    counts as the world's, with a note unless it is called "world". A world that is placed already is returned as it is.

    Raises MapError for an object in the frame of a link that moves, unless the scene says by joint values where it was,
    and for objects in several frames that are unknown.
    """
    rules = world.link_rules
    if not rules.frames:
        return world
    notes = [note for note in world.notes if note not in set(frame_notes(rules))]
    poses: dict[str, FloatArray] = {}
    strange: dict[str, str] = {}
    for name, frame in rules.frames.items():
        if frame in poses or frame in strange:
            continue
        if frame in WORLD_FRAMES or frame not in model.links:
            strange[frame] = name
            continue
        pose, still = model.link_pose(frame, rules.joints), model.link_pose(frame, {})
        if pose is None:
            raise MapError(
                f"the scene must give objects in the frame of the world or of a link that stands still, but gives "
                f"{shown(name)} in the frame of the link {shown(frame)}, which moves. If the robot holds it, attach it "
                "to the link (attached_collision_objects, or the option attached of the arm); else give its pose in "
                "the world, or save the scene with one robot_state that has all joints of the robot."
            )
        if still is None or not np.allclose(still, pose, atol=1e-9):
            notes.append(
                f"the scene gives {shown(name)} in the frame of the link {shown(frame)}: it stands where this link is "
                "in the scene's robot_state"
            )
        poses[frame] = pose
    if len(strange) > 1:
        (frame, first), (other, second) = list(strange.items())[:2]
        raise MapError(
            f"the scene gives the object {shown(first)} in frame {shown(frame)}, the object {shown(second)} in frame "
            f"{shown(other)}, and neither is a link of the robot. Give all objects in one frame, or give one frame in "
            "the other by fixed_frame_transforms."
            + (did_you_mean(frame, model.links) or did_you_mean(other, model.links))
        )
    for frame in set(strange).difference(WORLD_FRAMES):
        notes.append(
            f"the scene gives objects in the frame {shown(frame)}, which neither the robot nor fixed_frame_transforms "
            f"know; it is taken as the frame of the world.{did_you_mean(frame, model.links)}"
        )
    return world.derived(
        ("placed", *((frame, pose.tobytes()) for frame, pose in poses.items()), *notes),
        lambda: _in_one_frame(world, poses, notes),
    )


def _in_one_frame(world: World, poses: Mapping[str, FloatArray], notes: Iterable[str]) -> World:
    """Return a world with its solids in its own frame, given the poses (4, 4) in the world of other frames."""
    rules, ground = world.link_rules, world.ground
    if not all(np.array_equal(pose, np.eye(4)) for pose in poses.values()):
        within = [poses.get(rules.frames.get(solid.name, ""), np.eye(4)) for solid in ground.solids]
        solids = tuple(
            replace(solid, pose=pose @ solid.pose) for solid, pose in zip(ground.solids, within, strict=True)
        )
        prisms = tuple(prism for prism in ground.obstacles if prism.solid is None)
        ground = replace(ground, obstacles=prisms, solids=solids, extent=type(world).from_solids(solids).extent)
    placed = replace(world, ground=ground, notes=tuple(notes), link_rules=replace(rules, frames={}, joints={}))
    return placed if world.source is None else placed.read_from(world.source)


def read_shapes(thing: SceneEntry) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield each shape of an object with its pose (4, 4) in the object."""
    if thing.get("planes").given:
        raise MapError(f"{thing.get('planes').what} are infinite, and are not read; replace each by a thin box.")
    for kind, make in (("primitive", _primitive), ("mesh", _mesh)):
        shapes = thing.get("meshes" if kind == "mesh" else "primitives").entries()
        poses = thing.get(f"{kind}_poses").entries()
        if poses and len(poses) != len(shapes):
            raise MapError(
                f"{thing.what} has {len(shapes)} {kind} shapes and {len(poses)} {kind}_poses; give one each."
            )
        for place, shape in enumerate(shapes):
            limits.check(READING)
            within = shape_pose(poses[place]) if poses else np.eye(4)
            yield make(shape), within


def shape_pose(part: SceneEntry, place: str = "position", turned: str = "orientation") -> FloatArray:
    """Return a pose (4, 4) from position and orientation; a missing part or zero quaternion counts as the identity."""
    if part.given is None:
        return np.eye(4)
    position, orientation = part.get(place), part.get(turned)
    quaternion = None if orientation.given is None else orientation.numbers("xyzw")
    try:
        return pose_at(
            (0.0, 0.0, 0.0) if position.given is None else position.numbers("xyz"),
            quaternion=quaternion if quaternion and any(quaternion) else None,
        )
    except MapError as error:
        raise error if part.what in str(error) else MapError(f"{part.what}: {error}") from None


def _primitive(part: SceneEntry) -> Shape:
    given = part.get("type").given
    kind = NUMBERED.get(given) if type(given) is int else given
    if not isinstance(kind, str) or kind not in DIMENSIONS:
        raise part.get("type").fault(f"one of {', '.join(DIMENSIONS)} (give other shapes as convex meshes)")
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


def _mesh(part: SceneEntry) -> Hull:
    """Return a convex mesh as a hull; MapError if it is not convex."""
    if part.get("resource").given is not None:
        raise part.get("resource").fault("left out, as no mesh file is read: give vertices and triangles instead")
    vertices = np.array([v.numbers("xyz") for v in part.get("vertices").entries(MOST_POINTS)]).reshape(-1, 3)
    triangles = [_triangle(t, len(vertices)) for t in part.get("triangles").entries(2 * MOST_POINTS)]
    corners = vertices[np.array(triangles, dtype=np.int64).reshape(-1, 3)]
    try:
        hull = Hull(np.unique(corners.reshape(-1, 3), axis=0))
    except MapError as error:
        raise MapError(f"{part.what}: {error}") from None
    if not _is_convex(hull, corners):
        raise MapError(
            f"{part.what} is not convex, or its triangles are no closed and consistently oriented surface. Give its "
            "convex pieces as meshes of their own."
        )
    return hull


def _triangle(part: SceneEntry, count: int) -> list[int]:
    """Return the indices of the three vertices of a triangle."""
    inner = part.get("vertex_indices") if isinstance(part.given, dict) else part
    if not isinstance(inner.given, list) or len(inner.given) != 3:
        raise inner.fault("the indices of three vertices")
    return [whole(inner.what, vertex, 0, count - 1, "the index of a vertex", error=MapError) for vertex in inner.given]


def _is_convex(hull: Hull, corners: FloatArray) -> bool:
    """Return whether triangles (F, 3, 3), if closed and equally oriented, enclose the volume of their convex hull."""
    a, b, c = (corners - hull.points.mean(axis=0)).transpose(1, 0, 2)
    volume = abs(float(np.einsum("ij,ij->", np.cross(a, b), c))) / 6
    return volume >= (1 - CONVEX) * hull.volume
