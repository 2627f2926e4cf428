"""Checks of a serial arm's options (paths, poses, mappings of names to numbers), and notes on oddities in its files.

An SRDF is often written for several variants of a robot, so links and joints that it names need not exist. Since a
misspelt name looks like such a name, both give a note.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.math import not_radians
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.errors import ModelError, did_you_mean
from hpop.models.files import is_record, path_of
from hpop.models.serial_arm.urdf import MOVING, Robot, Semantics, UrdfJoint
from hpop.models.serial_arm.xml import pose_of
from hpop.models.speeds import MOST_CLASSES
from hpop.world import World

FARTHEST = 1e4  # m: largest coordinate in the options `base` and `camera`
SLOWEST = 1e-6
LEAST_SCALING = 1e-3
ROUNDED = 5e-4
"""Tolerance, rad or m, for values that rounding has moved beyond a limit, such as 1.5708 for pi/2."""
WORDS = {"urdf": "URDF", "srdf": "SRDF"}


def path_text(name: str, given: Any) -> str:
    """Check the option ``name``, a path or the record of a file in a saved front, and return the path as text."""
    path = path_of(given, WORDS.get(name, name)) if is_record(given) else given
    if not isinstance(path, str | os.PathLike) or not os.fspath(path):
        raise ModelError(f"{name} must be the path of a file, got {shown(given)}")
    return str(os.fspath(path))


def pose_matrix(name: str, given: Any) -> FloatArray:
    """Check the option ``name``, (x, y, z, roll, pitch, yaw) in m and rad, and return it as a pose (4, 4)."""
    try:
        numbers = [
            real(name, number, -FARTHEST, FARTHEST, "x, y, z, m, and roll, pitch, yaw, rad,", error=ModelError)
            for number in given
        ]
    except TypeError:
        numbers = []
    if len(numbers) != 6:
        raise ModelError(f"{name} must be (x, y, z, roll, pitch, yaw) in m and rad, got {shown(given)}")
    for angle in numbers[3:]:
        if advice := not_radians(angle):
            raise ModelError(f"an angle of {name} {advice}")
    return pose_of(np.array(numbers[:3]), np.array(numbers[3:]))


def checked_mapping(name: str, given: Any, what: str) -> dict[str, Any]:
    """Check the option ``name``, a mapping with names as keys, and return it as a dict.

    ``what`` says for messages what the values are.
    """
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise ModelError(f"{name} must map names to {what}, as {{'name': ...}}, got {shown(given)}")
    return dict(given)


def checked_numbers(name: str, given: Any, least: float, what: str, most: float = MOST) -> dict[str, float]:
    """Check the option ``name``, which maps names to numbers from ``least`` to ``most``, and return it as a dict."""
    named = checked_mapping(name, given, what)
    return {key: float(real(f"{name} of {key}", value, least, most, error=ModelError)) for key, value in named.items()}


def checked_shares(given: Any) -> tuple[float, ...]:
    """Check the option ``velocity_scaling`` and return it as a tuple: one share of the joint speeds, or rising shares.

    Each share is from ``LEAST_SCALING`` to 1. Shares that do not rise raise ModelError; they are not sorted.
    """
    several = tuple(given) if isinstance(given, list | tuple) else (given,)
    kind = "a share of the speeds" if len(several) == 1 else "a share of the speeds, or a list of rising shares, each"
    shares = tuple(float(real("velocity_scaling", each, LEAST_SCALING, 1, kind, error=ModelError)) for each in several)
    if not 1 <= len(shares) <= MOST_CLASSES or any(b <= a for a, b in pairwise(shares)):
        raise ModelError(
            f"velocity_scaling must be a share of the speeds, or a list of up to {MOST_CLASSES} rising shares, got "
            f"{shown(given)}; sort them, and give each once"
        )
    return shares


def check_touches(attached: Iterable[Mapping[str, Any]], links: Iterable[str], world: World) -> None:
    """Raise ModelError if an attached object may touch something that is no link, attached object or obstacle."""
    known = {*links, *(each["name"] for each in attached)}
    for each in attached:
        if strange := [name for name in each.get("touches", ()) if name not in known]:
            known |= {solid.name for solid in world.bodies}
            strange = [name for name in strange if name not in known]
        if strange:
            raise ModelError(
                f"touches of the attached object {shown(each['name'])} must be names of links, attached objects or "
                f"obstacles, got {shown(strange[0])}; there are {_names_text(sorted(known), MOST_KNOWN)}."
                + did_you_mean(strange[0], known)
            )


MOST_KNOWN = 40
"""Largest number of names in an error."""
MOST_NAMED = 8
"""Largest number of names in a note."""


def unknown_name_notes(robot: Robot, semantics: Semantics) -> Iterator[str]:
    """Yield a note for the user on links, joints and groups that an SRDF names, but that are defined nowhere."""
    links = {link for pair in semantics.disabled | semantics.enabled for link in pair} | semantics.lonely
    if strange := sorted(links - robot.links.keys()):
        yield _unknown_note("lists pairs of links with", strange, robot.links)
    joints = {joint for values in semantics.states.values() for joint in values} - semantics.loose
    for what, named in (("has named states with values for", joints), ("calls passive", semantics.passive)):
        if strange := sorted(named - robot.joints.keys()):
            yield _unknown_note(f"{what} the joints", strange, robot.joints)
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


def _names_text(names: list[str], most: int = MOST_NAMED) -> str:
    """Return names as text, separated by commas; after the first ones, only the number of the others."""
    more = [f"{len(names) - most:,} more"] if len(names) > most else []
    return ", ".join([*map(shown, names[:most]), *more])


def check_moves(robot: Robot, joint: UrdfJoint) -> None:
    """Raise ModelError for a joint between root and tip that an arm cannot have, such as one that mimics another."""
    way_out = f"if it does not move, give its value in fixed, as {{{joint.name}: 0.0}}; or give another tip"
    if joint.kind not in MOVING:
        raise robot.file.error(
            f"joints between the root and the tip must be fixed, {', '.join(MOVING)}, but joint {shown(joint.name)} "
            f"is {joint.kind}; {way_out}"
        )
    if joint.mimic is not None:
        raise robot.file.error(
            f"joints between the root and the tip must move independently, but joint {shown(joint.name)} mimics "
            f"{shown(joint.mimic.joint)}; {way_out}"
        )


def check_within(robot: Robot, joint: UrdfJoint, value: float) -> None:
    """Raise ModelError if a joint is fixed at a value, rad or m, beyond its limits by more than rounding."""
    low, high = joint.low, joint.high
    if joint.kind not in ("revolute", "prismatic") or low is None or high is None or low >= high:
        return
    if not low - ROUNDED <= value <= high + ROUNDED:
        unit = "m" if joint.kind == "prismatic" else "rad"
        raise robot.file.error(
            f"fixed must give joint {shown(joint.name)} a value within its limits, {low:.6g} to {high:.6g} {unit}, got "
            f"{value:.6g}; correct the value, or the limits in the URDF"
        )
