"""Collision tests of a mobile base with an arm: of the base in the plane, and of the links in space.

The base is tested against obstacles, keep-out zones and the border of the extent, as without an arm. Links are tested
against solids, one another and the base. For the links, base and arm form one chain with x, y and yaw as first joints.
A
drive, a turn in place and a reach each change these joints linearly, so proofs for an arm's motions hold for all of
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.models.collision.parts import Part as Prism
from hpop.models.serial_arm.chain import ArmPart, Chain, FrameMount, Pair, pair_of
from hpop.models.serial_arm.collision import ArmCollision, always_touching
from hpop.models.serial_arm.judge import ArmJudge
from hpop.motions import Collision, Motions, States, StateSpace
from hpop.world import World
from hpop.world.geometry.solids import Cylinder, Hull, Solid

BASE = 3  # joints by which the base moves, and the frame that moves with it
PLATFORM = "mobile base"  # name of the base among the links in messages


def carried_chain(space: StateSpace, chain: Chain) -> Chain:
    """Return the chain of an arm on a base with states x, y, yaw as joints without speed limits.

    Frame 0 of the arm is the base.
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
    """Return the solids of an arm in the frames of the carried chain, and the solids of the base."""
    return (
        *(replace(part, frame=BASE + part.frame) for part in parts),
        *(ArmPart(PLATFORM, BASE, upright_solid(prism)) for prism in platform),
    )


def upright_solid(prism: Prism) -> Solid:
    """Return an upright prism of a base as a solid in the base's frame.

    A cylinder if it has one corner, else a hull.
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
    """Return the pairs of a link and the base that touch in each of 10,000 random states of the arm, hence by design.

    Parts and frames are those of the arm's own chain.
    """
    links = dict.fromkeys(part.link for part in parts)
    known = apart | {pair_of(*pair) for pair in combinations(links, 2)}
    return always_touching(chain, [*parts, *(ArmPart(PLATFORM, 0, upright_solid(prism)) for prism in platform)], known)


@dataclass(frozen=True, eq=False)
class BaseAndLinks:
    """Collision test that needs both the base and the links to be free."""

    base: Collision
    links: Collision

    def states_free(self, states: States) -> BoolArray:
        """Return whether the robot is free in each state (N,)."""
        free = self.base.states_free(states)
        free[free] = self.links.states_free(states.take(free))
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Return whether the robot is free all along each motion (M,), ends included."""
        free = self.base.motions_free(motions)
        start, end = motions.start.take(free), motions.end.take(free)
        free[free] = self.links.motions_free(Motions(motions.world, motions.model, motions.law, start, end))
        return free

    def why_blocked(self, state: States) -> str:
        """Return what blocks one state and a remedy, without the final full stop; "" if the state is free."""
        return self.base.why_blocked(state) or self.links.why_blocked(state)


@dataclass(frozen=True, eq=False, repr=False)
class Links(ArmCollision):
    """Collision test of the links; the base is tested against the links only."""

    def _outer_pairs(self) -> Iterator[tuple[int, int]]:
        return ((a, b) for a, b in super()._outer_pairs() if self.parts[a].link != PLATFORM)


@dataclass(frozen=True, eq=False, repr=False)
class LinksJudge(ArmJudge):
    """Judge of the links by python-fcl; the base is tested against the links only."""

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        size = len(self.parts)
        return [(a, b) for a, b in super()._pairs if b < size or self.parts[a].link != PLATFORM]


@dataclass(frozen=True, eq=False, repr=False)
class MobileCollision(BaseAndLinks):
    """Collision test for planning: exact for a base on straight moves, proved for the links.

    platform  prisms of the base
    world
    """

    links: Links
    platform: tuple[Prism, ...]
    world: World

    @property
    def is_uncompiled(self) -> bool:
        """True if kernels must be compiled first."""
        return self.links.is_uncompiled

    def clearance(self, states: States) -> FloatArray:
        """Return the distance (N,), m, of the robot from the world: a lower bound, by a circle round the base."""
        x, y = np.asarray(states.x, float), np.asarray(states.y, float)
        around = [self.world.clearance(x, y, z=(part.z_min, part.z_max)) - part.reach for part in self.platform]
        return np.asarray(np.maximum(0.0, np.min([self.links.clearance(states), *around], axis=0)))
