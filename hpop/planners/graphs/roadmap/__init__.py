"""Graph family of the roadmap planner: a probabilistic roadmap of positions, or of configurations of any robot.

A robot beside something that moves as given has a roadmap of states in time, made from the roadmap of the robot alone.
Time is cut into equal steps. A node has a copy at each step at which the robot can be there and still reach a goal at
the last step. Each link has a copy at each step, and takes as many steps as its motion needs, rounded up, so that plans
keep the clock exactly. Links from each copy to the next of the same node are waits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import InitVar, dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, cast

import numpy as np

from hpop.base.arrays import FloatArray, IntArray, numbered
from hpop.base.options import set_wholes
from hpop.base.randomness import MaybeRNG, set_seed
from hpop.base.text import set_python_values
from hpop.criteria.base import make_criterion
from hpop.errors import OptionError, QueryError
from hpop.goals import Anywhere, LookAt
from hpop.goals.region import InverseKinematics
from hpop.motions import ModelInTime, States
from hpop.planners.graphs.family import BuiltGraph, GraphFamily, graph_family
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.roadmap.configurations import (
    ARC,
    ORDERED,
    ConfigurationRoadmap,
    configuration_roadmap,
    guide_roadmap,
)
from hpop.planners.graphs.roadmap.headings import StateRoadmap, checked_ends, drawn_positions, nearest_links, pairs
from hpop.planners.graphs.roadmap.survey import Survey, survey
from hpop.planners.needs import in_plane, start_of
from hpop.planners.objectives import Objectives
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

ROUNDING = 1e-9  # in steps
NEVER = 2**31  # step of a node that cannot be reached
TIMES = 9  # number of times at which the camera looks at the watched body in the drawn views
DRAWN = 4  # number of views that are drawn at first, as a multiple of those kept
BAND = 0.15, 1.0  # m, distances from which these views are drawn
VIEWS = 0.5  # share of the samples that are such views, at most


def timeless_problem(problem: Problem) -> Problem:
    """Return the problem of the robot alone, without time; its goal is its start if the robot may end anywhere."""
    model = cast(ModelInTime, problem.model)
    size, time = len(model.timeless.space.names), problem.start[-1]
    start = problem.start[:size]
    if time != 0.0:
        raise QueryError(
            f"the time of the start must be 0 s, when the given motion begins, got {time:g} s; leave it out"
        )
    if problem.tour is not None:
        raise QueryError("a robot whose states have a time takes no tour; give its stops as goals of several problems")
    end, goal = problem.model.space.high[-1], problem.goal
    if early := [values for values in problem.target.listed if values[-1] != end]:
        raise QueryError(f"the time of a goal must be {end:g} s, the end of the given motion, got {early[0][-1]:g} s")
    listed = [values[:size] for values in problem.target.listed]
    ends: Any = start if is_free_ending(problem) else listed or goal
    duration = make_criterion("duration")
    return replace(problem, model=model.timeless, start=start, goal=ends, criteria=(duration,), quanta={})


def is_free_ending(problem: Problem) -> bool:
    """Return whether every state is a goal."""
    return any(isinstance(goal, Anywhere) for goal in problem.target.alternatives())


def drawn_views(problem: Problem, alone: Problem, samples: int, seed: int) -> States:
    """Draw states in which the camera looks at the watched body at several times; none if it is out of reach.

    Views at the first time are drawn at random, and those near the start are kept. Those at each later time are made
    from the ones before by inverse kinematics, so that the robot can follow the body with small motions.
    """
    model, rng = cast(ModelInTime, problem.model), np.random.default_rng([seed, 1])
    times, space = np.linspace(0.0, model.space.high[-1], TIMES), alone.model.space
    pose = model.pose(model.watched, States(time=times))
    places = np.stack([np.broadcast_to(part, times.shape) for part in (pose.x, pose.y, pose.z)], axis=1).tolist()
    count, rows, found = max(1, int(VIEWS * samples / TIMES)), np.zeros((0, len(space.names))), []
    for x, y, z in places:
        goal = LookAt((x, y, z), distance=BAND, roll=0.0)
        sought = InverseKinematics(alone.model, space, goal)
        low, high = (np.broadcast_to(bound, (len(rows), bound.size)) for bound in goal.bounds)
        rows = sought.descend(rows, low, high) if len(rows) else rows
        rows = rows[goal.reached(alone.model, sought.states(rows))] if len(rows) else rows
        if not len(rows):
            try:
                states = goal.states(alone, rng, DRAWN * count)
            except QueryError:  # too far away
                continue
            apart = space.apart(space.state(alone.start).take(np.zeros(states.size, np.int64)), states)
            rows = sought.rows(states.take(np.argsort(apart, kind="stable")[:count]))
        found.append(rows)
    states = States(**dict(zip(space.names, np.concatenate([rows[:0], *found]).T, strict=True)))
    return states.take(alone.model.collision(alone.world).states_free(states)) if states.size else states


def roadmap_in_time(problem: Problem, still: ConfigurationRoadmap, spending: Spending) -> ConfigurationRoadmap:
    """Return the roadmap of states in time for a problem, from the roadmap of the robot alone.

    Raises QueryError if the start is blocked at time 0, or if no goal can be reached in time and is free at the end.
    """
    model, collision = cast(ModelInTime, problem.model), problem.model.collision(problem.world)
    if reason := collision.why_blocked(model.space.state(problem.start)):
        raise QueryError(f"the start is not usable: {reason}.")
    end = model.space.high[-1]
    count = max(1, math.ceil(end / model.step - ROUNDING))
    still = still.with_checked_arcs()
    tails, heads = still.arcs.ends(slice(0, still.arcs.heads.size))
    lasts = np.maximum(1, np.ceil(_durations(model, still, tails, heads) * count / end - ROUNDING)).astype(np.int64)
    ends = np.arange(still.size) if is_free_ending(problem) else np.array(still.goals)
    earliest = _steps(still.size, tails, heads, lasts, [still.start])
    latest = count - _steps(still.size, heads, tails, lasts, ends.tolist())
    if earliest[ends].min() > count:
        least = earliest[ends].min()
        reason = (
            f"that takes {least * end / count:.3g} s; give a nearer goal, or a longer motion"
            if least < NEVER
            else "the roadmap has no path to a goal; take more samples"
        )
        raise QueryError(f"no goal can be reached within {end:g} s, the duration of the given motion: {reason}")
    copies = np.maximum(0, latest - earliest + 1)
    first = np.cumsum(copies) - copies - earliest  # plus a step: the copy of a node at this step
    spending.check("the roadmap was copied for each step of time", int(copies.sum()) * 8 * (len(model.space.names) + 4))
    owner, number = numbered(copies)
    step = earliest[owner] + number
    columns = {name: np.nan_to_num(getattr(still.nodes, name)) for name in still.nodes.names}
    rest = {name: np.zeros(owner.size) for name in model.space.names if name not in columns}
    rest[model.space.names[-1]] = np.linspace(0.0, end, count + 1)[step]
    nodes = States(**{name: column[owner] for name, column in columns.items()}, **rest)
    links = np.concatenate([_links(tails, heads, lasts, earliest, latest, first), _waits(owner)])
    spending.check("the roadmap was copied for each step of time", len(links) * (ARC + ORDERED))
    free = collision.states_free(nodes)
    links = links[free[links].all(axis=1)]
    last = (first + count)[ends[copies[ends] > 0]]
    goals = last[free[last]].tolist()
    if not goals:
        raise QueryError(
            f"no goal is usable at {end:g} s: in all {last.size} states that can be reached by then, the robot touches "
            "what moves; move the goal"
        )
    blind = (
        f"in no state that was found does the camera look at the {model.watched} from {BAND[0]:g} to {BAND[1]:g} m, "
        "upright, at any of the times tried; move the robot nearer, or turn its camera"
    )
    name = f"{still.name}, at {count + 1} times {end / count:.4g} s apart, with waits"
    return replace(
        still,
        model=problem.model,
        nodes=nodes,
        links=links[np.lexsort(links.T[::-1])],
        goals=goals,
        name=name,
        chosen={**still.chosen, "step": end / count},
        lazy=True,
        notes=still.notes if still.chosen["views"] else (*still.notes, blind),
        spending=spending,
    )


def _durations(model: ModelInTime, still: ConfigurationRoadmap, tails: IntArray, heads: IntArray) -> FloatArray:
    """Return the least duration (N,), s, of the motion between each pair of nodes."""
    pairs = still.states(tails), still.states(heads)
    others = {name: np.zeros(tails.size) for name in model.space.names if name not in still.nodes.names}
    start, end = (States(**{**states.__dict__, **others}) for states in pairs)
    lasts: FloatArray = model.connect(start, end)[-1].end.__dict__[model.space.names[-1]]
    return lasts


def _steps(size: int, tails: IntArray, heads: IntArray, lasts: IntArray, start: Sequence[int]) -> IntArray:
    """Return the fewest steps (n,) from any of the nodes ``start`` to each node; :data:`NEVER` without a path."""
    from scipy.sparse import csr_array  # on first use: the import takes its time
    from scipy.sparse.csgraph import dijkstra

    network: Any = csr_array((lasts.astype(float), (tails, heads)), shape=(size, size))
    steps = dijkstra(network, indices=np.array(start), min_only=True)
    return np.where(np.isfinite(steps), steps, NEVER).astype(np.int64)


def _links(
    tails: IntArray, heads: IntArray, lasts: IntArray, earliest: IntArray, latest: IntArray, first: IntArray
) -> IntArray:
    """Return links (L, 2) between copies of nodes: each link (tail, head), at each step at which it can be used.

    tails, heads      nodes of the links of the roadmap without time
    lasts             steps that each link takes
    earliest, latest  by node: first and last step at which it has a copy
    first             by node: a step plus this number is its copy at that step
    """
    counts = np.maximum(0, np.minimum(latest[tails], latest[heads] - lasts) - earliest[tails] + 1)
    row, number = numbered(counts)
    begin = earliest[tails[row]] + number
    return np.stack([first[tails[row]] + begin, first[heads[row]] + begin + lasts[row]], axis=1)


def _waits(owner: IntArray) -> IntArray:
    """Return the links (L, 2) from each copy of a node to the next; ``owner`` (N,) is the node of each copy."""
    before = np.flatnonzero(owner[1:] == owner[:-1])
    return np.stack([before, before + 1], axis=1)


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
    far         number of further links from each sample to samples farther away. Each link leads to the nearest sample
                of a random subset; the smaller the subset, the longer the link. None: 0 in the plane, and 8 for other
                robots
    trees       number of pairs of random trees that look for paths, called guides, before samples are drawn. Three of
                ten samples then lie near guides. The others lie where the straight line from the start and the one on
                to a goal are together at most 1.6 times as long as the shortest guide. None: 0 in the plane, and 10 for
                other robots
    seed        seed of the random samples; in Python also `rng`: a seed, a Generator that draws one, or None for a
                fresh one (SPEC 7 of Scientific Python)

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
