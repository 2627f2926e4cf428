"""Reader of a planning scene's rules for links: ``link_padding``, ``link_scale`` and ``allowed_collision_matrix``."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Any

from hpop.base.text import counted
from hpop.errors import MapError
from hpop.world.link_rules import LinkRules, Pair, padding_of, scale_of
from hpop.world.readers.moveit_entry import SceneEntry

MOST_NAMES = 1_000
"""Largest number of names in an allowed collision matrix, and of links that are padded or scaled."""
OCTOMAP = "<octomap>"
"""Name of the octomap in a matrix; scenes with an octomap are not read."""


def link_rules(scene: SceneEntry, before: LinkRules) -> LinkRules:
    """Return the rules of a message, given those of the messages ``before``, as MoveIt applies them.

    Padding and scale of links that the message names are replaced. Its matrix replaces the one before unless it is
    empty.
    """
    pairs, others = _matrix(scene.get("allowed_collision_matrix"))
    if not pairs and not others:
        pairs, others = dict(before.pairs), dict(before.others)
    padding = _numbers(scene.get("link_padding"), "padding", padding_of)
    scale = _numbers(scene.get("link_scale"), "scale", scale_of)
    return LinkRules({**before.padding, **padding}, {**before.scale, **scale}, pairs, others)


def rule_notes(scene: SceneEntry, rules: LinkRules, objects: Collection[str]) -> Iterator[str]:
    """Yield notes for the user on rules that change what an arm may do; ``objects`` are names of obstacles."""
    padded = [by for by in rules.padding.values() if by]
    scaled = [by for by in rules.scale.values() if by != 1.0]
    if padded:
        yield (
            f"{scene.what} pads {counted(len(padded), 'link')} by up to {max(padded):g} m (link_padding): an arm with "
            "links of these names keeps this distance from obstacles"
        )
    if scaled:
        yield (
            f"{scene.what} scales {counted(len(scaled), 'link')} by {min(scaled):g} to {max(scaled):g} (link_scale): "
            "links of these names are tested with obstacles at this size"
        )
    free = sorted({name for pair, may in rules.pairs.items() if may for name in pair if name in objects})
    free = sorted({*free, *(name for name, may in rules.others.items() if may and name in objects)})
    if free:
        listed = ", ".join(map(repr, free[:8])) + (", ..." if len(free) > 8 else "")
        yield (
            f"{scene.what} lets links touch obstacles, which are not tested with these links "
            f"(allowed_collision_matrix): {listed}"
        )


def _numbers(listed: SceneEntry, key: str, checked: Callable[[str, Any], float]) -> dict[str, float]:
    """Return the number of each link in ``link_padding`` or ``link_scale``."""
    return {
        part.get("link_name").name("a link"): checked(part.get(key).what, part.get(key).given)
        for part in listed.entries(MOST_NAMES)
    }


def _matrix(matrix: SceneEntry) -> tuple[dict[Pair, bool], dict[str, bool]]:
    """Return the entries of a matrix by pairs of names, and its default entries by name."""
    if matrix.given is None:
        return {}, {}
    names = [part.name("a link or an object") for part in matrix.get("entry_names").entries(MOST_NAMES)]
    rows = [_flags(row) for row in matrix.get("entry_values").entries(MOST_NAMES)]
    if [len(row) for row in rows] != [len(names)] * len(names):
        raise MapError(
            f"{matrix.what} must have a row of entry_values for each of its {len(names)} entry_names, with as many "
            f"values; got {len(rows)} rows of {', '.join(map(str, sorted({len(row) for row in rows})))} values."
        )
    pairs = {
        (min(one, other), max(one, other)): rows[i][j] and rows[j][i]
        for i, one in enumerate(names)
        for j, other in enumerate(names[:i])
        if OCTOMAP not in (one, other)
    }
    known = [part.name("a link or an object") for part in matrix.get("default_entry_names").entries(MOST_NAMES)]
    values = _flags(matrix.get("default_entry_values"))
    if len(known) != len(values):
        raise MapError(
            f"{matrix.what} must have one of default_entry_values for each of default_entry_names; got {len(known)} "
            f"names and {len(values)} values."
        )
    return pairs, {name: value for name, value in zip(known, values, strict=True) if name != OCTOMAP}


def _flags(row: SceneEntry) -> list[bool]:
    """Return a row of true and false, given as a list or as a mapping with the key "enabled"."""
    entries = (row.get("enabled") if isinstance(row.given, dict) else row).entries(MOST_NAMES)
    for part in entries:
        if part.given not in (True, False):
            raise part.fault("true or false")
    return [bool(part.given) for part in entries]
