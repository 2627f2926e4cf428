"""Weights as they are given: lists of numbers, or the simplex lattice, as whole numbers in the same proportions."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any

from hpop.base.options import real, whole
from hpop.base.text import shown
from hpop.errors import OptionError
from hpop.search.supported.weight_cone import Vector

FINEST = 10**6  # denominators of given weights
MAX_WEIGHTS = 100_000


def simplex_lattice(divisions: int, k: int) -> Iterator[Vector]:
    """All vectors of k non-negative integers that sum to ``divisions``, in lexicographic order.

    >>> list(simplex_lattice(2, 2))
    [(0, 2), (1, 1), (2, 0)]
    """
    if k == 1:
        yield (divisions,)
        return
    for first in range(divisions + 1):
        for rest in simplex_lattice(divisions - first, k - 1):
            yield (first, *rest)


def checked_divisions(given: Any, k: int = 1) -> int:
    """Return the divisions of a simplex lattice of k weights; OptionError unless it can have that many."""
    divisions = whole("divisions", given, 1, kind="a whole number of steps from weight 0 to weight 1,")
    count = math.comb(divisions + k - 1, k - 1)
    if count > MAX_WEIGHTS:
        raise OptionError(
            f"{divisions} divisions of {k} weights make {count:,} weights, more than {MAX_WEIGHTS:,}; take fewer, or "
            "leave them out: then weights are chosen where they find something"
        )
    return divisions


def integer_weights(weights: Sequence[float], k: int | None = None) -> Vector:
    """Whole numbers in the proportions of weights; k says how many there must be.

    >>> integer_weights([0.1, 0.25, 0])
    (2, 5, 0)
    """
    try:
        values = [real("a weight", w, 0, sys.float_info.max) for w in weights]
    except TypeError:
        raise OptionError(f"weights are lists of numbers, one a cost, got {shown(weights)}") from None
    if k is not None and len(values) != k:
        raise OptionError(f"there are {k} costs to be weighted, got {len(values)} weights: {values}")
    if not any(values):
        raise OptionError("weights are all zero: one of them must be above")
    fractions = [Fraction(w / max(values)).limit_denominator(FINEST) for w in values]
    return smallest([int(f * math.lcm(*(g.denominator for g in fractions))) for f in fractions])


def smallest(vector: Sequence[int]) -> Vector:
    """The least whole numbers in the same proportions."""
    divisor = math.gcd(*vector)
    return tuple(v // divisor for v in vector)
