"""The knee of a front: the point that lies deepest below mixtures of its extreme points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hpop.base.arguments import checked_arguments
from hpop.frontier.choosing import least, scaled
from hpop.frontier.dominance import BoolArray, FloatArray, finite_costs, is_nondominated
from hpop.frontier.errors import FrontError

# Depths are of order one; differences below this are noise of the linear programs.
NOISE = 1e-9
ZERO = 1e-12  # in a tableau whose entries are of order one


@checked_arguments
def knee(Y: ArrayLike) -> int:
    """Row that lies deepest below the extreme points' convex hull, towards the ideal.

    Costs are normalised. The extreme points ``E`` are the best row of each criterion, and for each axis the row nearest
    to it, which has the least ``max(z_i, i != j)``. The depth of a row ``z`` is how much could be added to all of its
    costs until a mixture of extreme points is no worse in any of them::

        depth(z) = max t  such that  z + t (1, ..., 1) <= E' b,  b >= 0,  sum(b) = 1

    For two criteria this is, up to a factor, the distance below the straight line between the ends of the front (Das
    1999, "On characterizing the knee of the Pareto curve based on normal-boundary intersection"). Deviations from Das:
    "<=" stands for "=", as in goal attainment, so that every row has a depth; and the hull is not of the best rows
    alone, of which several coincide in fronts of three and more criteria, but also of the rows nearest to the axes (Deb
    and Jain 2014).

    The best row of a criterion is no compromise: it is the knee only if all other rows have depths below zero, in
    fronts that nowhere bulge towards the ideal. Ties go to the least worst scaled cost, so a straight front gives its
    middle. A single row is its own knee.

    Parameters
    ----------
    Y : (n, k) array
        Finite costs, at least one row. Rows that others dominate, and copies of a row, are left aside.

    Raises FrontError where there are no rows.

    Examples
    --------
    >>> knee([[0.0, 10.0], [1.0, 4.0], [3.0, 3.0], [9.0, 0.0], [9.0, 10.0]])
    1
    """
    matrix = finite_costs(Y)
    if not len(matrix):
        raise FrontError("no rows to choose a knee from")
    rows = np.flatnonzero(is_nondominated(matrix))
    rows = rows[np.lexsort(matrix[rows].T[::-1])]  # so that ties do not depend on the order of the rows
    return int(rows[_knee(matrix[rows])])


def _knee(Y: FloatArray) -> int:
    """The knee of mutually non-dominated costs."""
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


def _deepest(z: FloatArray, asked: BoolArray, extremes: FloatArray) -> tuple[int, float]:
    """Row of those asked for with the greatest depth, and that depth.

    The dual solution ``w`` of one row's linear program bounds the depth of every row: ``depth(z) <= max(E w) - w z``.
    So the row with the greatest bound is solved until its bound is its depth; a few programs settle thousands of rows.
    """
    rows = np.flatnonzero(asked)
    bound = extremes.mean(axis=1).max() - z[rows].mean(axis=1)
    while True:
        first = least(-bound, z[rows].max(axis=1), tie=NOISE)
        depth, weights = _depth(z[rows[first]], extremes)
        if depth >= bound[first] - NOISE:
            return int(rows[first]), depth
        bound = np.minimum(bound, (extremes @ weights).max() - z[rows] @ weights)
        bound[first] = depth  # whatever the noise of the program


def _depth(point: FloatArray, extremes: FloatArray) -> tuple[float, FloatArray]:
    """Depth of a point, and the weights (m,) of the criteria that prove it: not negative, their sum one.

    The depth is the value of a game: one player mixes extreme points, the other weighs criteria. With all payoffs above
    zero its linear program is max sum(u) such that payoffs u <= 1, u >= 0, and the optimum has the weights u / sum(u)
    and the value 1 / sum(u) (Dantzig 1951, "A proof of the equivalence of the programming problem and the game
    problem"). Its first tableau is feasible; steps are Bland's (1977), which never cycle. SciPy's solver would do as
    well, after an import that takes longer than a search.
    """
    payoffs = extremes - point
    shift = 1.0 - payoffs.min()
    mixed, axes = extremes.shape
    tableau = np.zeros((mixed + 1, axes + mixed + 1))
    tableau[:mixed] = np.hstack([payoffs + shift, np.eye(mixed), np.ones((mixed, 1))])
    tableau[mixed, :axes] = 1.0  # what is left to gain of each weight
    basis = np.arange(axes, axes + mixed)
    while (gains := np.flatnonzero(tableau[mixed, :-1] > ZERO)).size:
        column = tableau[:mixed, gains[0]]
        ratios = np.divide(tableau[:mixed, -1], column, out=np.full(mixed, np.inf), where=column > ZERO)
        tied = np.flatnonzero(ratios <= ratios.min() + ZERO)
        row = tied[np.argmin(basis[tied])]
        tableau[row] /= tableau[row, gains[0]]
        others = np.arange(mixed + 1) != row
        tableau[others] -= np.outer(tableau[others, gains[0]], tableau[row])
        basis[row] = gains[0]
    weights = np.zeros(axes + mixed)
    weights[basis] = np.maximum(tableau[:mixed, -1], 0.0)
    return float(1.0 / weights[:axes].sum() - shift), weights[:axes] / weights[:axes].sum()
