"""Graphs whose paths are trajectories: what a search on one needs to know of it, whatever its arcs are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.motions import Collision, Law, Model, States, StateSpace, is_coupled, onward
from hpop.motions.by_law import refuse_impossible
from hpop.planners.spending import Spending
from hpop.search import Graph
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.arcs import MotionChains
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.world import World

# All states stand in the same columns, all motions of a law are checked at once; trajectories are parts of the columns.


BLOCK = 2**20  # angles that are added up at once


class Stretches(NamedTuple):
    """Parts of trajectories, or whole ones, one after another.

    states  (N,)  what comes round is continuous within each
    kinds   (N,)  of the motion that ends in each state, as its place among those of the graph; of a first state it
                  says nothing
    sizes   (n,)  states of each; none where there is no such part
    """

    states: States
    kinds: IntArray
    sizes: IntArray

    @classmethod
    def through(
        cls, space: StateSpace, laws: Sequence[Law], states: States, kinds: IntArray, sizes: IntArray
    ) -> Stretches:
        """Motions of some kinds through states (N,), so many (n,) of them for each; angles turn the shorter way.

        laws  of the kinds
        """
        columns = dict(states.__dict__)
        begins = (np.cumsum(sizes) - sizes)[sizes > 0]
        turned = {name: np.append(np.zeros(1), turns)[: kinds.size] for name, turns in space.turns(states).items()}
        for number, law in enumerate(laws):
            if is_coupled(law):
                rows = np.flatnonzero(kinds == number)
                start = states.take(rows - 1)
                end = onward(law, space, start, states.take(rows))
                for name in law.varies & space.turning:
                    turned[name][rows] = getattr(end, name) - getattr(start, name)
        for name, steps in turned.items():
            steps[begins] = 0.0
            columns[name] = np.repeat(columns[name][begins], sizes[sizes > 0]) + _running(steps, sizes)
        return cls(States(**columns), kinds, sizes)

    @classmethod
    def joined(cls, space: StateSpace, parts: Sequence[Stretches]) -> Stretches:
        """From each part the first stretches make one, the second ones the next, and so on.

        Each begins where the one before it ends, but for whole turns of what comes round.
        """
        lengths = np.array([part.sizes for part in parts])  # (p, n)
        present = lengths > 0
        first = present & (np.cumsum(present, axis=0) == 1)
        kept = lengths - (present & ~first)  # where one begins, the one before it ends
        sizes = kept.sum(axis=0)
        begins = np.cumsum(sizes) - sizes + np.cumsum(kept, axis=0) - kept
        columns = {name: np.empty(sizes.sum()) for name in space.names}
        kinds = np.empty(sizes.sum(), dtype=np.int64)
        last = {name: np.zeros(sizes.size) for name in space.turning}
        for part, length, is_first, begin in zip(parts, lengths, first, begins, strict=True):
            owner = np.repeat(np.arange(length.size), length)
            own = np.cumsum(length) - length
            within = np.arange(owner.size) - own[owner]
            new = np.flatnonzero((within > 0) | is_first[owner])
            place = ((begin - ~is_first)[owner] + within)[new]
            there = length > 0
            kinds[place] = part.kinds[new]
            for name, column in columns.items():
                value = getattr(part.states, name)
                if name in last:
                    whole = np.zeros(length.size)
                    whole[there] = 2 * np.pi * np.round((last[name][there] - value[own[there]]) / (2 * np.pi))
                    whole[is_first] = 0.0
                    value = value + whole[owner]  # so half a turn stays the way round that was checked
                    last[name][there] = value[(own + length - 1)[there]]
                column[place] = value[new]
        return cls(States(**columns), kinds, sizes)

    def trajectories(self, model: Model, kinds: tuple[str, ...]) -> tuple[Trajectory, ...]:
        """The trajectories that they are, of motions of these kinds; raises ModelError for one that is none."""
        states = self.states
        for name in states.names:
            getattr(states, name).setflags(write=False)
        ends = np.cumsum(self.sizes)
        heads = np.delete(np.arange(self.kinds.size), ends - self.sizes)
        for number, kind in enumerate(kinds):
            rows = np.flatnonzero(self.kinds[heads] == number)
            if rows.size:
                start, end = states.take(heads[rows] - 1), states.take(heads[rows])
                refuse_impossible(model, model.laws[kind], start, end, rows)
        words = tuple(np.array(kinds, dtype=object)[self.kinds].tolist())
        return tuple(
            Trajectory.of_checked(model, states.take(slice(begin, end)), words[begin + 1 : end])
            for begin, end in pairwise([0, *ends.tolist()])
        )


def _running(steps: FloatArray, sizes: IntArray) -> FloatArray:
    """Sums (N,) of the steps up to each, over stretches of so many (n,), each added up from its first to its last."""
    running = np.empty(steps.size)
    ends = np.append(0, np.cumsum(sizes))
    several = max(1, BLOCK // max(1, int(sizes.max(initial=0))))
    for begin in range(0, sizes.size, several):
        own = sizes[begin : begin + several]
        part = slice(ends[begin], ends[begin + own.size])
        there = np.arange(own.max()) < own[:, None]
        rows = np.zeros(there.shape)
        rows[there] = steps[part]
        running[part] = np.cumsum(rows, axis=1)[there]
    return running


N = TypeVar("N", bound=np.generic)


@dataclass(frozen=True, eq=False)
class TrajectoryGraph(ABC):
    """States of a model in a world, numbered from 0, and arcs between them, each of one motion or a chain of some.

    model, world
    spending   what building it may spend
    has_clock  whether the graph can be put on a clock, so that people may move (:mod:`hpop.planners.graphs.timed`)
    """

    has_clock: ClassVar[bool] = False

    model: Model
    world: World
    spending: Spending = field(default_factory=Spending, kw_only=True)

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of states."""

    @property
    @abstractmethod
    def words(self) -> str:
        """What tells this graph from others, in words: "the lattice of step 0.25 m, ..."."""

    @property
    @abstractmethod
    def options(self) -> dict[str, Any]:
        """The same, JSON-able."""

    @abstractmethod
    def states(self, ids: IntArray) -> States:
        """States (N,) by their numbers."""

    @property
    @abstractmethod
    def kinds(self) -> tuple[str, ...]:
        """Kinds of its motions."""

    @abstractmethod
    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """The graph with one integer cost a criterion: costs of arcs in quanta, rounded once.

        Raises CriterionError that names the criterion whose cost is negative, not a number or of the wrong shape, and
        Exhausted where a limit of the spending is passed.
        """

    @property
    def is_checked(self) -> bool:
        """Whether all arcs of `graph` are known to be free; of others :meth:`arcs_free` tells."""
        return True

    def with_checked_arcs(self) -> Self:
        """Return the same graph with every arc checked when it is built."""
        return self

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs are kept from before; True where no path is known sooner than these."""
        return True

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of its parts, by name, for statistics."""
        return {}

    @property
    def states_alone(self) -> StateGraph | None:
        """The graph of states to which ends are joined, or itself; None of a graph that has no places."""
        return None

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the nodes of the graph itself in the place of ends that were joined to it."""
        return nodes

    @property
    def joins(self) -> MotionChains | None:
        """The arcs that join ends to the graph of states, by their tails; None where it has none."""
        return None

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Places in `graph` of the arcs of the graph of states, and of the joins."""
        states = self.states_alone
        return np.arange(0 if states is None else states.arcs.heads.size), np.zeros(0, np.int64)

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Return values (m, ...) of arcs between states and (j, ...) of joins, in the order of the arcs of `graph`."""
        return inner

    def costed_in(self, world: World) -> Self:
        """Return the same states and arcs, whether free there or not, to be costed in another world."""
        raise NotImplementedError

    def arcs_free(self, places: IntArray) -> BoolArray:
        """Which arcs (N,) of `graph`, by their places, are free."""
        return np.ones(places.size, dtype=np.bool_)

    def without(self, places: IntArray) -> TrajectoryGraph:
        """The same without some arcs (N,) of `graph` that are known to be blocked: of one that is not checked."""
        raise NotImplementedError

    @property
    @abstractmethod
    def turned(self) -> NDArray[np.int8]:
        """Motions (m,) in each arc of `graph` of which a path shall have few where its costs do not tell."""

    @abstractmethod
    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Trajectories through states (N,), so many (n,) of them for each, not yet checked."""

    @abstractmethod
    def what_separates(self, start: int, goals: list[int]) -> str:
        """Say in words why no path leads from a state to any of the goals."""

    @cached_property
    def collision(self) -> Collision:
        """What tells free states and motions."""
        return self.model.collision(self.world)

    def trajectory(self, ids: IntArray) -> Trajectory:
        """The trajectory through states (n+1,)."""
        return self.trajectories([ids])[0]

    def trajectories(self, paths: Sequence[IntArray]) -> tuple[Trajectory, ...]:
        """The trajectories through the states (n+1,) of each path: what comes round is continuous."""
        sizes = np.array([path.size for path in paths], dtype=np.int64)
        ids = np.concatenate([np.zeros(0, np.int64), *paths])
        return self.stretches(ids, sizes).trajectories(self.model, self.kinds)


def aggregates(criteria: Sequence[Criterion]) -> tuple[str, ...]:
    """How a search adds up the cost of each criterion."""
    return tuple("max" if criterion.aggregate == "max" else "sum" for criterion in criteria)
