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
from hpop.goals.approach import REACH, reached_in
from hpop.goals.region import sampled_space
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
                 at one of the values that were tried. If a goal has a straight approach: the states in which it begins
    goal_count   number of all goal states, including blocked ones
    pairs        number of pairs of random trees that searched for guides
    guides       collision-free paths that the trees found, shortest first
    seed         seed of all random draws
    approaches   for each goal, the rows of the states that follow on its straight approach, the goal itself last; ()
                 if no goal has one
    """

    problem: Problem
    connections: Connections
    start: States
    goals: States
    goal_count: int
    pairs: int
    guides: list[Guide]
    seed: int
    approaches: tuple[FloatArray, ...] = ()

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
        """Return the node numbers of the goals in a roadmap.

        Nodes are the start, ``free`` samples, the goals, and the states that follow on their approaches.
        """
        return list(range(1 + free, 1 + free + self.goals.size))

    @property
    def following(self) -> FloatArray:
        """Coordinates (n, k) of all states that follow the goals on their straight approaches."""
        return np.concatenate([self.connections.rows(self.start)[:0], *self.approaches])

    def approach_links(self, free: int) -> IntArray:
        """Return the links (L, 2) of straight approaches, sorted; no other links lead to or from their inner states."""
        first, links = 1 + free + self.goals.size, [np.zeros((0, 2), np.int64)]
        for goal, rows in zip(self.goal_nodes(free), self.approaches, strict=False):
            nodes = np.array([goal, *range(first, first + len(rows))])
            links.append(np.stack([nodes[:-1], nodes[1:]], axis=1))
            first += len(rows)
        joined = np.concatenate(links)
        return joined[np.argsort(joined[:, 0], kind="stable")]

    def target_nodes(self, free: int) -> list[int]:
        """Return the node numbers at which a path may end: the goals, and the start if it is at a goal already.

        If goals have straight approaches, paths end where the approaches end, and never at the start.

        free  number of samples, whose node numbers lie between those of start and goals
        """
        if self.approaches:
            last = (self.goals.size + free + np.cumsum([len(rows) for rows in self.approaches])).tolist()
            ends = zip(self.goal_nodes(free), last, self.approaches, strict=True)
            return [end if len(rows) else goal for goal, end, rows in ends]
        at_goal = reached_in(self.problem.world, self.problem.target, self.problem.model, self.start)[0]
        return [START, *self.goal_nodes(free)] if at_goal else self.goal_nodes(free)


def survey(problem: Problem, trees: int | None, seed: int, spending: Spending) -> Survey:
    """Check start and goals for collisions, draw goal states where needed, and search first paths (guides) to them.

    Raises QueryError if the start or every goal is blocked, or if no goal has the straight approach that it requires.

    Parameters
    ----------
    trees : number of pairs of random trees that search for guides; None: none for a robot in the plane, else 10
    """
    space, in_plane = sampled_space(problem.model, problem.world), "plane" in problem.model.provides
    of_goals, _, of_trees, _ = np.random.default_rng(seed).spawn(4)
    start, (goals, goal_count) = _free_start(problem), _free_goals(problem, of_goals)
    connections = Connections(problem, space)
    goals, approaches = _approached(connections, problem, goals)
    pairs = (0 if in_plane else PAIRS) if trees is None else trees
    begin, ends = connections.rows(start)[0], connections.rows(goals)
    ends = np.where(np.isnan(ends), begin, ends)  # free coordinates take the start's values
    found = guides(connections, begin, ends, pairs, of_trees, spending) if pairs else []
    return Survey(problem, connections, start, goals, goal_count, pairs, found, seed, approaches)


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


def _approached(connections: Connections, problem: Problem, goals: States) -> tuple[States, tuple[FloatArray, ...]]:
    """Return the states (G,) at which straight approaches to goals begin, and the rows that follow each.

    Goals with an approach that is impossible or collides are left out. Raises QueryError if none remains, or if the
    problem has a tour.
    """
    every = problem.target.alternatives()
    if not any(each.straight is not None for each in every):
        return goals, ()
    law = problem.model.laws.get(REACH)
    if law is None or not law.varies <= set(problem.model.joints):
        raise QueryError(
            f"{problem.model.name} cannot approach a goal along a line: only an arm can, alone or on a base. Leave "
            "approach out"
        )
    if problem.tour is not None:
        raise QueryError("the goal of a tour cannot have an approach; leave the approach or the tour out")
    begins, follow = list[FloatArray](), list[FloatArray]()
    left, reasons = np.ones(goals.size, dtype=bool), list[str]()
    given = connections.rows(goals)
    for each in sorted(every, key=lambda one: one.straight is not None):  # those without an approach come first
        there = np.flatnonzero(left & each.reached(problem.model, goals))
        if each.straight is None:
            left[there] = False
            begins += list(given[there])
            follow += [given[:0]] * there.size
            continue
        lines = each.straight.lines(problem.model, connections.space, problem.world, goals.take(there))
        found = [rows for rows in lines.rows if rows is not None]
        colliding = 0
        for index, rows in zip(there.tolist(), lines.rows, strict=True):
            if rows is not None and (connections.free(rows[:-1], rows[1:])).all():
                left[index] = False
                begins.append(rows[0])
                follow.append(rows[1:])
            colliding += rows is not None and bool(left[index])
        strayed, ends = int(lines.strayed.sum()), there.size - len(found) - int(lines.strayed.sum())
        reasons.append(
            f"the goal {each} cannot be approached like this: of its {there.size} free states, {ends} have no states "
            f"on the line within the joint limits, {strayed} none that motions join within the tolerances, and at "
            f"{colliding} the approach is blocked. Give a shorter distance, another axis or direction, or larger "
            "tolerances"
        )
    if not begins:
        raise QueryError(" ".join(reasons))
    return connections.states(np.array(begins)), tuple(follow)


def _state_text(values: Sequence[float | None]) -> str:
    """Return a state as text for messages, with "any" for a coordinate that may have any value."""
    return f"({', '.join('any' if value is None else f'{value:.3f}' for value in values)})"


def concatenated_states(space: StateSpace, parts: Sequence[States]) -> States:
    """Concatenate several arrays of states of a space."""
    return States(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in space.names})
