"""A roadmap of configurations: states of any model, drawn at random, and the chains of motions that connect them.

A roadmap of Kavraki et al. 1996 (doi 10.1109/70.508439) in the space of the model's states, near and far as its metric
says. An arc is all that the model needs to get from a state to another, so nothing is known here of how it moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.errors import OptionError, QueryError
from hpop.goals import GoalSet
from hpop.motions import States, StateSpace
from hpop.planners.graphs.arcs import Arcs, blocks
from hpop.planners.graphs.chains import Chains
from hpop.planners.graphs.stretches import Stretches
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph, aggregates
from hpop.planners.spending import Spending
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.problem import Problem

MAX_LINKS = 60_000_000
LINK = 64  # bytes that finding a link takes
ARC = 16  # bytes of an arc beside its costs
PIECES = 64  # a chain is as much work as so many arcs of one motion
DRAWN_AT_ONCE = 1 << 16
DRAWS = 1000  # states drawn for each that is wanted, before the free space is called too small
GOAL_STATES = 100  # drawn of a goal that is more than one state
START = 0  # its node


@dataclass(frozen=True, eq=False)
class ConfigurationRoadmap(TrajectoryGraph):
    """Configurations of a robot, and the chains of motions between them that are free.

    nodes   (P,)    the start, the samples, the goals; what is NaN of a goal is free
    links   (L, 2)  tails and heads, by tails, between which a chain may be free
    goals   nodes
    name    what the roadmap is, in words
    chosen  the options that made it, JSON-able

    A pair that the model's legs do not lead from one to the other has no chain.
    """

    nodes: States
    links: IntArray
    goals: list[int]
    name: str
    chosen: dict[str, Any]

    @property
    def start(self) -> int:
        """The node of the start."""
        return START

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.nodes.size

    @property
    def words(self) -> str:
        """What tells this roadmap from others, in words."""
        return self.name

    @property
    def options(self) -> dict[str, Any]:
        """The same, JSON-able."""
        return self.chosen

    @property
    def counts(self) -> dict[str, int]:
        """How large it is."""
        return {"configurations": self.size, "chains": self.arcs.heads.size}

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the legs by which the model connects states."""
        start = self.nodes.take(slice(START, START + 1))
        return tuple(dict.fromkeys(leg.kind for leg in self.model.connect(start, start)))

    def states(self, ids: IntArray) -> States:
        """Configurations (N,) by their nodes."""
        return self.nodes.take(ids)

    def _chains(self, tails: IntArray, heads: IntArray) -> Chains:
        """Chains (N,) between nodes, free or not."""
        return Chains.connecting(self, tails, heads, self.states(tails), self.states(heads))

    @cached_property
    def arcs(self) -> Arcs:
        """All free chains that lead where they shall, each an arc."""
        free = np.zeros(len(self.links), dtype=np.bool_)

        def found(part: slice) -> tuple[slice, BoolArray]:
            tails, heads = self.links[part].T
            chains = self._chains(tails, heads)
            return part, chains.free() & chains.reach(self.states(heads))

        for part, there in self.spending.each(found, blocks(free.size, PIECES), f"{self.words} was laid out"):
            free[part] = there
        tails, heads = self.links[free].T
        return Arcs.sorted(self.size, [(tails, heads)])

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """The graph with one integer cost a criterion: costs of chains in quanta, rounded once."""
        arcs, doing = self.arcs, f"{self.words} was built"
        self.spending.hold(arcs.heads.size * (8 * len(criteria) + ARC), doing)
        costs = np.empty((arcs.heads.size, len(criteria)), np.int64)

        def paid(part: slice) -> tuple[slice, IntArray]:
            return part, self._chains(*arcs.ends(part)).costs(criteria)

        for part, counts in self.spending.each(paid, blocks(arcs.heads.size, PIECES), doing):
            costs[part] = counts
        costs.setflags(write=False)
        return Graph.from_csr(arcs.start, arcs.heads, costs, aggregates=aggregates(criteria))

    @cached_property
    def turned(self) -> NDArray[np.int8]:
        """Motions (m,) in each arc."""
        size = self.arcs.heads.size
        parts = [self._chains(*self.arcs.ends(part)).count(self.kinds) for part in blocks(size, PIECES)]
        return np.concatenate([np.zeros(0, np.int8), *parts]).astype(np.int8)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Trajectories through nodes (N,), so many (n,) of them for each, the motions of chains written out."""
        alone = sizes == 1  # from a node to itself: a chain without motions
        ids = np.repeat(ids, np.repeat(np.where(alone, 2, 1), sizes))
        sizes = sizes + alone
        heads = np.delete(np.arange(ids.size), np.cumsum(sizes) - sizes)
        return self._chains(ids[heads - 1], ids[heads]).stretches(sizes - 1)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """How many components the roadmap has, and which hold the start and the goal, in words."""
        from scipy.sparse import csr_array  # on first use: the import takes its time
        from scipy.sparse.csgraph import connected_components

        arcs = self.arcs
        links = csr_array((np.ones(arcs.heads.size), arcs.heads, arcs.start), shape=(self.size, self.size))
        components, component = connected_components(links, directed=False)
        begin, *ends = component[[start, *goals]].tolist()
        if begin in ends:
            return (
                f"no path: start and goal are in one component of {self.words}, but its motions lead the other way; "
                "take more samples"
            )
        sizes = np.bincount(component)
        apart = ", ".join(str(sizes[end]) for end in dict.fromkeys(ends))
        return (
            f"no path: {self.words} has {components} components; that of the start has {sizes[begin]} of {self.size} "
            f"configurations, that of the goal {apart}; take more samples"
        )


def configuration_roadmap(
    problem: Problem, samples: int, neighbours: int | None, seed: int, spending: Spending
) -> ConfigurationRoadmap:
    """The roadmap between a problem's start and goal.

    Raises QueryError when one of them is blocked, OptionError for more links than a graph can have.

    Parameters
    ----------
    samples : free configurations, drawn uniformly; fewer where next to nothing is free
    neighbours : to how many of the nearest each is linked; None takes ceil(2e log n) of n
    """
    space, model = problem.model.space, problem.model
    of_goals, of_samples = np.random.default_rng(seed).spawn(2)
    start, (goals, found) = _start(problem), _goals(problem, of_goals)
    drawn = _drawn(problem, samples, of_samples, spending)
    nodes = _all_of(space, [start, drawn, goals])
    count = neighbours or math.ceil(2 * math.e * math.log(nodes.size))
    name = f"the roadmap of {drawn.size} samples (seed {seed}) and {count} neighbours of each"
    chosen = {"samples": drawn.size, "neighbours": count, "seed": seed}
    if not isinstance(problem.target, GoalSet):
        name += f", {goals.size} free states of the goal ({found} found, {GOAL_STATES} sought)"
        chosen = {**chosen, "goal_states": goals.size, "goal_states_found": found}
    ends = list(range(1 + drawn.size, nodes.size))
    return ConfigurationRoadmap(
        model,
        problem.world,
        nodes,
        _links(space, start, drawn, goals, count, spending),
        [START, *ends] if problem.target.reached(model, start)[0] else ends,
        name=name,
        chosen=chosen,
        spending=spending,
    )


# Start and goals


def _start(problem: Problem) -> States:
    """The start (1,); QueryError where it is blocked."""
    start = problem.model.space.state(problem.start)
    if reason := problem.model.collision(problem.world).why_blocked(start):
        raise QueryError(f"the start {_written(problem.start)} is not usable: {reason}.")
    return start


def _goals(problem: Problem, rng: np.random.Generator) -> tuple[States, int]:
    """Goals (G,) that are not blocked, NaN where they are free; of a goal of another kind some of its states.

    With them, how many there were before those that are blocked were left out.

    Raises QueryError where all are blocked.
    """
    model, target = problem.model, problem.target
    collision = model.collision(problem.world)
    if not isinstance(target, GoalSet):
        states = target.states(problem, rng, GOAL_STATES)
        free = collision.states_free(states)
        if not free.any():
            reason = collision.why_blocked(states.take(slice(0, 1)))
            raise QueryError(f"the goal is not usable: none of {states.size} states drawn of it is free: {reason}.")
        return states.take(free), states.size
    usable, refusals = list[States](), list[str]()
    for i, member in enumerate(target.members):
        drawn = GoalSet((member,)).states(problem, rng, GOAL_STATES)
        if collision.states_free(drawn).any():
            usable.append(model.space.state(member, free=model.space.angles))
            continue
        what = f"goal {i}" if len(target.members) > 1 else "goal"
        tried = f" (at {drawn.size} angles drawn)" * (drawn.size > 1)
        reason = collision.why_blocked(drawn.take(slice(0, 1)))
        refusals.append(f"the {what} {_written(member)} is not usable{tried}: {reason}.")
    if not usable:
        raise QueryError(" ".join(refusals))
    return _all_of(model.space, usable), len(target.members)


def _written(values: Sequence[float | None]) -> str:
    """A state, as messages name it."""
    return f"({', '.join('any' if value is None else f'{value:.3f}' for value in values)})"


# Samples


def _drawn(problem: Problem, samples: int, rng: np.random.Generator, spending: Spending) -> States:
    """Free configurations (n,), drawn uniformly; of a robot in the plane within the bounds of the world."""
    space, collision = problem.model.space, problem.model.collision(problem.world)
    if "plane" in problem.model.provides:
        x_min, y_min, x_max, y_max = problem.world.bounds
        space = space.bounded(x=(x_min, x_max), y=(y_min, y_max))
    at_once = min(samples, DRAWN_AT_ONCE)
    parts, number = [space.sample(rng, 0)], 0
    for _ in range(DRAWS * math.ceil(samples / at_once)):
        spending.check("configurations were drawn")
        drawn = space.sample(rng, at_once)
        parts.append(drawn.take(collision.states_free(drawn)))
        number += parts[-1].size
        if number >= samples:
            break
    return _all_of(space, parts).take(slice(0, samples))


def _all_of(space: StateSpace, parts: Sequence[States]) -> States:
    """States of several parts, in order."""
    return States(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in space.names})


# Links


def _links(
    space: StateSpace, start: States, samples: States, goals: States, count: int, spending: Spending
) -> IntArray:
    """Tails and heads (L, 2), by tails: of each sample and its nearest ones, either way, from the start, to the goals.

    Start and goals are linked to as many samples, the start to all goals as well. Nothing leads back.
    """
    number, places = samples.size, np.arange(goals.size)
    if number * count > MAX_LINKS:
        raise OptionError(
            f"{number:,} samples with {count} neighbours each make more than {MAX_LINKS:,} links; take fewer samples, "
            "or fewer neighbours"
        )
    spending.check("configurations were linked", number * count * LINK)
    others = nearest(space, samples, samples, count + 1, spending)  # each is among its own nearest
    ids = np.repeat(np.arange(number), others.shape[1])
    low, high = np.minimum(ids, others.ravel()), np.maximum(ids, others.ravel())
    pairs = np.unique((low * number + high)[low < high])
    low, high = (1 + side for side in np.divmod(pairs, max(1, number)))
    leaving = 1 + nearest(space, samples, start, count, spending).ravel()
    arriving = [1 + nearest(space, samples, goals.take([place]), count, spending).ravel() for place in places]
    goal = 1 + number + places
    tails = [low, high, np.full(leaving.size, START), *arriving, np.full(goal.size, START)]
    heads = [high, low, leaving, np.repeat(goal, [ids.size for ids in arriving]), goal]
    links = np.stack([np.concatenate(tails), np.concatenate(heads)], axis=1)
    spending.hold(links.nbytes, "configurations were linked")
    return links[np.lexsort((links[:, 1], links[:, 0]))]


def nearest(space: StateSpace, states: States, of: States, count: int, spending: Spending) -> IntArray:
    """Places (N, c) of the nearest among states to each ``of`` (N,), by the metric of the space.

    What is NaN in the first of these is left out of the metric. A column that turns is a circle of the tree.
    """
    from scipy.spatial import KDTree  # on first use

    count = min(count, states.size)
    found = np.zeros((of.size, count), np.int64)
    if not count:
        return found
    columns = [
        (name, weight, 2 * math.pi * weight if name in space.turning else 0.0)
        for name, weight in zip(space.names, space.weights, strict=True)
        if weight and not np.isnan(getattr(of, name)[:1]).any()
    ]

    def placed(some: States) -> FloatArray:
        rows = []
        for name, weight, period in columns:
            value = weight * np.asarray(getattr(some, name), float)
            value = np.mod(value, period) if period else value
            rows.append(np.where(value >= period, 0.0, value) if period else value)
        return np.stack(rows, axis=1)

    tree, asked = KDTree(placed(states), boxsize=np.array([period for *_, period in columns])), placed(of)

    def near(part: slice) -> tuple[slice, IntArray]:
        return part, np.asarray(tree.query(asked[part], [*range(1, count + 1)])[1], np.int64)

    for part, places in spending.each(near, blocks(of.size, count), "configurations were linked"):
        found[part] = places
    return found
