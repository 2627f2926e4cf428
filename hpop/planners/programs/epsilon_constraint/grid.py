"""The grid of bounds of the epsilon-constraint method, and the order in which its cells are solved.

A cell is a set of bounds, one for each cost. AUGMECON (Mavrotas 2009; Mavrotas and Florios 2013) lays a grid over the
ranges of the bounded costs. This grid has a cell for each warm start instead, bounded by its costs, and further cells
with bounds between these costs and the next better ones.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from hpop.base.arrays import BoolArray, FloatArray
from hpop.criteria.base import Criterion, index_of_role
from hpop.errors import OptionError, did_you_mean
from hpop.planners.judgement import exceeds
from hpop.planners.needs import one_goal, start_of
from hpop.planners.objectives import integral_of
from hpop.planners.programs.nlp import minimised, smooth_indices
from hpop.planners.programs.polyline import Polyline

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

SLACK = 1e-6  # m by which free space is enlarged, so that a path along its border lies inside
ROUNDING = 1e-6  # m⁴: a product of two areas below it counts as 0, so that a line along a side is a tangent
MOST_CORNERS = 5000  # largest number of corners of free space; with more, only the straight line bounds the length


def least_length(problem: Problem) -> float:
    """Return a length, m, that every trajectory from the start to the goal has at least.

    The shortest path of a disc among polygons turns only at corners of the free space of its axis (Lozano-Perez and
    Wesley 1979, doi 10.1145/359156.359164). Here the arcs of that space are replaced by their chords, and parts of the
    robot other than discs on the axis are left out. Both only enlarge the space, so the result is a lower bound.

    Raises QueryError for several goals.
    """
    start, goal = np.array(start_of(problem)[:2]), np.array(one_goal(problem, "a bound of the length")[:2])
    bounds = [math.dist(start, goal)]
    for part in problem.model.platform:
        if part.on_axis:
            free = problem.world.free_space((part.z_min, part.z_max)).region
            space = shapely.buffer(shapely.buffer(free, -part.radius, quad_segs=4), SLACK, join_style="mitre")
            bounds.append(_shortest(space, start, goal))
    return max(bounds)


def _shortest(space: shapely.Geometry, start: FloatArray, goal: FloatArray) -> float:
    """Return the length, m, of the shortest path in a region; 0 if there is none, or the region has too many corners.

    This is A* from corner to corner, along lines that touch the corners at both ends as tangents. A line is checked for
    leaving the region only when the search takes it from the queue.
    """
    corners, before, after = _corners(space)
    if len(corners) > MOST_CORNERS:
        return 0.0
    points = np.concatenate([[start, goal], corners])
    before, after = (
        np.concatenate([np.zeros((2, 2)), sides]) for sides in (before, after)
    )  # any line is a tangent at start and goal
    left = np.hypot(*(points - goal).T)
    done = np.zeros(len(points), np.bool_)
    queue = [(float(left[0]), 0.0, 0, 0)]
    shapely.prepare(space)
    while queue:
        _, length, u, v = heapq.heappop(queue)
        if done[v] or (u != v and not shapely.covers(space, shapely.linestrings(points[[u, v]]))):
            continue
        if v == 1:
            return length
        done[v] = True
        ahead = points - points[v]
        taut = ~done & _tangent(ahead, before, after) & _tangent(ahead, before[v], after[v])
        longer = length + np.hypot(*ahead.T)
        for w in np.flatnonzero(taut).tolist():
            heapq.heappush(queue, (float(longer[w] + left[w]), float(longer[w]), v, w))
    return 0.0


def _corners(space: shapely.Geometry) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the reflex vertices (n, 2) of a region, where a shortest path may turn.

    Also return the sides before and after each of them, as vectors (n, 2), in the direction of the border.
    """
    rows = [np.zeros((0, 3, 2))]
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(space))):  # the region is to the right of each
        points = shapely.get_coordinates(ring)[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        rows.append(np.stack([points, before, after], axis=1)[_cross(before, after) > 0])
    points, before, after = np.concatenate(rows).transpose(1, 0, 2)
    return points, before, after


def _tangent(ahead: FloatArray, before: FloatArray, after: FloatArray) -> BoolArray:
    """Return whether lines in directions ``ahead`` (n, 2) are tangents of a corner, so that a shortest path can turn.

    They are if both sides of the corner lie on one side of the line. ``before`` (n, 2) is the vector along the side
    that leads to the corner, ``after`` (n, 2) that along the side that leads away from it.
    """
    return _cross(ahead, before) * _cross(ahead, after) <= ROUNDING


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


LOOSE = 2e-4  # relative: costs that differ by less count as equal; bounds are loosened by it, for the solver
WAVE = 8  # least number of cells in a wave, whatever the number of workers


@dataclass(frozen=True)
class Roles:
    """Roles of the k costs: one is minimised, other smooth ones are bounded in programs, and the rest are counts.

    Counts of moves and turns follow from the number of segments, which a program does not change.

    criteria  k criteria
    minimise  index of the minimised cost
    smooth    indices of the costs with a gradient
    """

    criteria: tuple[Criterion, ...]
    minimise: int
    smooth: tuple[int, ...]

    @classmethod
    def of(cls, criteria: Sequence[Criterion], minimise: str | None, problem: Problem) -> Roles:
        """Return the roles of criteria, with ``minimise`` as the name of the cost to minimise.

        Without a name, the length is minimised, or else the first smooth cost. Raises the errors of
        :func:`smooth_indices` and :func:`minimised`.
        """
        smooth = smooth_indices(criteria, problem, "epsilon-constraint")
        if minimise is not None:
            return cls(tuple(criteria), minimised(minimise, criteria), smooth)
        length = index_of_role("length", criteria)
        return cls(tuple(criteria), length if length in smooth else smooth[0], smooth)

    @property
    def counted(self) -> list[int]:
        """Indices of the costs that only count moves and turns."""
        return [j for j in range(len(self.criteria)) if j not in self.smooth]

    @property
    def bounded(self) -> list[int]:
        """Indices of all costs but the minimised one."""
        return [j for j in range(len(self.criteria)) if j != self.minimise]

    def limits(self, epsilon: Mapping[str, float], problem: Problem) -> FloatArray:
        """Return the bounds (k,) that the option ``epsilon`` gives by name; inf for costs that it does not name.

        Raises OptionError for unknown names, and for bounds that no trajectory from start to goal can keep.
        """
        names = [criterion.name for criterion in self.criteria]
        unknown = sorted(str(name) for name in epsilon if name not in names)
        if unknown:
            means = {mean.name: integral_of(mean).name for mean in problem.criteria if mean.aggregate == "time-mean"}
            hints = (
                f" {name} is a mean, which does not add up, so {means[name]} is planned instead: bound {means[name]}."
                if name in means
                else did_you_mean(name, names)
                for name in unknown
            )
            raise OptionError(
                f"epsilon must bound criteria by their names, got {', '.join(unknown)}.{''.join(hints)} "
                f"The criteria are {', '.join(names)}"
            )
        limits = np.array([epsilon.get(name, np.inf) for name in names], float)
        least = np.array([_least(c, problem) if c.name in epsilon else 0.0 for c in self.criteria])
        for j in np.flatnonzero(exceeds(least, limits, self.criteria)):
            unit = f" {self.criteria[j].unit}".removesuffix(" 1")
            raise OptionError(
                f"epsilon bounds {names[j]} by {limits[j]:g}{unit}, but every trajectory from start to goal has at "
                f"least {least[j]:.6g}{unit}, and even the best may have more; give a larger bound"
            )
        return limits


def _least(criterion: Criterion, problem: Problem) -> float:
    """Return a lower bound of a cost, valid for any path from the start to any of the goals; 0 if none is known."""
    if index_of_role("length", [criterion]) is not None:
        return least_length(problem)
    bound = criterion.bound
    if bound is None:
        return 0.0
    # Angles that are free are NaN, and so are bounds that depend on them.
    space = problem.model.space
    start, *goals = (space.state(end, free=space.angles) for end in (problem.start, *problem.goals))
    return min(float(np.nan_to_num(bound(start, goal)[0])) for goal in goals)


@dataclass(frozen=True, eq=False)
class FreePolyline:
    """Polyline that is free of collisions, with its exact costs (k,)."""

    polyline: Polyline
    costs: FloatArray


@dataclass(frozen=True, eq=False)
class Cell:
    """Cell of the grid: a set of bounds on the costs, made from the costs of a warm start.

    epsilon  (k,) bounds
    of       index of the warm start
    level    0 if the bounds are the costs of the warm start; higher for tighter bounds
    """

    epsilon: FloatArray
    of: int
    level: int


@dataclass(frozen=True, eq=False)
class CellCandidate:
    """Candidate found within the bounds of a cell.

    solved      polyline with exact costs
    planned     (k,) costs of its polyline, smooth ones over the pieces of segments
    provenance  how it was found, for the front
    """

    cell: Cell
    solved: FreePolyline
    planned: FloatArray
    provenance: dict[str, Any]


@dataclass(eq=False)
class Grid:
    """Grid of bounds made from the costs of n warm starts, with the candidates found so far.

    roles       which cost is minimised, and which costs are bounded
    warm        warm starts; their costs are the bounds of level 0
    limits      (k,) bounds that hold in all cells
    divisions   number of further levels between the cost of a warm start and the next better one
    candidates  candidates found so far
    infeasible  cells that turned out to have no candidate
    """

    roles: Roles
    warm: Sequence[FreePolyline]
    limits: FloatArray
    divisions: int
    candidates: list[CellCandidate] = field(default_factory=list)
    infeasible: list[Cell] = field(default_factory=list)

    @cached_property
    def costs(self) -> FloatArray:
        """Costs (n, k) of the warm starts."""
        return np.array([polyline.costs for polyline in self.warm])

    @cached_property
    def levels(self) -> list[list[Cell]]:
        """Cells by level; in each level, those with the loosest bounds come first.

        Level 0 has a cell for each warm start, with its costs as bounds. In each higher level, a warm start has a cell
        for each smooth cost except the minimised one: the bound of this cost is level / (divisions + 1) of the way to
        the next better cost of another warm start. The other bounds stay, and the minimised cost has none.
        """
        levels: list[list[Cell]] = [[] for _ in range(self.divisions + 1)]
        for i, row in enumerate(self.costs):
            levels[0].append(Cell(np.minimum(row, self.limits), i, 0))
            for j in set(self.roles.smooth) - {self.roles.minimise}:
                below = self.costs[self.costs[:, j] < row[j] - LOOSE * abs(row[j]), j]
                for level in range(1, self.divisions + 1 if below.size else 1):
                    bound = row.copy()
                    bound[j] += (below.max() - row[j]) * level / (self.divisions + 1)
                    bound[self.roles.minimise] = np.inf
                    levels[level].append(Cell(np.minimum(bound, self.limits), i, level))
        span, bounded = np.maximum(np.ptp(self.costs, axis=0), 1e-9), self.roles.bounded
        return [sorted(cells, key=lambda c: -float((c.epsilon / span)[bounded].sum())) for cells in levels]

    def wave(self, cells: Sequence[Cell]) -> list[Cell]:
        """Choose the cells that are solved next, at the same time.

        The choice avoids solving cells in vain: a candidate of one cell should rarely keep the bounds of another one in
        the wave. Programs do not change counts of turns, so this is rare for cells with different bounds on counts. A
        wave has the loosest cell for each combination of bounds on counts. If there are fewer combinations than WAVE,
        it has more cells of each, evenly spaced in the order of ``cells``.
        """
        groups: dict[tuple[float, ...], list[Cell]] = {}
        for cell in cells:
            groups.setdefault(tuple(cell.epsilon[self.roles.counted]), []).append(cell)
        share = -(-WAVE // max(1, len(groups)))
        return [cell for group in groups.values() for cell in group[:: -(-len(group) // share)]]

    def unanswered(self, cells: Sequence[Cell]) -> list[Cell]:
        """Return the cells that still have to be solved.

        A cell can be skipped if a candidate found for looser bounds also keeps the bounds of this cell, or if looser
        bounds from the same warm start were infeasible.
        """
        bounded = self.roles.bounded
        left = [cell for cell in cells if not self._hopeless(cell)]
        for candidate in self.candidates:
            if left:
                epsilon = np.array([cell.epsilon for cell in left])
                looser = (candidate.cell.epsilon[bounded] >= epsilon[:, bounded]).all(axis=1)
                within = (candidate.solved.costs <= epsilon).all(axis=1)
                left = [left[i] for i in np.flatnonzero(~(looser & within))]
        return left

    def _hopeless(self, cell: Cell) -> bool:
        """Return whether a cell of the same warm start was infeasible, with no bound tighter than those of this cell.

        False at level 0.
        """
        return cell.level > 0 and any(
            cell.of == failed.of and (cell.epsilon <= failed.epsilon).all() for failed in self.infeasible
        )

    def start(self, cell: Cell) -> FreePolyline | None:
        """Return the polyline from which the search in a cell starts.

        It is the cell's warm start if that keeps the bounds. Else it is the warm start or candidate that exceeds the
        bounds least, and among equals the one with the least minimised cost. The result is None if all of them exceed
        the bound of a count, which no program changes.
        """
        if not exceeds(self.warm[cell.of].costs, cell.epsilon, self.roles.criteria).any():
            return self.warm[cell.of]
        polylines = [*self.warm, *(candidate.solved for candidate in self.candidates)]
        costs = np.array([polyline.costs for polyline in polylines])
        over = np.maximum(costs - cell.epsilon, 0.0) / np.maximum(np.ptp(costs, axis=0), 1e-9)
        beyond = (over[:, self.roles.counted] > 0).any(axis=1)
        nearest = polylines[int(np.lexsort((costs[:, self.roles.minimise], over.sum(axis=1), beyond))[0])]
        fits = not exceeds(nearest.costs, cell.epsilon, self.roles.criteria)[self.roles.counted].any()
        return nearest if fits else None
