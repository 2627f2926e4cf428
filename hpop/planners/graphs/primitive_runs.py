"""Graph of motion primitives for plans among moving people: the car drives runs from rest to rest.

A run goes in one direction. A plan among people must be executed punctually (:mod:`hpop.models.execution`), so a run at
speed v with acceleration a is planned to stand for v/2a, to drive at v, and to stand for v/2a again. Its execution
speeds up at once, and is never more than v²/8a from its planned position along the path.

State v of the lattice is node v, at rest, where the car may wait. In two more layers the car drives forwards or
backwards: a primitive leads from rest or from its own layer into its own layer, and a stop from there back to rest. The
shortest paths to goals begin and end at rest. Where they stop on the way, they stand for as long as stopping, steering
and starting take.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs
from hpop.models.ackermann.laws import STEERED, SteeredGeometry
from hpop.motions import HOLD, Motions, States, laws_of
from hpop.motions.laws import CLOCK
from hpop.planners.graphs.arcs import Arcs, MotionChains, blocks
from hpop.planners.graphs.state_graph import ARC, StateGraph
from hpop.planners.graphs.trajectory_graph import Stretches, aggregates
from hpop.planners.objectives import quantised
from hpop.search import Graph

if TYPE_CHECKING:
    from hpop.models.ackermann.model import Ackermann
    from hpop.planners.graphs.primitives import PrimitiveLattice
    from hpop.world import World

REST, FORWARDS, BACKWARDS = 0, 1, 2  # layers
STOP = -1  # instead of the number of a lattice arc
PIECES = 64  # work of an arc, as a multiple of the work for one motion


class Pauses(NamedTuple):
    """Times for which the car stands about the legs of C chains, so that it can stop and start again, s.

    before, after  (legs, C)  0 for legs that a chain skips
    """

    before: FloatArray
    after: FloatArray


@dataclass(frozen=True, eq=False)
class PrimitiveRuns(StateGraph):
    """Lattice of primitives on which the car drives runs from rest to rest; see the text of this module.

    inner  lattice of n states; node l n + v is state v in layer l: at rest, driving forwards, driving backwards
    """

    turns_in_place = False

    inner: PrimitiveLattice

    @property
    def size(self) -> int:
        """Number of nodes."""
        return 3 * self.inner.size

    @property
    def words(self) -> str:
        """Description of the lattice and its runs, for certificates."""
        return f"{self.inner.words}, each run in one direction from rest to rest"

    @property
    def options(self) -> dict[str, Any]:
        """Options that identify the lattice, JSON-able."""
        return self.inner.options

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of the lattice, by name."""
        return self.inner.counts

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of motions of the lattice."""
        return self.inner.kinds

    def states(self, ids: IntArray) -> States:
        """Return the states (N,) at some nodes."""
        return self.inner.states(ids % self.inner.size)

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return which nodes (N,) are in the layer of rest."""
        return np.asarray(ids < self.inner.size)

    def places(self, ids: IntArray) -> IntArray:
        """Return the number (N,) of the place of each node.

        A state at rest is a place of its own, since the car cannot turn in place. While the car drives, the nodes of a
        position share a place.
        """
        states = ids % self.inner.size
        return np.where(ids < self.inner.size, states, self.inner.size + self._positions[states])

    @cached_property
    def _positions(self) -> IntArray:
        """Number (n,) of the position of each state of the lattice."""
        cells = self.inner.cells
        of_cells = np.unique(cells[:, :2], axis=0, return_inverse=True)[1].ravel()
        others = np.arange(self.inner.size - len(cells)) + int(of_cells.max(initial=-1)) + 1
        return np.concatenate([of_cells, others])

    @property
    def bends(self) -> tuple[float, float]:
        """Largest curvature, 1/m, and largest change of the curvature per metre within a run, 1/m²."""
        car, known, step = cast("Ackermann", self.model), self.inner.primitives, self.inner.step
        curvature = max(known.curvature / step, 1.0 / car.radius)
        return curvature, np.inf if car.steering_rate is None else known.sharpness / step**2

    def _half(self, ways: IntArray) -> FloatArray:
        """Return the time (N,), s, that stopping takes longer than driving on, in directions (N,): 1 or -1."""
        car = cast("Ackermann", self.model)
        return np.where(ways > 0, car.speed, car.reverse_speed) / (2.0 * car.acceleration)

    # Arcs

    @cached_property
    def _listed(self) -> tuple[Arcs, IntArray, IntArray]:
        """All m arcs, the number (m,) of each one's arc in the lattice, or STOP, and its direction (m,): 1, -1 or 0."""
        arcs, n = self.inner.arcs, self.inner.size
        tails, heads = arcs.ends(slice(0, arcs.heads.size))
        ways = self.inner.directions(tails, heads)
        layers = np.where(ways > 0, FORWARDS, BACKWARDS)
        driven, joins = np.flatnonzero(ways != 0), np.flatnonzero(ways == 0)
        layer = layers[driven] * n
        stops = np.unique(heads[driven] + layer)
        parts = [
            (tails[driven], heads[driven] + layer, driven, ways[driven]),
            (tails[driven] + layer, heads[driven] + layer, driven, ways[driven]),
            (tails[joins], heads[joins], joins, 0 * joins),
            (stops, stops % n, 0 * stops + STOP, np.where(stops // n == FORWARDS, 1, -1)),
        ]
        all_tails, all_heads, own, of_way = (np.concatenate(column) for column in zip(*parts, strict=True))
        order = np.argsort(all_tails, kind="stable")
        return Arcs.sorted(self.size, [(all_tails, all_heads)]), own[order], of_way[order]

    @cached_property
    def arcs(self) -> Arcs:
        """All arcs, of which none stays in place by a turn."""
        return self._listed[0]

    def _ends(self, arcs: IntArray) -> tuple[IntArray, IntArray]:
        """Return the tails and the heads of some arcs (N,)."""
        tails = np.searchsorted(self.arcs.start, arcs, side="right") - 1
        return tails, self.arcs.heads[arcs].astype(np.int64)

    def _chains(self, arcs: IntArray) -> Iterator[tuple[IntArray, MotionChains, Pauses]]:
        """Yield positions, chains and pauses of some arcs (N,): first of primitives, then of paths to goals."""
        tails, heads = self._ends(arcs)
        _, own, ways = self._listed
        n = self.inner.size
        for rows in (np.flatnonzero((own[arcs] != STOP) & ((ways[arcs] == 0) == joins)) for joins in (False, True)):
            chains = self.inner.chains(tails[rows] % n, heads[rows] % n)
            way = ways[arcs[rows]]
            if (way == 0).any():
                yield rows, chains, self._pauses(chains)
                continue
            before = np.zeros((len(chains.kinds), rows.size))
            starts = np.where(tails[rows] < n, self._half(way), 0.0)
            first = np.argmax(np.array(chains.present), axis=0) if rows.size else rows
            before[first, np.arange(rows.size)] = starts
            yield rows, chains, Pauses(before, np.zeros_like(before))

    def _pauses(self, chains: MotionChains) -> Pauses:
        """Return the pauses about the legs of paths to goals, between which the car stops.

        The car stops at the ends, where its direction changes, and about legs whose plan includes the stop already.
        """
        size = chains.tails.size
        before, after = (np.zeros((len(chains.kinds), size)) for _ in range(2))
        last, way, stops = np.full(size, -1), np.zeros(size, np.int64), np.zeros(size, dtype=np.bool_)
        for i, kind in enumerate(chains.kinds):
            law, rows = laws_of(self.model)[kind], np.flatnonzero(chains.present[i])
            shape = cast(SteeredGeometry, law).shape(chains.corners[i].take(rows), chains.corners[i + 1].take(rows))
            ahead = np.where(shape.length < 0, -1, 1)
            waits = np.abs(shape.curvature(0.5)) > STEERED
            waits &= kind == "arc" and cast("Ackermann", self.model).steering_rate is not None
            begins = (last[rows] < 0) | stops[rows] | waits | (ahead != way[rows])
            ended = rows[begins & (last[rows] >= 0) & ~stops[rows]]
            after[last[ended], ended] = self._half(way[ended])
            before[i, rows] = np.where(begins & ~waits, self._half(ahead), 0.0)
            last[rows], way[rows], stops[rows] = i, ahead, waits
        ended = np.flatnonzero((last >= 0) & ~stops)
        after[last[ended], ended] = self._half(way[ended])
        return Pauses(before, after)

    def _hold(self, states: States, seconds: FloatArray) -> Motions:
        own = {name: np.nan_to_num(getattr(states, name)) for name in self.model.space.names}
        start, end = (States(**own, **{CLOCK: clock}) for clock in (0.0 * seconds, seconds))
        return Motions(self.world, self.model, HOLD, start, end)

    def legs(self, arcs: IntArray) -> Iterator[tuple[IntArray, Motions]]:
        """Yield the motions and pauses of some arcs (N,), in order of time: indices of the arcs, and the motions."""
        for rows, chains, pauses in self._chains(arcs):
            for i, (some, motions) in enumerate(chains.motions()):
                for where, seconds, at in ((0, pauses.before[i], i), (1, pauses.after[i], i + 1)):
                    if where == 1 and some.size:
                        yield arcs[rows[some]], motions
                    held = np.flatnonzero(seconds > 0.0)
                    if held.size:
                        yield arcs[rows[held]], self._hold(chains.corners[at].take(held), seconds[held])
        _, own, ways = self._listed
        stops = arcs[own[arcs] == STOP]
        if stops.size:
            yield stops, self._hold(self.states(self._ends(stops)[0]), self._half(ways[stops]))

    def motion_counts(self, arcs: IntArray) -> IntArray:
        """Return the number (N,) of motions in each of some arcs, without pauses."""
        counts = np.zeros(arcs.size, np.int64)
        for rows, chains, _ in self._chains(arcs):
            counts[rows] = chains.count(chains.kinds)
        return counts

    def pauses(self, arcs: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        """Return the pauses within some arcs (N,): for each the arc's position, the motions before it, and seconds."""
        _, own, ways = self._listed
        stops = np.flatnonzero(own[arcs] == STOP)
        found = [(stops, 0 * stops, self._half(ways[arcs[stops]]))]
        for rows, chains, pauses in self._chains(arcs):
            present = np.array(chains.present, dtype=np.int64)
            passed = np.cumsum(present, axis=0)
            for seconds, before in ((pauses.before, passed - present), (pauses.after, passed)):
                leg, some = np.nonzero(seconds)
                found.append((rows[some], before[leg, some], seconds[leg, some]))
        position, before, lasts = (np.concatenate(column) for column in zip(*found, strict=True))
        return position, before, lasts

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph: each arc costs what the criteria say of its motions and pauses, rounded up once."""
        arcs = self.arcs
        self.spending.hold(arcs.heads.size * (8 * len(criteria) + ARC), f"{self.words} was built")
        worst = np.array([criterion.aggregate == "max" for criterion in criteria])

        def paid(part: slice) -> tuple[slice, IntArray]:
            costs = np.zeros((part.stop - part.start, len(criteria)))
            for rows, motions in self.legs(np.arange(part.start, part.stop)):
                own = rows - part.start
                each = np.stack([motion_costs(criterion, motions) for criterion in criteria], axis=1)
                costs[own] = np.where(worst, np.maximum(costs[own], each), costs[own] + each)
            return part, np.stack([quantised(costs[:, j], c) for j, c in enumerate(criteria)], axis=1)

        costs = np.zeros((arcs.heads.size, len(criteria)), np.int64)
        for part, quanta in self.spending.each(paid, blocks(arcs.heads.size, PIECES), f"{self.words} was built"):
            costs[part] = quanta
        costs.setflags(write=False)
        return Graph.from_csr(arcs.start, arcs.heads, costs, aggregates=aggregates(criteria))

    def edges(self, kind: str) -> tuple[IntArray, IntArray]:
        """Raise NotImplementedError: an arc is a chain of motions, see :meth:`legs`."""
        raise NotImplementedError

    def costed_in(self, world: World) -> PrimitiveRuns:
        """Return a graph with the same arcs, whose costs are computed in another world; arcs are not checked again."""
        found = replace(self, world=world, inner=self.inner.costed_in(world))
        vars(found)["_listed"] = self._listed
        return found

    # Trajectories

    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, without the pauses about runs.

        ids    (N,)  nodes of all paths, one path after another
        sizes  (n,)  number of nodes of each path
        """
        states, path = ids % self.inner.size, np.repeat(np.arange(sizes.size), sizes)
        kept = np.append(True, (states[1:] != states[:-1]) | (path[1:] != path[:-1]))[: ids.size]
        return self.inner.stretches(states[kept], np.bincount(path[kept], minlength=sizes.size))

    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from start to goals, as text: that of the lattice."""
        return self.inner.what_separates(start % self.inner.size, [goal % self.inner.size for goal in goals])
