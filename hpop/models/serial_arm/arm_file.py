"""Arms from URDF and SRDF files: read once, assembled, with hashes for saved fronts, and notes on oddities.

SRDFs are written for several variants of a robot, so links and joints that they name need not exist. A misspelt name
looks the same as such a name, so both give a note.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.errors import ModelError, did_you_mean
from hpop.models.serial_arm.chain import ArmPart, Chain, FrameMount, Pair, pair_of
from hpop.models.serial_arm.meshes import hulls, mesh_bytes, mesh_path
from hpop.models.serial_arm.urdf import Robot, Semantics, UrdfJoint, UrdfMesh, read_srdf, read_urdf
from hpop.world.files import sha256
from hpop.world.geometry.solids import Hull, Solid

MOVING = ("revolute", "prismatic", "continuous")
LONGEST_MIMICRY = 20
"""Longest row of joints that mimic one another; longer ones may be rings."""
Place = tuple[int, FloatArray]
"""Frame of the chain, and a pose in it."""
MOST_NAMED = 8
"""Largest number of names in a note."""
Values = tuple[float, ...]
NO_SRDF = "states have names in an SRDF, and none was given as srdf"
ROUNDED = 5e-4
"""Tolerance, rad or m, of values beyond a limit for lack of decimals: 1.5708 stands for half of pi."""


class Assembly(NamedTuple):
    """Arm that results from a URDF and a choice of its tip.

    chain   joints that move, with the body "tool"
    places  frame that carries each link, and the pose of the link in this frame
    stands  value, rad or m, of each joint that could move but is fixed
    """

    chain: Chain
    places: Mapping[str, Place]
    stands: Mapping[str, float]


def assemble(
    robot: Robot, tip: str, base: FloatArray, fixed: Mapping[str, float], acceleration: float | Mapping[str, float]
) -> Assembly:
    """Return the chain from the root of a robot to a tip; the root has the pose ``base`` (4, 4) in the world.

    Joints in ``fixed`` stand at their value, joints outside the chain at 0 or the limit nearest to it.
    """
    given = {"fixed": fixed, "acceleration": acceleration if isinstance(acceleration, Mapping) else {}}
    for parameter, name in ((parameter, name) for parameter, values in given.items() for name in values):
        if name not in robot.joints:
            raise robot.file.error(
                f"{parameter} gives a value for the joint {shown(name)}, which does not exist; its joints are "
                f"{', '.join(map(shown, robot.joints))}." + did_you_mean(name, robot.joints)
            )
    ancestry = robot.ancestry(tip)
    joints = [joint for joint in ancestry if joint.kind != "fixed" and joint.name not in fixed]
    for joint in joints:
        _check_moves(robot, joint)
    if not joints:
        raise robot.file.error(f"no joint between {shown(robot.root)} and the tip {shown(tip)} moves")
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
    """Return the pose (4, 4) of a joint's child at a value, in the joint's frame."""
    pose = np.eye(4)
    if joint.kind == "prismatic":
        pose[:3, 3] = value * joint.axis
    elif value:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        pose[:3, :3] += math.sin(value) * cross + (1.0 - math.cos(value)) * cross @ cross
    return pose


def parts_of(robot: Robot, places: Mapping[str, Place], hulls: Callable[[UrdfMesh], list[Hull]]) -> Iterator[ArmPart]:
    """Yield the solids of the links, each in the frame with which it moves."""
    for link, geometries in robot.links.items():
        frame, pose = places[link]
        for geometry in geometries:
            shape = geometry.shape
            for solid in hulls(shape) if isinstance(shape, UrdfMesh) else [shape]:
                yield ArmPart(link, frame, Solid(solid, pose @ geometry.pose, link))


def touching_by_design(robot: Robot, places: Mapping[str, Place]) -> frozenset[Pair]:
    """Return pairs of links that touch by design.

    Joined directly or through links without solids, or fixed to one frame.
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
    """Yield all joints, each after the joint of its parent."""
    below: dict[str, list[UrdfJoint]] = {}
    for joint in robot.joints.values():
        below.setdefault(joint.parent, []).append(joint)
    rest = [robot.root]
    while rest:
        for joint in below.get(rest.pop(), []):
            yield joint
            rest.append(joint.child)


def _check_moves(robot: Robot, joint: UrdfJoint) -> None:
    """Raise ModelError for a joint between root and tip that arms cannot have."""
    way_out = f"if it stands, give its value in fixed, as {{{joint.name}: 0.0}}; or give another tip"
    if joint.kind not in MOVING:
        raise robot.file.error(
            f"joint {shown(joint.name)}, between the root and the tip, is {joint.kind}; the joints of an arm must "
            f"be fixed, {', '.join(MOVING)}: {way_out}"
        )
    if joint.mimic is not None:
        raise robot.file.error(
            f"joint {shown(joint.name)}, between the root and the tip, mimics {shown(joint.mimic.joint)}; the "
            f"joints of an arm move by themselves: {way_out}"
        )


def _fixed_values(robot: Robot, moving: Mapping[str, int], fixed: Mapping[str, float]) -> dict[str, float]:
    """Return the value, rad or m, of every joint that could move but is fixed; a mimicking joint follows its leader."""
    stands: dict[str, float] = {}

    def value(joint: UrdfJoint, followed: tuple[str, ...] = ()) -> float:
        if joint.name in fixed:
            return fixed[joint.name]
        if joint.mimic is not None:
            leader = joint.mimic.joint
            if leader not in robot.joints or leader in moving or len(followed) == LONGEST_MIMICRY:
                raise robot.file.error(
                    f"joint {shown(joint.name)} mimics {shown(leader)}, which moves or is not a fixed joint; give "
                    f"its value in fixed, as {{{joint.name}: 0.0}}"
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
    """Return the least and the greatest value; half a turn either way for a joint without limits."""
    if joint.kind == "continuous":
        return -math.pi, math.pi
    if joint.low is None or joint.high is None or joint.low >= joint.high:
        got = "none" if joint.low is None else f"lower {joint.low:g}, upper {joint.high:g}"
        raise robot.file.error(
            f"joint {shown(joint.name)} needs limits, got {got}; add <limit lower=... upper=... velocity=.../>, or "
            "make a revolute joint without end stops continuous"
        )
    return joint.low, joint.high


def _speed(robot: Robot, joint: UrdfJoint) -> float:
    if joint.speed is None or not joint.speed > 0:
        unit = "m/s" if joint.kind == "prismatic" else "rad/s"
        raise robot.file.error(
            f'joint {shown(joint.name)} needs a greatest speed; add velocity="..." in {unit} to its <limit>'
        )
    return joint.speed


def _acceleration(robot: Robot, joint: UrdfJoint, given: float | Mapping[str, float]) -> float:
    if not isinstance(given, Mapping):
        return given
    if joint.name not in given:
        raise robot.file.error(f"acceleration gives no value for joint {shown(joint.name)}; give one for each joint")
    return given[joint.name]


def unknown_name_notes(robot: Robot, semantics: Semantics) -> Iterator[str]:
    """Yield notes on links, joints and groups in an SRDF that neither the URDF nor the SRDF defines."""
    links = {link for pair in semantics.disabled | semantics.enabled for link in pair} | semantics.lonely
    if strange := sorted(links - robot.links.keys()):
        yield _unknown_note("says which links never collide also of", strange, robot.links)
    joints = {joint for values in semantics.states.values() for joint in values} - semantics.loose
    if strange := sorted(joints - robot.joints.keys()):
        yield _unknown_note("gives, in its states, values of the joints", strange, robot.joints)
    for state, group in sorted(semantics.grouped):
        if group not in semantics.groups:
            near = did_you_mean(group, semantics.groups)
            yield (
                f"the state {shown(state)} of the SRDF is one of the group {shown(group)}, which the SRDF does not "
                f"define.{near} It has {_names_text(sorted(semantics.groups)) or 'none'}"
            )


def passive_joint_notes(joints: Iterable[str], semantics: Semantics) -> Iterator[str]:
    """Yield notes on joints between root and tip that the SRDF calls passive, though they are planned for."""
    if passive := sorted(semantics.passive & {*joints}):
        yield (
            f"the SRDF says that the joints {_names_text(passive)} are not driven (passive_joint), but the arm moves "
            f"by them: give their values in fixed, as {{{passive[0]}: 0.0}}"
        )


def invalid_limit_notes(robot: Robot) -> Iterator[str]:
    """Yield notes on joint limits that contradict one another and are ignored."""
    yield from (joint.doubt for joint in robot.joints.values() if joint.doubt)


def missing_collision_notes(robot: Robot) -> Iterator[str]:
    """Yield notes on links without collision geometry: the visible ones, or all if no link has any."""
    if not any(robot.links.values()):
        yield "no link of the URDF has <collision> geometry: motions of the arm are not checked for collisions"
    elif bare := sorted(robot.bare):
        yield (
            f"the links {_names_text(bare)} have <visual> but no <collision> geometry in the URDF: they are not held "
            "against obstacles"
        )


def _unknown_note(what: str, strange: list[str], known: Iterable[str]) -> str:
    """Return a note on names in the SRDF that the URDF does not have; ``what`` says where the SRDF has them."""
    near = "".join(did_you_mean(name, known) for name in strange[:MOST_NAMED])
    return (
        f"the SRDF {what} {_names_text(strange)}, which the URDF does not have: is it the SRDF of another robot?{near}"
    )


def _names_text(names: list[str]) -> str:
    more = [f"{len(names) - MOST_NAMED:,} more"] if len(names) > MOST_NAMED else []
    return ", ".join([*map(shown, names[:MOST_NAMED]), *more])


class ArmFile(NamedTuple):
    """Contents of an arm's files.

    chain    moving joints, with the bodies "tool" and "camera"
    parts    solids of the links
    apart    pairs of links without collision tests: they touch by design, or the SRDF excludes them
    notes    oddities in the files that do not prevent their use
    states   values of the chain's joints by the name of a state
    unnamed  reasons why other names in the SRDF are no states; under "" the reason for all further names
    hashes   SHA-256 of the URDF, then of its meshes in the order of their names in it
    srdf_hash  SHA-256 of the SRDF, or None
    """

    chain: Chain
    parts: tuple[ArmPart, ...]
    apart: frozenset[Pair]
    notes: tuple[str, ...]
    states: Mapping[str, Values]
    unnamed: Mapping[str, str]
    hashes: tuple[str, ...]
    srdf_hash: str | None


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
) -> ArmFile:
    """Return an arm with its root at the pose ``base`` (4, 4) in the world and ``camera`` (4, 4) at its tip.

    Raises ModelError for a file that is no arm, and for files that are missing or not to be trusted.
    """
    robot = read_urdf(urdf)
    assembly = assemble(robot, tip, base, fixed, acceleration)
    hashes = {robot.file.path: sha256(robot.file.data)}
    pieces: dict[tuple[Path, tuple[float, ...]], list[Hull]] = {}

    def mesh_hulls(mesh: UrdfMesh) -> list[Hull]:
        try:
            path = mesh_path(mesh, robot.file.path.parent, packages)
            key = (path, tuple(mesh.scale.tolist()))
            if key not in pieces:
                data = mesh_bytes(path)
                hashes[path] = sha256(data)
                pieces[key] = hulls(data, path, mesh.scale)
        except ModelError as error:
            raise robot.file.error(f"the collision geometry of link {shown(mesh.link)}: {error}") from None
        return pieces[key]

    parts = tuple(parts_of(robot, assembly.places, mesh_hulls))
    tool = assembly.chain.mounts["tool"]
    mounts = {"tool": tool, "camera": FrameMount(tool.frame, tool.pose @ camera)}
    chain = replace(assembly.chain, mounts=mounts)
    apart, semantics = touching_by_design(robot, assembly.places), None if srdf is None else read_srdf(srdf)
    if semantics is not None:
        solid = [link for link, shapes in robot.links.items() if shapes]
        apart |= semantics.apart(solid)
    notes = (*missing_collision_notes(robot), *invalid_limit_notes(robot))
    if semantics is not None:
        notes = (*notes, *unknown_name_notes(robot, semantics), *passive_joint_notes(chain.names, semantics))
    states = {} if semantics is None else _named_states(chain, semantics)
    unnamed = {"": NO_SRDF} if semantics is None else _incomplete_states(chain, semantics)
    srdf_hash = None if semantics is None else sha256(semantics.file.data)
    return ArmFile(chain, parts, apart, notes, states, unnamed, tuple(hashes.values()), srdf_hash)


def _named_states(chain: Chain, semantics: Semantics) -> dict[str, Values]:
    """Return the named states that give every joint of the chain.

    Values at most ROUNDED beyond a limit are moved to it.

    Other states beyond limits are refused when they are used: MoveIt's own SRDF of the Panda has one.
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
    """Return, by name, the reason why a state of the SRDF is not usable: it lacks joints of the chain."""
    lacking = {
        name: ", ".join(joint for joint in chain.names if joint not in values)
        for name, values in semantics.states.items()
    }
    return {name: f"the SRDF's state of this name lacks {joints}" for name, joints in lacking.items() if joints}
