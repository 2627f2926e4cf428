"""Choosing one point of a front: pure functions on cost arrays that return a row number.

Each criterion is scaled by its range over the front, from the ideal (the best of each column) to the nadir
(the worst of each column over the non-dominated rows), so units do not matter. A column that is constant over
the front cannot distinguish points and is left out. Scaled values that differ by rounding alone are tied;
every function states how it breaks ties, and the last resort is the first row.

The methods of :class:`hpop.frontier.Front` of the same names call these with costs counted in whole quanta.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from numbers import Real

import numpy as np

from hpop.frontier.dominance import FloatArray
from hpop.frontier.errors import FrontError, UnknownColumnError

# Scaled values are of order one; differences below this are rounding.
TIE = 1e-12
# A range below this part of the values' size is rounding: the column is constant.
ROUNDING = 64 * float(np.finfo(np.float64).eps)
# Weight of the sum in the augmented Chebyshev function: small beside the maximum, enough to break its ties.
AUGMENTATION = 1e-4


def column_index(name: str, names: Sequence[str]) -> int:
    """Find a column by name, or list the names there are and suggest the nearest.

    >>> column_index("length", ["turns", "length"])
    1
    """
    if name in names:
        return list(names).index(name)
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise UnknownColumnError(f"the front has no {name!r}; known: {', '.join(names)}.{hint}")


def named_numbers(what: str, values: Mapping[str, float]) -> FloatArray:
    """Return the values of a mapping, refusing an empty one and anything but finite numbers."""
    if not isinstance(values, Mapping) or not values:
        raise FrontError(f"expected {what} by criterion, such as {{'length': 1.0}}, got {values!r:.80}")
    for name, value in values.items():
        if not isinstance(value, Real) or not math.isfinite(value):
            raise FrontError(f"{what} must be finite numbers, got {value!r:.80} for {name!r}")
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
    scaled = (Y - ideal) / np.where(varies, spread, 1.0)  # (n, k)
    return np.asarray(np.where(varies, scaled, 0.0), dtype=np.float64)


def knee(Y: FloatArray) -> int:
    """Row that lies deepest below the hyperplane through the extreme points, towards the ideal.

    After normalisation the extreme point of axis ``j`` is the row nearest to that axis: it has the least
    ``max(z_i, i != j)``, then the least ``z_j`` (for two criteria: the two ends of the front). If ``E`` holds
    the extreme points as rows, the hyperplane is ``n . z = 1`` with ``E n = 1``, and the knee maximises
    ``(1 - n . z) / |n|`` (Das 1999, "On characterizing the knee of the Pareto curve"; extreme points as in
    Deb and Jain 2014). Where the extreme points span no plane, or one whose normal is not positive, as in
    small fronts of many criteria, ``n = (1, ..., 1)`` is taken: the row with the least sum.

    Ties go to the least worst scaled cost, so a straight front gives its middle. A front that nowhere bulges
    towards the ideal has no knee, and the answer is one of its extreme points. A single row is its own knee.

    Parameters
    ----------
    Y : (n, k) array
        Mutually non-dominated costs, at least one row.

    Examples
    --------
    >>> knee(np.array([[0.0, 10.0], [1.0, 4.0], [3.0, 3.0], [9.0, 0.0]]))
    1
    """
    z = _scaled(Y)
    z = z[:, z.max(axis=0) > 0]  # (n, m): the columns that vary
    if z.shape[1] == 0:
        return 0
    normal = _plane_normal(z)
    return _least(z @ normal / np.linalg.norm(normal), z.max(axis=1))


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
    z = _scaled(Y)
    return _least(z @ (weights / weights.max()), z.sum(axis=1))


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
    return _least(distance, _scaled(rest).sum(axis=1))


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
    return _least(worst + AUGMENTATION * _scaled(Y).sum(axis=1))


def _scaled(Y: FloatArray) -> FloatArray:
    """Normalise by the front's own ideal and nadir."""
    return normalised(Y, Y.min(axis=0), Y.max(axis=0))


def _gaps(Y: FloatArray, wishes: FloatArray) -> FloatArray:
    """Scaled signed differences from the wishes, without the columns that do not vary."""
    low, high = Y.min(axis=0), Y.max(axis=0)
    varies = normalised(Y, low, high).any(axis=0)
    gaps: FloatArray = (Y[:, varies] - wishes[varies]) / (high - low)[varies]
    return gaps


def _plane_normal(z: FloatArray) -> FloatArray:
    """Solve ``E n = 1`` for the extreme points ``E``; all ones if there is no positive solution."""
    size = z.shape[1]
    extremes = np.empty((size, size))
    for axis in range(size):
        others = np.delete(z, axis, axis=1).max(axis=1)
        extremes[axis] = z[_least(others, z[:, axis])]
    if np.linalg.matrix_rank(extremes) == size:
        normal: FloatArray = np.linalg.solve(extremes, np.ones(size)).astype(np.float64)
        if (normal > TIE).all():
            return normal
    return np.ones(size)


def _least(*keys: FloatArray) -> int:
    """First row with the least first key, ties settled by the next key."""
    rows = np.arange(len(keys[0]))
    for key in keys:
        least = key[rows].min()
        rows = rows[key[rows] <= least + TIE * max(1.0, abs(least))]
    return int(rows[0])
