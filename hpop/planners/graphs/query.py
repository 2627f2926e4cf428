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
from hpop.planners.graphs.arcs import TIE_TURNS, summed, tie_broken
from hpop.planners.graphs.assemble import (
    ROUNDED,
    Plans,
    assemble,
    at_memory_limit,
    claimed,
    looked_at,
    plans_of,
    search_stats,
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
    """Raise for queries that a graph without a clock, ``what``, cannot answer: moving people, or too many costs."""
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
    """Return tolerances (k,) in quanta, rounded down; raise OptionError for an unknown cost or an invalid amount."""
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
    """A query to a graph of trajectories, for static, timed and prepared searches and for drives.

    space          the graph, with exact ends joined (:mod:`.joined_ends`)
    objectives     the optimised criteria, and how they are reported
    graph          arcs with their integer costs, in `quanta`
    start, goals   nodes
    build_seconds  s
    notes          on the ends, for the user
    max_turns      count  paths with more turns are left out; None for no bound
    closed         (m,)  mask of closed arcs; None for none
    timing         clock, moving people and departure; None where no person moves
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
        """Function that marks free arcs; None where all arcs are known to be free."""
        return None if self.space.is_checked else self.space.arcs_free

    def at_most(self) -> list[int | None]:
        """Return bounds (k,) on the costs; see :meth:`Objectives.at_most`."""
        return self.objectives.at_most(self.max_turns)

    @property
    def names(self) -> str:
        """The optimised criteria, in words."""
        return self.objectives.names

    @property
    def part(self) -> str:
        """The part of the graph that is searched, in words."""
        return f"{'' if self.space.is_checked else 'the free part of '}{self.space.words}"

    @property
    def where(self) -> str:
        """The graph, clock, criteria, bounds and closed arcs for which a claim holds, in words."""
        in_time = "" if self.timing is None else f", {self.timing.words},"
        words = f"{self.part}{in_time} for ({self.names})"
        if self.max_turns is not None:
            words += f" and at most {self.max_turns} turns"
        closed = 0 if self.closed is None else int(self.closed.sum())
        return f"{words}, {closed:,} of its edges closed" if closed else words

    @property
    def rounded(self) -> str:
        """The rounding of costs, in words."""
        return ROUNDED if self.timing is None else self.timing.rounded(self.objectives)

    # Searches

    def paths(self, limits: Limits, *, eps: float = 0.0, slack: IntArray | None = None) -> ParetoPaths | TimedPaths:
        """Find all non-dominated paths, or a cover within ``eps`` and a slack (k,), in quanta of the objectives."""
        slack = np.zeros(len(self.objectives.optimised), np.int64) if slack is None else slack
        if self.timing is not None:
            return self.timing.paths(self, limits, eps, slack)

        def search(graph: Graph) -> ParetoPaths:
            counts = slack.copy()
            if graph is self.tie_broken:
                counts[summed(graph)[0]] *= TIE_TURNS
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
        """Find all non-dominated paths, or a cover within ``eps``, as the candidates of the planner ``name``.

        Every non-dominated cost vector p is then covered by one that is at most (1 + eps) p + tolerance, the tolerance
        in the units of the costs that it names.

        Parameters
        ----------
        covered : points of an earlier stage cover every optimal vector within the factor 1 + covered
        stage : whether a later stage follows, so that a time limit is this stage's share of the time
        """
        slack = tolerance_counts(self.objectives, tolerance or {})
        paths = self.paths(Limits.of(limits), eps=eps, slack=slack)
        gap = min(paths.gap, covered)
        words: dict[str, Any] = {} if self.timing is not None or self.tie_broken is None else {"optimal": TIED}
        claim = claimed(paths, self.where, self.rounded, eps=eps, tolerance=tolerance, gap=gap, stage=stage, **words)
        claim += looked_at(self, paths)
        return assemble(name, self, paths, claim, notes=at_memory_limit(paths), stats=search_stats(paths, gap))

    def answer(
        self, name: str, paths: Sequence[IntArray], claim: str, *, status: Status = Status.COMPLETE
    ) -> Candidates:
        """Return paths of any search as the candidates of the planner ``name``.

        Parameters
        ----------
        paths : the arcs of each, as indices in `graph`, from the start to a goal
        claim : the planner's claim, in words
        status : how the search ended; a COMPLETE search without a path becomes NO_PATH
        """
        ended = Status.NO_PATH if not paths and status is Status.COMPLETE else status
        costs = costs_along(self.graph, paths)
        result = ParetoPaths(costs, ended, SearchStats(name), self.graph, self.start, tuple(paths))
        return assemble(name, self, result, claim)

    def first_answer(self, name: str, limits: Limits, *, quickly: bool = False) -> Candidates:
        """Return the first points found within some limits as a stage of the planner ``name``.

        They are supported points; where a cost is a maximum, or arcs are not checked, they are the first points of the
        exact search. ``quickly``: points of weighted sums only, as that search is compiled first.
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
        """Return paths as trajectories; their provenance has ``common`` entries and ``own`` ones of each path."""
        if self.timing is not None:
            return self.timing.plans(cast("TimedPaths", paths), common)
        return plans_of(self, cast(ParetoPaths, paths), common, own)

    def what_blocks(self, paths: ParetoPaths | TimedPaths) -> str:
        """Say in words why there is no path: turns, people, or a wall between start and goal."""
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
    def tie_broken(self) -> Graph | None:
        """The graph with turns as a last tie-break; None where a cost charges for every turn."""
        return tie_broken(self.graph, self.space.turned, self.space.spending)

    def break_ties(self) -> None:
        """Make the graph with broken ties now, so that the search does not count on its memory."""
        _ = self.tie_broken

    def drop_ties(self) -> None:
        """Free the memory of the graph with broken ties, after the last search in it."""
        broken: Graph | None = vars(self).pop("tie_broken", None)
        if broken is not None:
            self.space.spending.release(broken.costs.nbytes)

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Search, and keep of paths with equal costs one with the fewest turns, even if no cost charges for turns.

        A complete search loses nothing, as paths that differ only in turns are dropped afterwards. A stopped one may
        keep a point that ties with a better one in the first summed cost.
        """
        if self.tie_broken is None:
            return self._within(search(self.graph))
        paths, first = search(self.tie_broken), summed(self.graph)[0]
        costs = paths.costs.copy()
        turns = costs[:, first] % TIE_TURNS
        costs[:, first] //= TIE_TURNS
        order = np.lexsort((turns, *costs.T[::-1]))
        return paths.select(costs, order[is_nondominated(costs[order])])

    def _within(self, paths: ParetoPaths) -> ParetoPaths:
        """Return the paths within the bound on turns, which a search may have ignored."""
        bounds = [math.inf if bound is None else bound for bound in self.at_most()]
        rows = np.flatnonzero((paths.costs <= np.array(bounds or math.inf)).all(axis=1))
        return paths if rows.size == len(paths) else paths.select(paths.costs, rows)


def built_query(
    built: BuiltGraph, objectives: Objectives, began: float | None = None, max_turns: int | None = None
) -> Query:
    """Cost all arcs of a built graph, and return its query; raises Exhausted where a limit is passed.

    Where a criterion cannot cost motions that collide, all arcs are checked first. ``began``: when building began, s of
    :func:`time.perf_counter`; None for now.
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
