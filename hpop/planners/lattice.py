"""The lattice planner: every optimal trade-off on an SE(2) lattice, exactly."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.arrays import FloatArray, IntArray
from hpop.errors import OptionError, QueryError
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
        paths = pareto_paths(query.graph, query.start, query.goals, budget=budget, progress=progress)
        if paths.status.is_final:
            claim = f"exact on this lattice for ({query.names}), edge costs rounded to their quanta"
        else:
            claim = (
                f"incomplete ({paths.status}): every point is optimal on this lattice for ({query.names}), others are "
                "missing"
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
        start, goals, notes = self.ends(lattice, problem)
        graph = lattice.graph(objectives.optimised)
        return LatticeQuery(lattice, objectives, graph, start, goals, notes, time.perf_counter() - began)

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

    def ends(self, lattice: StateLattice, problem: Problem) -> tuple[int, list[int], tuple[str, ...]]:
        """State ids of the start and of the goal or goals, and a note on how far the goal was snapped."""
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
                at = f"({x + j * self.step:.3f}, {y + i * self.step:.3f})"
                note = f"the goal ({gx:.3f}, {gy:.3f}) was snapped to {at}, {distance:.3f} m away"
                return start, ids, (note,) if distance > 1e-6 else ()
        reason = why_blocked(lattice.model, lattice.world, gx, gy, goal_yaw or 0.0)
        reason = (
            reason or f"no lattice position within {self.step / math.sqrt(2):.3f} m can reach it; take a smaller step"
        )
        raise QueryError(f"the goal ({gx:.3f}, {gy:.3f}) is not usable: {reason}. Move it, or take a smaller robot.")

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


@dataclass(frozen=True, eq=False)
class LatticeQuery:
    """A problem on a lattice, for whichever search: what to search, and what is said of the result.

    graph          integer costs in quanta of ``objectives.optimised``
    start, goals   state ids
    notes          how far the goal was snapped
    build_seconds  s
    """

    lattice: StateLattice
    objectives: Objectives
    graph: Graph
    start: int
    goals: list[int]
    notes: tuple[str, ...]
    build_seconds: float

    @property
    def names(self) -> str:
        """The optimised criteria, in words."""
        return ", ".join(criterion.name for criterion in self.objectives.optimised)

    @property
    def quanta(self) -> FloatArray:
        """What one count of each cost is, (k,), in the criteria's units."""
        return np.array([criterion.quantum for criterion in self.objectives.optimised])

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
                {"planner": name, "edges": int(n.size - 1), **origin} for n, origin in zip(nodes, origins, strict=True)
            ),
            notes=(*objectives.notes, *self.notes, *blocked, *notes),
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
