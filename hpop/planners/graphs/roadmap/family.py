"""Graph family of the roadmap planner: a probabilistic roadmap of positions, or of configurations of any robot."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import InitVar, dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np

from hpop.base.options import set_wholes
from hpop.base.randomness import MaybeRNG, set_seed
from hpop.base.text import set_python_values
from hpop.errors import OptionError
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.roadmap.configurations import ConfigurationRoadmap, configuration_roadmap, guide_roadmap
from hpop.planners.graphs.roadmap.headings import StateRoadmap, checked_ends, drawn_positions, nearest_links, pairs
from hpop.planners.graphs.roadmap.in_time import drawn_views, is_free_ending, roadmap_in_time, timeless_problem
from hpop.planners.graphs.roadmap.survey import Survey, survey
from hpop.planners.needs import in_plane, start_of
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

# Building a large roadmap may take longer than the time limit. With a time limit, smaller roadmaps are therefore
# searched first, each within a share of the time. Each has a quarter of the samples of the next, but at least SMALLEST.


SMALLEST = 250  # smallest number of samples of a roadmap that is searched first
GROWTH = 4  # factor between the numbers of samples of successive roadmaps


def smaller_sample_counts(samples: int, spending: Spending) -> list[int]:
    """Return the numbers of samples of the smaller roadmaps to search before one with ``samples``, ascending.

    Empty without a time limit.
    """
    sizes: list[int] = []
    if spending.limits.time_limit is not None:
        while (samples := samples // GROWTH) >= SMALLEST:
            sizes.insert(0, samples)
    return sizes


MOST_SAMPLES = 1_000_000
MOST_TREES = 100
HEADED = frozenset({"plane", "turn-move", "rigid"})
AnyRoadmap: TypeAlias = StateRoadmap | ConfigurationRoadmap


@graph_family("roadmap")
@dataclass(frozen=True)
class RoadmapGraph(GraphFamily):
    """Probabilistic roadmap (Kavraki et al. 1996) of positions, or of configurations of any robot.

    samples     number of random free positions or configurations; for two_arms, up to half are views of the tool
    neighbours  number of nearest samples to which each sample is linked; None: ceil(2e log n) for n nodes in the plane,
                as in PRM*, and 8 for other robots
    far         number of farther samples to which each sample is linked as well: each is the nearest one in a random
                subset of all samples, of random size; None: 0 in the plane, and 8 for other robots
    trees       number of pairs of random trees that look for paths, called guides, before samples are drawn
                (:mod:`.guides`): three of ten samples then lie near guides, the others where a path through them is at
                most 1.6 times as long as the shortest guide; None: 0 in the plane, and 10 for other robots
    seed        seed of the random samples; in Python also `rng`: a seed, a Generator that draws one, or None for a
                fresh one (SPEC 7)

    To have a result even after a short time, a planner first searches a smaller graph: the guides alone, if there are
    any; or, for positions with a time limit, smaller roadmaps, each with a quarter of the samples of the next.
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

    def build(self, problem: Problem, objectives: Objectives, spending: Spending) -> BuiltGraph:
        """Build the whole roadmap, with the problem's start and goals."""
        *_, built = self.graphs(problem, objectives, spending)
        return built

    def graphs(
        self, problem: Problem, objectives: Objectives, spending: Spending, *, in_stages: bool = False
    ) -> Iterator[BuiltGraph]:
        """Yield the whole roadmap; if ``in_stages``, before it a roadmap of the guides alone, or smaller roadmaps.

        For a robot whose states have a time, only the whole roadmap is yielded.
        """
        if "time" in problem.model.provides:
            yield self._with_few(_built_graph(self._in_time(problem, spending), problem))
            return
        ends_and_guides = None if _has_positions(problem) else survey(problem, self.trees, self.seed, spending)
        if in_stages and ends_and_guides is not None and ends_and_guides.guides:
            yield replace(_built_graph(guide_roadmap(ends_and_guides, spending), problem), part="guides")
        if in_stages and ends_and_guides is None:
            for samples in smaller_sample_counts(self.samples, spending):
                held = spending.memory
                part = replace(self, samples=samples)._build_position_roadmap(problem, spending)
                yield replace(_built_graph(part, problem), part=f"roadmap of {samples:,} samples")
                spending.release(spending.memory - held)
        yield self._with_few(_built_graph(self._build_roadmap(problem, ends_and_guides, spending), problem))

    def _with_few(self, built: BuiltGraph) -> BuiltGraph:
        """Return a roadmap with a note if it has fewer samples than wanted."""
        drawn = built.ends.space.options["samples"]
        few = (
            f"the roadmap has only {drawn} of {self.samples:,} samples: at nearly all random samples the robot collides"
        )
        return replace(built, notes=(few, *built.notes)) if drawn < self.samples else built

    def _in_time(self, problem: Problem, spending: Spending) -> ConfigurationRoadmap:
        """Build the roadmap of states in time, from a roadmap of the robot without time.

        Some samples of the latter are views: states in which the camera looks at the body that it watches.
        """
        alone = timeless_problem(problem)
        found = survey(alone, 0 if is_free_ending(problem) else self.trees, self.seed, spending)
        views = drawn_views(problem, alone, self.samples, self.seed)
        random = max(1, self.samples - views.size)
        return roadmap_in_time(
            problem, configuration_roadmap(found, random, self.neighbours, self.far, spending, views), spending
        )

    def has_clock(self, problem: Problem) -> bool:
        """Return whether the roadmap can be searched in time steps: yes if its samples are positions."""
        return _has_positions(problem)

    def roadmap(self, problem: Problem, spending: Spending | None = None) -> AnyRoadmap:
        """Return the roadmap for a problem; raise QueryError if the start is blocked or no goal can be used."""
        spending = spending or Spending()
        if "time" in problem.model.provides:
            return self._in_time(problem, spending)
        ends_and_guides = None if _has_positions(problem) else survey(problem, self.trees, self.seed, spending)
        return self._build_roadmap(problem, ends_and_guides, spending)

    def _build_roadmap(self, problem: Problem, ends_and_guides: Survey | None, spending: Spending) -> AnyRoadmap:
        """Build the roadmap of configurations from a survey of start, goals and guides; without one, of positions."""
        if ends_and_guides is None:
            return self._build_position_roadmap(problem, spending)
        return configuration_roadmap(ends_and_guides, self.samples, self.neighbours, self.far, spending)

    def _build_position_roadmap(self, problem: Problem, spending: Spending) -> StateRoadmap:
        if self.far or self.trees:
            raise OptionError(
                "far and trees are options for robots whose roadmap has configurations as samples, but the roadmap of "
                "this robot has positions; leave far and trees out"
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
            remedy="take more samples",  # advice if there is no path
            spending=spending,
        )


def _built_graph(roadmap: AnyRoadmap, problem: Problem) -> BuiltGraph:
    return BuiltGraph(Ends(roadmap, roadmap.start, roadmap.goals), problem, roadmap.notes)


def _has_positions(problem: Problem) -> bool:
    """Return whether the roadmap for a problem has positions as samples, not configurations of all coordinates."""
    return problem.model.provides >= HEADED and bool(problem.target.listed)
