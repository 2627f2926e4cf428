"""Roadmap of configurations with several speeds: each chain of motions is driven at one of them.

Every chain begins and ends at rest, so nothing of its speed remains at its last configuration. A class is one of the
robot's speeds; for a base that carries an arm, it is one speed of the base with one of the arm. A path says by a node
which class a chain has: node v is configuration v, and node (c, v) is configuration v, reached by a chain of class c.
From v, each chain leads to nodes (c, w), and from these an arc without cost to w, where labels of all classes meet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.motions import States, laws_of
from hpop.motions.laws import CHANGE, SPEED
from hpop.planners.graphs.arcs import MotionChains, blocks
from hpop.planners.graphs.state_graph import WrappedGraph
from hpop.planners.graphs.trajectory_graph import Stretches, aggregates
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.planners.graphs.roadmap.configurations import ConfigurationRoadmap

ARC = 16  # bytes of memory for an arc, without its costs
PIECES = 64  # work of connecting two configurations, as a multiple of the work for one motion


@dataclass(frozen=True, eq=False)
class ChainSpeedGraph(WrappedGraph):
    """Graph in which each chain of a roadmap of configurations has one of several classes of speed.

    If the motions of a chain are equal in two classes, the chain is only in the faster one.

    inner  roadmap of n configurations; its nodes keep their numbers. Configuration v, reached by a chain of class c,
           from 0 for the slowest, is node (c + 1) n + v
    """

    inner: ConfigurationRoadmap

    @cached_property
    def _paces(self) -> list[dict[str, str]]:
        """For each class, from slow to fast: dict from kinds of motion to the kinds that replace them."""
        return [dict(pace) for pace in self.model.paces or [{}] for _ in self.model.speed_classes or [0.0]]

    @cached_property
    def _speeds(self) -> FloatArray:
        """Speed (c,), m/s, of the moves in each class; zeros if the model has no ``speed_classes``."""
        return np.tile(self.model.speed_classes or [0.0], len(self.model.paces) or 1)

    def _has_speed(self, kind: str) -> bool:
        return SPEED in laws_of(self.model)[kind].extra

    @property
    def size(self) -> int:
        """Number of nodes: each configuration once, and once for each class."""
        return self.inner.size * (1 + len(self._paces))

    @property
    def words(self) -> str:
        """Description of the roadmap and the speeds, for certificates."""
        return f"{self.inner.words}, {self.speed_words}"

    @property
    def speed_words(self) -> str:
        """Description of the speeds, for certificates."""
        *some, last = (f"{speed:g}" for speed in self.model.speed_classes or [0.0])
        words = [f"at speeds of {', '.join(some)} and {last} m/s"] if some else []
        if self.model.paces:
            kinds = dict.fromkeys(kind for pace in reversed(self._paces) for kind in pace.values())
            words.append(f"each chain at one of {len(self.model.paces)} speeds ({', '.join(kinds)})")
        return ", ".join(words)

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of the roadmap, and the number of classes."""
        return {**self.inner.counts, "speeds": len(self._paces)}

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions of the roadmap in all classes, and changes of speed."""
        replaced = (pace.get(kind, kind) for kind in self.inner.kinds for pace in self._paces)
        changes = [CHANGE] if any(map(self._has_speed, self.inner.kinds)) else []
        return tuple(dict.fromkeys((*replaced, *changes)))

    def _states_of(self, nodes: IntArray) -> IntArray:
        return np.asarray(nodes % self.inner.size)

    def states(self, ids: IntArray) -> States:
        """Return the configurations (N,) at some nodes."""
        return self.inner.states(self._states_of(ids))

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return a mask (N,): True for the nodes of configurations, where the robot may stand."""
        return np.asarray(ids < self.inner.size)

    def chains(self, tails: IntArray, heads: IntArray, classes: IntArray) -> MotionChains:
        """Return chains (N,) between configurations, each in a class (N,), not checked for collisions.

        A motion whose kind depends on the class has a leg for each kind, of which one is present. A move that has a
        speed lies between two changes of speed.
        """
        plain, speeds = self.inner.chains(tails, heads), self._speeds
        with_speed = any(map(self._has_speed, plain.kinds))

        def at(states: States, speed: FloatArray) -> States:
            return States(**states.__dict__ | {SPEED: speed}) if with_speed else states

        rest = np.zeros(classes.size)
        here = at(plain.corners[0], rest)
        kinds, corners, present = list[str](), [here], list[BoolArray]()
        for kind, end, some in zip(plain.kinds, plain.corners[1:], plain.present, strict=True):
            if self._has_speed(kind):
                driven = np.where(some, speeds[classes], 0.0)
                kinds += [CHANGE, kind, CHANGE]
                corners += [at(here, driven), at(end, driven), at(end, rest)]
                present += [some, some, some]
            else:
                of_class = [pace.get(kind, kind) for pace in self._paces]
                for becomes in dict.fromkeys(of_class):
                    own = some & np.isin(classes, [c for c, other in enumerate(of_class) if other == becomes])
                    kinds.append(becomes)
                    new, old = at(end, rest).__dict__, corners[-1].__dict__
                    corners.append(States(**{name: np.where(own, new[name], old[name]) for name in new}))
                    present.append(own)
            here = corners[-1]
        return replace(plain, graph=self, kinds=tuple(kinds), corners=tuple(corners), present=tuple(present))

    @cached_property
    def _offered(self) -> tuple[IntArray, IntArray]:
        """Arcs of the roadmap, each with a speed class in which it can be driven: two arrays (a,), sorted by arc.

        An arc is a chain of motions. If a faster class drives all its motions alike, the slower one is left out.
        """
        arcs, count = self.inner.arcs, len(self._paces)
        kinds = self.inner.kinds
        labels = [
            [(pace.get(kind, kind), self._speeds[c] if self._has_speed(kind) else 0) for kind in kinds]
            for c, pace in enumerate(self._paces)
        ]
        offered = np.ones((arcs.heads.size, count), np.bool_)
        for part in blocks(arcs.heads.size, PIECES):
            chains = self.inner.chains(*arcs.ends(part))
            some = {kind: chains.count([kind]) > 0 for kind in kinds}
            for c in range(count):
                for faster in range(c + 1, count):
                    others = [kind for kind, a, b in zip(kinds, labels[c], labels[faster], strict=True) if a != b]
                    offered[part, c] &= np.any([some[kind] for kind in others], axis=0)
        arc, of_class = np.nonzero(offered)
        return arc, of_class

    def _ends(self) -> tuple[IntArray, IntArray]:
        """Return the indices of the configurations at which chains begin, and at which they end: two arrays (a,)."""
        tails, heads = self.inner.arcs.ends(slice(0, self.inner.arcs.heads.size))
        return tails[self._offered[0]], heads[self._offered[0]]

    @cached_property
    def rows(self) -> IntArray:
        """Row pointers (N + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1."""
        leaving = np.bincount(self._ends()[0], minlength=self.inner.size)
        free = np.ones(self.size - self.inner.size, np.int64)
        return np.concatenate([np.zeros(1, np.int64), np.cumsum(np.concatenate([leaving, free]))])

    @cached_property
    def heads(self) -> NDArray[np.int32]:
        """Node (m,) to which each arc leads: chains lead to nodes of a class, and from there arcs to configurations."""
        reached = (self._offered[1] + 1) * self.inner.size + self._ends()[1]
        joined = np.tile(np.arange(self.inner.size), len(self._paces))
        heads = np.concatenate([reached, joined]).astype(np.int32)
        heads.setflags(write=False)
        return heads

    @property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of motions in each chain, plus the number of faster classes, so that fast paths win ties.

        It is 0 for the arcs without motions, which lead from nodes of a class to configurations.
        """
        arcs, classes = self._offered
        slower = (len(self._paces) - 1 - classes).astype(np.int8)
        free = np.zeros(self.heads.size - arcs.size, np.int8)
        return np.concatenate([self.inner.turned[arcs] + slower, free])

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph; the cost of a chain in a class is that of its motions in this class."""
        paid = self.inner.chain_costs(*self._ends(), criteria, self.chains, self._offered[1])
        free = np.zeros((self.heads.size - len(paid), len(criteria)), np.int64)
        self.spending.hold(free.size * 8 + len(free) * ARC, f"{self.words} was built")
        costs = np.concatenate([paid, free])
        for array in (self.rows, costs):
            array.setflags(write=False)
        return Graph.from_csr(self.rows, self.heads, costs, aggregates=aggregates(criteria))

    def arcs_free(self, arcs: IntArray) -> BoolArray:
        """Check arcs (N,), given by index; return a mask, True for those that are free of collisions.

        A chain is checked once for all classes.
        """
        chains, free = self._offered[0], np.ones(arcs.size, np.bool_)
        of_chain = arcs < chains.size
        own, which = np.unique(chains[arcs[of_chain]], return_inverse=True)
        free[of_chain] = self.inner.arcs_free(own)[which]
        return free

    def without(self, arcs: IntArray) -> ChainSpeedGraph:
        """Return the graph without some blocked arcs (N,), given by index; their chains are left out in each class."""
        chains = self._offered[0]
        return replace(self, inner=self.inner.without(np.unique(chains[arcs[arcs < chains.size]])))

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, with all motions of the chains.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        path, nodes, count = np.repeat(np.arange(sizes.size), sizes), self.inner.size, len(self._paces)
        of_class = ids >= nodes
        chains = np.bincount(path[of_class], minlength=sizes.size)
        alone = (sizes > 0) & (chains == 0)  # a path of one node becomes a chain without motions to the node itself
        at = np.sort(np.concatenate([np.flatnonzero(of_class), (np.cumsum(sizes) - sizes)[alone]]))
        tails = self._states_of(ids[np.where(of_class[at], at - 1, at)])
        classes = np.where(of_class[at], ids[at] // nodes - 1, count - 1)
        return self.chains(tails, self._states_of(ids[at]), classes).stretches(chains + alone)

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the configurations of some nodes."""
        return list(dict.fromkeys(node % self.inner.size for node in nodes))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from the start to the goals, as text: that of the roadmap."""
        return self.inner.what_separates(start, goals)
