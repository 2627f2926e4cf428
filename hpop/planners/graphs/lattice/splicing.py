"""Compiled loop that merges the old arcs of a lattice with the arcs that were checked again near a change of the world.

The module is imported on first use only, because importing numba takes a quarter of a second.
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
    """Merge old and new arcs, position by position, into the arrays ``out_heads``, ``out_kinds`` and ``origin`` (m,).

    Old arcs are those before a change of the world; new arcs were checked again after it.

    first, count          (P,)  index of the first arc at each position, and number of its arcs, in the list of old arcs
                          or, where ``is_new``, of new arcs
    is_new                (P,)  whether the arcs at a position were checked again, so that the new arcs apply
    heads, kinds          head state and kind of motion of the old arcs
    number                (n,)  number after the change of each state before it; negative if it is blocked now
    new_heads, new_kinds  head state and kind of motion of the new arcs
    new_number            number, after the change, of each state to which ``new_heads`` refers
    out_heads, out_kinds  output: head state and kind of motion of all arcs
    origin                output: index of each arc before the change; -1 for a new arc
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
