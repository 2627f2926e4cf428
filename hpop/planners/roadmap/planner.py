"""The roadmap planner: every optimal trade-off on a probabilistic roadmap, exactly."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import InitVar, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from hpop.errors import CriterionError, OptionError
from hpop.goals import GoalSet
from hpop.options import set_wholes
from hpop.planners.base import Candidates, joined, planner
from hpop.planners.goals import start_of
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.query import GraphQuery, refuse_unanswerable
from hpop.planners.graphs.shortest import shortest_path
from hpop.planners.in_time import evaluable_in_time
from hpop.planners.judgement import trusted
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives, edge_objectives
from hpop.planners.roadmap.configurations import ConfigurationRoadmap, configuration_roadmap, guide_roadmap
from hpop.planners.roadmap.growing import growing, smaller
from hpop.planners.roadmap.headings import StateRoadmap, nearest_links
from hpop.planners.roadmap.positions import checked_ends, drawn_positions, pairs
from hpop.planners.roadmap.survey import Survey, survey
from hpop.planners.spending import Exhausted, Spending, stopped
from hpop.planners.timed.asked import Asked, needless, people_move
from hpop.planners.timed.clock import HOLD, TimeOptions
from hpop.randomness import MaybeRNG, set_seed
from hpop.scalars import set_python_values
from hpop.search.machinery.checkpoint import Checkpoint, CheckpointSpec
from hpop.status import Budget, Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.problem import Problem

MOST_SAMPLES = 1_000_000
MOST_TREES = 100
QUICK = 0.1  # s, of a search on a smaller roadmap, at least
SHARE = 0.4  # of the time that planning took until then, if that is more
HEADED = frozenset({"plane", "turn-move", "rigid"})
AnyRoadmap: TypeAlias = StateRoadmap | ConfigurationRoadmap


@planner("roadmap")
@dataclass(frozen=True)
class Roadmap:
    """All non-dominated paths of a probabilistic roadmap (Kavraki et al. 1996), found by exact multi-objective search.

    samples     count  free positions, or configurations, drawn uniformly unless there are trees
    neighbours  count  nearest ones to which each is linked; None takes ceil(2e log n) of n, as PRM* does, and 8 beyond
                       the plane
    far         count  configurations farther away to which each is linked as well: the nearest within random subsets of
                       log-uniform size; None takes none in the plane, and 8 beyond it
    trees       count  pairs of trees that look for ways before (:mod:`.guides`): three of ten samples then lie near
                       these, the others where a way may be at most 1.6 times as long as the shortest of them; None
                       takes none in the plane, and 10 beyond it
    seed               of the random samples; in Python also `rng`: a seed, a Generator of which one is drawn, or None
                       for a fresh one (SPEC 7)
    time_limit  s      to read the map, build the roadmap and search, not to compile; what is found until then is
                       returned and called incomplete
    max_labels  count  partial paths kept by the search
    max_memory  bytes  of the map that is read, the fields that are made, the roadmap's graph and the search
    checkpoint  file in which the search keeps its state, and from which it goes on if it is there; remove it when the
                front is safe
    clock       s  of a tick, where people move; None: 1/20. Where nobody does there is no clock
    hold        s  that the robot stands at least when it waits for people who move; None: it never waits
    arrive_by   s  at the latest, among people who move; None: whenever
    margin      m  to be kept from people, those who stand as well

    Of a robot that turns and moves and has no states but x, y and yaw, samples are positions, and links straight moves,
    free on the exact geometry; the robot turns in place between any two of them, where it has the room and they differ
    by a degree, the least that counts as a turn (:mod:`.headings`). Of any other model, and to a goal that is no list
    of states, samples are configurations, and links the chains of motions by which the model connects them
    (:meth:`hpop.motions.Model.connect`); near is what its space calls so (:mod:`.configurations`). Start and goal are
    exact, whatever their headings, and linked to each other as well.

    What is chosen by itself depends on whether the model is one of the ``plane``. There uniform samples find ways, and
    to check all edges before takes less than to search several times. Beyond it, as with the joints of an arm, next to
    no uniform sample lies where a way is, the nearest ones alone make ways of many stops, and to check an edge takes
    most time: so there are guides and far links, and edges are checked only where a path on a front takes them
    (:mod:`hpop.search.lazy_paths`).

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of this
    roadmap (its options up to the seed) is better in one cost and no worse in the others, costs rounded to the
    criteria's quanta edge by edge. With the rule of k-nearest PRM* the shortest path tends to the shortest of all as
    samples grow (Karaman and Frazzoli 2011, doi 10.1177/0278364911406761); how far it still is, this planner does not
    say. Among people who move, a roadmap of positions has a clock, as the lattice has
    (:class:`hpop.planners.lattice.Lattice`), and the robot holds at positions. Positions cost a state for each heading
    of each link, and a turn for each two headings of a position; where a robot that is not round has little room, each
    of these turns is checked by itself, which takes most of the time.
    """

    needs: ClassVar[frozenset[str]] = frozenset()
    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True
    graph_options: ClassVar[tuple[str, ...]] = ("samples", "neighbours", "far", "trees", "seed")

    samples: int = 500
    neighbours: int | None = None
    far: int | None = None
    trees: int | None = None
    seed: int = 0
    time_limit: float | None = None
    max_labels: int | None = None
    max_memory: int | None = None
    checkpoint: CheckpointSpec | None = None
    clock: float | None = None
    hold: float | None = HOLD
    arrive_by: float | None = None
    margin: float = 0.0
    rng: InitVar[MaybeRNG] = ...

    def __post_init__(self, rng: MaybeRNG) -> None:
        set_python_values(self)
        set_wholes(self, "samples", least=1, most=MOST_SAMPLES)
        set_seed(self, rng)
        set_wholes(self, "neighbours", least=1, optional=True)
        set_wholes(self, "far", least=0, optional=True)
        set_wholes(self, "trees", least=0, most=MOST_TREES, optional=True)
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
        """Plan on the roadmap.

        Raises QueryError when start or goal is blocked, or when people move about a robot whose samples are no
        positions, UnsupportedCriterion when no criterion
        adds up along edges, CriterionError for a cost that is negative or not finite, CheckpointError for a checkpoint
        of another question.
        """
        answers = iter(self.stages(problem, progress))
        found = next(answers)
        for later in answers:
            found = later if later.status.is_final else joined(found, later)
        return found

    def stages(self, problem: Problem, progress: ProgressCallback | None = None) -> Iterator[Candidates]:
        """The ways along the guides soon, then those of the whole roadmap.

        So what a limit or Ctrl-C leaves is more than nothing as soon as the trees have met. Only the last stage comes
        where there are no guides, or where a search goes on from a checkpoint: a first answer would take the place of
        the better front that it had when it was stopped. Raises as :meth:`solve` does.
        """
        problem = problem.keeping(self.margin)
        objectives = edge_objectives(problem.criteria, "roadmap")
        if people_move(problem) and _has_positions(problem):
            yield from self._among_people(problem, objectives, progress)
            return
        objectives = objectives.noted(needless(problem, self.time_options))
        refuse_unanswerable(problem, objectives, "roadmap")
        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).place()
        goes_on = self.checkpoint is not None and Path(Checkpoint.of(self.checkpoint).path).exists()
        spending = Spending(self.budget(), spent=problem.read_seconds, memory=problem.read_memory)
        try:
            known = None if _has_positions(problem) else survey(problem, self.trees, self.seed, spending)
            if known is not None and known.guides and not goes_on:
                along = on_roadmap("roadmap", problem, objectives, guide_roadmap(known, spending), progress, ())
                with spending.paused():
                    yield _unfinished(along)
                if along.status is Status.INTERRUPTED:
                    return
            elif known is None and not goes_on:
                for first in self._first_answers("roadmap", problem, objectives, spending, progress):
                    with spending.paused():
                        yield first
                    if first.status is Status.INTERRUPTED:
                        return
            roadmap, notes = self._noted(self._made(problem, known, spending))
        except Exhausted as stop:
            yield stopped("roadmap", objectives, stop, spending)
            return
        yield on_roadmap("roadmap", problem, objectives, roadmap, progress, notes, self.checkpoint)

    def _first_answers(
        self,
        name: str,
        problem: Problem,
        objectives: Objectives,
        spending: Spending,
        progress: ProgressCallback | None,
    ) -> Iterator[Candidates]:
        """Yield what the planner ``name`` finds on smaller roadmaps of positions, where there is a time limit."""

        def search(roadmap: StateRoadmap) -> Candidates:
            return on_roadmap(name, problem, objectives, roadmap, progress, (), soon=True)

        def make(samples: int) -> StateRoadmap:
            return replace(self, samples=samples)._of_positions(problem, spending)

        yield from growing(smaller(self.samples, spending), make, search, spending)

    def first_answer(
        self,
        name: str,
        problem: Problem,
        objectives: Objectives,
        spending: Spending,
        progress: ProgressCallback | None = None,
    ) -> Candidates | None:
        """What the planner ``name``, which searches this roadmap otherwise, keeps in case it is not built in time."""
        if not _has_positions(problem):
            return None
        return next(iter(self._first_answers(name, problem, objectives, spending, progress)), None)

    def _among_people(
        self, problem: Problem, objectives: Objectives, progress: ProgressCallback | None
    ) -> Iterator[Candidates]:
        """Answers on a clock, each of them judged."""
        from hpop.planners.timed.answers import answers  # on first use: it takes what only they need

        if self.checkpoint is not None:
            Checkpoint.of(self.checkpoint).place()
        goes_on = self.checkpoint is not None and Path(Checkpoint.of(self.checkpoint).path).exists()
        spending = Spending(self.budget(), spent=problem.read_seconds, memory=problem.read_memory)
        asked = Asked("roadmap", self.time_options, checkpoint=self.checkpoint, in_stages=not goes_on)
        try:
            roadmap, notes = self._noted(self._of_positions(problem, spending))
            ends = Ends(roadmap, roadmap.start, roadmap.goals)
            for found in answers(problem, objectives, ends, asked, progress):
                yield _judged(replace(found, notes=(*found.notes, *notes)), problem, roadmap)
        except Exhausted as stop:
            yield stopped("roadmap", objectives, stop, spending)

    def graph_query(
        self, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None = None
    ) -> GraphQuery:
        """The problem on the roadmap's graph, for another search; raises as :meth:`solve` does, and Exhausted."""
        refuse_unanswerable(problem, objectives, "roadmap")
        roadmap, notes = self._noted(self.roadmap(problem, spending))
        return roadmap_query(objectives, roadmap, progress, notes)

    def _noted(self, roadmap: AnyRoadmap) -> tuple[AnyRoadmap, tuple[str, ...]]:
        """A roadmap, and a note if it has fewer samples than were asked for."""
        drawn = roadmap.options["samples"]
        few = f"only {drawn} of {self.samples:,} samples: next to nothing is free where they are drawn"
        notes = roadmap.notes if isinstance(roadmap, ConfigurationRoadmap) else ()
        return roadmap, (few, *notes) if drawn < self.samples else notes

    def roadmap(self, problem: Problem, spending: Spending | None = None) -> AnyRoadmap:
        """The roadmap between the problem's start and goal; raises QueryError when one of them is blocked.

        Building it may spend what the limits leave.
        """
        spending = spending or Spending()
        known = None if _has_positions(problem) else survey(problem, self.trees, self.seed, spending)
        return self._made(problem, known, spending)

    def _made(self, problem: Problem, known: Survey | None, spending: Spending) -> AnyRoadmap:
        """The roadmap of configurations where something is known of them, else that of positions."""
        if known is None:
            return self._of_positions(problem, spending)
        return configuration_roadmap(known, self.samples, self.neighbours, self.far, spending)

    def _of_positions(self, problem: Problem, spending: Spending) -> StateRoadmap:
        if self.far or self.trees:
            raise OptionError(
                "far and trees are for roadmaps of configurations; for this robot it has positions; leave them out"
            )
        ends = checked_ends(problem)
        positions = np.concatenate([ends.positions, drawn_positions(problem, self.samples, self.seed, spending)])
        drawn = len(positions) - len(ends.positions)
        count = self.neighbours or math.ceil(2 * math.e * math.log(len(positions)))
        return StateRoadmap(
            in_plane(problem.model),
            problem.world,
            positions,
            np.concatenate([nearest_links(positions, count, spending), pairs(len(ends.positions))]),
            start_of(problem)[2],
            ends.goals,
            name=f"the roadmap of {drawn} samples (seed {self.seed}) and {count} neighbours of each",
            chosen={"samples": drawn, "neighbours": count, "seed": self.seed},
            remedy="take more samples",
            spending=spending,
        )


def _has_positions(problem: Problem) -> bool:
    """Whether the samples of a problem's roadmap are positions."""
    return problem.model.provides >= HEADED and isinstance(problem.target, GoalSet)


def _unfinished(along: Candidates) -> Candidates:
    """Say of the ways along guides that the search goes on, unless it was interrupted."""
    return replace(
        along,
        status=along.status if along.status is Status.INTERRUPTED else Status.UNFINISHED,
        certificate=f"{along.certificate}; the whole roadmap was not searched",
        provenance=tuple(origin | {"stage": "guides"} for origin in along.provenance),
    )


def on_roadmap(
    name: str,
    problem: Problem,
    objectives: Objectives,
    roadmap: AnyRoadmap,
    progress: ProgressCallback | None,
    notes: tuple[str, ...],
    checkpoint: CheckpointSpec | None = None,
    *,
    soon: bool = False,
) -> Candidates:
    """All non-dominated paths of a roadmap as the candidates of the planner ``name``, each of them judged.

    ``soon``: what a share of the time left finds, as a stage before the last; raises Exhausted where it is not built.
    """
    spending, first = roadmap.spending, None
    if soon:
        query = roadmap_query(objectives, roadmap, progress, notes)
        query.break_ties()
        share = spending.share(max(QUICK, SHARE * query.build_seconds))
        return _judged(query.exact(name, share, progress, stage=True), problem, roadmap)
    try:
        first = _first_of(name, roadmap, objectives)
        query = roadmap_query(objectives, roadmap, progress, notes)
        query.break_ties()
        found = query.exact(name, spending.left(), progress, checkpoint=checkpoint)
    except Exhausted as stop:
        found = stopped(name, objectives, stop, spending, first)
        return _judged(found, problem, roadmap) if found.trajectories else found
    return _judged(found, problem, roadmap)


def _first_of(name: str, roadmap: AnyRoadmap, objectives: Objectives) -> Candidates | None:
    """The shortest path of a roadmap of positions, kept in case a time limit is passed before its edges are costed."""
    if roadmap.spending.budget.time_limit is None or not isinstance(roadmap, StateRoadmap):
        return None
    if roadmap.costed(objectives.optimised):
        return None
    return shortest_path(name, roadmap, objectives, roadmap.start, roadmap.goals)


def _judged(found: Candidates, problem: Problem, roadmap: AnyRoadmap) -> Candidates:
    """Those of the candidates that can be judged in time, and are to be trusted."""
    name = str(found.stats["planner"])

    def left() -> float | None:  # as much again is for the evaluation of the front
        return None if (until := roadmap.spending.until_limit()) is None else until / 2

    found = evaluable_in_time(found, left, lambda some: trusted(some, problem, name))
    kept = trusted(found, problem, name)
    dropped = len(found.trajectories) - len(kept.trajectories)
    return replace(
        kept,
        certificate=found.certificate + f"; without {dropped} that were dropped as not to be trusted" * bool(dropped),
        stats={**kept.stats, **roadmap.counts},
    )


def roadmap_query(
    objectives: Objectives, roadmap: AnyRoadmap, progress: ProgressCallback | None, notes: tuple[str, ...]
) -> GraphQuery:
    """What is asked of a roadmap's graph; raises Exhausted where a limit is passed.

    A criterion that cannot cost what collides has all edges checked before.
    """
    if progress:
        progress(Progress("graph"))
    try:
        graph = roadmap.graph(objectives.optimised)
    except CriterionError as error:
        if roadmap.is_checked or not isinstance(roadmap, ConfigurationRoadmap):
            raise
        notes = (*notes, f"all edges were checked before the search, as some that were not have no cost: {error}")
        roadmap = replace(roadmap, lazy=False)
        graph = roadmap.graph(objectives.optimised)
    return GraphQuery(
        roadmap, objectives, graph, roadmap.start, roadmap.goals, build_seconds=roadmap.spending.seconds(), notes=notes
    )
