"""Graphs of states that turns and moves connect, and a planning problem on such a graph, for whichever search.

A lattice, a roadmap: what they have in common is that a state stands at a place, that turns join the states of one
place, and that an edge is a motion, so criteria cost it as they cost trajectories.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from hpop.arrays import BoolArray, FloatArray, IntArray
from hpop.criteria.base import Criterion, motion_costs
from hpop.errors import GraphError, OptionError, QueryError, did_you_mean
from hpop.frontier import is_nondominated
from hpop.math import wrap
from hpop.models.collision import PlanarCollision
from hpop.motions import Motions, States
from hpop.options import MOST, MOST_COUNTED, real
from hpop.planners.arcs import Arcs, Counts, Quanta, blocks, table
from hpop.planners.base import Candidates, Objectives, quantised
from hpop.planners.claims import at_memory_limit, missing, within
from hpop.planners.purse import Purse
from hpop.planners.search import Graph, ParetoPaths, pareto_paths
from hpop.planners.search.checkpoint import CheckpointSpec
from hpop.status import Budget, ProgressCallback, Status
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.models import DifferentialDrive
    from hpop.problem import Problem
    from hpop.world import World

A = TypeVar("A")
BATCH = 500_000  # motions evaluated at once: bounds memory, large enough for array speed
ARC = 16  # bytes of an arc beside its costs
MAX_COSTS = 6
TIE_TURNS = 2**18  # more turns than any path makes
COARSE = 0.01
SHARE = "this stage's share of the time"
TURNS = "turns"  # the criterion that ``max_turns`` bounds


@dataclass(frozen=True, eq=False)
class StateGraph(ABC):
    """Free states of a model in a world, numbered from 0, and the motions that join them.

    model, world
    purse  what building it may spend
    """

    model: DifferentialDrive
    world: World
    purse: Purse = field(default_factory=Purse, kw_only=True)

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
    def places(self, ids: IntArray) -> IntArray:
        """Number (N,) of the place at which each state is; turns join the states of one place, moves places."""

    @abstractmethod
    def states(self, ids: IntArray) -> States:
        """Positions and yaws of states (N,)."""

    @property
    @abstractmethod
    def turns(self) -> tuple[IntArray, IntArray]:
        """Tails and heads of all free turns."""

    @property
    @abstractmethod
    def moves(self) -> tuple[IntArray, IntArray]:
        """Tails and heads of all free moves."""

    @abstractmethod
    def what_separates(self, start: int, goals: list[int]) -> str:
        """Say in words why no path leads from a state to any of the goals."""

    def near(self, x: float, y: float, radius: float) -> IntArray:
        """Ids (N,), rising, of the states no farther than a radius, m, from a place; not all of them need be free."""
        found = [np.zeros(0, dtype=np.int64)]
        for begin in range(0, self.size, BATCH):
            ids = np.arange(begin, min(begin + BATCH, self.size))
            states = self.states(ids)
            found.append(ids[np.hypot(states.x - x, states.y - y) <= radius])
        return np.concatenate(found)

    def turned(self, graph: Graph) -> IntArray:
        """Turns (m,) in each arc of its graph."""
        place = self.places(np.arange(graph.nodes))
        return np.asarray(np.repeat(place, np.diff(graph.indptr)) == place[graph.heads], dtype=np.int64)

    @cached_property
    def collision(self) -> PlanarCollision:
        """What tells free states and motions."""
        return PlanarCollision(self.model, self.world)

    def motions(self, kind: str, tails: IntArray, heads: IntArray) -> Motions:
        """Edges (M,) as motions; a turn goes the shorter way, a half turn counter-clockwise."""
        start, end = self.states(tails), self.states(heads)
        end.__dict__["yaw"] = start.yaw + wrap(end.yaw - start.yaw) if kind == "turn" else start.yaw
        return Motions(self.world, self.model, self.model.laws[kind], start, end)

    @cached_property
    def arcs(self) -> Arcs:
        """All free turns and moves."""
        return Arcs.sorted(self.size, self.turns, self.moves)

    def batches(self) -> Iterator[tuple[IntArray, IntArray, Motions]]:
        """All edges as tails, heads and motions, in batches of bounded size."""
        for part in blocks(self.arcs.heads.size):
            for _, tails, heads, motions in self._batches(part):
                yield tails, heads, motions

    def _batches(self, part: slice) -> Iterator[tuple[BoolArray, IntArray, IntArray, Motions]]:
        """A range of arcs as motions of one law: which of them, their tails and heads, and the motions."""
        tails, heads = self.arcs.ends(part)
        for kind in ("turn", "move"):
            own = self.arcs.turns[part] == (kind == "turn")
            if own.any():
                yield own, tails[own], heads[own], self.motions(kind, tails[own], heads[own])

    @property
    def key(self) -> Hashable:
        """What makes equal graphs of one world equal, so that it keeps their parts; None where nothing is kept."""
        return None

    def shared(self, name: Hashable, make: Callable[[], A]) -> A:
        """A part that the world keeps for all equal graphs: another planning run need not make it again."""
        found = self._found(name)
        if found is None:  # not made under the cache's lock: it is made by several threads
            found = make()
            self._keep(name, found)
        return cast(A, found)

    def costed(self, criteria: Sequence[Criterion]) -> bool:
        """Whether the costs of all edges are kept from an earlier planning run."""
        return all(self._found(_name(criterion)) is not None for criterion in criteria)

    def _found(self, name: Hashable) -> Any:
        return None if None in (self.key, name) else self.world.cache.find((self.key, name))

    def _keep(self, name: Hashable, value: Any) -> None:
        if None not in (self.key, name):
            self.world.cache.keep((self.key, name), value)

    def graph(self, criteria: Sequence[Criterion]) -> Graph:
        """The graph with one integer cost a criterion: edge costs in quanta, rounded once.

        Raises CriterionError that names the criterion whose cost is negative, not a number or of the wrong shape, and
        Exhausted where a limit of the purse is passed.
        """
        arcs = self.arcs
        self.purse.hold(arcs.heads.size * (8 * len(criteria) + ARC), f"{self.words} was built")
        return Graph.from_csr(
            arcs.start,
            arcs.heads,
            table(self._columns(criteria), arcs.heads.size),
            aggregates=tuple("max" if c.aggregate == "max" else "sum" for c in criteria),
        )

    def _columns(self, criteria: Sequence[Criterion]) -> list[Counts]:
        """Costs (m,) of all arcs in each criterion; those that are not kept are made together, block by block."""
        columns = [self._found(_name(criterion)) for criterion in criteria]
        missing = [j for j, column in enumerate(columns) if column is None]
        size = self.arcs.heads.size
        made = [Quanta(size) for _ in missing]

        def costs(part: slice) -> tuple[slice, list[IntArray]]:
            counts = [np.empty(part.stop - part.start, np.int64) for _ in missing]
            for own, _, _, motions in self._batches(part):
                for count, j in zip(counts, missing, strict=True):
                    count[own] = quantised(motion_costs(criteria[j], motions), criteria[j])
            return part, counts

        for part, counts in self.purse.each(costs, blocks(size) if missing else (), f"{self.words} was built"):
            for column, count in zip(made, counts, strict=True):
                column.write(part, count)
        for j, column in zip(missing, made, strict=True):
            column.counts.setflags(write=False)
            columns[j] = column.counts
            self._keep(_name(criteria[j]), column.counts)
        return columns

    def trajectory(self, ids: IntArray) -> Trajectory:
        """The trajectory through states (n+1,): one motion an edge, yaw continuous."""
        states = self.states(ids)
        yaw = states.yaw[0] + np.concatenate([[0.0], np.cumsum(wrap(np.diff(states.yaw)))])
        same = np.diff(self.places(ids)) == 0
        kinds = tuple("turn" if turned else "move" for turned in same)
        return Trajectory(self.model, States(x=states.x, y=states.y, yaw=yaw), kinds)


def _name(criterion: Criterion) -> Hashable:
    """What makes equal columns of costs equal; None of a criterion that may change, or that knows no equals."""
    try:
        return identity(criterion), criterion.quantum
    except TypeError:
        return None


def identity(value: Any) -> Hashable:
    """What tells a value that cannot change from others: of a dataclass all fields, compared or not.

    Raises TypeError for one that may change.
    """
    if not is_dataclass(value):
        hash(value)
        return cast(Hashable, value)
    declared = vars(type(value)).get("__dataclass_params__")  # its own: a class below may hold more than fields
    if declared is None or not declared.frozen:
        raise TypeError(f"{type(value).__name__} may change")
    return type(value), *(identity(getattr(value, field.name)) for field in fields(value))


def refuse_unanswerable(problem: Problem, objectives: Objectives, what: str) -> None:
    """Raise where a graph without time, ``what``, cannot answer: people who move (QueryError), or too many costs."""
    people = problem.world.content.people
    moving = [person.name or f"number {i}" for i, person in enumerate(people) if person.moves]
    if moving:
        raise QueryError(
            f"the {what} has no time, so it cannot tell where people who move will be: {', '.join(moving)}. Give them "
            "no velocity to plan round where they are now, or leave them out and evaluate the criteria on the front's "
            "trajectories, in the world with them."
        )
    if len(objectives.optimised) > MAX_COSTS:
        names = [criterion.name for criterion in objectives.optimised]
        raise OptionError(
            f"the exact search takes at most {MAX_COSTS} costs, got {len(names)}: {', '.join(names)}; leave some out"
        )


def tolerance_counts(objectives: Objectives, tolerance: Mapping[str, float]) -> IntArray:
    """Tolerances (k,) in quanta, rounded down; raises OptionError for a name that is no cost, or no length."""
    names = [criterion.name for criterion in objectives.optimised]
    for name, value in tolerance.items():
        if name not in names:
            raise OptionError(
                f"tolerance names {name!r}, but the costs that are searched for are {', '.join(names)}."
                + did_you_mean(name, names)
            )
        real(f"the tolerance in {name}", value, 0, MOST)
    slack = [tolerance.get(criterion.name, 0.0) / criterion.quantum for criterion in objectives.optimised]
    return np.array([min(math.floor(value + 1e-9), MOST_COUNTED) for value in slack], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class GraphQuery:
    """A problem on a graph of states, for whichever search: what to search, and what is said of the result.

    space          the states
    graph          integer costs in quanta of ``objectives.optimised``
    start, goals   state ids
    build_seconds  s
    notes          what the user should know of the ends
    max_turns      paths with more turns do not count
    """

    space: StateGraph
    objectives: Objectives
    graph: Graph
    start: int
    goals: list[int]
    build_seconds: float
    notes: tuple[str, ...] = ()
    max_turns: int | None = None

    @property
    def names(self) -> str:
        """The optimised criteria, in words."""
        return ", ".join(criterion.name for criterion in self.objectives.optimised)

    @property
    def quanta(self) -> FloatArray:
        """What one count of each cost is, (k,), in the criteria's units."""
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

    def exact(
        self,
        name: str,
        budget: Budget,
        progress: ProgressCallback | None = None,
        *,
        eps: float = 0.0,
        tolerance: Mapping[str, float] | None = None,
        checkpoint: CheckpointSpec | None = None,
        covered: float = math.inf,
        stage: bool = False,
    ) -> Candidates:
        """All non-dominated paths as the candidates of the planner ``name``, or some within ``eps`` of them all.

        Every non-dominated cost vector p is then covered by one that is at most (1 + eps) p + tolerance, the tolerance
        in the units of the costs that it names. ``checkpoint``: as in :func:`pareto_paths`. ``covered``: points at hand
        already, of an earlier stage, cover every optimal vector within the factor 1 + covered. ``stage``: before the
        last, so that the budget's time is a share and not a limit that anybody has set.
        """
        counts = tolerance_counts(self.objectives, tolerance or {})

        def search(graph: Graph) -> ParetoPaths:
            slack = counts.copy()
            if graph is self.tie_broken:
                slack[_summed(graph)[0]] *= TIE_TURNS
            return pareto_paths(
                graph,
                self.start,
                self.goals,
                budget=budget,
                progress=progress,
                eps=eps,
                tolerance=slack.tolist(),
                at_most=self.at_most(),
                checkpoint=checkpoint,
            )

        paths = self.with_fewest_turns(search)
        where = f"{self.space.words} for ({self.names})"
        if self.max_turns is not None:
            where += f" and at most {self.max_turns} turns"
        factor, gap = within(eps, tolerance or {}), min(paths.gap, covered)
        if not paths.status.is_final:
            optimal = "every point is optimal"
            each = optimal if self.tie_broken is None else "no path is better in every cost than a point"
            each = f"points are within {factor} of optimal" if factor else each
            each = each if len(paths) else "the search itself found none"
            ended = SHARE if stage and paths.status is Status.TIME_LIMIT else paths.status
            claim = f"incomplete ({ended}): {each} on {where}, others are missing{missing(gap, tolerance or {})}"
        elif factor:
            claim = (
                f"every optimal cost vector on {where} is covered within {factor}, edge costs rounded to their quanta; "
                "points need not be optimal themselves"
            )
        else:
            claim = f"exact on {where}, edge costs rounded to their quanta"
        found = {
            "method": paths.stats.method,
            "labels_generated": paths.stats.labels_generated,
            "labels_expanded": paths.stats.labels_expanded,
            "labels_open": paths.stats.labels_open,
            "peak_memory": paths.stats.peak_memory,
            "gap": gap if math.isfinite(gap) else None,
        }
        return self.candidates(name, paths, claim, notes=at_memory_limit(paths), stats=found)

    def at_most(self) -> list[int | None]:
        """Bounds (k,) on the costs, none where none is asked for.

        Raises OptionError where turns are bounded, but none of the costs.
        """
        names = [criterion.name for criterion in self.objectives.optimised]
        if self.max_turns is None:
            return []
        if TURNS not in names:
            raise OptionError(
                f"max_turns bounds the cost {TURNS!r}, but the costs that are searched for are {self.names}; list it "
                "among the criteria, or leave max_turns out"
            )
        return [self.max_turns if name == TURNS else None for name in names]

    @cached_property
    def tie_broken(self) -> Graph | None:
        """The graph with turns as a last tie-break, where no cost charges for every turn; None where one does.

        Ties would else be broken by spinning as well as by not. The first summed cost becomes cost * TIE_TURNS + turns.
        """
        graph, turns = self.graph, self.space.turned(self.graph)
        summed = _summed(graph)
        if not summed or not turns.any() or (graph.costs[turns > 0][:, summed].min(axis=0) > 0).any():
            return None
        costs = graph.costs.copy()
        costs[:, summed[0]] = costs[:, summed[0]] * TIE_TURNS + turns
        try:
            return replace(graph, costs=costs)
        except GraphError:  # sums would overflow: the graph is too large for a tie-break
            return None

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Search, and of paths with equal costs keep one with the fewest turns, also where no cost charges for them.

        A search that ends by itself loses nothing: what differs in the turns alone is dropped afterwards. One that is
        stopped may keep a point that ties with a better one in the first summed cost.
        """
        if self.tie_broken is None:
            return self._within(search(self.graph))
        paths, first = search(self.tie_broken), _summed(self.graph)[0]
        found = paths.costs.copy()
        spun = found[:, first] % TIE_TURNS
        found[:, first] //= TIE_TURNS
        order = np.lexsort((spun, *found.T[::-1]))
        kept = order[is_nondominated(found[order])]
        return paths.select(found, kept)

    def candidates(
        self,
        name: str,
        paths: ParetoPaths,
        claim: str,
        *,
        provenance: Sequence[Mapping[str, Any]] | None = None,
        notes: Sequence[str] = (),
        stats: Mapping[str, Any] | None = None,
        blocks: str = "",
    ) -> Candidates:
        """Paths as the candidates of the planner ``name``: each with its provenance, all with a claim and counts.

        ``blocks``: why there is no path, where the caller knows.
        """
        objectives, space = self.objectives, self.space
        nodes: list[IntArray] = [paths.nodes(i) for i in range(len(paths.costs))]
        # A sum is rounded once an edge, a worst edge once.
        summed = np.array([criterion.aggregate != "max" for criterion in objectives.optimised])
        rounds = np.where(summed, np.array([[max(1, n.size - 1)] for n in nodes]).reshape(-1, 1), 1)
        blocked = (blocks or self._what_blocks(),) if paths.status is Status.NO_PATH else ()
        origins, options = provenance or [{} for _ in nodes], space.options
        return Candidates(
            objectives=objectives.optimised,
            trajectories=tuple(space.trajectory(n) for n in nodes),
            planned=paths.costs * self.quanta,
            tolerance=rounds * self.quanta,
            status=paths.status,
            certificate=f"{name}: {claim}{objectives.certificate}",
            provenance=tuple(
                {"planner": name, **options, "edges": int(n.size - 1), **origin}
                for n, origin in zip(nodes, origins, strict=True)
            ),
            notes=(*objectives.notes, *self.notes, *blocked, *self._coarse(paths, rounds), *notes),
            filters=objectives.filters,
            stats={
                "planner": name,
                "states": space.size,
                "edges": int(self.graph.heads.size),
                "build_seconds": self.build_seconds,
                **(stats or {}),
                "bounds_seconds": paths.stats.seconds_bounds,
                "search_seconds": paths.stats.seconds_search,
            },
        )

    def _within(self, paths: ParetoPaths) -> ParetoPaths:
        """The paths that keep the bound on the turns; a search that knows nothing of it may have found others."""
        bounds = [math.inf if bound is None else bound for bound in self.at_most()]
        kept = np.flatnonzero((paths.costs <= np.array(bounds or math.inf)).all(axis=1))
        return paths if kept.size == len(paths) else paths.select(paths.costs, kept)

    def _what_blocks(self) -> str:
        """Why there is no path, in words: too many turns, or what separates start and goal."""
        for j, bound in enumerate(self.at_most()):
            if bound is not None:
                turns = replace(self.graph, costs=self.graph.costs[:, [j]], aggregates=("sum",))
                least = pareto_paths(turns, self.start, self.goals).costs
                if len(least):
                    return f"no path has at most {bound} turns; the least is {least[0, 0]}. Raise max_turns"
        return self.space.what_separates(self.start, self.goals)

    def _coarse(self, paths: ParetoPaths, rounds: IntArray) -> list[str]:
        """A note on each cost whose rounding, edge by edge, may be more than a hundredth of what it tells apart."""
        if not len(paths):
            return []
        error = rounds.max(axis=0) * self.quanta
        size = np.maximum(np.ptp(paths.costs, axis=0), paths.costs.max(axis=0)) * self.quanta
        return [
            f"{criterion.name} is rounded to {criterion.quantum:g} {criterion.unit} edge by edge, by up to {off:.3g} "
            "in all: that is coarse for this front; declare a smaller quantum"
            for criterion, off, whole in zip(self.objectives.optimised, error, size, strict=True)
            if off > COARSE * whole > 0.0 and criterion.quantum != 1.0
        ]


def _summed(graph: Graph) -> list[int]:
    """Columns of the costs that add up."""
    return [j for j, aggregate in enumerate(graph.aggregates) if aggregate == "sum"]
