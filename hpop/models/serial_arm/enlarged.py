"""Links of an arm as obstacles have to avoid them: enlarged by the arm's padding and by the rules of a scene.

Boxes, cylinders and spheres are enlarged as MoveIt does it: scaled, and each surface moved outwards by the padding. A
hull is scaled about the mean of its corners, and a ball with the padding as its radius is added to it. So the enlarged
link contains all points within the padding of the scaled link. Links are tested with each other as they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hpop.models.serial_arm.chain import ArmPart, Pair, pair_of
from hpop.world.bodies import LinkRules
from hpop.world.geometry.solids import Box, Cylinder, Hull, Shape, Sphere


def enlarged_parts(parts: Sequence[ArmPart], rules: LinkRules) -> dict[int, ArmPart]:
    """Return, by number, the parts that are enlarged; the padding of a result is a ball yet to be added to its solid.

    If arm and scene pad a link, the larger padding counts.
    """
    found = {}
    for number, part in enumerate(parts):
        scale, padding = rules.scale.get(part.link, 1.0), max(part.padding, rules.padding.get(part.link, 0.0))
        if scale != 1.0 or padding:
            shape, ball = _grown(part.solid.shape, scale, padding)
            found[number] = replace(part, solid=replace(part.solid, shape=shape), padding=ball)
    return found


def _grown(shape: Shape, scale: float, padding: float) -> tuple[Shape, float]:
    """Return an enlarged shape, and the radius, m, of a ball that is still to be added to it."""
    match shape:
        case Box(size=(x, y, z)):
            return Box((scale * x + 2 * padding, scale * y + 2 * padding, scale * z + 2 * padding)), 0.0
        case Cylinder(radius=radius, length=length):
            return Cylinder(scale * radius + padding, scale * length + 2 * padding), 0.0
        case Sphere(radius=radius):
            return Sphere(scale * radius + padding), 0.0
    middle = shape.points.mean(axis=0)
    return (shape if scale == 1.0 else Hull(middle + scale * (shape.points - middle))), padding


def pairs_apart(
    parts: Sequence[ArmPart], apart: frozenset[Pair], touching: frozenset[Pair], rules: LinkRules
) -> frozenset[Pair]:
    """Return the pairs of links that are not tested with each other in a scene with rules.

    apart     pairs that are not tested without rules
    touching  those of them that touch by design, and so stay untested

    Other pairs of ``apart`` are tested if the rules name them as pairs that must not touch.
    """
    if not rules:
        return apart
    links = sorted({part.link for part in parts})
    allowed = {pair_of(a, b) for i, a in enumerate(links) for b in links[:i] if rules.may_touch(a, b)}
    return frozenset(pair for pair in apart if pair in touching or rules.pairs.get(pair, True)) | allowed
