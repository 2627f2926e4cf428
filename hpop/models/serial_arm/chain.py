"""The chain of joints from the base of an arm to its tip, and the solid parts that it carries."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from hpop.base.arrays import BoolArray, FloatArray, frozen

if TYPE_CHECKING:
    from hpop.world.geometry.solids import Solid


class Mount(NamedTuple):
    """Where a body is on a chain.

    frame  0, which stands, to n, which moves with joint n
    pose   (4, 4)  in that frame; x ahead, y left, z up
    """

    frame: int
    pose: FloatArray


@dataclass(frozen=True, eq=False)
class Chain:
    """The n joints that move, from base to tip.

    Frame 0 is fixed to the world; the pose of the base in the world is in the origin of the first joint. Frame i = 1..n
    moves with joint i; where the joint is at 0 it lies at the joint's origin.

    names         n of them
    sliding       (n,)       prismatic joints; the others turn
    turning       (n,)       joints without limits (continuous), in which 2 pi is a whole turn
    axes          (n, 3)     unit vectors, each in its joint's frame
    origins       (n, 4, 4)  each joint's frame at value 0, in the frame of the joint before; the first in the world
    low           (n,)       rad or m; of a joint without limits -pi
    high          (n,)       rad or m
    speed         (n,)       rad/s or m/s, the greatest
    acceleration  (n,)       rad/s² or m/s², the greatest
    mounts        "tool" and "camera", where they are
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
    mounts: Mapping[str, Mount] = field(default_factory=dict)

    def __post_init__(self) -> None:
        arrays = ("sliding", "turning", "axes", "origins", "low", "high", "speed", "acceleration")
        for name in arrays:
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.names)


@dataclass(frozen=True, eq=False)
class Part:
    """A solid that a link carries.

    link   its name
    frame  0 to n, with which it moves
    solid  its shape and its pose in that frame
    """

    link: str
    frame: int
    solid: Solid
