"""Chain of joints from the base of an arm to its tip: frames, solids and levers; enlarged links; objects in the hand.

Obstacles have to avoid links enlarged by the arm's padding and by the rules of a scene. Boxes, cylinders and spheres
are enlarged as MoveIt does it: scaled, and each surface moved outwards by the padding. A hull is scaled about the mean
of its corners, and a ball with the padding as its radius is added to it. So the enlarged link contains all points
within the padding of the scaled link. Links are tested with each other as they are.

Objects that an arm holds are solids attached to a link, with the bodies that they may touch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, frozen
from hpop.base.options import Degrees
from hpop.base.text import shown
from hpop.errors import MapError, ModelError, did_you_mean
from hpop.models import serial_arm
from hpop.motions import States
from hpop.world.bodies import MOST_ATTACHED, LinkRules
from hpop.world.geometry.solids import Box, Cylinder, Hull, Shape, Solid, Sphere, pose_at

if TYPE_CHECKING:
    from hpop.world.geometry.solids import Solid

MANY = 256
"""States from which on poses are computed by a compiled kernel."""

Pair = tuple[str, str]
"""Names of two links, in alphabetical order."""


def pair_of(a: str, b: str) -> Pair:
    """Return the names of two links as a pair in alphabetical order."""
    return (a, b) if a < b else (b, a)


class FrameMount(NamedTuple):
    """Position of a body, the tool or the camera, on a chain of joints.

    frame  number of the frame that carries the body: frame 0 is fixed, frame i moves with joint i
    pose   (4, 4)  of the body in that frame; x ahead, y left, z up
    """

    frame: int
    pose: FloatArray


@dataclass(frozen=True, eq=False)
class Chain:
    """Chain of the n moving joints of an arm, from base to tip.

    Frame 0 is the world. Frame i = 1..n moves with joint i. The origin of the first joint includes the pose of the
    arm's base in the world.

    names         names of the n joints
    sliding       (n,)       True for prismatic joints; all others turn
    turning       (n,)       True for continuous joints, which have no limits and for which 2 pi is a whole turn
    axes          (n, 3)     unit vectors of the joint axes, each in its joint's frame
    origins       (n, 4, 4)  frame of each joint at value 0, in the frame of the joint before; the first in the world
    low           (n,)       rad or m, lower limits; -pi for a continuous joint
    high          (n,)       rad or m, upper limits; pi for a continuous joint
    speed         (n,)       rad/s or m/s, largest speeds
    acceleration  (n,)       rad/s² or m/s², largest accelerations
    mounts        positions of the bodies "tool" and "camera" on the chain
    """

    names: tuple[str, ...]
    sliding: BoolArray
    turning: BoolArray
    axes: FloatArray
    origins: FloatArray
    low: FloatArray
    high: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    mounts: Mapping[str, FrameMount] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = ("sliding", "turning", "axes", "origins", "low", "high", "speed", "acceleration")
        for name in arrays:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class ArmPart:
    """Collision part of an arm: a solid on one of its links.

    link     name of the link
    frame    number, 0 to n, of the frame that carries the solid
    solid    shape of the solid, and its pose in that frame
    padding  m, distance that the link keeps from obstacles, in addition to the usual distance
    touches  names of obstacles that it may touch
    """

    link: str
    frame: int
    solid: Solid
    padding: float = 0.0
    touches: frozenset[str] = frozenset()


def frames(chain: Chain, states: States) -> list[FloatArray]:
    """Return the poses in the world (N, 4, 4) of the frames 0 to n in each of N states; not for CasADi symbols."""
    found = [np.broadcast_to(np.eye(4), (states.size, 4, 4))]
    for name, sliding, axis, origin in zip(chain.names, chain.sliding, chain.axes, chain.origins, strict=True):
        value = np.broadcast_to(getattr(states, name), (states.size,))
        found.append(found[-1] @ origin @ (_slide_poses if sliding else _rotation_poses)(axis, value))
    return found


def placed_parts(chain: Chain, parts: Sequence[ArmPart], states: States) -> list[tuple[Shape, FloatArray]]:
    """Return the shapes of parts and their poses in the world (N, 4, 4) in each of N states; not for CasADi symbols."""
    if states.size <= MANY:
        found = frames(chain, states)
        return [(part.solid.shape, found[part.frame] @ part.solid.pose) for part in parts]
    poses = np.empty((len(parts), states.size, 4, 4))
    offsets = np.array([part.solid.pose for part in parts], np.float64).reshape(-1, 4, 4)
    numbers = np.array([part.frame for part in parts], np.int64)
    values = np.array([np.broadcast_to(getattr(states, name), (states.size,)) for name in chain.names], np.float64)
    joints = (np.ascontiguousarray(array) for array in (chain.origins, chain.axes, chain.sliding))
    serial_arm.postures.place_bodies(*joints, values, numbers, offsets, poses)
    return [(part.solid.shape, pose) for part, pose in zip(parts, poses, strict=True)]


def _slide_poses(axis: FloatArray, way: FloatArray) -> FloatArray:
    """Return translations by distances ``way`` (N,), m, along an axis, as poses (N, 4, 4)."""
    poses: FloatArray = np.tile(np.eye(4), (way.size, 1, 1))
    poses[:, :3, 3] = way[:, None] * axis
    return poses


def _rotation_poses(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Return rotations by angles (N,), rad, about an axis, as poses (N, 4, 4), by the formula of Rodrigues."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    poses: FloatArray = np.tile(np.eye(4), (angle.size, 1, 1))
    poses[:, :3, :3] += sine * skew + rest * (skew @ skew)
    return poses


def levers(chain: Chain) -> FloatArray:
    """Return upper bounds (n,) on how far tool and camera move, m, per rad or m by which each joint moves.

    For a turning joint the bound is the distance of the next joint from its axis, plus the lengths of all later links,
    slides extended. A sliding joint moves all links after it by the distance that it slides, so its bound is 1.
    """
    n = len(chain)
    lengths = np.zeros(n)  # of the step to each joint's frame, slides included
    for i in range(n):
        slide = max(abs(chain.low[i]), abs(chain.high[i])) if chain.sliding[i] else 0.0
        lengths[i] = np.linalg.norm(chain.origins[i][:3, 3]) + slide
    farthest = max((float(np.linalg.norm(mount.pose[:3, 3])) for mount in chain.mounts.values()), default=0.0)
    found = np.ones(n)
    for i in range(n):
        if chain.sliding[i]:
            continue
        steps = [chain.origins[i + 1][:3, 3]] if i + 1 < n else [mount.pose[:3, 3] for mount in chain.mounts.values()]
        aside = max((float(np.linalg.norm(np.cross(chain.axes[i], step))) for step in steps), default=0.0)
        if i + 1 < n:
            slide = lengths[i + 1] - float(np.linalg.norm(chain.origins[i + 1][:3, 3]))
            aside += slide + lengths[i + 2 :].sum() + farthest
        found[i] = aside
    return found


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
    """Return a shape enlarged by scale and padding, and the padding, m, that it does not contain yet.

    Boxes, cylinders and spheres contain the whole padding. The corners of a hull are only scaled, so its whole padding
    remains: the collision test adds it to distances.
    """
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

    Other pairs of ``apart`` are tested if the rules name them as pairs that must not touch. Pairs that the rules allow
    to touch are not tested.
    """
    if not rules:
        return apart
    links = sorted({part.link for part in parts})
    allowed = {pair_of(a, b) for i, a in enumerate(links) for b in links[:i] if rules.may_touch(a, b)}
    return frozenset(pair for pair in apart if pair in touching or rules.pairs.get(pair, True)) | allowed


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
