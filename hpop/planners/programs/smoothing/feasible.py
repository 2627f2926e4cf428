"""The end of a nonlinear program: from a point that nearly keeps all limits to the nearest one that keeps them.

Where the optimum lies in a flat valley, an interior-point method goes on along it for dozens of iterations, and each of
its steps leaves curved limits again by a little. So it is stopped where the gradient is small enough and the limits are
kept within a thousandth or so; what they lack is then less than the square root of what is wanted, and one step of
Newton's method closes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING
from warnings import catch_warnings, simplefilter

import numpy as np

from hpop.base.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

KEPT = 1e-7  # by how much a limit may be exceeded
STEPS = 5
LEAST = 1e-12  # on the diagonal: limits that say the same, or of which nothing is free

Bounds = tuple[FloatArray, FloatArray]


def made_feasible(
    limits: Callable[[FloatArray], tuple[FloatArray, csr_array]], point: FloatArray, box: Bounds, bounds: Bounds
) -> FloatArray | None:
    """A point (d,) in the box whose limits are kept within KEPT, or None if STEPS steps lead to none.

    Newton's method on the equations and on all limits that were exceeded on the way. Steps are the shortest, where a
    variable counts the more the nearer it is to the end of its range: so it stays in it.

    Parameters
    ----------
    limits : from a point to values (m,) and their sparse Jacobian (m, d)
    point : (d,) in the box
    box, bounds : lowest and highest variables (d,) and values (m,)

    >>> from scipy.sparse import csr_array
    >>> circle = lambda x: (np.array([x @ x]), csr_array(2 * x[None]))
    >>> wide, one = np.full(2, np.inf), np.ones(1)
    >>> made_feasible(circle, np.array([0.61, 0.81]), (-wide, wide), (one, one)).round(3)
    array([0.602, 0.799])
    """
    from scipy.sparse import diags_array, eye_array
    from scipy.sparse.linalg import spsolve

    room = np.clip(np.minimum(point - box[0], box[1] - point), 0.0, 1.0)
    active = bounds[0] == bounds[1]
    for _ in range(STEPS):
        values, slopes = limits(point)
        off = values - np.clip(values, *bounds)
        if np.abs(off).max() <= KEPT:
            return point
        active |= off != 0.0
        across = slopes[np.flatnonzero(active)]
        normal = across @ diags_array(room) @ across.T + LEAST * eye_array(across.shape[0])
        with catch_warnings():
            simplefilter("ignore")  # a matrix that is singular shows in what comes of it
            moved = spsolve(normal.tocsc(), off[active])
        if not np.isfinite(moved).all():
            return None
        point = np.clip(point - room * (across.T @ moved), *box)
    return None
