"""Joins of start and goals in a graph of speeds: a copy of each for every speed of its moves and rate of its turns.

A join connects an added node (start, goal or a state of a stop) to a state of the graph. It is a chain of motions such
as turn, move, turn (:class:`.arcs.MotionChains`). A class is one of the model's speeds. Layer 0 is rest, and layer i is
class i (:mod:`.speeds`). A copy of a join is its chain of motions with all moves in one class, all turns at one rate,
and the changes of speed that these moves need.

In paths of the graph, one direct change of speed replaces several at one state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.motions import Model, Motions, States, laws_of
from hpop.motions.laws import CHANGE, SPEED
from hpop.planners.graphs.trajectory_graph import TrajectoryGraph
from hpop.planners.objectives import quantised

if TYPE_CHECKING:
    from hpop.planners.graphs.speeds import SpeedGraph


class ChainStep(NamedTuple):
    """One motion that several copies of joins make at the same place in their chains.

    rows   (r,)  indices of these copies
    kind   index of its kind in ``kinds`` of the graph of speeds
    start  states (r,) in which it begins, with speeds
    end    states (r,) in which it ends, with speeds
    """

    rows: IntArray
    kind: int
    start: States
    end: States


class Waypoints(NamedTuple):
    """States at the ends of all motions of the copies of joins (w,), copy by copy.

    pointers  (c + 1,)  the states of copy i are pointers[i] : pointers[i + 1]
    states    (w,)  with speeds
    kinds     (w,)  kind of the motion that ends there, as in :class:`ChainStep`
    turns     (w,)  rad  by name of each turning column: its change in that motion
    """

    pointers: IntArray
    states: States
    kinds: IntArray
    turns: dict[str, FloatArray]


@dataclass(frozen=True, eq=False)
class JoinCopies:
    """Copies (c,) of the joins of a graph: one for each speed of a join's moves, with each rate of its turns.

    A join without moves is not copied for speeds, one without turns not for turn rates.

    A join is an arc that connects a start, goal or stop to the graph. A copy includes the changes of speed between its
    motions. It begins or ends at rest at a start, a goal or an added state of a stop. At a state of the graph, it
    begins at the speed of its first motion, or ends at that of its last.

    inner   graph of states, with joins or without
    model   model with speed classes
    speeds  m/s, rising: the classes
    kinds   kinds of motions of the graph of speeds: those of the inner graph, changes of speed, and slower turns
    """

    inner: TrajectoryGraph
    model: Model
    speeds: tuple[float, ...]
    kinds: tuple[str, ...]

    def __len__(self) -> int:
        return self._copies[0].size

    def _has_speed(self, kind: str) -> bool:
        return SPEED in laws_of(self.model)[kind].extra

    @cached_property
    def _copies(self) -> tuple[IntArray, IntArray]:
        """For each copy (c,): the index of its join, and a number for its turn rate and speed, both counted from slow.

        The number is the index of the turn rate, times the number of speeds, plus the index of the speed.
        """
        joins = self.inner.joins
        if joins is None:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        moves, turns = np.zeros((2, joins.tails.size), dtype=np.bool_)
        for kind, present in zip(joins.kinds, joins.present, strict=True):
            moves |= present & self._has_speed(kind)
            turns |= present & any(kind in pace for pace in self.model.paces)
        row, of_turns, speed = np.indices((moves.size, len(self._paces), len(self.speeds))).reshape(3, -1)
        offered = (moves[row] | (speed == len(self.speeds) - 1)) & (turns[row] | (of_turns == len(self._paces) - 1))
        return row[offered], (of_turns * len(self.speeds) + speed)[offered]

    @property
    def _paces(self) -> Sequence[Mapping[str, str]]:
        return self.model.paces or ({},)

    @property
    def rows(self) -> IntArray:
        """Index (c,) of the join that each copy repeats."""
        return self._copies[0]

    @property
    def tails(self) -> IntArray:
        """Node (c,) of the inner graph at which each copy begins."""
        return self._copies[0] if self.inner.joins is None else self.inner.joins.tails[self._copies[0]]

    @property
    def heads(self) -> IntArray:
        """Node (c,) of the inner graph at which each copy ends."""
        return self._copies[0] if self.inner.joins is None else self.inner.joins.heads[self._copies[0]]

    @property
    def begins(self) -> IntArray:
        """Layer (speed class, 0 for rest) in which each copy (c,) begins."""
        return self._chains[0]

    @property
    def ends(self) -> IntArray:
        """Layer (speed class, 0 for rest) in which each copy (c,) ends."""
        return self._chains[1]

    @cached_property
    def _chains(self) -> tuple[IntArray, IntArray, tuple[ChainStep, ...]]:
        """Layers in which the copies (c,) begin and end, as two arrays, and all their motions, in order of time."""
        (rows, classes), joins, alone = self._copies, self.inner.joins, self.inner.states_alone
        if joins is None or alone is None:
            return rows, classes, ()
        of_turns, classes = classes // len(self.speeds), classes % len(self.speeds) + 1
        speed_of, change = np.array([0.0, *self.speeds]), len(self.inner.kinds)
        at_tail, at_head = self.tails >= alone.size, self.heads >= alone.size
        begun, steps = np.zeros(rows.size, dtype=np.bool_), list[ChainStep]()
        begins = layer = np.zeros(rows.size, np.int64)

        def add(kind: int, some: BoolArray, corners: Sequence[States], layers: Sequence[IntArray]) -> None:
            own = np.flatnonzero(some)
            if own.size:
                start, end = (
                    at_speed(states.take(rows[own]), speed_of[at[own]])
                    for states, at in zip(corners, layers, strict=True)
                )
                steps.append(ChainStep(own, kind, start, end))

        for i, kind in enumerate(joins.kinds):
            present, before, after = joins.present[i][rows], joins.corners[i], joins.corners[i + 1]
            needed = np.where(present, classes if self._has_speed(kind) else 0, layer)
            first = present & ~begun & ~at_tail
            begins, layer = np.where(first, needed, begins), np.where(first, needed, layer)
            add(change, layer != needed, (before, before), (layer, needed))
            for number, pace in enumerate(self._paces):
                own = present & (of_turns == number)
                add(self.kinds.index(pace.get(kind, kind)), own, (before, after), (needed, needed))
            layer, begun = needed, begun | present
        ends = np.where(at_head, 0, layer)
        add(change, layer != ends, (joins.corners[-1], joins.corners[-1]), (layer, ends))
        return begins, ends, tuple(steps)

    def _kind(self, step: ChainStep) -> str:
        return self.kinds[step.kind]

    @property
    def turned(self) -> NDArray[np.int8]:
        """Number (c,) of motions in place in each copy; a change to a class counts one more for each faster class."""
        turned, speeds = np.zeros(len(self), np.int8), np.array(self.speeds)
        for step in self._chains[2]:
            turned[step.rows] += np.int8("x" not in laws_of(self.model)[self._kind(step)].varies)
            if self._kind(step) == CHANGE:
                faster = len(speeds) - np.searchsorted(speeds, step.end.speed, side="right")
                turned[step.rows] += np.where(step.end.speed > 0.0, faster, 0).astype(np.int8)
        return turned + (len(self._paces) - 1 - self._copies[1] // len(speeds)).astype(np.int8)

    def costs(self, criteria: Sequence[Criterion]) -> IntArray:
        """Return the costs (c, k) of the copies in quanta of the criteria, rounded up once for each copy."""
        costs, laws = np.zeros((len(self), len(criteria))), laws_of(self.model)
        for step in self._chains[2]:
            motions = Motions(self.inner.world, self.model, laws[self._kind(step)], step.start, step.end)
            for j, criterion in enumerate(criteria):
                paid, worst = motion_costs(criterion, motions), criterion.aggregate == "max"
                known = costs[step.rows, j]
                costs[step.rows, j] = np.maximum(known, paid) if worst else known + paid
        return np.stack([quantised(costs[:, j], criterion) for j, criterion in enumerate(criteria)], axis=1)

    @cached_property
    def waypoints(self) -> Waypoints:
        """States at the ends of the motions of all copies."""
        steps, space = self._chains[2], self.model.space
        copy = np.concatenate([np.zeros(0, np.int64), *(step.rows for step in steps)])
        order = np.argsort(copy, kind="stable")

        def joined(columns: list[FloatArray]) -> FloatArray:
            return np.concatenate([np.zeros(0), *columns])[order]

        states = {name: joined([getattr(step.end, name) for step in steps]) for name in (*space.names, SPEED)}
        turns = {
            name: joined([getattr(step.end, name) - getattr(step.start, name) for step in steps])
            for name in space.turning
        }
        kinds = np.concatenate([np.zeros(0, np.int64), *(np.full(step.rows.size, step.kind) for step in steps)])
        pointers = np.append(np.zeros(1, np.int64), np.cumsum(np.bincount(copy, minlength=len(self))))
        return Waypoints(pointers, States(**states), kinds[order], turns)


def at_speed(states: States, speed: float | FloatArray) -> States:
    """Return states (N,) with a further column, the speed in m/s: one for all, or one for each (N,)."""
    return States(**states.__dict__ | {SPEED: np.full(states.size, speed)})


SAME = 1e-9  # relative difference of equal costs: rounding


def needless_nodes(space: SpeedGraph, ids: IntArray, sizes: IntArray) -> BoolArray:
    """Return a mask of the nodes (N,) of paths that can be left out, since one change of speed replaces several.

    A path may change from rest to a fast class, or back, by way of slower classes at one state. One direct change
    replaces these changes if it costs as much in each criterion. Also left out are nodes to which a free change leads,
    to or from a class of turns.

    ids    (N,)  nodes of all paths, one path after another
    sizes  (n,)  number of nodes of each path
    """
    layer, joins = ids % space.layers, space.is_join(ids)
    turning = ~joins & (layer > len(space.speeds))
    layer[turning] = 0  # turns are at rest
    same = (np.diff(ids // space.layers) == 0) & ~(joins[1:] | joins[:-1])  # a change of speed
    same[np.cumsum(sizes)[:-1] - 1] = False  # not from one path to the next
    rises, falls = same & (np.diff(layer) > 0), same & (np.diff(layer) < 0)
    begins, middle, ends = layer[:-2], layer[1:-1], layer[2:]
    upwards = _is_one_change(space, ids[1:-1], rises[:-1] & rises[1:], 0 * begins, middle, ends)
    downwards = _is_one_change(space, ids[1:-1], falls[:-1] & falls[1:], begins, middle, 0 * ends)
    passed = np.zeros(ids.size, dtype=np.bool_)
    for _ in range(len(space.speeds) - 1):  # from rest onwards, and towards rest
        at_rest = (layer == 0) | passed
        passed[1:-1] |= at_rest[:-2] & upwards | at_rest[2:] & downwards
    passed[1:] |= same & (turning[1:] != turning[:-1])
    return passed


def kinds_into(space: SpeedGraph, ids: IntArray, rows: IntArray) -> IntArray:
    """Return the kind (p,) of the motion that leads to each of p nodes of paths; any kind for first nodes.

    ids   (N,)  nodes of all paths, one path after another
    rows  (p,)  indices of the p nodes in ``ids``
    """
    state, layer = space.states_of(ids), ids[rows] % space.layers
    before, now = state[np.maximum(rows - 1, 0)], state[rows]
    kinds = np.full(rows.size, len(space.inner.kinds))
    moved = (before != now) & (before < space.alone.size) & (now < space.alone.size)
    kinds[moved] = space.alone.kinds_between(before[moved], now[moved])
    for number, pace in enumerate(space.slower_turns, 1 + len(space.speeds)):
        own = [space.kinds.index(pace.get(kind, kind)) for kind in space.kinds]
        kinds = np.where(layer == number, np.array(own)[kinds], kinds)
    return kinds


def _is_one_change(space: SpeedGraph, nodes: IntArray, some: BoolArray, *layers: IntArray) -> BoolArray:
    """Return a mask of nodes (n,) where one change from the first to the last of three layers replaces two changes.

    It does so if it costs as much as the two changes, by way of the second layer, in each criterion. Only nodes in the
    mask ``some`` are checked; for others the result is False.
    """
    result, own = some.copy(), np.flatnonzero(some)
    if not own.size:
        return result
    states, law = space.inner.states(nodes[own] // space.layers), laws_of(space.model)[CHANGE]
    at = [at_speed(states, space.speed_of[layer[own]]) for layer in layers]
    whole, *parts = (Motions(space.world, space.model, law, at[i], at[j]) for i, j in ((0, 2), (0, 1), (1, 2)))
    for criterion in space.criteria:
        paid = [motion_costs(criterion, part) for part in parts]
        by_way = np.maximum(*paid) if criterion.aggregate == "max" else sum(paid)
        result[own] &= np.isclose(motion_costs(criterion, whole), by_way, rtol=SAME, atol=SAME * criterion.quantum)
    return result
