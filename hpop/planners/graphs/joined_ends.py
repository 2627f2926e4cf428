"""Add the exact start and goals to a graph of states, each connected to the states near it.

Start and goals are called ends. An end that equals a state of the graph needs no new node. Otherwise it becomes one
additional node, and new arcs, called joins, connect it to near states. A join is a chain of motions: a turn, a straight
move and a turn, then motions of joints if the model has some (:class:`.arcs.MotionChains`). No join leads from a goal,
or to the start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, N, copied, inserted
from hpop.criteria.base import Criterion
from hpop.errors import QueryError
from hpop.motions import States
from hpop.planners.graphs.arcs import MOVE, MotionChains
from hpop.planners.graphs.state_graph import UNMOVED as UNMOVED  # imported from here by others
from hpop.planners.graphs.state_graph import StateGraph, WrappedGraph
from hpop.planners.graphs.trajectory_graph import NO_MARKER, Stretches, TrajectoryGraph, unmarked
from hpop.planners.needs import elsewhere
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World

HEADING_TOLERANCE = 2e-3  # rad: a yaw that was written with three decimals still equals the graph's heading
START, GOAL = "start", "goal"


class Ends(NamedTuple):
    """Graph, and its nodes for the start and the goals of a problem.

    space  the graph
    start  number of the start's node
    goals  numbers of the goals' nodes
    """

    space: TrajectoryGraph
    start: int
    goals: list[int]

    @property
    def inside(self) -> tuple[list[int], list[int]]:
        """States of the original graph at or near the start, and at or near the goals.

        If an end was added as a node, these are the states to which it is connected, nearest first. Both lists are
        empty if start and goal are connected only to each other.
        """
        return self.space.inside([self.start]), self.space.inside(self.goals)


def with_ends(graph: StateGraph, problem: Problem, reach: float, *, beside: bool = False) -> Ends:
    """Return the graph with nodes for the problem's start and goals.

    An end that equals a free state of the graph uses its node. Any other end becomes a new node, connected to states
    nearby; so does a goal with any heading that is near such a start. Raises QueryError if the start, or every goal, is
    blocked or cannot be connected.

    Parameters
    ----------
    reach : m, largest distance of states to which a new node is connected
    beside : the start becomes a new node even if it equals a state of the graph, and is connected up to twice as far
    """
    space, goals = problem.model.space, problem.goals
    reach = 2.0 * reach if beside else reach
    ends = {START: space.state(problem.start)}
    ends |= {
        f"{GOAL} {place}" if len(goals) > 1 else GOAL: space.state(goal, free=space.angles)
        for place, goal in enumerate(goals)
    }
    states = {what: [] if beside and what == START else states_at(graph, end) for what, end in ends.items()}

    def straight(end: States) -> bool:
        """Return whether a straight move may lead to a goal: it is near a start off the graph and takes any heading."""
        return bool(not states[START] and np.isnan(end.yaw[0]) and _distance(ends[START], end)[0] <= reach)

    new = {what: end for what, end in ends.items() if not states[what] or straight(end)}
    if not new:
        joined: TrajectoryGraph = graph
    else:
        joined = JoinedEnds(graph.model, graph.world, graph, new, reach, spending=graph.spending)
        states |= joined.checked(list(ends)[1:])
    return Ends(joined, states[START][0], list(dict.fromkeys(id_ for what in list(ends)[1:] for id_ in states[what])))


def states_at(graph: StateGraph, end: States) -> list[int]:
    """Return the numbers of the graph's collision-free states that equal a start or goal ``end`` (1,).

    A NaN in ``end`` matches any value. Angles may differ by HEADING_TOLERANCE, other coordinates by UNMOVED.
    """
    ids, space = graph.near(float(end.x[0]), float(end.y[0]), UNMOVED), graph.model.space
    states = graph.states(ids)
    is_end = graph.collision.states_free(states)
    for name, off in space.differences(end, states).items():
        is_end &= ~(np.abs(off) > (HEADING_TOLERANCE if name in space.angles else UNMOVED))
    return [int(id_) for id_ in ids[is_end]]


@dataclass(frozen=True, eq=False)
class JoinedEnds(WrappedGraph):
    """Graph of states with additional nodes for a start, goals or stops that do not equal any of its states.

    Arcs that connect these nodes (ends) to states, or the start to another end, are called joins. If joins may choose
    among speeds and turn rates, there is a further node for each choice but the fastest, the marker: a path that takes
    a join with this choice names it by the marker, between the ends of the join. No arc leads to a marker.

    inner  original graph; the additional nodes have the numbers after its states
    ends   state (1,) of each additional node, by name: "start" first, then goals, then stops; NaN in a coordinate that
           may have any value
    reach  m, distance within which states are connected to an end
    stops  names of the ends that are states of a tour's stops; these have joins in both directions
    """

    has_clock = True

    inner: StateGraph
    ends: dict[str, States]
    reach: float
    stops: tuple[str, ...] = ()

    @property
    def states_alone(self) -> StateGraph:
        """The original graph, without the additional nodes."""
        return self.inner

    @property
    def added_states(self) -> dict[str, States]:
        """State (1,) of each additional node, by name."""
        return self.ends

    def with_stops_joined(self, to: TrajectoryGraph) -> TrajectoryGraph:
        """Return ``to``, another graph of these states, with the joins to stops that this graph has."""
        alone = to.states_alone
        if not self.stops or alone is None:
            return to
        ends = {**to.added_states, **{what: self.ends[what] for what in self.stops}}
        return JoinedEnds(alone.model, alone.world, alone, ends, self.reach, self.stops, spending=alone.spending)

    def over_states(self, change: Callable[[StateGraph], StateGraph]) -> JoinedEnds:
        """Return the ends joined to the graph that ``change`` makes of the graph of states."""
        return replace(self, inner=change(self.inner))

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return a mask (N,): True for the ends, and for states of the inner graph in which the robot may stand.

        It is False for a start to which the robot comes at a speed (:meth:`.StateGraph.arriving_at`).
        """
        return self.inner.at_rest(ids)

    def in_layer(self, states: IntArray, speeds: FloatArray) -> IntArray:
        """Return, for nodes (N,) and speeds (N,), m/s, the nodes of their states at these speeds; ends stay."""
        return np.where(states < self.inner.size, self.inner.in_layer(states, speeds), states)

    @property
    def slower_turns(self) -> tuple[Mapping[str, str], ...]:
        """The slower turn rates among which paths of the inner graph choose."""
        return self.inner.slower_turns

    def node(self, what: str) -> int:
        """Return the node number of an end by its name in ``ends``."""
        return self.inner.size + list(self.ends).index(what)

    @property
    def size(self) -> int:
        """Number of nodes: the states of the inner graph, the added start, goals and stops, and markers."""
        return self._no_choice + 1 + int(self.joins.choices.max(initial=0))

    @property
    def _no_choice(self) -> int:
        """Number of the last added node; adding the number of a choice gives its marker."""
        return self.inner.size + len(self.ends) - 1

    def is_marker(self, nodes: IntArray) -> BoolArray:
        """Return a mask (N,): True for nodes that only say with which speed or turn rate a path takes an arc."""
        return self.inner.is_marker(nodes) | (nodes > self._no_choice)

    @cached_property
    def markers(self) -> IntArray | None:
        """Marker (m,) of each arc of `graph`, NO_MARKER for arcs without one; None if there is only one choice."""
        if self.inner.markers is None and not self.joins.choices.any():
            return None
        none = np.full(self.inner.arcs.heads.size, NO_MARKER)
        own = np.where(self.joins.choices > 0, self._no_choice + self.joins.choices, NO_MARKER)
        return self.with_joins(none if self.inner.markers is None else self.inner.markers, own)

    @property
    def words(self) -> str:
        """Description of the inner graph, and of how start, goals and stops are connected to it, for certificates."""
        counts = self.options["joined"]
        joined = [f"the {what} joined to {count} positions" for what, count in counts.items() if what not in self.stops]
        joined += [f"{len(self.stops)} states of stops joined to positions"] if self.stops else []
        return f"{self.inner.words}, {' and '.join(joined)} within {self.reach:g} m by {self.join_words}"

    @property
    def join_words(self) -> str:
        """Motions of which a join consists, for messages: "at most a turn, a move and a turn"."""
        slower = {kind for pace in self.slower_turns for kind in pace.values()}
        *kinds, last = (kind for kind in self.joins.kinds if kind not in slower)
        return f"at most a {', a '.join(kinds)} and a {last}"

    @property
    def options(self) -> dict[str, Any]:
        """Options of the inner graph, and for each end the number of positions to which it is connected."""
        counts = {what: np.unique(self.inner.places(self.joined(what))).size for what in self.ends}
        return {**self.inner.options, "joined": counts}

    @cached_property
    def joins(self) -> MotionChains:
        """All joins: arcs between ends and states, and from the start directly to other ends, sorted by tail."""
        parts = [self._joins_of(what, leaving=what == START) for what in self.ends]
        parts += [self._joins_of(what, leaving=True) for what in self.stops]
        parts += [self._direct_join(what) for what in self.ends if START in self.ends and what != START]
        joins = MotionChains.all_of(parts)
        return joins.take(np.argsort(joins.tails, kind="stable"))

    def _direct_join(self, end: str) -> MotionChains:
        """Return the join from the start to another end: one chain, or none if it is too long or collides."""
        ends = [self.ends[what] for what in (START, end)]
        near = np.flatnonzero(_distance(*ends) <= self.reach)
        tails, heads = (np.full(near.size, self.node(what)) for what in (START, end))
        return MotionChains.between(self.inner, tails, heads, *(states.take(near) for states in ends))

    def _joins_of(self, what: str, *, leaving: bool) -> MotionChains:
        """Return the collision-free joins between the named end and all states within ``reach``.

        They lead from the end to the states if ``leaving``, else from the states to the end.
        """
        end = self.ends[what]
        ids = self.inner.near(float(end.x[0]), float(end.y[0]), self.reach)
        nodes = np.full(ids.size, self.node(what))
        states, end = self.inner.states(ids), end.take(np.zeros(ids.size, np.int64))
        if leaving:
            return MotionChains.between(self.inner, nodes, ids, end, states)
        return MotionChains.between(self.inner, ids, nodes, states, end)

    def joined(self, what: str) -> IntArray:
        """Return the states of the inner graph to which the named end is connected, nearest first."""
        node, end = self.node(what), self.ends[what]
        from_it, to_it = self.joins.tails == node, self.joins.heads == node
        ids = np.concatenate([self.joins.heads[from_it], self.joins.tails[to_it]])
        ids = np.unique(ids[ids < self.inner.size])  # parallel joins have the same ends
        states = self.inner.states(ids)
        return ids[np.argsort(_distance(states, end), kind="stable")]

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the nodes with each end replaced by the states to which it is connected."""
        ends = list(self.ends)
        parts = [
            [node] if node < self.inner.size else self.joined(ends[node - self.inner.size]).tolist() for node in nodes
        ]
        return [node for part in parts for node in part]

    def checked(self, goals: Sequence[str]) -> dict[str, list[int]]:
        """Return a dict from the name of each end to a list: its node, or empty if the end cannot be connected.

        Names are those of ``ends``: "start", goals and stops. Raises QueryError if the start, or every one of
        ``goals``, is blocked or cannot be connected.
        """
        reached = {*self.joins.tails.tolist(), *self.joins.heads.tolist()}
        lost = [what for what in self.ends if self.node(what) not in reached]
        if START in lost or set(goals) <= set(lost):
            raise QueryError(" ".join(map(self._reason_unusable, [START] if START in lost else lost)))
        return {what: [] if what in lost else [self.node(what)] for what in self.ends}

    def _reason_unusable(self, what: str) -> str:
        """Return the error message for an end that cannot be used: it is blocked, or not connected to the graph."""
        end = self.ends[what]
        whole = States(**{name: np.nan_to_num(column) for name, column in end.__dict__.items()})
        blocked = self.collision.why_blocked(whole)
        reason = blocked or (
            f"the robot cannot drive {'from it' if what == START else 'to it'} by {self.join_words} without a "
            f"collision, for any position of {self.inner.words} within {self.reach:.3f} m; take a smaller step"
        )
        hint = elsewhere(self.model, self.world, end) if blocked else ""
        return f"the {what} ({end.x[0]:.3f}, {end.y[0]:.3f}) is not usable: {reason}.{hint}"

    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the position of each node; an end has a negative number that no other node has.

        The last end and all markers share a number.
        """
        places = self.inner.size - 1 - np.minimum(ids, self._no_choice)
        inside = ids < self.inner.size
        places[inside] = self.inner.places(ids[inside])
        return places

    def states(self, ids: IntArray) -> States:
        """Return the states (N,) with the given numbers; the yaw is NaN for a goal that accepts any heading.

        For a marker, it is the state of the last end.
        """
        ids = np.minimum(ids, self._no_choice)
        inside = ids < self.inner.size
        inner, ends = self.inner.states(ids[inside]), self.ends.values()
        columns = {}
        for name in self.model.space.names:
            columns[name] = np.empty(ids.size)
            columns[name][inside] = getattr(inner, name)
            columns[name][~inside] = np.array([getattr(end, name)[0] for end in ends])[ids[~inside] - self.inner.size]
        return States(**columns)

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph with costs; at each node, the arcs of the inner graph come first, then the joins."""
        inner, joins = self.inner.graph(criteria), self.joins
        copies = inner.arcs * (4 + 8 * len(criteria))
        self.spending.check("start and goal were joined", copies)
        costs, is_reused = joins.costs(criteria), self.inner.is_reused
        if is_reused:  # the inner graph stays in memory, and some searches copy its arcs
            self.spending.hold(copies, "start and goal were joined")
        return inner.extended(self.size, joins.tails, joins.heads, costs, is_reused=is_reused)

    def costed_in(self, world: World) -> JoinedEnds:
        """Return a graph with the same arcs, whose costs are computed in another world; arcs are not checked again."""
        inner = self.inner.costed_in(world)
        return copied(replace(self, inner=inner, world=world), joins=replace(self.joins, graph=inner))

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Merge values of arcs into one array, in the order of the arcs of `graph`.

        inner  values (a, ...) of the arcs of the inner graph
        joins  values (j, ...) of the joins
        """
        return inserted(inner, self._rows[self.joins.tails + 1], joins)

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Indices in `graph` of the inner graph's arcs, and indices in `graph` of the joins."""
        places = self._rows[self.joins.tails + 1]
        inner = np.arange(self.inner.arcs.heads.size)
        return inner + np.searchsorted(places, inner, side="right"), places + np.arange(places.size)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of motions in place in each arc of `graph`, including joins; searches break ties by the sum."""
        turns = self.joins.count(self.kinds[MOVE + 1 :]).astype(np.int8)
        return self.with_joins(self.inner.turned, turns)

    @property
    def rows(self) -> IntArray:
        """Row pointers (n + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1 in `graph`."""
        leaving = np.bincount(self.joins.tails, minlength=self.size)
        return self._rows + np.append(np.zeros(1, np.int64), np.cumsum(leaving))

    @property
    def heads(self) -> NDArray[np.int32]:
        """Node (m,) to which each arc of `graph` leads, including joins."""
        return self.with_joins(self.inner.arcs.heads, self.joins.heads.astype(np.int32))

    @property
    def _rows(self) -> IntArray:
        """Row pointers (n + 1,) into the arcs of the inner graph alone, in which the ends have no arcs."""
        start = self.inner.arcs.start
        return np.append(start, np.full(self.size - self.inner.size, start[-1]))

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, including those of joins.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        ids, sizes, markers = unmarked(ids, sizes, ids > self._no_choice)
        choices = np.where(markers == NO_MARKER, 0, markers - self._no_choice)
        inside = ids < self.inner.size
        ends = np.cumsum(sizes)
        begins, whole = ends - sizes, sizes == 2
        inner = np.bincount(np.repeat(np.arange(sizes.size), sizes)[inside], minlength=sizes.size)
        from_start = ~inside[begins]
        to_goal = ~inside[ends - 1] & ~(whole & from_start)  # the join from start to goal is counted once
        after, before = np.minimum(begins + 1, ends - 1), np.maximum(ends - 2, begins)

        def joins_between(tails: IntArray, heads: IntArray, is_present: BoolArray) -> Stretches:
            tails, heads = tails[is_present], heads[is_present]
            rows = self.joins.rows(ids[tails], ids[heads], choices[heads])
            return self.joins.take(rows).stretches(is_present.astype(np.int64))

        of_start, of_goal = joins_between(begins, after, from_start), joins_between(before, ends - 1, to_goal)
        return Stretches.joined(self.model.space, [of_start, self.inner.stretches(ids[inside], inner), of_goal])

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text for an error, why no path leads from the start to the goals.

        The inner graph finds the reason, between a state to which the start is connected and the states to which goals
        are connected.
        """
        return self.inner.what_separates(self.inside([start])[0], self.inside(goals))


def _distance(states: States, end: States) -> FloatArray:
    """Return the distance (M,), m, of each state from a start or goal ``end`` (1,)."""
    return np.asarray(np.hypot(states.x - end.x, states.y - end.y))
