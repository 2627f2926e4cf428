"""The query that every search answers: the non-dominated paths of a graph between its start and goals."""

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
from hpop.runtime.status import Budget, Status
from hpop.search import Graph, ParetoPaths, pareto_paths, supported_paths
from hpop.search.lazy_paths import Free
from hpop.search.queries import SearchStats, costs_along
from hpop.search.supported.first_paths import first_paths

if TYPE_CHECKING:
    from hpop.planners.graphs.family import BuiltGraph
    from hpop.planners.graphs.timed.timing import Timing
    from hpop.problems.problem import Problem
    from hpop.search.timed import TimedPaths

MAX_COSTS = 6
TIED = "no path is better in every cost than a point"


def refuse_unanswerable(problem: Problem, objectives: Objectives, what: str) -> None:
    """Raise QueryError if people move, OptionError for too many costs; ``what`` names the graph without a clock."""
    refuse_moving(problem, what)
    refuse_too_many(objectives)


def refuse_too_many(objectives: Objectives) -> None:
    """Raise OptionError for more costs than an exact search can handle."""
    if len(objectives.optimised) > MAX_COSTS:
        names = [criterion.name for criterion in objectives.optimised]
        raise OptionError(
            f"the exact search takes at most {MAX_COSTS} costs, got {len(names)}: {', '.join(names)}; leave some out"
        )


def tolerance_counts(objectives: Objectives, tolerance: Mapping[str, float]) -> IntArray:
    """Return the tolerances of all costs (k,) in quanta, rounded down, from amounts by name of the cost.

    Raises OptionError for an unknown cost or an invalid amount.
    """
    names = [criterion.name for criterion in objectives.optimised]
    for name in tolerance:
        if name not in names:
            raise OptionError(
                f"tolerance names {name!r}, which is no optimised cost.{did_you_mean(name, names)} "
                f"Optimised are {', '.join(names)}"
            )
    checked = amounts("tolerance", tolerance, MOST)
    slack = [checked.get(criterion.name, 0.0) / criterion.quantum for criterion in objectives.optimised]
    return np.array([min(math.floor(value + 1e-9), MOST_COUNTED) for value in slack], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Query:
    """Query to a graph of trajectories, for static, timed and prepared searches and for drives.

    space          graph of trajectories, with exact ends joined (:mod:`.joined_ends`)
    objectives     optimised criteria, and how they are reported
    graph          arcs with their integer costs, in ``quanta``
    start, goals   nodes
    build_seconds  s, time to build the graph
    notes          remarks on start and goals, for the user
    max_turns      count  paths with more turns are left out; None for no bound
    closed         (m,)  mask of closed arcs; None if all are open
    timing         clock, moving people and departure; None if no person moves
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
        """Quanta (k,) of the costs, in the criteria's units."""
        if self.timing is not None:
            return self.timing.timed.quanta
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

    @property
    def free(self) -> Free | None:
        """Function that marks the free ones of some arcs; None if all arcs of the graph are known to be free."""
        return None if self.space.is_checked else self.space.arcs_free

    def at_most(self) -> list[int | None]:
        """Return bounds (k,) on the costs; see :meth:`Objectives.at_most`."""
        return self.objectives.at_most(self.max_turns)

    @property
    def names(self) -> str:
        """Names of the optimised criteria, as text."""
        return self.objectives.names

    @property
    def part(self) -> str:
        """Description of the graph that is searched, as text for a claim."""
        return f"{'' if self.space.is_checked else 'the free part of '}{self.space.words}"

    @property
    def where(self) -> str:
        """Description of what a claim holds for: graph, clock, criteria, bounds and closed arcs."""
        in_time = "" if self.timing is None else f", {self.timing.words},"
        words = f"{self.part}{in_time} for ({self.names})"
        if self.max_turns is not None:
            words += f" and at most {self.max_turns} turns"
        closed = 0 if self.closed is None else int(self.closed.sum())
        return f"{words}, {closed:,} of its edges closed" if closed else words

    @property
    def rounded(self) -> str:
        """Description of how costs are rounded, as text for a claim."""
        return ROUNDED if self.timing is None else self.timing.rounded(self.objectives)

    # Searches

    def paths(self, limits: Limits, *, eps: float = 0.0, slack: IntArray | None = None) -> ParetoPaths | TimedPaths:
        """Find all non-dominated paths, or paths that cover them within ``eps`` and ``slack`` (k,), in quanta."""
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
        """Find all non-dominated paths, or paths that cover them, as the candidates of the planner ``name``.

        For every non-dominated cost vector p, a vector of at most (1 + eps) p + tolerance is returned; the tolerance
        is given by name, in the unit of the cost.

        Parameters
        ----------
        covered : points of an earlier stage cover every optimal vector within the factor 1 + covered
        stage : whether a later stage follows, so that a time limit is this stage's share of the time
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
        """Return paths of any search as the candidates of the planner ``name``.

        Parameters
        ----------
        paths : for each path its arcs, as indices in ``graph``, from the start to a goal
        claim : the planner's claim, as text
        status : how the search ended; a COMPLETE search without a path becomes NO_PATH
        """
        ended = Status.NO_PATH if not paths and status is Status.COMPLETE else status
        costs = costs_along(self.graph, paths)
        result = ParetoPaths(costs, ended, SearchStats(name), self.graph, self.start, tuple(paths))
        return assemble(name, self, result, claim)

    def first_answer(self, name: str, limits: Limits, *, quickly: bool = False) -> Candidates:
        """Return the points found within some limits as an early stage of the planner ``name``.

        Points are supported points. If a cost is a maximum, or arcs are not checked yet, they are the first points of
        the exact search. If ``quickly``, they are optima of a few weights, found without compiled kernels.
        """
        exactly = "max" in self.graph.aggregates or self.free is not None
        quickly &= self.free is None

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
            f"{what} of {self.space.words} for ({self.names})",
            provenance=[{"stage": what}] * len(paths),
            stats={"method": paths.stats.method, "peak_memory": paths.stats.peak_memory},
        )
        return first.unfinished()

    # Paths of a search

    def plans(
        self, paths: ParetoPaths | TimedPaths, common: Mapping[str, Any], own: Sequence[Mapping[str, Any]] | None
    ) -> Plans:
        """Return paths as plans; provenance consists of ``common`` entries and of the ``own`` entries of each path."""
        if self.timing is not None:
            return self.timing.plans(cast("TimedPaths", paths), common)
        return static_plans(self, cast(ParetoPaths, paths), common, own)

    def what_blocks(self, paths: ParetoPaths | TimedPaths) -> str:
        """Return the reason why there is no path, as text: too few turns allowed, people, or a wall in between."""
        if self.timing is not None:
            return self.timing.what_blocks(self)
        for j, bound in enumerate(self.at_most()):
            if bound is not None:
                turns = replace(self.graph, costs=self.graph.costs[:, [j]], aggregates=("sum",))
                least = pareto_paths(turns, self.start, self.goals).costs
                if len(least):
                    return f"no path has at most {bound} turns; the least is {least[0, 0]}. Raise max_turns"
        space = self.space if self.space.is_checked else self.space.without(cast(ParetoPaths, paths).blocked)
        return space.what_separates(self.start, self.goals)

    # Ties

    @cached_property
    def graph_with_tie_break(self) -> Graph | None:
        """Graph with the number of turns as a tie-break; None if a cost charges for every turn."""
        return graph_with_tie_break(self.graph, self.space.turned, self.space.spending)

    def break_ties(self) -> None:
        """Build the graph with the tie-break now, so that the search accounts for the memory of this copy."""
        _ = self.graph_with_tie_break

    def drop_ties(self) -> None:
        """Free the memory of the graph with the tie-break, after its last search."""
        broken: Graph | None = vars(self).pop("graph_with_tie_break", None)
        if broken is not None:
            self.space.spending.release(broken.costs.nbytes)

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Run a search; of paths with equal costs, return one with the fewest turns, even if no cost charges for turns.

        The search runs on the graph with the tie-break; paths that differ only in turns are dropped afterwards, so a
        complete search loses nothing. A stopped search may return a point that another point dominates, if both have
        the same first summed cost.
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
        """Return the paths that keep the bound on turns, as a search may have ignored the bound."""
        bounds = [math.inf if bound is None else bound for bound in self.at_most()]
        rows = np.flatnonzero((paths.costs <= np.array(bounds or math.inf)).all(axis=1))
        return paths if rows.size == len(paths) else paths.select(paths.costs, rows)


def built_query(
    built: BuiltGraph, objectives: Objectives, began: float | None = None, max_turns: int | None = None
) -> Query:
    """Compute the costs of all arcs of a built graph, and return its query; raise Exhausted if a limit is passed.

    If a criterion cannot cost motions that collide, all arcs are checked first.

    began  time at which building began, s of :func:`time.perf_counter`; None for now
    """
    began = time.perf_counter() if began is None else began
    (space, start, goals), notes = built.ends, built.notes
    space.spending.report("graph")
    try:
        graph = space.graph(objectives.optimised)
    except CriterionError as error:
        if space.is_checked:
            raise
        notes = (*notes, f"all edges were checked before the search, as some that were not have no cost: {error}")
        space = space.with_checked_arcs()
        graph = space.graph(objectives.optimised)
    seconds = time.perf_counter() - began
    return Query(space, objectives, graph, start, goals, build_seconds=seconds, notes=notes, max_turns=max_turns)
