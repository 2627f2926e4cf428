"""Graphs of states in the plane, such as lattices and roadmaps, connected by moves and turns.

Each state is at a place. Turns join the states of one place, moves join places. Each edge is a motion, so criteria cost
it as they cost trajectories.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import Motions, PlaneCollision, States, collision_of, onward
from hpop.planners.graphs.arcs import MOVE, Arcs, Counts, Quanta, blocks, table
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph, aggregates
from hpop.planners.objectives import quantised
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel
    from hpop.problems.problem import Problem
    from hpop.world import World

A = TypeVar("A")
UNMOVED = 1e-6  # m: an end within this distance of a state is at its place
NEAREST = 12  # least number of places to which an end beside a graph is joined
BATCH = 500_000  # motions evaluated at once: bounds memory, large enough for array speed
ARC = 16  # bytes of an arc without its costs


@dataclass(frozen=True, eq=False)
class StateGraph(TrajectoryGraph):
    """Free states of a model in the plane, numbered from 0, with arcs of one motion each."""

    has_clock = True

    model: PlanarModel

    @property
    def states_alone(self) -> StateGraph:
        """The graph itself."""
        return self

    @abstractmethod
    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the place of each state."""

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions: moves, then motions in place."""
        return ("move", "turn")

    @abstractmethod
    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Return tails and heads of all free motions of one kind."""

    def kinds_between(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the kind (N,) of the edges between states, as an index into `kinds`: a turn in place, or a move."""
        stays: BoolArray = self.places(tails) == self.places(heads)
        return stays.astype(np.int64)

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Return the ids (N,), rising, of states within a radius, m, of a position x, y, m; some may not be free."""
        near = [np.zeros(0, dtype=np.int64)]
        for begin in range(0, self.size, BATCH):
            ids = np.arange(begin, min(begin + BATCH, self.size))
            states = self.states(ids)
            near.append(ids[np.hypot(states.x - x, states.y - y) <= radius])
        return np.concatenate(near)

    def reach(self, problem: Problem) -> float:
        """Return the distance, m, within which a start or goal beside the graph is joined to states.

        By default, this is the distance of the start from its twelfth nearest place.
        """
        start, states = problem.model.space.state(problem.start), self.states(np.arange(self.size))
        distances = np.unique(np.hypot(states.x - start.x, states.y - start.y))
        return float(distances[min(NEAREST, distances.size) - 1]) + UNMOVED

    def cut_corners(self, tails: IntArray, kinds: IntArray, blocked: IntArray) -> BoolArray:
        """Mark the arcs (N,) that are closed because states beside them are blocked; none by default.

        Parameters
        ----------
        tails, kinds : (N,) of the arcs
        blocked : ids of blocked states
        """
        return np.zeros(tails.size, dtype=np.bool_)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of motions in place in each arc of `graph`."""
        in_place: BoolArray = self.arcs.kinds != MOVE
        return in_place.view(np.int8)

    @cached_property
    def collision(self) -> PlaneCollision:
        """Collision check of states and motions."""
        return cast(PlaneCollision, collision_of(self.model, self.world))

    def motions(self, kind: str, tails: IntArray, heads: IntArray) -> Motions:
        """Return edges (M,) of a kind as motions; angles take the shorter direction, half a turn counter-clockwise."""
        law, start = self.model.laws[kind], self.states(tails)
        end = onward(law, self.model.space, start, self.states(heads))
        kept = {name: getattr(start, name) for name in start.names if name not in law.varies}
        return Motions(self.world, self.model, law, start, States(**{**end.__dict__, **kept}))

    @cached_property
    def arcs(self) -> Arcs:
        """Arcs of all free motions."""
        return Arcs.sorted(self.size, [self.edges(kind) for kind in self.kinds])

    @property
    def rows(self) -> IntArray:
        """Row pointers (n + 1,) of the arcs."""
        return self.arcs.start

    @property
    def heads(self) -> NDArray[np.int32]:
        """Heads (m,) of the arcs."""
        return self.arcs.heads

    def batches(self) -> Iterator[tuple[IntArray, IntArray, Motions]]:
        """Yield tails, heads and motions of all arcs, in batches of bounded size."""
        for part in blocks(self.arcs.heads.size):
            for _, tails, heads, motions in self._batches(part):
                yield tails, heads, motions

    def _batches(self, part: slice) -> Iterator[tuple[BoolArray, IntArray, IntArray, Motions]]:
        """Yield the arcs of a range, law by law: a mask over the range, tails, heads and motions of these arcs."""
        tails, heads = self.arcs.ends(part)
        for number, kind in sorted(enumerate(self.kinds), reverse=True):
            own = self.arcs.kinds[part] == number
            if own.any():
                yield own, tails[own], heads[own], self.motions(kind, tails[own], heads[own])

    @cached_property
    def key(self) -> Hashable:
        """Cache key of the graph in its world, equal for equal graphs; None if nothing is cached."""
        return None

    def shared(self, name: Hashable, make: Callable[[], A]) -> A:
        """Return a named part of the graph from the world's cache; if it is missing, ``make`` the part and cache it."""
        part = self.cached_part(name)
        if part is None:  # made without the cache's lock, by several threads
            part = make()
            self.cache_part(name, part)
        return cast(A, part)

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all edges are cached from an earlier planning run."""
        return all(self.cached_part(self.cache_name(criterion)) is not None for criterion in criteria)

    def cached_part(self, name: Hashable) -> Any:
        """Return a named part of the graph from the world's cache; None if it is missing."""
        return None if None in (self.key, name) else self.world.cache.find((self.key, name))

    def cache_part(self, name: Hashable, value: Any) -> None:
        """Store a named part of the graph in the world's cache, if the graph has a key."""
        if None not in (self.key, name):
            self.world.cache.keep((self.key, name), value)

    @staticmethod
    def cache_name(criterion: Criterion) -> Hashable:
        """Return the name under which a criterion's costs are cached; None for a mutable criterion, never cached."""
        try:
            return identity(criterion), criterion.quantum
        except TypeError:
            return None

    def motions_of(self, places: IntArray) -> Iterator[tuple[IntArray, Motions]]:
        """Yield some arcs, given by indices (N,) in ``arcs``, as motions, in batches: the indices and the motions."""
        tails = np.searchsorted(self.arcs.start, places, side="right") - 1
        for number, kind in enumerate(self.kinds):
            own = np.flatnonzero(self.arcs.kinds[places] == number)
            for begin in range(0, own.size, BATCH):
                rows = own[begin : begin + BATCH]
                motions = self.motions(kind, tails[rows], self.arcs.heads[places[rows]].astype(np.int64))
                for run, portion in motions.portions():
                    yield places[rows][run], portion

    @property
    def is_reused(self) -> bool:
        """True if other queries will use this graph, so that it is cached with its costs."""
        return False

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph with one integer cost per criterion: costs of arcs in quanta, rounded once."""
        names = tuple(self.cache_name(criterion) for criterion in criteria)
        if not self.is_reused or None in names:
            return self._costed_graph(criteria)
        graph: Graph | None = self.cached_part(("graph", names))
        if graph is None:
            graph = self._costed_graph(criteria)
            self.cache_part(("graph", names), graph)
        else:
            self.spending.hold(graph.arcs * (8 * len(criteria) + ARC), f"{self.words} was taken from before")
        return graph

    def _costed_graph(self, criteria: Sequence[Criterion]) -> Graph:
        arcs = self.arcs
        self.spending.hold(arcs.heads.size * (8 * len(criteria) + ARC), f"{self.words} was built")
        return Graph.from_csr(
            arcs.start,
            arcs.heads,
            table(self._columns(criteria), arcs.heads.size),
            aggregates=aggregates(criteria),
        )

    def _columns(self, criteria: Sequence[Criterion]) -> list[Counts]:
        """Return the costs (m,) of all arcs by each criterion; those not cached are computed together, in blocks."""
        columns = [self.cached_part(self.cache_name(criterion)) for criterion in criteria]
        missing = [j for j, column in enumerate(columns) if column is None]
        size = self.arcs.heads.size
        made = [Quanta(size) for _ in missing]

        def costs(part: slice) -> tuple[slice, list[IntArray]]:
            counts = [np.empty(part.stop - part.start, np.int64) for _ in missing]
            for own, _, _, motions in self._batches(part):
                places = np.flatnonzero(own)
                for run, portion in motions.portions():
                    for count, j in zip(counts, missing, strict=True):
                        count[places[run]] = quantised(motion_costs(criteria[j], portion), criteria[j])
            return part, counts

        for part, counts in self.spending.each(costs, blocks(size) if missing else (), f"{self.words} was built"):
            for column, count in zip(made, counts, strict=True):
                column.write(part, count)
        for j, column in zip(missing, made, strict=True):
            column.counts.setflags(write=False)
            columns[j] = column.counts
            self.cache_part(self.cache_name(criteria[j]), column.counts)
        return columns

    def costed_in(self, world: World) -> Self:
        """Return the graph with the same arcs, free or not, in another world; the cache of that world is not used.

        So costs after a change of people or doors are computed without building the graph again.
        """
        _ = self.arcs, self.size  # computed in this world, not in the other
        return copied(self, without={"collision"}, world=world, key=None)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return n trajectories, not yet checked, through states (N,), one motion per arc.

        sizes  (n,)  number of states of each trajectory
        """
        kinds = np.zeros(ids.size, np.int64)
        kinds[1:] = self.kinds_between(ids[:-1], ids[1:])
        laws = [self.model.laws[kind] for kind in self.kinds]
        return Stretches.through(self.model.space, laws, self.states(ids), kinds, sizes)


def identity(value: Any) -> Hashable:
    """Return a hashable that identifies an immutable value; a dataclass is identified by all its fields.

    Raises TypeError for a mutable value.
    """
    if not is_dataclass(value):
        hash(value)
        return cast(Hashable, value)
    declared = vars(type(value)).get("__dataclass_params__")  # a subclass may hold more than fields
    if declared is None or not declared.frozen:
        raise TypeError(f"{type(value).__name__} may change")
    return type(value), *(identity(getattr(value, field.name)) for field in fields(value))
