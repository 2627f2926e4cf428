"""Costs of motions that stay at a position, computed once for all positions of a lattice if they are equal there.

Most arcs of a lattice turn in place. Many criteria, such as the duration or the number of turns, give a turn the same
cost at every position. To find these criteria, each is evaluated on motions that record whether it reads the position
or the world.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from hpop.base.arrays import IntArray
from hpop.criteria.base import Criterion
from hpop.motions import Motions, States
from hpop.motions.states import LazyStates
from hpop.planners.objectives import quantised
from hpop.runtime.limits import LimitPassed

if TYPE_CHECKING:
    from hpop.planners.graphs.lattice.graph import StateLattice
    from hpop.world import World

PLACE = frozenset({"x", "y", "world"})


class RecordedMotions(Motions):
    """Motions that record the names of the state coordinates that are read, and "world" if the world is read.

    recorded  names read so far
    """

    recorded: set[str]

    @property
    def world(self) -> World:
        """World, recorded when it is read."""
        self.recorded.add("world")
        return cast("World", self.__dict__["world"])

    @classmethod
    def of(cls, motions: Motions) -> RecordedMotions:
        """Return a copy of motions that records which of their states are read, and whether the world is."""
        recorded = set[str]()

        def lazy(states: States) -> LazyStates:
            return LazyStates(states.names, states.size, lambda name: getattr(states, name), recorded)

        copy = object.__new__(cls)
        fields = {name: vars(motions)[name] for name in ("world", "model", "law", "t0", "panels", "turns")}
        copy.__dict__.update(fields, start=lazy(motions.start), end=lazy(motions.end), recorded=recorded)
        return copy


def costs_anywhere(lattice: StateLattice, kind: str, criterion: Criterion) -> IntArray | None:
    """Return the costs, in quanta, of all motions of one kind that stay at a position, such as turns.

    They form a table (S, S) by the stations (headings and joint values) in which the motions begin and end. None if the
    costs may depend on the position, because the criterion reads the position or the world; also if the criterion
    cannot cost these motions, or if the lattice has no position.
    """
    if not lattice.cells[0].size:
        return None
    tails, heads = lattice.stations.motions[kind]
    motions = RecordedMotions.of(lattice.motions(kind, tails, heads))  # at the first position
    try:
        costs = np.asarray(criterion.cost(motions))
    except (LimitPassed, MemoryError):
        raise
    except Exception:  # the costs of all arcs raise it again, with its reason
        return None
    is_valid = costs.shape == tails.shape and np.can_cast(costs.dtype, np.float64, "same_kind")
    if motions.recorded & PLACE or not is_valid or not (np.isfinite(costs) & (costs >= 0)).all():
        return None
    table = np.zeros((lattice.width, lattice.width), np.int64)
    table[tails, heads] = quantised(costs.astype(np.float64), criterion)
    return table
