"""Arm from its URDF and SRDF files: the chain of joints up to the tip, solids, named states, file hashes and notes."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.errors import did_you_mean
from hpop.models.serial_arm.chain import ArmPart, AttachedObject, Chain, FrameMount, Pair, pair_of
from hpop.models.serial_arm.checks import (
    ROUNDED,
    check_moves,
    check_within,
    invalid_limit_notes,
    missing_collision_notes,
    passive_joint_notes,
    unknown_name_notes,
)
from hpop.models.serial_arm.meshes import ReadMeshes, Way, read_meshes
from hpop.models.serial_arm.urdf import MOVING, Robot, Semantics, UrdfJoint, UrdfMesh, read_srdf, read_urdf
from hpop.world.files import sha256
from hpop.world.geometry.solids import Solid

LONGEST_MIMICRY = 20
"""Longest sequence of joints that mimic the next one; a longer sequence may be a circle."""
Place = tuple[int, FloatArray]
"""Number of a frame of the chain, and a pose (4, 4) in this frame."""
Values = tuple[float, ...]
NO_SRDF = "states get their names from an SRDF, and no file was given as srdf"


class Assembly(NamedTuple):
    """Arm that results from a URDF and the choice of its tip.

    chain   joints that move, with the body "tool" at the tip
    places  by link: the frame that carries it, and its pose in this frame
    stands  by joint that could move but is fixed: its value, rad or m
    """

    chain: Chain
    places: Mapping[str, Place]
    stands: Mapping[str, float]


def assemble(
    robot: Robot, tip: str, base: FloatArray, fixed: Mapping[str, float], acceleration: float | Mapping[str, float]
) -> Assembly:
    """Return the chain of moving joints from the root of a robot to the link ``tip``, with the places of all links.

    base          (4, 4)  pose of the root in the world
    fixed         values of joints that do not move; other joints outside the chain are at 0, or at the nearest limit
    acceleration  rad/s² or m/s², largest acceleration of all joints, or of each by name
    """
    given = {"fixed": fixed, "acceleration": acceleration if isinstance(acceleration, Mapping) else {}}
    for parameter, name in ((parameter, name) for parameter, values in given.items() for name in values):
        if name not in robot.joints:
            raise robot.file.error(
                f"{parameter} must name joints of this file, got {shown(name)}; its joints are "
                f"{', '.join(map(shown, robot.joints))}." + did_you_mean(name, robot.joints)
            )
    ancestry = robot.ancestry(tip)
    joints = [joint for joint in ancestry if joint.kind != "fixed" and joint.name not in fixed]
    for joint in joints:
        check_moves(robot, joint)
    if not joints:
        raise robot.file.error(
            f"at least one joint between the root {shown(robot.root)} and the tip {shown(tip)} must move; give another "
            "tip, or take joints out of fixed"
        )
    numbers = {joint.name: i for i, joint in enumerate(joints, 1)}
    stands = _fixed_values(robot, numbers, fixed)
    places: dict[str, Place] = {robot.root: (0, base)}
    origins = []
    for joint in _joints_from_root(robot):
        frame, pose = places[joint.parent]
        at = pose @ joint.origin
        if joint.name in numbers:
            origins.append(at)  # in the order of the chain: from root to tip
            places[joint.child] = numbers[joint.name], np.eye(4)
        else:
            places[joint.child] = frame, at @ displacement(joint, stands.get(joint.name, 0.0))
    low, high = zip(*(_limits(robot, joint) for joint in joints), strict=True)
    chain = Chain(
        names=tuple(joint.name for joint in joints),
        sliding=np.array([joint.kind == "prismatic" for joint in joints]),
        turning=np.array([joint.kind == "continuous" for joint in joints]),
        axes=np.array([joint.axis for joint in joints]),
        origins=np.array(origins),
        low=np.array(low),
        high=np.array(high),
        speed=np.array([_speed(robot, joint) for joint in joints]),
        acceleration=np.array([_acceleration(robot, joint, acceleration) for joint in joints]),
        mounts={"tool": FrameMount(*places[tip])},
    )
    return Assembly(chain, places, stands)


def displacement(joint: UrdfJoint, value: float) -> FloatArray:
    """Return the pose (4, 4) of a joint's child link, in the frame of the joint, at a joint value, rad or m."""
    pose = np.eye(4)
    if joint.kind == "prismatic":
        pose[:3, 3] = value * joint.axis
    elif value:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        pose[:3, :3] += math.sin(value) * cross + (1.0 - math.cos(value)) * cross @ cross
    return pose


def parts_of(
    robot: Robot,
    places: Mapping[str, Place],
    meshes: ReadMeshes,
    padding: float | Mapping[str, float],
) -> Iterator[ArmPart]:
    """Yield the collision solids of all links, each in the frame of the chain that carries it.

    places   frame and pose of each link
    meshes   convex hulls of the meshes
    padding  m, of all links, or of each by name
    """
    for link, geometries in robot.links.items():
        frame, pose = places[link]
        padded = padding.get(link, 0.0) if isinstance(padding, Mapping) else padding
        for geometry in geometries:
            shape = geometry.shape
            for solid in meshes.of(shape) if isinstance(shape, UrdfMesh) else [shape]:
                yield ArmPart(link, frame, Solid(solid, pose @ geometry.pose, link), padded)


def _held_parts(
    robot: Robot,
    places: Mapping[str, Place],
    attached: Sequence[AttachedObject],
    padding: float | Mapping[str, float],
) -> Iterator[ArmPart]:
    """Yield the attached objects as parts, each a link of its own.

    Raises ModelError if the link that carries an object is missing, or if a link has the object's name.
    """
    for each in attached:
        name = each.solid.name
        if each.link not in robot.links:
            raise robot.file.error(
                f"the attached object {shown(name)} must be on a link of this file, got {shown(each.link)}; its links "
                f"are {', '.join(map(shown, robot.links))}." + did_you_mean(each.link, robot.links)
            )
        if name in robot.links:
            raise robot.file.error(
                f"a link of this file has the name {shown(name)}, so no attached object may have it; rename the object "
                "where it is attached (the option attached, arm.holding or the scene)"
            )
        frame, pose = places[each.link]
        padded = padding.get(name, 0.0) if isinstance(padding, Mapping) else padding
        yield ArmPart(name, frame, replace(each.solid, pose=pose @ each.solid.pose), padded, each.touches)


def touching_by_design(robot: Robot, places: Mapping[str, Place]) -> frozenset[Pair]:
    """Return the pairs of links that touch by design: neighbours in the tree of links, and links fixed to one frame.

    Links are also neighbours if only links without solids are between them.
    """
    solid = [link for link, shapes in robot.links.items() if shapes]
    pairs = {pair_of(a, b) for a, b in combinations(solid, 2) if places[a][0] == places[b][0]}
    parent = {joint.child: joint.parent for joint in robot.joints.values()}
    for link in solid:
        above = parent.get(link)
        while above is not None:
            pairs.add(pair_of(link, above))
            above = None if robot.links[above] else parent.get(above)
    return frozenset(pairs)


def _joints_from_root(robot: Robot) -> Iterator[UrdfJoint]:
    """Yield all joints, from the root outwards: each joint after the one that moves its parent link."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in robot.joints.values():
        below.setdefault(joint.parent, []).append(joint)
    rest = [robot.root]
    while rest:
        for joint in below.get(rest.pop(), []):
            yield joint
            rest.append(joint.child)


def _fixed_values(robot: Robot, moving: Mapping[str, int], fixed: Mapping[str, float]) -> dict[str, float]:
    """Return the value, rad or m, of each joint outside the chain that could move, by name.

    moving  names of the joints of the chain
    fixed   values that the user has given

    A joint without a given value follows the joint that it mimics; if it mimics none, it is at 0 or, if 0 is beyond a
    limit, at this limit. Raises ModelError for a value beyond limits, and if the joint that it mimics moves.
    """
    stands: dict[str, float] = {}

    def value(joint: UrdfJoint, followed: tuple[str, ...] = ()) -> float:
        if joint.name in fixed:
            check_within(robot, joint, fixed[joint.name])
            return fixed[joint.name]
        if joint.mimic is not None:
            leader = joint.mimic.joint
            if leader not in robot.joints or leader in moving or len(followed) == LONGEST_MIMICRY:
                raise robot.file.error(
                    f"joint {shown(joint.name)} mimics {shown(leader)}, but may only mimic a joint that does not move; "
                    f"give its value in fixed, as {{{joint.name}: 0.0}}"
                )
            return joint.mimic.factor * value(robot.joints[leader], (*followed, joint.name)) + joint.mimic.offset
        if joint.kind == "continuous" or joint.low is None or joint.high is None:
            return 0.0
        return min(max(0.0, joint.low), joint.high)

    for joint in robot.joints.values():
        if joint.name not in moving and joint.kind in MOVING:
            stands[joint.name] = value(joint)
    return stands


def _limits(robot: Robot, joint: UrdfJoint) -> tuple[float, float]:
    """Return the lower and upper limit of a joint; -pi and pi for a continuous joint, which has none."""
    if joint.kind == "continuous":
        return -math.pi, math.pi
    if joint.low is None or joint.high is None or joint.low >= joint.high:
        got = "none" if joint.low is None else f"lower {joint.low:g}, upper {joint.high:g}"
        raise robot.file.error(
            f"joint {shown(joint.name)} must have limits with lower below upper, got {got}; add <limit lower=... "
            "upper=... velocity=.../>, or, for a joint without end stops, set its type to continuous"
        )
    return joint.low, joint.high


def _speed(robot: Robot, joint: UrdfJoint) -> float:
    """Return the largest speed of a joint, rad/s or m/s; ModelError if the URDF gives none."""
    if joint.speed is None or not joint.speed > 0:
        unit = "m/s" if joint.kind == "prismatic" else "rad/s"
        raise robot.file.error(
            f'joint {shown(joint.name)} must have a largest speed above 0; add velocity="..." in {unit} to its <limit>'
        )
    return joint.speed


def _acceleration(robot: Robot, joint: UrdfJoint, given: float | Mapping[str, float]) -> float:
    """Return the largest acceleration of a joint from the option ``acceleration``, rad/s² or m/s²."""
    if not isinstance(given, Mapping):
        return given
    if joint.name not in given:
        raise robot.file.error(
            "the option acceleration of the arm must have a value for each joint, but has none for "
            f"{shown(joint.name)}; add one there"
        )
    return given[joint.name]


class ArmFile(NamedTuple):
    """Arm as read from its files; each attached object counts as a link.

    chain     moving joints, with the bodies "tool" and "camera"
    parts     collision solids of the links
    touching  pairs of links that touch by design, and so are not tested for collision; also an attached object and
              each body that it may touch
    apart     pairs of links that are not tested for collision: they touch by design, or the SRDF excludes them
    notes     sentences for the user on oddities in the files that do not prevent their use
    states    values of the chain's joints, by the name of each named state
    links     names of all links of the URDF
    unnamed   reason why a name is no usable state, by name: states of the SRDF that lack a joint's value; without an
              SRDF, one reason for all names, under ""
    hashes    SHA-256 of the URDF, then of each collision mesh, in the order in which the URDF first names them
    srdf_hash  SHA-256 of the SRDF, or None
    above     joint above each link but the root, by the name of the link
    stands    by joint that could move but is fixed: its value, rad or m
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    touching: frozenset[Pair]
    apart: frozenset[Pair]
    notes: tuple[str, ...]
    states: Mapping[str, Values]
    unnamed: Mapping[str, str]
    hashes: tuple[str, ...]
    srdf_hash: str | None
    links: frozenset[str]
    above: Mapping[str, UrdfJoint]
    stands: Mapping[str, float]

    def link_pose(self, link: str, values: Mapping[str, float]) -> FloatArray | None:
        """Return the pose (4, 4) of a link in the root at joint values; None if a moving joint before it has none.

        Joints outside the chain without a value stand where they always do.
        """
        pose = np.eye(4)
        while link in self.above:
            joint = self.above[link]
            value, master = values.get(joint.name), joint.mimic and joint.mimic.joint
            if value is None and joint.mimic is not None and master in values:
                value = joint.mimic.factor * values[joint.mimic.joint] + joint.mimic.offset
            if value is None and {joint.name, master} & {*self.chain.names}:
                return None
            value = self.stands.get(joint.name, 0.0) if value is None else value
            pose, link = joint.origin @ displacement(joint, value) @ pose, joint.parent
        return pose


def read_arm(
    urdf: str,
    srdf: str | None,
    *,
    packages: Mapping[str, str],
    tip: str,
    camera: FloatArray,
    base: FloatArray,
    fixed: Mapping[str, float],
    acceleration: float | Mapping[str, float],
    padding: float | Mapping[str, float] = 0.0,
    way: Way = "hull",
    attached: Sequence[AttachedObject] = (),
) -> ArmFile:
    """Read an arm from its files.

    urdf, srdf    paths of the files
    packages      folders of mesh files, by package
    tip           name of the last link
    camera        (4, 4)  pose of the camera in the frame of the tip
    base          (4, 4)  pose of the root link in the world
    fixed         values of joints that do not move
    acceleration  rad/s² or m/s², largest acceleration of all joints, or of each by name
    padding       m, distance that all links, or each by name, keep from obstacles beyond the usual distance
    way           what to do with meshes that are not convex, one of ``WAYS``
    attached      objects that the arm holds

    Raises ModelError for missing or invalid files.
    """
    robot = read_urdf(urdf)
    assembly = assemble(robot, tip, base, fixed, acceleration)
    meshes = read_meshes(robot, packages, way)
    hashes = {robot.file.path: sha256(robot.file.data), **meshes.hashes}
    for name in padding if isinstance(padding, Mapping) else ():
        if name not in {*robot.links, *(each.solid.name for each in attached)}:
            raise robot.file.error(
                f"padding must name links of this file or attached objects, got {shown(name)}; the links are "
                f"{', '.join(map(shown, robot.links))}." + did_you_mean(name, robot.links)
            )
    held = tuple(_held_parts(robot, assembly.places, attached, padding))
    parts = (*parts_of(robot, assembly.places, meshes, padding), *held)
    tool = assembly.chain.mounts["tool"]
    mounts = {"tool": tool, "camera": FrameMount(tool.frame, tool.pose @ camera)}
    chain = replace(assembly.chain, mounts=mounts)
    carried = {pair_of(each.solid.name, name) for each in attached for name in (each.link, *each.touches)}
    touching, semantics = touching_by_design(robot, assembly.places), None if srdf is None else read_srdf(srdf)
    touching |= carried
    apart = touching
    if semantics is not None:
        solid = [link for link, shapes in robot.links.items() if shapes]
        apart |= semantics.apart(solid)
    notes = (*missing_collision_notes(robot), *invalid_limit_notes(robot), *meshes.notes)
    if semantics is not None:
        notes = (*notes, *unknown_name_notes(robot, semantics), *passive_joint_notes(chain.names, semantics))
    states = {} if semantics is None else _named_states(chain, semantics)
    unnamed = {"": NO_SRDF} if semantics is None else _incomplete_states(chain, semantics)
    srdf_hash = None if semantics is None else sha256(semantics.file.data)
    links, above = frozenset(robot.links), {joint.child: joint for joint in robot.joints.values()}
    found = (chain, parts, touching, apart, notes, states, unnamed, tuple(hashes.values()), srdf_hash, links)
    return ArmFile(*found, above, assembly.stands)


def _named_states(chain: Chain, semantics: Semantics) -> dict[str, Values]:
    """Return those named states of an SRDF that give a value to every joint of the chain.

    Values at most ``ROUNDED`` beyond a limit are moved to the limit. States farther beyond a limit are returned too.
    They are refused only when they are used, because MoveIt's own SRDF of the Panda has one.
    """
    found = {}
    for name, values in semantics.states.items():
        if values.keys() >= set(chain.names):
            given = np.array([values[joint] for joint in chain.names])
            within = np.clip(given, chain.low, chain.high)
            meant = ~chain.turning & (np.abs(given - within) <= ROUNDED)
            found[name] = tuple(np.where(meant, within, given).tolist())
    return found


def _incomplete_states(chain: Chain, semantics: Semantics) -> dict[str, str]:
    """Return, by name, why named states of an SRDF cannot be used: they give no value to some joints of the chain."""
    lacking = {
        name: ", ".join(joint for joint in chain.names if joint not in values)
        for name, values in semantics.states.items()
    }
    return {name: f"this state of the SRDF has no value for {joints}" for name, joints in lacking.items() if joints}
