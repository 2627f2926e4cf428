"""Graph of speeds: a copy of the inner graph's states for each speed of the model, and one for standing still.

These copies are called layers. Layer 0 is rest; layer i is class i, the i-th of the model's speeds
(:mod:`hpop.models.speeds`). A node is a state of the inner graph together with a layer. Turns and other motions in
place stay in layer 0, moves stay in the layer of a class. Arcs between layers keep the state: they change the speed,
and cost what the criteria say of that motion. So a straight run may change its speed at each state, and any search on
this graph finds speeds as it finds paths.

A model with several turn rates (``paces``) has a further layer for each slower one, with free changes from and to rest.
These are parallel arcs, one for each rate. This is exact: a turn begins and ends at rest, so its cost depends on its
ends and rate only. The layer says which of these arcs a path takes.

A join connects a start or goal to the graph (:mod:`.joined_ends`) by a chain of motions. It has one copy for each speed
of its moves with each rate of its turns (:mod:`.speed_joins`). Each copy has a node of its own, between its tail and
its head, so that a path says which copy it takes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, N, copied
from hpop.base.options import LEAST
from hpop.criteria.base import Criterion
from hpop.errors import ModelError, QueryError
from hpop.models.speeds import checked_speeds, neighbouring, turns_text
from hpop.motions import Model, Motions, States, laws_of
from hpop.motions.laws import CHANGE, SPEED
from hpop.planners.graphs.arcs import blocks
from hpop.planners.graphs.chain_speeds import ChainSpeedGraph
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.speed_joins import JoinCopies, at_speed, kinds_into, needless_nodes
from hpop.planners.graphs.state_graph import ARC, StateGraph, WrappedGraph
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph, aggregates
from hpop.planners.objectives import motion_quanta
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.world import World


def with_speeds(ends: Ends, model: Model, criteria: Sequence[Criterion], *, moving: bool = False) -> Ends:
    """Return the graph in which the robot chooses among the speeds of the model, its ``speed_classes`` or ``paces``.

    ends      graph with start and goals among its nodes; returned as it is if the model has one speed, or
              the graph has changes of speed already
    criteria  costs that the search minimises
    moving    whether the robot may come at a speed to a start that was added to the states, and then stops there

    Raises QueryError for a graph without states in the plane or chains of motions, and ModelError for wrong speeds.
    """
    space, start, goals = ends
    if not (model.speed_classes or model.paces) or CHANGE in space.kinds:
        return ends
    speeds = checked_speeds(model.speed_classes, LEAST) if model.speed_classes else ()
    if speeds and CHANGE not in laws_of(model):
        raise ModelError(
            f"the model {model.name!r} has speed_classes, so its laws must include {CHANGE!r}, got "
            f"{', '.join(laws_of(model))}; add **speed_laws(speed_classes, acceleration) from hpop.models.speeds"
        )
    if space.has_chains:
        return ends._replace(space=ChainSpeedGraph(model, space.world, cast(Any, space), spending=space.spending))
    if space.states_alone is None or not speeds:
        raise QueryError(
            f"{space.words} has no states at which this robot could change its speed; give the robot one speed, or use "
            "a roadmap"
        )
    slowed = start if moving and start >= space.states_alone.size else None
    layered = SpeedGraph(space.model, space.world, space, speeds, tuple(criteria), slowed, spending=space.spending)
    return Ends(layered, layered.node(start), [layered.node(goal) for goal in goals])


@dataclass(frozen=True, eq=False)
class SpeedGraph(WrappedGraph):
    """Graph of speeds: layers of an inner graph, and a node for each copy of a join (:class:`.speed_joins.JoinCopies`).

    A join is an arc that connects a start, goal or stop to the graph. There are L layers: rest, one for each speed, and
    one for each slower turn rate. State v of the inner graph has the node v * L + l in layer l. Nodes of joins come
    last.

    inner     graph of states, with start and goals among its nodes
    speeds    m/s, rising: the classes
    criteria  costs that the search minimises
    slowed    added start at which paths may begin at a speed; then they change to rest there. None if there is none
    """

    inner: TrajectoryGraph
    speeds: tuple[float, ...]
    criteria: tuple[Criterion, ...]
    slowed: int | None = None

    @property
    def alone(self) -> StateGraph:
        """The graph of states, without joins."""
        alone = self.inner.states_alone
        assert alone is not None
        return alone

    @property
    def layers(self) -> int:
        """Number of layers: one at rest, one for each class of speed, and one for each slower class of turns."""
        return 1 + len(self.speeds) + len(self.slower_turns)

    @cached_property
    def slower_turns(self) -> tuple[Mapping[str, str], ...]:
        """For each slower turn rate, from slow: the kinds of motion that it replaces, such as {"turn": "turn_0.5"}."""
        return tuple(self.model.paces[:-1])

    @property
    def speed_of(self) -> FloatArray:
        """Speed of each layer, m/s."""
        return np.array([0.0, *self.speeds, *[0.0] * len(self.slower_turns)])

    def node(self, state: int, layer: int = 0) -> int:
        """Return the node of a state of the inner graph in a layer; by default at rest."""
        return state * self.layers + layer

    @cached_property
    def size(self) -> int:
        """Number of nodes."""
        return self.inner.size * self.layers + len(self._joins)

    @property
    def one_layer(self) -> TrajectoryGraph:
        """The inner graph, without layers."""
        return self.inner

    def in_layer(self, states: IntArray, speeds: FloatArray) -> IntArray:
        """Return the nodes (N,) of states of the inner graph (N,), each in the layer nearest to its speed, m/s (N,).

        A speed of -i means class i of the slower turns, from 1.
        """
        own = [0.0, *self.speeds, *(-1.0 - np.arange(len(self.slower_turns)))]
        return np.asarray(states * self.layers + np.abs(speeds[:, None] - own).argmin(axis=1))

    def is_join(self, nodes: IntArray) -> BoolArray:
        """Return a mask (N,): True for the nodes of joins."""
        return np.asarray(nodes >= self.inner.size * self.layers)

    def costed_in(self, world: World) -> SpeedGraph:
        """Return a graph with the same arcs, whose costs are computed in another world; arcs are not checked again."""
        return copied(self, {"_joins", "collision"}, inner=self.inner.costed_in(world), world=world)

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Return an array (m,) with a value for each arc of this graph, in its order; 0 for changes of speed.

        inner  (a,)  values of the arcs of the graph with one speed; repeated for each slower speed and turn rate
        joins  (j,)  values of the joins of starts and goals to the graph
        """
        slower = np.concatenate([inner[arcs] for arcs in self._slower_arcs])
        none, last = (np.zeros(size, inner.dtype) for size in (self._changes[0].size, 1 + self._slowing[0].size))
        return np.concatenate([inner, slower, none, joins[self._joins.rows], last])[self._arcs[2]]

    @property
    def words(self) -> str:
        """Description of the inner graph and the speeds, for certificates."""
        *some, last = (f"{speed:g}" for speed in self.speeds)
        words = f"{self.inner.words}, at speeds of {', '.join(some)} and {last} m/s" if some else self.inner.words
        return words + turns_text(self.model)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions of the inner graph, then changes of speed, then slower turns."""
        slower = (kind for pace in self.slower_turns for kind in pace.values())
        return tuple(dict.fromkeys((*self.inner.kinds, CHANGE, *slower)))

    @cached_property
    def _has_speed(self) -> BoolArray:
        """Mask of the inner graph's kinds of motions: True for moves, which are driven at one of the speeds."""
        laws = laws_of(self.model)
        return np.array([SPEED in laws[kind].extra for kind in self.inner.kinds])

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of the inner graph, and the number of speeds."""
        return {**self.inner.counts, "speeds": len(self.speeds)}

    def states_of(self, nodes: IntArray) -> IntArray:
        """Return the node (N,) of the inner graph for each node; for the node of a join, the one to which it leads."""
        last, heads = self.inner.size * self.layers, np.append(self._joins.heads, 0)
        return np.where(nodes < last, nodes // self.layers, heads[np.clip(nodes - last, 0, len(self._joins))])

    def states(self, ids: IntArray) -> States:
        """Return the robot's states (N,) at nodes, without speeds; for a join's node, the state to which it leads."""
        return self.inner.states(self.states_of(ids))

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the inner nodes of some nodes; an added start or goal is replaced by the states joined to it."""
        return self.inner.inside(list(dict.fromkeys(self.states_of(np.array(nodes, np.int64)).tolist())))

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return which nodes (N,) are in the layer of rest."""
        return np.asarray(~self.is_join(ids) & (ids % self.layers == 0))

    @cached_property
    def _joins(self) -> JoinCopies:
        """Copies of the joins, the connections of start and goals to the graph, for each speed and turn rate."""
        return JoinCopies(self.inner, self.model, self.speeds, self.kinds)

    # Arcs

    @cached_property
    def _arcs(self) -> tuple[IntArray, NDArray[np.int32], IntArray]:
        """Row pointers (N + 1,), heads (m,), and for each arc (m,) its row in the table of costs.

        The table has a row for each arc of the graph of states, at the fastest speed, then for its moves and turns at
        each slower speed, for changes of speed, for copies of joins, a row of zeros, and changes at the start.
        """
        alone, count = self.alone, self.layers
        tails, heads = np.repeat(np.arange(alone.size), np.diff(alone.rows)), alone.heads.astype(np.int64)
        in_place, moves = self._in_place_and_moves
        fastest = len(self.speeds)
        parts = [(tails[in_place] * count, heads[in_place] * count, in_place)]
        parts += [(tails[moves] * count + fastest, heads[moves] * count + fastest, moves)]
        row = heads.size
        for layer, arcs in zip([*range(1, fastest), *range(fastest + 1, count)], self._slower_arcs, strict=True):
            parts.append((tails[arcs] * count + layer, heads[arcs] * count + layer, row + np.arange(arcs.size)))
            row += arcs.size
        state, since, until = self._changes
        parts.append((state * count + since, state * count + until, row + np.arange(state.size)))
        row += state.size
        joins = self._joins
        middle = self.inner.size * count + np.arange(len(joins))
        paid, free = row + np.arange(len(joins)), np.full(len(joins), row + len(joins))
        # A search takes turns together where no turn leads into them from elsewhere (hpop.search.machinery.turns): so a
        # join to a goal costs behind its node, where it ends, and any other before.
        late = joins.heads >= alone.size
        parts.append((joins.tails * count + joins.begins, middle, np.where(late, free, paid)))
        parts.append((middle, joins.heads * count + joins.ends, np.where(late, paid, free)))
        state, since, until = self._slowing
        parts.append((state * count + since, state * count, row + len(joins) + 1 + np.arange(since.size)))
        all_tails, all_heads, rows = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(all_tails, kind="stable")
        pointers = np.append(0, np.cumsum(np.bincount(all_tails, minlength=self.size)))
        return pointers.astype(np.int64), all_heads[order].astype(np.int32), rows[order]

    @cached_property
    def _in_place_and_moves(self) -> tuple[IntArray, IntArray]:
        """Indices of those arcs of the graph of states that are motions in place, and of those that are moves."""
        has_speed = self._has_speed[self.alone.arcs.kinds]
        return np.flatnonzero(~has_speed), np.flatnonzero(has_speed)

    @cached_property
    def _slower_arcs(self) -> list[IntArray]:
        """Indices of moves in the graph of states, once for each slower speed; then of turns, for each slower rate."""
        arcs = self.alone.arcs.kinds
        turns = [np.isin(arcs, [i for i, kind in enumerate(self.inner.kinds) if kind in p]) for p in self.slower_turns]
        return [*[self._in_place_and_moves[1]] * (len(self.speeds) - 1), *map(np.flatnonzero, turns)]

    @cached_property
    def _changes(self) -> tuple[IntArray, IntArray, IntArray]:
        """Changes of speed at all states, as three arrays (c,): the state, and the layers before and after."""
        pairs = neighbouring(len(self.speeds), len(self.slower_turns))
        state, pair = np.divmod(np.arange(self.alone.size * len(pairs)), len(pairs))
        since, until = pairs[pair].T
        return state, since, until

    @property
    def _slowing(self) -> tuple[IntArray, IntArray, IntArray]:
        """Changes to rest at the start ``slowed``, one from each speed, as three arrays like those of `_changes`."""
        since = np.arange(1, 1 if self.slowed is None else 1 + len(self.speeds))
        return np.full(since.size, self.slowed or 0), since, 0 * since

    @property
    def rows(self) -> IntArray:
        """Row pointers (N + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1."""
        return self._arcs[0]

    @property
    def heads(self) -> NDArray[np.int32]:
        """Head node (m,) of each arc."""
        return self._arcs[1]

    @property
    def turned(self) -> NDArray[np.int8]:
        """Count (m,) of each arc by which searches break ties: of paths with equal costs, they prefer the smallest sum.

        It is the number of motions in place, changes of speed included. A change to a class counts one more for each
        faster class, so that fast paths are preferred.
        """
        until, count = self._changes[2], len(self.speeds)
        turned = [self.alone.turned, *(self.alone.turned[arcs] for arcs in self._slower_arcs)]
        turned.append(1 + np.where(until > 0, np.where(until > count, self.layers, count) - until, 0).astype(np.int8))
        last = np.zeros(1, np.int8), np.ones(self._slowing[0].size, np.int8)
        return np.concatenate([*turned, self._joins.turned, *last])[self._arcs[2]]

    # Costs

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph: each motion costs what the criteria say of it at its speed."""
        inner = self.alone.graph(criteria)
        pointers, heads, rows = self._arcs
        self.spending.hold(rows.size * (8 * len(criteria) + 2 * ARC), f"{self.words} was built")
        own = self._own_costs(criteria), self._joins.costs(criteria), np.zeros((1, len(criteria)), np.int64)
        costs = np.concatenate([inner.costs, *own, self._change_costs(self._slowing, criteria)])[rows]
        for array in (pointers, heads, costs):
            array.setflags(write=False)
        return Graph.from_csr(pointers, heads, costs, aggregates=aggregates(criteria))

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs of the graph of states are cached, at all speeds."""
        return self.inner.costed(criteria) and all(self._cached(criterion) is not None for criterion in criteria)

    def _cached(self, criterion: Criterion) -> IntArray | None:
        """Return the costs of slower motions and of changes by a criterion from the world's cache; None if missing."""
        name = self.alone.cache_name(criterion)
        return None if name is None else cast(IntArray | None, self.alone.cached_part((name, SPEED)))

    def _own_costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (r, k), in quanta, of moves at slower speeds, slower turns, and changes of speed."""
        columns = [self._cached(criterion) for criterion in criteria]
        if missing := [j for j, column in enumerate(columns) if column is None]:
            some = [criteria[j] for j in missing]
            found = np.concatenate([*self._slower_costs(some), self._change_costs(self._changes, some)])
            for j, column in zip(missing, found.T, strict=True):
                columns[j] = np.ascontiguousarray(column)
                if (name := self.alone.cache_name(criteria[j])) is not None:
                    self.alone.cache_part((name, SPEED), columns[j])
        return np.stack([column for column in columns if column is not None], axis=1)

    def _slower_costs(self, criteria: Sequence[Criterion]) -> Iterator[IntArray]:
        """Yield the costs (a, k) of the arcs of :attr:`_slower_arcs`, for each speed and each class of turns."""
        laws, none = laws_of(self.model), dict[str, str]()
        classes = [*((speed, none) for speed in self.speeds[:-1]), *((0.0, pace) for pace in self.slower_turns)]
        for own, (speed, pace) in zip(self._slower_arcs, classes, strict=True):

            def of_arcs(part: slice, own: IntArray = own, speed: float = speed, pace: Any = pace) -> IntArray:
                costs = np.empty((part.stop - part.start, len(criteria)), np.int64)
                for arcs, motions in self.alone.motions_of(own[part]):
                    start, end = (at_speed(s, speed) if speed else s for s in (motions.start, motions.end))
                    driven = replace(motions, law=laws[pace.get(motions.kind, motions.kind)], start=start, end=end)
                    costs[np.searchsorted(own[part], arcs)] = motion_quanta(driven, criteria)
                return costs

            yield self._each(of_arcs, own.size, criteria)

    def _change_costs(self, changes: tuple[IntArray, ...], criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (c, k) of changes of speed, given as `_changes`."""

        def of_changes(part: slice) -> IntArray:
            state, *layers = (column[part] for column in changes)
            start, end = (at_speed(self.inner.states(state), self.speed_of[layer]) for layer in layers)
            return motion_quanta(Motions(self.world, self.model, self.model.laws[CHANGE], start, end), criteria)

        return self._each(of_changes, changes[0].size, criteria)

    def _each(self, work: Any, size: int, criteria: Sequence[Criterion]) -> IntArray:
        costs = self.spending.each(work, blocks(size), f"{self.words} was built")
        return np.concatenate([np.zeros((0, len(criteria)), np.int64), *costs])

    # Trajectories

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return n trajectories, not yet checked, through nodes (N,), with speeds.

        The node of a join (connection of start or goal) is replaced by the states in which its motions end, and the
        node after it is left out, as are nodes of slower classes where one change from or to rest replaces several, and
        those to which a free change leads, to or from a class of turns.
        """
        last, space = self.inner.size * self.layers, self.model.space
        pointers, ends, end_kinds, end_turns = self._joins.waypoints
        join = self.is_join(ids)
        copy = np.where(join, ids - last, 0)
        counts = np.where(join, np.diff(pointers, append=0)[copy], 1)
        behind = np.append(False, join[:-1])
        behind[np.cumsum(sizes)[:-1]] = False
        counts[behind | needless_nodes(self, ids, sizes)] = 0
        owner = np.repeat(np.arange(ids.size), counts)  # node of each state
        within = np.arange(owner.size) - np.repeat(np.cumsum(counts) - counts, counts)
        of_join = join[owner]
        plain, at = ids[owner[~of_join]], pointers[copy[owner[of_join]]] + within[of_join]
        columns = dict[str, FloatArray]()
        states = at_speed(self.inner.states(plain // self.layers), self.speed_of[plain % self.layers])
        for name in (*space.names, SPEED):
            columns[name] = np.empty(owner.size)
            columns[name][~of_join], columns[name][of_join] = getattr(states, name), getattr(ends, name)[at]
        kinds = np.full(owner.size, len(self.inner.kinds))
        kinds[of_join] = end_kinds[at]
        kinds[~of_join] = kinds_into(self, ids, owner[~of_join])
        turns = {name: np.full(owner.size, np.nan) for name in space.turning}
        for name, known in turns.items():
            known[of_join] = end_turns[name][at]
        lengths = np.bincount(np.repeat(np.arange(sizes.size), sizes), counts, minlength=sizes.size).astype(np.int64)
        laws = [laws_of(self.model)[kind] for kind in self.kinds]
        return Stretches.through(space, laws, States(**columns), kinds, lengths, turns)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from start to goals, as text: that of the inner graph."""
        begin, *ends = self.states_of(np.array([start, *goals], np.int64)).tolist()
        return self.inner.what_separates(begin, ends)
