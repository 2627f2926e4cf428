"""Graphs with trajectories as paths: the interface that searches use, for any kind of arcs."""

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

# All states share columns, and all motions of a law are checked at once; trajectories are parts of the columns.


BLOCK = 2**20  # angles added up at once


class Stretches(NamedTuple):
    """Stretches: n trajectories, or parts of trajectories, one after another in common arrays.

    states  (N,)  states of all parts; angles are continuous within each part
    kinds   (N,)  index, in the kinds of the graph, of the motion that ends in each state; arbitrary for first states
    sizes   (n,)  number of states of each part; 0 for an absent part
    """

    states: States
    kinds: IntArray
    sizes: IntArray

    @classmethod
    def through(
        cls, space: StateSpace, laws: Sequence[Law], states: States, kinds: IntArray, sizes: IntArray
    ) -> Stretches:
        """Return the stretches through given states (N,); angles take the shorter direction.

        laws   law of each kind of motion
        kinds  (N,)  kind of the motion that ends in each state
        sizes  (n,)  number of states of each part
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
        """Join stretches end to end: stretch i of the result consists of the stretches i of all ``parts``, in order.

        Each stretch begins where the previous one ends, up to whole turns of angles.
        """
        lengths = np.array([part.sizes for part in parts])  # (p, n)
        present = lengths > 0
        first = present & (np.cumsum(present, axis=0) == 1)
        kept = lengths - (present & ~first)  # a part shares its first state with the part before it
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
            is_present = length > 0
            kinds[place] = part.kinds[new]
            for name, column in columns.items():
                value = getattr(part.states, name)
                if name in last:
                    whole = np.zeros(length.size)
                    whole[is_present] = (
                        2 * np.pi * np.round((last[name][is_present] - value[own[is_present]]) / (2 * np.pi))
                    )
                    whole[is_first] = 0.0
                    value = value + whole[owner]  # so half a turn keeps the direction that was checked
                    last[name][is_present] = value[(own + length - 1)[is_present]]
                column[place] = value[new]
        return cls(States(**columns), kinds, sizes)

    def trajectories(self, model: Model, kinds: tuple[str, ...]) -> tuple[Trajectory, ...]:
        """Return the trajectories; ``kinds`` are the names of the kinds. Raises ModelError for an impossible motion."""
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
    """Return the running sums (N,) of steps (N,), starting anew in each stretch of ``sizes`` (n,)."""
    running = np.empty(steps.size)
    ends = np.append(0, np.cumsum(sizes))
    at_once = max(1, BLOCK // max(1, int(sizes.max(initial=0))))
    for begin in range(0, sizes.size, at_once):
        own = sizes[begin : begin + at_once]
        part = slice(ends[begin], ends[begin + own.size])
        inside = np.arange(own.max()) < own[:, None]
        rows = np.zeros(inside.shape)
        rows[inside] = steps[part]
        running[part] = np.cumsum(rows, axis=1)[inside]
    return running


N = TypeVar("N", bound=np.generic)


@dataclass(frozen=True, eq=False)
class TrajectoryGraph(ABC):
    """Graph with states of a model in a world as nodes, and motions or chains of motions as arcs.

    States are numbered from 0.

    model, world
    spending   account of time and memory for building the graph
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
        """Description in words: "the lattice of step 0.25 m, ..."."""

    @property
    @abstractmethod
    def options(self) -> dict[str, Any]:
        """Options that identify the graph, as JSON."""

    @abstractmethod
    def states(self, ids: IntArray) -> States:
        """Return states (N,) by their numbers."""

    @property
    @abstractmethod
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions in this graph."""

    @abstractmethod
    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Return the search graph with one integer cost per criterion: costs of arcs in quanta, rounded once.

        Raises CriterionError that names the criterion with a cost that is negative, not a number or of the wrong shape,
        and Exhausted if a limit of the spending is passed.
        """

    @property
    @abstractmethod
    def rows(self) -> IntArray:
        """Row pointers (n + 1,) of `graph`: the arcs that leave state u are rows[u] : rows[u + 1]."""

    @property
    @abstractmethod
    def heads(self) -> NDArray[np.int32]:
        """Heads (m,) of the arcs of `graph`."""

    @property
    def is_checked(self) -> bool:
        """True if all arcs of `graph` are known to be free; otherwise :meth:`arcs_free` checks them."""
        return True

    def with_checked_arcs(self) -> Self:
        """Return the same graph with every arc checked when it is built."""
        return self

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs are cached; by default True, so that no quick first answer is tried."""
        return True

    @property
    def counts(self) -> dict[str, int]:
        """Sizes of the graph, by name, for statistics."""
        return {}

    @property
    def states_alone(self) -> StateGraph | None:
        """The graph of states without joined ends; None for a graph without places."""
        return None

    def inside(self, nodes: list[int]) -> list[int]:
        """Return nodes with joined ends replaced by the states to which they are joined."""
        return nodes

    @property
    def joins(self) -> MotionChains | None:
        """The arcs that join ends to the graph of states, by tail; None where there are none."""
        return None

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Indices in `graph` of the arcs of the graph of states, and of the joins."""
        states = self.states_alone
        return np.arange(0 if states is None else states.arcs.heads.size), np.zeros(0, np.int64)

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Return values (m, ...) of arcs between states and (j, ...) of joins, in the order of the arcs of `graph`."""
        return inner

    def costed_in(self, world: World) -> Self:
        """Return the graph with its arcs, free or not, to be costed in another world."""
        raise NotImplementedError

    def arcs_free(self, places: IntArray) -> BoolArray:
        """Mark the free ones of some arcs (N,), given by their indices in `graph`."""
        return np.ones(places.size, dtype=np.bool_)

    def without(self, places: IntArray) -> TrajectoryGraph:
        """Return the graph without some blocked arcs (N,), if arcs are checked only on demand."""
        raise NotImplementedError

    @property
    @abstractmethod
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) of turns, or other motions, in each arc of `graph`; it breaks ties between equal costs."""

    @abstractmethod
    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return n trajectories, not yet checked, through states (N,); ``sizes`` (n,) are their numbers of states."""

    @abstractmethod
    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason why no path leads from a state to any of the goals, as text."""

    @cached_property
    def collision(self) -> Collision:
        """Collision check of states and motions."""
        return self.model.collision(self.world)

    def trajectory(self, ids: IntArray) -> Trajectory:
        """Return the trajectory through states (n+1,)."""
        return self.trajectories([ids])[0]

    def trajectories(self, paths: Sequence[IntArray]) -> tuple[Trajectory, ...]:
        """Return the trajectories through the states (n+1,) of each path, with continuous angles."""
        sizes = np.array([path.size for path in paths], dtype=np.int64)
        return self.trajectories_through(np.concatenate([np.zeros(0, np.int64), *paths]), sizes)

    def trajectories_through(self, ids: IntArray, sizes: IntArray) -> tuple[Trajectory, ...]:
        """Return n trajectories through states (N,); ``sizes`` (n,) are their numbers of states."""
        return self.stretches(ids, sizes).trajectories(self.model, self.kinds)


def aggregates(criteria: Sequence[Criterion]) -> tuple[str, ...]:
    """Return how a search adds up the cost of each criterion: "sum" or "max"."""
    return tuple("max" if criterion.aggregate == "max" else "sum" for criterion in criteria)
