"""Objects that an arm holds: solids attached to a link, with the bodies that they may touch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from hpop.base.options import Degrees
from hpop.base.text import shown
from hpop.errors import MapError, ModelError, did_you_mean
from hpop.world.bodies import MOST_ATTACHED
from hpop.world.geometry.solids import Box, Cylinder, Hull, Shape, Solid, Sphere, pose_at

SHAPES = ("box", "cylinder", "sphere", "hull")
KEYS = ("name", "link", *SHAPES, "position", "rpy", "touches")
FORM = (
    'attached must be a list of objects such as {"name": "can", "link": "hand", "cylinder": {"radius": 0.03, "length": '
    '0.12}, "position": (0, 0, 0.1), "touches": ["left_finger"]}, with one of box, cylinder, sphere and hull; '
)


class AttachedObject(NamedTuple):
    """Object that an arm holds.

    link     link that carries it
    solid    shape, name, and pose in the frame of the link
    touches  names of links and obstacles that it may touch
    spec     value of the option ``attached`` for this object, JSON-able
    """

    link: str
    solid: Solid
    touches: frozenset[str]
    spec: dict[str, Any]


def attached_objects(given: Any) -> list[AttachedObject]:
    """Check the option ``attached`` and return its objects; ModelError if one is malformed or two have one name."""
    if not isinstance(given, list | tuple) or len(given) > MOST_ATTACHED:
        raise ModelError(f"{FORM}at most {MOST_ATTACHED} objects; got {shown(given)}")
    found = [_object(each) for each in given]
    names = [each.solid.name for each in found]
    for name in names:
        if names.count(name) > 1:
            raise ModelError(
                f"attached objects must have different names, but two are called {shown(name)}; rename one"
            )
    return found


def _object(given: Any) -> AttachedObject:
    if not isinstance(given, Mapping):
        raise ModelError(f"{FORM}got {shown(given)}")
    for key in given:
        if key not in KEYS:
            raise ModelError(f"{FORM}got the key {shown(key)}.{did_you_mean(str(key), KEYS)}")
    kinds = [key for key in SHAPES if given.get(key) is not None]
    texts = [given.get("name"), given.get("link")]
    touches = given.get("touches", ())
    is_named = all(isinstance(text, str) and text for text in texts)
    if len(kinds) != 1 or not is_named or not isinstance(touches, list | tuple | set | frozenset):
        raise ModelError(f"{FORM}got {shown(dict(given))}")
    if not all(isinstance(name, str) for name in touches):
        raise ModelError(f"touches must be a list of names of links and obstacles, got {shown(touches)}")
    name, link = str(texts[0]), str(texts[1])
    try:
        position = list(given.get("position", (0.0, 0.0, 0.0)))
        rpy = [Degrees.in_radians(angle) for angle in given.get("rpy", (0.0, 0.0, 0.0))]
        solid = Solid(_shape(kinds[0], given[kinds[0]]), pose_at(position, rpy=rpy), name)
    except (MapError, TypeError) as error:
        raise ModelError(f"the attached object {shown(name)}: {error}") from None
    shape = {kinds[0]: solid.describe()[kinds[0]]}
    place = {"position": [float(value) for value in position], "rpy": [float(angle) for angle in rpy]}
    spec = {"name": name, "link": link, **shape, **place, "touches": sorted(touches)}
    return AttachedObject(link, solid, frozenset(touches), spec)


def _shape(kind: str, given: Any) -> Shape:
    match kind:
        case "box":
            return Box(tuple(given))
        case "cylinder":
            return Cylinder(**given)
        case "sphere":
            return Sphere(given)
    return Hull(given)
