"""The grid of bounds of the epsilon-constraint method: which are tried, which together, and which are answered.

AUGMECON (Mavrotas 2009; Mavrotas and Florios 2013) lays a grid over the ranges of the bounded costs. This one spans
what is known instead: a bound for each known trade-off, and some down to the next better one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion, place_of
from hpop.errors import OptionError, did_you_mean
from hpop.planners.judgement import exceeds
from hpop.planners.objectives import integral_of
from hpop.planners.polylines.polyline import Polyline
from hpop.planners.programs.criteria import minimised, smooth_places
from hpop.planners.programs.epsilon_constraint.least_length import least_length

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

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
        length = place_of("length", criteria)
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
    if place_of("length", [criterion]) is not None:
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
