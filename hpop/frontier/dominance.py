"""Pareto dominance of cost vectors; all costs are minimised.

``a`` dominates ``b`` if it is nowhere worse and somewhere better: ``a <= b`` in every criterion and ``a != b``. Equal
vectors do not dominate each other; a front keeps one of them.

Floating-point sums make equal costs unequal (0.1 + 0.2 and 0.3). A tolerance does not help, because "equal within a
tolerance" is not transitive. So fronts compare integers: every cost is rounded once to a whole multiple of its quantum,
the smallest difference that counts (:func:`quantised`). From then on, comparisons are exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hpop.base.arguments import checked_arguments

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Beyond this number of quanta, neighbouring float64 numbers are more than one quantum apart.
MAX_QUANTA = 2.0**53
DIGITS = 9  # number of digits of a column's largest value that the default quantum resolves


@checked_arguments
def dominates(a: ArrayLike, b: ArrayLike) -> bool:
    """Return whether cost vector ``a`` is nowhere worse than ``b`` and somewhere better.

    Parameters
    ----------
    a, b : (k,) array
        Cost vectors of the same length, without NaN.

    Examples
    --------
    >>> dominates([1, 2], [1, 3]), dominates([1, 2], [1, 2]), dominates([1, 2], [2, 1])
    (True, False, False)
    """
    first, second = np.asarray(a), np.asarray(b)
    if first.ndim != 1 or first.shape != second.shape:
        raise ValueError(f"a and b must be vectors of equal length, got shapes {first.shape} and {second.shape}")
    matrix = cost_matrix(np.stack([first, second]))
    return bool((matrix[0] <= matrix[1]).all() and (matrix[0] < matrix[1]).any())


@checked_arguments
def is_nondominated(Y: ArrayLike) -> BoolArray:
    """Mark the rows of ``Y`` that no other row dominates; of equal ones among these, only the first.

    Every row that is not marked is equal to a marked row or dominated by one. Only the order of the numbers matters. So
    each number is replaced by its rank in its column before the sweep of moocore (Kung, Luccio and Preparata 1975).
    Therefore int64 costs above 2**53 stay exact, and infinite costs are allowed. moocore itself misjudges +inf, crashes
    on -inf, and lets a row of NaN dominate all others.

    Parameters
    ----------
    Y : (n, k) array
        Costs, integer or float, without NaN.

    Returns
    -------
    (n,) bool array

    Raises
    ------
    ValueError
        If ``Y`` is not a real matrix with at least one column, or contains NaN.

    Examples
    --------
    >>> is_nondominated([[1, 3], [2, 2], [2, 3], [2, 2]])
    array([ True,  True, False, False])
    """
    matrix = cost_matrix(Y)
    if len(matrix) == 0:
        return np.zeros(0, dtype=np.bool_)
    columns = [np.unique(column, return_inverse=True)[1] for column in matrix.T]
    ranks = np.column_stack(columns).astype(np.float64)  # (n, k)
    try:
        import moocore  # slow to import
    except ImportError:  # the package hpop-search depends on numpy and numba only
        return _swept(ranks)
    return np.asarray(moocore.is_nondominated(ranks), dtype=np.bool_)


def _swept(ranks: FloatArray) -> BoolArray:
    """Mark the non-dominated rows of a finite matrix, of equal rows only the first, without the package moocore.

    It takes one pass over the rows for each marked row.
    """
    is_marked = np.zeros(len(ranks), np.bool_)
    waiting = np.lexsort(ranks.T[::-1])  # no row is dominated by a later one
    while len(waiting):
        is_marked[waiting[0]] = True
        waiting = waiting[(ranks[waiting] < ranks[waiting[0]]).any(axis=1)]
    return is_marked


@checked_arguments
def filter(Y: ArrayLike) -> NDArray[np.float64] | NDArray[np.int64]:
    """Return the rows of ``Y`` that no other row dominates, without repeated rows, in the order of ``Y``.

    This is ``Y[is_nondominated(Y)]``, and raises the errors of :func:`is_nondominated`.

    Examples
    --------
    >>> filter([[1, 3], [2, 2], [2, 3], [2, 2]]).tolist()
    [[1, 3], [2, 2]]
    """
    matrix = cost_matrix(Y)
    rows: NDArray[np.float64] | NDArray[np.int64] = matrix[is_nondominated(matrix)]
    return rows


@checked_arguments
def default_quanta(Y: ArrayLike) -> FloatArray:
    """Return a quantum (smallest difference that counts) for each of k columns of costs (n, k).

    A column of whole numbers gets 1. Others get a billionth of their largest absolute value, as a power of ten. That is
    fine enough to distinguish measured values, and coarse enough that sums in a different order are equal.

    Examples
    --------
    >>> default_quanta([[3.25, 7], [420.0, 1], [0.1, 2]]).tolist()
    [1e-07, 1.0]
    """
    matrix = finite_costs(Y)
    largest = np.abs(matrix).max(axis=0, initial=0.0)
    is_count = (matrix == np.rint(matrix)).all(axis=0) & (largest <= MAX_QUANTA)
    exponents = [int(np.floor(np.log10(size))) if size else 0 for size in largest]
    return np.array(
        [1.0 if count else float(f"1e{power - DIGITS}") for count, power in zip(is_count, exponents, strict=True)]
    )


@checked_arguments
def quantised(Y: ArrayLike, quanta: ArrayLike) -> IntArray:
    """Return costs as whole numbers of quanta: ``Z[i, j] = round(Y[i, j] / quanta[j])``.

    A half is rounded to the even neighbour. Choose quanta that keep costs away from halves, because rounding errors
    decide there. The quotient is computed in float64, so a quantum must be coarse enough for float64 to resolve it: a
    cost beyond 2**53 quanta raises an error.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs.
    quanta : (k,) array
        Positive quantum of each column, in its unit.

    Returns
    -------
    (n, k) int64 array

    Raises
    ------
    ValueError
        If a cost is not finite, a quantum not positive, the shapes differ or a quotient exceeds 2**53.

    Examples
    --------
    >>> quantised([[0.1 + 0.2, 2.5], [0.3, 3.5]], [1e-6, 1.0])
    array([[300000,      2],
           [300000,      4]])
    """
    matrix = finite_costs(Y)
    steps = np.asarray(quanta, dtype=np.float64)
    if steps.shape != matrix.shape[1:]:
        raise ValueError(f"quanta must have one entry for each of {matrix.shape[1]} columns, got shape {steps.shape}")
    if not (np.isfinite(steps).all() and (steps > 0).all()):
        raise ValueError(f"quanta must be positive and finite, got {steps.tolist()}")
    with np.errstate(over="ignore"):  # an infinite quotient is refused below
        quotients = matrix / steps  # (n, k)
    if (beyond := np.abs(quotients) > MAX_QUANTA).any():
        row, column = np.argwhere(beyond)[0]
        cost = matrix[row, column]
        raise ValueError(
            f"costs must be at most 2**53 quanta, which float64 resolves, but row {row}, column {column} has a cost of "
            f"{cost:.6g} with a quantum of {steps[column]:.3g}; use a quantum above {abs(cost) / MAX_QUANTA:.3g}"
        )
    return np.rint(quotients).astype(np.int64)


def finite_costs(Y: ArrayLike) -> FloatArray:
    """Return costs as a matrix of float64; ValueError if ``Y`` is not a matrix of finite numbers."""
    matrix = cost_matrix(Y).astype(np.float64)
    if not np.isfinite(matrix).all():
        row, column = np.argwhere(~np.isfinite(matrix))[0]
        raise ValueError(
            f"costs must be finite, got {matrix[row, column]} in row {row}, column {column}; leave such rows out"
        )
    return matrix


def cost_matrix(Y: ArrayLike) -> NDArray[np.float64] | NDArray[np.int64]:
    """Return costs as a NumPy matrix; ValueError if ``Y`` is not a matrix of real numbers without NaN."""
    matrix = np.asarray(Y)
    if matrix.ndim != 2 or matrix.shape[1] == 0:
        raise ValueError(f"costs must be a matrix of shape (n, k) with k >= 1, got shape {matrix.shape}")
    if matrix.dtype.kind not in "iuf":
        raise ValueError(f"costs must be real numbers, got an array of {matrix.dtype}")
    if np.isnan(matrix).any():
        row, column = np.argwhere(np.isnan(matrix))[0]
        raise ValueError(f"costs must be numbers, got NaN in row {row}, column {column}; leave such rows out")
    return matrix
