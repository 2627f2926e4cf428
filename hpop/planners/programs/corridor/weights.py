"""Optima of one corridor for weighted sums of costs: first each cost alone, then given weights or a dichotomy.

A corridor is a sequence of convex free regions (:mod:`.corridor`). The dichotomy, for two costs, takes weights normal
to the line through two neighbouring points of the front, again and again.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.planners.programs import Deadline
from hpop.planners.programs.corridor.corridor import Corridor
from hpop.planners.programs.corridor.program import CorridorProgram
from hpop.planners.programs.polyline import Polyline
from hpop.runtime.limits import LimitPassed
from hpop.world import World

if TYPE_CHECKING:
    from hpop.models.base import PlanarModel

SMALL = 1e-4  # added to every weight of a normalised cost, so that none is zero
GAP = 0.01  # largest gap to the front, in the normalised weighted sum, at which the dichotomy ends
CONSTANT = 1e-6  # relative: a cost that differs by less among the individual optima counts as constant
SAME = 1e-6  # m: nearer vertices count as equal


@dataclass(frozen=True, eq=False)
class Shared:
    """Data that the jobs of all corridors share.

    criteria  k convex criteria
    weights   vectors (k,) of weights for the normalised costs, or None for the dichotomy
    solvers   cvxpy's names of solvers, in the order in which they are tried
    deadline  time after which no further program is solved
    """

    world: World
    model: PlanarModel
    criteria: tuple[Criterion, ...]
    weights: tuple[tuple[float, ...], ...] | None
    solvers: tuple[str, ...]
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)


@dataclass(eq=False)
class CorridorPoints:
    """Optima of one corridor for weighted sums of costs.

    polylines      n different polylines
    costs          (n, k) costs as the program computes them
    exact          (k,) whether the program has the cost itself, not an upper bound of it
    weights        for each polyline, the weights of normalised costs for which it is optimal
    ideal, nadir   (k,) least and greatest of each cost among the optima of single costs; empty if one is missing
    solved         number of programs that each solver solved
    failed         number of failed solves, by solver and reason
    unsolved       number of programs that no solver solved
    is_cut_short   whether the time ran out before the programs of all weight vectors were solved
    build_seconds  s, for building and compiling
    solve_seconds  s, for everything else
    """

    polylines: list[Polyline] = field(default_factory=list)
    costs: list[FloatArray] = field(default_factory=list)
    exact: tuple[bool, ...] = ()
    weights: list[list[tuple[float, ...]]] = field(default_factory=list)
    ideal: FloatArray = field(default_factory=lambda: np.empty(0))
    nadir: FloatArray = field(default_factory=lambda: np.empty(0))
    solved: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)
    unsolved: int = 0
    is_cut_short: bool = False
    build_seconds: float = 0.0
    solve_seconds: float = 0.0


def solve_corridor(shared: Shared, corridor: Corridor) -> CorridorPoints:
    """Compile the convex program of one corridor, and return its optima for all weight vectors; this is one job."""
    began = time.perf_counter()
    program = CorridorProgram(corridor, shared.criteria, shared.world, shared.model, shared.solvers)
    program.compile()
    built = time.perf_counter()
    weighted = _Weighted(program, shared.deadline)
    try:
        weighted.run(shared.weights)
    except LimitPassed:
        weighted.points.is_cut_short = True
    points = weighted.points
    points.exact = tuple(cost.exact for cost in program.costs)
    points.solved, points.failed = program.solved, program.failed
    points.build_seconds, points.solve_seconds = built - began, time.perf_counter() - built
    return points


@dataclass(eq=False)
class _Weighted:
    """Solver of one corridor's program for one vector of weights after another.

    vertices  vertices of the polylines found so far
    """

    program: CorridorProgram
    deadline: Deadline = Deadline()  # noqa: RUF009  (frozen)
    points: CorridorPoints = field(default_factory=CorridorPoints)
    vertices: list[FloatArray] = field(default_factory=list)

    def run(self, weights: tuple[tuple[float, ...], ...] | None) -> CorridorPoints:
        """Solve for each cost alone, then for all other vectors of weights; return the optima found.

        Weights are of normalised costs: each cost is divided by its range over the optima of the costs alone, or by
        its value on the warm start if that range is negligible. If ``weights`` is None, the vectors for two costs are
        chosen by dichotomy, if neither range is negligible. If no solver finds the optimum of a cost alone, only the
        optima of the other costs are returned.
        """
        k = len(self.program.criteria)
        warm = self.program.evaluate(self.program.base)
        units = [tuple(float(i == j) for i in range(k)) for j in range(k)]
        self.scale = np.where(warm > CONSTANT, warm, 1.0)
        optima = [self._solve(unit) for unit in units]
        if any(costs is None for costs in optima):
            return self.points
        table = np.array(optima)
        self.points.ideal, self.points.nadir = table.min(axis=0), table.max(axis=0)
        ranges = self.points.nadir - self.points.ideal
        traded = ranges > CONSTANT * self.scale
        self.scale = np.where(traded, ranges, self.scale)
        if weights is not None:
            for row in weights:
                share = tuple(w / sum(row) for w in row)
                if share not in units:
                    self._solve(share)
        elif k == 2 and traded.all():
            self._dichotomy(table[0], table[1])
        return self.points

    def _dichotomy(self, first: FloatArray, last: FloatArray) -> None:
        """Fill the front of two costs between two optima, with costs ``first`` and ``last`` (2,) (Cohon 1978).

        Weights are taken normal to the line through two neighbouring points. If their optimum lies more than GAP below
        this line, the intervals on both sides of it are treated likewise.
        """
        waiting = [(first, last)]
        while waiting:
            a, b = waiting.pop()
            normal = np.abs((a - b)[::-1] / self.scale[::-1])
            normal = normal / normal.sum()
            costs = self._solve(tuple(normal.tolist()))
            if costs is not None and float(normal @ ((a - costs) / self.scale)) > GAP:
                waiting += [(a, costs), (costs, b)]

    def _solve(self, weights: tuple[float, ...]) -> FloatArray | None:
        """Solve for one vector of weights, record the optimum and return its costs (k,); None if no solver succeeds."""
        self.deadline.check("a convex program was solved")
        positive = (np.array(weights) + SMALL) / self.scale
        vertices = self.program.solve(positive)
        if vertices is None:
            self.points.unsolved += 1
            return None
        vertices = self.program.tidied(vertices, positive)
        costs = self.program.evaluate(vertices)
        for i, earlier in enumerate(self.vertices):
            if np.abs(earlier - vertices).max() <= SAME:
                self.points.weights[i].append(weights)
                return costs
        self.vertices.append(vertices)
        self.points.polylines.append(self.program.polyline(vertices))
        self.points.costs.append(costs)
        self.points.weights.append([weights])
        return costs
