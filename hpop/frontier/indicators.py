"""Numbers that compare two fronts of the same problem.

Both indicators are in the units of the costs, so criteria of different units should be scaled first, both
fronts by the same ideal and nadir (:func:`hpop.frontier.choosing.normalised`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hpop.frontier.dominance import FloatArray, cost_matrix


def hypervolume(Y: ArrayLike, reference: ArrayLike) -> float:
    """Volume of the cost space between the front and a reference point: larger is better.

    The measure of ``{z <= reference : some row of Y is <= z}`` (Zitzler and Thiele 1998), computed exactly.
    Rows that are not below the reference in every criterion add nothing.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs; dominated rows are harmless.
    reference : (k,) array
        A cost vector worse than all that should count.

    Examples
    --------
    >>> hypervolume([[1, 2], [2, 1]], reference=[3, 3])
    3.0
    """
    matrix = _finite(Y)
    corner = _finite(np.atleast_2d(np.asarray(reference)))
    _same_columns(matrix, corner)
    import moocore

    return float(moocore.hypervolume(matrix, ref=corner[0]))


def additive_epsilon(Y: ArrayLike, reference: ArrayLike) -> float:
    """Least shift that lets one front cover another: smaller is better, zero or less is as good everywhere.

    The smallest ``e`` such that every row ``r`` of ``reference`` has a row ``y`` of ``Y`` with
    ``y <= r + e`` in every criterion (Zitzler et al. 2003). An empty ``Y`` covers nothing: infinity.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs of the front that is judged.
    reference : (m, k) array
        Finite costs of the front that it is judged against, at least one row.

    Examples
    --------
    >>> additive_epsilon([[1, 4], [3, 2]], [[1, 3], [3, 1]])
    1.0
    """
    matrix, target = _finite(Y), _finite(reference)
    _same_columns(matrix, target)
    if len(target) == 0:
        raise ValueError("the reference front is empty; additive_epsilon needs something to cover")
    if len(matrix) == 0:
        return float("inf")
    import moocore

    return float(moocore.epsilon_additive(matrix, ref=target))


def _finite(Y: ArrayLike) -> FloatArray:
    """Return ``Y`` as a finite float matrix."""
    matrix = cost_matrix(Y).astype(np.float64)
    if not np.isfinite(matrix).all():
        raise ValueError("indicators need finite costs, got an infinite one; leave such rows out")
    return matrix


def _same_columns(matrix: FloatArray, other: FloatArray) -> None:
    """Refuse to compare cost spaces of different dimension."""
    if matrix.shape[1] != other.shape[1]:
        raise ValueError(f"expected the same criteria on both sides, got {matrix.shape[1]} and {other.shape[1]}")
