"""Exact ends on any graph of states: a start or goal that is none of its states is joined to the states near by.

A join is one arc, a chain of up to three motions: a turn, a straight move, a turn (:mod:`.chains`). So a start or goal
adds one node and no turns from heading to heading: nothing leads back from the goal, nor to the start.
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
from hpop.planners.graphs.state_graph import UNMOVED as UNMOVED  # by this name too
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
    """A graph of states, and which of them are the start and the goals."""

    space: TrajectoryGraph
    start: int
    goals: list[int]

    @property
    def inside(self) -> tuple[list[int], list[int]]:
        """States of the graph itself that are the start and the goals, or to which these are joined, the nearest first.

        None where start and goal are joined to each other alone.
        """
        return self.space.inside([self.start]), self.space.inside(self.goals)


def with_ends(graph: StateGraph, problem: Problem, reach: float) -> Ends:
    """The graph, and what on it are start and goal; those that are no states of it are joined to those within reach.

    Raises QueryError for a start that is blocked, or to which nothing can be joined, and where all goals are so.

    Parameters
    ----------
    reach : m
    """
    space, goals = problem.model.space, problem.goals
    ends = {START: space.state(problem.start)}
    ends |= {
        f"{GOAL} {place}" if len(goals) > 1 else GOAL: space.state(goal, free=space.angles)
        for place, goal in enumerate(goals)
    }
    states = {what: states_at(graph, end) for what, end in ends.items()}

    def straight(end: States) -> bool:
        """A path straight from the start to it need not end with a heading of the graph."""
        return bool(not states[START] and np.isnan(end.yaw[0]) and _distance(ends[START], end)[0] <= reach)

    beside = {what: end for what, end in ends.items() if not states[what] or straight(end)}
    if not beside:
        joined: TrajectoryGraph = graph
    else:
        joined = JoinedEnds(graph.model, graph.world, graph, beside, reach, spending=graph.spending)
        states |= joined.checked(list(ends)[1:])
    return Ends(joined, states[START][0], list(dict.fromkeys(id_ for what in list(ends)[1:] for id_ in states[what])))


def states_at(graph: StateGraph, end: States) -> list[int]:
    """Ids of the free states at an end (1,); any will do in what is NaN there."""
    ids = graph.near(float(end.x[0]), float(end.y[0]), UNMOVED)
    states = graph.states(ids)
    there = graph.collision.states_free(states)
    return [int(one) for one in ids[there & alike(graph.model.space, states, end)]]


def alike(space: StateSpace, states: States, end: States) -> BoolArray:
    """Which states (M,) are an end, whose angles may be written with three decimals; what is NaN is free."""
    there = np.ones(states.size, dtype=np.bool_)
    for name, off in space.differences(end, states).items():
        there &= ~(np.abs(off) > (HEADING_TOLERANCE if name in space.angles else UNMOVED))
    return there


@dataclass(frozen=True, eq=False)
class JoinedEnds(TrajectoryGraph):
    """A graph of states and beside it a start, goals or both: one node each, after those of the graph.

    inner  the graph
    ends   "start", goals or both, in this order: the state (1,); what is NaN there is free
    reach  m: states no farther away are joined to them, where there is a free turn, straight move and turn
    """

    has_clock = True

    inner: StateGraph
    ends: dict[str, States]
    reach: float

    @property
    def states_alone(self) -> StateGraph:
        """The inner graph."""
        return self.inner

    def node(self, what: str) -> int:
        """Node of an end."""
        return self.inner.size + list(self.ends).index(what)

    @property
    def size(self) -> int:
        """Number of states, the ends among them."""
        return self.inner.size + len(self.ends)

    @property
    def words(self) -> str:
        """The inner graph, and how the ends are joined to it, in words."""
        joined = (f"the {what} joined to {count} positions" for what, count in self.options["joined"].items())
        by = f"at most a {', a '.join(self.joins.kinds[:-1])} and a {self.joins.kinds[-1]}"
        return f"{self.inner.words}, {' and '.join(joined)} within {self.reach:g} m by {by}"

    @property
    def options(self) -> dict[str, Any]:
        """The inner graph's, and to how many of its positions each end is joined."""
        counts = {what: np.unique(self.inner.places(self.joined(what))).size for what in self.ends}
        return {**self.inner.options, "joined": counts}

    @cached_property
    def joins(self) -> MotionChains:
        """The arcs beside those of the inner graph, by their tails."""
        found = [self._joins(what) for what in self.ends]
        found += [self._straight(what) for what in self.ends if START in self.ends and what != START]
        joins = MotionChains.all_of(found)
        return joins.take(np.argsort(joins.tails, kind="stable"))

    def _straight(self, goal: str) -> MotionChains:
        """The join of the start to a goal, if they are near each other and it is free."""
        ends = [self.ends[what] for what in (START, goal)]
        near = np.flatnonzero(_distance(*ends) <= self.reach)
        tails, heads = (np.full(near.size, self.node(what)) for what in (START, goal))
        return MotionChains.between(self.inner, tails, heads, *(end.take(near) for end in ends))

    def _joins(self, what: str) -> MotionChains:
        """Free joins between an end and the states within reach."""
        end = self.ends[what]
        ids = self.inner.near(float(end.x[0]), float(end.y[0]), self.reach)
        nodes = np.full(ids.size, self.node(what))
        states, end = self.inner.states(ids), end.take(np.zeros(ids.size, np.int64))
        if what == START:
            return MotionChains.between(self.inner, nodes, ids, end, states)
        return MotionChains.between(self.inner, ids, nodes, states, end)

    def joined(self, what: str) -> IntArray:
        """States of the inner graph to which an end is joined, the nearest first."""
        node, end = self.node(what), self.ends[what]
        from_it, to_it = self.joins.tails == node, self.joins.heads == node
        ids = np.concatenate([self.joins.heads[from_it], self.joins.tails[to_it]])
        ids = ids[ids < self.inner.size]
        states = self.inner.states(ids)
        return ids[np.argsort(_distance(states, end), kind="stable")]

    def inside(self, nodes: list[int]) -> list[int]:
        """States of the inner graph: the nodes themselves, or those to which the end that they are is joined."""
        ends = list(self.ends)
        parts = [
            [node] if node < self.inner.size else self.joined(ends[node - self.inner.size]).tolist() for node in nodes
        ]
        return [node for part in parts for node in part]

    def checked(self, goals: Sequence[str]) -> dict[str, list[int]]:
        """The node of each end, none of a goal that is not usable if another of the ``goals`` is.

        Raises QueryError for a start, or goals, that are blocked, or to which nothing can be joined.
        """
        reached = {*self.joins.tails.tolist(), *self.joins.heads.tolist()}
        lost = [what for what in self.ends if self.node(what) not in reached]
        if START in lost or set(goals) <= set(lost):
            raise QueryError(" ".join(map(self._refusal, [START] if START in lost else lost)))
        return {what: [] if what in lost else [self.node(what)] for what in self.ends}

    def _refusal(self, what: str) -> str:
        """Why an end cannot be used."""
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
        """Places (N,) of the inner graph; an end has one of its own, below 0."""
        places = self.inner.size - 1 - ids
        inside = ids < self.inner.size
        places[inside] = self.inner.places(ids[inside])
        return places

    def states(self, ids: IntArray) -> States:
        """Positions and yaws of states (N,); NaN is the yaw of a goal whose heading is free."""
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
        """Those of the inner graph."""
        return self.inner.kinds

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """The inner graph's arcs, and after those of each node its joins."""
        inner, joins = self.inner.graph(criteria), self.joins
        self.spending.check("start and goal were joined", inner.heads.nbytes + inner.costs.nbytes)
        costs, is_reused = joins.costs(criteria), self.inner.is_reused
        if is_reused:  # beside the inner graph, which is kept
            self.spending.hold(inner.heads.nbytes + inner.costs.nbytes, "start and goal were joined")
        return inner.extended(self.size, joins.tails, joins.heads, costs, is_reused=is_reused)

    @property
    def counts(self) -> dict[str, int]:
        """Counts of the inner graph."""
        return self.inner.counts

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs of the inner graph are kept from before."""
        return self.inner.costed(criteria)

    def costed_in(self, world: World) -> JoinedEnds:
        """The same states and arcs, whether free there or not, to be costed in another world."""
        inner = self.inner.costed_in(world)
        return copied(replace(self, inner=inner, world=world), joins=replace(self.joins, graph=inner))

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Return values (m, ...) of the inner graph's arcs and (j, ...) of the joins, in the order of `graph`."""
        return inserted(inner, self._rows[self.joins.tails + 1], joins)

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Where in `graph` the arcs of the inner graph are, and the joins."""
        places = self._rows[self.joins.tails + 1]
        inner = np.arange(self.inner.arcs.heads.size)
        return inner + np.searchsorted(places, inner, side="right"), places + np.arange(places.size)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Turns (m,) in each arc of `graph`, those of joins among them."""
        turns = self.joins.count(self.kinds[MOVE + 1 :]).astype(np.int8)
        return self.with_joins(self.inner.turned, turns)

    @property
    def _rows(self) -> IntArray:
        """Where the arcs (n + 1,) of each node begin among those of the inner graph, which has none of the ends."""
        start = self.inner.arcs.start
        return np.append(start, np.full(len(self.ends), start[-1]))

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Through states (N,), so many (n,) for each, the motions of joins written out."""
        inside = ids < self.inner.size
        ends = np.cumsum(sizes)
        begins, whole = ends - sizes, sizes == 2
        inner = np.bincount(np.repeat(np.arange(sizes.size), sizes)[inside], minlength=sizes.size)
        from_start = ~inside[begins]
        to_goal = ~inside[ends - 1] & ~(whole & from_start)  # of two nodes, the join between them is the first
        after, before = np.minimum(begins + 1, ends - 1), np.maximum(ends - 2, begins)
        return Stretches.joined(
            self.model.space,
            [
                self._joined(ids[begins], ids[after], from_start),
                self.inner.stretches(ids[inside], inner),
                self._joined(ids[before], ids[ends - 1], to_goal),
            ],
        )

    def _joined(self, tails: IntArray, heads: IntArray, there: BoolArray) -> Stretches:
        """The joins between nodes (n,), where there are any."""
        rows = self.joins.rows(tails[there], heads[there])
        return self.joins.take(rows).stretches(there.astype(np.int64))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """What the inner graph says of the states to which the ends are joined, in words."""
        return self.inner.what_separates(self.inside([start])[0], self.inside(goals))


def _distance(states: States, end: States) -> FloatArray:
    """How far (M,), m, places are from that of an end (1,)."""
    return np.asarray(np.hypot(states.x - end.x, states.y - end.y))
