"""Query to a graph: which non-dominated paths lead from a start to the goals? Every search answers such queries."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.options import MOST, MOST_COUNTED, amounts
from hpop.errors import CriterionError, OptionError, did_you_mean
from hpop.frontier import is_nondominated
from hpop.planners.base import Candidates
from hpop.planners.graphs.arcs import TIE_TURNS, graph_with_tie_break, summed_columns
from hpop.planners.graphs.assemble import (
    ROUNDED,
    Plans,
    assemble,
    checked_edges_text,
    memory_limit_notes,
    search_claim,
    search_stats,
    static_plans,
)
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import refuse_moving
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Limits
from hpop.runtime.limits import Budget, Status
from hpop.search import Graph, ParetoPaths, pareto_paths, supported_paths
from hpop.search.lazy_paths import Free
from hpop.search.queries import SearchStats, costs_along
from hpop.search.supported.first_paths import first_paths

if TYPE_CHECKING:
    from hpop.planners.graphs.family import BuiltGraph
    from hpop.planners.graphs.timed import Timing
    from hpop.problems.problem import Problem
    from hpop.search.timed import TimedPaths

MAX_COSTS = 6
TIED = "no path is better in every cost than a point"


def refuse_unanswerable(problem: Problem, objectives: Objectives, what: str) -> None:
    """Raise QueryError if people move, and OptionError if there are too many costs.

    ``what`` names, for the error, a planner that does not consider time.
    """
    refuse_moving(problem, what)
    refuse_too_many(objectives)


def refuse_too_many(objectives: Objectives) -> None:
    """Raise OptionError if there are more costs than an exact search can handle."""
    if len(objectives.optimised) > MAX_COSTS:
        names = [criterion.name for criterion in objectives.optimised]
        raise OptionError(
            f"the exact search takes at most {MAX_COSTS} costs, got {len(names)}: {', '.join(names)}; leave some out"
        )


def tolerance_counts(objectives: Objectives, tolerance: Mapping[str, float]) -> IntArray:
    """Convert the option ``tolerance`` to whole numbers of quanta (k,), one for each cost.

    A quantum is the smallest step of a cost; ``tolerance`` has absolute errors by name of a cost. Values are rounded
    down, and costs without a tolerance get 0. Raises OptionError for an unknown cost or an invalid value.
    """
    names = [criterion.name for criterion in objectives.optimised]
    for name in tolerance:
        if name not in names:
            raise OptionError(
                f"tolerance must name costs that the search minimises ({', '.join(names)}), got {name!r}."
                f"{did_you_mean(name, names)} Leave it out, or add it to the criteria"
            )
    checked = amounts("tolerance", tolerance, MOST)
    slack = [checked.get(criterion.name, 0.0) / criterion.quantum for criterion in objectives.optimised]
    return np.array([min(math.floor(value + 1e-9), MOST_COUNTED) for value in slack], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Query:
    """Search task: a graph with costs, a start, goals and limits, of which the non-dominated paths are wanted.

    Searches of all kinds use it: with and without moving people, and while a robot drives.

    space          graph of trajectories, with nodes for the exact start and goals (:mod:`.joined_ends`)
    objectives     criteria that are minimised, and how the others are reported
    graph          arcs of ``space`` with integer costs, in multiples of ``quanta``
    start, goals   numbers of nodes
    build_seconds  s, time that building the graph took
    notes          remarks on start and goals, for the user
    max_turns      count  paths with more turns are left out; None for no limit
    closed         (m,)  mask of arcs that the paths of a drive may not use; None if all are open. Only certificates
                   and reasons use it: searches among moving people get a graph that is built without these arcs
    timing         clock, moving people and departure time; None if no person moves
    """

    space: TrajectoryGraph
    objectives: Objectives
    graph: Graph
    start: int
    goals: list[int]
    build_seconds: float = 0.0
    notes: tuple[str, ...] = ()
    max_turns: int | None = None
    closed: BoolArray | None = None
    timing: Timing | None = None

    # The query in numbers and in words

    @property
    def quanta(self) -> FloatArray:
        """Quanta (k,): the value of one unit of each integer cost, in the unit of its criterion."""
        if self.timing is not None:
            return self.timing.timed.quanta
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

    @property
    def free(self) -> Free | None:
        """Function that checks arcs for collisions: it takes arc indices and returns which of these arcs are free.

        None if all arcs of the graph are known to be free.
        """
        return None if self.space.is_checked else self.space.arcs_free

    def at_most(self) -> list[int | None]:
        """Return the upper bound of each cost, None for all but the turns; [] without max_turns."""
        return self.objectives.at_most(self.max_turns)

    @property
    def names(self) -> str:
        """Names of the criteria that are minimised, as text."""
        return self.objectives.names

    @property
    def part(self) -> str:
        """Description of the graph for the certificate: "the lattice of ..."; "the free part of ..." if unchecked."""
        return f"{'' if self.space.is_checked else 'the free part of '}{self.space.words}"

    @property
    def where(self) -> str:
        """Description, for the certificate, of the task: graph, clock, criteria, limit on turns and closed arcs."""
        in_time = "" if self.timing is None else f", {self.timing.words},"
        words = f"{self.part}{in_time or ','} for ({self.names})"
        if self.max_turns is not None:
            words += f" and at most {self.max_turns} turns"
        closed = 0 if self.closed is None else int(self.closed.sum())
        return f"{words}, {closed:,} of its edges closed" if closed else words

    @property
    def rounded(self) -> str:
        """Description, for the certificate, of how costs are rounded."""
        return ROUNDED if self.timing is None else self.timing.rounded(self.objectives)

    # Searches

    def paths(self, limits: Limits, *, eps: float = 0.0, slack: IntArray | None = None) -> ParetoPaths | TimedPaths:
        """Run the exact search and return all non-dominated paths, or those found before it reached a limit.

        With ``eps`` or ``slack``, fewer paths may be returned. If no limit ends the search: for each non-dominated cost
        vector p, the cost vector of a returned path is at most (1 + eps) p + slack.

        slack  (k,)  in quanta
        """
        slack = np.zeros(len(self.objectives.optimised), np.int64) if slack is None else slack
        if self.timing is not None:
            return self.timing.paths(self, limits, eps, slack)

        def search(graph: Graph) -> ParetoPaths:
            counts = slack.copy()
            if graph is self.graph_with_tie_break:
                counts[summed_columns(graph)[0]] *= TIE_TURNS
            return pareto_paths(
                graph,
                self.start,
                self.goals,
                budget=limits,
                progress=limits.progress,
                eps=eps,
                tolerance=counts.tolist(),
                at_most=self.at_most(),
                checkpoint=limits.checkpoint,
                free=self.free,
            )

        return self.with_fewest_turns(search)

    def exact(
        self,
        name: str,
        limits: Budget,
        *,
        eps: float = 0.0,
        tolerance: Mapping[str, float] | None = None,
        covered: float = math.inf,
        stage: bool = False,
    ) -> Candidates:
        """Run the exact search and return its paths as the candidates of the planner ``name``.

        If no limit ends the search: for each non-dominated cost vector p, the cost vector of a returned path is at most
        (1 + eps) p + tolerance. The tolerance is given by name, in the unit of the cost.

        Parameters
        ----------
        covered : relative error of an earlier stage: for every optimal cost vector it has a point that is worse by at
            most the factor 1 + covered; infinite without such a stage
        stage : whether a later stage follows; a time limit is then described as this stage's share of the time
        """
        slack = tolerance_counts(self.objectives, tolerance or {})
        paths = self.paths(Limits.of(limits), eps=eps, slack=slack)
        gap = min(paths.gap, covered)
        words: dict[str, Any] = (
            {} if self.timing is not None or self.graph_with_tie_break is None else {"optimal": TIED}
        )
        claim = search_claim(
            paths, self.where, self.rounded, eps=eps, tolerance=tolerance, gap=gap, stage=stage, **words
        )
        claim += checked_edges_text(self, paths)
        return assemble(name, self, paths, claim, notes=memory_limit_notes(paths), stats=search_stats(paths, gap))

    def answer(
        self, name: str, paths: Sequence[IntArray], claim: str, *, status: Status = Status.COMPLETE
    ) -> Candidates:
        """Return paths that a search of your own has found as the candidates of the planner ``name``.

        Parameters
        ----------
        paths : for each path its arcs, as indices in ``graph``, from the start to a goal
        claim : what the search guarantees for the paths, as text for the certificate
        status : how the search ended; a COMPLETE search without a path becomes NO_PATH
        """
        ended = Status.NO_PATH if not paths and status is Status.COMPLETE else status
        costs = costs_along(self.graph, paths)
        result = ParetoPaths(costs, ended, SearchStats(name), self.graph, self.start, tuple(paths))
        return assemble(name, self, result, claim)

    def first_answer(self, name: str, limits: Limits, *, quickly: bool = False) -> Candidates:
        """Return the paths that can be found within ``limits``, as an early result of the planner ``name``.

        These are supported paths, which minimise weighted sums of the costs. If a cost is a maximum, or arcs are still
        unchecked, they are the first paths of the exact search instead. If ``quickly`` and no arc is unchecked, only a
        few weight vectors are tried, by code that needs no compilation.
        """
        exactly = "max" in self.graph.aggregates or self.free is not None
        quickly &= self.free is None
        if quickly or not exactly:
            self.hold_copies()

        def search(graph: Graph) -> ParetoPaths:
            if quickly:
                return first_paths(graph, self.start, self.goals, limits, limits.progress)
            if exactly:
                return pareto_paths(
                    graph, self.start, self.goals, budget=limits, progress=limits.progress, free=self.free
                )
            return supported_paths(graph, self.start, self.goals, budget=limits, progress=limits.progress)

        what = "points of weighted costs" if quickly else f"{'non-dominated' if exactly else 'supported'} points"
        paths = self.with_fewest_turns(search)
        first = assemble(
            name,
            self,
            # the last stage says why there is no path
            replace(paths, status=Status.UNFINISHED) if paths.status is Status.NO_PATH else paths,
            f"{what} of {self.space.words}, for ({self.names})",
            provenance=[{"stage": what}] * len(paths),
            stats={"method": paths.stats.method, "peak_memory": paths.stats.peak_memory},
        )
        return first.unfinished()

    # Paths of a search

    def plans(
        self, paths: ParetoPaths | TimedPaths, common: Mapping[str, Any], own: Sequence[Mapping[str, Any]] | None
    ) -> Plans:
        """Convert the paths of a search to trajectories with costs and provenance.

        The provenance of each path consists of the entries of ``common`` and of its item in ``own``, if given. Among
        moving people, ``own`` is not used.
        """
        if self.timing is not None:
            return self.timing.plans(cast("TimedPaths", paths), common)
        return static_plans(self, cast(ParetoPaths, paths), common, own)

    def what_blocks(self, paths: ParetoPaths | TimedPaths) -> str:
        """Return the reason, as text, why a search without a result found no path.

        Too few turns may be allowed, people may block the robot, or a wall may separate start and goal.

        paths  result of the search; it knows which arcs were found to be blocked
        """
        if self.timing is not None:
            return self.timing.what_blocks(self)
        for j, bound in enumerate(self.at_most()):
            if bound is not None:
                turns = replace(self.graph, costs=self.graph.costs[:, [j]], aggregates=("sum",))
                least = pareto_paths(turns, self.start, self.goals, free=self.free).costs
                if len(least):
                    return f"no path has at most {bound} turns; the fewest turns are {least[0, 0]}. Raise max_turns"
        space = self.space if self.space.is_checked else self.space.without(cast(ParetoPaths, paths).blocked)
        return space.what_separates(self.start, self.goals)

    # Ties: of paths with equal costs, the one with the fewest turns is wanted

    @cached_property
    def graph_with_tie_break(self) -> Graph | None:
        """Copy of ``graph`` whose costs also prefer paths with fewer turns among paths with equal costs.

        None if no such copy is needed or possible (:func:`.arcs.graph_with_tie_break`).
        """
        return graph_with_tie_break(self.graph, self.space.turned, self.space.spending)

    def break_ties(self) -> None:
        """Make ``graph_with_tie_break`` now, not on first use, so that its memory is counted before the search."""
        if self.free is not None:
            self.hold_copies()
        _ = self.graph_with_tie_break

    def hold_copies(self) -> None:
        """Add the arrays of all layers of a tour to the memory that the limit counts, before a search makes them.

        Raises Exhausted if the limit would be passed. Without a tour, nothing happens.
        """
        if copies := self.graph.bytes_to_copy:
            self.space.spending.hold(copies, "the layers of the tour were copied")

    def drop_ties(self) -> None:
        """Free the memory of the graph copy that breaks ties, after its last search."""
        broken: Graph | None = vars(self).pop("graph_with_tie_break", None)
        if broken is not None:
            self.space.spending.release(broken.distinct_costs.nbytes)

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Run a search such that, of paths with equal costs, one with the fewest turns is returned.

        The search runs on the graph copy that breaks ties. Of paths that differ only in turns, one is kept afterwards,
        so a complete search loses nothing. A stopped search may return a path that a path not found yet dominates, if
        both have equal values of the first cost that is a sum.
        """
        if self.graph_with_tie_break is None:
            return self._within_turn_bound(search(self.graph))
        paths, first = search(self.graph_with_tie_break), summed_columns(self.graph)[0]
        costs = paths.costs.copy()
        turns = costs[:, first] % TIE_TURNS
        costs[:, first] //= TIE_TURNS
        order = np.lexsort((turns, *costs.T[::-1]))
        return paths.select(costs, order[is_nondominated(costs[order])])

    def _within_turn_bound(self, paths: ParetoPaths) -> ParetoPaths:
        """Return only the paths with at most max_turns turns, since some searches ignore this limit."""
        bounds = [math.inf if bound is None else bound for bound in self.at_most()]
        rows = np.flatnonzero((paths.costs <= np.array(bounds or math.inf)).all(axis=1))
        return paths if rows.size == len(paths) else paths.select(paths.costs, rows)


def built_query(
    built: BuiltGraph, objectives: Objectives, began: float | None = None, max_turns: int | None = None
) -> Query:
    """Compute the costs of all arcs of a graph and return the query for its start and goals.

    If a criterion has no cost for motions that collide, all arcs are checked for collisions first. Raises Exhausted if
    a limit is passed.

    built      the graph, with its start and goals
    began      value of :func:`time.perf_counter` when building the graph began, for statistics; None for now
    max_turns  largest number of turns of a path; None for no limit
    """
    began = time.perf_counter() if began is None else began
    (space, start, goals), notes = built.ends, built.notes
    space.spending.report("graph")
    try:
        graph = space.graph(objectives.optimised)
    except CriterionError as error:
        if space.is_checked:
            raise
        notes = (
            *notes,
            "all edges were checked for collisions before the search, not only those that it uses, because the cost of "
            f"an edge that collides could not be computed: {error}",
        )
        space = space.with_checked_arcs()
        graph = space.graph(objectives.optimised)
    seconds = time.perf_counter() - began
    return Query(space, objectives, graph, start, goals, build_seconds=seconds, notes=notes, max_turns=max_turns)
