"""Answers for tours with more stops than a search over all states of each stop takes.

Each stop is fixed to one state of the graph, or to a few. These states are called sites (:mod:`.fixed_stops`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import IntArray
from hpop.errors import OptionError, QueryError
from hpop.goals.tour import MOST_LAYERS, Tour
from hpop.planners.base import Candidates
from hpop.planners.graphs.assemble import OFF, assemble, gap_text, memory_limit_notes, precision_text, search_stats
from hpop.planners.graphs.family import BuiltGraph
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.query import Query, built_query, tolerance_counts
from hpop.planners.graphs.tour_stops import tour_graph
from hpop.planners.needs import people_move
from hpop.planners.objectives import Objectives
from hpop.planners.searches.fixed_stops import ENDS, FixedStops, Fronts, TourPaths, chosen_states, stages_of
from hpop.planners.spending import Exhausted, Limits, Spending
from hpop.runtime.limits import Progress, Status
from hpop.search import ParetoPaths, SearchStats

if TYPE_CHECKING:
    from hpop.planners.searches import ExactSearch
    from hpop.problems.problem import Problem

MOST_ARCS = 8_000_000  # paths between sites, for all sets of decided stops; with more, the fronts are thinned
THINNED = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # relative errors that this may cause, tried one after another
ORDER = "tours in the order of the shortest one"
OTHERS = "other states within a stop's region may be better"


def fixes_stops(search: ExactSearch, problem: Problem) -> bool:
    """Return whether a planner must fix the stops of a problem's tour to few states each.

    Raises OptionError if another option of the planner does not allow it, or stop_states is given without a tour, and
    QueryError if people move.
    """
    if problem.tour is None:
        if search.stop_states is not None:
            raise OptionError("stop_states needs a problem with a tour; leave it out, or add stops")
        return False
    if search.stop_states is None and not problem.tour.has_many_layers:
        return False
    if search.max_detour is not None:
        raise OptionError(
            f"max_detour needs a tour with at most {MOST_LAYERS} sets of visited stops, which are six stops in any "
            "order, and no stop_states, since a mean does not add up over parts of a tour; leave max_detour out, and "
            "the integral is minimised, or keep more stops in order"
        )
    if people_move(problem):
        raise QueryError(
            f"among people who move, a tour must have at most {MOST_LAYERS} sets of visited stops, which are six stops "
            "in any order, and no stop_states, since paths between two stops depend on the time; keep more stops in "
            "order, leave stop_states out, or give people no velocity"
        )
    return True


def in_order_of_shortest(search: ExactSearch, query: Query, limits: Limits) -> Candidates | None:
    """Return the front of the tours in one order, that of the shortest tour, as an early result.

    The graph has a layer for each stop only. The shortest tour is that of :meth:`.FixedStops.shortest_tour`, with one
    state of each stop. None is returned without a tour, if its order is given already, if arcs are checked only
    when a path uses them, or if no such tour is found.

    query  query for all orders
    """
    layered, spending, criteria = query.space.tour_layers, query.space.spending, query.objectives.optimised
    if layered is None or query.free is not None or len(layered.tour.layers) <= len(layered.tour.remaining) + 1:
        return None
    held, tour, inner = spending.memory, layered.tour, layered.inner
    plain = replace(query, space=inner, graph=inner.graph(criteria), goals=list(layered.goals))
    sites = tuple(nodes[nodes.size // 2 :][:1] for nodes in layered.members)
    fixed = FixedStops(plain, replace(layered, members=sites), stages_of(tour))
    stops = (fixed.stages[number].stop for number in fixed.shortest_tour()[:, 0].tolist())
    order = [stop for stop in stops if stop != ENDS]
    if not order and not tour.optional:
        return None
    for stop in (i for i in tour.remaining if i not in order):  # stops that no path leads to
        order.insert(
            min((at for at, later in enumerate(order) if stop in tour.before[later]), default=len(order)), stop
        )
    chain = replace(layered, tour=replace(tour, order=tuple(pairwise(order))))
    one = replace(query, space=chain, graph=chain.layered(plain.graph, criteria), goals=chain.targets)
    front = one.exact(search.name, limits, eps=search.eps, tolerance=search.tolerance, stage=True)
    one.drop_ties()
    spending.release(spending.memory - held)
    origins = tuple(origin | {"stage": ORDER} for origin in front.provenance)
    return replace(front, provenance=origins).unfinished() if front.trajectories else None


def fixed_stop_answers(
    search: ExactSearch, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool
) -> Iterator[tuple[Candidates, BuiltGraph]]:
    """Yield the front of a tour whose stops are fixed to few states each, with the graph on which it was found.

    If ``in_stages``, the front of the tours in the order of the shortest tour comes first. It is also a part of the
    result if a limit ends the search.
    """
    tour, began = problem.tour, time.perf_counter()
    assert tour is not None
    for built in search.family.graphs(problem, objectives, spending):
        answer = _Answer.on(search, built, tour, objectives, began)
        fixed = answer.fixed
        built = replace(built, ends=Ends(fixed.layered, fixed.query.start, fixed.layered.targets))
        order = fixed.shortest_tour()
        first = answer.in_one_order(order) if len(order) else answer.none(Status.NO_PATH)
        if in_stages and len(first):
            with spending.paused():
                yield answer.candidates(first, stage=ORDER), built
        last = answer.in_all_orders(first) if len(order) else first
        yield answer.candidates(last, (1.0 + answer.thinned) * (1.0 + answer.share) * (1.0 + last.gap) - 1.0), built


@dataclass
class _Answer:
    """Search for tours whose stops are fixed to few states each (sites), with the paths between sites found so far.

    search   planner whose options apply
    fixed    the tour with its sites, on a graph
    slack    (k,)  absolute errors that are allowed, in quanta
    fronts   paths found so far, by the indices of the sites where they begin and end
    thinned  relative error that was accepted to make the fronts between sites smaller
    """

    search: ExactSearch
    fixed: FixedStops
    slack: IntArray
    fronts: dict[tuple[int, int], ParetoPaths]
    thinned: float = 0.0

    @classmethod
    def on(cls, search: ExactSearch, built: BuiltGraph, tour: Tour, objectives: Objectives, began: float) -> _Answer:
        """Build the query on a plain graph, and choose the states of the stops."""
        layered, start = tour_graph(built.ends, built.problem, tour, objectives.optimised)
        layered = layered.with_checked_arcs()
        ends = Ends(layered.inner, start, list(layered.goals))
        query = built_query(replace(built, ends=ends), objectives, began, search.max_turns)
        query.break_ties()
        stages = stages_of(tour)
        dwells = [layered.dwell_costs(stop, objectives.optimised) for stop in range(len(tour.stops))]
        pairs = {(stage.origin, stage.stop) for stage in stages}
        rows = chosen_states(query, layered.members, dwells, pairs, search.stop_states or 1)
        sites = tuple(nodes[np.sort(own)] for nodes, own in zip(layered.members, rows, strict=True))
        return cls(
            search,
            FixedStops(query, replace(layered, members=sites), stages),
            tolerance_counts(objectives, search.tolerance or {}),
            {},
        )

    @property
    def share(self) -> float:
        """Relative error s of the paths between sites, and again of the tours that are joined from them.

        Together they give the option ``eps``: (1 + s)² = 1 + eps.
        With max_turns the paths are exact: approximate ones may have more turns.
        """
        return 0.0 if self.search.max_turns is not None else math.sqrt(1.0 + self.search.eps) - 1.0

    def add_fronts(self, parts: IntArray) -> Status:
        """Search the paths that some parts need between their sites, and add their fronts to ``fronts``.

        Returns COMPLETE, or the status of the limit that ended the search.

        parts  (p, 3)  rows of :attr:`.FixedStops.parts`
        """
        spending = self.fixed.query.space.spending
        missing = [pair for pair in self.fixed.pairs(parts) if pair not in self.fronts]
        for done, pair in enumerate(missing, 1):
            try:
                limits = replace(spending.left(), checkpoint=None, progress=None)
                found = self.fixed.front_between(*pair, limits, self.share)
                if not found.status.is_final:
                    return found.status
                spending.hold(8 * found.all_arcs.size, "paths between stops were searched")
                self.fronts[pair] = found
                if spending.limits.progress:
                    spending.limits.progress(Progress("paths between stops", detail=f"{done} of {len(missing)}"))
            except Exhausted as stop:
                return stop.status
        return Status.COMPLETE

    def in_one_order(self, order: IntArray) -> TourPaths:
        """Return the front of the tours that visit given sites in a given order; none if a limit comes first.

        order  (p, 3)  rows of :attr:`.FixedStops.parts` that make up one tour
        """
        status = self.add_fronts(order)
        if status is not Status.COMPLETE:
            return self.none(status)
        return self.joined(order, self.fronts, replace(self.fixed.query.space.spending.left(), checkpoint=None))

    def in_all_orders(self, first: TourPaths) -> TourPaths:
        """Return the front of all tours; after a limit or Ctrl-C, the tours found, and the ``first`` ones."""
        parts = self.fixed.parts
        try:
            status = self.add_fronts(parts) if first.status.is_final else first.status
            if status is Status.COMPLETE:
                found = self.joined(parts, self.thin_fronts(), self.fixed.query.space.spending.left())
            else:
                found = self.none(status)
        except Exhausted as stop:
            found = self.none(stop.status)
        except KeyboardInterrupt:
            if not len(first):
                raise
            found = self.none(Status.INTERRUPTED)
        return found if found.status.is_final else found.with_tours_of(first)

    def none(self, status: Status) -> TourPaths:
        """Return a result without tours, of a search that ended with a status."""
        graph = self.fixed.query.graph
        costs = np.zeros((0, graph.criteria), np.int64)
        return TourPaths(costs, status, SearchStats("auto"), graph, 0, (), gap=math.inf)

    def joined(self, parts: IntArray, fronts: Fronts, limits: Limits) -> TourPaths:
        """Return the front of the tours made of ``parts``, which are rows (p, 3) of :attr:`.FixedStops.parts`."""
        eps = (1.0 + self.search.eps) / (1.0 + self.share) - 1.0
        return self.fixed.tours(fronts, parts, limits, eps, self.slack)

    def thin_fronts(self) -> Fronts:
        """Return the fronts between sites; if they make too many arcs, with fewer paths, within a relative error.

        Sets ``thinned`` to this error. With max_turns nothing is thinned: the remaining paths may have more turns.
        """
        pairs = [(origin, target) for _, origin, target in self.fixed.parts.tolist()]
        fronts: Fronts = self.fronts
        for eps in THINNED if self.search.max_turns is None else ():
            if sum(len(fronts[pair]) for pair in pairs) <= MOST_ARCS:
                break
            self.thinned = eps
            fronts = {pair: found.select(found.costs, cover(found.costs, eps)) for pair, found in self.fronts.items()}
        return fronts

    def candidates(self, paths: TourPaths, gap: float = math.inf, *, stage: str = "") -> Candidates:
        """Return tours as candidates, with a certificate that names the states of the stops.

        gap    upper bound on how much better missing tours through these states may be, relative (0.1 for 10 %);
               infinite if not known
        stage  name of an early result; "" for the last one
        """
        query = self.fixed.query
        toured = replace(query, space=self.fixed.layered)
        among = f"tours that stop at these states ({self.fixed.words}), on {toured.where}"
        stats = {"states": self.fixed.layered.inner.size, "fronts_between_stops": len(self.fronts)}
        found = assemble(
            self.search.name,
            toured,
            self._with_all_stats(paths),
            f"{stage}, for {among}; {OTHERS}" if stage else self._claim(paths, among, gap),
            provenance=[{"stage": stage} if stage else {}] * len(paths),
            notes=(self.note, *memory_limit_notes(paths)),
            stats=search_stats(paths, gap) | stats,
            reason=self._why_no_path if paths.status is Status.NO_PATH else "",
        )
        return found.unfinished() if stage else found

    def _claim(self, paths: TourPaths, among: str, gap: float) -> str:
        """Return, as text for the certificate, what holds for the last result.

        among  tours among which the front was searched, as text
        """
        tolerance = self.search.tolerance or {}
        if not paths.status.is_final:
            each = "points need not be optimal" if len(paths) else "the search found none"
            return (
                f"incomplete ({paths.status}): {each} for {among}, others are missing{gap_text(gap, tolerance)}; "
                f"{OTHERS}"
            )
        eps = (1.0 + self.search.eps) * (1.0 + self.thinned) - 1.0
        factor = precision_text(math.ceil(eps * 1e5 - 1e-6) / 1e5 if self.thinned else self.search.eps, tolerance)
        if factor:
            return (
                f"for {among}, every optimal cost vector is covered within {factor}; {OTHERS}; {OFF}, points need not "
                f"be optimal themselves; {self.fixed.query.rounded}"
            )
        return f"exact for {among}; {OTHERS}; {OFF}; {self.fixed.query.rounded}"

    @property
    def _why_no_path(self) -> str:
        """Reason why there is no tour, as text for a note."""
        fixed, turns = self.fixed, self.fixed.query.max_turns
        through = f"tours were searched through these states only: {fixed.words}"
        if turns is not None and len(fixed.shortest_tour()):
            return f"no path visits the stops with at most {turns} turns; {through}. Raise max_turns or stop_states"
        return f"{fixed.layered.what_separates(fixed.query.start, list(fixed.layered.goals))}; {through}"

    @property
    def note(self) -> str:
        """Note for the user: which method was used, and why."""
        layers, number = len(self.fixed.layered.tour.layers), self.search.stop_states
        why = (
            f"as stop_states is {number}"
            if number is not None
            else f"since the order leaves {layers:,} sets of visited stops, and all states of stops are searched for "
            f"at most {MOST_LAYERS} (six stops in any order)"
        )
        thinned = f"; fronts between stops were thinned within a factor {1 + self.thinned:g}" if self.thinned else ""
        few = "one of its states" if number in (None, 1) else f"at most {number} of its states"
        return f"each stop was fixed to {few}, {why}; the certificate names these states{thinned}"

    def _with_all_stats(self, paths: TourPaths) -> TourPaths:
        """Return tours whose statistics include the searches between sites."""
        each = [paths.stats, *(found.stats for found in self.fronts.values())]
        stats = replace(
            paths.stats,
            seconds_bounds=sum(one.seconds_bounds for one in each),
            seconds_search=sum(one.seconds_search for one in each),
        )
        return replace(paths, stats=stats)


def cover(costs: IntArray, eps: float) -> IntArray:
    """Return the indices of rows of ``costs`` (n, k) that cover all rows within a factor 1 + eps in each cost.

    The rows must be in lexicographic order.

    >>> cover(np.array([[100, 9], [101, 8], [150, 7]]), 0.2).tolist()
    [0, 2]
    """
    kept = list[int]()
    for row, vector in enumerate(costs):
        if not (costs[kept] <= (1.0 + eps) * vector).all(axis=1).any():
            kept.append(row)
    return np.array(kept, np.int64)
