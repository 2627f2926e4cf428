"""An arm put together of a URDF's links and joints: its chain, its solid parts, and which of them touch by design."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import shown
from hpop.errors import did_you_mean
from hpop.models.serial_arm.chain import Chain, Mount, Part
from hpop.models.serial_arm.srdf import Pair, pair_of
from hpop.models.serial_arm.urdf import Joint, Mesh, Robot
from hpop.world.geometry.solids import Hull, Solid

MOVING = ("revolute", "prismatic", "continuous")
LONGEST_MIMICRY = 20
"""Joints that follow one another, at most: longer rows may be rings."""
Place = tuple[int, FloatArray]
"""A frame of the chain, and a pose in it."""


class Assembly(NamedTuple):
    """What a URDF makes of a choice of its tip.

    chain   the joints that move, with the body "tool"
    places  where each link is
    stands  value, rad or m, of each joint that could move, but stands
    """

    chain: Chain
    places: Mapping[str, Place]
    stands: Mapping[str, float]


def assembled(
    robot: Robot, tip: str, base: FloatArray, fixed: Mapping[str, float], acceleration: float | Mapping[str, float]
) -> Assembly:
    """The chain from the root of a robot to a tip, the pose of the root in the world being ``base`` (4, 4).

    Joints in ``fixed`` stand at a value, those elsewhere than between root and tip at 0 or the limit nearest to it.
    """
    given = {"fixed": fixed, "acceleration": acceleration if isinstance(acceleration, Mapping) else {}}
    for parameter, name in ((parameter, name) for parameter, values in given.items() for name in values):
        if name not in robot.joints:
            raise robot.file.error(
                f"{parameter} gives a value for the joint {shown(name)}, which there is not; its joints are "
                f"{', '.join(map(shown, robot.joints))}." + did_you_mean(name, robot.joints)
            )
    ancestry = robot.ancestry(tip)
    joints = [joint for joint in ancestry if joint.kind != "fixed" and joint.name not in fixed]
    for joint in joints:
        _check_moves(robot, joint)
    if not joints:
        raise robot.file.error(f"no joint between {shown(robot.root)} and the tip {shown(tip)} moves")
    numbers = {joint.name: i for i, joint in enumerate(joints, 1)}
    stands = _standing(robot, numbers, fixed)
    places: dict[str, Place] = {robot.root: (0, base)}
    origins = []
    for joint in _from_the_root(robot):
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
        mounts={"tool": Mount(*places[tip])},
    )
    return Assembly(chain, places, stands)


def displacement(joint: Joint, value: float) -> FloatArray:
    """Pose (4, 4) of a joint's child at a value, in the joint's frame."""
    pose = np.eye(4)
    if joint.kind == "prismatic":
        pose[:3, 3] = value * joint.axis
    elif value:
        x, y, z = joint.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        pose[:3, :3] += math.sin(value) * cross + (1.0 - math.cos(value)) * cross @ cross
    return pose


def parts_of(robot: Robot, places: Mapping[str, Place], hulls: Callable[[Mesh], list[Hull]]) -> Iterator[Part]:
    """The solids that links carry, each in the frame with which it moves."""
    for link, geometries in robot.links.items():
        frame, pose = places[link]
        for geometry in geometries:
            shape = geometry.shape
            for solid in hulls(shape) if isinstance(shape, Mesh) else [shape]:
                yield Part(link, frame, Solid(solid, pose @ geometry.pose, link))


def touching(robot: Robot, places: Mapping[str, Place]) -> frozenset[Pair]:
    """Pairs of links that touch by design: joined by a joint or through links without solids, or on one frame."""
    solid = [link for link, shapes in robot.links.items() if shapes]
    pairs = {pair_of(a, b) for a, b in combinations(solid, 2) if places[a][0] == places[b][0]}
    parent = {joint.child: joint.parent for joint in robot.joints.values()}
    for link in solid:
        above = parent.get(link)
        while above is not None:
            pairs.add(pair_of(link, above))
            above = None if robot.links[above] else parent.get(above)
    return frozenset(pairs)


def _from_the_root(robot: Robot) -> Iterator[Joint]:
    """All joints, each after that of its parent."""
    below: dict[str, list[Joint]] = {}
    for joint in robot.joints.values():
        below.setdefault(joint.parent, []).append(joint)
    rest = [robot.root]
    while rest:
        for joint in below.get(rest.pop(), []):
            yield joint
            rest.append(joint.child)


def _check_moves(robot: Robot, joint: Joint) -> None:
    """Raise ModelError for a joint between root and tip that no arm here can have."""
    way_out = f"if it stands, give its value in fixed, as {{{joint.name}: 0.0}}; or give another tip"
    if joint.kind not in MOVING:
        raise robot.file.error(
            f"joint {shown(joint.name)}, between the root and the tip, is {joint.kind}; an arm's are fixed, "
            f"{', '.join(MOVING)}: {way_out}"
        )
    if joint.mimic is not None:
        raise robot.file.error(
            f"joint {shown(joint.name)}, between the root and the tip, mimics {shown(joint.mimic.joint)}; joints of an "
            f"arm move by themselves: {way_out}"
        )


def _standing(robot: Robot, moving: Mapping[str, int], fixed: Mapping[str, float]) -> dict[str, float]:
    """Value, rad or m, of every joint that stands though it could move; one that mimics another follows that."""
    stands: dict[str, float] = {}

    def value(joint: Joint, followed: tuple[str, ...] = ()) -> float:
        if joint.name in fixed:
            return fixed[joint.name]
        if joint.mimic is not None:
            leader = joint.mimic.joint
            if leader not in robot.joints or leader in moving or len(followed) == LONGEST_MIMICRY:
                raise robot.file.error(
                    f"joint {shown(joint.name)} mimics {shown(leader)}, which moves, or is no joint that stands; give "
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


def _limits(robot: Robot, joint: Joint) -> tuple[float, float]:
    """Least and greatest value; of a joint without limits half a turn either way."""
    if joint.kind == "continuous":
        return -math.pi, math.pi
    if joint.low is None or joint.high is None or joint.low >= joint.high:
        got = "none" if joint.low is None else f"lower {joint.low:g}, upper {joint.high:g}"
        raise robot.file.error(
            f"joint {shown(joint.name)} needs limits, got {got}; add <limit lower=... upper=... velocity=.../>, or "
            "make a revolute joint without end stops continuous"
        )
    return joint.low, joint.high


def _speed(robot: Robot, joint: Joint) -> float:
    if joint.speed is None or not joint.speed > 0:
        unit = "m/s" if joint.kind == "prismatic" else "rad/s"
        raise robot.file.error(
            f'joint {shown(joint.name)} needs a greatest speed; add velocity="..." in {unit} to its <limit>'
        )
    return joint.speed


def _acceleration(robot: Robot, joint: Joint, given: float | Mapping[str, float]) -> float:
    if not isinstance(given, Mapping):
        return given
    if joint.name not in given:
        raise robot.file.error(f"acceleration gives no value for joint {shown(joint.name)}; give one for each joint")
    return given[joint.name]
