"""Paths of a graph of speeds in which one change of speed replaces several at one state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.criteria.costs import motion_costs
from hpop.motions import Motions, laws_of
from hpop.motions.laws import CHANGE
from hpop.planners.graphs.speed_joins import at_speed

if TYPE_CHECKING:
    from hpop.planners.graphs.speeds import SpeedGraph

SAME = 1e-9  # relative difference of equal costs: rounding


def needless_nodes(space: SpeedGraph, ids: IntArray, sizes: IntArray) -> BoolArray:
    """Return a mask of the nodes (N,) of paths that can be left out, since one change of speed replaces several.

    A path may change from rest to a fast class, or back, by way of slower classes at one state. One direct change
    replaces these changes if it costs as much in each criterion.

    ids    (N,)  nodes of all paths, one path after another
    sizes  (n,)  number of nodes of each path
    """
    layer, joins = ids % space.layers, space.is_join(ids)
    same = (np.diff(ids // space.layers) == 0) & ~(joins[1:] | joins[:-1])  # a change of speed
    same[np.cumsum(sizes)[:-1] - 1] = False  # not from one path to the next
    rises, falls = same & (np.diff(layer) > 0), same & (np.diff(layer) < 0)
    begins, middle, ends = layer[:-2], layer[1:-1], layer[2:]
    upwards = _is_one_change(space, ids[1:-1], rises[:-1] & rises[1:], 0 * begins, middle, ends)
    downwards = _is_one_change(space, ids[1:-1], falls[:-1] & falls[1:], begins, middle, 0 * ends)
    passed = np.zeros(ids.size, dtype=np.bool_)
    for _ in range(space.layers - 2):  # from rest onwards, and towards rest
        at_rest = (layer == 0) | passed
        passed[1:-1] |= at_rest[:-2] & upwards | at_rest[2:] & downwards
    return passed


def _is_one_change(space: SpeedGraph, nodes: IntArray, some: BoolArray, *layers: IntArray) -> BoolArray:
    """Return a mask of nodes (n,) where one change from the first to the last of three layers replaces two changes.

    It does so if it costs as much as the two changes, by way of the second layer, in each criterion. Only nodes in the
    mask ``some`` are checked; for others the result is False.
    """
    result, own = some.copy(), np.flatnonzero(some)
    if not own.size:
        return result
    states, law = space.inner.states(nodes[own] // space.layers), laws_of(space.model)[CHANGE]
    at = [at_speed(states, space.speed_of[layer[own]]) for layer in layers]
    whole, *parts = (Motions(space.world, space.model, law, at[i], at[j]) for i, j in ((0, 2), (0, 1), (1, 2)))
    for criterion in space.criteria:
        paid = [motion_costs(criterion, part) for part in parts]
        by_way = np.maximum(*paid) if criterion.aggregate == "max" else sum(paid)
        result[own] &= np.isclose(motion_costs(criterion, whole), by_way, rtol=SAME, atol=SAME * criterion.quantum)
    return result
