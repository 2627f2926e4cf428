"""What is strange in the files of an arm though they can be used: said in notes, since it may be meant.

SRDFs are written for several variants of a robot, so what they name need not be there; a misspelt name looks the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from hpop.base.text import shown
from hpop.errors import did_you_mean
from hpop.models.serial_arm.srdf import Semantics
from hpop.models.serial_arm.urdf import Robot

MOST_NAMED = 8
"""Names that a note lists."""


def strangers(robot: Robot, semantics: Semantics) -> Iterator[str]:
    """What an SRDF names and neither the URDF nor the SRDF has: links, joints, groups."""
    links = {link for pair in semantics.disabled | semantics.enabled for link in pair} | semantics.lonely
    if strange := sorted(links - robot.links.keys()):
        yield _unknown("says which links never collide also of", strange, robot.links)
    joints = {joint for values in semantics.states.values() for joint in values} - semantics.loose
    if strange := sorted(joints - robot.joints.keys()):
        yield _unknown("gives, in states by name, values of the joints", strange, robot.joints)
    for state, group in sorted(semantics.grouped):
        if group not in semantics.groups:
            near = did_you_mean(group, semantics.groups)
            yield (
                f"the state {shown(state)} of the SRDF is one of the group {shown(group)}, which the SRDF does not "
                f"define.{near} It has {_listed(sorted(semantics.groups)) or 'none'}"
            )


def undriven(joints: Iterable[str], semantics: Semantics) -> Iterator[str]:
    """Joints between the root and the tip that the SRDF calls passive, and that are planned for as if they were not."""
    if passive := sorted(semantics.passive & {*joints}):
        yield (
            f"the SRDF says that the joints {_listed(passive)} are not driven (passive_joint), but the arm moves by "
            f"them: give where they stand in fixed, as {{{passive[0]}: 0.0}}"
        )


def pointless(robot: Robot) -> Iterator[str]:
    """Limits of joints that are strange, and left out."""
    yield from (joint.doubt for joint in robot.joints.values() if joint.doubt)


def uncovered(robot: Robot) -> Iterator[str]:
    """Links that nothing is known to collide with: those that can be seen, or all where none has a solid."""
    if not any(robot.links.values()):
        yield "no link of the URDF has <collision> geometry: nothing that the arm does is held against obstacles"
    elif bare := sorted(robot.bare):
        yield (
            f"the links {_listed(bare)} have <visual> but no <collision> geometry in the URDF: they are not held "
            "against obstacles"
        )


def _unknown(what: str, strange: list[str], known: Iterable[str]) -> str:
    """A note on names that the URDF does not have."""
    near = "".join(did_you_mean(name, known) for name in strange[:MOST_NAMED])
    return f"the SRDF {what} {_listed(strange)}, which the URDF does not have: is it another's?{near}"


def _listed(names: list[str]) -> str:
    more = [f"{len(names) - MOST_NAMED:,} more"] if len(names) > MOST_NAMED else []
    return ", ".join([*map(shown, names[:MOST_NAMED]), *more])
