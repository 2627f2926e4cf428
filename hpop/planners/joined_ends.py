"""Exact ends on any graph of states: a start or goal that is none of its states is joined to the states near by.

A join is one arc of up to three motions: a turn, a straight move, a turn. Criteria cost each of them, collisions are
looked for in each, as for all motions; a turn that is not needed is no motion. So a start or goal adds one node and no
chain of turns at one place: nothing leads back from the goal, nor to the start.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import BoolArray, Column, IntArray
from hpop.criteria.base import Criterion, motion_costs
from hpop.errors import QueryError
from hpop.math import wrap
from hpop.motions import Motions, States
from hpop.planners.base import quantised
from hpop.planners.goals import End, goals_of, start_of
from hpop.planners.search import Graph
from hpop.planners.state_graph import StateGraph
from hpop.planners.stretches import KINDS, MOVE, TURN, Stretches

if TYPE_CHECKING:
    from hpop.problem import Problem

UNMOVED = 1e-6  # m: an end that is so near to a state is at its place
HEADING_TOLERANCE = 2e-3  # rad: a yaw written with three decimals is on its heading
ALIGNED = 1e-9  # rad: a turn by less is none
MOTIONS = (TURN, MOVE, TURN)  # of a join
BY = "at most a turn, a move and a turn"
NODES = 2**31  # more than a graph has
START, GOAL = "start", "goal"


class Ends(NamedTuple):
    """A graph of states, and which of them are the start and the goals."""

    space: StateGraph
    start: int
    goals: list[int]

    @property
    def inside(self) -> tuple[list[int], list[int]]:
        """States of the graph itself that are the start and the goals, or to which these are joined, the nearest first.

        None where start and goal are joined to each other alone.
        """
        if isinstance(self.space, JoinedEnds):
            return self.space.inside([self.start]), self.space.inside(self.goals)
        return [self.start], self.goals


def with_ends(graph: StateGraph, problem: Problem, reach: float) -> Ends:
    """The graph, and what on it are start and goal; those that are no states of it are joined to those within reach.

    Raises QueryError for a start that is blocked, or to which nothing can be joined, and where all goals are so.

    Parameters
    ----------
    reach : m
    """
    start, goals = start_of(problem), goals_of(problem)
    poses: dict[str, End] = {START: start}
    poses |= {f"{GOAL} {place}" if len(goals) > 1 else GOAL: goal for place, goal in enumerate(goals)}
    states = {what: states_at(graph, end) for what, end in poses.items()}

    def straight(end: End) -> bool:
        """A path straight from the start to it need not end with a heading of the graph."""
        return not states[START] and end[2] is None and math.dist(start[:2], end[:2]) <= reach

    beside = {what: end for what, end in poses.items() if not states[what] or straight(end)}
    if not beside:
        joined: StateGraph = graph
    else:
        joined = JoinedEnds(graph.model, graph.world, graph, beside, reach, purse=graph.purse)
        states |= joined.checked(list(poses)[1:])
    return Ends(joined, states[START][0], list(dict.fromkeys(id_ for what in list(poses)[1:] for id_ in states[what])))


def states_at(graph: StateGraph, end: End) -> list[int]:
    """Ids of the free states at an end; with any heading where its yaw is None."""
    x, y, yaw = end
    ids = graph.near(x, y, UNMOVED)
    states = graph.states(ids)
    there = graph.collision.states_free(states)
    if yaw is not None:
        there &= is_on(states.yaw, yaw)
    return [int(one) for one in ids[there]]


def is_on(yaw: Column, heading: float) -> BoolArray:
    """Whether yaws, rad, are on a heading that may be written with three decimals."""
    return np.asarray(np.abs(wrap(yaw - heading)) <= HEADING_TOLERANCE)


@dataclass(frozen=True, eq=False)
class Joins:
    """Joins (J,) of one state to another: a turn towards it, a straight move, a turn to its heading.

    graph         tells what is free
    tails, heads  (J,)  nodes
    corners       the states (J,) before the first motion and after each
    present       whether (J,) each of the three is a motion
    """

    graph: StateGraph
    tails: IntArray
    heads: IntArray
    corners: tuple[States, ...]
    present: tuple[BoolArray, ...]

    @classmethod
    def between(cls, graph: StateGraph, tails: IntArray, heads: IntArray, states: States, ends: States) -> Joins:
        """Those joins of states (J,) to others that are free; a yaw of NaN at the end is that of the move."""
        apart = np.hypot(ends.x - states.x, ends.y - states.y) > UNMOVED
        arrives = np.where(np.isnan(ends.yaw), states.yaw, ends.yaw)
        ahead = np.where(apart, np.arctan2(ends.y - states.y, ends.x - states.x), arrives)
        last = np.where(np.isnan(ends.yaw), ahead, ends.yaw)
        turns = wrap(ahead - states.yaw), wrap(last - ahead)
        first, second = (np.where(np.abs(turn) > ALIGNED, turn, 0.0) for turn in turns)
        x, y = np.where(apart, ends.x, states.x), np.where(apart, ends.y, states.y)
        yaws = (states.yaw, states.yaw + first, states.yaw + first + second)
        corners = (
            States(x=states.x, y=states.y, yaw=yaws[0]),
            States(x=states.x, y=states.y, yaw=yaws[1]),
            States(x=x, y=y, yaw=yaws[1]),
            States(x=x, y=y, yaw=yaws[2]),
        )
        joins = cls(graph, tails, heads, corners, (first != 0.0, apart, second != 0.0))
        free = graph.collision.states_free(corners[0])
        for rows, motions in joins.motions():
            free[rows] &= graph.collision.motions_free(motions)
        return joins.take(np.flatnonzero(free))

    @classmethod
    def all_of(cls, parts: Sequence[Joins]) -> Joins:
        """The joins of several parts, in order."""
        corners = [
            States(**{name: np.concatenate([getattr(s, name) for s in states]) for name in states[0].names})
            for states in zip(*(part.corners for part in parts), strict=True)
        ]
        return cls(
            parts[0].graph,
            np.concatenate([part.tails for part in parts]),
            np.concatenate([part.heads for part in parts]),
            tuple(corners),
            tuple(np.concatenate(columns) for columns in zip(*(part.present for part in parts), strict=True)),
        )

    @property
    def turned(self) -> IntArray:
        """Turns (J,) in each join."""
        return self.present[0].astype(np.int64) + self.present[2]

    def take(self, rows: IntArray) -> Joins:
        """Some of the joins."""
        return Joins(
            self.graph,
            self.tails[rows],
            self.heads[rows],
            tuple(states.take(rows) for states in self.corners),
            tuple(present[rows] for present in self.present),
        )

    def motions(self) -> Iterator[tuple[IntArray, Motions]]:
        """The first motions, the moves and the last ones, each with the joins that it is of."""
        graph = self.graph
        for i, law in enumerate(MOTIONS):
            rows = np.flatnonzero(self.present[i])
            start, end = (self.corners[j].take(rows) for j in (i, i + 1))
            yield rows, Motions(graph.world, graph.model, graph.model.laws[KINDS[law]], start, end)

    def costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Costs (J, k) in quanta, rounded once a join."""
        costs = np.zeros((self.tails.size, len(criteria)))
        for rows, motions in self.motions():
            for j, criterion in enumerate(criteria):
                paid = motion_costs(criterion, motions)
                worst = criterion.aggregate == "max"
                costs[rows, j] = np.maximum(costs[rows, j], paid) if worst else costs[rows, j] + paid
        return np.stack([quantised(costs[:, j], criterion) for j, criterion in enumerate(criteria)], axis=1)

    def stretches(self, tails: IntArray, heads: IntArray, there: BoolArray) -> Stretches:
        """The joins between nodes (n,), where there are any, to be checked as parts of whole trajectories."""
        known, asked = self.tails * NODES + self.heads, tails * NODES + heads
        ranked = np.argsort(known, kind="stable")
        rows = ranked[np.searchsorted(known[ranked], asked[there])]
        kept = np.zeros((there.size, len(self.corners)), dtype=np.bool_)
        kept[there] = np.stack(
            [np.ones(rows.size, dtype=np.bool_), *(present[rows] for present in self.present)], axis=1
        )
        x, y, yaw = (
            np.stack([getattr(corner, name)[rows] for corner in self.corners], axis=1)[kept[there]]
            for name in ("x", "y", "yaw")
        )
        law = np.broadcast_to([MOVE, *MOTIONS], kept.shape)[kept]
        return Stretches(x, y, yaw, law, kept.sum(axis=1))


@dataclass(frozen=True, eq=False)
class JoinedEnds(StateGraph):
    """A graph of states and beside it a start, goals or both: one node each, after those of the graph.

    inner  the graph
    ends   "start", goals or both, in this order: the pose (x m, y m, yaw rad); a yaw of None leaves the heading free
    reach  m: states no farther away are joined to them, where there is a free turn, straight move and turn
    """

    inner: StateGraph
    ends: dict[str, End]
    reach: float

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
        return f"{self.inner.words}, {' and '.join(joined)} within {self.reach:g} m by {BY}"

    @property
    def options(self) -> dict[str, Any]:
        """The inner graph's, and to how many of its positions each end is joined."""
        counts = {what: np.unique(self.inner.places(self.joined(what))).size for what in self.ends}
        return {**self.inner.options, "joined": counts}

    @cached_property
    def joins(self) -> Joins:
        """The arcs beside those of the inner graph, by their tails."""
        found = [self._joins(what) for what in self.ends]
        found += [self._straight(what) for what in self.ends if START in self.ends and what != START]
        joins = Joins.all_of(found)
        return joins.take(np.argsort(joins.tails, kind="stable"))

    def _straight(self, goal: str) -> Joins:
        """The join of the start to a goal, if they are near each other and it is free."""
        ends = [_poses(self.ends[what], 1) for what in (START, goal)]
        near = np.flatnonzero(np.hypot(ends[1].x - ends[0].x, ends[1].y - ends[0].y) <= self.reach)
        tails, heads = (np.full(near.size, self.node(what)) for what in (START, goal))
        return Joins.between(self.inner, tails, heads, *(end.take(near) for end in ends))

    def _joins(self, what: str) -> Joins:
        """Free joins between an end and the states within reach."""
        x, y, _ = self.ends[what]
        ids = self.inner.near(x, y, self.reach)
        nodes = np.full(ids.size, self.node(what))
        states, end = self.inner.states(ids), _poses(self.ends[what], ids.size)
        if what == START:
            return Joins.between(self.inner, nodes, ids, end, states)
        return Joins.between(self.inner, ids, nodes, states, end)

    def joined(self, what: str) -> IntArray:
        """States of the inner graph to which an end is joined, the nearest first."""
        node, (x, y, _) = self.node(what), self.ends[what]
        from_it, to_it = self.joins.tails == node, self.joins.heads == node
        ids = np.concatenate([self.joins.heads[from_it], self.joins.tails[to_it]])
        ids = ids[ids < self.inner.size]
        states = self.inner.states(ids)
        return ids[np.argsort(np.hypot(states.x - x, states.y - y), kind="stable")]

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
        x, y, yaw = self.ends[what]
        reason = self.collision.why_blocked(_poses((x, y, yaw or 0.0), 1)) or (
            f"no position of {self.inner.words} within {self.reach:.3f} m has a free turn, straight move and turn "
            f"{'from' if what == START else 'to'} it; take a smaller step"
        )
        return f"the {what} ({x:.3f}, {y:.3f}) is not usable: {reason}."

    def places(self, ids: IntArray) -> IntArray:
        """Places (N,) of the inner graph; an end has one of its own, below 0."""
        places = self.inner.size - 1 - ids
        inside = ids < self.inner.size
        places[inside] = self.inner.places(ids[inside])
        return places

    def states(self, ids: IntArray) -> States:
        """Positions and yaws of states (N,); NaN is the yaw of a goal whose heading is free."""
        inside = ids < self.inner.size
        inner, ends = self.inner.states(ids[inside]), [_poses(end, 1) for end in self.ends.values()]
        columns = {}
        for name in ("x", "y", "yaw"):
            columns[name] = np.empty(ids.size)
            columns[name][inside] = getattr(inner, name)
            columns[name][~inside] = np.array([getattr(end, name)[0] for end in ends])[ids[~inside] - self.inner.size]
        return States(**columns)

    @property
    def turns(self) -> tuple[IntArray, IntArray]:
        """Those of the inner graph."""
        return self.inner.turns

    @property
    def moves(self) -> tuple[IntArray, IntArray]:
        """Those of the inner graph."""
        return self.inner.moves

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """The inner graph's arcs, and after those of each node its joins."""
        inner, joins = self.inner.graph(criteria), self.joins
        self.purse.check("start and goal were joined", inner.heads.nbytes + inner.costs.nbytes)
        rows = self._rows
        more = np.append(0, np.cumsum(np.bincount(joins.tails, minlength=self.size)))
        places = rows[joins.tails + 1]
        heads = np.insert(inner.heads, places, joins.heads)
        costs = np.insert(inner.costs, places, joins.costs(criteria), axis=0)
        heads.setflags(write=False)  # so that they are not copied again
        costs.setflags(write=False)
        return Graph.from_csr(rows + more, heads, costs, aggregates=inner.aggregates)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Turns (m,) in each arc of `graph`, those of joins among them."""
        return np.insert(self.inner.turned, self._rows[self.joins.tails + 1], self.joins.turned.astype(np.int8))

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
            [
                self.joins.stretches(ids[begins], ids[after], from_start),
                self.inner.stretches(ids[inside], inner),
                self.joins.stretches(ids[before], ids[ends - 1], to_goal),
            ]
        )

    def what_separates(self, start: int, goals: list[int]) -> str:
        """What the inner graph says of the states to which the ends are joined, in words."""
        return self.inner.what_separates(self.inside([start])[0], self.inside(goals))


def _poses(end: End, count: int) -> States:
    """One pose (count,) times; NaN for a yaw of None."""
    x, y, yaw = (np.full(count, np.nan if value is None else value) for value in end)
    return States(x=x, y=y, yaw=yaw)
