"""Robots from URDF and SRDF files: links, joints, named states, and pairs of links without collision tests.

Only entries that planning needs are read: of a URDF's link its ``collision`` elements, of a joint its type, origin,
axis, limits, soft limits (``safety_controller``) and the joint that it mimics. http://wiki.ros.org/urdf/XML,
http://wiki.ros.org/srdf
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import LEAST
from hpop.base.text import printable, shown
from hpop.errors import did_you_mean
from hpop.models.serial_arm.chain import Pair, pair_of
from hpop.models.serial_arm.xml import XmlFile, exact, pose_of
from hpop.world.geometry.solids import Box, Cylinder, Shape, Sphere

KINDS = ("fixed", "revolute", "prismatic", "continuous", "floating", "planar")
MOST_LINKS = 1000
MOST_SHOWN = 12
"""Largest number of links of a circle in a message."""


class UrdfMesh(NamedTuple):
    """Mesh file of a link in a URDF: the link, the file's name in the URDF, and the scale (3,) of its coordinates."""

    link: str
    name: str
    scale: FloatArray


class Geometry(NamedTuple):
    """Solid of a link.

    shape  shape, or the mesh file that holds it
    pose   (4, 4)  in the link's frame
    """

    shape: Shape | UrdfMesh
    pose: FloatArray


class Mimic(NamedTuple):
    """Rule by which a joint follows another: its value times a factor, plus an offset."""

    joint: str
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """Joint between a link and its parent.

    kind    type of the joint, one of KINDS
    parent, child  names of the links
    origin  (4, 4)  frame of the joint in the frame of the parent; at value 0 it is the frame of the child
    axis    (3,)    unit vector in the joint's frame
    low, high, speed  limits, None if missing in the file; soft limits where these are tighter
    mimic   rule by which it follows another joint, or None
    doubt   oddity of its limits, in words, or ""
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    low: float | None
    high: float | None
    speed: float | None
    mimic: Mimic | None
    doubt: str = ""


@dataclass(frozen=True, eq=False)
class Robot:
    """Robot as a tree of links.

    file    the URDF
    root    name of the link without a parent
    links   solids of each link by name
    joints  by name
    bare    names of links that are visible, but have no solids
    """

    file: XmlFile
    root: str
    links: Mapping[str, tuple[Geometry, ...]]
    joints: Mapping[str, UrdfJoint]
    bare: frozenset[str]

    def ancestry(self, tip: str) -> list[UrdfJoint]:
        """Return the joints from the root to a link, in this order."""
        if tip not in self.links:
            raise self.file.error(
                f"it has no link {shown(tip)} for the tip.{did_you_mean(tip, self.links)} "
                f"Its links are {', '.join(map(shown, self.links))}"
            )
        above = {joint.child: joint for joint in self.joints.values()}
        found = []
        while tip in above:
            found.append(above[tip])
            tip = above[tip].parent
        return found[::-1]


def read_urdf(path: str | os.PathLike[str]) -> Robot:
    """Return the robot of a URDF; ModelError for any other file, and for one that exceeds the bounds."""
    file = XmlFile(path, "URDF", "robot")
    file.refuse_xacro("arm.urdf")
    links, bare = {}, set()
    if file.root.find("link") is None:
        semantic = any(file.root.find(tag) is not None for tag in ("group", "group_state", "disable_collisions"))
        what = (
            "it is an SRDF: it has groups, states or pairs of links, but no <link>" if semantic else "it has no <link>"
        )
        raise file.error(f"{what}; give the URDF, which has the links and joints")
    for element in file.root.findall("link"):
        name = file.name(element)
        if name in links:
            raise file.error(f"two links are called {shown(name)}")
        links[name] = tuple(_geometries(file, name, element))
        if not links[name] and element.find("visual") is not None:
            bare.add(name)
    joints = {}
    for element in file.root.findall("joint"):
        joint = _joint(file, element)
        if joint.name in joints:
            raise file.error(f"two joints are called {shown(joint.name)}")
        for end in (joint.parent, joint.child):
            if end not in links:
                raise file.error(f"joint {shown(joint.name)} names the link {shown(end)}, which does not exist")
        joints[joint.name] = joint
    if len(links) > MOST_LINKS:
        raise file.error(f"expected at most {MOST_LINKS:,} links, found {len(links):,}")
    return Robot(file, _root(file, links, joints), links, joints, frozenset(bare))


def _root(file: XmlFile, links: Mapping[str, object], joints: Mapping[str, UrdfJoint]) -> str:
    """Return the one link without a parent, from which joints lead to every other link."""
    above: dict[str, UrdfJoint] = {}
    for joint in joints.values():
        if joint.child in above:
            raise file.error(
                f"the link {shown(joint.child)} has two parent joints, {shown(above[joint.child].name)} and "
                f"{shown(joint.name)}; arms with closed loops are not supported"
            )
        above[joint.child] = joint
    roots = [link for link in links if link not in above]
    if not roots:
        raise file.error(
            f"each link has a parent, so the joints form a circle, {_circle(above, next(iter(links)))}; the root link "
            "of an arm must not be the child of a joint"
        )
    if len(roots) > 1:
        named = ", ".join(map(shown, roots[:8]))
        raise file.error(f"expected one link without a parent joint, found {len(roots)}: {named}")
    reached, below = set[str](), dict[str, list[str]]()
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint.child)
    rest = [roots[0]]
    while rest:
        link = rest.pop()
        reached.add(link)
        rest += below.get(link, [])
    if lost := [link for link in links if link not in reached]:
        raise file.error(
            f"{len(lost)} links are not joined to {shown(roots[0])}, but to each other in a circle, "
            f"{_circle(above, lost[0])}"
        )
    return roots[0]


def _circle(above: Mapping[str, UrdfJoint], link: str) -> str:
    """Return, as text, the links of a circle that contains a link, from parent to child."""
    passed: list[str] = []
    while link not in passed:
        passed.append(link)
        link = above[link].parent
    circle = [*passed[passed.index(link) :], link][::-1]
    return " > ".join(map(shown, circle if len(circle) <= MOST_SHOWN else [*circle[: MOST_SHOWN - 1], circle[-1]]))


def _joint(file: XmlFile, element: Element) -> UrdfJoint:
    name, kind = file.name(element), element.get("type")
    what = f"joint {shown(name)}"
    if kind not in KINDS:
        raise file.error(f"{what} must be one of {', '.join(KINDS)}, got {shown(kind)}")
    ends = [element.find(end) for end in ("parent", "child")]
    if any(end is None for end in ends):
        raise file.error(f"{what} needs a <parent link=...> and a <child link=...>")
    parent, child = (file.name(end, "link") for end in ends if end is not None)
    limit, mimic, direction = (element.find(tag) for tag in ("limit", "mimic", "axis"))
    bounds = {
        key: file.number(f"the {key} limit of {what}", limit.get(key)) if limit is not None and limit.get(key) else None
        for key in ("lower", "upper", "velocity")
    }
    if limit is not None and kind in ("revolute", "prismatic"):  # missing attributes are 0
        bounds |= {key: bounds[key] or 0.0 for key in ("lower", "upper")}
    soft, doubt = element.find("safety_controller"), ""
    if soft is not None and kind in ("revolute", "prismatic"):
        within = _soft_limits(file, what, soft, bounds)
        if None not in within.values() and within["lower"] >= within["upper"]:  # type: ignore[operator]  # not None
            doubt = f"the soft limits of {what} exclude all values within its limits, and are ignored"
        else:
            bounds |= within
    axis = np.array([1.0, 0.0, 0.0])
    if direction is not None and kind not in ("fixed", "floating"):
        axis = file.numbers(f"the axis of {what}", direction.get("xyz"), 3)
        length = float(np.linalg.norm(axis))
        if length < LEAST:
            raise file.error(f"the axis of {what} must be a direction, got {shown(direction.get('xyz'))}")
        axis = np.array([exact(float(part) / length) for part in axis])
    follows = None
    if mimic is not None and kind != "fixed":
        factor, offset = (
            file.number(f"the {key} of {what}", mimic.get(key, otherwise))
            for key, otherwise in (("multiplier", "1"), ("offset", "0"))
        )
        follows = Mimic(file.name(mimic, "joint"), factor, offset)
    origin = _pose(file, what, element)
    low, high, speed = (bounds[key] for key in ("lower", "upper", "velocity"))
    return UrdfJoint(name, kind, parent, child, origin, axis, low, high, speed, follows, doubt)


def _soft_limits(file: XmlFile, what: str, soft: Element, hard: Mapping[str, float | None]) -> dict[str, float | None]:
    """Return the tighter of the hard limits and those of a safety_controller, as in MoveIt.

    A missing attribute sets no limit.
    """
    given = {
        key: file.number(f"the soft {key} limit of {what}", text)
        for key in ("lower", "upper")
        if (text := soft.get(f"soft_{key}_limit"))
    }
    low = max((value for value in (given.get("lower"), hard["lower"]) if value is not None), default=None)
    high = min((value for value in (given.get("upper"), hard["upper"]) if value is not None), default=None)
    return {"lower": low, "upper": high}


def _pose(file: XmlFile, what: str, element: Element) -> FloatArray:
    """Return the pose of an element's origin; the identity without an origin."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = (file.numbers(f"the origin {key} of {what}", origin.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
    return pose_of(xyz, rpy)


def _geometries(file: XmlFile, link: str, element: Element) -> Iterator[Geometry]:
    what = f"the collision geometry of link {shown(link)}"
    for collision in element.findall("collision"):
        geometry = collision.find("geometry")
        shapes = [] if geometry is None else list(geometry)
        if len(shapes) != 1:
            raise file.error(f"{what} needs one shape, found {len(shapes)}")
        yield Geometry(_shape(file, link, what, shapes[0]), _pose(file, what, collision))


def _shape(file: XmlFile, link: str, what: str, element: Element) -> Shape | UrdfMesh:
    def lengths(attribute: str, count: int = 1) -> list[float]:
        found = file.numbers(f"the {attribute} of {what}", element.get(attribute), count)
        if (found < LEAST).any():
            raise file.error(f"the {attribute} of {what} must be above 0 m, got {shown(element.get(attribute))}")
        return [float(length) for length in found]

    match element.tag:
        case "box":
            x, y, z = lengths("size", 3)
            return Box((x, y, z))
        case "cylinder":
            return Cylinder(*lengths("radius"), *lengths("length"))
        case "sphere":
            return Sphere(*lengths("radius"))
        case "mesh":
            scale = file.numbers(f"the scale of {what}", element.get("scale", "1 1 1"), 3)
            if (np.abs(scale) < LEAST).any():
                raise file.error(f"the scale of {what} must not be 0, got {shown(element.get('scale'))}")
            return UrdfMesh(link, file.name(element, "filename"), scale)
    raise file.error(f"{what} must be a box, cylinder, sphere or mesh, got <{printable(element.tag)[:80]}>")


@dataclass(frozen=True, eq=False)
class Semantics:
    """Contents of an SRDF.

    file      the SRDF
    states    values of joints, rad or m, by the name of the state; "group/name" where groups differ in a name
    groups    names of the groups that it defines
    grouped   state and group of each set of values
    loose     names of joints that place the robot in the world, which no URDF has
    passive   joints that are not driven
    disabled  pairs of links without collision test (they never collide, or always), each in alphabetical order
    lonely    links without collision tests, except for the pairs in ``enabled``
    enabled   pairs of links with a collision test in spite of ``lonely``
    """

    file: XmlFile
    states: Mapping[str, Mapping[str, float]]
    groups: frozenset[str]
    grouped: frozenset[tuple[str, str]]
    loose: frozenset[str]
    passive: frozenset[str]
    disabled: frozenset[Pair]
    lonely: frozenset[str]
    enabled: frozenset[Pair]

    def apart(self, links: list[str]) -> frozenset[Pair]:
        """Return all pairs among links that need no collision test."""
        pairs = {pair_of(link, other) for link in self.lonely for other in links if link != other}
        return (frozenset(pairs) - self.enabled) | self.disabled


def read_srdf(path: str | os.PathLike[str]) -> Semantics:
    """Return the contents of an SRDF; ModelError for another file."""
    file = XmlFile(path, "SRDF", "robot")
    file.refuse_xacro("arm.srdf")
    root = file.root
    if root.find("link") is not None:
        raise file.error("it is a URDF, because it has links; an SRDF has groups, named states, and pairs of links")
    disabled, enabled = (
        frozenset(pair_of(file.name(pair, "link1"), file.name(pair, "link2")) for pair in root.findall(tag))
        for tag in ("disable_collisions", "enable_collisions")
    )
    lonely = frozenset(file.name(one, "link") for one in root.findall("disable_default_collisions"))
    groups, loose, passive = (
        frozenset(map(file.name, root.findall(tag))) for tag in ("group", "virtual_joint", "passive_joint")
    )
    grouped = frozenset((file.name(state), file.name(state, "group")) for state in root.findall("group_state"))
    return Semantics(file, _states(file, root), groups, grouped, loose, passive, disabled, lonely, enabled)


def _states(file: XmlFile, root: Element) -> dict[str, dict[str, float]]:
    """Return joint values by state name, or by "group/name" if groups differ in the state."""
    states: dict[str, dict[str, float]] = {}
    groups: dict[str, dict[str, dict[str, float]]] = {}
    for state in root.findall("group_state"):
        name, group = file.name(state), file.name(state, "group")
        values = {}
        for joint in state.findall("joint"):
            given = joint.get("value") or ""
            if len(given.split()) == 1:  # joints of a chain have one degree of freedom
                what = f"the value of joint {file.name(joint)!r} in the state {name!r}"
                values[file.name(joint)] = file.number(what, given)
        groups.setdefault(name, {})[group] = values
    for name, by_group in groups.items():
        merged: dict[str, float] = {}
        agree = all(merged.setdefault(joint, v) == v for values in by_group.values() for joint, v in values.items())
        named = {name: merged} if agree else {f"{group}/{name}": values for group, values in by_group.items()}
        states.update(named)
    return states
