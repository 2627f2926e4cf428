"""Guides: ways through free space, found by random trees, near which a roadmap takes samples.

In the space of many joints next to no sample that is drawn uniformly lies where a way is. Two trees, from the start and
from the goals, find one soon: RRT-Connect (Kuffner and LaValle 2000, doi 10.1109/ROBOT.2000.844730), here on whatever
chains of motions the model connects states by. Several pairs of trees grow side by side, so that all that they ask at a
step is asked at once.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.motions import Motions, States, StateSpace
from hpop.planners.graphs.arcs import REACHED
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

STEPS = 1500  # of trees that find nothing
PATIENCE = 10  # trees may take so many times the steps of the first pair that met
SHARES = (1.0, 0.3, 0.1, 0.03)  # of the way towards a target: the largest that is free is taken
HALVINGS = 2  # of the motions of a guide, each followed by shortcuts
GROWN = "ways were sought for samples to lie near"


class Guide(NamedTuple):
    """A way from the start to a goal, free all along.

    rows  (n, k)  states, by the columns of the space
    goal          its place among the goals
    """

    rows: FloatArray
    goal: int


class Connections:
    """What leads from states to others, and how far apart they are: rows (n, k) are states by the space's columns."""

    def __init__(self, problem: Problem, space: StateSpace) -> None:
        """Of a problem's model in its world; ``space`` is where its states are drawn."""
        self.world, self.model, self.space = problem.world, problem.model, space
        self.collision = problem.model.collision(problem.world)
        self.weights = np.array(space.weights)
        self.turns = np.array([name in space.turning for name in space.names])

    def states(self, rows: FloatArray) -> States:
        """Rows as states."""
        return States(**dict(zip(self.space.names, np.ascontiguousarray(rows.T), strict=True)))

    def rows(self, states: States) -> FloatArray:
        """States as rows."""
        return np.stack([np.asarray(getattr(states, name), float) for name in self.space.names], axis=-1)

    def differences(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """What is to be added to rows a for b, the shorter way round."""
        found = b - a
        found[..., self.turns] = wrap(found[..., self.turns])
        return found

    def apart(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Distances by the metric of the space."""
        return np.asarray(np.linalg.norm(self.weights * self.differences(a, b), axis=-1))

    def free(self, a: FloatArray, b: FloatArray) -> BoolArray:
        """Whether the chain from each row a to b is free, and reaches it."""
        at, to = self.states(a), self.states(b)
        free = np.ones(len(a), np.bool_)
        for kind, end, present in self.model.connect(at, to):
            rows = np.flatnonzero(present & free)
            if rows.size:
                motions = Motions(self.world, self.model, self.model.laws[kind], at.take(rows), end.take(rows))
                free[rows] &= self.collision.motions_free(motions)
            at = end
        return free & (np.abs(self.differences(self.rows(at), b)) <= REACHED).all(axis=1)


class Tree:
    """Trees of several pairs, all from the start or all from the goals, in the same columns.

    rows    (n, k)  states
    parent  (n,)    place of each one's parent, -1 of a root
    pair    (n,)    which pair each belongs to
    """

    def __init__(self, roots: FloatArray, pairs: int, connections: Connections, *, onward: bool) -> None:
        """Each with all the roots; ``onward`` says that motions lead away from these."""
        self.connections, self.onward = connections, onward
        self.rows = np.tile(roots, (pairs, 1))
        self.pair = np.repeat(np.arange(pairs), len(roots))
        self.parent = np.full(len(self.rows), -1)
        self.roots = len(roots)

    def grow(self, pairs: IntArray, targets: FloatArray) -> tuple[IntArray, BoolArray]:
        """From its nearest state each tree of some pairs (p,) grows towards a target (p, k), as far as the way is free.

        Returns the new states (p,), -1 where there is none, and whether they are the targets.
        """
        apart = self.connections.apart(self.rows[None], targets[:, None])
        near = np.where(self.pair == pairs[:, None], apart, np.inf).argmin(axis=1)
        begin = np.repeat(self.rows[near], len(SHARES), axis=0)
        steps = np.tile(np.array(SHARES), pairs.size)[:, None] * self.connections.differences(
            begin, np.repeat(targets, len(SHARES), axis=0)
        )
        ends = begin + steps
        free = self.connections.free(begin, ends) if self.onward else self.connections.free(ends, begin)
        free = free.reshape(pairs.size, len(SHARES))
        grown, first = free.any(axis=1), free.argmax(axis=1)
        found = np.full(pairs.size, -1)
        found[grown] = len(self.rows) + np.arange(np.count_nonzero(grown))
        self.rows = np.concatenate([self.rows, ends.reshape(pairs.size, len(SHARES), -1)[grown, first[grown]]])
        self.parent = np.concatenate([self.parent, near[grown]])
        self.pair = np.concatenate([self.pair, pairs[grown]])
        return found, grown & (first == 0)

    def branch(self, place: int) -> list[int]:
        """Places from a state to its root."""
        found = [place]
        while self.parent[found[-1]] >= 0:
            found.append(int(self.parent[found[-1]]))
        return found


def guides(
    connections: Connections,
    start: FloatArray,
    goals: FloatArray,
    pairs: int,
    rng: np.random.Generator,
    spend: Spending,
) -> list[Guide]:
    """The ways that so many pairs of trees find from the start (k,) to goals (G, k), the shortest first.

    Trees that take much longer than the first pair that met are given up, and all after STEPS steps.
    """
    trees = (
        Tree(start[None], pairs, connections, onward=True),
        Tree(goals, pairs, connections, onward=False),
    )
    waiting, found, last = np.arange(pairs), list[Guide](), STEPS
    for step in range(STEPS):
        spend.check(GROWN)
        if step >= last or not waiting.size:
            break
        one, other = trees[step % 2], trees[1 - step % 2]
        targets = connections.rows(connections.space.sample(rng, waiting.size))
        new, _ = one.grow(waiting, targets)
        grown = np.flatnonzero(new >= 0)
        if not grown.size:
            continue
        met, meets = other.grow(waiting[grown], one.rows[new[grown]])
        for place in np.flatnonzero(meets):
            ends = {one: int(new[grown[place]]), other: int(met[place])}
            there, back = trees[0].branch(ends[trees[0]])[::-1], trees[1].branch(ends[trees[1]])
            rows = np.concatenate([trees[0].rows[there], trees[1].rows[back[1:]]])
            found.append(Guide(rows, back[-1] % len(goals)))
        if meets.any():
            waiting = np.delete(waiting, grown[meets])
            last = min(last, PATIENCE * (step + 1) + len(SHARES))
    for _ in range(HALVINGS):
        found = shortened([halved(guide, connections) for guide in shortened(found, connections)], connections)
    return sorted(found, key=lambda guide: length(guide, connections))


def length(guide: Guide, connections: Connections) -> float:
    """Of a guide, by the metric of the space."""
    return float(connections.apart(guide.rows[:-1], guide.rows[1:]).sum())


def halved(guide: Guide, connections: Connections) -> Guide:
    """The guide, and the state in the middle of each two."""
    begin = guide.rows[:-1]
    rows = np.repeat(guide.rows, 2, axis=0)[:-1]
    rows[1::2] = begin + 0.5 * connections.differences(begin, guide.rows[1:])
    return guide._replace(rows=rows)


def shortened(found: list[Guide], connections: Connections) -> list[Guide]:
    """The shortest ways through states of each guide, in their order, whatever others they leave out.

    Whether a motion is free is asked only where a shortest way would take it.
    """
    between = [connections.apart(guide.rows[:, None], guide.rows[None]) for guide in found]
    known = [np.zeros(table.shape, np.bool_) for table in between]
    while True:
        ways = [_shortest(table) for table in between]
        asked = [[(i, j) for i, j in pairwise(way) if not table[i, j]] for way, table in zip(ways, known, strict=True)]
        pairs = [(number, i, j) for number, several in enumerate(asked) for i, j in several]
        if not pairs:
            return [guide._replace(rows=guide.rows[way]) for guide, way in zip(found, ways, strict=True)]
        a, b = (np.stack([found[pair[0]].rows[pair[side]] for pair in pairs]) for side in (1, 2))
        for (number, i, j), free in zip(pairs, connections.free(a, b).tolist(), strict=True):
            known[number][i, j] = True
            if not free:
                between[number][i, j] = np.inf


def _shortest(table: FloatArray) -> list[int]:
    """The shortest way from the first to the last through a table (n, n) of distances, onward alone."""
    cost, before = np.full(len(table), np.inf), np.zeros(len(table), np.int64)
    cost[0] = 0.0
    for j in range(1, len(table)):
        through = cost[:j] + table[:j, j]
        before[j] = through.argmin()
        cost[j] = through[before[j]]
    way = [len(table) - 1]
    while way[-1]:
        way.append(int(before[way[-1]]))
    return way[::-1]
