"""The graph that all searches of a drive reuse, and known paths on it.

It is built once, in the world without people and named keep-out zones. Closed areas are masks over its arcs. After a
change of the world, only criteria that depend on the change are evaluated again.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.drive.closings import Closing, chains_closed, closed_arcs, no_way_out, states_by_place
from hpop.drive.known_paths import GoalJoin, KnownRoutes, arcs_between, joins_to_goals, named_heads, places_of_nodes
from hpop.drive.plan import speed_of
from hpop.frontier import is_nondominated
from hpop.motions import States
from hpop.motions.laws import SPEED
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble, claim_with_known_paths, search_stats
from hpop.planners.graphs.joined_ends import HEADING_TOLERANCE, UNMOVED, with_ends
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.speeds import with_speeds
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.tour_stops import with_stop_states
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.objectives import Objectives
from hpop.runtime.limits import Status
from hpop.search import Graph, ParetoPaths, SearchStats
from hpop.search.prepared import Prepared
from hpop.search.prepared.closings import known_paths
from hpop.search.queries import costs_along
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.spatial import KDTree

    from hpop.problems.problem import Problem
    from hpop.world import World

SAMPLED = 200  # arcs nearest to a change, evaluated to find the criteria that depend on it
CACHED = ("_places", "_finder", "_named", "_goal_joins", "tails")  # values that depend only on states and arcs
OF_PEOPLE = frozenset({"people", "moving people", "groups"})  # requirements of criteria that depend on people


@dataclass(frozen=True, eq=False)
class DriveGraph:
    """The graph of a drive, with its present costs and closed arcs.

    name      name of the planner that built it
    query     search problem on the graph, between a start and the goal, built in the bare world
    world     world in which costs are evaluated, with the present people and closed areas
    closings  closed areas
    masks     (c,) for each closed area, the indices of the arcs that it closes in the graph without start and goal
    reading   columns of the criteria whose costs depend on closed areas
    """

    name: str
    query: Query
    world: World
    closings: tuple[Closing, ...] = ()
    masks: tuple[IntArray, ...] = ()
    reading: frozenset[int] = frozenset()

    @classmethod
    def laid_out(
        cls,
        name: str,
        inner: StateGraph,
        problem: Problem,
        objectives: Objectives,
        closings: Sequence[Closing] = (),
        like: TrajectoryGraph | None = None,
        beside: bool = False,
    ) -> DriveGraph:
        """Build the graph from the start of a problem to its goal; ``inner`` is a graph of states in the bare world.

        The bare world has no people and no named keep-out zones; ``closings`` are the closed areas of the problem. If
        the graph ``like`` is given, stops of a tour have the same states as in it, and the robot may come to the start
        at any of several speeds. A start ``beside`` the graph is always joined. QueryError if start or goal cannot be.
        """
        began = time.perf_counter()
        ends = with_ends(inner, problem, inner.reach(problem), beside=beside)
        ends = ends._replace(space=with_stop_states(ends.space, problem, like))
        space, start, goals = with_speeds(ends, inner.model, objectives.optimised, moving=like is not None)
        costed = space if inner.world is problem.world else space.costed_in(problem.world)
        graph = costed.graph(objectives.optimised)
        query = Query(space, objectives, graph, start, goals, build_seconds=time.perf_counter() - began)
        masks = [closed_arcs(inner, closing, *states_by_place(inner)) for closing in closings]
        return cls(name, query, problem.world, tuple(closings), tuple(masks))

    def from_beside(self, problem: Problem, state: States | None = None, *, always: bool = False) -> DriveGraph:
        """Return this graph with a new start: that of a problem, a state off the graph, joined to it by motions.

        Criteria and closed areas stay. The problem must have the goal of the drive. Among moving people, the robot
        is at the start at the speed of ``state`` (1,). ``always`` joins any start, to farther states too.
        """
        inner = self.inner if state is None else self.inner.arriving_at(float(speed_of(state)[0]))
        like = self.query.space.one_layer
        joined = DriveGraph.laid_out(self.name, inner, problem, self.query.objectives, like=like, beside=always)
        return replace(joined, closings=self.closings, masks=self.masks, reading=self.reading)

    @property
    def inner(self) -> StateGraph:
        """The graph of states, without joined start and goal."""
        states = self.query.space.one_layer.states_alone
        assert states is not None  # the query was laid out on one
        return states

    @property
    def graph(self) -> Graph:
        """Arcs of the graph with their costs, including closed arcs."""
        return self.query.graph

    @cached_property
    def tails(self) -> IntArray:
        """Tail (m,) of each arc of the graph."""
        return np.repeat(np.arange(self.graph.nodes), np.diff(self.graph.indptr))

    @property
    def _is_goal(self) -> BoolArray:
        """Mask (n,) of the goals."""
        goals = np.zeros(self.graph.nodes, dtype=np.bool_)
        goals[self.query.goals] = True
        return goals

    @cached_property
    def _places(self) -> tuple[States, float]:
        return states_by_place(self.inner)

    @cached_property
    def closed(self) -> BoolArray:
        """Mask (m,) of the closed arcs of the graph, including arcs that join start and goal to it."""
        inner, chains = np.zeros(self.inner.arcs.heads.size, dtype=np.bool_), self.query.space.one_layer.joins
        for mask in self.masks:
            inner[mask] = True
        if chains is None:
            return self.query.space.with_joins(inner, inner[:0])
        joins = [np.zeros(chains.tails.size, np.bool_), *(chains_closed(chains, area) for area in self.closings)]
        return self.query.space.with_joins(inner, np.any(joins, axis=0))

    # Changes

    def changed(self, world: World, closings: Sequence[Closing], *, people: bool) -> DriveGraph:
        """Return the graph for a changed world and changed closed areas; ``people`` is True if people have changed."""
        masks, reading = [], set(self.reading)
        criteria = self.query.objectives.optimised
        for closing in closings:
            if closing in self.closings:
                masks.append(self.masks[self.closings.index(closing)])
                continue
            masks.append(closed_arcs(self.inner, closing, *self._places))
            reading |= self._reading(closing, criteria, world)
        for closing in self.closings:
            if closing not in closings and not reading:
                reading |= self._reading(closing, criteria, world)
        anew = {j for j, c in enumerate(criteria) if people and OF_PEOPLE & {*c.requires}} | reading
        changed = replace(self, world=world, closings=tuple(closings), masks=tuple(masks), reading=frozenset(reading))
        if anew:
            columns = sorted(anew)
            costs = self.graph.costs.copy()
            costs[:, columns] = self.query.space.costed_in(world).graph([criteria[j] for j in columns]).costs
            costs.setflags(write=False)
            changed = replace(changed, query=replace(self.query, graph=replace(self.graph, costs=costs)))
        return copied(changed, **{part: vars(self)[part] for part in CACHED if part in vars(self)})

    def _reading(self, closing: Closing, criteria: Sequence[Criterion], world: World) -> set[int]:
        """Return the columns of criteria whose costs near a closed area differ in `self.world` and ``world``.

        At most `SAMPLED` arcs that leave the states nearest to the area are compared.
        """
        states, _ = self._places
        x_min, y_min, x_max, y_max = closing.area.bounds
        dx, dy = np.maximum(x_min - states.x, states.x - x_max), np.maximum(y_min - states.y, states.y - y_max)
        apart = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
        nearest = np.argpartition(apart, SAMPLED - 1)[:SAMPLED] if apart.size > SAMPLED else np.arange(apart.size)
        arcs = self.inner.arcs
        ends = [np.arange(arcs.start[node], arcs.start[node + 1]) for node in nearest.tolist()]
        places = np.concatenate([np.zeros(0, np.int64), *ends])[:SAMPLED]
        tails = np.searchsorted(arcs.start, places, side="right") - 1
        columns = set[int]()
        for number, kind in enumerate(self.inner.kinds):
            own = arcs.kinds[places] == number
            if not own.any():
                continue
            motions = self.inner.motions(kind, tails[own], arcs.heads[places[own]].astype(np.int64))
            before, after = (replace(motions, world=world) for world in (self.world, world))
            for j, criterion in enumerate(criteria):
                if j not in columns and not np.array_equal(
                    motion_costs(criterion, before), motion_costs(criterion, after)
                ):
                    columns.add(j)
        return columns

    @cached_property
    def _finder(self) -> KDTree:
        """Search tree of all states of the graph without start and goal; angles are points on a circle."""
        from scipy.spatial import KDTree  # on first use: the import takes its time

        return KDTree(_points(self.inner, self._places[0]))

    def nodes(self, states: States, *, at_rest: bool = False) -> IntArray:
        """Return the nodes (N,) of the graph, without start and goal, at states (N,); -1 where there is no node.

        With several speeds, the nodes are those for the column ``speed`` of the states; without it, those at rest.
        """
        space = self.inner.model.space
        own = States(**{name: getattr(states, name) for name in space.names})
        nearest = np.asarray(self._finder.query(_points(self.inner, own))[1], np.int64)
        states_there = self._places[0].take(nearest)
        same = np.ones(nearest.size, dtype=np.bool_)
        for name, off in space.differences(own, states_there).items():
            same &= np.abs(off) <= (HEADING_TOLERANCE if name in space.angles else UNMOVED)
        speeds = speed_of(own if at_rest else states)
        same &= speeds >= -len(self.query.space.slower_turns)  # such turns are on the graph
        return np.where(same, self.query.space.in_layer(nearest, speeds), -1)

    def _with_start(self, nodes: IntArray, states: States) -> IntArray:
        """Return :meth:`nodes` (N,) of states, but where no node is, and a state equals an added start, its node."""
        space = self.query.space
        start, is_start = space.states(np.full(nodes.size, self.query.start)), nodes < 0
        if self.nodes(start.take([0]), at_rest=True)[0] >= 0:
            return nodes
        for off in self.inner.model.space.differences(states, start).values():
            is_start &= np.abs(off) <= UNMOVED
        layers = 0 if space.one_layer is space else space.in_layer(np.zeros_like(nodes), speed_of(states))
        return np.where(is_start, self.query.start + layers, nodes)

    def beginning(self, state: States) -> int:
        """Return the node of the start at the speed of a state (1,)."""
        space = self.query.space
        layer = 0 if space.one_layer is space else space.in_layer(np.zeros(1, np.int64), speed_of(state))[0]
        return self.query.start + int(layer)

    def arcs_of(self, trajectories: Sequence[Trajectory]) -> list[IntArray]:
        """Return for each trajectory the arcs of its last part on the graph, up to a goal; [] if it ends elsewhere."""
        return [arcs for arcs, _ in self.arcs_and_places(trajectories)]

    def arcs_and_places(self, trajectories: Sequence[Trajectory]) -> list[tuple[IntArray, IntArray]]:
        """Return for each trajectory the arcs as :meth:`arcs_of`, and the indices of its states at their tails."""
        if not trajectories:
            return []
        columns = {n: [getattr(t.states, n) for t in trajectories] for n in self.inner.model.space.names}
        places, columns[SPEED] = map(list, zip(*map(places_of_nodes, trajectories), strict=True))
        columns |= {n: [c[at] for c, at in zip(columns[n], places, strict=True)] for n in columns if n != SPEED}
        states, cuts = States(**{n: np.concatenate(c) for n, c in columns.items()}), np.cumsum([p.size for p in places])
        nodes = self.nodes(states)
        each = (np.split(found, cuts[:-1]) for found in (self._with_start(nodes, states), nodes < 0))
        return [self._arcs_along(*path) for path in zip(*each, places, trajectories, strict=True)]

    def all_arcs(self, trajectory: Trajectory) -> IntArray | None:
        """Return the arcs of a trajectory from its start on; None if it leaves the graph, or if an arc is closed."""
        (arcs,) = self.arcs_of([trajectory])
        first = int(self.nodes(trajectory.states.take([0]))[0])
        begins = self.tails[arcs[0]] == first if arcs.size else first in self.query.goals
        return arcs if begins and not self.closed[arcs].any() else None

    def _arcs_along(
        self, nodes: IntArray, added: BoolArray, places: IntArray, trajectory: Trajectory
    ) -> tuple[IntArray, IntArray]:
        """Return the arcs of the last part of a trajectory that ends at a goal, and the indices of its states there.

        The part begins after the last state off the graph. Both are empty if no arc leads on to the goal.

        nodes, places  (N,)  nodes of the trajectory, -1 off the graph, and the indices of its states at them
        added          (N,)  True for an added start, and off the graph
        """
        repeats = (nodes[1:] == nodes[:-1]) & ~added[1:]  # by holds; joins begin at any time
        distinct = np.flatnonzero(np.append(~repeats, True))
        nodes, places = nodes[distinct], places[distinct]
        last, final = nodes.size - 1, np.zeros(0, np.int64)
        if nodes[last] not in self.query.goals:  # a join leads to a goal beside the graph
            ways = ((i, join) for i, node in enumerate(nodes.tolist()) for join in self._goal_joins.get(node, ()))
            joined = ((i, join.arcs) for i, join in ways if join.is_end_of(trajectory, int(places[i])))
            last, final = next(joined, (0, final))
            if not final.size:
                return final, final
        tails = np.flatnonzero(~self.inner.is_marker(nodes[:last]))
        arcs = arcs_between(self.graph, self._named, nodes[tails], nodes[tails + 1])
        breaks = np.flatnonzero(arcs < 0)
        first = breaks[-1] + 1 if breaks.size else 0
        arcs = np.concatenate([arcs[first:], final])
        return arcs, places[np.append(tails, np.arange(last, nodes.size))[first : first + arcs.size]]

    @cached_property
    def _goal_joins(self) -> dict[int, list[GoalJoin]]:
        """Joins to goals beside the graph, by the node at which they begin."""
        added = self.query.space.in_layer(np.array([self.inner.size]), np.zeros(1))[0]
        beside = np.array([goal for goal in self.query.goals if goal >= added], np.int64)
        return joins_to_goals(self.graph, self.query.space, self.tails, self._named, beside)

    @cached_property
    def _named(self) -> NDArray[np.int32]:
        """Node (m,) that follows the tail of each arc in a path."""
        return named_heads(self.graph, self.query.space)

    def known_routes(self, paths: Sequence[IntArray]) -> KnownRoutes:
        """Return known paths, given by their arcs, with their remaining costs."""
        return KnownRoutes.of(paths, self.tails, self.graph, self.closed)

    # Search

    def prepared(self, before: DriveGraph | None = None, kept: Prepared | None = None) -> Prepared:
        """Return the graph prepared for searches, with the present closed arcs, and turns as the last tie-break.

        Parameters
        ----------
        before, kept : an earlier graph and its preparation. If the costs are unchanged, ``kept`` is changed in place
            and returned
        """
        if before is not None and kept is not None and before.graph is self.graph:
            kept.open(np.flatnonzero(before.closed & ~self.closed))
            kept.close(np.flatnonzero(self.closed & ~before.closed))
            return kept
        made = Prepared(
            self.graph if self.query.graph_with_tie_break is None else self.query.graph_with_tie_break, self.query.goals
        )
        made.close(np.flatnonzero(self.closed))
        return made

    def remaining_paths(
        self,
        prepared: Prepared,
        node: int,
        known: Sequence[IntArray],
        present: IntArray | None,
        deadline: float | None = None,
    ) -> ParetoPaths:
        """Return all non-dominated paths from a node to the goal, or the paths found until a deadline.

        Known paths need no search: they are returned even for a deadline of 0 s, unless a better path is found.

        Parameters
        ----------
        prepared : this graph from :meth:`prepared`
        known : arcs of known open paths from the node
        present : arcs of the present plan, which is preferred among paths with equal costs
        deadline : s of processor time of this thread; None for no deadline
        """
        several = [*known] if present is None else [present, *known]

        def search(graph: Graph) -> ParetoPaths:
            return prepared.paths(node, deadline=deadline, known=several)

        paths, known_paths = self.query.with_fewest_turns(search), self._unsearched(node, several)
        first = np.concatenate([len(paths) + np.arange(len(known_paths)), np.arange(len(paths))])  # known ones first
        paths = paths.and_those_of(known_paths)
        rows = first[is_nondominated(paths.costs[first])] if len(paths) else first
        return paths.select(paths.costs, rows[np.lexsort(paths.costs[rows].T[::-1])])

    def restored(self, node: int, answer: Mapping[str, Any]) -> ParetoPaths:
        """Rebuild the result of a search from ``node`` that was cut short; ``answer`` is from the event log."""
        logged = [np.array(path, np.int64) for path in answer["arcs"]]
        arcs = known_paths(self.graph, node, self._is_goal, logged, self.closed).paths
        paths, gap = self._unsearched(node, arcs), answer["gap"]
        stats = SearchStats("none", labels_generated=answer["labels"])
        return replace(paths, status=Status(answer["status"]), gap=math.inf if gap is None else gap, stats=stats)

    def _unsearched(self, node: int, several: Sequence[IntArray]) -> ParetoPaths:
        """Return known paths from a node, given by their arcs, as the result of a search without any work."""
        costs, stats = costs_along(self.graph, several), SearchStats("none")
        return ParetoPaths(costs, Status.TIME_LIMIT, stats, self.graph, node, tuple(several), gap=math.inf)

    def candidates(self, node: int, paths: ParetoPaths) -> Candidates:
        """Return paths from a node as trajectories of the planner that built the graph, with a claim of optimality."""
        query = replace(self.query, start=node, closed=self.closed)
        reason = self.closed_in(node) if paths.status is Status.NO_PATH else ""
        claim, stats = claim_with_known_paths(paths, self.where(query)), search_stats(paths, paths.gap)
        return assemble(self.name, query, paths, claim, reason=reason, stats=stats)

    def where(self, query: Query) -> str:
        """Return the description of a search for the certificate."""
        return query.where

    def unreachable(self, node: int) -> tuple[str, ...]:
        """Return the names of stops that must be visited but cannot be reached from a node: (), as there is no tour."""
        return ()

    def closed_in(self, node: int) -> str:
        """Return as text why no path leads to the goal from a node; "" if no area is closed."""
        return no_way_out(self.closings, self.query.space.states(np.array([node])), self.inner.model)


def _points(graph: StateGraph, states: States) -> FloatArray:
    """Return states (N,) as points (N, d), such that near states are near points, even across a turn of 2 pi."""
    columns: list[FloatArray] = []
    for name in graph.model.space.names:
        column = getattr(states, name)
        columns += [np.cos(column), np.sin(column)] if name in graph.model.space.turning else [column]
    return np.stack(columns, axis=1)
