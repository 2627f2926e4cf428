"""A planning problem on a graph of states, for whichever search: what to search, and what is said of the result."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.base.options import MOST, MOST_COUNTED, amounts
from hpop.errors import CriterionError, OptionError, did_you_mean
from hpop.frontier import is_nondominated
from hpop.planners.base import Candidates
from hpop.planners.deferred import Deferred
from hpop.planners.graphs.claims import at_memory_limit, claimed
from hpop.planners.graphs.ties import TIE_TURNS, summed, tie_broken
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.needs import refuse_moving
from hpop.planners.objectives import Objectives
from hpop.runtime.status import Budget, Progress, ProgressCallback, Status
from hpop.search import Graph, ParetoPaths, pareto_paths, supported_paths
from hpop.search.asked_arcs import Free
from hpop.search.machinery.checkpoint import CheckpointSpec
from hpop.search.queries import SearchStats
from hpop.search.supported.first_paths import first_paths

if TYPE_CHECKING:
    from hpop.planners.graphs.family import BuiltGraph
    from hpop.problems.problem import Problem
    from hpop.trajectories.trajectory import Trajectory

MAX_COSTS = 6
COARSE = 0.01
TIED = "no path is better in every cost than a point"


def refuse_unanswerable(problem: Problem, objectives: Objectives, what: str) -> None:
    """Raise where a graph without time, ``what``, cannot answer: people who move (QueryError), or too many costs."""
    refuse_moving(problem, what)
    refuse_too_many(objectives)


def refuse_too_many(objectives: Objectives) -> None:
    """Raise OptionError for more costs than an exact search takes."""
    if len(objectives.optimised) > MAX_COSTS:
        names = [criterion.name for criterion in objectives.optimised]
        raise OptionError(
            f"the exact search takes at most {MAX_COSTS} costs, got {len(names)}: {', '.join(names)}; leave some out"
        )


def tolerance_counts(objectives: Objectives, tolerance: Mapping[str, float]) -> IntArray:
    """Tolerances (k,) in quanta, rounded down; raises OptionError for a name that is no cost, or no length."""
    names = [criterion.name for criterion in objectives.optimised]
    for name in tolerance:
        if name not in names:
            raise OptionError(
                f"tolerance names {name!r}, which is no cost that is searched for.{did_you_mean(name, names)} "
                f"These are {', '.join(names)}"
            )
    checked = amounts("tolerance", tolerance, MOST)
    slack = [checked.get(criterion.name, 0.0) / criterion.quantum for criterion in objectives.optimised]
    return np.array([min(math.floor(value + 1e-9), MOST_COUNTED) for value in slack], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class GraphQuery:
    """A problem on a graph of states, for whichever search: what to search, and what is said of the result.

    space          the states
    graph          integer costs in quanta of ``objectives.optimised``
    start, goals   state ids
    build_seconds  s
    notes          what the user should know of the ends
    max_turns      paths with more turns do not count
    """

    space: TrajectoryGraph
    objectives: Objectives
    graph: Graph
    start: int
    goals: list[int]
    build_seconds: float
    notes: tuple[str, ...] = ()
    max_turns: int | None = None

    @property
    def names(self) -> str:
        """The optimised criteria, in words."""
        return self.objectives.names

    @property
    def quanta(self) -> FloatArray:
        """What one count of each cost is, (k,), in the criteria's units."""
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

    def exact(
        self,
        name: str,
        budget: Budget,
        progress: ProgressCallback | None = None,
        *,
        eps: float = 0.0,
        tolerance: Mapping[str, float] | None = None,
        checkpoint: CheckpointSpec | None = None,
        covered: float = math.inf,
        stage: bool = False,
    ) -> Candidates:
        """All non-dominated paths as the candidates of the planner ``name``, or some within ``eps`` of them all.

        Every non-dominated cost vector p is then covered by one that is at most (1 + eps) p + tolerance, the tolerance
        in the units of the costs that it names. ``checkpoint``: as in :func:`pareto_paths`. ``covered``: points at hand
        already, of an earlier stage, cover every optimal vector within the factor 1 + covered. ``stage``: before the
        last, so that the budget's time is a share and not a limit that anybody has set.
        """
        counts = tolerance_counts(self.objectives, tolerance or {})

        def search(graph: Graph) -> ParetoPaths:
            slack = counts.copy()
            if graph is self.tie_broken:
                slack[summed(graph)[0]] *= TIE_TURNS
            return pareto_paths(
                graph,
                self.start,
                self.goals,
                budget=budget,
                progress=progress,
                eps=eps,
                tolerance=slack.tolist(),
                at_most=self.at_most(),
                checkpoint=checkpoint,
                free=self.free,
            )

        paths = self.with_fewest_turns(search)
        where = f"{self.part} for ({self.names})"
        if self.max_turns is not None:
            where += f" and at most {self.max_turns} turns"
        gap = min(paths.gap, covered)
        told: dict[str, Any] = {} if self.tie_broken is None else {"optimal": TIED}
        claim = claimed(paths, where, eps=eps, tolerance=tolerance, gap=gap, stage=stage, **told)
        claim += self.looked_at(paths)
        found = {
            "method": paths.stats.method,
            "labels_generated": paths.stats.labels_generated,
            "labels_expanded": paths.stats.labels_expanded,
            "labels_open": paths.stats.labels_open,
            "peak_memory": paths.stats.peak_memory,
            "gap": gap if math.isfinite(gap) else None,
        }
        return self.candidates(name, paths, claim, notes=at_memory_limit(paths), stats=found)

    def answer(
        self, name: str, paths: Sequence[IntArray], claim: str, *, status: Status = Status.COMPLETE
    ) -> Candidates:
        """Return paths of any search as the candidates of the planner ``name``.

        Parameters
        ----------
        paths : the arcs of each, as places in `graph`, from the start to a goal
        claim : what the planner says of them, in words
        status : how the search ended; NO_PATH is found out where there is no path and the search is COMPLETE
        """
        worst = np.array([aggregate == "max" for aggregate in self.graph.aggregates])
        rows = [self.graph.costs[arcs] for arcs in paths]
        costs = [np.where(worst, row.max(axis=0, initial=0), row.sum(axis=0)) for row in rows]
        table = np.array(costs, np.int64).reshape(len(paths), self.graph.criteria)
        ended = Status.NO_PATH if not paths and status is Status.COMPLETE else status
        found = ParetoPaths(table, ended, SearchStats(name), self.graph, self.start, tuple(paths))
        return self.candidates(name, found, claim)

    def first_answer(
        self, name: str, budget: Budget, progress: ProgressCallback | None = None, *, quickly: bool = False
    ) -> Candidates:
        """Return the first points found within a budget as a stage of the planner ``name``.

        These are supported points; where a cost takes the worst arc, or not all arcs are checked, the first ones of the
        exact search. ``quickly``: points of weighted costs, whose search is compiled first.
        """
        exactly = "max" in self.graph.aggregates or self.free is not None

        def search(graph: Graph) -> ParetoPaths:
            if quickly:
                return first_paths(graph, self.start, self.goals, budget, progress)
            if exactly:
                return pareto_paths(graph, self.start, self.goals, budget=budget, progress=progress, free=self.free)
            return supported_paths(graph, self.start, self.goals, budget=budget, progress=progress)

        quickly &= self.free is None
        what = "points of weighted costs" if quickly else f"{'non-dominated' if exactly else 'supported'} points"
        paths = self.with_fewest_turns(search)
        found = self.candidates(
            name,
            # why there is no path is said by the last stage
            replace(paths, status=Status.UNFINISHED) if paths.status is Status.NO_PATH else paths,
            f"{what} of {self.space.words} for ({self.names})",
            provenance=[{"stage": what}] * len(paths),
            stats={"method": paths.stats.method, "peak_memory": paths.stats.peak_memory},
        )
        return found.unfinished()

    @property
    def part(self) -> str:
        """The part of the graph that is searched, in words."""
        return f"{'' if self.space.is_checked else 'the free part of '}{self.space.words}"

    @property
    def free(self) -> Free | None:
        """What tells which arcs are free; None where all are."""
        return None if self.space.is_checked else self.space.arcs_free

    def looked_at(self, paths: ParetoPaths) -> str:
        """How many edges were checked, in words; nothing where all are free."""
        if self.space.is_checked:
            return ""
        stats = paths.stats
        return (
            f"; {stats.arcs_checked:,} of {self.graph.arcs:,} edges were checked in {stats.rounds} "
            f"round{'s' * (stats.rounds != 1)}, "
            f"{stats.arcs_blocked:,} of them blocked; edges on no front were not checked"
        )

    def at_most(self) -> list[int | None]:
        """Bounds (k,) on the costs, none where none is asked for; see :meth:`Objectives.at_most`."""
        return self.objectives.at_most(self.max_turns)

    @cached_property
    def tie_broken(self) -> Graph | None:
        """The graph with turns as a last tie-break, where no cost charges for every turn; see :mod:`.ties`."""
        return tie_broken(self.graph, self.space.turned, self.space.spending)

    def break_ties(self) -> None:
        """Make that graph now, so that its memory is not given to the search as well."""
        _ = self.tie_broken

    def drop_ties(self) -> None:
        """Free that graph, once nothing is searched in it any more, and give its memory back."""
        broken: Graph | None = vars(self).pop("tie_broken", None)
        if broken is not None:
            self.space.spending.release(broken.costs.nbytes)

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Search, and of paths with equal costs keep one with the fewest turns, also where no cost charges for them.

        A search that ends by itself loses nothing: what differs in the turns alone is dropped afterwards. One that is
        stopped may keep a point that ties with a better one in the first summed cost.
        """
        if self.tie_broken is None:
            return self._within(search(self.graph))
        paths, first = search(self.tie_broken), summed(self.graph)[0]
        found = paths.costs.copy()
        spun = found[:, first] % TIE_TURNS
        found[:, first] //= TIE_TURNS
        order = np.lexsort((spun, *found.T[::-1]))
        kept = order[is_nondominated(found[order])]
        return paths.select(found, kept)

    def candidates(
        self,
        name: str,
        paths: ParetoPaths,
        claim: str,
        *,
        provenance: Sequence[Mapping[str, Any]] | None = None,
        notes: Sequence[str] = (),
        stats: Mapping[str, Any] | None = None,
        reason: str = "",
    ) -> Candidates:
        """Paths as the candidates of the planner ``name``: each with its provenance, all with a claim and counts.

        ``reason``: why there is no path, where the caller knows.
        """
        objectives, space = self.objectives, self.space
        edges = paths.lengths

        def trajectories(rows: IntArray) -> tuple[Trajectory, ...]:
            return space.stretches(*paths.through(rows)).trajectories(space.model, space.kinds)

        # A sum is rounded once an edge, a worst edge once.
        adds_up = np.array([criterion.aggregate != "max" for criterion in objectives.optimised])
        rounds = np.where(adds_up, np.maximum(edges, 1)[:, None], 1)
        blocked = (reason or self._what_blocks(paths.blocked),) if paths.status is Status.NO_PATH else ()
        options, counted = space.options, dict[str, int]()
        if not space.is_checked:
            counted = {"edges_checked": paths.stats.arcs_checked, "edges_blocked": paths.stats.arcs_blocked}
            counted |= {"rounds": paths.stats.rounds}
        return Candidates(
            objectives=objectives.optimised,
            trajectories=Deferred(len(paths), trajectories) if len(paths) else (),
            planned=paths.costs * self.quanta,
            tolerance=rounds * self.quanta,
            status=paths.status,
            certificate=f"{name}: {claim}{objectives.certificate}",
            provenance=_origins({"planner": name, **options}, edges.tolist(), provenance),
            notes=(*objectives.notes, *self.notes, *blocked, *self._coarse(paths, rounds), *notes),
            filters=objectives.filters,
            stats={
                "planner": name,
                "states": space.size,
                "edges": int(self.graph.heads.size),
                "build_seconds": self.build_seconds,
                **(stats or {}),
                **counted,
                "bounds_seconds": paths.stats.seconds_bounds,
                "search_seconds": paths.stats.seconds_search,
            },
        )

    def _within(self, paths: ParetoPaths) -> ParetoPaths:
        """The paths that keep the bound on the turns; a search that knows nothing of it may have found others."""
        bounds = [math.inf if bound is None else bound for bound in self.at_most()]
        kept = np.flatnonzero((paths.costs <= np.array(bounds or math.inf)).all(axis=1))
        return paths if kept.size == len(paths) else paths.select(paths.costs, kept)

    def _what_blocks(self, blocked: IntArray) -> str:
        """Why there is no path, in words: too many turns, or what separates start and goal."""
        for j, bound in enumerate(self.at_most()):
            if bound is not None:
                turns = replace(self.graph, costs=self.graph.costs[:, [j]], aggregates=("sum",))
                least = pareto_paths(turns, self.start, self.goals).costs
                if len(least):
                    return f"no path has at most {bound} turns; the least is {least[0, 0]}. Raise max_turns"
        space = self.space if self.space.is_checked else self.space.without(blocked)
        return space.what_separates(self.start, self.goals)

    def _coarse(self, paths: ParetoPaths, rounds: IntArray) -> list[str]:
        """A note on each cost whose rounding, edge by edge, may be more than a hundredth of what it tells apart."""
        if not len(paths):
            return []
        error = rounds.max(axis=0) * self.quanta
        size = np.maximum(np.ptp(paths.costs, axis=0), paths.costs.max(axis=0)) * self.quanta
        return [
            f"{criterion.name} is rounded to {criterion.quantum:g} {criterion.unit} edge by edge, by up to {off:.3g} "
            "in all: that is coarse for this front; declare a smaller quantum"
            for criterion, off, whole in zip(self.objectives.optimised, error, size, strict=True)
            if off > COARSE * whole > 0.0 and criterion.quantum != 1.0
        ]


def built_query(
    built: BuiltGraph,
    objectives: Objectives,
    began: float | None = None,
    max_turns: int | None = None,
    progress: ProgressCallback | None = None,
) -> GraphQuery:
    """Cost all arcs of a graph that was built; raises Exhausted where a limit is passed.

    Where a criterion cannot cost what collides, all arcs are checked first. ``began``: when building it began, s of
    :func:`time.perf_counter`; None for now.
    """
    began = time.perf_counter() if began is None else began
    if progress:
        progress(Progress("graph"))
    (space, start, goals), notes = built.ends, built.notes
    try:
        graph = space.graph(objectives.optimised)
    except CriterionError as error:
        if space.is_checked:
            raise
        notes = (*notes, f"all edges were checked before the search, as some that were not have no cost: {error}")
        space = space.with_checked_arcs()
        graph = space.graph(objectives.optimised)
    seconds = time.perf_counter() - began
    return GraphQuery(space, objectives, graph, start, goals, build_seconds=seconds, notes=notes, max_turns=max_turns)


def _origins(
    common: Mapping[str, Any], edges: Sequence[int], own: Sequence[Mapping[str, Any]] | None
) -> tuple[dict[str, Any], ...]:
    """Where each path comes from; of thousands most are alike, and those are one object."""
    if own is not None:
        return tuple({**common, "edges": count, **each} for count, each in zip(edges, own, strict=True))
    alike = {count: {**common, "edges": count} for count in set(edges)}
    return tuple(alike[count] for count in edges)
