"""The roadmap planner: every optimal trade-off on a probabilistic roadmap, exactly."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import InitVar, dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from hpop.errors import OptionError
from hpop.options import set_wholes
from hpop.planners.base import planner
from hpop.planners.goals import start_of
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.needs import in_plane
from hpop.planners.objectives import Objectives
from hpop.planners.roadmap.configurations import ConfigurationRoadmap, configuration_roadmap, guide_roadmap
from hpop.planners.roadmap.growing import smaller
from hpop.planners.roadmap.headings import StateRoadmap, nearest_links
from hpop.planners.roadmap.positions import checked_ends, drawn_positions, pairs
from hpop.planners.roadmap.survey import Survey, survey
from hpop.planners.searches.exact import ExactSearch
from hpop.planners.spending import Spending
from hpop.randomness import MaybeRNG, set_seed
from hpop.scalars import set_python_values
from hpop.status import ProgressCallback

if TYPE_CHECKING:
    from hpop.problem import Problem

MOST_SAMPLES = 1_000_000
MOST_TREES = 100
HEADED = frozenset({"plane", "turn-move", "rigid"})
AnyRoadmap: TypeAlias = StateRoadmap | ConfigurationRoadmap


@graph_family("roadmap")
@dataclass(frozen=True)
class RoadmapGraph(GraphFamily):
    """A probabilistic roadmap (Kavraki et al. 1996) of positions, or of configurations of any robot.

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

    Where trees found guides, the graph of these alone comes first; of positions under a time limit, roadmaps of a
    sixteenth and a quarter of the samples. So a limit leaves more than nothing.
    """

    goal_sets: ClassVar[bool] = True
    any_goal: ClassVar[bool] = True
    answers_by_parts: ClassVar[bool] = True

    samples: int = 500
    neighbours: int | None = None
    far: int | None = None
    trees: int | None = None
    seed: int = 0
    rng: InitVar[MaybeRNG] = field(default=..., kw_only=True)

    def __post_init__(self, rng: MaybeRNG) -> None:
        set_python_values(self)
        set_wholes(self, "samples", least=1, most=MOST_SAMPLES)
        set_seed(self, rng)
        set_wholes(self, "neighbours", least=1, optional=True)
        set_wholes(self, "far", least=0, optional=True)
        set_wholes(self, "trees", least=0, most=MOST_TREES, optional=True)

    def build(
        self, problem: Problem, objectives: Objectives, spending: Spending, progress: ProgressCallback | None = None
    ) -> BuiltGraph:
        """Lay out the roadmap between the problem's start and goal."""
        *_, built = self.graphs(problem, objectives, spending, progress)
        return built

    def graphs(
        self,
        problem: Problem,
        objectives: Objectives,
        spending: Spending,
        progress: ProgressCallback | None = None,
        *,
        in_stages: bool = False,
    ) -> Iterator[BuiltGraph]:
        """Yield the graph of the guides, if there are some and they are wanted, then the whole roadmap."""
        known = None if _has_positions(problem) else survey(problem, self.trees, self.seed, spending)
        if in_stages and known is not None and known.guides:
            yield replace(_built(guide_roadmap(known, spending), problem), part="guides")
        if in_stages and known is None:
            for samples in smaller(self.samples, spending):
                held = spending.memory
                part = replace(self, samples=samples)._of_positions(problem, spending)
                yield replace(_built(part, problem), part=f"roadmap of {samples:,} samples")
                spending.release(spending.memory - held)
        roadmap = self._made(problem, known, spending)
        drawn = roadmap.options["samples"]
        few = f"only {drawn} of {self.samples:,} samples: next to nothing is free where they are drawn"
        built = _built(roadmap, problem)
        yield replace(built, notes=(few, *built.notes)) if drawn < self.samples else built

    def has_clock(self, problem: Problem) -> bool:
        """Return whether the samples are positions, between which a robot can hold."""
        return _has_positions(problem)

    def roadmap(self, problem: Problem, spending: Spending | None = None) -> AnyRoadmap:
        """Return the roadmap between the problem's start and goal; QueryError when one of them is blocked."""
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


def _built(roadmap: AnyRoadmap, problem: Problem) -> BuiltGraph:
    return BuiltGraph(Ends(roadmap, roadmap.start, roadmap.goals), problem, roadmap.notes)


@planner("roadmap")
@dataclass(frozen=True)
class Roadmap(ExactSearch, RoadmapGraph):
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

    def __post_init__(self, rng: MaybeRNG) -> None:
        RoadmapGraph.__post_init__(self, rng)
        ExactSearch.__post_init__(self)


def _has_positions(problem: Problem) -> bool:
    """Whether the samples of a problem's roadmap are positions."""
    return problem.model.provides >= HEADED and bool(problem.target.listed)
