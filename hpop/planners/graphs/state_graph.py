"""Graphs of robot states in the plane, such as lattices and roadmaps, whose arcs are moves and turns.

States with the same position share a place, which has a number. Turns connect the states of one place, and moves
connect states of different places. Each arc is one motion, so criteria compute its cost as for motions of trajectories.

Here is also the base class of graphs that are made of another one.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.base.options import identity
from hpop.criteria.base import Criterion
from hpop.motions import Motions, PlaneCollision, States, collision_of, onward
from hpop.motions.laws import SPEED
from hpop.planners.graphs.arcs import BLOCK, MOVE, Arcs, Counts, Quanta, blocks, table
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph, aggregates
from hpop.planners.objectives import motion_quanta
from hpop.planners.spending import return_freed_memory
from hpop.runtime import limits
from hpop.search import Graph
from hpop.search.extended import CompactGraph

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel
    from hpop.problems.problem import Problem
    from hpop.world import World

A = TypeVar("A")
UNMOVED = 1e-6  # m: a start or goal within this distance of a state has its position
NEAREST = 12  # a start or goal off the graph is connected to states up to the twelfth smallest distance of a place
BATCH = 500_000  # motions evaluated at once: few enough to limit memory, enough for fast array operations
ARC = 16  # bytes of memory for an arc, without its costs


@dataclass(frozen=True, eq=False)
class StateGraph(TrajectoryGraph):
    """Graph of robot states in the plane, numbered from 0, each arc of which is one collision-free motion."""

    has_clock = True
    turns_in_place: ClassVar[bool] = True  # if not, the robot waits at a state in its heading

    model: PlanarModel

    @property
    def states_alone(self) -> StateGraph:
        """The graph itself, since it has no added nodes for start and goals."""
        return self

    def over_states(self, change: Callable[[StateGraph], StateGraph]) -> StateGraph:
        """Return the graph that ``change`` makes of this one, which has no added nodes."""
        return change(self)

    def arriving_at(self, speed: float) -> StateGraph:
        """Return this graph for an added start, which is none of its states, where the robot comes at ``speed``, m/s.

        By default, the graph is returned unchanged.
        """
        return self

    @abstractmethod
    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the place of each state; states with equal numbers have the same position."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions: first the one that changes the position, then those in place."""
        return ("move", "turn")

    @abstractmethod
    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Return all collision-free motions of one kind: numbers of their first states, and of their last states."""

    def kinds_between(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the kind (N,) of the motion from each tail (N,) to its head (N,), as an index into `kinds`.

        It is 1 (turn) between states of one place, else 0 (move).
        """
        stays: BoolArray = self.places(tails) == self.places(heads)
        return stays.astype(np.int64)

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Return the numbers (N,), ascending, of the states within ``radius``, m, of the position (x, y), m.

        Subclasses may include states that are not free of collisions.
        """
        near = [np.zeros(0, dtype=np.int64)]
        for begin in range(0, self.size, BATCH):
            ids = np.arange(begin, min(begin + BATCH, self.size))
            states = self.states(ids)
            near.append(ids[np.hypot(states.x - x, states.y - y) <= radius])
        return np.concatenate(near)

    def reach(self, problem: Problem) -> float:
        """Return the distance, m, within which a start or goal off the graph is connected to states.

        By default, this is the twelfth smallest of the distances between start and places; equal distances count once.
        """
        start, states = problem.model.space.state(problem.start), self.states(np.arange(self.size))
        distances = np.unique(np.hypot(states.x - start.x, states.y - start.y))
        return float(distances[min(NEAREST, distances.size) - 1]) + UNMOVED

    def cut_corners(self, tails: IntArray, kinds: IntArray, blocked: IntArray) -> BoolArray:
        """Return which arcs (N,) may not be used because states next to them are blocked; by default none.

        A lattice uses this for diagonal moves that pass a blocked position.

        Parameters
        ----------
        tails, kinds : (N,) first state and kind of motion of each arc
        blocked : numbers of blocked states
        """
        return np.zeros(tails.size, dtype=np.bool_)

    @property
    def turned(self) -> NDArray[np.int8]:
        """1 for each arc (m,) of `graph` that is a motion in place, 0 for moves; searches break ties by the sum."""
        in_place: BoolArray = self.arcs.kinds != MOVE
        return in_place.view(np.int8)

    @cached_property
    def collision(self) -> PlaneCollision:
        """Collision checker for states and motions of the robot in the world."""
        return cast(PlaneCollision, collision_of(self.model, self.world))

    def motions(self, kind: str, tails: IntArray, heads: IntArray) -> Motions:
        """Return the motions (M,) of one kind from states ``tails`` to ``heads``, with angles in the shorter direction.

        Half a turn is counter-clockwise. Moves of a model with several speeds have the fastest one.
        """
        law, start = self.model.laws[kind], self.states(tails)
        end = onward(law, self.model.space, start, self.states(heads))
        if SPEED in law.extra:
            start = States(**start.__dict__, **{SPEED: np.full(tails.size, self.model.speed_classes[-1])})
        kept = {name: getattr(start, name) for name in start.names if name not in law.varies}
        return Motions(self.world, self.model, law, start, States(**{**end.__dict__, **kept}))

    @cached_property
    def arcs(self) -> Arcs:
        """All collision-free motions of all kinds, sorted by the states that they leave."""
        return Arcs.sorted(self.size, [self.edges(kind) for kind in self.kinds])

    @property
    def rows(self) -> IntArray:
        """Row pointers (n + 1,): the arcs that leave state u have the indices rows[u] to rows[u + 1] - 1."""
        return self.arcs.start

    @property
    def heads(self) -> NDArray[np.int32]:
        """State (m,) to which each arc leads."""
        return self.arcs.heads

    def batches(self) -> Iterator[tuple[IntArray, IntArray, Motions]]:
        """Yield all arcs in batches of limited size: their first states, their last states, and their motions."""
        for part in blocks(self.arcs.heads.size):
            for number, _, tails, heads in self._ends_by_kind(part):
                yield tails, heads, self.motions(self.kinds[number], tails, heads)

    def _ends_by_kind(self, part: slice) -> Iterator[tuple[int, IntArray, IntArray, IntArray]]:
        """Yield the arcs of a range of indices by kind of motion.

        Each item has the kind, as an index into `kinds`, the positions of its arcs in the range, and their tails and
        heads.
        """
        tails, heads = self.arcs.ends(part)
        for number in reversed(range(len(self.kinds))):
            own = np.flatnonzero(self.arcs.kinds[part] == number)
            if own.size:
                yield number, own, tails[own], heads[own]

    def costs_anywhere(self, kind: str, criterion: Criterion) -> IntArray | None:
        """Return the costs, in quanta, of the motions in place of one kind, indexed by :meth:`in_place_pairs`.

        None if the costs depend on the place; this is the default.
        """
        return None

    def in_place_pairs(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return a number (N,) for each motion in place; motions that differ only in their place have equal numbers.

        tails, heads  (N,)  first and last states of the motions
        """
        raise NotImplementedError

    @cached_property
    def key(self) -> Hashable:
        """Key of the graph in the cache of its world; equal graphs have equal keys. None if the graph is not cached."""
        return None

    def shared(self, name: Hashable, make: Callable[[], A]) -> A:
        """Return an array or table of the graph from the world's cache, by name; if it is missing, make and cache it.

        make  function that computes it; it runs in each call if the graph has no key
        """
        part = self.cached_part(name)
        if part is None:  # the cache is not locked meanwhile, so several threads may compute it
            part = make()
            self.cache_part(name, part)
        return cast(A, part)

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs by these criteria are cached from an earlier planning run."""
        return all(self.cached_part(self.cache_name(criterion)) is not None for criterion in criteria)

    def cached_part(self, name: Hashable) -> Any:
        """Return an array or table of the graph from the world's cache, by name; None if it is not cached."""
        return None if None in (self.key, name) else self.world.cache.find((self.key, name))

    def cache_part(self, name: Hashable, value: Any) -> None:
        """Store an array or table of the graph in the world's cache, by name, if the graph has a key."""
        if None not in (self.key, name):
            self.world.cache.keep((self.key, name), value)

    @staticmethod
    def cache_name(criterion: Criterion) -> Hashable:
        """Return the name under which a criterion's costs are cached.

        None for a mutable criterion, whose costs are not cached because they may change.
        """
        try:
            return identity(criterion), criterion.quantum
        except TypeError:
            return None

    @property
    def bends(self) -> tuple[float, float]:
        """Largest curvature, 1/m, of the robot's motions, and its largest change per metre, 1/m²; by default none."""
        return 0.0, 0.0

    def legs(self, arcs: IntArray) -> Iterator[tuple[IntArray, Motions]]:
        """Yield the motions of arcs (N,), ascending, with their arcs, which occur once for each of their motions."""
        return self.motions_of(arcs)

    def motion_counts(self, arcs: IntArray) -> IntArray:
        """Return the number (N,) of motions in each of some arcs, without pauses; by default 1."""
        return np.ones(arcs.size, np.int64)

    def pauses(self, arcs: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pauses within arcs (N,), none by default: the arc's position, the motions before, and seconds."""
        return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)

    def motions_of(self, arcs: IntArray) -> Iterator[tuple[IntArray, Motions]]:
        """Yield the motions of some arcs (N,), given by their indices, in batches of one kind of motion.

        Each batch is a pair: the indices of its arcs, and their motions.
        """
        tails = np.searchsorted(self.arcs.start, arcs, side="right") - 1
        for number, kind in enumerate(self.kinds):
            own = np.flatnonzero(self.arcs.kinds[arcs] == number)
            for begin in range(0, own.size, BATCH):
                rows = own[begin : begin + BATCH]
                motions = self.motions(kind, tails[rows], self.arcs.heads[arcs[rows]].astype(np.int64))
                yield arcs[rows], motions

    @property
    def is_reused(self) -> bool:
        """True if later queries will use this graph, so that the graph with its costs is cached; by default False."""
        return False

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the graph for a search, with one integer cost for each criterion, from the cache if it is there.

        A cost is a number of the criterion's quanta, rounded up.
        """
        names = tuple(self.cache_name(criterion) for criterion in criteria)
        if not self.is_reused or None in names:
            return self._costed_graph(criteria)
        graph: Graph | None = self.cached_part(("graph", names))
        if graph is None:
            graph = self._costed_graph(criteria)
            self.cache_part(("graph", names), graph)
        else:
            self.spending.hold(graph.arcs * (8 * len(criteria) + ARC), f"{self.words} was taken from the cache")
        return graph

    def _costed_graph(self, criteria: Sequence[Criterion]) -> Graph:
        arcs = self.arcs
        self.spending.hold(arcs.heads.size * (8 * len(criteria) + ARC), f"{self.words} was built")
        columns = self._columns(criteria)
        if len(columns) == 3 and any(column.max(initial=0) == 1 for column in columns):  # one counts turns
            return CompactGraph.of(arcs.start, arcs.heads, columns, aggregates(criteria))
        return Graph.from_csr(
            arcs.start,
            arcs.heads,
            table(columns, arcs.heads.size),
            aggregates=aggregates(criteria),
        )

    def _columns(self, criteria: Sequence[Criterion]) -> list[Counts]:
        """Return, for each criterion, the costs (m,) of all arcs in quanta.

        Costs that are not cached are computed, block by block, and cached.
        """
        columns = [self.cached_part(self.cache_name(criterion)) for criterion in criteria]
        missing = [j for j, column in enumerate(columns) if column is None]
        size = self.arcs.heads.size
        made = [Quanta(size) for _ in missing]

        with limits.within(self.spending):
            tables = {
                (number, j): self.costs_anywhere(kind, criteria[j])
                for number, kind in enumerate(self.kinds)
                for j in missing
            }
        anywhere = {at: costs for at, costs in tables.items() if costs is not None}

        def costs(part: slice) -> tuple[slice, list[IntArray]]:
            counts = {j: np.empty(part.stop - part.start, np.int64) for j in missing}
            for number, own, tails, heads in self._ends_by_kind(part):
                alike = [j for j in missing if (number, j) in anywhere]
                pairs = self.in_place_pairs(tails, heads) if alike else tails
                for j in alike:
                    counts[j][own] = anywhere[number, j].take(pairs)
                if len(alike) == len(missing):
                    continue
                motions = self.motions(self.kinds[number], tails, heads)
                others = [j for j in missing if j not in alike]
                for j, column in zip(others, motion_quanta(motions, [criteria[j] for j in others]).T, strict=True):
                    counts[j][own] = column
            return part, [*counts.values()]

        for part, counts in self.spending.each(costs, blocks(size) if missing else (), f"{self.words} was built"):
            for column, count in zip(made, counts, strict=True):
                column.write(part, count)
        if missing and size > BLOCK:
            return_freed_memory()
        for j, column in zip(missing, made, strict=True):
            column.counts.setflags(write=False)
            columns[j] = column.counts
            self.cache_part(self.cache_name(criteria[j]), column.counts)
        return columns

    def costed_in(self, world: World) -> Self:
        """Return a graph with the same arcs in another world, in which only the costs are computed again.

        Arcs are not checked for collisions there, and the cache of that world is not used. This gives the costs after
        people or doors have changed, without building the graph again.
        """
        _ = self.arcs, self.size  # computed in this world, not in the other
        return copied(self, without={"collision"}, world=world, key=None)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, not yet checked for impossible motions.

        ids    (N,)  states of all paths, one path after another
        sizes  (n,)  number of states of each path
        """
        kinds = np.zeros(ids.size, np.int64)
        kinds[1:] = self.kinds_between(ids[:-1], ids[1:])
        laws = [self.model.laws[kind] for kind in self.kinds]
        return Stretches.through(self.model.space, laws, self.states(ids), kinds, sizes)


@dataclass(frozen=True, eq=False)
class WrappedGraph(TrajectoryGraph):
    """Graph made of another one; unless a subclass says otherwise, it has the properties of that one.

    inner  graph that is wrapped
    """

    inner: TrajectoryGraph

    @property
    def options(self) -> dict[str, Any]:
        """Options that identify the inner graph, JSON-able."""
        return self.inner.options

    @property
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions of the inner graph."""
        return self.inner.kinds

    @property
    def counts(self) -> dict[str, int]:
        """Numbers that describe the size of the inner graph, by name."""
        return self.inner.counts

    @property
    def is_checked(self) -> bool:
        """True if all arcs of the inner graph are known to be free of collision."""
        return self.inner.is_checked

    def with_checked_arcs(self) -> Self:
        """Return this graph on the inner graph without arcs that collide, of which every arc was checked."""
        return self if self.is_checked else replace(self, inner=self.inner.with_checked_arcs())

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs of the inner graph are cached."""
        return self.inner.costed(criteria)
