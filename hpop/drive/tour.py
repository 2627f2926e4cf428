"""A drive along a tour: its progress, and its graph with a layer for each set of stops that may be done.

A stop is done if it was visited or skipped. A layer is a copy of the drive's graph. The graph is built when the drive
begins, and again after a stop was skipped that the tour's order does not allow to skip. After a visit, searches only
begin in another layer, so all that is known of the graph is kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.base.text import shown
from hpop.criteria.base import index_of_role
from hpop.criteria.visits import Visit, Visits, all_visits, missed_weights, weight_of
from hpop.drive.closings import listed
from hpop.drive.drive_graph import DriveGraph
from hpop.drive.known_paths import KnownRoutes
from hpop.drive.plan import SAME, between
from hpop.errors import DriveError, did_you_mean
from hpop.goals import Tour
from hpop.motions import HOLD, States
from hpop.planners.graphs.query import Query
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.tour import TourGraph
from hpop.planners.graphs.tour_stops import refuse_many_layers, tour_members
from hpop.problems.named_rows import StopVisit
from hpop.search.prepared import Prepared
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


@dataclass(frozen=True)
class TourProgress:
    """Stops of a tour that are done at some time of a drive.

    tour         the tour; its stops that are done include skipped ones, and those passed over
    since        s since the plan began; no further visit may begin before this time
    visits       visits so far, in order of time; their times are in s, on the clock of the drive
    passed_over  names of the optional stops that were missed because a later stop was visited
    skipped      names of the stops that were skipped on request, in this order
    """

    tour: Tour
    since: float = 0.0
    visits: tuple[StopVisit, ...] = ()
    passed_over: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()

    @property
    def remaining(self) -> tuple[str, ...]:
        """Names of the stops that remain, optional ones included, in the order in which the tour lists them."""
        return tuple(self.tour.names[i] for i in self.tour.remaining)

    def after(self, plan: Trajectory, t: float, lag: float, problem: Problem) -> TourProgress:
        """Return the progress at time ``t`` of a plan, s; ``lag`` is the time of the drive at which the plan began.

        Visits are assigned along the whole plan, so that it misses as few stops as possible by their weights. The
        visits that end by ``t`` are done. Optional stops that the order has only before such a visit are passed over.
        The problem has the present world, and the weights.
        """
        if not self.tour.remaining:
            return self
        onward = between(plan, self.since, plan.duration)
        (found,) = all_visits(self.tour, problem.world, [onward], missed_weights(problem.criteria))
        made = [visit for visit in found.visits if self.since + visit.end <= t + SAME]
        since = max(self.since, _standstill(plan, t))
        if not made:
            return replace(self, since=since)
        names, begin, layer, passed = self.tour.names, lag + self.since, 0, list(self.passed_over)
        for visit in made:
            step = next(step for step in self.tour.steps[layer] if step.stop == visit.stop)
            layer, passed = step.layer, [*passed, *(names[i] for i in step.skipped)]
        return replace(
            self,
            tour=replace(self.tour, done=tuple(self.tour.layers[layer])),
            since=max(since, self.since + made[-1].end),
            visits=(
                *self.visits,
                *(StopVisit(v.stop + 1, names[v.stop], begin + v.begin, begin + v.end) for v in made),
            ),
            passed_over=tuple(passed),
        )

    def coming(self, plan: Trajectory, t: float, tour: Tour, problem: Problem) -> Visits:
        """Return the visits of a plan that end after time ``t`` of the plan, s; their times are seconds after ``t``.

        A visit that is under way at ``t`` begins at 0. Missed are the optional stops that remain in ``tour``, the tour
        with the stops done at ``t``, and that the plan does not visit; ``problem`` has their weights.
        """
        weights = missed_weights(problem.criteria)
        (found,) = all_visits(self.tour, problem.world, [between(plan, self.since, plan.duration)], weights)
        ahead = [(visit, self.since - t) for visit in found.visits if self.since + visit.end > t + SAME]
        visits = tuple(Visit(v.stop, max(0.0, v.begin + lag), v.end + lag) for v, lag in ahead)
        made = {visit.stop for visit in visits}
        missed = [i for i in tour.remaining if tour.stops[i].optional and i not in made]
        return Visits(visits, weight_of(tour, missed, weights), found.complete)

    def without(self, stop: str) -> TourProgress:
        """Return the progress with one stop skipped, given by name; DriveError if it does not remain."""
        names = self.tour.names
        if not isinstance(stop, str) or stop not in names:
            raise DriveError(
                f"expected the name of a stop, got {shown(stop)}.{did_you_mean(stop, names)} The stops that remain are "
                f"{_listed(self.remaining)}; give one of these"
            )
        if stop not in self.remaining:
            done = "skipped" if stop in self.skipped else "passed over" if stop in self.passed_over else "visited"
            raise DriveError(
                f"stop {stop!r} was {done} already; the stops that remain are {_listed(self.remaining)}: skip one of "
                "these, or none"
            )
        tour = replace(self.tour, done=(*self.tour.done, stop))
        return replace(self, tour=tour, skipped=(*self.skipped, stop))


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


def _standstill(plan: Trajectory, t: float) -> float:
    """Return the time, s, at which the motion under way at ``t`` began; if the robot stands, when it came to rest."""
    times, kinds = plan.times, plan.kinds
    i = min(int(np.searchsorted(times, t + SAME, side="right")) - 1, len(plan))
    if i < len(plan) and kinds[i] != HOLD.kind and t > times[i] + SAME:
        return float(times[i])
    while i > 0 and kinds[i - 1] == HOLD.kind:
        i -= 1
    return float(times[i])


@dataclass(frozen=True, eq=False)
class TourDriveGraph(DriveGraph):
    """A drive's graph in layers (:class:`hpop.planners.graphs.tour.TourGraph`), with the present closed arcs.

    base   the drive's graph, of which each layer is a copy
    space  the states and arcs of all layers
    """

    base: DriveGraph = field(kw_only=True)
    space: TourGraph = field(kw_only=True)

    @classmethod
    def over(cls, base: DriveGraph, tour: Tour, before: TourDriveGraph | None = None) -> TourDriveGraph:
        """Build the graph for a tour; its first layer is that of the stops that are done in the tour.

        Parameters
        ----------
        before : an earlier graph, whose states of stops are reused if the states are equal
        """
        inner, criteria = base.query.space, base.query.objectives.optimised
        if before is not None and before.base.query.space is inner:
            none = np.zeros(0, np.int64)
            members = tuple(none if i in tour.done else own for i, own in enumerate(before.space.members))
        else:
            members = tour_members(inner, tour, base.world)
        goals = tuple(dict.fromkeys(base.query.goals))
        space = TourGraph(inner.model, base.world, inner, tour, members, goals, spending=inner.spending)
        query = replace(base.query, space=space, graph=space.layered(base.graph, criteria), goals=space.targets)
        return cls(base.name, query, base.world, base.closings, base=base, space=space)

    def from_beside(self, problem: Problem, state: States | None = None, *, always: bool = False) -> TourDriveGraph:
        """Return this graph with a new start; see :meth:`hpop.drive.drive_graph.DriveGraph.from_beside`."""
        return TourDriveGraph.over(self.base.from_beside(problem, state, always=always), self.space.tour)

    @property
    def inner(self) -> StateGraph:
        """The graph of states, without layers, start, goals and stops."""
        return self.base.inner

    @cached_property
    def closed(self) -> BoolArray:
        """Mask (m,) of the closed arcs; an arc is closed in all layers."""
        closed: BoolArray = self.space.in_layers(self.base.closed, np.zeros(1, np.bool_))
        return closed

    def allows(self, tour: Tour) -> bool:
        """Return whether one of the layers is that of the stops that are done in a tour."""
        return tour.layers[0] in self.space.tour.layers

    def node(self, inner: int, tour: Tour) -> int:
        """Return the node that node ``inner`` of the base graph has in the layer of the stops done in a tour."""
        return self.space.tour.layers.index(tour.layers[0]) * self.base.graph.nodes + inner

    def prepared(self, before: DriveGraph | None = None, kept: Prepared | None = None) -> Prepared:
        """Return the graph prepared for searches.

        If missed stops are a cost, each search begins with a path that misses the fewest of them and is short.
        """
        made = super().prepared(before, kept)
        missed = index_of_role("stops_missed", self.query.objectives.optimised)
        if missed is not None:
            made.break_ties(missed)
        return made

    def where(self, query: Query) -> str:
        """Return the description of the search for the certificate, with the stops that are done at its start."""
        layer = self.space.tour.layers[query.start // self.base.graph.nodes]
        done = [self.space.tour.names[i] for i in sorted(layer - self.space.tour.layers[0])]
        return f"{query.where}, after {', '.join(done)}" if done else query.where

    # Known paths

    def arcs_of(self, trajectories: Sequence[Trajectory]) -> list[IntArray]:
        """Return for each trajectory the arcs of its last part on the graph, up to a goal; its visits change the layer.

        The arcs are [] if the trajectory ends elsewhere, or if its visits do not lead through the layers.
        """
        of_base = self.base.arcs_and_places(trajectories)
        weights = missed_weights(self.query.objectives.optimised)
        visits = all_visits(self.space.tour, self.world, trajectories, weights)
        return [
            self._in_layers(arcs, trajectory.times[places], found.visits)
            for trajectory, (arcs, places), found in zip(trajectories, of_base, visits, strict=True)
        ]

    def _in_layers(self, arcs: IntArray, leaves: FloatArray, visits: Sequence[Visit]) -> IntArray:
        """Return the arcs in this graph of a path of the base graph with visits; [] if it does not lead to a goal.

        arcs    (n,)  arcs of the path in the base graph
        leaves  (n,)  s, time at which the robot leaves the tail of each of the n arcs
        """
        none, (tour, base), count = np.zeros(0, np.int64), (self.space.tour, self.base.graph), self.base.graph.nodes
        if not arcs.size:
            return none
        nodes = [*self.base.tails[arcs].tolist(), int(base.heads[arcs[-1]])]
        path, layer, later = list[int](), 0, [*visits]
        for k, (node, left) in enumerate(zip(nodes, [*leaves.tolist(), np.inf], strict=True)):
            while later and later[0].begin <= left + SAME:
                stop = later.pop(0).stop
                higher = next(step.layer for step in tour.steps[layer] if step.stop == stop)
                path += self._arc(layer * count + node, higher * count + node) if k else []
                layer = higher
            if k < arcs.size:
                path.append(int(self.graph.indptr[layer * count + node] + arcs[k] - base.indptr[node]))
        skipped = dict(tour.endings).get(layer)
        if skipped:
            path += self._arc(layer * count + nodes[-1], len(tour.layers) * count + self.space.goals.index(nodes[-1]))
        return none if skipped is None or min(path) < 0 else np.array(path, np.int64)

    def _arc(self, tail: int, head: int) -> list[int]:
        """Return the arc between two nodes, as a list; [-1] if there is none."""
        begin, end = self.graph.indptr[tail : tail + 2].tolist()
        return [begin + i for i in np.flatnonzero(self.graph.heads[begin:end] == head).tolist()] or [-1]

    # Stops out of reach

    def unreachable(self, node: int) -> tuple[str, ...]:
        """Return the names of the stops that must still be visited, but that no open path from a node reaches."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import breadth_first_order

        layer, begin = divmod(node, self.base.graph.nodes)
        is_open = ~self.base.closed
        ends = self.base.tails[is_open], self.base.graph.heads[is_open]
        links = csr_array((np.ones(ends[0].size, np.int8), ends), shape=(self.base.graph.nodes,) * 2)
        reached = np.zeros(self.base.graph.nodes, dtype=np.bool_)
        reached[breadth_first_order(links, begin, return_predecessors=False)] = True
        tour = self.space.tour
        due = [i for i, stop in enumerate(tour.stops) if i not in tour.layers[layer] and not stop.optional]
        return tuple(tour.names[i] for i in due if not reached[self.space.members[i]].any())

    def closed_in(self, node: int) -> str:
        """Return as text why no path leads on from a node: stops that cannot be reached, or closed areas."""
        lost = self.unreachable(node)
        if not lost:
            return super().closed_in(node)
        stops, skips = ", ".join(map(repr, lost)), ", ".join(f"drive.skip({name!r})" for name in lost)
        return (
            f"no path: from where the robot may change its plan, it cannot reach stop{'s' * (len(lost) > 1)} {stops}; "
            f"closed: {listed(self.closings)}. Open what is closed, or skip with {skips}"
        )


class TourGraphs:
    """The layered graph of a drive, its preparation for searches, and the paths of earlier searches on it."""

    def __init__(self, tour: Tour, trajectories: Sequence[Trajectory]) -> None:
        """Begin with the tour of a problem, of which no stop is done, and known trajectories.

        Raises QueryError for a tour with too many layers.
        """
        refuse_many_layers(tour, "a drive", "drive two tours, one after the other")
        self.tour, self._trajectories = tour, trajectories
        self._graph: TourDriveGraph | None = None
        self._prepared: Prepared | None = None
        self._arcs: list[IntArray] = []  # of the known trajectories
        self._last_paths: list[IntArray] = []
        self._routes: KnownRoutes | None = None

    def at(self, base: DriveGraph, tour: Tour | None = None) -> TourDriveGraph:
        """Return the layered graph over the drive's graph ``base``, for searches after the stops done in a tour.

        It is kept, and changed or built again only if ``base`` has changed or no layer fits the tour.
        """
        tour, before = tour or self.tour, self._graph
        if before is not None and not before.allows(tour):
            self.tour, self._last_paths = tour, []
        elif before is not None and before.base is base:
            return before
        same_layers = before is not None and before.space.tour is self.tour
        if before is not None and same_layers and before.base.graph is base.graph:  # only other areas are closed
            changed = {"world": base.world, "closings": base.closings, "base": base}
            self._graph = copied(before, without=("closed",), **changed)
        else:
            self._graph = TourDriveGraph.over(base, self.tour, before)
        if not same_layers:
            self._arcs = self._graph.arcs_of(self._trajectories)
        self._routes = self._graph.known_routes(self._arcs)
        self._prepared = self._graph.prepared(before if same_layers else None, self._prepared)
        return self._graph

    def known(self, graph: TourDriveGraph, node: int) -> list[IntArray]:
        """Return the arcs of the remaining parts, from a node of ``graph`` on, of known paths; [] for another graph."""
        if graph is not self._graph or self._routes is None:
            return []
        last = graph.known_routes(self._last_paths)
        return [arcs for routes in (self._routes, last) for arcs in routes.remaining(node)]

    def keep(self, graph: DriveGraph, paths: Sequence[IntArray]) -> None:
        """Keep the paths of a search for later ones, unless its graph was built for that search alone."""
        if graph is self._graph:
            self._last_paths = list(paths)

    def prepared(self, graph: TourDriveGraph) -> Prepared:
        """Return ``graph`` prepared for searches; the preparation is kept only for the graph of :meth:`at`."""
        if graph is self._graph and self._prepared is not None:
            return self._prepared
        return graph.prepared()
