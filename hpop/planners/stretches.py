"""Many trajectories of one graph made together: fronts have thousands, and one by one they take ten times as long.

All states stand in the same columns, all motions of a law are checked at once; trajectories are parts of the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.math import wrap
from hpop.motions import States
from hpop.trajectory import Trajectory, refuse_impossible

if TYPE_CHECKING:
    from hpop.motions import Model

KINDS = np.array(["move", "turn"], dtype=object)
MOVE, TURN = range(2)
BLOCK = 2**20  # yaws that are added up at once


class Stretches(NamedTuple):
    """Parts of trajectories, or whole ones, one after another.

    x, y, yaw  (N,)  m and rad, the yaw continuous within each
    law        (N,)  of the motion that ends in each state, as its place in KINDS; of a first state it says nothing
    sizes      (n,)  states of each; none where there is no such part
    """

    x: FloatArray
    y: FloatArray
    yaw: FloatArray
    law: IntArray
    sizes: IntArray

    @classmethod
    def through(cls, states: States, places: IntArray, sizes: IntArray) -> Stretches:
        """Turns at a place and moves between places, through states (N,), so many (n,) of them for each."""
        stays, turned = np.zeros(places.size, dtype=np.int64), np.zeros(places.size)
        stays[1:] = np.diff(places) == 0
        turned[1:] = wrap(np.diff(states.yaw))
        begins = (np.cumsum(sizes) - sizes)[sizes > 0]
        turned[begins] = 0.0
        yaw = np.repeat(states.yaw[begins], sizes[sizes > 0]) + _running(turned, sizes)
        return cls(states.x, states.y, yaw, np.where(stays, TURN, MOVE), sizes)

    @classmethod
    def joined(cls, parts: Sequence[Stretches]) -> Stretches:
        """From each part the first stretches make one, the second ones the next, and so on.

        Each begins where the one before it ends, but for whole turns of the yaw.
        """
        lengths = np.array([part.sizes for part in parts])  # (p, n)
        present = lengths > 0
        first = present & (np.cumsum(present, axis=0) == 1)
        kept = lengths - (present & ~first)  # where one begins, the one before it ends
        sizes = kept.sum(axis=0)
        begins = np.cumsum(sizes) - sizes + np.cumsum(kept, axis=0) - kept
        x, y, yaw = (np.empty(sizes.sum()) for _ in range(3))
        law, last = np.empty(sizes.sum(), dtype=np.int64), np.zeros(sizes.size)
        for part, length, is_first, begin in zip(parts, lengths, first, begins, strict=True):
            owner = np.repeat(np.arange(length.size), length)
            own = np.cumsum(length) - length
            within = np.arange(owner.size) - own[owner]
            new = np.flatnonzero((within > 0) | is_first[owner])
            place = ((begin - ~is_first)[owner] + within)[new]
            there = length > 0
            whole = np.zeros(length.size)
            whole[there] = 2 * np.pi * np.round((last[there] - part.yaw[own[there]]) / (2 * np.pi))
            whole[is_first] = 0.0
            continuous = part.yaw + whole[owner]  # so half a turn stays the way round that was checked
            last[there] = continuous[(own + length - 1)[there]]
            x[place], y[place], yaw[place], law[place] = part.x[new], part.y[new], continuous[new], part.law[new]
        return cls(x, y, yaw, law, sizes)

    def trajectories(self, model: Model) -> tuple[Trajectory, ...]:
        """The trajectories that they are; raises ModelError for a motion that is none of its law."""
        states = States(x=self.x, y=self.y, yaw=self.yaw)
        for name in states.names:
            getattr(states, name).setflags(write=False)
        ends = np.cumsum(self.sizes)
        heads = np.delete(np.arange(self.law.size), ends - self.sizes)
        for law, kind in enumerate(KINDS):
            rows = np.flatnonzero(self.law[heads] == law)
            if rows.size:
                start, end = states.take(heads[rows] - 1), states.take(heads[rows])
                refuse_impossible(model, model.laws[kind], start, end, rows)
        kinds = tuple(KINDS[self.law].tolist())
        return tuple(
            Trajectory.of_checked(model, states.take(slice(begin, end)), kinds[begin + 1 : end])
            for begin, end in pairwise([0, *ends.tolist()])
        )


def _running(steps: FloatArray, sizes: IntArray) -> FloatArray:
    """Sums (N,) of the steps up to each, over stretches of so many (n,), each added up from its first to its last."""
    running = np.empty(steps.size)
    ends = np.append(0, np.cumsum(sizes))
    several = max(1, BLOCK // max(1, int(sizes.max(initial=0))))
    for begin in range(0, sizes.size, several):
        own = sizes[begin : begin + several]
        part = slice(ends[begin], ends[begin + own.size])
        there = np.arange(own.max()) < own[:, None]
        rows = np.zeros(there.shape)
        rows[there] = steps[part]
        running[part] = np.cumsum(rows, axis=1)[there]
    return running
