"""Chains of motions: what leads from states to others as the model connects them, each one arc of a graph.

Criteria cost each motion of a chain, collisions are looked for in each, as for all motions; costs are added up, or the
worst is taken, and rounded once a chain. What a chain does not need is no motion.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.errors import ModelError
from hpop.motions import Motions, States
from hpop.planners.graphs.stretches import Stretches
from hpop.planners.objectives import quantised

if TYPE_CHECKING:
    from hpop.planners.graphs.trajectory_graph import TrajectoryGraph

NODES = 2**31  # more than a graph has
REACHED = 1e-6  # m or rad: no column of a state in which a chain shall end is off by more


@dataclass(frozen=True, eq=False)
class Chains:
    """Chains (C,) of motions from a node to another, as many legs each, of which some are no motion.

    graph         tells what is free
    tails, heads  (C,)  nodes
    kinds         of the legs, as the model connects states
    corners       the states (C,) before the first leg and after each
    present       whether (C,) each leg is a motion
    """

    graph: TrajectoryGraph
    tails: IntArray
    heads: IntArray
    kinds: tuple[str, ...]
    corners: tuple[States, ...]
    present: tuple[BoolArray, ...]

    @classmethod
    def connecting(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> Chains:
        """Those that lead from states a (C,) to b, free or not; what is NaN in b is left as it comes."""
        kinds, corners, present = zip(*graph.model.connect(a, b), strict=True)
        if unknown := set(kinds) - graph.model.laws.keys():
            raise ModelError(f"connect leads by {sorted(unknown)}; this model has the laws {sorted(graph.model.laws)}")
        return cls(graph, tails, heads, kinds, (a, *corners), present)

    @classmethod
    def between(cls, graph: TrajectoryGraph, tails: IntArray, heads: IntArray, a: States, b: States) -> Chains:
        """Those of them that are free, and reach b: a model need not connect all of its states."""
        chains = cls.connecting(graph, tails, heads, a, b)
        return chains.take(np.flatnonzero(chains.free() & chains.reach(b)))

    @classmethod
    def all_of(cls, parts: Sequence[Chains]) -> Chains:
        """The chains of several parts, in order."""
        corners = [
            States(**{name: np.concatenate([getattr(s, name) for s in states]) for name in states[0].names})
            for states in zip(*(part.corners for part in parts), strict=True)
        ]
        return cls(
            parts[0].graph,
            np.concatenate([part.tails for part in parts]),
            np.concatenate([part.heads for part in parts]),
            parts[0].kinds,
            tuple(corners),
            tuple(np.concatenate(columns) for columns in zip(*(part.present for part in parts), strict=True)),
        )

    def take(self, rows: IntArray) -> Chains:
        """Some of the chains."""
        return Chains(
            self.graph,
            self.tails[rows],
            self.heads[rows],
            self.kinds,
            tuple(states.take(rows) for states in self.corners),
            tuple(present[rows] for present in self.present),
        )

    def rows(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Places (N,) of the chains between nodes, which are there."""
        known, asked = self.tails * NODES + self.heads, tails * NODES + heads
        ranked = np.argsort(known, kind="stable")
        return ranked[np.searchsorted(known[ranked], asked)]

    def count(self, kinds: Sequence[str]) -> IntArray:
        """Motions of some kinds (C,) in each chain."""
        number = np.zeros(self.tails.size, np.int64)
        for kind, there in zip(self.kinds, self.present, strict=True):
            number += there & (kind in kinds)
        return number

    def motions(self) -> Iterator[tuple[IntArray, Motions]]:
        """The first motions, the second ones and so on, each with the chains that it is of."""
        graph = self.graph
        for i, kind in enumerate(self.kinds):
            rows = np.flatnonzero(self.present[i])
            start, end = (self.corners[j].take(rows) for j in (i, i + 1))
            yield rows, Motions(graph.world, graph.model, graph.model.laws[kind], start, end)

    def free(self) -> BoolArray:
        """Which chains (C,) are free of collisions all along."""
        free = self.graph.collision.states_free(self.corners[0])
        for rows, motions in self.motions():
            free[rows] &= self.graph.collision.motions_free(motions)
        return free

    def reach(self, states: States) -> BoolArray:
        """Which chains (C,) end in states (C,), whatever is NaN there."""
        off = self.graph.model.space.differences(states, self.corners[-1]).values()
        return np.asarray(~np.any([np.abs(column) > REACHED for column in off], axis=0))

    def costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Costs (C, k) in quanta, rounded once a chain."""
        costs = np.zeros((self.tails.size, len(criteria)))
        for rows, motions in self.motions():
            for j, criterion in enumerate(criteria):
                paid = motion_costs(criterion, motions)
                worst = criterion.aggregate == "max"
                costs[rows, j] = np.maximum(costs[rows, j], paid) if worst else costs[rows, j] + paid
        return np.stack([quantised(costs[:, j], criterion) for j, criterion in enumerate(criteria)], axis=1)

    def stretches(self, sizes: IntArray) -> Stretches:
        """What so many (n,) of the chains, one after another, make each, to be checked as parts of whole trajectories.

        Each chain begins where the one before it ends, but for whole turns of what comes round.
        """
        some = sizes > 0
        first = (np.cumsum(sizes) - sizes)[some]
        kept = np.stack([np.zeros(self.tails.size, dtype=np.bool_), *self.present], axis=1)
        kept[first, 0] = True
        space, columns = self.graph.model.space, dict[str, np.ndarray]()
        for name in space.names:
            column = np.stack([getattr(corner, name) for corner in self.corners], axis=1)
            if name in space.turning:
                turns = np.zeros(self.tails.size)
                turns[1:] = np.round((column[:-1, -1] - column[1:, 0]) / (2 * np.pi))
                turns[first] = 0.0
                turns = np.cumsum(turns)
                turns -= np.repeat(turns[first], sizes[some])
                column[turns != 0.0] += 2 * np.pi * turns[turns != 0.0, None]
            columns[name] = column[kept]
        numbers = [self.graph.kinds.index(kind) for kind in self.kinds]
        kinds = np.broadcast_to([0, *numbers], kept.shape)[kept]
        owner = np.repeat(np.arange(sizes.size), sizes)
        lengths = np.bincount(owner, kept.sum(axis=1), minlength=sizes.size).astype(np.int64)
        return Stretches(States(**columns), kinds, lengths)
