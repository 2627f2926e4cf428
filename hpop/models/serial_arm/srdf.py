"""What an SRDF adds to a URDF: states with a name, and pairs of links whose collisions are not looked at.

http://wiki.ros.org/srdf
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from hpop.models.serial_arm.xml import XmlFile

Pair = tuple[str, str]


@dataclass(frozen=True, eq=False)
class Semantics:
    """What an SRDF says.

    states    values of joints, rad or m, by the name of the state; "group/name" where groups differ in a name
    groups    names of the groups that it defines
    grouped   the state and the group of each set of values
    loose     names of joints by which it says that the robot stands in the world: no URDF has those
    disabled  pairs of links that never collide, or always do, each in alphabetical order
    passive   joints that it says are not driven
    lonely    links whose collisions with any other are not looked at, but for the pairs in ``enabled``
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
        """All pairs among links whose collisions are not looked at."""
        pairs = {pair_of(link, other) for link in self.lonely for other in links if link != other}
        return (frozenset(pairs) - self.enabled) | self.disabled


def pair_of(a: str, b: str) -> Pair:
    """A pair in alphabetical order."""
    return (a, b) if a < b else (b, a)


def read_srdf(path: str | os.PathLike[str]) -> Semantics:
    """What is in an SRDF; ModelError for what is none."""
    file = XmlFile(path, "SRDF", "robot")
    file.refuse_xacro("arm.srdf")
    root = file.root
    if root.find("link") is not None:
        raise file.error("it is a URDF, for it has links; an SRDF has groups, states by name, and pairs of links")
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
    """Values of joints by the name of the state, of all groups that have it if they agree."""
    states: dict[str, dict[str, float]] = {}
    groups: dict[str, dict[str, dict[str, float]]] = {}
    for state in root.findall("group_state"):
        name, group = file.name(state), file.name(state, "group")
        values = {}
        for joint in state.findall("joint"):
            given = joint.get("value") or ""
            if len(given.split()) == 1:  # a joint of several degrees of freedom is none of a chain
                what = f"the value of joint {file.name(joint)!r} in the state {name!r}"
                values[file.name(joint)] = file.number(what, given)
        groups.setdefault(name, {})[group] = values
    for name, by_group in groups.items():
        merged: dict[str, float] = {}
        agree = all(merged.setdefault(joint, v) == v for values in by_group.values() for joint, v in values.items())
        named = {name: merged} if agree else {f"{group}/{name}": values for group, values in by_group.items()}
        states.update(named)
    return states
