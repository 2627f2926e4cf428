"""Choice of one point of a front, such as the knee: functions that take arrays of costs and return a row number.

Each criterion is scaled by its range over the front, so that units do not matter. The range goes from the ideal (the
best value of each column) to the nadir (the worst value of each column over the non-dominated rows). A column that is
constant over the front cannot distinguish points and is left out. Scaled values that differ only by rounding are ties.
Every function states how it breaks ties; of rows that are still tied, the first is taken.

Methods of :class:`hpop.frontier.ItemFront` with the same names call these functions with costs in whole quanta.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.base.text import is_number, shown
from hpop.frontier.dominance import BoolArray, FloatArray, finite_costs, is_nondominated
from hpop.frontier.points import FrontError, UnknownColumnError

# Scaled values are of order one; differences below this are rounding errors.
TIE = 1e-12
# A column whose range is below this share of its values counts as constant.
ROUNDING = 64 * float(np.finfo(np.float64).eps)
# Weight of the sum in the augmented Chebyshev function: small beside the maximum, enough to break its ties.
AUGMENTATION = 1e-4
MOST_LETTERS = 100  # number of characters of a name that are compared with known names
# Depths (see `knee`) are of order one; differences below this are errors of the linear programs.
NOISE = 1e-9
ZERO = 1e-12  # entries of a simplex tableau below this count as 0


def column_index(name: str, names: Sequence[str], reported: Sequence[str] = ()) -> int:
    """Return the column index of a criterion; UnknownColumnError, with all names and the nearest one, if unknown.

    reported  names of values that a front reports but that cannot choose a point; the error for them says so

    >>> column_index("length", ["turns", "length"])
    1
    """
    if not isinstance(name, str):
        raise UnknownColumnError(f"a criterion must be given by its name, one of {', '.join(names)}, got {shown(name)}")
    if name in names:
        return list(names).index(name)
    if name in reported:
        raise UnknownColumnError(
            f"points can be chosen by the criteria that were minimised, {', '.join(names)}, but {shown(name)} is only "
            f"reported; choose by those, or by nearest({{{shown(name)}: ...}}), or plan a front that minimises it"
        )
    near = difflib.get_close_matches(name[:MOST_LETTERS], names, n=1)
    near += [each for each in names if name and each.startswith(name)]  # stops_missed for stops
    hint = f" Did you mean {near[0]!r}?" if near else ""
    raise UnknownColumnError(f"the front has no column {shown(name)}.{hint} Its columns: {', '.join(names)}")


def named_numbers(what: str, values: Mapping[str, float]) -> FloatArray:
    """Check an argument that maps criteria to finite numbers, and return the numbers (m,).

    what  name of the argument in the message of a FrontError
    """
    if not isinstance(values, Mapping) or not values:
        raise FrontError(f"{what} must map criteria to numbers, such as {{'length': 1.0}}, got {shown(values)}")
    for name, value in values.items():
        if not is_number(value) or not math.isfinite(value):
            raise FrontError(f"{what} must be finite numbers, got {shown(value)} for {shown(name)}")
    return np.array([float(value) for value in values.values()])


def normalised(Y: FloatArray, ideal: FloatArray, nadir: FloatArray) -> FloatArray:
    """Scale the costs so that the ideal becomes 0 and the nadir 1; columns in which these are equal become 0.

    Parameters
    ----------
    Y : (n, k) array
        Costs.
    ideal, nadir : (k,) array
        Costs that become 0 and 1. To compare two fronts, use one ideal and one nadir for both.

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
    """Return the row with the smallest weighted sum of normalised costs; ties go to the smallest sum without weights.

    The result is a supported point: a point on the convex hull of the front.

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
    """Return the row with the smallest value in the first column of ``order``; the second column breaks ties, etc.

    Columns that are not in ``order`` come after it, from left to right. Values are compared exactly.

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
    """Return the row nearest to wished values, by Euclidean distance with each column scaled by its range.

    A value better than wished counts as distance too, while :func:`achievement` rewards it. Ties go to the row with the
    smallest sum of the other normalised costs.

    Parameters
    ----------
    named : (n, m) array
        Columns for which there is a wish.
    wishes : (m,) array
        Wished values, in the units of ``named``.
    rest : (n, k) array
        Costs for which there is no wish.
    """
    distance = np.linalg.norm(_scaled_differences(named, wishes), axis=1)  # (n,)
    return least(distance, scaled(rest).sum(axis=1))


def achievement(Y: FloatArray, columns: Sequence[int], aspirations: FloatArray) -> int:
    """Return the best row with respect to a reference point, by the augmented Chebyshev achievement function.

    The row minimises ``max_j (y_j - r_j) / range_j + rho * sum_i z_i`` with ``rho = 1e-4``. The maximum is over the
    columns that have an aspiration level r_j, the sum over all normalised costs z_i (Wierzbicki 1980, "The use of
    reference objectives in multiobjective optimization"). Unlike a distance, it goes beyond a reference point that can
    be beaten. Unlike a weighted sum, it can reach points that are not on the convex hull.

    Parameters
    ----------
    Y : (n, k) array
        Mutually non-dominated costs, at least one row.
    columns : sequence of int
        Columns that have an aspiration level.
    aspirations : (m,) array
        Reference point: an aspiration level for each of ``columns``, in the units of ``Y``.
    """
    gaps = _scaled_differences(Y[:, list(columns)], aspirations)  # (n, columns that vary)
    worst = gaps.max(axis=1) if gaps.shape[1] else np.zeros(len(Y))
    return least(worst + AUGMENTATION * scaled(Y).sum(axis=1))


def differing(Y: FloatArray, count: int, *, always: Sequence[int] = ()) -> list[int]:
    """Return some rows whose costs, scaled by their ranges, differ as much as possible, by farthest-point selection.

    Parameters
    ----------
    Y : (n, k) array
        Costs, at least one row.
    count : int
        Number of rows to return, at most all. All rows of ``always`` are returned even if they are more.
    always : sequence of int
        Rows that are chosen first; by default the first row of ``Y``.

    Examples
    --------
    >>> differing(np.array([[0.0, 9.0], [1.0, 8.0], [5.0, 5.0], [9.0, 0.0]]), 3)
    [0, 3, 2]
    """
    Z = scaled(Y)
    return farthest(lambda row: np.asarray(np.linalg.norm(Z - Z[row], axis=1)), len(Y), count, always=always)


def farthest(distances: Callable[[int], FloatArray], size: int, count: int, *, always: Sequence[int] = ()) -> list[int]:
    """Choose points one by one, each as far as possible from those already chosen, and return their indices.

    The first is point 0, unless ``always`` names others. Ties go to the first point. If the distances are a metric, and
    ``always`` has at most one point, the largest distance of any point to the nearest chosen one is at most twice the
    smallest that any choice of equally many points can give (Gonzalez 1985, "Clustering to minimize the maximum
    intercluster distance").

    Parameters
    ----------
    distances : function that returns the distances (size,) of a point to all points, not negative
    size : number of points, at least one
    count, always : as for :func:`differing`
    """
    chosen = list(dict.fromkeys(always)) or [0]
    nearest = np.full(size, np.inf)
    for row in chosen:
        nearest = np.minimum(nearest, distances(row))
    while len(chosen) < min(count, size):
        nearest[chosen] = -np.inf  # chosen only once, even with ties
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, distances(chosen[-1]))
    return chosen


def scaled(Y: FloatArray) -> FloatArray:
    """Return costs (n, k) scaled column by column: least 0, greatest 1; 0 where all values of a column are equal."""
    return normalised(Y, Y.min(axis=0), Y.max(axis=0))


def _scaled_differences(Y: FloatArray, wishes: FloatArray) -> FloatArray:
    """Return costs (n, m) minus wishes (m,), divided by each column's range in ``Y``, without constant columns."""
    low, high = Y.min(axis=0), Y.max(axis=0)
    varies = normalised(Y, low, high).any(axis=0)
    gaps: FloatArray = (Y[:, varies] - wishes[varies]) / (high - low)[varies]
    return gaps


def least(*keys: FloatArray, tie: float = TIE) -> int:
    """Return the row with the smallest first key; the second key breaks ties, and so on, finally the row number.

    keys  (n,) each
    tie   values up to tie * max(1, |least|) above the least value count as equal to it
    """
    rows = np.arange(len(keys[0]))
    for key in keys:
        lowest = key[rows].min()
        rows = rows[key[rows] <= lowest + tie * max(1.0, abs(lowest))]
    return int(rows[0])


@checked_arguments
def knee(Y: ArrayLike) -> int:
    """Return the row of the knee: the one that lies deepest below the convex hull of the extreme points.

    "Below" means towards the ideal. Costs are normalised. The extreme points ``E`` are the best row of each criterion,
    and for each axis j the row nearest to it, which has the smallest ``max(z_i, i != j)``. The depth of a row ``z`` is
    the largest number that can be added to all its costs before some mixture of extreme points is as good in all of
    them::

        depth(z) = max t  such that  z + t (1, ..., 1) <= E' b,  b >= 0,  sum(b) = 1

    For two criteria this is, up to a factor, the distance below the straight line between the ends of the front (Das
    1999, "On characterizing the knee of the Pareto curve based on normal-boundary intersection"). There are two
    deviations from Das. First, "<=" takes the place of "=", as in goal attainment, so that every row has a depth.
    Second, the hull contains not only the best rows of the criteria, several of which coincide if there are three or
    more criteria, but also the rows nearest to the axes (Deb and Jain 2014).

    The best row of a criterion is no compromise. It is the knee only if all other rows have negative depths, in fronts
    that nowhere bulge towards the ideal. Ties go to the row whose worst scaled cost is smallest, so the knee of a
    straight front is its middle. A single row is its own knee.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs, at least one row. Dominated rows, and copies of a row, are ignored.

    Raises FrontError if there are no rows.

    Examples
    --------
    >>> knee([[0.0, 10.0], [1.0, 4.0], [3.0, 3.0], [9.0, 0.0], [9.0, 10.0]])
    1
    """
    matrix = finite_costs(Y)
    if not len(matrix):
        raise FrontError("Y must have at least one row to choose a knee from, got none; plan or filter again")
    rows = np.flatnonzero(is_nondominated(matrix))
    rows = rows[np.lexsort(matrix[rows].T[::-1])]  # so that ties do not depend on the order of the rows
    return int(rows[_knee(matrix[rows])])


def _knee(Y: FloatArray) -> int:
    """Return the row of the knee among mutually non-dominated costs (n, k)."""
    z = scaled(Y)
    z = z[:, z.max(axis=0) > 0]  # (n, m): the columns that vary
    if z.shape[1] == 0:
        return 0
    axes = range(z.shape[1])
    best = [least(z[:, axis], z.sum(axis=1)) for axis in axes]
    near = [least(np.delete(z, axis, axis=1).max(axis=1), z[:, axis]) for axis in axes] if z.shape[1] > 1 else best
    between = np.ones(len(z), dtype=np.bool_)
    between[best] = False
    extremes = z[sorted({*best, *near})]
    if between.any():
        row, depth = _deepest(z, between, extremes)
        if depth >= -NOISE:
            return row
    return _deepest(z, ~between, extremes)[0]


def _deepest(z: FloatArray, candidates: BoolArray, extremes: FloatArray) -> tuple[int, float]:
    """Return the candidate row with the largest depth (see :func:`knee`), and this depth.

    The dual solution ``w`` of the linear program of one row bounds the depth of every row: ``depth(z) <= max(E w) - w
    z``. So the program of the row with the largest bound is solved, the bounds are updated, and this is repeated until
    a bound equals its depth. A few programs suffice for thousands of rows.
    """
    rows = np.flatnonzero(candidates)
    bound = extremes.mean(axis=1).max() - z[rows].mean(axis=1)
    while True:
        first = least(-bound, z[rows].max(axis=1), tie=NOISE)
        depth, weights = _depth(z[rows[first]], extremes)
        if depth >= bound[first] - NOISE:
            return int(rows[first]), depth
        bound = np.minimum(bound, (extremes @ weights).max() - z[rows] @ weights)
        bound[first] = depth  # exactly, without the error of the program


def _depth(point: FloatArray, extremes: FloatArray) -> tuple[float, FloatArray]:
    """Return the depth of a point (see :func:`knee`), and weights (m,) >= 0 of the criteria, with sum 1, that prove it.

    The depth is the value of a matrix game: one player mixes extreme points, the other chooses weights of criteria. If
    all payoffs are positive, its linear program is max sum(u) such that payoffs u <= 1, u >= 0. The optimum has the
    weights u / sum(u) and the value 1 / sum(u) (Dantzig 1951, "A proof of the equivalence of the programming problem
    and the game problem"). It is solved by the simplex method, from a first tableau that is feasible, with the pivot
    rule of Bland (1977), which never cycles. SciPy has a solver too, but importing it takes longer than a search.
    """
    payoffs = extremes - point
    shift = 1.0 - payoffs.min()
    mixed, axes = extremes.shape
    tableau = np.zeros((mixed + 1, axes + mixed + 1))
    tableau[:mixed] = np.hstack([payoffs + shift, np.eye(mixed), np.ones((mixed, 1))])
    tableau[mixed, :axes] = 1.0  # remaining gain of each weight
    basis = np.arange(axes, axes + mixed)
    while (gains := np.flatnonzero(tableau[mixed, :-1] > ZERO)).size:
        column = tableau[:mixed, gains[0]]
        ratios = np.divide(tableau[:mixed, -1], column, out=np.full(mixed, np.inf), where=column > ZERO)
        tied = np.flatnonzero(ratios <= ratios.min() + ZERO)
        row = tied[np.argmin(basis[tied])]
        tableau[row] /= tableau[row, gains[0]]
        remaining = np.arange(mixed + 1) != row
        tableau[remaining] -= np.outer(tableau[remaining, gains[0]], tableau[row])
        basis[row] = gains[0]
    weights = np.zeros(axes + mixed)
    weights[basis] = np.maximum(tableau[:mixed, -1], 0.0)
    return float(1.0 / weights[:axes].sum() - shift), weights[:axes] / weights[:axes].sum()
