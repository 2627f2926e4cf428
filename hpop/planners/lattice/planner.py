"""The lattice planner: every optimal trade-off on an SE(2) lattice, exactly."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from hpop.errors import OptionError
from hpop.options import LEAST, MOST, amounts, set_reals, set_wholes, truth
from hpop.planners.base import Candidates, planner
from hpop.planners.goals import start_of
from hpop.planners.graphs.exact_mean import Detour, DetourSpec, exact_mean, mean_criteria, mean_objectives
from hpop.planners.graphs.joined_ends import Ends, with_ends
from hpop.planners.graphs.query import GraphQuery, refuse_unanswerable, tolerance_counts
from hpop.planners.lattice.graph import StateLattice
from hpop.planners.lattice.grid import Headings
from hpop.planners.lattice.stages import MOST_IN_TIME, first_answer, part_of, stages
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.spending import Exhausted, Spending, stopped
from hpop.planners.timed.asked import Asked, needless, people_move
from hpop.planners.timed.clock import HOLD, TimeOptions
from hpop.scalars import set_python_values
from hpop.search.machinery.approximation import Precision
from hpop.search.machinery.checkpoint import Checkpoint, CheckpointSpec
from hpop.status import Budget, Progress, ProgressCallback

if TYPE_CHECKING:
    from hpop.problem import Problem

REACH = 1.5 + 1e-9  # steps: a start or goal that is none of the lattice's states is joined to those within


@planner("lattice")
@dataclass(frozen=True)
class Lattice:
    """All non-dominated paths of an SE(2) lattice (Becerra et al. 2020), found by exact multi-objective search.

    step            m      between neighbouring positions
    headings        4, 8 or 16
    corner_cutting  whether a diagonal may pass between two blocked positions
    max_detour      longest duration over the least of any path, or ``{"length": 1.3}``: longest length over the least,
                    which needs max_turns as well; a time-mean is then optimised itself
    max_turns       count  paths with more turns are left out; needs the criterion turns
    eps             every optimal cost vector is covered within a factor 1 + eps; 0 finds them all
    tolerance       or within these amounts, by the name of a cost: ``{"length": 0.1}``
    time_limit      s      to read the map, build the lattice and search, not to compile; what is found until then is
                           returned and called incomplete
    max_labels      count  partial paths kept by the search
    max_memory      bytes  of the map that is read, the fields that are made, the lattice's graph and the search
    checkpoint      file in which the search keeps its state, and from which it goes on if it is there
    clock           s  of a tick, where people move; None: 1/20. Where nobody does there is no clock
    hold            s  that the robot stands at least when it waits for people who move; None: it never waits
    arrive_by       s  at the latest, among people who move; None: whenever
    margin          m  to be kept from people, those who stand as well

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of the
    lattice is better in one cost and no worse in the others, costs rounded to the criteria's quanta edge by edge;
    every float Pareto vector is covered within quantum times number of edges. The lattice is anchored at the start. A
    start or goal that is none of its states, in place or heading, is joined to all positions within 1.5 steps from
    which, or to which, the robot can turn, go straight and turn (:mod:`.joined_ends`).

    With ``eps`` or ``tolerance`` a cost vector p that is optimal is covered by a returned one of at most
    (1 + eps) p + tolerance, which need not be optimal itself: far fewer points, and less work. A search that was
    stopped says how much better the points that it misses may be.

    A ``checkpoint`` is written now and then, and when the search is stopped: the same question with the same file goes
    on from there, after Ctrl-C, a limit or kill -9, to the same front (:func:`hpop.search.pareto_paths`).
    Remove the file when the front is safe.

    With ``max_detour`` one time-mean is a cost itself, beside at most four others, and the front is exact among all
    walks, loops allowed, that keep the cap (:func:`hpop.search.capped_mean_paths`); it cannot be joined with
    fronts in which the integral stands in. The cost grows steeply with the cap. A cap on the length (a criterion then,
    as turns are) leaves the mean without a bound unless the turns have one: turning in place costs no length, so time
    without end could be spent where the mean is low.

    Among people who move (:mod:`hpop.planners.timed`) costs and free ways depend on when the robot is where, so motions
    last whole ticks of a clock, and the robot may hold at every position. The front is then exact on that clock, for
    people as they are predicted: no path and no holds of the lattice are better in one cost and no worse in the others.
    The robot keeps clear of them by ``margin``, also if it is 0.2 s off the clock; where a prediction is uncertain,
    nobody is nearer than that with more than 5 % at any moment. Planned costs are within their stated tolerance of the
    plan's own, which the certificate says how far it is off the clock. ``max_detour`` is for worlds where nobody moves.
    """

    needs: ClassVar[frozenset[str]] = frozenset({"plane", "turn-move"})
    goal_sets: ClassVar[bool] = True
    graph_options: ClassVar[tuple[str, ...]] = ("step", "headings", "corner_cutting")

    step: float = 0.25
    headings: int = 8
    corner_cutting: bool = False
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
        set_reals(self, "step", least=LEAST, most=MOST, kind="a positive length in m")
        truth("corner_cutting", self.corner_cutting)
        Headings(self.headings)
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

    @property
    def time_options(self) -> TimeOptions:
        """What it is told about time."""
        return TimeOptions(self.clock, self.hold, self.arrive_by, self.margin)

    def budget(self) -> Budget:
        """The planner's limits, which reading the map, building and searching share."""
        return Budget(self.time_limit, self.max_labels, self.max_memory)

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan on the lattice.

        Raises QueryError when start or goal is blocked, off the map or out of reach,
        UnsupportedCriterion when no criterion adds up along edges, CriterionError for a cost that is negative or not
        finite, OptionError for a ``max_detour`` without a time-mean, CheckpointError for a checkpoint that is of
        another question.
        """
        if people_move(problem):
            *_, found = self._among_people(problem, progress, in_stages=False)
            return found
        notes = needless(problem, self.time_options)
        spending = self.spending(problem)
        lattice = self.lattice(problem, spending)
        mean = self.max_detour is not None
        objectives = (mean_objectives if mean else edge_objectives)(problem.criteria, "lattice").noted(notes)
        try:
            query = self.query(problem, objectives, progress, lattice)
            if self.max_detour is not None:
                detour = Detour.of(self.max_detour, self.max_turns)
                return exact_mean(query, problem.criteria, detour, "lattice", spending, progress, self.checkpoint)
            query.break_ties()
            eps, tolerance, kept = self.eps, self.tolerance, self.checkpoint
            return query.exact("lattice", spending.left(), progress, eps=eps, tolerance=tolerance, checkpoint=kept)
        except Exhausted as stop:
            return stopped(
                "lattice", mean_criteria(problem.criteria, objectives) if mean else objectives, stop, spending
            )

    def spending(self, problem: Problem) -> Spending:
        """The limits, of which reading the map has spent some."""
        return Spending(self.budget(), spent=problem.read_seconds, memory=problem.read_memory)

    def stages(self, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
        """A first answer soon, on part of a large lattice, then the exact one; see :mod:`.stages`.

        Only the exact one unless :attr:`answers_in_stages`. Raises as :meth:`solve` does.
        """
        if not self.answers_in_stages:
            yield self.solve(problem, progress)
        elif people_move(problem):
            yield from self._among_people(problem, progress, in_stages=True)
        else:
            yield from stages(self, problem, progress)

    def _among_people(
        self, problem: Problem, progress: ProgressCallback | None, *, in_stages: bool
    ) -> Iterator[Candidates]:
        """Answers on a clock."""
        from hpop.planners.timed.answers import answers  # on first use: it takes what only they need

        if self.max_detour is not None:
            raise OptionError("max_detour is for worlds where nobody moves; leave it out, a mean is then only reported")
        objectives, spending = edge_objectives(problem.criteria, "lattice"), self.spending(problem)
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).place()
        asked = Asked(
            "lattice", self.time_options, self.eps, self.tolerance, self.checkpoint, self.max_turns, in_stages
        )
        try:
            lattice = self.lattice(problem, spending)
            ends = self.ends(lattice, problem)
            part = part_of(self, lattice, problem, MOST_IN_TIME) if in_stages else None
            sooner = None if part is None else self.ends(part, problem)
            yield from answers(problem, objectives, ends, asked, progress, sooner)
        except Exhausted as stop:
            yield stopped("lattice", objectives, stop, spending)

    @property
    def answers_in_stages(self) -> bool:
        """Whether a first answer comes before the exact one.

        None does with ``max_detour`` or ``max_turns``, nor where a search goes on from a checkpoint: a first answer
        would take the place of the better front that it had when it was stopped.
        """
        goes_on = self.checkpoint is not None and Path(Checkpoint.of(self.checkpoint).path).exists()
        return not goes_on and self.max_detour is None and self.max_turns is None

    def query(
        self,
        problem: Problem,
        objectives: Objectives,
        progress: ProgressCallback | None = None,
        lattice: StateLattice | None = None,
    ) -> GraphQuery:
        """The lattice, its graph with the objectives' costs, and its ends; raises as :meth:`solve` does."""
        refuse_unanswerable(problem, objectives, "lattice")
        tolerance_counts(objectives, self.tolerance or {})  # these two would only be found wrong by the last stage
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).place()
        began = time.perf_counter()
        if progress:
            progress(Progress("graph"))
        lattice = lattice or self.lattice(problem)
        space, start, goals = self.ends(lattice, problem)
        graph = space.graph(objectives.optimised)
        return GraphQuery(
            space,
            objectives,
            graph,
            start,
            goals,
            build_seconds=time.perf_counter() - began,
            max_turns=self.max_turns,
        )

    def graph_query(
        self, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None = None
    ) -> GraphQuery:
        """The problem on the lattice's graph, for another search; raises as :meth:`solve` does, and Exhausted."""
        return self.query(problem, objectives, progress, self.lattice(problem, spending))

    def first_answer(
        self,
        name: str,
        problem: Problem,
        objectives: Objectives,
        spending: Spending,
        progress: ProgressCallback | None = None,
    ) -> Candidates | None:
        """What the planner ``name``, which searches this graph otherwise, keeps in case it is not built in time."""
        return first_answer(name, self, problem, objectives, spending, progress)

    def lattice(self, problem: Problem, spending: Spending | None = None) -> StateLattice:
        """The lattice anchored at the problem's start; building it may spend what is in the spending."""
        return StateLattice(
            in_plane(problem.model),
            problem.keeping(self.margin).world,
            start_of(problem)[:2],
            float(self.step),
            Headings(self.headings),
            self.corner_cutting,
            spending=spending or Spending(),
        )

    def ends(self, lattice: StateLattice, problem: Problem) -> Ends:
        """The lattice with the problem's start and goal, joined to it where they are none of its states.

        Raises QueryError where one of them is blocked or out of reach.
        """
        return with_ends(lattice, problem, REACH * self.step)
