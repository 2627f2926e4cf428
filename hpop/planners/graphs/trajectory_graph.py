"""Interface of graphs whose paths are robot trajectories, as searches and planners use it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import BoolArray, FloatArray, IntArray, N, running_sums
from hpop.criteria.base import Criterion
from hpop.motions import Collision, Law, Model, States, StateSpace, is_coupled, onward
from hpop.motions.by_law import extras, refuse_impossible
from hpop.planners.spending import Spending
from hpop.search import Graph
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.planners.graphs.arcs import MotionChains
    from hpop.planners.graphs.state_graph import StateGraph
    from hpop.planners.graphs.tour import TourGraph
    from hpop.world import World

# Trajectories are built together: the states of all of them lie in common arrays, of which each trajectory is a slice.


class Stretches(NamedTuple):
    """States and motions of n trajectories, or of n parts of trajectories, one after another in common arrays.

    Each of the n sequences of states is called a stretch.

    states  (N,)  states of all stretches; angles have no jumps of whole turns within a stretch
    kinds   (N,)  kind of the motion that ends in each state, as an index into the graph's ``kinds``; without meaning
                  for the first state of a stretch
    sizes   (n,)  number of states of each stretch; 0 if a stretch is empty
    """

    states: States
    kinds: IntArray
    sizes: IntArray

    @classmethod
    def through(
        cls,
        space: StateSpace,
        laws: Sequence[Law],
        states: States,
        kinds: IntArray,
        sizes: IntArray,
        turns: Mapping[str, FloatArray] | None = None,
    ) -> Stretches:
        """Return the stretches through given states (N,), with angles made continuous.

        From one state to the next, an angle changes in the shorter direction, unless the law couples it to another
        angle.

        laws   law (the rule by which states change during a motion) of each kind of motion
        kinds  (N,)  index into ``laws`` of the motion that ends in each state
        sizes  (n,)  number of states of each stretch
        turns  by name of each turning column: its change (N,), rad, in the motion that ends in each state; NaN where
               the rule above applies, None for NaN everywhere
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
            if turns is not None:
                steps[:] = np.where(np.isnan(turns[name]), steps, turns[name])
            steps[begins] = 0.0
            columns[name] = np.repeat(columns[name][begins], sizes[sizes > 0]) + running_sums(steps, sizes)
        return cls(States(**columns), kinds, sizes)

    @classmethod
    def joined(cls, space: StateSpace, parts: Sequence[Stretches]) -> Stretches:
        """Join several parts of n trajectories: trajectory i is stretch i of the first part, then of the second, etc.

        Each stretch that is not empty must begin in the state in which the previous one ends. Angles may differ by
        whole turns there; these are then added, so that the joined angles have no jumps.
        """
        lengths = np.array([part.sizes for part in parts])  # (p, n)
        present = lengths > 0
        first = present & (np.cumsum(present, axis=0) == 1)
        kept = lengths - (present & ~first)  # the first state of a part repeats the last state of the part before
        sizes = kept.sum(axis=0)
        begins = np.cumsum(sizes) - sizes + np.cumsum(kept, axis=0) - kept
        further = [name for name in parts[0].states.names if name not in space.names] if parts else []
        columns = {name: np.empty(sizes.sum()) for name in (*space.names, *further)}
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
        """Return the n stretches as trajectories of a robot model.

        The trajectories share the arrays of ``states``, which become read-only. Raises ModelError if one of the motions
        does not follow the motion law of its kind.

        kinds  names of the kinds of motion, to which the field ``kinds`` refers by index
        """
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
        parts = [(slice(begin, end), words[begin + 1 : end]) for begin, end in pairwise([0, *ends.tolist()])]
        if len(states.names) == len(model.space.names):
            return tuple(Trajectory.of_checked(model, states.take(part), own) for part, own in parts)
        several = []
        for part, own in parts:  # a trajectory has only those further columns that its motions need
            names = (*model.space.names, *extras(model, own))
            columns = States(**{name: getattr(states, name)[part] for name in names})
            several.append(Trajectory.of_checked(model, columns, own))
        return tuple(several)


NO_MARKER = -1  # for an arc that its tail and head identify


@dataclass(frozen=True, eq=False)
class TrajectoryGraph(ABC):
    """Directed graph whose nodes are robot states, numbered from 0, and whose arcs are motions or chains of motions.

    model, world  the robot and its surroundings
    spending      time and memory used for building the graph, with the limits
    has_clock     whether the graph can be searched in time steps (:mod:`hpop.planners.graphs.timed`)
    has_chains    whether all arcs are chains from rest to rest, each with a speed of its own (:mod:`.chain_speeds`)
    """

    has_clock: ClassVar[bool] = False
    has_chains: ClassVar[bool] = False

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
        """Description for certificates and messages: "the lattice of step 0.25 m, ..."."""

    @property
    @abstractmethod
    def options(self) -> dict[str, Any]:
        """Options from which the graph was built, JSON-able, for the provenance of its paths."""

    @abstractmethod
    def states(self, ids: IntArray) -> States:
        """Return the states (N,) with the given numbers."""

    @property
    @abstractmethod
    def kinds(self) -> tuple[str, ...]:
        """Names of the kinds of motions in this graph, such as "move" and "turn"."""

    def at_rest(self, ids: IntArray) -> BoolArray:
        """Return a mask (N,): True for states in which the robot may stand; in a graph of speeds, those at rest."""
        return np.ones(ids.size, dtype=np.bool_)

    @abstractmethod
    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """Compute the costs of all arcs and return the graph for a search, with one integer cost for each criterion.

        A cost is a number of the criterion's quanta, rounded up. Raises CriterionError if a cost is negative, not
        finite or of the wrong shape, and Exhausted if a limit of ``spending`` is passed.
        """

    @property
    @abstractmethod
    def rows(self) -> IntArray:
        """Row pointers (n + 1,): the arcs that leave state u have the indices rows[u] to rows[u + 1] - 1 in `graph`."""

    @property
    @abstractmethod
    def heads(self) -> NDArray[np.int32]:
        """State (m,) to which each arc of `graph` leads."""

    @property
    def is_checked(self) -> bool:
        """True if all arcs of `graph` are known to be free; if not, a search checks those it uses (`arcs_free`)."""
        return True

    def with_checked_arcs(self) -> Self:
        """Return a version of this graph without arcs that collide, for which every arc is checked in advance."""
        return self

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Return whether the costs of all arcs are cached; if not, planners may seek a path before. True by default."""
        return True

    @property
    def counts(self) -> dict[str, int]:
        """Numbers that describe the size of the graph, by name, for statistics; none by default."""
        return {}

    @property
    def states_alone(self) -> StateGraph | None:
        """The graph without the nodes that were added for start, goals and stops.

        None if there is no such graph in the plane (:class:`.state_graph.StateGraph`), as for a roadmap of
        configurations, or if this graph has layers, for speeds or a tour.
        """
        return None

    def over_states(self, change: Callable[[StateGraph], StateGraph]) -> TrajectoryGraph:
        """Return this graph on another graph of states: the one that ``change`` makes of `states_alone`."""
        raise NotImplementedError

    def with_runs(self) -> TrajectoryGraph:
        """Return the graph for plans among moving people, with times for stops and starts; by default itself."""
        return self

    def driven(self, chains: MotionChains) -> MotionChains:
        """Return chains of motions of the model as this graph drives them at the fastest; by default, as they are."""
        return chains

    def in_choices(self, chains: MotionChains) -> MotionChains:
        """Return chains as :meth:`driven`, each at every speed and turn rate that it may choose, the fastest last."""
        return self.driven(chains)

    @property
    def markers(self) -> IntArray | None:
        """Node (m,) between the ends of each arc by which paths name it; NO_MARKER for none. None if no arc has one."""
        return None

    def is_marker(self, nodes: IntArray) -> BoolArray:
        """Return which nodes (N,) are markers: they name arcs, and no arc leads to them. By default none."""
        return np.zeros(nodes.size, dtype=np.bool_)

    @property
    def one_layer(self) -> TrajectoryGraph:
        """The graph itself, without layers for speeds."""
        return self

    @property
    def tour_layers(self) -> TourGraph | None:
        """The graph itself if it has layers for the visited stops of a tour, else None."""
        return None

    @property
    def slower_turns(self) -> tuple[Mapping[str, str], ...]:
        """For each slower turn rate, from slow: the kinds of motion that it replaces, such as {"turn": "turn_0.5"}."""
        return ()

    def in_layer(self, states: IntArray, speeds: FloatArray) -> IntArray:
        """Return, for nodes (N,) of `one_layer` and speeds (N,), m/s, the nodes (N,) of this graph at these speeds."""
        return states

    def is_join(self, nodes: IntArray) -> BoolArray:
        """Return a mask (N,): True for nodes that stand for a join, between its ends; there are none by default."""
        return np.zeros(nodes.size, dtype=np.bool_)

    @property
    def added_states(self) -> Mapping[str, States]:
        """State (1,) of each node that was added for a start, a goal or a stop, by name; none by default."""
        return {}

    def with_stops_joined(self, to: TrajectoryGraph) -> TrajectoryGraph:
        """Return ``to``, another graph of these states, with the joins to stops that this graph has."""
        return to

    def inside(self, nodes: list[int]) -> list[int]:
        """Return the nodes with each added start or goal replaced by the states to which it is connected."""
        return nodes

    @property
    def joins(self) -> MotionChains | None:
        """Arcs that connect added nodes (start, goals, stops) to the graph, sorted by tail; None without such nodes."""
        return None

    @property
    def order(self) -> tuple[IntArray, IntArray]:
        """Indices in `graph` of the arcs of `states_alone` (a,), and of the arcs of `joins` (j,), as two arrays."""
        states = self.states_alone
        return np.arange(0 if states is None else states.arcs.heads.size), np.zeros(0, np.int64)

    def with_joins(self, inner: NDArray[N], joins: NDArray[N]) -> NDArray[N]:
        """Merge values of arcs into one array (m, ...), in the order of the arcs of `graph`.

        inner  values (a, ...) of the arcs of `states_alone`
        joins  values (j, ...) of the arcs of `joins`
        """
        return inner

    def costed_in(self, world: World) -> Self:
        """Return a graph with the same arcs, whose costs are computed in another world; arcs are not checked again."""
        raise NotImplementedError

    def arcs_free(self, arcs: IntArray) -> BoolArray:
        """Check arcs (N,), given by their indices in `graph`; return a mask, True for those that do not collide."""
        return np.ones(arcs.size, dtype=np.bool_)

    def without(self, arcs: IntArray) -> TrajectoryGraph:
        """Return the graph without some blocked arcs (N,), given by their indices in `graph`.

        Used only for graphs whose arcs are checked on demand.
        """
        raise NotImplementedError

    @property
    @abstractmethod
    def turned(self) -> NDArray[np.int8]:
        """Number (m,) by which searches break ties: of paths with equal costs, they prefer the one with the least sum.

        Each arc has the number of its motions in place, such as turns. In a roadmap of configurations, all motions of
        the arc are counted.
        """

    @abstractmethod
    def stretches(self, ids: IntArray, sizes: IntArray) -> Stretches:
        """Return the states and motions of n trajectories, not yet checked for impossible motions.

        ids    (N,)  states of all paths, one path after another
        sizes  (n,)  number of states of each path
        """

    @abstractmethod
    def what_separates(self, start: int, goals: list[int]) -> str:
        """Return the reason, as text for an error, why no path leads from a state to any of the goals."""

    @cached_property
    def collision(self) -> Collision:
        """Collision checker for states and motions of the model in the world."""
        return self.model.collision(self.world)

    def trajectory(self, ids: IntArray) -> Trajectory:
        """Return the trajectory through states (n+1,), given by number."""
        return self.trajectories([ids])[0]

    def trajectories(self, paths: Sequence[IntArray]) -> tuple[Trajectory, ...]:
        """Return one trajectory for each path, given by the numbers (n+1,) of its states."""
        sizes = np.array([path.size for path in paths], dtype=np.int64)
        return self.trajectories_through(np.concatenate([np.zeros(0, np.int64), *paths]), sizes)

    def trajectories_through(self, ids: IntArray, sizes: IntArray) -> tuple[Trajectory, ...]:
        """Return n trajectories.

        ids    (N,)  states of all paths, one path after another
        sizes  (n,)  number of states of each path
        """
        return self.stretches(ids, sizes).trajectories(self.model, self.kinds)


def aggregates(criteria: Sequence[Criterion]) -> tuple[str, ...]:
    """Return, for each criterion, how a search combines the costs of arcs to the cost of a path: "sum" or "max"."""
    return tuple("max" if criterion.aggregate == "max" else "sum" for criterion in criteria)


def unmarked(ids: IntArray, sizes: IntArray, marks: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return n paths without markers: their nodes (N,), their sizes (n,), and a marker or NO_MARKER before each node.

    ids, marks  (N,)  nodes of all paths, and which of them are markers
    sizes       (n,)  number of nodes of each path
    """
    before = np.full(ids.size, NO_MARKER)
    before[1:] = np.where(marks, ids, NO_MARKER)[:-1]
    path = np.repeat(np.arange(sizes.size), sizes)
    return ids[~marks], sizes - np.bincount(path[marks], minlength=sizes.size), before[~marks]
