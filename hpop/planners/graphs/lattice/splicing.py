"""Compiled loop that joins arcs from before a local change with the arcs that were checked again near the change.

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
    """Write the heads, kinds and origins (m,) of all arcs, position by position.

    first, count  (P,)  first arc of each position, and number of its arcs, before the change or among the new arcs
    is_new        (P,)  whether the arcs of a position are the new arcs, checked again
    heads, kinds        of the arcs before the change
    number        (n,)  id after the change of each state before it, negative for none
    new_heads, new_kinds, new_number  the same for the new arcs
    origin              output: index of the arc before the change; -1 for a new arc
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
