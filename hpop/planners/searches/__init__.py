"""Searches for optimal paths on graphs of any family; here the exact search, with quick early results if wanted."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hpop.base.options import MOST, amounts, set_wholes
from hpop.base.text import set_python_values
from hpop.errors import OptionError
from hpop.planners.base import Candidates, joined, planner
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, NotBuilt, OnGraph
from hpop.planners.graphs.query import Query, built_query, refuse_too_many, tolerance_counts
from hpop.planners.graphs.timed.clock import HOLD, TimeOptions, needless
from hpop.planners.judgement import evaluable_in_time, trusted
from hpop.planners.needs import people_move, refuse_moving
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.searches.many_stops import fixed_stop_answers, fixes_stops, in_order_of_shortest
from hpop.planners.searches.people_and_mean import Detour, DetourSpec, exact_mean, mean_criteria, mean_objectives
from hpop.planners.spending import Exhausted, Limits, Spending, stopped
from hpop.runtime.limits import Budget, ProgressCallback, Status
from hpop.search.machinery import Precision
from hpop.search.machinery.beside import is_compiling, is_first_kernel_missing, start_compilers
from hpop.search.machinery.checkpoint import Checkpoint, CheckpointSpec

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

QUICK = 0.1  # s: least time for a search before the exact one
SHARE = 0.4  # of the building time, if that is longer: the building time also reflects the load of the machine
COARSE = 0.1  # relative error allowed in the last stage before the exact one
MOST_COPIED = 40_000_000  # arcs of a graph that has stages before the exact search, if a part of it was searched before


@dataclass(frozen=True, kw_only=True)
class ExactSearch:
    """Base class of planners with exact search: the options of the search, and ``solve`` on the planner's graph family.

    max_detour   minimise a mean over time itself, not its integral, among paths that last at most this multiple of the
                 least duration of any path. ``{"length": 1.3}`` limits the length instead, and needs max_turns as well,
                 since turns in place add no length
    max_turns    largest number of turns; paths with more are left out. Needs the criterion turns
    eps          relative error: every optimal cost vector is met within a factor 1 + eps; 0 finds all optimal vectors
    tolerance    absolute errors that are allowed as well, by the name of a cost: ``{"length": 0.1}``
    stop_states  largest number of states at which a tour may visit a stop. None: all states of the stop, or only one if
                 the order leaves more than 64 sets of visited stops (six stops in any order have 64)
    time_limit   s  for reading the map, building the graph and searching, without compiling. When it ends, the paths
                 found are returned, and the status says that more may exist
    max_labels   largest number of partial paths that the search generates
    max_memory   bytes  for the map, the fields computed on it (such as distances to obstacles), the graph and the
                 search
    checkpoint   file in which the search saves its state, and from which it continues if the file exists
    clock        s  time step of a search among moving people; None: 0.05
    hold         s  shortest wait for moving people; None: the robot never waits
    arrive_by    s  latest arrival, among moving people; None: no limit
    margin       m  distance that the robot keeps from people, whether they move or stand
    """

    name: ClassVar[str]
    tours: ClassVar[bool] = True
    speeds: ClassVar[bool] = True

    max_detour: DetourSpec | None = None
    max_turns: int | None = None
    eps: float = 0.0
    tolerance: Mapping[str, float] | None = None
    stop_states: int | None = None
    time_limit: float | None = None
    max_labels: int | None = None
    max_memory: int | None = None
    checkpoint: CheckpointSpec | None = None
    clock: float | None = None
    hold: float | None = HOLD
    arrive_by: float | None = None
    margin: float = 0.0

    def __post_init__(self) -> None:
        set_python_values(self)
        if self.max_detour is not None:
            Detour.of(self.max_detour, self.max_turns)
        Precision(self.eps)
        if self.tolerance is not None:
            object.__setattr__(self, "tolerance", amounts("tolerance", self.tolerance, MOST))
        set_wholes(self, "max_turns", least=0, optional=True)
        set_wholes(self, "stop_states", least=1, optional=True)
        if self.max_detour is not None and (self.eps or self.tolerance):
            raise OptionError("max_detour cannot be combined with eps or tolerance: leave these out, or max_detour")
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint)
        _ = self.time_options
        self.budget()

    if TYPE_CHECKING:

        @property
        def family(self) -> GraphFamily:
            """Graph family that is searched: a base class of the planner, or its option ``on``."""
            ...

    @property
    def time_options(self) -> TimeOptions:
        """Options of planning among moving people."""
        return TimeOptions(self.clock, self.hold, self.arrive_by, self.margin)

    def budget(self) -> Budget:
        """Return the limits on time, labels and memory, which reading, building and searching share."""
        return Budget(self.time_limit, self.max_labels, self.max_memory)

    def spending(self, problem: Problem, progress: ProgressCallback | None = None) -> Spending:
        """Return the time and memory account of a new planning run, with what reading the map has used already."""
        limits = Limits(self.time_limit, self.max_labels, self.max_memory, self.checkpoint, progress)
        return Spending(limits, spent=problem.read_seconds, memory=problem.read_memory)

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Find all non-dominated paths of the graph.

        Raises QueryError if start or goal is blocked, off the map or cannot be connected to the graph, or if people
        move and the graph family cannot consider time. Raises UnsupportedCriterion if no criterion adds up along edges,
        CriterionError for a cost that is negative or not finite, OptionError for ``max_detour`` without a time-mean,
        and CheckpointError if the checkpoint file belongs to another problem.
        """
        in_stages = self.family.answers_by_parts and self.answers_in_stages
        candidates: Candidates | None = None
        for later in self._answers(problem, progress, in_stages=in_stages):
            candidates = later if later.status.is_final else joined(candidates, later)
        assert candidates is not None  # there is at least one answer
        return candidates

    def stages(self, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
        """Yield a quick early result, for example from a part of a large graph, then the exact result.

        If :attr:`answers_in_stages` is false, only the exact result is yielded. After Ctrl-C, the paths found so far
        are the last result. Raises the errors of :meth:`solve`.
        """
        yield from self._answers(problem, progress, in_stages=self.answers_in_stages)

    @property
    def answers_in_stages(self) -> bool:
        """True if :meth:`stages` may yield an early result before the exact one.

        False with ``max_detour`` or ``max_turns``, and if the search continues from a checkpoint: an early result would
        replace the better front that the search had when it was stopped.
        """
        goes_on = self.checkpoint is not None and Path(Checkpoint.of(self.checkpoint).path).exists()
        return not goes_on and self.max_detour is None and self.max_turns is None

    @property
    def graph_of_drives(self) -> GraphFamily | None:
        """Graph family on which a driving robot can replan; None if a front's options do not rebuild the same graph."""
        return self.family if self.family.is_remade else None

    @property
    def needs_kernels(self) -> bool:
        """True if the search uses compiled kernels, which are then compiled in the background during a first stage."""
        return self.max_detour is None

    def _answers(self, problem: Problem, progress: ProgressCallback | None, *, in_stages: bool) -> Iterator[Candidates]:
        """Check that the search can solve the problem, then yield its results: the exact one last.

        If ``in_stages``, early results come first.
        """
        moving, family = people_move(problem), self.family
        if self.max_detour is not None and problem.tour is not None and problem.tour.optional:
            raise OptionError(
                "max_detour cannot be combined with optional stops of a tour: leave max_detour out, or set optional to "
                "False for every stop"
            )
        if moving and self.max_detour is not None and family.has_clock(problem):
            raise OptionError(
                "max_detour needs a world without moving people; leave max_detour out: the integral is then minimised, "
                "and the mean only reported"
            )
        split = edge_objectives if self.max_detour is None else mean_objectives
        objectives = split(problem.criteria, self.name).with_notes(needless(problem, self.time_options))
        if not (moving and family.has_clock(problem)):
            refuse_moving(problem, self.name)
        refuse_too_many(objectives)
        tolerance_counts(objectives, self.tolerance or {})  # find errors now, not only in the last stage
        is_fixed = fixes_stops(self, problem)
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).checked_path()
        spending = self.spending(problem, progress)
        kept = problem.keeping(self.margin)
        graphs = family.toured_graphs(kept, objectives, spending, in_stages=in_stages)
        try:
            if is_fixed:
                for candidates, built in fixed_stop_answers(self, kept, objectives, spending, in_stages=in_stages):
                    yield self._judged(candidates, built)
            elif moving:
                yield from self._among_people(problem, objectives, graphs, spending, in_stages=in_stages)
            else:
                yield from self._on_graphs(problem, objectives, graphs, spending, in_stages=in_stages)
        except NotBuilt as stop:
            yield self._paths_of_building(stop.candidates, problem)
        except Exhausted as stop:
            if self.max_detour is not None:
                objectives = mean_criteria(problem.criteria, objectives)
            yield stopped(self.name, objectives, stop, spending)

    def _among_people(
        self,
        problem: Problem,
        objectives: Objectives,
        graphs: Iterable[BuiltGraph],
        spending: Spending,
        *,
        in_stages: bool,
    ) -> Iterator[Candidates]:
        """Yield the results for a world in which people move; each graph is searched on a clock."""
        from hpop.planners.searches.people_and_mean import answers_among_people  # on first use: start-up time

        spending.report("graph")
        for candidates, built in answers_among_people(self, problem, objectives, graphs, in_stages=in_stages):
            yield self._judged(candidates, built)

    def _on_graphs(
        self,
        problem: Problem,
        objectives: Objectives,
        graphs: Iterable[BuiltGraph],
        spending: Spending,
        *,
        in_stages: bool,
    ) -> Iterator[Candidates]:
        """Yield the results for a world in which no person moves: if ``in_stages`` early ones, then the exact one."""
        quick: Candidates | None = None
        built: BuiltGraph | None = None
        is_bounded = self.max_turns is not None or self.max_detour is not None
        began, has_answer, is_second = time.perf_counter(), False, False
        try:
            for built in graphs:
                if spending.limits.time_limit is not None and not (has_answer or built.part or is_bounded):
                    quick = self.family.first_answer(self.name, built, objectives)
                query = built_query(built, objectives, began, self.max_turns)
                if self.max_detour is not None:
                    detour = Detour.of(self.max_detour, self.max_turns)
                    candidates = exact_mean(query, problem.criteria, detour, self.name, spending)
                    yield self._judged(candidates, built)
                    return
                query.break_ties()
                covered = math.inf
                # If arcs are checked only when a path uses them, a second search would check them again.
                if built.part or (in_stages and built.ends.space.is_checked):
                    for stage in self._first_stages(query, built, spending, is_second=is_second):
                        is_end = stage.status.is_final or stage.status is Status.INTERRUPTED
                        if is_end or stage.trajectories or not built.part:
                            yield self._judged(stage, built)
                        if is_end:
                            return
                        has_answer |= len(stage.trajectories) > 0
                        gap = stage.stats.get("gap")
                        covered = math.inf if gap is None else gap
                    is_second = True
                if not built.part:
                    start_compilers()
                    candidates = query.exact(
                        self.name, spending.left(), eps=self.eps, tolerance=self.tolerance, covered=covered
                    )
                    yield self._judged(candidates, built)
                    return
                query.drop_ties()
                built, began = None, time.perf_counter()
        except Exhausted as stop:
            if built is None:
                raise
            if self.max_detour is not None:
                objectives = mean_criteria(problem.criteria, objectives)
            yield self._judged(stopped(self.name, objectives, stop, spending, quick), built)
        except KeyboardInterrupt:
            if built is None or built.first is None:
                raise
            yield self._paths_of_building(replace(built.first, status=Status.INTERRUPTED), problem)

    def _paths_of_building(self, candidates: Candidates, problem: Problem) -> Candidates:
        """Return the result if the graph was not searched: the paths that were found while building it.

        For example, the any-angle planner builds its graph from lattice paths. With max_turns or max_detour, or among
        moving people, the result is empty, since these paths may not satisfy the limits.
        """
        is_bounded = self.max_turns is not None or self.max_detour is not None
        if not candidates.trajectories or not (is_bounded or people_move(problem)):
            return candidates
        note = (
            "the graph was not searched, and paths found while building it are left out: they may break max_turns, "
            "max_detour or arrive_by"
        )
        return replace(candidates.subset([]), notes=(*candidates.notes, note))

    def _first_stages(
        self,
        query: Query,
        built: BuiltGraph,
        spending: Spending,
        *,
        is_second: bool,
    ) -> Iterator[Candidates]:
        """Yield early results on one graph; if the exact search ends within their time limit, yield only its result.

        is_second  True if early results on another graph were yielded before, such as on a part of this graph
        """
        share = spending.share(max(QUICK, SHARE * query.build_seconds))
        if not (built.is_large or is_compiling()):
            checkpoint = None if built.part else self.checkpoint
            exact = _quick_exact_answer(self, query, replace(share, checkpoint=checkpoint))
            if exact is not None:
                with spending.paused():
                    yield _as_stage_of_part(exact, built.part) if built.part else exact
                return
        is_vast = is_second and query.graph.arcs > MOST_COPIED and not query.graph.has_costs
        if not is_vast:
            candidates = query.first_answer(self.name, share, quickly=is_first_kernel_missing() and not is_second)
            with spending.paused():
                yield candidates
            if candidates.status is Status.INTERRUPTED:
                return
        start_compilers()
        ordered = in_order_of_shortest(self, query, spending.share(query.build_seconds))
        if ordered is not None:
            with spending.paused():
                yield ordered
        if built.part or is_vast or not built.is_large or self.eps >= COARSE:
            return
        coarse = query.exact(self.name, spending.share(query.build_seconds), eps=COARSE, stage=True)
        stage = {"stage": f"within a factor {1 + COARSE:g}"}
        with spending.paused():
            yield replace(coarse, provenance=tuple(origin | stage for origin in coarse.provenance)).unfinished()

    def _judged(self, candidates: Candidates, built: BuiltGraph) -> Candidates:
        """Complete the candidates of a stage: check trajectories if the graph family asks for it, and add statistics.

        If the search was stopped without a path, the paths found while building the graph are returned instead.
        """
        is_stopped = not candidates.trajectories and not candidates.status.is_final
        if built.first is not None and is_stopped:
            notes = tuple(dict.fromkeys((*built.first.notes, *candidates.notes)))
            return self._paths_of_building(replace(built.first, status=candidates.status, notes=notes), built.problem)
        if is_stopped:
            return candidates
        if self.family.is_judged:
            spending = built.ends.space.spending

            def left() -> float | None:  # the other half of the time is for evaluating the front
                return None if (until := spending.until_limit()) is None else until / 2

            candidates = evaluable_in_time(candidates, left, lambda subset: trusted(subset, built.problem, self.name))
            accepted = trusted(candidates, built.problem, self.name)
            dropped = len(candidates.trajectories) - len(accepted.trajectories)
            words = f"; without {dropped} that failed the exact check" if dropped else ""
            candidates = replace(accepted, certificate=candidates.certificate + words)
        own = built.status.is_final or candidates.status in (Status.INTERRUPTED, Status.UNFINISHED)
        return replace(
            candidates,
            status=candidates.status if own else built.status,
            stats={**candidates.stats, **built.ends.space.counts, **built.stats},
        )


def _quick_exact_answer(search: ExactSearch, query: Query, limits: Limits) -> Candidates | None:
    """Run the exact search on a graph; return its candidates, or None if a limit ends it before it is done.

    After Ctrl-C, the candidates found so far are returned.
    """
    precise = query.exact(search.name, limits, eps=search.eps, tolerance=search.tolerance)
    return precise if precise.status.is_final or precise.status is Status.INTERRUPTED else None


def _as_stage_of_part(candidates: Candidates, part: str) -> Candidates:
    """Mark the candidates of an exact search on a part of the graph, named ``part``, as an early result."""
    return replace(
        candidates,
        status=candidates.status if candidates.status is Status.INTERRUPTED else Status.UNFINISHED,
        certificate=f"{candidates.certificate}; the whole graph was not searched",
        provenance=tuple(origin | {"stage": part} for origin in candidates.provenance),
    )


@planner("exact")
@dataclass(frozen=True)
class Exact(ExactSearch, OnGraph):
    """All non-dominated paths of a graph of any family, found by exact multi-objective search.

    on   the graph family with its options, such as ``{"lattice": {"step": 0.5}}``,
         ``{"roadmap": {"samples": 300}}`` or ``{"corners": {"step": 0.5}}``

    The planners "lattice", "roadmap" and "any-angle" are this search on a fixed graph family; they have the options of
    both. Accepts at most six criteria that add up along edges or take the worst edge (sum, max). Guarantees that no
    path of the graph is better in one cost and no worse in the others, with the cost of each edge rounded to the
    criterion's quantum. :class:`~hpop.planners.graph_planners.Lattice` describes eps, tolerance, checkpoint, max_detour
    and clock.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.take_needs()
