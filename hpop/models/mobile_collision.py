"""Collision tests of a mobile base with an arm: of the base in the plane, and of the arm's links in space.

The base is tested with obstacles, keep-out zones and the border of the map, as without an arm. Links are tested with
the solids of the world, with each other and with the base. For them, base and arm form one chain, whose first joints
are x, y and yaw. Straight moves, turns in place and reaches change these joints linearly, so the proofs for an arm's
motions hold for all of them. Here is also the check that an arm and a base can form a mobile arm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.registry import with_optional_members
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.base import PlanarModel
from hpop.models.collision import Part as Prism
from hpop.models.serial_arm import SerialArm
from hpop.models.serial_arm.chain import ArmPart, Chain, FrameMount, Pair, pair_of
from hpop.models.serial_arm.collision import ArmCollision, always_touching
from hpop.models.serial_arm.judge import ArmJudge
from hpop.models.serial_arm.keep import SLACK, KeepingCollision, KeepingJudge, KeptAxis
from hpop.models.serial_arm.kinematics import Kinematics
from hpop.motions import (
    MODEL_DEFAULTS,
    Collision,
    Motions,
    States,
    StateSpace,
)
from hpop.world import World
from hpop.world.geometry.solids import Cylinder, Hull, Solid

CARRIES = frozenset({"base", "plane", "rigid"})  # capabilities of a base that can carry an arm

BASE = 3  # number of joints for the base, and the number of the frame that moves with it
VERTICAL = 1e-6  # largest horizontal part of a vertical unit vector
PLATFORM = "mobile base"  # name of the base as a link, in messages


def carried_chain(space: StateSpace, chain: Chain) -> Chain:
    """Return the chain of base and arm: x, y and yaw of the base (``space``) as three joints before those of the arm.

    The joints of the base have no speed limits. Frame 0 of the arm's own chain must be the frame of the base.
    """
    return Chain(
        names=(*space.names, *chain.names),
        sliding=np.array([True, True, False, *chain.sliding]),
        turning=np.array([False, False, True, *chain.turning]),
        axes=np.concatenate([np.eye(3), chain.axes]),
        origins=np.concatenate([np.tile(np.eye(4), (BASE, 1, 1)), chain.origins]),
        low=np.append(space.low, chain.low),
        high=np.append(space.high, chain.high),
        speed=np.append(np.full(BASE, np.inf), chain.speed),
        acceleration=np.append(np.full(BASE, np.inf), chain.acceleration),
        mounts={name: FrameMount(BASE + mount.frame, mount.pose) for name, mount in chain.mounts.items()},
    )


def carried_parts(parts: Sequence[ArmPart], platform: Sequence[Prism]) -> tuple[ArmPart, ...]:
    """Return the collision solids of arm and base, in the frames of the chain of :func:`carried_chain`."""
    return (
        *(replace(part, frame=BASE + part.frame) for part in parts),
        *(ArmPart(PLATFORM, BASE, upright_solid(prism)) for prism in platform),
    )


def upright_solid(prism: Prism) -> Solid:
    """Return a collision part of the base, an upright prism, as a solid in the frame of the base.

    A part with one corner is a cylinder with its radius, any other the convex hull of its lower and upper corners.
    """
    pose, (z_min, z_max) = np.eye(4), (prism.z_min, prism.z_max)
    if len(prism.corners) == 1:
        pose[:3, 3] = (*prism.corners[0], 0.5 * (z_min + z_max))
        return Solid(Cylinder(prism.radius, z_max - z_min), pose, PLATFORM)
    points: FloatArray = np.array([(*corner, z) for z in (z_min, z_max) for corner in prism.corners])
    return Solid(Hull(points), pose, PLATFORM)


def touching_platform(
    chain: Chain, parts: Sequence[ArmPart], apart: frozenset[Pair], platform: Sequence[Prism]
) -> frozenset[Pair]:
    """Return the links that touch the base by design: in each of 10,000 random states of the arm.

    Each is returned as a pair of the link and the base. Parts and frames are those of the arm's own chain.
    """
    links = dict.fromkeys(part.link for part in parts)
    known = apart | {pair_of(*pair) for pair in combinations(links, 2)}
    return always_touching(chain, [*parts, *(ArmPart(PLATFORM, 0, upright_solid(prism)) for prism in platform)], known)


@dataclass(frozen=True, eq=False)
class BaseAndLinks:
    """Collision test of a mobile arm: the robot is free if both its base and the links of its arm are."""

    base: Collision
    links: Collision

    @checked_arguments
    def states_free(self, states: States) -> BoolArray:
        """Return in which states (N,) neither the base nor the arm collides with the world, nor the arm with the robot.

        The result is a mask (N,).
        """
        free = self.base.states_free(states)
        free[free] = self.links.states_free(states.take(free))
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""
        free = self.base.motions_free(motions)
        start, end = motions.start.take(free), motions.end.take(free)
        free[free] = self.links.motions_free(Motions(motions.world, motions.model, motions.law, start, end))
        return free

    @checked_arguments
    def why_blocked(self, state: States) -> str:
        """Return a text, without final full stop: what blocks one state (1,) and a remedy; "" if the state is free."""
        return self.base.why_blocked(state) or self.links.why_blocked(state)


@dataclass(frozen=True, eq=False, repr=False)
class Links(ArmCollision):
    """Collision test of the links of a mobile arm; its base is tested with the links, but not with the world."""

    def _outer_pairs(self) -> Iterator[tuple[int, int]]:
        return ((a, b) for a, b in super()._outer_pairs() if self.parts[a].link != PLATFORM)


@dataclass(frozen=True, eq=False, repr=False)
class LinksJudge(ArmJudge):
    """Collision test of the links for verification; the base is tested with the links, but not with the world."""

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        size = len(self.parts)
        return [(a, b) for a, b in super()._pairs if b < size or self.parts[a].link != PLATFORM]


@dataclass(frozen=True, eq=False, repr=False)
class KeepingLinks(KeepingCollision, Links):
    """Collision test of the links of a mobile arm that keeps an orientation."""


@dataclass(frozen=True, eq=False, repr=False)
class KeepingLinksJudge(KeepingJudge, LinksJudge):
    """Collision test of the links of a mobile arm that keeps an orientation, for verification."""


def check_kept(kept: KeptAxis | None, chain: Chain, folded: States) -> None:
    """Raise ModelError if a mobile arm with this ``folded`` state (1,) of its arm cannot keep an orientation."""
    if kept is None:
        return
    if math.hypot(*kept.direction[:2]) > VERTICAL:
        raise ModelError(
            "direction of keep must be vertical, (0, 0, 1), for an arm on a base, as the base turns; got "
            f"{shown(list(kept.direction))}"
        )
    if float(kept.margin(Kinematics(chain), folded)[0]) < SLACK:
        raise ModelError(
            f"the folded arm must keep its orientation as well, as it is folded while the base moves: {kept}. Give "
            "another folded state, or wider bounds of keep"
        )


@dataclass(frozen=True, eq=False, repr=False)
class MobileCollision(BaseAndLinks):
    """Collision test of a mobile arm for planning: exact for straight moves of the base, proved for the links.

    platform  collision parts of the base
    world     obstacles and zones
    """

    links: Links
    platform: tuple[Prism, ...]
    world: World

    @property
    def is_uncompiled(self) -> bool:
        """True if kernels must be compiled at the first call, which takes some 20 s."""
        return self.links.is_uncompiled

    @property
    def _keeping(self) -> KeepingLinks | None:
        return self.links if isinstance(self.links, KeepingLinks) else None

    @property
    def kept(self) -> KeptAxis | None:
        """Orientation that the arm keeps, or None."""
        return None if self._keeping is None else self._keeping.kept

    @property
    def constraint(self) -> str:
        """Return the orientation that is kept, and how this is checked, as text for certificates; "" if none is."""
        return "" if self._keeping is None else self._keeping.constraint

    @property
    def projected(self) -> Callable[[States], States] | None:
        """Function that moves states until the arm keeps its orientation; None if it need not."""
        return None if self._keeping is None else self._keeping.projected

    def clearance(self, states: States) -> FloatArray:
        """Return a lower bound (N,), m, on the distance between robot and world; the base counts as a circle."""
        x, y = np.asarray(states.x, float), np.asarray(states.y, float)
        around = [self.world.clearance(x, y, z=(part.z_min, part.z_max)) - part.reach for part in self.platform]
        return np.asarray(np.maximum(0.0, np.min([self.links.clearance(states), *around], axis=0)))


def check_parts(arm: Any, base: Any) -> None:
    """Raise ModelError for an arm and a base that cannot form a mobile arm."""
    if not isinstance(arm, SerialArm):
        raise ModelError(f"arm must be a serial arm, arm=SerialArm(...), got {shown(arm)}")
    if not isinstance(base, PlanarModel) or not base.provides >= CARRIES:
        raise ModelError(
            f"base must be a model in the plane without joints, such as base=DifferentialDrive(...), got {shown(base)}"
        )
    if with_optional_members(base, MODEL_DEFAULTS).field_of_view is not None:
        raise ModelError(
            "field_of_view of the base must not be set, because the arm carries the camera; set it for the arm"
        )
    if taken := [name for name in arm.joints if name in base.space.names]:
        raise ModelError(
            "joints of the arm must not have names of states of the base, but a joint is called "
            f"{shown(taken[0])}; rename it in the URDF"
        )
    if taken := [kind for kind in base.laws if kind in arm.laws]:
        raise ModelError(
            f"the base must not have a law (kind of motion) called {taken[0]!r}, because the arm's law has this name; "
            "rename the base's law"
        )
    if any(part.link == PLATFORM for part in arm.parts):
        raise ModelError(
            f"no link of the arm may be called {PLATFORM!r}, which is the name of the base; rename it in the URDF"
        )
