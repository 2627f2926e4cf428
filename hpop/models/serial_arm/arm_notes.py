"""Notes on an arm: sentences for the user on oddities in its files.

An SRDF is often written for several variants of a robot, so links and joints that it names need not exist. Since a
misspelt name looks like such a name, both give a note.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from hpop.base.text import shown
from hpop.errors import did_you_mean
from hpop.models.serial_arm.urdf import Robot, Semantics

MOST_NAMED = 8
"""Largest number of names in a note."""


def unknown_name_notes(robot: Robot, semantics: Semantics) -> Iterator[str]:
    """Yield a note for the user on links, joints and groups that an SRDF names, but that are defined nowhere."""
    links = {link for pair in semantics.disabled | semantics.enabled for link in pair} | semantics.lonely
    if strange := sorted(links - robot.links.keys()):
        yield _unknown_note("lists pairs of links with", strange, robot.links)
    joints = {joint for values in semantics.states.values() for joint in values} - semantics.loose
    if strange := sorted(joints - robot.joints.keys()):
        yield _unknown_note("has named states with values for the joints", strange, robot.joints)
    for state, group in sorted(semantics.grouped):
        if group not in semantics.groups:
            near = did_you_mean(group, semantics.groups)
            yield (
                f"the named state {shown(state)} of the SRDF belongs to the group {shown(group)}, which the SRDF does "
                f"not define.{near} Its groups: {_names_text(sorted(semantics.groups)) or 'none'}"
            )


def passive_joint_notes(joints: Iterable[str], semantics: Semantics) -> Iterator[str]:
    """Yield a note for the user on joints of the arm that the SRDF calls passive (not driven by a motor)."""
    if passive := sorted(semantics.passive & {*joints}):
        yield (
            f"the SRDF says that no motor drives the joints {_names_text(passive)} (passive_joint), but they are "
            f"planned to move: give their values in fixed, as {{{passive[0]}: 0.0}}"
        )


def invalid_limit_notes(robot: Robot) -> Iterator[str]:
    """Yield a note for the user on each joint whose soft limits are ignored, because they contradict its limits."""
    yield from (joint.doubt for joint in robot.joints.values() if joint.doubt)


def missing_collision_notes(robot: Robot) -> Iterator[str]:
    """Yield a note for the user on links that are not tested for collisions, because they have no geometry for it."""
    if not any(robot.links.values()):
        yield "no link of the URDF has <collision> geometry: motions of the arm are not checked for collisions"
    elif bare := sorted(robot.bare):
        yield (
            f"the links {_names_text(bare)} have <visual> but no <collision> geometry in the URDF: they are not "
            "checked for collisions"
        )


def _unknown_note(what: str, strange: list[str], known: Iterable[str]) -> str:
    """Return a note on names in the SRDF that the URDF does not have; ``what`` says where the SRDF uses them."""
    near = "".join(did_you_mean(name, known) for name in strange[:MOST_NAMED])
    return (
        f"the SRDF {what} {_names_text(strange)}, which the URDF does not have: is it the SRDF of another robot?{near}"
    )


def _names_text(names: list[str]) -> str:
    """Return names as text, separated by commas; after eight names, only the number of the others."""
    more = [f"{len(names) - MOST_NAMED:,} more"] if len(names) > MOST_NAMED else []
    return ", ".join([*map(shown, names[:MOST_NAMED]), *more])
