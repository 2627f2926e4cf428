"""Exact ends on any graph of states: a start or goal beside its states is joined to the states near it.

A join is one arc, a chain of up to three motions: a turn, a straight move, a turn (:class:`.arcs.MotionChains`). So a
start or goal adds one node. No arc leads back from a goal, or to the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied, inserted
from hpop.criteria.base import Criterion
from hpop.errors import QueryError
from hpop.motions import States, StateSpace
from hpop.planners.graphs.arcs import MOVE, MotionChains
from hpop.planners.graphs.state_graph import UNMOVED as UNMOVED  # imported from here by others
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.trajectory_graph import N, Stretches, TrajectoryGraph
from hpop.planners.needs import elsewhere
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World

HEADING_TOLERANCE = 2e-3  # rad: a yaw written with three decimals is on its heading
START, GOAL = "start", "goal"


class Ends(NamedTuple):
    """Graph with the nodes of the start and the goals.

    space  the graph
    start  node of the start
    goals  nodes of the goals
    """

    space: TrajectoryGraph
    start: int
    goals: list[int]

    @property
    def inside(self) -> tuple[list[int], list[int]]:
        """States of the graph for the start and for the goals.

        A joined end is replaced by the states joined to it, nearest first. Both lists are empty if start and goal are
        joined only to each other.
        """
        return self.space.inside([self.start]), self.space.inside(self.goals)


def with_ends(graph: StateGraph, problem: Problem, reach: float) -> Ends:
    """Return the graph with the problem's start and goals; ends that are no states of it are joined to near states.

    Raises QueryError if the start or every goal is blocked or cannot be joined.

    Parameters
    ----------
    reach : m, largest distance of joined states
    """
    space, goals = problem.model.space, problem.goals
    ends = {START: space.state(problem.start)}
    ends |= {
        f"{GOAL} {place}" if len(goals) > 1 else GOAL: space.state(goal, free=space.angles)
        for place, goal in enumerate(goals)
    }
    states = {what: states_at(graph, end) for what, end in ends.items()}

    def straight(end: States) -> bool:
        """Return whether a straight path from the start may end here with any heading."""
        return bool(not states[START] and np.isnan(end.yaw[0]) and _distance(ends[START], end)[0] <= reach)

    beside = {what: end for what, end in ends.items() if not states[what] or straight(end)}
    if not beside:
        joined: TrajectoryGraph = graph
    else:
        joined = JoinedEnds(graph.model, graph.world, graph, beside, reach, spending=graph.spending)
        states |= joined.checked(list(ends)[1:])
    return Ends(joined, states[START][0], list(dict.fromkeys(id_ for what in list(ends)[1:] for id_ in states[what])))


def states_at(graph: StateGraph, end: States) -> list[int]:
    """Return the ids of the free states of the graph that equal an end (1,); a NaN in the end matches any value."""
    ids = graph.near(float(end.x[0]), float(end.y[0]), UNMOVED)
    states = graph.states(ids)
    free = graph.collision.states_free(states)
    return [int(id_) for id_ in ids[free & matches(graph.model.space, states, end)]]


def matches(space: StateSpace, states: States, end: States) -> BoolArray:
    """Mark the states (M,) that equal an end (1,), angles to three decimals; a NaN in the end matches any value."""
    is_end = np.ones(states.size, dtype=np.bool_)
    for name, off in space.differences(end, states).items():
        is_end &= ~(np.abs(off) > (HEADING_TOLERANCE if name in space.angles else UNMOVED))
    return is_end


@dataclass(frozen=True, eq=False)
class JoinedEnds(TrajectoryGraph):
    """Graph of states with additional nodes for a start and goals that are no states of it.

    inner  graph of states; the additional nodes follow its states
    ends   name -> state (1,): "start" and goals, in this order; NaN in coordinates that may have any value
    reach  m, distance within which states are joined to an end by a free turn, straight move and turn
    stops  names of those ends that are states of stops: joins lead to them and from them
    """

    has_clock = True

    inner: StateGraph
    ends: dict[str, States]
    reach: float
    stops: tuple[str, ...] = ()

    @property
    def states_alone(self) -> StateGraph:
        """The inner graph."""
        return self.inner

    def node(self, what: str) -> int:
        """Return the node of the end with a name, a key of ``ends``."""
        return self.inner.size + list(self.ends).index(what)

    @property
    def size(self) -> int:
        """Number of states, ends included."""
        return self.inner.size + len(self.ends)

    @property
    def words(self) -> str:
        """Description of the inner graph and the joins, in words."""
        counts = self.options["joined"]
        joined = [f"the {what} joined to {count} positions" for what, count in counts.items() if what not in self.stops]
        joined += [f"{len(self.stops)} states of stops joined to positions"] if self.stops else []
        by = f"at most a {', a '.join(self.joins.kinds[:-1])} and a {self.joins.kinds[-1]}"
        return f"{self.inner.words}, {' and '.join(joined)} within {self.reach:g} m by {by}"

    @property
    def options(self) -> dict[str, Any]:
        """Options of the inner graph, and the number of its positions joined to each end."""
        counts = {what: np.unique(self.inner.places(self.joined(what))).size for what in self.ends}
        return {**self.inner.options, "joined": counts}

    @cached_property
    def joins(self) -> MotionChains:
        """Arcs that join the ends to states and to each other, sorted by tail."""
        parts = [self._joins_of(what, leaving=what == START) for what in self.ends]
        parts += [self._joins_of(what, leaving=True) for what in self.stops]
        parts += [self._direct_join(what) for what in self.ends if START in self.ends and what != START]
        joins = MotionChains.all_of(parts)
        return joins.take(np.argsort(joins.tails, kind="stable"))

    def _direct_join(self, goal: str) -> MotionChains:
        """Return the join from the start to a goal, or none if they are out of reach or the join is not free."""
        ends = [self.ends[what] for what in (START, goal)]
        near = np.flatnonzero(_distance(*ends) <= self.reach)
        tails, heads = (np.full(near.size, self.node(what)) for what in (START, goal))
        return MotionChains.between(self.inner, tails, heads, *(end.take(near) for end in ends))

    def _joins_of(self, what: str, *, leaving: bool) -> MotionChains:
        """Return the free joins to the named end, or those leaving it, from or to the states within reach."""
        end = self.ends[what]
        ids = self.inner.near(float(end.x[0]), float(end.y[0]), self.reach)
        nodes = np.full(ids.size, self.node(what))
        states, end = self.inner.states(ids), end.take(np.zeros(ids.size, np.int64))
        if leaving:
            return MotionChains.between(self.inner, nodes, ids, end, states)
        return MotionChains.between(self.inner, ids, nodes, states, end)

    def joined(self, what: str) -> IntArray:
        """Return the states of the inner graph that are joined to the named end, nearest first."""
        node, end = self.node(what), self.ends[what]
        from_it, to_it = self.joins.tails == node, self.joins.heads == node
        ids = np.concatenate([self.joins.heads[from_it], self.joins.tails[to_it]])
        ids = ids[ids < self.inner.size]
        states = self.inner.states(ids)
        return ids[np.argsort(_distance(states, end), kind="stable")]

    def inside(self, nodes: list[int]) -> list[int]:
        """Return nodes, with each end replaced by the states joined to it."""
        ends = list(self.ends)
        parts = [
            [node] if node < self.inner.size else self.joined(ends[node - self.inner.size]).tolist() for node in nodes
        ]
        return [node for part in parts for node in part]

    def checked(self, goals: Sequence[str]) -> dict[str, list[int]]:
        """Return the nodes of each end by name: one node, or [] for a goal that cannot be used.

        Raises QueryError if the start, or every one of ``goals``, is blocked or cannot be joined.
        """
        reached = {*self.joins.tails.tolist(), *self.joins.heads.tolist()}
        lost = [what for what in self.ends if self.node(what) not in reached]
        if START in lost or set(goals) <= set(lost):
            raise QueryError(" ".join(map(self._reason_unusable, [START] if START in lost else lost)))
        return {what: [] if what in lost else [self.node(what)] for what in self.ends}

    def _reason_unusable(self, what: str) -> str:
        """Return the reason why the named end cannot be used, as text."""
        end = self.ends[what]
        whole = States(**{name: np.nan_to_num(column) for name, column in end.__dict__.items()})
        blocked = self.collision.why_blocked(whole)
        reason = blocked or (
            f"no position of {self.inner.words} within {self.reach:.3f} m has a free turn, straight move and turn "
            f"{'from' if what == START else 'to'} it; take a smaller step"
        )
        hint = elsewhere(self.model, self.world, end) if blocked else ""
        return f"the {what} ({end.x[0]:.3f}, {end.y[0]:.3f}) is not usable: {reason}.{hint}"

    def places(self, ids: IntArray) -> IntArray:
        """Return the place (N,) of each state in the inner graph; each end has a negative place of its own."""
        places = self.inner.size - 1 - ids
        inside = ids < self.inner.size
        places[inside] = self.inner.places(ids[inside])
        return places

    def states(self, ids: IntArray) -> States:
        """Return states (N,); the yaw of a goal with a free heading is NaN."""
        inside = ids < self.inner.size
        inner, ends = self.inner.states(ids[inside]), self.ends.values()
        columns = {}
        for name in self.model.space.names:
            columns[name] = np.empty(ids.size)
            columns[name][inside] = getattr(inner, name)
            columns[name][~inside] = np.array([getattr(end, name)[0] for end in ends])[ids[~inside] - self.inner.size]
        return States(**columns)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions of the inner graph."""
        return self.inner.kinds

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the inner graph with costs; the joins of each node follow its arcs."""
        inner, joins = self.inner.graph(criteria), self.joins
        self.spending.check("start and goal were joined", inner.heads.nbytes + inner.costs.nbytes)
        costs, is_reused = joins.costs(criteria), self.inner.is_reused
        if is_reused:  # a copy beside the inner graph, which stays
            self.spending.hold(inner.heads.nbytes + inner.costs.nbytes, "start and goal were joined")
        return inner.extended(self.size, joins.tails, joins.heads, costs, is_reused=is_reused)

    @property
    def counts(self) -> dict[str, int]:
        """Counts of the inner graph."""
        return self.inner.counts

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs of the inner graph are cached."""
        return self.inner.costed(criteria)

    def costed_in(self, world: World) -> JoinedEnds:
        """Return the graph with its arcs, free or not, to be costed in another world."""
        inner = self.inner.costed_in(world)
        return copied(replace(self, inner=inner, world=world), joins=replace(self.joins, graph=inner))

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Return values (m, ...) of the inner graph's arcs and (j, ...) of the joins, in the order of `graph`."""
        return inserted(inner, self._rows[self.joins.tails + 1], joins)

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Indices in `graph` of the arcs of the inner graph, and of the joins."""
        places = self._rows[self.joins.tails + 1]
        inner = np.arange(self.inner.arcs.heads.size)
        return inner + np.searchsorted(places, inner, side="right"), places + np.arange(places.size)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of turns in each arc of `graph`, joins included."""
        turns = self.joins.count(self.kinds[MOVE + 1 :]).astype(np.int8)
        return self.with_joins(self.inner.turned, turns)

    @property
    def rows(self) -> IntArray:
        """Row pointers (n + 1,) of the arcs of `graph`, joins included."""
        leaving = np.bincount(self.joins.tails, minlength=self.size)
        return self._rows + np.append(np.zeros(1, np.int64), np.cumsum(leaving))

    @property
    def heads(self) -> NDArray[np.int32]:
        """Heads (m,) of the arcs of `graph`, joins included."""
        return self.with_joins(self.inner.arcs.heads, self.joins.heads.astype(np.int32))

    @property
    def _rows(self) -> IntArray:
        """Row pointers (n + 1,) into the arcs of the graph that is extended; the rows of added ends are empty."""
        start = self.inner.arcs.start
        return np.append(start, np.full(len(self.ends), start[-1]))

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return trajectories through states (N,), ``sizes`` (n,) for each, with the motions of joins."""
        inside = ids < self.inner.size
        ends = np.cumsum(sizes)
        begins, whole = ends - sizes, sizes == 2
        inner = np.bincount(np.repeat(np.arange(sizes.size), sizes)[inside], minlength=sizes.size)
        from_start = ~inside[begins]
        to_goal = ~inside[ends - 1] & ~(whole & from_start)  # two joined ends share one join
        after, before = np.minimum(begins + 1, ends - 1), np.maximum(ends - 2, begins)
        return Stretches.joined(
            self.model.space,
            [
                self._joins_between(ids[begins], ids[after], from_start),
                self.inner.stretches(ids[inside], inner),
                self._joins_between(ids[before], ids[ends - 1], to_goal),
            ],
        )

    def _joins_between(self, tails: IntArray, heads: IntArray, is_present: BoolArray) -> Stretches:
        """Return the motions of the joins between nodes (n,); none where ``is_present`` (n,) is False."""
        rows = self.joins.rows(tails[is_present], heads[is_present])
        return self.joins.take(rows).stretches(is_present.astype(np.int64))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from start to goals, from the states joined to these, as text."""
        return self.inner.what_separates(self.inside([start])[0], self.inside(goals))


def _distance(states: States, end: States) -> FloatArray:
    """Return the distances (M,), m, of states from an end (1,)."""
    return np.asarray(np.hypot(states.x - end.x, states.y - end.y))
