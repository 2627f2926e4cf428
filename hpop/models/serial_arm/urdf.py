"""Reader of URDF and SRDF files: links, joints, named states, and pairs of links that need no collision test.

Only entries that planning needs are read. Of a link in a URDF, these are its ``collision`` elements. Of a joint, these
are its type, origin, axis, limits, soft limits (``safety_controller``) and the joint that it mimics.
http://wiki.ros.org/urdf/XML, http://wiki.ros.org/srdf
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
"""Largest number of links that a message about a circle of links names."""


MOVING = ("revolute", "prismatic", "continuous")


class UrdfMesh(NamedTuple):
    """Mesh file that a URDF names: the link, the name of the file as in the URDF, the scale (3,) of its coordinates."""

    link: str
    name: str
    scale: FloatArray


class Geometry(NamedTuple):
    """Collision solid of a link in a URDF.

    shape  a simple shape, or the mesh file that has it
    pose   (4, 4)  of the shape in the link's frame
    """

    shape: Shape | UrdfMesh
    pose: FloatArray


class Mimic(NamedTuple):
    """Rule by which a joint follows another joint: its value is that of ``joint``, times a factor, plus an offset."""

    joint: str
    factor: float
    offset: float


@dataclass(frozen=True, eq=False)
class UrdfJoint:
    """Joint of a URDF, between a parent link and a child link.

    kind    type of the joint, one of ``KINDS``
    parent, child  names of the links
    origin  (4, 4)  frame of the joint in the frame of the parent; at value 0 it is the frame of the child
    axis    (3,)    unit vector in the joint's frame
    low, high, speed  limits, None if missing in the file; soft limits replace them where they are tighter. Where a
            revolute or prismatic joint has a <limit> without lower or upper, these are 0
    mimic   rule by which the joint follows another joint, or None
    doubt   note for the user on contradictory limits, or ""
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
    """Contents of a URDF: a robot as a tree of links.

    file    the URDF
    root    name of the link without a parent
    links   collision solids of each link, by its name
    joints  joints by name
    bare    names of links that have visible geometry but no collision solids
    """

    file: XmlFile
    root: str
    links: Mapping[str, tuple[Geometry, ...]]
    joints: Mapping[str, UrdfJoint]
    bare: frozenset[str]

    def ancestry(self, tip: str) -> list[UrdfJoint]:
        """Return the joints on the way from the root link to the link ``tip``, in order."""
        if tip not in self.links:
            raise self.file.error(
                f"tip must be the name of one of its links, got {shown(tip)}.{did_you_mean(tip, self.links)} "
                f"Its links are {', '.join(map(shown, self.links))}"
            )
        above = {joint.child: joint for joint in self.joints.values()}
        found = []
        while tip in above:
            found.append(above[tip])
            tip = above[tip].parent
        return found[::-1]

    @property
    def farthest_tip(self) -> str:
        """Link after the most moving joints, none of them mimicking or mimicked; of several, after the most joints."""
        mimicked = {joint.mimic.joint for joint in self.joints.values() if joint.mimic is not None}

        def length(link: str) -> tuple[int, int]:
            joints = self.ancestry(link)
            moving = [joint for joint in joints if joint.kind in MOVING]
            usable = not any(joint.mimic is not None or joint.name in mimicked for joint in moving)
            return (len(moving), len(joints)) if usable else (-1, 0)

        return max(self.links, key=length)


def read_urdf(path: str | os.PathLike[str]) -> Robot:
    """Read a URDF file; ModelError if it is no URDF, contradicts itself or is too large."""
    file = XmlFile(path, "URDF", "robot")
    file.refuse_xacro("arm.urdf")
    links, bare = {}, set()
    if file.root.find("link") is None:
        semantic = any(file.root.find(tag) is not None for tag in ("group", "group_state", "disable_collisions"))
        what = (
            "it has no <link>, but groups, states or pairs of links: it is an SRDF" if semantic else "it has no <link>"
        )
        raise file.error(f"{what}; give the URDF as urdf, which has the links and joints")
    for element in file.root.findall("link"):
        name = file.name(element)
        if name in links:
            raise file.error(f"links must have different names, but two are called {shown(name)}; rename one")
        links[name] = tuple(_geometries(file, name, element))
        if not links[name] and element.find("visual") is not None:
            bare.add(name)
    joints = {}
    for element in file.root.findall("joint"):
        joint = _joint(file, element)
        if joint.name in joints:
            raise file.error(f"joints must have different names, but two are called {shown(joint.name)}; rename one")
        for end in (joint.parent, joint.child):
            if end not in links:
                raise file.error(
                    f"joint {shown(joint.name)} must join two links of the file, but {shown(end)} is none; add this "
                    f"<link>, or correct the name.{did_you_mean(end, links)}"
                )
        joints[joint.name] = joint
    if len(links) > MOST_LINKS:
        raise file.error(
            f"it must have at most {MOST_LINKS:,} links, got {len(links):,}; remove links that the arm does not need"
        )
    return Robot(file, _root(file, links, joints), links, joints, frozenset(bare))


def _root(file: XmlFile, links: Mapping[str, object], joints: Mapping[str, UrdfJoint]) -> str:
    """Return the root: the only link without a parent. ModelError unless joints lead from it to every other link."""
    above: dict[str, UrdfJoint] = {}
    for joint in joints.values():
        if joint.child in above:
            raise file.error(
                f"a link must be the child of at most one joint, but {shown(joint.child)} is that of "
                f"{shown(above[joint.child].name)} and {shown(joint.name)}; remove one, since closed loops of links "
                "are not supported"
            )
        above[joint.child] = joint
    roots = [link for link in links if link not in above]
    if not roots:
        raise file.error(
            "one link, the root, must not be the child of a joint, but the joints form a circle, "
            f"{_circle(above, next(iter(links)))}; remove one of its joints"
        )
    if len(roots) > 1:
        named = ", ".join(map(shown, roots[:8]))
        raise file.error(
            f"exactly one link must have no parent joint, got {len(roots)}: {named}; join the others by joints"
        )
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
            f"all links must be joined to the root {shown(roots[0])}, but {len(lost)} are not, because joints form a "
            f"circle, {_circle(above, lost[0])}; correct the parents of these joints"
        )
    return roots[0]


def _circle(above: Mapping[str, UrdfJoint], link: str) -> str:
    """Return the links of the circle to which a link leads, as text: "a > b > a", from parent to child."""
    passed: list[str] = []
    while link not in passed:
        passed.append(link)
        link = above[link].parent
    circle = [*passed[passed.index(link) :], link][::-1]
    return " > ".join(map(shown, circle if len(circle) <= MOST_SHOWN else [*circle[: MOST_SHOWN - 1], circle[-1]]))


def _joint(file: XmlFile, element: Element) -> UrdfJoint:
    """Read a <joint> element of a URDF; ModelError for invalid entries."""
    name, kind = file.name(element), element.get("type")
    what = f"joint {shown(name)}"
    if kind not in KINDS:
        raise file.error(f"the type of {what} must be one of {', '.join(KINDS)}, got {shown(kind)}")
    ends = [element.find(end) for end in ("parent", "child")]
    if any(end is None for end in ends):
        raise file.error(f"{what} must have <parent link=...> and <child link=...>, but lacks one of them; add it")
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
            raise file.error(f"the axis of {what} must not have length 0, got {shown(direction.get('xyz'))}")
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
    """Return a joint's limits, each the tighter of its <limit> (``hard``) and its <safety_controller> (``soft``).

    This is as in MoveIt. A missing attribute sets no limit.
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
    """Return the pose (4, 4) in an element's <origin>; the identity if it has none. ``what`` names it in an error."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    xyz, rpy = (file.numbers(f"the origin {key} of {what}", origin.get(key, "0 0 0"), 3) for key in ("xyz", "rpy"))
    return pose_of(xyz, rpy)


def _geometries(file: XmlFile, link: str, element: Element) -> Iterator[Geometry]:
    """Yield the collision solids of a <link> element."""
    what = f"the collision geometry of link {shown(link)}"
    for collision in element.findall("collision"):
        geometry = collision.find("geometry")
        shapes = [] if geometry is None else list(geometry)
        if len(shapes) != 1:
            raise file.error(f"{what} must have one shape in each <collision> element, got {len(shapes)}")
        yield Geometry(_shape(file, link, what, shapes[0]), _pose(file, what, collision))


def _shape(file: XmlFile, link: str, what: str, element: Element) -> Shape | UrdfMesh:
    """Read a shape in a <geometry> element; ModelError for unknown shapes and sizes of 0."""

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
    """Contents of an SRDF file.

    file      the SRDF
    states    values of joints, rad or m, by the name of the state; "group/name" if groups give a state other values
    groups    names of the groups of joints that the file defines
    grouped   (state, group) of each set of joint values
    loose     names of virtual joints, which place the robot in the world and are not in the URDF
    passive   names of joints that no motor drives
    disabled  pairs of links that need no collision test, because they never or always collide; alphabetical order
    lonely    links that need no collision test with any link, except for the pairs in ``enabled``
    enabled   pairs of links that do need a collision test although one of them is in ``lonely``
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
        """Return the pairs of links that need no collision test.

        These are pairs of a link in ``lonely`` and one of the given ``links``, except those in ``enabled``, and all
        pairs in ``disabled``, also those of other links.
        """
        pairs = {pair_of(link, other) for link in self.lonely for other in links if link != other}
        return (frozenset(pairs) - self.enabled) | self.disabled


def read_srdf(path: str | os.PathLike[str]) -> Semantics:
    """Read an SRDF file; ModelError if it is no SRDF."""
    file = XmlFile(path, "SRDF", "robot")
    file.refuse_xacro("arm.srdf")
    root = file.root
    if root.find("link") is not None:
        raise file.error(
            "it must be an SRDF (groups, named states, pairs of links), but it has links: it is a URDF; give it as urdf"
        )
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
    """Return the joint values of each named state in an SRDF, by its name.

    Groups that name the state are merged; if they contradict each other, each has its own state "group/name".
    """
    states: dict[str, dict[str, float]] = {}
    groups: dict[str, dict[str, dict[str, float]]] = {}
    for state in root.findall("group_state"):
        name, group = file.name(state), file.name(state, "group")
        values = {}
        for joint in state.findall("joint"):
            given = joint.get("value") or ""
            if len(given.split()) == 1:  # other joints have several degrees of freedom and are in no chain
                what = f"the value of joint {file.name(joint)!r} in the state {name!r}"
                values[file.name(joint)] = file.number(what, given)
        groups.setdefault(name, {})[group] = values
    for name, by_group in groups.items():
        merged: dict[str, float] = {}
        agree = all(merged.setdefault(joint, v) == v for values in by_group.values() for joint, v in values.items())
        named = {name: merged} if agree else {f"{group}/{name}": values for group, values in by_group.items()}
        states.update(named)
    return states
