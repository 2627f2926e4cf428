"""Paths that pass through a region or across a line: two copies of a graph, before and after the passage.

A node is a state of the inner graph together with a layer: 0, or 1 where the passage was made. Arcs that make the
passage change the layer, and paths end in layer 1. So any search on this graph finds the paths that pass there, and its
optimality claims hold for them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.errors import QueryError
from hpop.motions import States, is_curve, laws_of
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.state_graph import ARC, WrappedGraph
from hpop.planners.graphs.timed import Timing
from hpop.planners.graphs.timed.assembly import timed_graph
from hpop.planners.graphs.timed.clock import TimeOptions
from hpop.planners.graphs.timed.plans import GraphOnClock
from hpop.planners.graphs.timed.tour_layers import TimedTour, table_rows
from hpop.planners.graphs.tour import NONE, TourGraph
from hpop.planners.graphs.trajectory_graph import Stretches, TrajectoryGraph
from hpop.planners.objectives import Objectives
from hpop.runtime.limits import within
from hpop.search import Graph
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.family import BuiltGraph
    from hpop.planners.graphs.joined_ends import JoinedEnds
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.problems.problem import Problem

SAMPLED = 0.02  # s between the states of a curve at which a passage is checked


@dataclass(frozen=True, eq=False)
class Passage:
    """Place where the base of a robot must pass: a region, or a line that it must cross.

    words   how a sentence names it after "passing": "left of the statue"
    shape   region; or, if ``across``, line of two points. m
    within  m, a path that comes at most this near to the region passes through it
    across  whether paths must cross the line, an odd number of times: a path that comes back does not pass there
    """

    words: str
    shape: BaseGeometry
    within: float = 0.0
    across: bool = False

    def made(self, x: FloatArray, y: FloatArray, to_x: FloatArray, to_y: FloatArray) -> BoolArray:
        """Return which straight moves (M,), from (x, y) to (to_x, to_y) in m, pass; moves in place do not."""
        if self.across:
            return self._crossed(x, y, to_x, to_y)
        x_min, y_min, x_max, y_max = self.shape.buffer(self.within + 1e-9).bounds
        near = (np.maximum(x, to_x) >= x_min) & (np.minimum(x, to_x) <= x_max)
        near &= (np.maximum(y, to_y) >= y_min) & (np.minimum(y, to_y) <= y_max)
        near &= (x != to_x) | (y != to_y)
        rows = np.flatnonzero(near)
        ends = np.stack([np.stack([x[rows], y[rows]], 1), np.stack([to_x[rows], to_y[rows]], 1)], 1)
        near[rows] = shapely.dwithin(shapely.linestrings(ends), self.shape, self.within)
        return near

    def _crossed(self, x: FloatArray, y: FloatArray, to_x: FloatArray, to_y: FloatArray) -> BoolArray:
        """Return which moves (M,) cross the line.

        Positions on the line count as on its left side, so that two moves that meet on the line cross it at most once.
        """
        (x0, y0), (x1, y1) = self.shape.coords
        length = float(np.hypot(x1 - x0, y1 - y0))
        along_x, along_y = (x1 - x0) / length, (y1 - y0) / length
        sides = [along_x * (v - y0) - along_y * (u - x0) for u, v in ((x, y), (to_x, to_y))]
        places = [along_x * (u - x0) + along_y * (v - y0) for u, v in ((x, y), (to_x, to_y))]
        changed = (sides[0] >= 0.0) != (sides[1] >= 0.0)
        apart = np.where(changed, sides[0] - sides[1], 1.0)
        at = places[0] + sides[0] / apart * (places[1] - places[0])
        return np.asarray(changed & (at >= 0.0) & (at <= length))

    def contains(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which positions (M,), m, lie in the region, so that a path from there passes; none for a line."""
        if self.across:
            return np.zeros(np.shape(x), np.bool_)
        return np.asarray(shapely.dwithin(shapely.points(x, y), self.shape, self.within))

    def holds(self, trajectories: Sequence[Trajectory]) -> BoolArray:
        """Return which trajectories (n,) pass; curves are sampled."""
        parts = [_places(trajectory) for trajectory in trajectories]
        if not parts:
            return np.zeros(0, np.bool_)
        sizes = np.array([len(part) for part in parts])
        x, y = np.concatenate(parts).T
        begins = np.cumsum(sizes) - sizes
        owner = np.repeat(np.arange(sizes.size), sizes)
        heads = np.delete(np.arange(x.size), begins)
        made = self.made(x[heads - 1], y[heads - 1], x[heads], y[heads])
        counts = np.bincount(owner[heads], made, minlength=sizes.size)
        return counts % 2 == 1 if self.across else (counts > 0) | self.contains(x[begins], y[begins])


def _places(trajectory: Trajectory) -> FloatArray:
    """Return the positions (m, 2), m, between which a trajectory goes straight, or nearly so in sampled curves."""
    states, laws = trajectory.states, laws_of(trajectory.model)
    if any(is_curve(laws[kind]) for kind in set(trajectory.kinds)):
        count = int(trajectory.duration / SAMPLED) + 2
        states = trajectory.at(np.union1d(np.linspace(0.0, trajectory.duration, count), trajectory.times))
    return np.stack([states.x, states.y], axis=1)


@dataclass(frozen=True, eq=False)
class PassingGraph(WrappedGraph):
    """Two copies of an inner graph of n nodes, before and after a passage: node v is v in one, n + v in the other.

    inner    graph whose arcs are straight moves, or motions in place
    passage  where paths must pass
    """

    passage: Passage

    @property
    def size(self) -> int:
        """Number of nodes."""
        return 2 * self.inner.size

    @property
    def words(self) -> str:
        """Description of the inner graph and of the passage, for certificates."""
        return f"{self.inner.words}, passing {self.passage.words}"

    @property
    def counts(self) -> dict[str, int]:
        """Numbers that describe the size of the inner graph, and the number of its arcs that make the passage."""
        return {**self.inner.counts, "passing_edges": int(self.passing.sum())}

    def states(self, ids: IntArray) -> States:
        """Return the robot states (N,) at some nodes, given by number."""
        return self.inner.states(ids % self.inner.size)

    @cached_property
    def passing(self) -> BoolArray:
        """Mask (m,) of the inner graph's arcs that make the passage."""
        states, heads = self.inner.states(np.arange(self.inner.size)), self.inner.heads
        counts = np.diff(self.inner.rows)
        x, y = states.x, states.y
        return self.passage.made(np.repeat(x, counts), np.repeat(y, counts), x[heads], y[heads])

    @property
    def rows(self) -> IntArray:
        """Row pointers (N + 1,): the arcs that leave node u have the indices rows[u] to rows[u + 1] - 1."""
        rows = self.inner.rows
        return np.append(rows, rows[1:] + rows[-1])

    @property
    def heads(self) -> NDArray[np.int32]:
        """Node (m,) to which each arc leads: the inner arcs from the first layer, then those from the second."""
        return _heads(self.inner.heads, self.passing, self.inner.size, across=self.passage.across)

    def begins(self, start: int) -> int:
        """Return the offset by which a start node of the inner graph becomes one of this graph.

        It is the size of the inner graph if the start lies in the region, so that the passage is already made; else 0.
        """
        begin = self.inner.states(np.array([start]))
        return self.inner.size if self.passage.contains(begin.x, begin.y)[0] else 0

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph: the inner arcs and their costs in both layers."""
        return self.layered(self.inner.graph(criteria))

    def layered(self, inner: Graph) -> Graph:
        """Return the search graph of both layers, given the search graph of the inner graph."""
        size = 2 * inner.arcs * (8 * inner.criteria + ARC)
        self.spending.hold(size, f"the layers before and after {self.passage.words} were built")
        costs = np.concatenate([inner.costs, inner.costs])
        graph = Graph.from_csr(self.rows, self.heads, costs, aggregates=inner.aggregates)
        return copied(graph, turns=inner.turns)

    @property
    def turned(self) -> NDArray[np.int8]:
        """Count (m,) of each arc by which searches break ties: that of the inner graph."""
        return np.concatenate([self.inner.turned, self.inner.turned])

    def arcs_free(self, arcs: IntArray) -> BoolArray:
        """Return a mask of arcs (N,), given by index: True for those that are free of collision."""
        return self.inner.arcs_free(arcs % self.inner.heads.size)

    def without(self, arcs: IntArray) -> TrajectoryGraph:
        """Return the graph without some blocked arcs (N,), given by index; both layers lose them."""
        return replace(self, inner=self.inner.without(np.unique(arcs % self.inner.heads.size)))

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the motions of n paths.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        return self.inner.stretches(ids % self.inner.size, sizes)

    def trajectories_through(self, ids: IntArray, sizes: IntArray) -> tuple[Trajectory, ...]:
        """Return n trajectories, those of the inner graph; arguments as for :meth:`stretches`."""
        return self.inner.trajectories_through(ids % self.inner.size, sizes)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return, as text, why no path from the start makes the passage and then ends at a goal."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order

        count, begin = self.inner.size, start % self.inner.size
        ends = [goal % count for goal in goals]
        size, heads, rows = count, self.inner.heads, self.inner.rows
        links = csr_array((np.ones(heads.size, np.int8), heads, rows), shape=(size, size))
        reached = np.zeros(size, np.bool_)
        reached[breadth_first_order(links, begin, return_predecessors=False)] = True
        if not reached[ends].any():
            return self.inner.what_separates(begin, ends)
        if not self.passing.any():
            return f"no motion of {self.inner.words} leads there without a collision"
        tails = np.repeat(np.arange(size), np.diff(rows))[self.passing]
        if not reached[tails].any():
            return f"it cannot be reached: {self.inner.what_separates(begin, self.inner.inside(tails.tolist()))}"
        if self.passage.across:
            return "each path that crosses the line there comes back across it"
        return "it can be reached, but no path leads from there to the goal"


def _heads(heads: IntArray | NDArray[np.int32], passing: BoolArray, count: int, *, across: bool) -> NDArray[np.int32]:
    """Return the heads (2 m,) of the arcs in both layers, from those (m,) of one layer of ``count`` nodes.

    passing  (m,)  arcs that make the passage: they lead from the first layer to the second; if ``across``, also back
    """
    second = heads + count * ~passing if across else heads + count
    return np.concatenate([heads + count * passing, second]).astype(np.int32)


def passing_query(query: Query, passage: Passage) -> Query:
    """Return a query that is restricted to the paths that make a passage; ``query`` must have no moving people."""
    space = PassingGraph(query.space.model, query.space.world, query.space, passage, spending=query.space.spending)
    start, count = query.start + space.begins(query.start), query.space.size
    goals = [goal + count for goal in query.goals]
    return replace(query, space=space, graph=space.layered(query.graph), start=start, goals=goals)


class TimedPassing(TimedTour):
    """Two layers of a graph on a clock, before and after a passage; built as those of a tour, but without stops."""

    def blocked_stops(self) -> Iterator[str]:
        """Yield nothing: there are no stops."""
        yield from ()

    @classmethod
    def of(cls, timed: GraphOnClock, space: PassingGraph, ends: Sequence[int]) -> TimedPassing:
        """Return the two layers of the graph on a clock ``timed``; ``ends`` are the nodes of its goals in one layer."""
        base, states_of = timed.graph, timed.arcs.states_of
        arcs, count = base.graph.arcs, base.graph.nodes
        space.spending.hold(2 * arcs * (8 * base.graph.criteria + ARC), f"the layers of {space.words} were built")
        states = space.inner.states(states_of)
        tails, heads = timed.arcs.tails, base.graph.heads
        passing = space.passage.made(states.x[tails], states.y[tails], states.x[heads], states.y[heads])
        layers = _heads(heads, passing, count, across=space.passage.across)
        goals = np.array(ends, np.int64) + count
        rows = table_rows(timed, np.tile(np.arange(arcs), 2), np.isin(layers, goals))
        clocked = np.flatnonzero(rows != NONE)
        indptr = np.append(base.graph.indptr, base.graph.indptr[1:] + arcs)
        costs = np.concatenate([base.graph.costs, base.graph.costs])
        graph = replace(
            base,
            graph=Graph.from_csr(indptr, layers, costs, aggregates=base.graph.aggregates),
            durations=np.tile(base.durations, 2),
            timed=clocked.astype(np.int32),
            rows=rows[clocked].astype(np.int32),
            place=np.tile(base.place, 2),
            stays=np.tile(base.stays, 2),
        )
        origins = np.tile(np.arange(arcs, dtype=np.int32), 2)
        none = np.full(2 * arcs, NONE, np.int32)
        return cls(timed, cast("TourGraph", space), graph, goals.tolist(), origins, none, np.zeros(1))


def timed_passing_query(
    built: BuiltGraph, passage: Passage, objectives: Objectives, problem: Problem, options: TimeOptions
) -> Query:
    """Return the query for the paths that make a passage, among the moving people of a problem.

    Raises the errors of :func:`.timed.timed_query`, and QueryError for a problem with a tour.
    """
    inner, start, ends = built.ends
    if not inner.has_clock:
        raise QueryError(
            f"among moving people, paths through a place are searched on a graph where the robot can wait, but "
            f"{inner.words} has no such positions; use the lattice, without a tour"
        )
    space = PassingGraph(inner.model, inner.world, inner, passage, spending=inner.spending)
    with within(space.spending):
        one_layer = cast("StateGraph | JoinedEnds", inner)
        timed = timed_graph(one_layer, objectives.optimised, start, ends, options, problem.quanta, passes_goals=True)
        layers = TimedPassing.of(timed, space, ends)
    begin = timed.start + timed.graph.graph.nodes * (space.begins(start) > 0)
    timing = Timing(timed, begin, options, problem.world.content.people, tour=layers)
    return Query(space, objectives, layers.graph.graph, start, layers.goals, notes=built.notes, timing=timing)
