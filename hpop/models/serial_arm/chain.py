"""Chain of joints from the base of an arm to its tip: its frames, its solid parts, and bounds on its motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, frozen
from hpop.motions import States

if TYPE_CHECKING:
    from hpop.world.geometry.solids import Solid

Pair = tuple[str, str]
"""Two names of links, in alphabetical order."""


def pair_of(a: str, b: str) -> Pair:
    """Return a pair of link names in alphabetical order."""
    return (a, b) if a < b else (b, a)


class FrameMount(NamedTuple):
    """Position of a body on a chain.

    frame  number of the frame that carries the body: 0 is fixed, frame n moves with joint n
    pose   (4, 4)  of the body in that frame; x ahead, y left, z up
    """

    frame: int
    pose: FloatArray


@dataclass(frozen=True, eq=False)
class Chain:
    """Chain of n joints that move, from base to tip.

    Frame 0 is fixed to the world; the pose of the base in the world is in the origin of the first joint. Frame i = 1..n
    moves with joint i; at value 0 it lies at the joint's origin.

    names         names of the n joints
    sliding       (n,)       whether each joint is prismatic; all others turn
    turning       (n,)       whether each joint is continuous: without limits, 2 pi is a whole turn
    axes          (n, 3)     unit vectors, each in its joint's frame
    origins       (n, 4, 4)  each joint's frame at value 0, in the frame of the joint before; the first in the world
    low           (n,)       rad or m, lower limits; -pi for a continuous joint
    high          (n,)       rad or m, upper limits
    speed         (n,)       rad/s or m/s, greatest speeds
    acceleration  (n,)       rad/s² or m/s², greatest accelerations
    mounts        positions of "tool" and "camera"
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
    """Solid that a link carries.

    link   name of the link
    frame  0 to n, the frame that carries the solid
    solid  shape of the solid, and its pose in that frame
    """

    link: str
    frame: int
    solid: Solid


def frames(chain: Chain, states: States) -> list[FloatArray]:
    """Return the poses (N, 4, 4) of frames 0 to n in each state; numbers only."""
    found = [np.broadcast_to(np.eye(4), (states.size, 4, 4))]
    for name, sliding, axis, origin in zip(chain.names, chain.sliding, chain.axes, chain.origins, strict=True):
        value = np.broadcast_to(getattr(states, name), (states.size,))
        found.append(found[-1] @ origin @ (_slide_poses if sliding else _rotation_poses)(axis, value))
    return found


def _slide_poses(axis: FloatArray, way: FloatArray) -> FloatArray:
    """Return the poses (N, 4, 4) of slides (N,), m, along an axis."""
    poses: FloatArray = np.tile(np.eye(4), (way.size, 1, 1))
    poses[:, :3, 3] = way[:, None] * axis
    return poses


def _rotation_poses(axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Return the poses (N, 4, 4) of rotations (N,), rad, about an axis (Rodrigues)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, rest = np.sin(angle)[:, None, None], (1.0 - np.cos(angle))[:, None, None]
    poses: FloatArray = np.tile(np.eye(4), (angle.size, 1, 1))
    poses[:, :3, :3] += sine * skew + rest * (skew @ skew)
    return poses


def levers(chain: Chain) -> FloatArray:
    """Return bounds (n,) on the distance, m, that any body moves per rad of a turning joint or per m of a sliding one.

    For a turning joint the bound is the sum of the lengths of all links that follow. A sliding joint moves all links
    that follow by the distance that it slides, so its bound is 1.
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
