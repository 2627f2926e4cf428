"""The graph of a drive, kept from its first moment to its last: ways from any of its nodes, and what is known of them.

It is laid out once, in the world without people and without the areas that have names; these are masks over its arcs,
which come and go. What a change makes of the costs is worked out for the criteria alone whose costs it changes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.drive.closings import Closing, chains_closed, closed_arcs, listed, states_by_place
from hpop.frontier import is_nondominated
from hpop.motions import Motions, States
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import assemble, claimed_with_known, search_stats
from hpop.planners.graphs.joined_ends import HEADING_TOLERANCE, UNMOVED, with_ends
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Status
from hpop.search import Graph, ParetoPaths, SearchStats
from hpop.search.prepared import Prepared
from hpop.search.prepared.closings import known_paths
from hpop.search.queries import costs_along
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from scipy.spatial import KDTree

    from hpop.problems.problem import Problem
    from hpop.world import World


@dataclass(frozen=True, eq=False)
class Known:
    """Ways to a goal, the arcs of all, one way after another, and what is still to go from each.

    Where only closings came since they were found, the open rests of optimal ways are optimal: alternatives became
    fewer.

    tails, arcs  (S,)
    ends         (S,)  where the way of each arc ends among these
    to_go        (S, k)  counts, from the tail of each arc to the goal
    closed       (S,)  whether an arc from there on is closed
    """

    tails: IntArray
    arcs: IntArray
    ends: IntArray
    to_go: IntArray
    closed: BoolArray

    @classmethod
    def of(cls, ways: Sequence[IntArray], tails: IntArray, graph: Graph, closed: BoolArray) -> Known:
        """Of ways, arcs each, through a graph whose arcs (m,) have these tails, some of them closed."""
        arcs = np.concatenate([np.zeros(0, np.int64), *ways])
        sizes = [way.size for way in ways]
        last = np.cumsum(np.array(sizes, np.int64))
        to_go = np.empty((arcs.size, graph.criteria), np.int64)
        shut = np.empty(arcs.size, dtype=np.bool_)
        worst = np.array(graph.aggregates) == "max"
        for end, size in zip(last.tolist(), sizes, strict=True):
            own = slice(end - size, end)
            costs = graph.costs[arcs[own]][::-1]
            to_go[own] = np.where(worst, np.maximum.accumulate(costs), np.cumsum(costs, axis=0))[::-1]
            shut[own] = np.logical_or.accumulate(closed[arcs[own]][::-1])[::-1]
        return cls(tails[arcs], arcs, np.repeat(last, sizes), to_go, shut)

    def rests(self, node: int) -> list[IntArray]:
        """The open rests of the ways from a node, arcs each, none of them dominated."""
        found = np.flatnonzero((self.tails == node) & ~self.closed)
        found = found[is_nondominated(self.to_go[found])] if found.size else found
        return [self.arcs[at : self.ends[at]] for at in found.tolist()]


ASKED = 200  # arcs nearest to a change that tell which criteria's costs it changes
KEPT = ("_places", "_finder", "tails")  # derived from the graph's states and arcs alone
OF_PEOPLE = frozenset({"people", "moving people", "groups"})  # what a criterion of theirs requires


def bare(world: World) -> World:
    """A world without what comes and goes while a robot drives: people, and closed areas that have names."""
    content = world.content
    zones = tuple(zone for zone in content.zones if not (zone.kind == "keep-out" and zone.name))
    if not content.people and len(zones) == len(content.zones):
        return world
    return world.with_content(landmarks=content.landmarks, zones=zones)


@dataclass(frozen=True, eq=False)
class Ways:
    """The graph of a drive, with its costs as they are now and what of it is closed now.

    name      of the planner whose graph it is
    query     the graph between a start and the goal, laid out in the bare world
    world     in which costs are, with the people and closings of now
    closings  areas that are closed
    masks     (c,) of each of these, which arcs of the inner graph it closes, by number
    reading   criteria, by column, whose costs closings change as well
    """

    name: str
    query: Query
    world: World
    closings: tuple[Closing, ...] = ()
    masks: tuple[IntArray, ...] = ()
    reading: frozenset[int] = frozenset()

    @classmethod
    def laid_out(
        cls, name: str, inner: StateGraph, problem: Problem, objectives: Objectives, closings: Sequence[Closing] = ()
    ) -> Ways:
        """The ways from a problem's start; ``inner`` is a graph of states in the bare world of the drive.

        closings  what of the problem's world is closed, which it is not in the bare one

        Raises QueryError where the start or the goal cannot be joined to it.
        """
        began = time.perf_counter()
        space, start, goals = with_ends(inner, problem, inner.reach(problem))
        costed = space if inner.world is problem.world else space.costed_in(problem.world)
        graph = costed.graph(objectives.optimised)
        query = Query(space, objectives, graph, start, goals, build_seconds=time.perf_counter() - began)
        masks = [closed_arcs(inner, closing, *states_by_place(inner)) for closing in closings]
        return cls(name, query, problem.world, tuple(closings), tuple(masks))

    def from_beside(self, problem: Problem) -> Ways:
        """The same ways from a problem's start that is no state of the graph: joined to it as exact ends are."""
        other = Ways.laid_out(self.name, self.inner, problem, self.query.objectives)
        return replace(other, closings=self.closings, masks=self.masks, reading=self.reading)

    @property
    def inner(self) -> StateGraph:
        """The graph of states, to which ends may be joined."""
        states = self.query.space.states_alone
        assert states is not None  # it was laid out of one
        return states

    @property
    def graph(self) -> Graph:
        """Arcs and their costs, closed ones among them."""
        return self.query.graph

    @cached_property
    def tails(self) -> IntArray:
        """Tail (m,) of each arc of the graph."""
        return np.repeat(np.arange(self.graph.nodes), np.diff(self.graph.indptr))

    @property
    def _is_goal(self) -> BoolArray:
        """Which nodes (n,) are goals."""
        goals = np.zeros(self.graph.nodes, dtype=np.bool_)
        goals[self.query.goals] = True
        return goals

    @cached_property
    def _places(self) -> tuple[States, float]:
        return states_by_place(self.inner)

    @cached_property
    def closed(self) -> BoolArray:
        """Which arcs (m,) of the graph are closed."""
        space = self.query.space
        inner = np.zeros(self.inner.arcs.heads.size, dtype=np.bool_)
        for mask in self.masks:
            inner[mask] = True
        if space.joins is None:
            return inner
        joins = np.zeros(space.joins.tails.size, dtype=np.bool_)
        for closing in self.closings:
            joins |= chains_closed(space.joins, closing)
        return space.with_joins(inner, joins)

    # Changes

    def changed(self, world: World, closings: Sequence[Closing], *, people: bool) -> Ways:
        """The same ways in a world with other people (``people``) or other closings, of which known ones stay masked.

        Costs are made anew of those criteria alone that read what changed.
        """
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
        other = replace(self, world=world, closings=tuple(closings), masks=tuple(masks), reading=frozenset(reading))
        if anew:
            columns = sorted(anew)
            costs = self.graph.costs.copy()
            costs[:, columns] = self.query.space.costed_in(world).graph([criteria[j] for j in columns]).costs
            costs.setflags(write=False)
            other = replace(other, query=replace(self.query, graph=replace(self.graph, costs=costs)))
        return copied(other, **{part: vars(self)[part] for part in KEPT if part in vars(self)})

    def _reading(self, closing: Closing, criteria: Sequence[Criterion], world: World) -> set[int]:
        """Which criteria read what is closed: their costs of the arcs nearest to a closing differ in the two worlds."""
        states, _ = self._places
        x_min, y_min, x_max, y_max = closing.area.bounds
        dx, dy = np.maximum(x_min - states.x, states.x - x_max), np.maximum(y_min - states.y, states.y - y_max)
        apart = np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0))
        nearest = np.argpartition(apart, ASKED - 1)[:ASKED] if apart.size > ASKED else np.arange(apart.size)
        arcs = self.inner.arcs
        ends = [np.arange(arcs.start[node], arcs.start[node + 1]) for node in nearest.tolist()]
        places = np.concatenate([np.zeros(0, np.int64), *ends])[:ASKED]
        tails = np.searchsorted(arcs.start, places, side="right") - 1
        found = set[int]()
        for number, kind in enumerate(self.inner.kinds):
            own = arcs.kinds[places] == number
            if not own.any():
                continue
            motions = self.inner.motions(kind, tails[own], arcs.heads[places[own]].astype(np.int64))
            before, after = (replace(motions, world=world) for world in (self.world, world))
            for j, criterion in enumerate(criteria):
                if j not in found and _differ(criterion, before, after):
                    found.add(j)
        return found

    # What is known of its nodes

    @cached_property
    def _finder(self) -> KDTree:
        """All states of the inner graph as points: what comes round lies on a circle."""
        from scipy.spatial import KDTree  # on first use: the import takes its time

        return KDTree(_points(self.inner, self._places[0]))

    def nodes(self, states: States) -> IntArray:
        """Nodes (N,) of the inner graph at which states are, -1 where there is none."""
        space = self.inner.model.space
        own = States(**{name: getattr(states, name) for name in space.names})
        nearest = self._finder.query(_points(self.inner, own))[1]
        there = self._places[0].take(nearest)
        same = np.ones(nearest.size, dtype=np.bool_)
        for name, off in space.differences(own, there).items():
            same &= np.abs(off) <= (HEADING_TOLERANCE if name in space.angles else UNMOVED)
        return np.where(same, nearest, -1)

    def ways_of(self, trajectories: Sequence[Trajectory]) -> list[IntArray]:
        """The last part of each trajectory that goes along arcs of the graph to a goal, as their numbers."""
        return [arcs for arcs, _ in self.ways_with_places(trajectories)]

    def ways_with_places(self, trajectories: Sequence[Trajectory]) -> list[tuple[IntArray, IntArray]]:
        """The same, and of each arc the number of the state from which it leads on."""
        if not trajectories:
            return []
        names = self.inner.model.space.names
        nodes = self.nodes(
            States(**{name: np.concatenate([getattr(t.states, name) for t in trajectories]) for name in names})
        )
        ends = np.cumsum([len(t) + 1 for t in trajectories])
        return [self._way(own) for own in np.split(nodes, ends[:-1])]

    def whole_way(self, trajectory: Trajectory) -> IntArray | None:
        """The arcs of a trajectory that goes along the graph from its beginning on, all of them open; None else."""
        (arcs,) = self.ways_of([trajectory])
        first = int(self.nodes(trajectory.states.take([0]))[0])
        begins = self.tails[arcs[0]] == first if arcs.size else first in self.query.goals
        return arcs if begins and not self.closed[arcs].any() else None

    def _way(self, nodes: IntArray) -> tuple[IntArray, IntArray]:
        """Arcs between the last of some nodes, to a goal, and the places of their tails; -1 is no node of the graph."""
        places = np.flatnonzero(np.append(nodes[1:] != nodes[:-1], True))  # one who stands stays at a node
        nodes = nodes[places]
        last, final = nodes.size - 1, np.zeros(0, np.int64)
        if nodes[last] not in self.query.goals:  # a join of up to three motions leads to a goal beside the graph
            beside = [goal for goal in self.query.goals if goal >= self.inner.size]
            for last in range(nodes.size - 2, max(nodes.size - 5, -1), -1):
                tail = np.full(len(beside), nodes[last])
                final = self._arcs(tail, np.array(beside, np.int64))[:1] if nodes[last] >= 0 else final
                if final.size and final[0] >= 0:
                    break
            else:
                return np.zeros(0, np.int64), np.zeros(0, np.int64)
        arcs = self._arcs(nodes[:last], nodes[1 : last + 1])
        breaks = np.flatnonzero(arcs < 0)
        first = breaks[-1] + 1 if breaks.size else 0
        arcs = np.concatenate([arcs[first:], final])
        return arcs, places[first : first + arcs.size]

    def _arcs(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Arcs (N,) of the graph between nodes, -1 where there is none."""
        found = np.full(tails.size, -1)
        here = np.flatnonzero((tails >= 0) & (heads >= 0))
        begins, ends = self.graph.indptr[tails[here]], self.graph.indptr[tails[here] + 1]
        for more in range(int((ends - begins).max(initial=0))):
            arcs = np.minimum(begins + more, ends - 1)
            hits = (begins + more < ends) & (self.graph.heads[arcs] == heads[here])
            found[here[hits]] = arcs[hits]
        return found

    def known(self, ways: Sequence[IntArray]) -> Known:
        """What is known of ways, arcs each."""
        return Known.of(ways, self.tails, self.graph, self.closed)

    # Search

    def prepared(self, before: Ways | None = None, kept: Prepared | None = None) -> Prepared:
        """Return the graph for searches, with turns as the last tie-break where no cost counts them.

        Arcs that are closed now are closed in it.

        Parameters
        ----------
        before, kept : earlier ways and what was prepared for them: where costs are the same, it is brought up to date
        """
        if before is not None and kept is not None and before.graph is self.graph:
            kept.open(np.flatnonzero(before.closed & ~self.closed))
            kept.close(np.flatnonzero(self.closed & ~before.closed))
            return kept
        made = Prepared(self.graph if self.query.tie_broken is None else self.query.tie_broken, self.query.goals)
        made.close(np.flatnonzero(self.closed))
        return made

    def rests(
        self,
        prepared: Prepared,
        node: int,
        known: Sequence[IntArray],
        present: IntArray | None,
        deadline: float | None = None,
    ) -> ParetoPaths:
        """Return all non-dominated paths from a node to the goal, or those found until a deadline.

        Known paths take no search: they are returned even after a deadline of 0 s, and stay where nothing is better.

        Parameters
        ----------
        prepared : the graph of these ways, as :meth:`prepared` makes it
        known : open paths from there, arcs each
        present : the present plan among them: it stands for all paths of its costs
        deadline : s of this thread's processor time, None for none
        """
        several = [*known] if present is None else [present, *known]

        def search(graph: Graph) -> ParetoPaths:
            return prepared.paths(node, deadline=deadline, known=several)

        paths, told = self.query.with_fewest_turns(search), self._told(node, several)
        first = np.concatenate([len(paths) + np.arange(len(told)), np.arange(len(paths))])  # what is known comes first
        paths = paths.and_those_of(told)
        kept = first[is_nondominated(paths.costs[first])] if len(paths) else first
        return paths.select(paths.costs, kept[np.lexsort(paths.costs[kept].T[::-1])])

    def told(self, node: int, answer: Mapping[str, Any]) -> ParetoPaths:
        """What was found from a node before, where a deadline cut it short, from how it was noted."""
        given = [np.array(way, np.int64) for way in answer["arcs"]]
        arcs = known_paths(self.graph, node, self._is_goal, given, self.closed).paths
        paths, gap = self._told(node, arcs), answer["gap"]
        stats = SearchStats("none", labels_generated=answer["labels"])
        return replace(paths, status=Status(answer["status"]), gap=math.inf if gap is None else gap, stats=stats)

    def _told(self, node: int, several: Sequence[IntArray]) -> ParetoPaths:
        """Return known paths from a node, the arcs of each, as the result of a search that did nothing."""
        costs, stats = costs_along(self.graph, several), SearchStats("none")
        return ParetoPaths(costs, Status.TIME_LIMIT, stats, self.graph, node, tuple(several), gap=math.inf)

    def candidates(self, node: int, paths: ParetoPaths) -> Candidates:
        """Return paths from a node as candidates of the planner that laid out the graph, with their claim."""
        query, reason = replace(self.query, start=node, closed=self.closed), ""
        if paths.status.is_final and self.closings:
            reason = f"no path: no way is open from where the robot may leave its plan; closed: {listed(self.closings)}"
        claim, stats = claimed_with_known(paths, query.where), search_stats(paths, paths.gap)
        return assemble(self.name, query, paths, claim, reason=reason, stats=stats)


def _differ(criterion: Criterion, before: Motions, after: Motions) -> bool:
    """Whether a criterion costs motions differently in two worlds."""
    return not np.array_equal(motion_costs(criterion, before), motion_costs(criterion, after))


def _points(graph: StateGraph, states: States) -> FloatArray:
    """States (N,) as points (N, d): near each other where the states are, whole turns apart or not."""
    columns: list[FloatArray] = []
    for name in graph.model.space.names:
        column = getattr(states, name)
        columns += [np.cos(column), np.sin(column)] if name in graph.model.space.turning else [column]
    return np.stack(columns, axis=1)
