"""Who is noticed where and when: pairs of a place and a tick for which costs depend on somebody who moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.planners.graphs.timed.clock import Clock
from hpop.planners.graphs.timed.company import Company
from hpop.planners.graphs.timed.notice import Notices
from hpop.runtime import limits
from hpop.world import World

TOLD_APART = 62  # people; of more, each pair is evaluated among all
ALONE = 2048  # pairs: fewer are evaluated among all people, which is as quick as to make a world for them
NOTICED = "it was reckoned where people who move are noticed"

Masks = NDArray[np.unsignedinteger[Any]]  # bit i for the i-th of those who move, the last one for all others


@dataclass(frozen=True, eq=False)
class Presence:
    """Who is noticed where and when.

    company, notices
    clock
    horizon  H: ticks 0 to H - 1 are asked about
    x, y     (P,) m  places
    """

    company: Company
    notices: Notices
    clock: Clock
    horizon: int
    x: FloatArray
    y: FloatArray
    _worlds: dict[int, World] = field(default_factory=dict, init=False)
    _masks: dict[tuple[float, float], Masks] = field(default_factory=dict, init=False)

    @property
    def over(self) -> float:
        """A time, s, from which on nothing changes any more."""
        return self.company.settled + self.clock.tick

    @property
    def at_last(self) -> World:
        """A world that costs what this one does when all is over."""
        return self.company.world

    @cached_property
    def _beyond(self) -> list[NDArray[np.float32]]:
        """For each of those who move, how far (P, H), m, places are beyond where it is noticed."""
        times = self.clock.seconds(np.arange(self.horizon))
        distances = self.x.size * self.horizon * np.dtype(np.float32).itemsize
        limits.hold(NOTICED, len(self.notices.of) * distances, 2 * distances)
        if not self.notices.overlooked.size:
            return [np.full((self.x.size, self.horizon), np.inf, np.float32) for _ in self.notices.of]
        each = ([one.beyond(self.x, self.y, times) for one in some] for some in self.notices.of)
        return [np.minimum.reduce(some) for some in each]

    def masks(self, way: float, lasts: float) -> Masks:
        """Who (P, H) is noticed within some metres of each place, from each tick on for some seconds."""
        if (way, lasts) not in self._masks:
            people = self.company.people
            kind = np.dtype(np.min_scalar_type(1 << min(len(people), TOLD_APART)))
            limits.hold(NOTICED, self.x.size * self.horizon * kind.itemsize, self.x.size * self.horizon)
            masks = np.zeros((self.x.size, self.horizon), kind)
            for i, (person, beyond) in enumerate(zip(people, self._beyond, strict=True)):
                near = beyond <= np.float32(way + person.speed * lasts)
                masks |= near.astype(masks.dtype) << masks.dtype.type(min(i, TOLD_APART))
            self._masks[way, lasts] = masks
        return self._masks[way, lasts]

    def parts(self, masks: Masks) -> Iterator[tuple[IntArray, World]]:
        """Pairs (N,) with the same people, each with a world in which those are."""
        rest = []
        values, which, counts = np.unique(masks, return_inverse=True, return_counts=True)
        for number, (mask, count) in enumerate(zip(values.tolist(), counts.tolist(), strict=True)):
            own = np.flatnonzero(which == number)
            if count < ALONE or mask >> TOLD_APART:
                rest.append(own)
            else:
                yield own, self._world(mask)
        if rest:
            yield np.concatenate(rest), self.company.world

    def _world(self, mask: int) -> World:
        if mask not in self._worlds:
            self._worlds[mask] = self.company.with_those([i for i in range(TOLD_APART) if mask >> i & 1])
        return self._worlds[mask]
