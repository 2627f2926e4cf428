"""First step of building a roadmap of configurations: find usable goals, and first paths (guides) to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.errors import QueryError
from hpop.goals import GoalSet
from hpop.goals.region import sampled_space
from hpop.goals.sight import reached_in
from hpop.motions import States, StateSpace
from hpop.planners.graphs.roadmap.guides import Connections, Guide, guides
from hpop.planners.graphs.roadmap.links import START
from hpop.planners.needs import elsewhere
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

PAIRS = 10  # number of pairs of random trees, for robots that do not move in the plane
GOAL_STATES = 100  # number of states that are drawn from a goal with more than one state


@dataclass(frozen=True, eq=False)
class Survey:
    """A problem's start, its usable goals, and first paths to them, as found before samples are drawn.

    connections  distances between states, and collision checks of motions between them
    start        (1,)  state
    goals        (G,)  goal states without a collision; NaN for an angle that may have any value, if the robot is free
                 at one of the values that were tried
    goal_count   number of all goal states, including blocked ones
    pairs        number of pairs of random trees that searched for guides
    guides       collision-free paths that the trees found, shortest first
    seed         seed of all random draws
    """

    problem: Problem
    connections: Connections
    start: States
    goals: States
    goal_count: int
    pairs: int
    guides: list[Guide]
    seed: int

    @property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Coordinates of the start (k,) and of the goals (G, k).

        A coordinate of a goal that may have any value gets the start's value.
        """
        start, goals = self.connections.rows(self.start)[0], self.connections.rows(self.goals)
        return start, np.where(np.isnan(goals), start, goals)

    @cached_property
    def inner(self) -> FloatArray:
        """Coordinates (n, k) of all states of the guides, without their start and goals."""
        start = self.connections.rows(self.start)
        return np.concatenate([start[:0], *(guide.rows[1:-1] for guide in self.guides)])

    def goal_nodes(self, free: int) -> list[int]:
        """Return the node numbers of the goals in a roadmap: nodes are the start, ``free`` samples, then the goals."""
        return list(range(1 + free, 1 + free + self.goals.size))

    def target_nodes(self, free: int) -> list[int]:
        """Return the node numbers at which a path may end: the goals, and the start if it is at a goal already.

        free  number of samples, whose node numbers lie between those of start and goals
        """
        at_goal = reached_in(self.problem.world, self.problem.target, self.problem.model, self.start)[0]
        return [START, *self.goal_nodes(free)] if at_goal else self.goal_nodes(free)


def survey(problem: Problem, trees: int | None, seed: int, spending: Spending) -> Survey:
    """Check start and goals for collisions, draw goal states where needed, and search first paths (guides) to them.

    Raises QueryError if the start or every goal is blocked.

    Parameters
    ----------
    trees : number of pairs of random trees that search for guides; None: none for a robot in the plane, else 10
    """
    space, in_plane = sampled_space(problem.model, problem.world), "plane" in problem.model.provides
    of_goals, _, of_trees, _ = np.random.default_rng(seed).spawn(4)
    start, (goals, goal_count) = _free_start(problem), _free_goals(problem, of_goals)
    connections = Connections(problem, space)
    pairs = (0 if in_plane else PAIRS) if trees is None else trees
    begin, ends = connections.rows(start)[0], connections.rows(goals)
    ends = np.where(np.isnan(ends), begin, ends)  # free coordinates take the start's values
    found = guides(connections, begin, ends, pairs, of_trees, spending) if pairs else []
    return Survey(problem, connections, start, goals, goal_count, pairs, found, seed)


def guide_links(guides: Sequence[Guide], goals: Sequence[int]) -> IntArray:
    """Return the links (L, 2), as pairs of nodes, that make all guides paths of a roadmap.

    The inner states of the guides must be the first nodes after the start, in the order of :attr:`Survey.inner`.

    goals  node numbers of the goals
    """
    parts, node = [np.zeros((0, 2), np.int64)], START + 1
    for guide in guides:
        inner = len(guide.rows) - 2
        nodes = np.array([START, *range(node, node + inner), goals[guide.goal]])
        parts.append(np.stack([nodes[:-1], nodes[1:]], axis=1))
        node += inner
    return np.concatenate(parts)


# Start and goals


def _free_start(problem: Problem) -> States:
    """Return the start (1,); raise QueryError if it is blocked."""
    start = problem.model.space.state(problem.start)
    if reason := problem.model.collision(problem.world).why_blocked(start):
        hint = elsewhere(problem.model, problem.world, start)
        raise QueryError(f"the start {_state_text(problem.start)} is not usable: {reason}.{hint}")
    return start


def _free_goals(problem: Problem, rng: np.random.Generator) -> tuple[States, int]:
    """Return the goal states (G,) that are not blocked, and the number of all goal states.

    NaN stands for a coordinate that may have any value. A goal that is not a list of states is replaced by states
    drawn from it at random. Raises QueryError if all are blocked.
    """
    model, target = problem.model, problem.target
    collision = model.collision(problem.world)
    if not target.listed:
        states = target.states(problem, rng, GOAL_STATES)
        free = collision.states_free(states)
        if not free.any():
            reason = collision.why_blocked(states.take(slice(0, 1)))
            raise QueryError(
                f"the goal is not usable: all of {states.size} states drawn from it at random are blocked. Move the "
                f"goal, or make it larger. The first of these states: {reason}."
            )
        return states.take(free), states.size
    usable, refusals = list[States](), list[str]()
    for i, member in enumerate(target.listed):
        drawn = GoalSet((member,)).states(problem, rng, GOAL_STATES)
        if collision.states_free(drawn).any():
            usable.append(model.space.state(member, free=model.space.angles))
            continue
        what = f"goal {i}" if len(target.listed) > 1 else "goal"
        tried = f" (at any of {drawn.size} random angles)" * (drawn.size > 1)
        reason = collision.why_blocked(drawn.take(slice(0, 1)))
        hint = elsewhere(model, problem.world, model.space.state(member, free=model.space.angles))
        refusals.append(f"the {what} {_state_text(member)} is not usable{tried}: {reason}.{hint}")
    if not usable:
        raise QueryError(" ".join(refusals))
    return concatenated_states(model.space, usable), len(target.listed)


def _state_text(values: Sequence[float | None]) -> str:
    """Return a state as text for messages, with "any" for a coordinate that may have any value."""
    return f"({', '.join('any' if value is None else f'{value:.3f}' for value in values)})"


def concatenated_states(space: StateSpace, parts: Sequence[States]) -> States:
    """Concatenate several arrays of states of a space."""
    return States(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in space.names})
