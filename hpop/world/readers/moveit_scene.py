"""Reader for planning scenes in YAML, as MoveIt and MotionBenchMaker write them, and in MoveIt's text format.

It reads the collision objects of ``moveit_msgs/PlanningScene``: boxes, cylinders, spheres and convex meshes. Points are
lists ``[x, y, z]`` or mappings ``{x: ..}``; quaternions are x, y, z, w. The output of ``ros2 topic echo`` may hold
several messages, and prints a byte as a character. Also read are the rules for links: padding, scale, and the allowed
collision matrix, and objects attached to links. The joint values of the robot are not read; a note says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import counted, shown
from hpop.errors import MapError, did_you_mean
from hpop.runtime import limits
from hpop.runtime.limits import READING
from hpop.world.bodies import LinkRules
from hpop.world.files import file_source, named, read_bytes, read_text, read_yaml_documents
from hpop.world.geometry.solids import Shape, Solid
from hpop.world.readers.moveit_frames import (
    WORLD_FRAMES,
    frame_notes,
    joint_values,
    read_shapes,
    shape_pose,
)
from hpop.world.readers.moveit_parts import (
    SceneEntry,
    attached_objects,
    is_scene_text,
    link_rules,
    rule_notes,
    scene_of_text,
)
from hpop.world.world import World

MOST_BYTES = 5_000_000
"""Size of the largest scene file, bytes: some seconds of reading."""
PARSED = 60
"""Memory of Python objects per byte of a file while it is read, bytes."""
ADD, REMOVE, APPEND, MOVE = range(4)
"""Operations of ``moveit_msgs/CollisionObject``."""
WORDS = ("add", "remove", "append", "move")
OPERATIONS: dict[Any, int] = {None: ADD} | {
    name: code for code, word in enumerate(WORDS) for name in (code, chr(code), word, word.upper())
}
SHAPES = ("primitives", "primitive_poses", "meshes", "mesh_poses", "planes", "plane_poses")
READ = frozenset({"id", "header", "operation", "pose", *SHAPES})
LABELS = frozenset({"type", "subframe_names", "subframe_poses"})
"""Keys of an object that are ignored, since they describe no solid part."""
NOTED = ("robot_state", "allowed_collision_matrix", "link_padding", "link_scale", "object_colors")
SCENE = frozenset({"name", "robot_model_name", "is_diff", "world", "fixed_frame_transforms", *NOTED})
WITHIN = (
    "header seq stamp sec nanosec secs nsecs frame_id child_frame_id transform translation rotation position "
    "orientation x y z w r g b a dimensions polygon points resource vertices triangles vertex_indices coef "
    "collision_objects octomap origin binary resolution data joint_state velocity effort multi_dof_joint_state "
    "joint_names transforms twist wrench linear angular force torque attached_collision_objects link_name object "
    "touch_links detach_posture weight positions velocities accelerations time_from_start entry_names "
    "entry_values enabled default_entry_names default_entry_values padding scale color key db"
)
"""Keys of the parts of a scene in ``moveit_msgs/PlanningScene``; some of them are of no use for planning."""
NUMBERS = ("vertices", "triangles", "data")
"""Keys of long lists of numbers."""


class Object(NamedTuple):
    """Collision object of a scene.

    frame   name of the frame in which the pose is stated
    pose    (4, 4) of the object in this frame
    shapes  shapes, each with its pose (4, 4) in the object
    """

    frame: str
    pose: FloatArray
    shapes: list[tuple[Shape, FloatArray]]


def read(path: str | Path) -> World:
    """Read the collision objects of a scene's world as solids, each named by the id of its object.

    The extent is the bounding box of the solids, 1 m larger on each side. There is no floor unless it is an object. If
    the file has several messages, changes (``is_diff``) are applied to the last whole scene before them.
    Rules for links are applied by arms with links of these names (`World.link_rules`): ``link_padding``,
    ``link_scale``, ``allowed_collision_matrix``, and ``attached_collision_objects``, which become parts of the arm.
    ``world.notes`` list these rules, and ignored parts: joint values and pose of the robot as a start, colours,
    subframes, unknown keys. A problem, which has the robot, places objects in the frame of a link in the world.
    Solid parts that cannot be read are refused: other shapes, meshes that are not convex or in other files, planes,
    octomaps.

    Raises
    ------
    MapError
        If the file is missing or no scene, or an object cannot be read; the message names the object.
    """
    content = read_bytes(path, "scene file", limit=MOST_BYTES)
    limits.hold(READING, len(content), PARSED * len(content))
    text = read_text(content, path, "scene file")
    documents = [scene_of_text(text, named(path))] if is_scene_text(text) else read_yaml_documents(text, path)
    several = len(documents) > 1
    objects: dict[str, Object] = {}
    notes: list[str] = []
    rules = LinkRules()
    states: list[dict[str, float]] = []
    for place, given in enumerate(documents or [None]):
        scene = SceneEntry(f"{named(path)}, message {place}" if several else named(path), given)
        is_diff = scene.get("is_diff").given is True
        if is_diff and not place:
            raise MapError(
                f"{scene.what} must be a whole scene, but is a change of one (is_diff: true), so that what was there "
                "before is unknown. Save the whole scene: ros2 topic echo --once --full-length "
                "/monitored_planning_scene, or the service /get_planning_scene with components: 1023."
            )
        if place and not is_diff:
            objects.clear()
            states.clear()
            rules = LinkRules()
        _apply(scene, objects, is_diff=is_diff)
        rules = attached_objects(scene.get("robot_state"), link_rules(scene, rules), objects, _placed_shapes)
        notes += [*_unread(scene), *rule_notes(scene, rules, objects)]
        if any(thing.frame not in WORLD_FRAMES for thing in objects.values()):
            states += [found for found in (joint_values(scene.get("robot_state")),) if found]
    if several:
        notes.append(
            f"{named(path)} has {len(documents)} messages; the last whole scene and the changes after it are read"
        )
    frames = {name: thing.frame for name, thing in objects.items() if thing.shapes}
    if len({"world", *frames.values()}) > 1 and set(frames.values()) != {""}:
        stood = states[0] if states and all(state == states[0] for state in states) else {}
        rules = replace(rules, frames=frames, joints=stood)
    solids = [
        Solid(shape, thing.pose @ within, name) for name, thing in objects.items() for shape, within in thing.shapes
    ]
    if not solids:
        raise MapError(
            f"{named(path)} has no collision object with a shape to build a world from. Add one, "
            "such as a box for the table, or give the world solids: {extent: [[-2, -2], [2, -2], [2, 2], [-2, 2]]}."
        )
    world = World.from_solids(solids)
    source = file_source("moveit_scene", path, {}, content)
    notes = [*dict.fromkeys(notes), *frame_notes(rules), *world.notes]
    return World(world.ground, notes=tuple(notes), link_rules=rules).read_from(source)


def _apply(scene: SceneEntry, objects: dict[str, Object], *, is_diff: bool) -> None:
    """Apply a message to ``objects`` in place; MapError for unreadable objects.

    With ``is_diff`` the message is a change of a scene, which may remove, move and extend objects; else it only adds.
    """
    world = scene.get("world")
    if not isinstance(world.given, dict) or "collision_objects" not in world.given:
        raise MapError(
            f"{scene.what} must be a planning scene, with world: {{collision_objects: [...]}}; got "
            f"{shown(scene.given)}."
        )
    _refuse_unread(scene)
    transforms = _transforms(scene)
    named_before = dict.fromkeys(objects)
    for place, entry in enumerate(world.get("collision_objects").entries()):
        limits.check(READING)
        name = entry.get("id").given
        if not isinstance(name, str) or not name:
            raise entry.get("id").fault("the name of an object")
        thing = SceneEntry(f"{scene.what.partition(', message')[0]}: object {shown(name)}", entry.given)
        operation = _operation(thing, is_diff=is_diff)
        if name in objects and name not in named_before and operation == ADD:
            raise MapError(
                f"{thing.what} is there twice, the second time as entry {place} (from 0); give each object its own id."
            )
        if operation != ADD and name not in objects:
            raise MapError(
                f"{thing.what} is to be removed, moved or extended, but no such object exists; add it first."
            )
        if operation == REMOVE:
            del objects[name]
            continue
        frame, base = _resolved(_frame(thing), transforms, objects)
        pose = base @ shape_pose(thing.get("pose"))
        if operation == MOVE:
            objects[name] = Object(frame, pose, objects[name].shapes)
            continue
        shapes = list(read_shapes(thing))
        if operation == APPEND:
            known = objects[name]
            if known.frame != frame:
                raise (
                    thing.get("header")
                    .get("frame_id")
                    .fault(f"the frame of the object that it extends, {shown(known.frame)}")
                )
            back = np.linalg.inv(known.pose) @ pose
            objects[name] = known._replace(
                shapes=[*known.shapes, *((shape, back @ within) for shape, within in shapes)]
            )
        else:
            objects[name] = Object(frame, pose, shapes)
            named_before.pop(name, None)


def _unread(scene: SceneEntry) -> Iterator[str]:
    """Yield notes (warnings to print) on parts of a message that may matter but are not read."""
    state = scene.get("robot_state")
    joints = state.get("joint_state").given if isinstance(state.given, dict) else None
    if isinstance(joints, dict) and joints.get("name"):
        yield f"{state.what} is not read; give the start to the problem"
    moved = state.get("multi_dof_joint_state") if isinstance(state.given, dict) else None
    transforms = moved.get("transforms").entries() if moved is not None and isinstance(moved.given, dict) else []
    if any(not np.allclose(shape_pose(each, "translation", "rotation"), np.eye(4), atol=1e-9) for each in transforms):
        yield f"{state.what}: multi_dof_joint_state is not read; give the pose of the root link as base of the arm"
    if colours := scene.get("object_colors").entries():
        yield f"{scene.what} has {counted(len(colours), 'colour')} of objects, which are not read"
    things = scene.get("world").get("collision_objects").entries()
    if frames := [entry for entry in things if entry.get("subframe_names").given]:
        yield f"{scene.what} has subframes of {counted(len(frames), 'object')}, which are not read"
    unknown = {str(key) for entry in things for key in entry.given if key not in READ | LABELS}
    strange = {str(key) for key in scene.given if key not in SCENE}
    known = READ | LABELS | SCENE | set(WITHIN.split())
    within = set(_keys(scene.given)) - known - unknown - strange
    for where, keys in (("its objects have", unknown), ("it has", strange), ("parts of it have", within)):
        if keys:
            near = "".join(did_you_mean(key, known) for key in sorted(keys))
            yield f"{scene.what}: {where} {', '.join(map(shown, sorted(keys)))}, which is not read.{near}"


def _keys(given: Any) -> Iterator[str]:
    """Yield the keys of all mappings within a value, except in long lists of numbers."""
    for key, value in given.items() if isinstance(given, dict) else ():
        yield str(key)
        if key not in NUMBERS:
            yield from _keys(value)
    for value in given if isinstance(given, list) else ():
        yield from _keys(value)


def _transforms(scene: SceneEntry) -> dict[str, tuple[str, FloatArray]]:
    """Return the parent frame of each frame in ``fixed_frame_transforms``, and its pose (4, 4) in the parent.

    The planning frame is a child of itself, or of no frame; it has no entry. MapError if frames form a circle.
    """
    found: dict[str, tuple[str, FloatArray]] = {}
    for entry in scene.get("fixed_frame_transforms").entries():
        child, moved = entry.get("child_frame_id"), entry.get("transform")
        if not isinstance(child.given, str):
            raise child.fault("the name of a frame")
        pose = shape_pose(moved, "translation", "rotation")
        name, parent = child.given.lstrip("/"), _frame(entry)
        is_same = np.allclose(pose, np.eye(4), atol=1e-12)
        if not is_same and parent in ("", name):
            raise MapError(
                f"{entry.what} gives the pose of frame {shown(name)} relative to itself or to no frame; write the "
                "name of another frame, such as world, in header: frame_id."
            )
        if parent not in ("", name):
            found[name] = parent, pose
    for name in found:
        passed, frame = {name}, found[name][0]
        while frame in found:
            if frame in passed:
                raise MapError(
                    f"{scene.get('fixed_frame_transforms').what} must lead from each frame to one planning frame, but "
                    f"frame {shown(frame)} is given in itself; correct the parents (header: frame_id)."
                )
            passed.add(frame)
            frame = found[frame][0]
    return found


def _resolved(
    frame: str, transforms: Mapping[str, tuple[str, FloatArray]], objects: Mapping[str, Object]
) -> tuple[str, FloatArray]:
    """Follow a frame to its parents; return the last parent, and the pose (4, 4) of the frame in that parent.

    The frame may be that of an object that is in the scene already.
    """
    pose = np.eye(4)
    if frame in objects:
        frame, pose = objects[frame].frame, objects[frame].pose
    while frame in transforms:
        frame, step = transforms[frame]
        pose = step @ pose
    return frame, pose


def _refuse_unread(scene: SceneEntry) -> None:
    """Raise MapError for solid parts of a scene that are not collision objects, such as an octomap."""
    octomap = scene.get("world").get("octomap")
    if isinstance(octomap.given, dict):
        inside = octomap.get("octomap")
        tree = inside.given if isinstance(inside.given, dict) else octomap.given
        if tree.get("data"):
            raise MapError(
                f"{octomap.what} has cells, which are not read. Save the scene without it. To keep the cells, save the "
                "octomap as a .bt file and write its cells as boxes: octree2pointcloud map.bt map.pcd, then "
                "World.from_file('map.pcd', resolution=CELL)."
            )


def _frame(thing: SceneEntry) -> str:
    """Return the name of the frame in which the pose of an object is given, "" if there is none."""
    header = thing.get("header")
    frame = None if header.given is None else header.get("frame_id").given
    if not isinstance(frame, str | None):
        raise thing.get("header").get("frame_id").fault("the name of a frame")
    return (frame or "").lstrip("/")


def _operation(thing: SceneEntry, *, is_diff: bool) -> int:
    """Return the operation of an object (add, remove, ...), given as a number, a character or a word.

    Raises MapError for an unknown one, and without ``is_diff`` for any but add.
    """
    operation = thing.get("operation")
    given = operation.given
    known = isinstance(given, int | str | None) and not isinstance(given, bool) and given in OPERATIONS
    if not known or (OPERATIONS[given] != ADD and not is_diff):
        raise operation.fault("0 (add), unless the message is a change of a scene (is_diff: true)")
    return OPERATIONS[given]


def _placed_shapes(thing: SceneEntry) -> Iterator[tuple[Shape, FloatArray]]:
    """Yield each shape of an object with its pose (4, 4) in the frame of the object's header."""
    base = shape_pose(thing.get("pose"))
    return ((shape, base @ within) for shape, within in read_shapes(thing))
