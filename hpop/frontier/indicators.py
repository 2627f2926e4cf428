"""Numbers that compare two fronts of the same problem.

Both indicators are in the units of the costs, so criteria of different units should be scaled first, both
fronts by the same ideal and nadir (:func:`hpop.frontier.choosing.normalised`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.frontier.dominance import FloatArray, filter, finite_costs

BEYOND = 0.1  # of the range between ideal and nadir: how far beyond the nadir the default reference lies


@checked_arguments
def hypervolume(Y: ArrayLike, reference: ArrayLike | None = None) -> float:
    """Volume of the cost space between the front and a reference point: larger is better.

    The measure of ``{z <= reference : some row of Y is <= z}`` (Zitzler and Thiele 1998), computed exactly.
    Rows that are not below the reference in every criterion add nothing.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs; dominated rows are harmless.
    reference : (k,) array, optional
        A cost vector worse than all that should count. Without it :func:`default_reference` of ``Y`` itself: enough to
        watch one set, not to compare two, which need the same reference.

    Examples
    --------
    >>> hypervolume([[1, 2], [2, 1]], reference=[3, 3])
    3.0
    >>> default_reference([[1, 2], [2, 1]]), round(hypervolume([[1, 2], [2, 1]]), 9)
    (array([2.1, 2.1]), 0.21)
    """
    if reference is None:
        reference = default_reference(Y)
    matrix = finite_costs(Y)
    corner = finite_costs(np.atleast_2d(np.asarray(reference)))
    _same_columns(matrix, corner)
    import moocore

    return float(moocore.hypervolume(matrix, ref=corner[0]))


@checked_arguments
def default_reference(Y: ArrayLike) -> FloatArray:
    """A reference point (k,) for hypervolumes: a tenth of the range beyond the nadir of the non-dominated rows.

    So the ends of the front count as well. A column in which these rows are all the same gets 1 in the place of its
    range's tenth, so that it is a factor of 1. Of no rows at all it is zero.

    Examples
    --------
    >>> default_reference([[0.0, 7.0], [10.0, 7.0], [99.0, 99.0]])  # the second and third are dominated
    array([1., 8.])
    >>> default_reference([[0.0, 20.0], [10.0, 10.0], [99.0, 99.0]])
    array([11., 21.])
    """
    front = filter(finite_costs(Y)).astype(np.float64)
    if not len(front):
        return np.zeros(front.shape[1])
    nadir, span = front.max(axis=0), np.ptp(front, axis=0)
    return np.asarray(nadir + np.where(span > 0, BEYOND * span, 1.0), dtype=np.float64)


@checked_arguments
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
    matrix, target = finite_costs(Y), finite_costs(reference)
    _same_columns(matrix, target)
    if len(target) == 0:
        raise ValueError("the reference front is empty; additive_epsilon needs something to cover")
    if len(matrix) == 0:
        return float("inf")
    import moocore

    return float(moocore.epsilon_additive(matrix, ref=target))


def _same_columns(matrix: FloatArray, other: FloatArray) -> None:
    """Refuse to compare cost spaces of different dimension."""
    if matrix.shape[1] != other.shape[1]:
        raise ValueError(f"expected the same criteria on both sides, got {matrix.shape[1]} and {other.shape[1]}")
