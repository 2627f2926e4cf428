"""Collisions of a base that carries an arm: of the base in the plane, of the links and with the base in space.

The base meets obstacles, keep-out zones and the border of the extent as it does alone; links meet what is solid, each
other and the base.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray
from hpop.models.collision.parts import Part as Prism
from hpop.models.mobile_arm.carried import PLATFORM
from hpop.models.serial_arm.collision import ArmCollision
from hpop.models.serial_arm.judge import ArmJudge
from hpop.motions import Collision, Motions, States
from hpop.world import World


@dataclass(frozen=True, eq=False)
class Both:
    """What is free to the base and to the links."""

    base: Collision
    links: Collision

    def states_free(self, states: States) -> BoolArray:
        """Whether the robot is free in each state (N,)."""
        free = self.base.states_free(states)
        free[free] = self.links.states_free(states.take(free))
        return free

    def motions_free(self, motions: Motions) -> BoolArray:
        """Whether the robot is free all along each motion (M,), ends included."""
        free = self.base.motions_free(motions)
        start, end = motions.start.take(free), motions.end.take(free)
        free[free] = self.links.motions_free(Motions(motions.world, motions.model, motions.law, start, end))
        return free

    def why_blocked(self, state: States) -> str:
        """What blocks one state and what helps, in words without the last full stop; empty when it is free."""
        return self.base.why_blocked(state) or self.links.why_blocked(state)


@dataclass(frozen=True, eq=False, repr=False)
class Links(ArmCollision):
    """Links in space; the base is held against these alone."""

    def _outer_pairs(self) -> Iterator[tuple[int, int]]:
        return ((a, b) for a, b in super()._outer_pairs() if self.parts[a].link != PLATFORM)


@dataclass(frozen=True, eq=False, repr=False)
class LinksJudge(ArmJudge):
    """The same by python-fcl."""

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        size = len(self.parts)
        return [(a, b) for a, b in super()._pairs if b < size or self.parts[a].link != PLATFORM]


@dataclass(frozen=True, eq=False, repr=False)
class MobileCollision(Both):
    """For planning: exact for the base where it goes straight, proved for the links all along.

    platform  prisms of the base
    world
    """

    links: Links
    platform: tuple[Prism, ...]
    world: World

    @property
    def is_uncompiled(self) -> bool:
        """Whether the first question takes longer, for kernels that are not compiled yet."""
        return self.links.is_uncompiled

    def clearance(self, states: States) -> FloatArray:
        """Distance (N,), m, of the robot from what stands in the world: a lower bound, by a circle round the base."""
        x, y = np.asarray(states.x, float), np.asarray(states.y, float)
        around = [self.world.clearance(x, y, z=(part.z_min, part.z_max)) - part.reach for part in self.platform]
        return np.asarray(np.maximum(0.0, np.min([self.links.clearance(states), *around], axis=0)))
