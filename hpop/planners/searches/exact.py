"""The exact search on any graph: every non-dominated path, in stages, among moving people, under limits."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hpop.base.options import MOST, amounts, set_wholes
from hpop.base.scalars import set_python_values
from hpop.criteria.base import index_of_role
from hpop.errors import OptionError
from hpop.planners.base import Candidates, Planner, joined, planner
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, NotBuilt, OnGraph
from hpop.planners.graphs.query import Query, built_query, refuse_too_many, tolerance_counts
from hpop.planners.graphs.timed.clock import HOLD, TimeOptions, needless
from hpop.planners.judgement import evaluable_in_time, trusted
from hpop.planners.needs import people_move, refuse_moving, refuse_tour
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.searches.mean import Detour, DetourSpec, exact_mean, mean_criteria, mean_objectives
from hpop.planners.spending import Exhausted, Limits, Spending, stopped
from hpop.runtime.status import Budget, ProgressCallback, Status
from hpop.search.machinery.approximation import Precision
from hpop.search.machinery.beside import Onset, compiling_beside, is_compiling, is_first_kernel_missing, start_compilers
from hpop.search.machinery.checkpoint import Checkpoint, CheckpointSpec
from hpop.search.pareto_paths import main_kernels

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

QUICK = 0.1  # s: least time of a search before the exact one
SHARE = 0.4  # of the building time, if that is longer: it also reflects the load of the machine
COARSE = 0.1  # relative precision of the last stage before the exact one


@dataclass(frozen=True, kw_only=True)
class ExactSearch:
    """Options of the exact search, and its solution of a problem on the planner's graph family.

    max_detour  upper limit that makes a mean over time a cost itself: the longest duration, as a multiple of the least
                duration of any path; or ``{"length": 1.3}``, the same for lengths, which also needs max_turns
    max_turns   largest number of turns; paths with more are left out. Needs the criterion turns
    eps         relative error: every optimal cost vector is met within a factor 1 + eps; 0 finds all optimal vectors
    tolerance   absolute errors that are also allowed, by the name of a cost: ``{"length": 0.1}``
    time_limit  s  for reading the map, building the graph and searching, without compiling. When it ends, the paths
                found are returned, and the status says that more may exist
    max_labels  largest number of partial paths that the search keeps
    max_memory  bytes  for the map, its fields, the graph and the search
    checkpoint  file in which the search saves its state, and from which it continues if the file exists
    clock       s  time step of a search among moving people; None: 0.05
    hold        s  shortest wait for moving people; None: the robot never waits
    arrive_by   s  latest arrival, among moving people; None: no limit
    margin      m  distance to keep from people, also from those who stand
    """

    name: ClassVar[str]
    tours: ClassVar[bool] = True

    max_detour: DetourSpec | None = None
    max_turns: int | None = None
    eps: float = 0.0
    tolerance: Mapping[str, float] | None = None
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
        if self.max_detour is not None and (self.eps or self.tolerance):
            raise OptionError("max_detour takes no eps or tolerance: leave them out, or leave out max_detour")
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
        """Return the limits, which reading the map, building the graph and searching share."""
        return Budget(self.time_limit, self.max_labels, self.max_memory)

    def spending(self, problem: Problem, progress: ProgressCallback | None = None) -> Spending:
        """Return the account of a planning run, charged with reading the map."""
        limits = Limits(self.time_limit, self.max_labels, self.max_memory, self.checkpoint, progress)
        return Spending(limits, spent=problem.read_seconds, memory=problem.read_memory)

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Find all non-dominated paths of the graph.

        Raises QueryError when start or goal is blocked, off the map or out of reach, or when people move and the graph
        has no clock, UnsupportedCriterion when no criterion adds up along edges, CriterionError for a cost that is
        negative or not finite, OptionError for a ``max_detour`` without a time-mean, CheckpointError for a checkpoint
        of another problem.
        """
        in_stages = self.family.answers_by_parts and self.answers_in_stages
        candidates: Candidates | None = None
        for later in self._answers(problem, progress, in_stages=in_stages):
            candidates = later if later.status.is_final else joined(candidates, later)
        assert candidates is not None  # there is at least one answer
        return candidates

    def stages(self, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
        """Yield a first answer soon, for example on a part of a large graph, then the exact answer.

        Without :attr:`answers_in_stages`, only the exact answer is yielded. After Ctrl-C, the paths found so far are
        the last answer. Raises the errors of :meth:`solve`.
        """
        yield from self._answers(problem, progress, in_stages=self.answers_in_stages)

    @property
    def answers_in_stages(self) -> bool:
        """True if a first answer may come before the exact one.

        This is false with ``max_detour`` or ``max_turns``, and if a search resumes from a checkpoint: a first answer
        would replace the better front that the search had when it was stopped.
        """
        goes_on = self.checkpoint is not None and Path(Checkpoint.of(self.checkpoint).path).exists()
        return not goes_on and self.max_detour is None and self.max_turns is None

    @property
    def graph_of_drives(self) -> GraphFamily | None:
        """Graph family that is searched, if the planner options of a saved front rebuild the same graph."""
        return self.family if self.family.is_remade else None

    @property
    def needs_kernels(self) -> bool:
        """True if kernels of the exact search that are not cached are compiled during a first answer."""
        return self.max_detour is None

    def _answers(self, problem: Problem, progress: ProgressCallback | None, *, in_stages: bool) -> Iterator[Candidates]:
        """Yield answers on each part of the graph that the family builds, then on the whole graph."""
        moving, family = people_move(problem), self.family
        if moving:
            refuse_tour(problem, f"{self.name} among people who move")
        if self.max_detour is not None and problem.tour is not None and problem.tour.optional:
            raise OptionError(
                "max_detour takes no optional stops: leave it out, or make every stop of the tour required"
            )
        if moving and self.max_detour is not None and family.has_clock(problem):
            raise OptionError(
                "max_detour needs a world without moving people; leave it out, a mean is then only reported"
            )
        split = edge_objectives if self.max_detour is None else mean_objectives
        objectives = split(problem.criteria, self.name).with_notes(needless(problem, self.time_options))
        if not (moving and family.has_clock(problem)):
            refuse_moving(problem, self.name)
        refuse_too_many(objectives)
        tolerance_counts(objectives, self.tolerance or {})  # else only the last stage would find an error in these two
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).checked_path()
        spending = self.spending(problem, progress)
        graphs = family.toured_graphs(problem.keeping(self.margin), objectives, spending, in_stages=in_stages)
        try:
            if moving:
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
        """Yield answers among moving people, on graphs with a clock."""
        from hpop.planners.searches.among_people import answers_among_people  # on first use: start-up time

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
        """Yield answers on graphs without a clock, as no person moves."""
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
        """Return the paths from which the graph was to be built, as the result if the graph itself was not searched.

        The paths are left out if they might break max_turns, max_detour or the clock.
        """
        is_bounded = self.max_turns is not None or self.max_detour is not None
        if not candidates.trajectories or not (is_bounded or people_move(problem)):
            return candidates
        note = "paths from which the graph is built are left out: they need not keep max_turns, max_detour or the times"
        return replace(candidates.subset([]), notes=(*candidates.notes, note))

    def _first_stages(
        self,
        query: Query,
        built: BuiltGraph,
        spending: Spending,
        *,
        is_second: bool,
    ) -> Iterator[Candidates]:
        """Yield answers before the exact one; if the exact search is as fast, yield only its final answer."""
        share = spending.share(max(QUICK, SHARE * query.build_seconds))
        if not (built.is_large or is_compiling()):
            checkpoint = None if built.part else self.checkpoint
            exact = _quick_exact_answer(self, query, replace(share, checkpoint=checkpoint))
            if exact is not None:
                with spending.paused():
                    yield _as_stage_of_part(exact, built.part) if built.part else exact
                return
        candidates = query.first_answer(self.name, share, quickly=is_first_kernel_missing() and not is_second)
        with spending.paused():
            yield candidates
        if candidates.status is Status.INTERRUPTED:
            return
        start_compilers()
        if built.part or not built.is_large or self.eps >= COARSE:
            return
        coarse = query.exact(self.name, spending.share(query.build_seconds), eps=COARSE, stage=True)
        stage = {"stage": f"within a factor {1 + COARSE:g}"}
        with spending.paused():
            yield replace(coarse, provenance=tuple(origin | stage for origin in coarse.provenance)).unfinished()

    def _judged(self, candidates: Candidates, built: BuiltGraph) -> Candidates:
        """Return candidates with statistics of the graph, judged on the exact geometry if the family requires it."""
        is_stopped = not candidates.trajectories and not candidates.status.is_final
        if built.first is not None and is_stopped:
            notes = tuple(dict.fromkeys((*built.first.notes, *candidates.notes)))
            return self._paths_of_building(replace(built.first, status=candidates.status, notes=notes), built.problem)
        if is_stopped:
            return candidates
        if self.family.is_judged:
            spending = built.ends.space.spending

            def left() -> float | None:  # the other half is for the evaluation of the front
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
    """Return the exact answer on a graph if the search ends within ``limits``, else None."""
    precise = query.exact(search.name, limits, eps=search.eps, tolerance=search.tolerance)
    return precise if precise.status.is_final or precise.status is Status.INTERRUPTED else None


def _as_stage_of_part(candidates: Candidates, part: str) -> Candidates:
    """Return the candidates of an exact search on a part of a graph as candidates of an early stage."""
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

    The planners "lattice", "roadmap" and "any-angle" are this search with the options of their graph and of the search.
    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six. Guarantees that no path of
    the graph is better in one cost and no worse in the others, costs rounded to the criteria's quanta edge by edge.
    :class:`hpop.planners.lattice.Lattice` describes eps, tolerance, checkpoint, max_detour and the clock.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        self.take_needs()


def kernels_beside(planners: Sequence[Planner], problem: Problem) -> AbstractContextManager[Onset | None]:
    """Compile the kernels of the exact searches among some planners in background processes, unless they are cached.

    Compiling begins after the first answer if the first planner has stages, else at once. The value of the context is
    the :class:`.Onset`, or None if there is nothing to compile.
    """
    searching = [planner for planner in planners if planner.needs_kernels]
    if not searching:
        return nullcontext()
    criteria = edge_objectives(problem.criteria, searching[0].name).optimised
    turns = index_of_role("turns", criteria)
    onset = Onset.AFTER_FIRST if planners[0].answers_in_stages else Onset.AT_ONCE
    aggregates = ["max" if criterion.aggregate == "max" else "sum" for criterion in criteria]
    return compiling_beside(aggregates, -1 if turns is None else turns, onset, main_kernels)
