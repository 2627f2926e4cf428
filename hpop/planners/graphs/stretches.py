"""Many trajectories of one graph made together: fronts have thousands, and one by one they take ten times as long.

All states stand in the same columns, all motions of a law are checked at once; trajectories are parts of the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.motions import Law, States, StateSpace, is_coupled, onward
from hpop.motions.by_law import refuse_impossible
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.motions import Model

BLOCK = 2**20  # angles that are added up at once


class Stretches(NamedTuple):
    """Parts of trajectories, or whole ones, one after another.

    states  (N,)  what comes round is continuous within each
    kinds   (N,)  of the motion that ends in each state, as its place among those of the graph; of a first state it
                  says nothing
    sizes   (n,)  states of each; none where there is no such part
    """

    states: States
    kinds: IntArray
    sizes: IntArray

    @classmethod
    def through(
        cls, space: StateSpace, laws: Sequence[Law], states: States, kinds: IntArray, sizes: IntArray
    ) -> Stretches:
        """Motions of some kinds through states (N,), so many (n,) of them for each; angles turn the shorter way.

        laws  of the kinds
        """
        columns = dict(states.__dict__)
        begins = (np.cumsum(sizes) - sizes)[sizes > 0]
        turned = {name: np.append(np.zeros(1), turns)[: kinds.size] for name, turns in space.turns(states).items()}
        for number, law in enumerate(laws):
            if is_coupled(law):
                rows = np.flatnonzero(kinds == number)
                start = states.take(rows - 1)
                end = onward(law, space, start, states.take(rows))
                for name in law.varies & space.turning:
                    turned[name][rows] = getattr(end, name) - getattr(start, name)
        for name, steps in turned.items():
            steps[begins] = 0.0
            columns[name] = np.repeat(columns[name][begins], sizes[sizes > 0]) + _running(steps, sizes)
        return cls(States(**columns), kinds, sizes)

    @classmethod
    def joined(cls, space: StateSpace, parts: Sequence[Stretches]) -> Stretches:
        """From each part the first stretches make one, the second ones the next, and so on.

        Each begins where the one before it ends, but for whole turns of what comes round.
        """
        lengths = np.array([part.sizes for part in parts])  # (p, n)
        present = lengths > 0
        first = present & (np.cumsum(present, axis=0) == 1)
        kept = lengths - (present & ~first)  # where one begins, the one before it ends
        sizes = kept.sum(axis=0)
        begins = np.cumsum(sizes) - sizes + np.cumsum(kept, axis=0) - kept
        columns = {name: np.empty(sizes.sum()) for name in space.names}
        kinds = np.empty(sizes.sum(), dtype=np.int64)
        last = {name: np.zeros(sizes.size) for name in space.turning}
        for part, length, is_first, begin in zip(parts, lengths, first, begins, strict=True):
            owner = np.repeat(np.arange(length.size), length)
            own = np.cumsum(length) - length
            within = np.arange(owner.size) - own[owner]
            new = np.flatnonzero((within > 0) | is_first[owner])
            place = ((begin - ~is_first)[owner] + within)[new]
            there = length > 0
            kinds[place] = part.kinds[new]
            for name, column in columns.items():
                value = getattr(part.states, name)
                if name in last:
                    whole = np.zeros(length.size)
                    whole[there] = 2 * np.pi * np.round((last[name][there] - value[own[there]]) / (2 * np.pi))
                    whole[is_first] = 0.0
                    value = value + whole[owner]  # so half a turn stays the way round that was checked
                    last[name][there] = value[(own + length - 1)[there]]
                column[place] = value[new]
        return cls(States(**columns), kinds, sizes)

    def trajectories(self, model: Model, kinds: tuple[str, ...]) -> tuple[Trajectory, ...]:
        """The trajectories that they are, of motions of these kinds; raises ModelError for one that is none."""
        states = self.states
        for name in states.names:
            getattr(states, name).setflags(write=False)
        ends = np.cumsum(self.sizes)
        heads = np.delete(np.arange(self.kinds.size), ends - self.sizes)
        for number, kind in enumerate(kinds):
            rows = np.flatnonzero(self.kinds[heads] == number)
            if rows.size:
                start, end = states.take(heads[rows] - 1), states.take(heads[rows])
                refuse_impossible(model, model.laws[kind], start, end, rows)
        words = tuple(np.array(kinds, dtype=object)[self.kinds].tolist())
        return tuple(
            Trajectory.of_checked(model, states.take(slice(begin, end)), words[begin + 1 : end])
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
