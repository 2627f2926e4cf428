"""The supported part of the front, by weighted sums: one exact shortest path for each vector of weights.

Weights are integers, given or derived from the hull of the points found.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import gcd
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import IntArray
from hpop.base.lazy import homes_of, on_first_use
from hpop.base.options import real, whole
from hpop.base.text import shown
from hpop.errors import OptionError

if TYPE_CHECKING:  # imported on first use: numba is slow to import
    from hpop.search.supported import weighted_path as weighted_path


# Let Y be the points found so far. The weights to try next are normals of facets of the polyhedron conv(Y) + R^k_>=. An
# inequality w . y >= b that holds on this polyhedron is a point (w, b) of the cone
#
#     { (w, b) : w_j >= 0 for all j,  w . y - b >= 0 for all y in Y },
#
# and the facets are the extreme rays of this cone. The cone of one point is simplicial, so its rays are known. Each
# further point cuts the cone with a half-space, and the double description method (Motzkin, Raiffa, Thompson and Thrall
# 1953; Fukuda and Prodon 1996) updates the rays: those on the wrong side are dropped, and each pair of adjacent rays on
# different sides gives a new one. Fewer points than dimensions, points in a plane and weights of zero need no special
# cases, unlike in a convex hull in floating point. The facets are the weights of the outer-approximation algorithms of
# Ehrgott, Loehne and Shao (2012) and Boekler and Mutzel (2015); for two costs they are the dichotomy of Aneja and Nair
# (1979).


Vector = tuple[int, ...]


class WeightCone:
    """Facets of the convex hull of a growing set of integer points y and of all larger points, conv(Y) + R^k_>=.

    They are computed by the double description method (see the comment above).

    >>> cone = WeightCone((0, 4))
    >>> cone.add((4, 0))
    >>> sorted(cone.facets())
    [((0, 1), 0), ((1, 0), 0), ((1, 1), 4)]
    """

    def __init__(self, first: Sequence[int]) -> None:
        k = len(first)
        self._count = k + 1  # half-spaces so far: the k signs, then the points
        point = 1 << k
        signs = point - 1
        self._rays: dict[Vector, int] = {}  # ray (w, b) -> the half-spaces on whose border it lies, as bits
        for j in range(k):
            unit = [0] * k
            unit[j] = 1
            self._rays[(*unit, int(first[j]))] = (signs & ~(1 << j)) | point
        self._rays[(*[0] * k, -1)] = signs

    def facets(self) -> list[tuple[Vector, int]]:
        """Return each facet w . y >= b as a pair of its weights w and its right-hand side b.

        Facets that are not cut off by new points stay in the order in which they were found.
        """
        return [(ray[:-1], ray[-1]) for ray in self._rays if any(ray[:-1])]

    def add(self, point: Sequence[int]) -> None:
        """Add a point y to the hull: keep the weights w and bounds b of the cone for which w . y >= b."""
        y = [int(value) for value in point]
        k = len(y)
        bit = 1 << self._count
        self._count += 1
        value = {ray: sum(w * c for w, c in zip(ray, y, strict=False)) - ray[-1] for ray in self._rays}
        rays = {ray: zero | bit if value[ray] == 0 else zero for ray, zero in self._rays.items() if value[ray] >= 0}
        if len(rays) < len(self._rays):
            above = [(ray, zero) for ray, zero in self._rays.items() if value[ray] > 0]
            for low, low_zero in self._rays.items():
                if value[low] >= 0:
                    continue
                for high, high_zero in above:
                    shared = low_zero & high_zero
                    if shared.bit_count() >= k - 1 and self._adjacent(shared, low, high):
                        rays[_ray_on_cut(high, value[high], low, value[low])] = shared | bit
        self._rays = rays

    def _adjacent(self, shared: int, low: Vector, high: Vector) -> bool:
        """Return whether two rays are adjacent: no other ray lies on all borders that they share (``shared``, bits)."""
        return all(zero & shared != shared or ray is low or ray is high for ray, zero in self._rays.items())


def _ray_on_cut(high: Vector, above: int, low: Vector, below: int) -> Vector:
    """Return the ray between two rays on different sides of a half-space's border that lies on the border.

    ``above`` > 0 and ``below`` < 0 are the values of the half-space's inequality at the rays ``high`` and ``low``.
    """
    ray = [above * a - below * b for a, b in zip(low, high, strict=True)]
    divisor = gcd(*ray)
    return tuple(value // divisor for value in ray)


FINEST = 10**6  # largest denominator of weights that users give
MAX_WEIGHTS = 100_000


def simplex_lattice(divisions: int, k: int) -> Iterator[Vector]:
    """Yield all vectors of k non-negative integers that sum to ``divisions``, in lexicographic order.

    >>> list(simplex_lattice(2, 2))
    [(0, 2), (1, 1), (2, 0)]
    """
    if k == 1:
        yield (divisions,)
        return
    for first in range(divisions + 1):
        for tail in simplex_lattice(divisions - first, k - 1):
            yield (first, *tail)


def checked_divisions(value: Any, k: int = 1) -> int:
    """Return the option ``divisions`` if it is valid; raise OptionError if not, or if it gives too many weight vectors.

    With d divisions, the vectors are all those of k weights that are multiples of 1/d and sum to 1.
    """
    divisions = whole("divisions", value, 1, kind="a whole number of steps from weight 0 to weight 1,")
    count = math.comb(divisions + k - 1, k - 1)
    if count > MAX_WEIGHTS:
        raise OptionError(
            f"divisions must give at most {MAX_WEIGHTS:,} vectors of weights, but {divisions} divisions for {k} costs "
            f"give {count:,}; take fewer, or leave divisions out to choose weights adaptively"
        )
    return divisions


def integer_weights(weights: Sequence[float], k: int | None = None) -> Vector:
    """Return the smallest integers in the same proportions as k given weights.

    Weights are first rounded to fractions of the largest one with denominators up to FINEST.

    Raises OptionError for weights that are negative, not finite or all zero, and for another number than k.

    >>> integer_weights([0.1, 0.25, 0])
    (2, 5, 0)
    """
    try:
        values = [real("a weight", w, 0, sys.float_info.max) for w in weights]
    except TypeError:
        raise OptionError(f"weights must be lists of numbers, one for each cost, got {shown(weights)}") from None
    if k is not None and len(values) != k:
        raise OptionError(f"weights must have one number for each of {k} costs, got {len(values)}: {values}")
    if not any(values):
        raise OptionError(f"weights must have at least one number above 0, got {values}")
    fractions = [Fraction(w / max(values)).limit_denominator(FINEST) for w in values]
    return divided_by_gcd([int(f * math.lcm(*(g.denominator for g in fractions))) for f in fractions])


def divided_by_gcd(vector: Sequence[int]) -> Vector:
    """Return a vector of integers divided by their greatest common divisor."""
    divisor = math.gcd(*vector)
    return tuple(v // divisor for v in vector)


NONE = np.zeros(0, np.int64)


class Task(NamedTuple):
    """Task of a worker: find the path with the least weighted sum of costs.

    weights  (k,)  integer weights of the reduced costs
    limit    upper bound of the least weighted sum, by which the search prunes
    blocked  (b,)  arcs of the reduced graph that the path must not use
    """

    weights: Vector
    limit: int
    blocked: IntArray = NONE


@dataclass(frozen=True, eq=False)
class Reduced:
    """Graph for workers, without arcs that reach no target, and with reduced costs that speed up shortest paths.

    The reduced cost of an arc, c(u, v) + h(v) - h(u), with lower bounds h of the remaining costs, is not negative. The
    reduced cost of a path from the source to a target is its cost minus the least possible cost h(source).

    indptr, heads  arcs in compressed rows, see :class:`.Graph`
    costs          (m, k)  reduced costs, in int32 if they fit
    source         node
    is_target      (n,)    mask of nodes
    largest        (k,)    greatest reduced cost of an arc
    """

    indptr: IntArray
    heads: Any
    costs: Any
    source: int
    is_target: Any
    largest: tuple[int, ...]


def solve_weight(data: Reduced, task: Task) -> IntArray:
    """Return the path with the least weighted sum, as indices of arcs in the reduced graph; this is a worker's job."""
    arcs = least_path(data, task, lambda kernel, *arguments: kernel(*arguments))
    if arcs is None:
        raise AssertionError(
            f"a path within the limit of {task} must exist, but none was found; please report this bug"
        )
    return arcs


def least_path(data: Reduced, task: Task, call: Any) -> IntArray | None:
    """Return the path with the least weighted sum, as indices of arcs, or None if no path is within the task's limit.

    data  graph with reduced costs, to which the indices refer
    task  weights, limit, and the arcs that the path must not use
    call  function that calls a kernel with its arguments
    """
    from hpop.search.supported import weighted_path as kernels  # numba is slow to import

    weights, limit = kernels.encoded(task.weights, task.limit, data.largest)
    heads = data.heads
    if task.blocked.size:  # they become loops, which no shortest path uses
        heads = heads.copy()
        heads[task.blocked] = np.searchsorted(data.indptr, task.blocked, side="right") - 1
    ends = data.source, data.is_target
    arcs: IntArray = call(kernels.weighted_path, data.indptr, heads, data.costs, *ends, weights, limit)
    return None if arcs.size and arcs[0] < 0 else arcs


__getattr__ = on_first_use(__name__, homes_of(__name__))
