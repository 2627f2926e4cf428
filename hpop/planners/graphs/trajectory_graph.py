"""Graphs whose paths are trajectories: what a search on one needs to know of it, whatever its arcs are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, IntArray
from hpop.criteria.base import Criterion
from hpop.motions import Collision, Model, States
from hpop.planners.graphs.stretches import Stretches
from hpop.planners.spending import Spending
from hpop.search import Graph
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.chains import Chains
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.world import World

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
    def joins(self) -> Chains | None:
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
