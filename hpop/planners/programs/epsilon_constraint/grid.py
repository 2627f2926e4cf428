"""The grid of bounds of the epsilon-constraint method: which are tried, which together, and which are answered.

AUGMECON (Mavrotas 2009; Mavrotas and Florios 2013) lays a grid over the ranges of the bounded costs. This one spans
what is known instead: a bound for each known trade-off, and some down to the next better one.
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
from hpop.planners.programs.criteria import minimised, smooth_places
from hpop.planners.programs.polyline import Polyline

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

SLACK = 1e-6  # m, by which free space is grown, so that a way along its border lies in it
ROUNDING = 1e-6  # m4, of a product of two areas: a line along a side is a tangent
MOST_CORNERS = 5000  # of free space; where there are more, nothing but the straight line is known


def least_length(problem: Problem) -> float:
    """A lower bound, m, of the length of trajectories from start to goal.

    The shortest way of a disc among polygons turns only at corners of the free space of its axis (Lozano-Perez and
    Wesley 1979, doi 10.1145/359156.359164). The arcs of that space are replaced by their chords, which makes it larger,
    so what is found is a bound. Parts that are no discs on the axis are left out, which makes it a lower one.
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
    """The length of the shortest way in a region; 0 where there is none, or the region has too many corners.

    A* from corner to corner, along lines that are tangents at both ends; whether one sees the other is asked when it
    would be next.
    """
    corners, before, after = _corners(space)
    if len(corners) > MOST_CORNERS:
        return 0.0
    points = np.concatenate([[start, goal], corners])
    before, after = (np.concatenate([np.zeros((2, 2)), sides]) for sides in (before, after))  # all is tangent at an end
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
    """Vertices (n, 2) of a region at which a way may turn, where the region is on the outer side; sides to and from."""
    found = [np.zeros((0, 3, 2))]
    for ring in shapely.get_rings(shapely.get_parts(shapely.normalize(space))):  # the region is to the right of each
        points = shapely.get_coordinates(ring)[:-1]
        before, after = points - np.roll(points, 1, axis=0), np.roll(points, -1, axis=0) - points
        found.append(np.stack([points, before, after], axis=1)[_cross(before, after) > 0])
    points, before, after = np.concatenate(found).transpose(1, 0, 2)
    return points, before, after


def _tangent(ahead: FloatArray, before: FloatArray, after: FloatArray) -> BoolArray:
    """Whether lines (n, 2) leave both sides of a corner on one side."""
    return _cross(ahead, before) * _cross(ahead, after) <= ROUNDING


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


LOOSE = 2e-4  # relative: costs that differ by less are one; a bound is loosened by it, so that a solver can move
WAVE = 8  # bounds that are tried at once, or more: the same with and without workers


@dataclass(frozen=True)
class Roles:
    """What becomes of each cost: one is minimised, smooth ones are bounded in programs, structures settle the others.

    criteria  k
    minimise  place of the cost that is minimised
    smooth    places of those with a gradient
    """

    criteria: tuple[Criterion, ...]
    minimise: int
    smooth: tuple[int, ...]

    @classmethod
    def of(cls, criteria: Sequence[Criterion], minimise: str | None, problem: Problem) -> Roles:
        """Roles of the optimised criteria; without a name the length is minimised, or the first smooth cost.

        Raises as :func:`smooth_places` and :func:`minimised` do.
        """
        smooth = smooth_places(criteria, problem, "epsilon-constraint")
        if minimise is not None:
            return cls(tuple(criteria), minimised(minimise, criteria), smooth)
        length = index_of_role("length", criteria)
        return cls(tuple(criteria), length if length in smooth else smooth[0], smooth)

    @property
    def counted(self) -> list[int]:
        """Places of the costs that a structure settles."""
        return [j for j in range(len(self.criteria)) if j not in self.smooth]

    @property
    def bounded(self) -> list[int]:
        """Places of all costs but the one that is minimised."""
        return [j for j in range(len(self.criteria)) if j != self.minimise]

    def limits(self, epsilon: Mapping[str, float], problem: Problem) -> FloatArray:
        """Bounds (k,) from bounds by name; raises OptionError for a name that is not there and what cannot be kept."""
        names = [criterion.name for criterion in self.criteria]
        unknown = sorted(str(name) for name in epsilon if name not in names)
        if unknown:
            means = {mean.name: integral_of(mean).name for mean in problem.criteria if mean.aggregate == "time-mean"}
            hints = (
                f" {name} is a mean and does not add up, so {means[name]} stands in for it: bound that."
                if name in means
                else did_you_mean(name, names)
                for name in unknown
            )
            raise OptionError(
                f"epsilon bounds {', '.join(unknown)}, which is no objective.{''.join(hints)} "
                f"These are {', '.join(names)}"
            )
        limits = np.array([epsilon.get(name, np.inf) for name in names], float)
        least = np.array([_least(c, problem) if c.name in epsilon else 0.0 for c in self.criteria])
        for j in np.flatnonzero(exceeds(least, limits, self.criteria)):
            unit = f" {self.criteria[j].unit}".removesuffix(" 1")
            raise OptionError(
                f"epsilon bounds {names[j]} by {limits[j]:g}{unit}, but no trajectory from start to goal has less than "
                f"{least[j]:.6g}{unit}; give more than that"
            )
        return limits


def _least(criterion: Criterion, problem: Problem) -> float:
    """The least that a criterion is known to cost between start and goal, whatever the way."""
    if index_of_role("length", [criterion]) is not None:
        return least_length(problem)
    bound = criterion.bound
    if bound is None:
        return 0.0
    # What depends on a heading that is free is not known.
    space = problem.model.space
    start, *goals = (space.state(end, free=space.angles) for end in (problem.start, *problem.goals))
    return min(float(np.nan_to_num(bound(start, goal)[0])) for goal in goals)


@dataclass(frozen=True, eq=False)
class Known:
    """A trajectory that is free, with its exact costs (k,)."""

    polyline: Polyline
    costs: FloatArray


@dataclass(frozen=True, eq=False)
class Cell:
    """Bounds (k,) that are tried; ``of`` is the warm start they come from, ``level`` 0 for its own costs."""

    epsilon: FloatArray
    of: int
    level: int


@dataclass(frozen=True, eq=False)
class Found:
    """A candidate: the cell that it answers, what it is, its costs (k,) as planned, and how it came about."""

    cell: Cell
    known: Known
    planned: FloatArray
    provenance: dict[str, Any]


@dataclass(eq=False)
class Grid:
    """Bounds over what is known, and what has come of them.

    roles
    warm        known trajectories whose costs the bounds are made of
    limits      (k,) bounds that hold throughout
    divisions   count of further bounds between a known cost and the next better one
    found       candidates, in the order of their cells
    infeasible  cells for which there is none
    """

    roles: Roles
    warm: Sequence[Known]
    limits: FloatArray
    divisions: int
    found: list[Found] = field(default_factory=list)
    infeasible: list[Cell] = field(default_factory=list)

    @cached_property
    def costs(self) -> FloatArray:
        """Costs (n, k) of the warm starts."""
        return np.array([known.costs for known in self.warm])

    @cached_property
    def levels(self) -> list[list[Cell]]:
        """Cells level by level, each loosest first: the warm starts' own costs, then down to the next better ones."""
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
        """Some cells to be tried together, which hardly ever answer one another.

        A structure's counts are given, so an answer is one for cells of other counts only if it lost a turn. Hence the
        loosest cell of each count; if that makes fewer than WAVE, more of each, evenly spaced.
        """
        groups: dict[tuple[float, ...], list[Cell]] = {}
        for cell in cells:
            groups.setdefault(tuple(cell.epsilon[self.roles.counted]), []).append(cell)
        share = -(-WAVE // max(1, len(groups)))
        return [cell for group in groups.values() for cell in group[:: -(-len(group) // share)]]

    def unanswered(self, cells: Sequence[Cell]) -> list[Cell]:
        """Cells without those that looser bounds have answered within them, or shown to have no answer."""
        bounded = self.roles.bounded
        left = [cell for cell in cells if not self._hopeless(cell)]
        for answer in self.found:
            if left:
                epsilon = np.array([cell.epsilon for cell in left])
                looser = (answer.cell.epsilon[bounded] >= epsilon[:, bounded]).all(axis=1)
                within = (answer.known.costs <= epsilon).all(axis=1)
                left = [left[i] for i in np.flatnonzero(~(looser & within))]
        return left

    def _hopeless(self, cell: Cell) -> bool:
        """Whether a looser bound of the same warm start is infeasible."""
        return cell.level > 0 and any(
            cell.of == failed.of and (cell.epsilon <= failed.epsilon).all() for failed in self.infeasible
        )

    def start(self, cell: Cell) -> Known | None:
        """The nearest known trajectory: the least beyond the bounds, then the least in the cost to minimise.

        None where no known one has counts as low as the bounds are: no program changes them.
        """
        if not exceeds(self.warm[cell.of].costs, cell.epsilon, self.roles.criteria).any():
            return self.warm[cell.of]
        known = [*self.warm, *(answer.known for answer in self.found)]
        costs = np.array([one.costs for one in known])
        over = np.maximum(costs - cell.epsilon, 0.0) / np.maximum(np.ptp(costs, axis=0), 1e-9)
        beyond = (over[:, self.roles.counted] > 0).any(axis=1)
        nearest = known[int(np.lexsort((costs[:, self.roles.minimise], over.sum(axis=1), beyond))[0])]
        fits = not exceeds(nearest.costs, cell.epsilon, self.roles.criteria)[self.roles.counted].any()
        return nearest if fits else None
