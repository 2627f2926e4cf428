"""The lattice planner: every optimal trade-off on an SE(2) lattice, exactly."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.errors import GraphError, OptionError, QueryError
from hpop.frontier import is_nondominated
from hpop.models.collision import why_blocked
from hpop.motions import Motions, States
from hpop.planners.base import Candidates, Objectives, edge_objectives, planner
from hpop.planners.grid import Headings
from hpop.planners.lattice_graph import StateLattice
from hpop.planners.search import Graph, ParetoPaths, pareto_paths
from hpop.planners.separation import what_separates
from hpop.status import Budget, Progress, ProgressCallback, Status

if TYPE_CHECKING:
    from hpop.problem import Problem

HEADING_TOLERANCE = 2e-3  # rad: a yaw written with three decimals is on its heading
MAX_COSTS = 6
TIE_TURNS = 2**18  # more turns than any path makes
COARSE = 0.01


@planner("lattice")
@dataclass(frozen=True)
class Lattice:
    """All non-dominated paths of an SE(2) lattice (Becerra et al. 2020), found by exact multi-objective search.

    step            m      between neighbouring positions
    headings        4, 8 or 16
    corner_cutting  whether a diagonal may pass between two blocked positions
    time_limit      s      of the search; what is found until then is returned and called incomplete
    max_labels      count  partial paths kept by the search
    max_memory      bytes  allocated by the search

    Accepts criteria that add up along edges or take the worst edge (sum, max), at most six; a time-mean is
    represented by its integral, and criteria with memory only filter what was found. Guarantees that no path of the
    lattice is better in one cost and no worse in the others, costs rounded to the criteria's quanta edge by edge;
    every float Pareto vector is covered within quantum times number of edges. The lattice is anchored at the start;
    the goal is the nearest free position within step / sqrt(2) from which the robot could go straight to where the
    goal was asked for.
    """

    step: float = 0.25
    headings: int = 8
    corner_cutting: bool = False
    time_limit: float | None = None
    max_labels: int | None = None
    max_memory: int | None = None

    def __post_init__(self) -> None:
        if not (isinstance(self.step, int | float) and 0 < self.step < math.inf):
            raise OptionError(f"the lattice's step must be a positive length in m, got {self.step!r}")
        Headings(self.headings)
        Budget(self.time_limit, self.max_labels, self.max_memory)

    def solve(self, problem: Problem, progress: ProgressCallback | None = None) -> Candidates:
        """Plan on the lattice.

        Raises QueryError when start or goal is blocked, off the map or off the headings, or when people move,
        UnsupportedCriterion when no criterion adds up along edges, CriterionError for a cost that is negative or not
        finite.
        """
        query = self.query(problem, edge_objectives(problem.criteria, "lattice"), progress)
        budget = Budget(self.time_limit, self.max_labels, self.max_memory)
        paths = query.with_fewest_turns(
            lambda graph: pareto_paths(graph, query.start, query.goals, budget=budget, progress=progress)
        )
        if paths.status.is_final:
            claim = f"exact on {query.lattice.words} for ({query.names}), edge costs rounded to their quanta"
        else:
            each = (
                "every point is optimal" if query.tie_broken is None else "no path is better in every cost than a point"
            )
            claim = (
                f"incomplete ({paths.status}): {each} on {query.lattice.words} for ({query.names}), others are missing"
            )
        found = {
            "method": paths.stats.method,
            "labels_generated": paths.stats.labels_generated,
            "labels_expanded": paths.stats.labels_expanded,
            "peak_memory": paths.stats.peak_memory,
        }
        return query.candidates("lattice", paths, claim, stats=found)

    def query(self, problem: Problem, objectives: Objectives, progress: ProgressCallback | None = None) -> LatticeQuery:
        """The lattice, its graph with the objectives' costs, and its ends; raises as :meth:`solve` does."""
        _refuse_who_moves(problem)
        if len(objectives.optimised) > MAX_COSTS:
            raise OptionError(f"the exact search takes at most {MAX_COSTS} costs, got {len(objectives.optimised)}")
        began = time.perf_counter()
        if progress:
            progress(Progress("graph"))
        lattice = self.lattice(problem)
        start, goals, snapped = self.ends(lattice, problem)
        graph = lattice.graph(objectives.optimised)
        return LatticeQuery(lattice, objectives, graph, start, goals, snapped, time.perf_counter() - began)

    def lattice(self, problem: Problem) -> StateLattice:
        """The lattice anchored at the problem's start."""
        anchor = (problem.start[0], problem.start[1])
        return StateLattice(
            problem.model, problem.world, anchor, float(self.step), Headings(self.headings), self.corner_cutting
        )

    def _heading(self, yaw: float, what: str) -> int:
        headings = Headings(self.headings)
        nearest, gap = headings.nearest(yaw)
        if gap > HEADING_TOLERANCE:
            order = np.argsort(np.abs((headings.yaw - yaw + math.pi) % (2 * math.pi) - math.pi))[:2]
            names = " or ".join(f"{headings.yaw[i]:.6f} ({math.degrees(headings.yaw[i]):.2f} deg)" for i in order)
            raise QueryError(
                f"the {what} heading {yaw:.6f} rad ({math.degrees(yaw):.2f} deg) is not one of the lattice's "
                f"{self.headings}; the nearest are {names}"
            )
        return nearest

    def ends(self, lattice: StateLattice, problem: Problem) -> tuple[int, list[int], Snapped]:
        """State ids of the start and of the goal or goals, and where the goal was snapped to."""
        x, y, yaw = problem.start
        heading = self._heading(yaw, "start")
        start = lattice.state(-lattice.first[0], -lattice.first[1], heading)
        if start < 0:
            reason = why_blocked(lattice.model, lattice.world, x, y, yaw) or "the lattice does not reach it"
            raise QueryError(f"the start ({x:.3f}, {y:.3f}) is not usable: {reason}. Move it, or take a smaller robot.")
        gx, gy, goal_yaw = problem.goal
        wanted = range(self.headings) if goal_yaw is None else [self._heading(goal_yaw, "goal")]
        column, row = (gx - x) / self.step, (gy - y) / self.step
        corners = [(math.floor(row) + i, math.floor(column) + j) for i in (0, 1) for j in (0, 1)]
        corners.sort(key=lambda cell: math.hypot(cell[0] - row, cell[1] - column))
        for i, j in corners:
            distance = self.step * math.hypot(i - row, j - column)
            ids = [lattice.state(i - lattice.first[0], j - lattice.first[1], h) for h in wanted]
            ids = [one for one in ids if one >= 0 and self._joined(lattice, one, gx, gy)]
            if ids and distance <= self.step / math.sqrt(2) + 1e-9:
                return start, ids, Snapped((gx, gy), (x + j * self.step, y + i * self.step), distance)
        reason = why_blocked(lattice.model, lattice.world, gx, gy, goal_yaw or 0.0)
        remedy = f"{reason}. Move it, or take a smaller robot" if reason else ""
        remedy = (
            remedy or f"no lattice position within {self.step / math.sqrt(2):.3f} m can reach it; take a smaller step"
        )
        raise QueryError(f"the goal ({gx:.3f}, {gy:.3f}) is not usable: {remedy}.")

    @staticmethod
    def _joined(lattice: StateLattice, state: int, x: float, y: float) -> bool:
        """Whether the robot could slide from a state straight to (x, y): a goal is not snapped through a wall."""
        start = lattice.states(np.array([state]))
        end = States(x=np.array([x]), y=np.array([y]), yaw=start.yaw)
        law = lattice.model.laws["move"]
        return bool(lattice.collision.motions_free(Motions(lattice.world, lattice.model, law, start, end))[0])


def _refuse_who_moves(problem: Problem) -> None:
    """Raise QueryError that names people who move: the lattice has no time, so it cannot tell where they will be."""
    people = problem.world.content.people
    moving = [person.name or f"number {i}" for i, person in enumerate(people) if person.moves]
    if moving:
        raise QueryError(
            f"the lattice has no time, so it cannot tell where people who move will be: {', '.join(moving)}. Give them "
            "no velocity to plan round where they are now, or leave them out and evaluate the criteria on the front's "
            "trajectories, in the world with them."
        )


class Snapped(NamedTuple):
    """Where the goal was moved to: asked for and taken, (x, y) m, and the distance between, m."""

    asked: tuple[float, float]
    taken: tuple[float, float]
    distance: float

    @property
    def notes(self) -> tuple[str, ...]:
        """A note, if it was moved at all."""
        if self.distance <= 1e-6:
            return ()
        asked, taken = (f"({x:.3f}, {y:.3f})" for x, y in (self.asked, self.taken))
        return (f"the goal {asked} was snapped to {taken}, {self.distance:.3f} m away",)


@dataclass(frozen=True, eq=False)
class LatticeQuery:
    """A problem on a lattice, for whichever search: what to search, and what is said of the result.

    graph          integer costs in quanta of ``objectives.optimised``
    start, goals   state ids
    snapped        where the goal was snapped to
    build_seconds  s
    """

    lattice: StateLattice
    objectives: Objectives
    graph: Graph
    start: int
    goals: list[int]
    snapped: Snapped
    build_seconds: float

    @property
    def names(self) -> str:
        """The optimised criteria, in words."""
        return ", ".join(criterion.name for criterion in self.objectives.optimised)

    @property
    def quanta(self) -> FloatArray:
        """What one count of each cost is, (k,), in the criteria's units."""
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

    @cached_property
    def tie_broken(self) -> Graph | None:
        """The graph with turns as a last tie-break, where no cost charges for every turn; None where one does.

        Ties would else be broken by spinning as well as by not. The first summed cost becomes cost * TIE_TURNS + turns.
        """
        graph, count = self.graph, self.lattice.headings.count
        tails = np.repeat(np.arange(graph.nodes), np.diff(graph.indptr))
        turns = tails // count == graph.heads // count
        summed = _summed(graph)
        if not summed or not turns.any() or (graph.costs[turns][:, summed].min(axis=0) > 0).any():
            return None
        costs = graph.costs.copy()
        costs[:, summed[0]] = costs[:, summed[0]] * TIE_TURNS + turns
        try:
            return replace(graph, costs=costs)
        except GraphError:  # sums would overflow: the lattice is too large for a tie-break
            return None

    def with_fewest_turns(self, search: Callable[[Graph], ParetoPaths]) -> ParetoPaths:
        """Search, and of paths with equal costs keep one with the fewest turns, also where no cost charges for them.

        A search that ends by itself loses nothing: what differs in the turns alone is dropped afterwards. One that is
        stopped may keep a point that ties with a better one in the first summed cost.
        """
        if self.tie_broken is None:
            return search(self.graph)
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
    ) -> Candidates:
        """Paths as the candidates of the planner ``name``: each with its provenance, all with a claim and counts."""
        objectives, lattice = self.objectives, self.lattice
        nodes: list[IntArray] = [paths.nodes(i) for i in range(len(paths.costs))]
        # A sum is rounded once an edge, a worst edge once.
        summed = np.array([criterion.aggregate != "max" for criterion in objectives.optimised])
        rounds = np.where(summed, np.array([[max(1, n.size - 1)] for n in nodes]).reshape(-1, 1), 1)
        blocked = (what_separates(lattice, self.start, self.goals),) if paths.status is Status.NO_PATH else ()
        origins = provenance or [{} for _ in nodes]
        return Candidates(
            objectives=objectives.optimised,
            trajectories=tuple(lattice.trajectory(n) for n in nodes),
            planned=paths.costs * self.quanta,
            tolerance=rounds * self.quanta,
            status=paths.status,
            certificate=f"{name}: {claim}{objectives.certificate}",
            provenance=tuple(
                {
                    "planner": name,
                    **self.lattice.options,
                    "goal_offset": self.snapped.distance,
                    "edges": int(n.size - 1),
                    **origin,
                }
                for n, origin in zip(nodes, origins, strict=True)
            ),
            notes=(*objectives.notes, *self.snapped.notes, *blocked, *self._coarse(paths, rounds), *notes),
            filters=objectives.filters,
            stats={
                "planner": name,
                "states": lattice.size,
                "edges": int(self.graph.heads.size),
                "build_seconds": self.build_seconds,
                **(stats or {}),
                "bounds_seconds": paths.stats.seconds_bounds,
                "search_seconds": paths.stats.seconds_search,
            },
        )

    def _coarse(self, paths: ParetoPaths, rounds: IntArray) -> list[str]:
        """A note on each cost whose rounding, edge by edge, may be more than a hundredth of what it tells apart."""
        if not len(paths):
            return []
        error = 0.5 * rounds.max(axis=0) * self.quanta
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
