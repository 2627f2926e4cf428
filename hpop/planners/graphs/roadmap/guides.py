"""Guides: collision-free paths found quickly by random trees, near which a roadmap then draws samples.

For robots with many joints, hardly any uniform sample lies near a useful path. Two random trees, one from the start and
one from the goals, find a path quickly: RRT-Connect (Kuffner and LaValle 2000, doi 10.1109/ROBOT.2000.844730). A branch
is a chain of motions by which the model connects two states. Several pairs of trees grow at the same time, so that
their collision checks run in one batch.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.base.math import wrap
from hpop.motions import Motions, States, StateSpace
from hpop.motions.bodies import collision_of
from hpop.planners.graphs.arcs import REACHED
from hpop.planners.spending import Spending

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

STEPS = 1500  # largest number of growth steps
PATIENCE = 10  # once a pair of trees has met, the others may take at most this multiple of its steps
SHARES = (1.0, 0.3, 0.1, 0.03)  # shares of the distance to a target that are tried; the largest free one is taken
HALVINGS = 2  # how often states are added in the middle of a guide's motions, to find more shortcuts
GROWN = "random trees searched for first paths"


class Guide(NamedTuple):
    """Collision-free path from the start to a goal, near which samples are drawn.

    rows  (n, k)  its states; column j is coordinate j of the model's space
    goal          index of the goal
    """

    rows: FloatArray
    goal: int


class Connections:
    """Distances between states, and collision checks of the motions that connect them, for a problem's robot and world.

    States are given as rows (n, k) of an array, with the coordinates of the space as columns.
    """

    def __init__(self, problem: Problem, space: StateSpace) -> None:
        """Prepare the collision checks; ``space`` defines the columns of states, and distances."""
        self.world, self.model, self.space = problem.world, problem.model, space
        self.collision = collision_of(problem.model, problem.world)
        self.weights = np.array(space.weights)
        self.turns = np.array([name in space.turning for name in space.names])

    def states(self, rows: FloatArray) -> States:
        """Convert rows (n, k) to states."""
        return States(**dict(zip(self.space.names, np.ascontiguousarray(rows.T), strict=True)))

    def rows(self, states: States) -> FloatArray:
        """Convert states to rows (n, k)."""
        return np.stack([np.asarray(getattr(states, name), float) for name in self.space.names], axis=-1)

    def projected(self, rows: FloatArray) -> FloatArray:
        """Return rows of states (n, k), moved so that they fulfil the robot's constraint, if it has one."""
        project = self.collision.projected
        return rows if project is None else self.rows(project(self.states(rows)))

    def differences(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the differences b - a of rows of states; angles differ by half a turn at most."""
        differences = b - a
        differences[..., self.turns] = wrap(differences[..., self.turns])
        return differences

    def distances(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the distances between rows of states a and b, by the metric of the space."""
        return np.asarray(np.linalg.norm(self.weights * self.differences(a, b), axis=-1))

    def free(self, a: FloatArray, b: FloatArray) -> BoolArray:
        """Return whether the robot can drive from each state in a (n, k) to that in b (n, k) without a collision.

        The model connects the two states by a chain of motions; it must also end in the state of b.
        """
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
    """Several random trees in common arrays, all of which begin at the start, or all at the goals.

    Each tree belongs to a pair: one tree from the start and one from the goals, which grow towards each other. An
    object of this class has one of the two trees of every pair.

    rows    (n, k)  states of all trees
    parent  (n,)    index of the parent of each state, -1 for a root
    pair    (n,)    number of the pair to which each state's tree belongs
    """

    def __init__(self, roots: FloatArray, pairs: int, connections: Connections, *, onward: bool) -> None:
        """Create one tree for each of ``pairs`` pairs; each has all the states ``roots`` (r, k) as roots.

        onward  True for trees from the start, along which the robot drives away from the roots; False for trees from
                the goals, along which it drives towards them
        """
        self.connections, self.onward = connections, onward
        self.rows = np.tile(roots, (pairs, 1))
        self.pair = np.repeat(np.arange(pairs), len(roots))
        self.parent = np.full(len(self.rows), -1)
        self.roots = len(roots)

    def grow(self, pairs: IntArray, targets: FloatArray) -> tuple[IntArray, BoolArray]:
        """Add one state to the trees of some pairs (p,), each as far towards a target (p, k) as the way is free.

        The branch begins at the state of the tree that is nearest to the target. Of the way to the target, it covers
        the largest of SHARES that has no collision. Returns two arrays (p,): the index of each new state, -1 if there
        is none, and whether the new state is the target.
        """
        distances = self.connections.distances(self.rows[None], targets[:, None])
        near = np.where(self.pair == pairs[:, None], distances, np.inf).argmin(axis=1)
        begin = np.repeat(self.rows[near], len(SHARES), axis=0)
        steps = np.tile(np.array(SHARES), pairs.size)[:, None] * self.connections.differences(
            begin, np.repeat(targets, len(SHARES), axis=0)
        )
        ends = begin + steps
        short = np.tile(np.array(SHARES) < 1.0, pairs.size)
        ends[short] = self.connections.projected(ends[short])
        free = self.connections.free(begin, ends) if self.onward else self.connections.free(ends, begin)
        free = free.reshape(pairs.size, len(SHARES))
        grown, first = free.any(axis=1), free.argmax(axis=1)
        new = np.full(pairs.size, -1)
        new[grown] = len(self.rows) + np.arange(np.count_nonzero(grown))
        self.rows = np.concatenate([self.rows, ends.reshape(pairs.size, len(SHARES), -1)[grown, first[grown]]])
        self.parent = np.concatenate([self.parent, near[grown]])
        self.pair = np.concatenate([self.pair, pairs[grown]])
        return new, grown & (first == 0)

    def branch(self, index: int) -> list[int]:
        """Return the indices of the states on the branch from a state, given by its index, back to its root."""
        branch = [index]
        while self.parent[branch[-1]] >= 0:
            branch.append(int(self.parent[branch[-1]]))
        return branch


def guides(
    connections: Connections,
    start: FloatArray,
    goals: FloatArray,
    pairs: int,
    rng: np.random.Generator,
    spend: Spending,
) -> list[Guide]:
    """Search collision-free paths (guides) from the start (k,) to goals (G, k) with ``pairs`` pairs of random trees.

    Returns at most one guide for each pair, made shorter by shortcuts; the shortest guide comes first. Pairs that take
    much longer than the first successful pair are abandoned, and all pairs stop after STEPS steps.
    """
    trees = (
        Tree(start[None], pairs, connections, onward=True),
        Tree(goals, pairs, connections, onward=False),
    )
    waiting, found_guides, last = np.arange(pairs), list[Guide](), STEPS
    for step in range(STEPS):
        spend.check(GROWN)
        if step >= last or not waiting.size:
            break
        growing, opposite = trees[step % 2], trees[1 - step % 2]
        targets = connections.projected(connections.rows(connections.space.sample(rng, waiting.size)))
        new, _ = growing.grow(waiting, targets)
        grown = np.flatnonzero(new >= 0)
        if not grown.size:
            continue
        met, meets = opposite.grow(waiting[grown], growing.rows[new[grown]])
        for index in np.flatnonzero(meets):
            ends = {growing: int(new[grown[index]]), opposite: int(met[index])}
            there, back = trees[0].branch(ends[trees[0]])[::-1], trees[1].branch(ends[trees[1]])
            rows = np.concatenate([trees[0].rows[there], trees[1].rows[back[1:]]])
            found_guides.append(Guide(rows, back[-1] % len(goals)))
        if meets.any():
            waiting = np.delete(waiting, grown[meets])
            last = min(last, PATIENCE * (step + 1) + len(SHARES))
    for _ in range(HALVINGS):
        found_guides = shorten(
            [with_midpoints(guide, connections) for guide in shorten(found_guides, connections)], connections
        )
    return sorted(found_guides, key=lambda guide: length(guide, connections))


def length(guide: Guide, connections: Connections) -> float:
    """Return the length of a guide: the sum of the distances between its states, by the metric of the space."""
    return float(connections.distances(guide.rows[:-1], guide.rows[1:]).sum())


def with_midpoints(guide: Guide, connections: Connections) -> Guide:
    """Return a guide with a state added in the middle of each motion."""
    begin = guide.rows[:-1]
    rows = np.repeat(guide.rows, 2, axis=0)[:-1]
    rows[1::2] = begin + 0.5 * connections.differences(begin, guide.rows[1:])
    return guide._replace(rows=rows)


def shorten(found_guides: list[Guide], connections: Connections) -> list[Guide]:
    """Shorten guides by shortcuts: return, for each, the shortest collision-free path that skips some of its states.

    To save time, a motion is checked for collisions only when a shortest path uses it.
    """
    between = [connections.distances(guide.rows[:, None], guide.rows[None]) for guide in found_guides]
    checked = [np.zeros(table.shape, np.bool_) for table in between]
    while True:
        paths = [_shortest(table) for table in between]
        pairs = [
            (number, i, j) for number, path in enumerate(paths) for i, j in pairwise(path) if not checked[number][i, j]
        ]
        if not pairs:
            return [guide._replace(rows=guide.rows[path]) for guide, path in zip(found_guides, paths, strict=True)]
        a, b = (np.stack([found_guides[pair[0]].rows[pair[side]] for pair in pairs]) for side in (1, 2))
        for (number, i, j), free in zip(pairs, connections.free(a, b).tolist(), strict=True):
            checked[number][i, j] = True
            if not free:
                between[number][i, j] = np.inf


def _shortest(table: FloatArray) -> list[int]:
    """Return the shortest path from the first to the last of n states, as indices, which ascend.

    table  (n, n)  distance between each two states, inf if the motion between them collides
    """
    cost, before = np.full(len(table), np.inf), np.zeros(len(table), np.int64)
    cost[0] = 0.0
    for j in range(1, len(table)):
        through = cost[:j] + table[:j, j]
        before[j] = through.argmin()
        cost[j] = through[before[j]]
    path = [len(table) - 1]
    while path[-1]:
        path.append(int(before[path[-1]]))
    return path[::-1]
