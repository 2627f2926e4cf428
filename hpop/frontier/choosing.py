"""Choosing one point of a front: pure functions on cost arrays that return a row number.

Each criterion is scaled by its range over the front, from the ideal (the best of each column) to the nadir
(the worst of each column over the non-dominated rows), so units do not matter. A column that is constant over
the front cannot distinguish points and is left out. Scaled values that differ by rounding alone are tied;
every function states how it breaks ties, and the last resort is the first row.

The methods of :class:`hpop.frontier.Front` of the same names call these with costs counted in whole quanta. The knee
has a file of its own, :mod:`hpop.frontier.knees`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hpop.base.scalars import is_number
from hpop.base.text import shown
from hpop.frontier.dominance import FloatArray
from hpop.frontier.errors import FrontError, UnknownColumnError

# Scaled values are of order one; differences below this are rounding.
TIE = 1e-12
# A range below this part of the values' size is rounding: the column is constant.
ROUNDING = 64 * float(np.finfo(np.float64).eps)
# Weight of the sum in the augmented Chebyshev function: small beside the maximum, enough to break its ties.
AUGMENTATION = 1e-4
MOST_LETTERS = 100  # of a name that is compared with others


def column_index(name: str, names: Sequence[str], reported: Sequence[str] = ()) -> int:
    """Find a column by name, or list the names there are and suggest the nearest.

    Of one that is only `reported`, and cannot be taken here, the error says so and what can be done instead.

    >>> column_index("length", ["turns", "length"])
    1
    """
    if not isinstance(name, str):
        raise UnknownColumnError(f"a criterion is given by its name, one of {', '.join(names)}, got {shown(name)}")
    if name in names:
        return list(names).index(name)
    if name in reported:
        raise UnknownColumnError(
            f"{shown(name)} is only reported here, points are the best in {', '.join(names)}; choose by these, or by "
            f"nearest({{{shown(name)}: ...}}), or make a front by a search that minimises it itself"
        )
    near = difflib.get_close_matches(name[:MOST_LETTERS], names, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise UnknownColumnError(f"the front has no {shown(name)}.{hint} Known: {', '.join(names)}")


def named_numbers(what: str, values: Mapping[str, float]) -> FloatArray:
    """Return the values of a mapping, refusing an empty one and anything but finite numbers."""
    if not isinstance(values, Mapping) or not values:
        raise FrontError(f"expected {what} by criterion, such as {{'length': 1.0}}, got {shown(values)}")
    for name, value in values.items():
        if not is_number(value) or not math.isfinite(value):
            raise FrontError(f"{what} must be finite numbers, got {shown(value)} for {shown(name)}")
    return np.array([float(value) for value in values.values()])


def normalised(Y: FloatArray, ideal: FloatArray, nadir: FloatArray) -> FloatArray:
    """Scale costs so that the ideal becomes 0 and the nadir 1; columns where the two agree become 0.

    Parameters
    ----------
    Y : (n, k) array
        Costs.
    ideal, nadir : (k,) array
        What becomes 0 and 1; to compare two fronts use the same for both.

    Examples
    --------
    >>> normalised(np.array([[2.0, 5.0], [4.0, 5.0]]), np.array([2.0, 5.0]), np.array([6.0, 5.0])).tolist()
    [[0.0, 0.0], [0.5, 0.0]]
    """
    spread = nadir - ideal  # (k,)
    varies = spread > ROUNDING * np.maximum(np.abs(ideal), np.abs(nadir))
    shares = (Y - ideal) / np.where(varies, spread, 1.0)  # (n, k)
    return np.asarray(np.where(varies, shares, 0.0), dtype=np.float64)


def weighted_sum(Y: FloatArray, weights: FloatArray) -> int:
    """Row with the least weighted sum of normalised costs; ties go to the least plain sum.

    Only supported points, those on the convex hull of the front, can be found so.

    Parameters
    ----------
    Y : (n, k) array
        Mutually non-dominated costs, at least one row.
    weights : (k,) array
        Not negative, not all zero; their common scale does not matter.
    """
    if not np.isfinite(weights).all() or (weights < 0).any() or not weights.any():
        raise FrontError(f"weights must be finite, not negative and not all zero, got {weights.tolist()}")
    z = scaled(Y)
    return least(z @ (weights / weights.max()), z.sum(axis=1))


def lexicographic(Y: FloatArray, order: Sequence[int]) -> int:
    """Row that is best in the first column of ``order``, among those in the second, and so on.

    Columns that ``order`` leaves out follow in their own order. Values are compared exactly.

    Parameters
    ----------
    Y : (n, k) array
        Costs, at least one row.
    order : sequence of int
        Distinct columns, the most important first.

    Examples
    --------
    >>> lexicographic(np.array([[1.0, 9.0, 2.0], [1.0, 8.0, 3.0], [2.0, 0.0, 0.0]]), [0])
    1
    """
    rest = [column for column in range(Y.shape[1]) if column not in order]
    return int(np.lexsort(Y[:, [*order, *rest]].T[::-1])[0])


def nearest(named: FloatArray, wishes: FloatArray, rest: FloatArray) -> int:
    """Row nearest to the wishes: least Euclidean distance, each column scaled by its range over the front.

    Being better than a wish is as far away as being worse; :func:`achievement` rewards it. Ties go to the
    least sum of the other normalised costs.

    Parameters
    ----------
    named : (n, m) array
        The columns that a wish names.
    wishes : (m,) array
        The values wished for, in the units of ``named``.
    rest : (n, k) array
        The costs that no wish names.
    """
    distance = np.linalg.norm(_gaps(named, wishes), axis=1)  # (n,)
    return least(distance, scaled(rest).sum(axis=1))


def achievement(Y: FloatArray, columns: Sequence[int], aspirations: FloatArray) -> int:
    """Row that does best against a reference point: the augmented Chebyshev achievement function.

    Minimises ``max_j (y_j - r_j) / range_j + rho * sum_i z_i`` with ``rho = 1e-4``, the maximum over the
    columns that have an aspiration, the sum over all normalised costs (Wierzbicki 1980, "The use of reference
    objectives in multiobjective optimization"). Unlike a distance it also improves on a reference point that
    can be beaten, and unlike a weighted sum it reaches points that are not supported.

    Parameters
    ----------
    Y : (n, k) array
        Mutually non-dominated costs, at least one row.
    columns : sequence of int
        The columns that have an aspiration.
    aspirations : (m,) array
        The reference point, one value for each of ``columns``, in the units of ``Y``.
    """
    gaps = _gaps(Y[:, list(columns)], aspirations)  # (n, columns that vary)
    worst = gaps.max(axis=1) if gaps.shape[1] else np.zeros(len(Y))
    return least(worst + AUGMENTATION * scaled(Y).sum(axis=1))


def differing(Y: FloatArray, count: int, *, always: Sequence[int] = ()) -> list[int]:
    """Rows that differ most in their costs, each scaled by its range over the front: farthest-point selection.

    Parameters
    ----------
    Y : (n, k) array
        Costs, at least one row.
    count : int
        How many rows; all where there are no more. Those of ``always`` stay, also where they are more.
    always : sequence of int
        Rows that are chosen first; without any, the first row of ``Y`` is.

    Examples
    --------
    >>> differing(np.array([[0.0, 9.0], [1.0, 8.0], [5.0, 5.0], [9.0, 0.0]]), 3)
    [0, 3, 2]
    """
    Z = scaled(Y)
    return farthest(lambda row: np.asarray(np.linalg.norm(Z - Z[row], axis=1)), len(Y), count, always=always)


def farthest(distances: Callable[[int], FloatArray], size: int, count: int, *, always: Sequence[int] = ()) -> list[int]:
    """Points of which each is the farthest from those chosen before it; ties go to the first.

    Gonzalez 1985, "Clustering to minimize the maximum intercluster distance": no choice of as many points leaves the
    others half as far from the nearest chosen one.

    Parameters
    ----------
    distances : of a point to all, (size,), not negative
    size : number of points, at least one
    count, always : as for :func:`differing`
    """
    chosen = list(dict.fromkeys(always)) or [0]
    nearest = np.full(size, np.inf)
    for row in chosen:
        nearest = np.minimum(nearest, distances(row))
    while len(chosen) < min(count, size):
        nearest[chosen] = -np.inf  # chosen once, also where others are as near
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, distances(chosen[-1]))
    return chosen


def scaled(Y: FloatArray) -> FloatArray:
    """Normalise by the front's own ideal and nadir."""
    return normalised(Y, Y.min(axis=0), Y.max(axis=0))


def _gaps(Y: FloatArray, wishes: FloatArray) -> FloatArray:
    """Scaled signed differences from the wishes, without the columns that do not vary."""
    low, high = Y.min(axis=0), Y.max(axis=0)
    varies = normalised(Y, low, high).any(axis=0)
    gaps: FloatArray = (Y[:, varies] - wishes[varies]) / (high - low)[varies]
    return gaps


def least(*keys: FloatArray, tie: float = TIE) -> int:
    """First row with the least first key, ties settled by the next key."""
    rows = np.arange(len(keys[0]))
    for key in keys:
        lowest = key[rows].min()
        rows = rows[key[rows] <= lowest + tie * max(1.0, abs(lowest))]
    return int(rows[0])
