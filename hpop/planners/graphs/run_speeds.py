"""Graph for a robot with several speeds among people who move: each straight run has one speed, from rest to rest.

A plan among people must be executed punctually. A run at speed v with acceleration a is planned to stand for v/2a, to
drive its length L at v, and to stand for v/2a again. Its execution speeds up at once and needs L/v + v/a in all, which
is equally long; a run shorter than v²/a needs less and begins later. So the robot is never more than v²/8a from its
planned position, as with one speed (:mod:`hpop.models.execution`). A change between two speeds while driving has no
such execution: it is planned for longer than it takes.

State v of the inner graph is node v, at rest. For each of the model's k speeds there are two more layers of nodes: one
in which a run begins, and one in which it goes on. So a run has at least one move, and the robot waits at rest only.
From rest, a change of speed leads to the first of these layers, each move to the second, and a change back to rest.

Of several turn rates, each has its own arc for every turn, with its own duration: these arcs are parallel. A path is a
list of nodes, so it names a turn at a slower rate by a further node between its ends, the marker: the state in which
the turn ends, in a layer of this rate. No arc leads to a marker.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray, copied
from hpop.base.options import LEAST
from hpop.errors import ModelError
from hpop.models.speeds import checked_speeds, turns_text
from hpop.motions import Model, Motions, States, laws_of
from hpop.motions.laws import CHANGE, SPEED
from hpop.planners.graphs.arcs import MOVE, MotionChains
from hpop.planners.graphs.joined_ends import Ends
from hpop.planners.graphs.speed_joins import at_speed
from hpop.planners.graphs.state_graph import StateGraph
from hpop.planners.graphs.trajectory_graph import NO_MARKER, Stretches, unmarked

if TYPE_CHECKING:
    from hpop.problems.problem import Problem
    from hpop.world import World


def with_run_speeds(ends: Ends, model: Model) -> Ends:
    """Return the graph in which each straight run has one of the speeds of the model, for plans among moving people.

    Without several speeds or turn rates, or if the graph is not in the plane, it is the graph of its runs
    (:meth:`.TrajectoryGraph.with_runs`). Raises ModelError for several turn rates without speeds.
    """
    space, alone = ends.space, ends.space.states_alone
    if not (model.speed_classes or model.paces) or alone is None:
        return ends._replace(space=space.with_runs())
    runs = run_speed_graph(alone)
    layered = space.over_states(lambda _: runs)

    def moved(node: int) -> int:  # nodes that were added for ends come after those of all layers
        return node - alone.size + runs.size if node >= alone.size else node

    return Ends(layered, moved(ends.start), [moved(goal) for goal in ends.goals])


def run_speed_graph(states: StateGraph) -> StateGraph:
    """Return a graph of states in which each straight run has one of the speeds of the model.

    The given graph is returned if the model has one speed and one turn rate. Raises ModelError for several turn rates
    without speeds.
    """
    if not (states.model.speed_classes or states.model.paces):
        return states
    if not states.model.speed_classes:
        raise ModelError(
            f"the model {states.model.name!r} has paces, so among people who move it needs speed_classes; add one or "
            "more, and **speed_laws(speed_classes, acceleration) from hpop.models.speeds to its laws"
        )
    speeds = checked_speeds(states.model.speed_classes, LEAST)
    return RunSpeedGraph(states.model, states.world, states, speeds, spending=states.spending)


@dataclass(frozen=True, eq=False)
class RunSpeedGraph(StateGraph):
    """States of an inner graph at rest, and in two layers for each speed; see the text of this module.

    inner    graph of n states; node l n + v is state v in layer l: 0 at rest, then k in which runs begin, then k
             others, then one of markers for each slower turn rate
    speeds   (k,)  m/s, rising
    arrives  m/s, speed at which the robot comes to an added start, which is no state of the graph; there it stops
    """

    inner: StateGraph
    speeds: tuple[float, ...]
    arrives: float = 0.0

    @property
    def size(self) -> int:
        """Number of nodes."""
        return self.inner.size * (1 + 2 * len(self.speeds) + len(self.slower_turns))

    @property
    def slower_turns(self) -> tuple[Mapping[str, str], ...]:
        """For each slower turn rate, from slow: the kinds of motion that it replaces, such as {"turn": "turn_0.5"}."""
        return tuple(self.model.paces[:-1])

    @cached_property
    def _slower(self) -> dict[str, tuple[int, int]]:
        """For each slower kind of turn: the layer of its markers, and the index of the inner kind that it replaces."""
        known = self.inner.kinds
        return {
            slow: (layer, known.index(kind))
            for layer, pace in enumerate(self.slower_turns, 1 + 2 * len(self.speeds))
            for kind, slow in pace.items()
            if kind in known and slow not in known
        }

    def is_marker(self, nodes: IntArray) -> BoolArray:
        """Return a mask (N,): True for nodes that only say at which slower rate a path turns."""
        return np.asarray((nodes >= self.inner.size * (1 + 2 * len(self.speeds))) & (nodes < self.size))

    @cached_property
    def markers(self) -> IntArray | None:
        """Marker (m,) of each arc, NO_MARKER for arcs without one; None if there is only one turn rate."""
        if not self._slower:
            return None
        layers = [NO_MARKER] * (len(self.inner.kinds) + 1) + [layer for layer, _ in self._slower.values()]
        layer = np.array(layers)[self.arcs.kinds]
        return np.where(layer == NO_MARKER, NO_MARKER, layer * self.inner.size + self.arcs.heads)

    @property
    def words(self) -> str:
        """Description of the inner graph and the speeds, for certificates."""
        *some, last = (f"{speed:g}" for speed in self.speeds)
        speeds = f"{', '.join(some)} or {last}" if some else last
        return f"{self.inner.words}, each straight run at {speeds} m/s{turns_text(self.model)}"

    @property
    def options(self) -> dict[str, Any]:
        """Options that identify the inner graph, JSON-able."""
        return self.inner.options

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of the inner graph, and the number of speeds."""
        return {**self.inner.counts, "speeds": len(self.speeds)}

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions of the inner graph, then changes of speed, then slower turns."""
        return (*self.inner.kinds, CHANGE, *self._slower)

    def states(self, ids: IntArray) -> States:
        """Return the states (N,) at some nodes, without speeds."""
        return self.inner.states(ids % self.inner.size)

    def _speed_of(self, ids: IntArray) -> FloatArray:
        return np.array([0.0, *self.speeds, *self.speeds, *[0.0] * len(self.slower_turns)])[ids // self.inner.size]

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return which nodes (N,), also those of ends joined to the graph, are at rest."""
        return np.asarray((ids < self.inner.size) | (ids > self.size) | ((ids == self.size) & (self.arrives == 0.0)))

    def in_layer(self, states: IntArray, speeds: FloatArray) -> IntArray:
        """Return the nodes (N,) of a path, given by nodes (N,), whose layers are ignored, and speeds (N,), m/s.

        A node with a speed is in the layer in which runs begin if the node before it has the same state at rest;
        otherwise it is in the layer in which runs go on. A speed of -i means class i of the slower turns, from 1: the
        second of two such nodes is a marker, the first is at rest.
        """
        states, layers = states % self.inner.size, np.abs(speeds[:, None] - [0.0, *self.speeds]).argmin(axis=1)
        begins = np.append(False, (states[1:] == states[:-1]) & (layers[:-1] == 0))
        layers += len(self.speeds) * ((layers > 0) & ~begins)
        turned = 1 + np.flatnonzero((states[1:] != states[:-1]) & (speeds[1:] < 0) & (speeds[1:] == speeds[:-1]))
        layers[turned] = 2 * len(self.speeds) - speeds[turned]
        return np.asarray(states + self.inner.size * layers)

    def arriving_at(self, speed: float) -> RunSpeedGraph:
        """Return this graph for an added start, which is none of its states, where the robot comes at ``speed``, m/s.

        Paths begin with a change of speed from ``speed`` to rest.
        """
        return copied(self, arrives=speed)

    def costed_in(self, world: World) -> RunSpeedGraph:
        """Return a graph with the same arcs, whose costs are computed in another world; arcs are not checked again."""
        return copied(super().costed_in(world), inner=self.inner.costed_in(world))

    def reach(self, problem: Problem) -> float:
        """Return the distance, m, within which a start or goal off the graph is connected to states."""
        return self.inner.reach(problem)

    def cut_corners(self, tails: IntArray, kinds: IntArray, blocked: IntArray) -> BoolArray:
        """Return which arcs (N,) may not be used because states next to them are blocked."""
        return self.inner.cut_corners(tails % self.inner.size, kinds, blocked % self.inner.size)

    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the place of each node.

        A position has two places: one for the nodes at rest there, and one for those with a speed.
        """
        every = int(self.inner.places(np.arange(self.inner.size)).max(initial=-1)) + 1
        return np.asarray(self.inner.places(ids % self.inner.size) + every * ~self.at_rest(ids))

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Return the nodes at rest within ``radius``, m, of the position (x, y), m."""
        return self.inner.near(x, y, radius)

    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Return all collision-free motions of one kind: numbers of their first nodes, and of their last nodes."""
        n, k = self.inner.size, len(self.speeds)
        begins, goes_on = np.arange(1, 1 + k)[:, None] * n, np.arange(1 + k, 1 + 2 * k)[:, None] * n
        if kind == CHANGE:
            rest = np.tile(np.arange(n), k)
            ends = (np.arange(n) + begins).ravel(), (np.arange(n) + goes_on).ravel()
            return np.concatenate([rest, ends[1]]), np.concatenate([ends[0], rest])
        number = self._slower[kind][1] if kind in self._slower else self.inner.kinds.index(kind)
        tails, heads = self.inner.arcs.of(number)
        if number != MOVE:
            return tails, heads
        both = np.concatenate([tails + begins, tails + goes_on]).ravel()
        return both, np.concatenate([heads + goes_on, heads + goes_on]).ravel()

    def kinds_between(self, tails: IntArray, heads: IntArray) -> IntArray:
        """Return the kind (N,) of the motion from each tail (N,) to its head (N,), as an index into `kinds`."""
        n = self.inner.size
        kinds = self.inner.kinds_between(tails % n, heads % n)
        return np.where(self.at_rest(tails) == self.at_rest(heads), kinds, len(self.inner.kinds))

    def motions(self, kind: str, tails: IntArray, heads: IntArray) -> Motions:
        """Return the motions (M,) of one kind from nodes ``tails`` to ``heads``, angles in the shorter direction."""
        n = self.inner.size
        if kind == CHANGE:
            states, law = self.states(tails), self.model.laws[CHANGE]
            start, end = (at_speed(states, self._speed_of(ids)) for ids in (tails, heads))
            return Motions(self.world, self.model, law, start, end)
        if kind in self._slower:
            motions = self.inner.motions(self.inner.kinds[self._slower[kind][1]], tails, heads)
            return replace(motions, law=self.model.laws[kind])
        motions = self.inner.motions(kind, tails % n, heads % n)
        if SPEED not in laws_of(self.model)[kind].extra:
            return motions
        start, end = (at_speed(states, self._speed_of(tails)) for states in (motions.start, motions.end))
        return replace(motions, start=start, end=end)

    def driven(self, chains: MotionChains) -> MotionChains:
        """Return chains with their moves at the fastest speed, each between two changes of speed.

        Those from a start at which the robot arrives at a speed begin with a change to rest.
        """
        return self._chosen(chains, np.zeros(chains.tails.size, np.int64))

    def in_choices(self, chains: MotionChains) -> MotionChains:
        """Return chains as :meth:`driven`, once for each speed of their moves with each rate of their turns.

        A chain without moves has no choice of a speed, one without turns none of a rate. The fastest comes last.
        """
        laws, count = laws_of(self.model), len(self.speeds) * (1 + len(self.slower_turns))
        rows, choices = np.divmod(np.arange(chains.tails.size * count), count)
        choices = count - 1 - choices
        rates, speeds = np.divmod(choices, len(self.speeds))
        moves = chains.count([kind for kind in chains.kinds if SPEED in laws[kind].extra]) > 0
        turns = chains.count([kind for pace in self.slower_turns for kind in pace]) > 0
        offered = (moves[rows] | (speeds == 0)) & (turns[rows] | (rates == 0))
        return self._chosen(chains.take(rows[offered]), choices[offered])

    def _chosen(self, chains: MotionChains, choices: IntArray) -> MotionChains:
        """Return chains with changes of speed, each with one speed of its moves and one rate of its turns.

        choices  (C,)  number of the rate times the number of speeds, plus number of the speed, both from the fastest
        """
        laws, rest, (rates, speeds) = laws_of(self.model), np.zeros(choices.size), np.divmod(choices, len(self.speeds))
        chosen = np.array(self.speeds)[::-1][speeds]
        kinds, corners, present = list[str](), [at_speed(chains.corners[0], rest)], list[BoolArray]()
        if self.arrives:
            slowed = chains.tails == self.size  # the start is the first node after all states
            corners.insert(0, at_speed(chains.corners[0], np.where(slowed, self.arrives, 0.0)))
            kinds.append(CHANGE)
            present.append(slowed)
        for kind, end, some in zip(chains.kinds, chains.corners[1:], chains.present, strict=True):
            if SPEED in laws[kind].extra:
                speed = np.where(some, chosen, 0.0)
                kinds += [CHANGE, kind, CHANGE]
                corners += [at_speed(corners[-1], speed), at_speed(end, speed), at_speed(end, rest)]
                present += [some, some, some]
                continue
            ends = at_speed(end, rest).__dict__
            for number, pace in enumerate(reversed(self.slower_turns), 1):
                if pace.get(kind) in self._slower:
                    slow, before = some & (rates == number), corners[-1].__dict__
                    kinds.append(pace[kind])
                    present.append(slow)
                    corners.append(States(**{n: np.where(slow, column, before[n]) for n, column in ends.items()}))
                    some = some & ~slow
            kinds.append(kind)
            present.append(some)
            corners.append(States(**ends))
        return replace(chains, kinds=tuple(kinds), corners=tuple(corners), present=tuple(present), choices=choices)

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states, with speeds, and the motions of n trajectories, not yet checked for impossible motions.

        ids    (N,)  nodes of all paths, one path after another; a marker says how the path turns to the node after it
        sizes  (n,)  number of nodes of each path
        """
        ids, sizes, markers = unmarked(ids, sizes, self.is_marker(ids))
        layers = np.where(markers == NO_MARKER, NO_MARKER, markers // self.inner.size)
        kinds = np.zeros(ids.size, np.int64)
        kinds[1:] = self.kinds_between(ids[:-1], ids[1:])
        for number, (layer, replaced) in enumerate(self._slower.values(), len(self.inner.kinds) + 1):
            kinds[(layers == layer) & (kinds == replaced)] = number
        laws: Sequence[Any] = [laws_of(self.model)[kind] for kind in self.kinds]
        return Stretches.through(self.model.space, laws, at_speed(self.states(ids), self._speed_of(ids)), kinds, sizes)

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from start to goals, as text: that of the inner graph."""
        return self.inner.what_separates(start % self.inner.size, [goal % self.inner.size for goal in goals])
