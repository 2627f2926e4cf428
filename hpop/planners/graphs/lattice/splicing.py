"""Compiled loop that joins the arcs of a lattice after a local change from those before it and those made again.

Imported on first use only, because importing numba takes a quarter of a second.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import IntArray
from hpop.runtime.compiled import lean


@lean
def splice(
    first: IntArray,
    count: IntArray,
    is_new: NDArray[np.bool_],
    heads: NDArray[np.int32],
    kinds: NDArray[np.uint8],
    number: NDArray[np.int32],
    new_heads: NDArray[np.int32],
    new_kinds: NDArray[np.uint8],
    new_number: NDArray[np.int32],
    out_heads: NDArray[np.int32],
    out_kinds: NDArray[np.uint8],
    origin: NDArray[np.int32],
) -> None:
    """Write the heads, kinds and origins (m,) of the arcs that leave each position.

    first, count, is_new  (P,)  the first arc of each position, their number, and whether they are made again
    heads, kinds                of the arcs before the change
    number                (n,)  number of each of its states after the change, -1 for none
    new_heads, ...              of the arcs that are made again
    origin                      index of an arc before the change; -1 for an arc that was made again
    """
    m = 0
    for p in range(first.size):
        if is_new[p]:
            for a in range(first[p], first[p] + count[p]):
                out_heads[m] = new_number[new_heads[a]]
                out_kinds[m] = new_kinds[a]
                origin[m] = -1
                m += 1
        else:
            for a in range(first[p], first[p] + count[p]):
                out_heads[m] = number[heads[a]]
                out_kinds[m] = kinds[a]
                origin[m] = a
                m += 1
