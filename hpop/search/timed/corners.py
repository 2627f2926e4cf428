"""Corners of what solutions leave uncovered, and whether a label can still get into one.

What no solution covers is nowhere larger than one of finitely many corners, the local upper bounds of the solutions:
with each new solution z, a corner u > z makes way for u with u_j = z_j - 1, one for each j, and those that lie within
others are left out (Klamroth, Lacour and Vanderpooten, "On the representation of the search region in multi-objective
optimization", EJOR 2015). A label with estimate f and costs g may become something uncovered only if for one corner c
f <= c, and w.g + H_w <= w.c for all weights of the joint bounds (:mod:`.joint`), where w.c is infinite if c is in any
cost that w weighs. Labels are weighed rounded down and corners rounded up, so rounding never prunes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray
from hpop.runtime.compiled import lean
from hpop.search.machinery.approximation import ANYTHING
from hpop.search.timed.joint import DOWN, FAR, LANES, UP, Joint

NEVER = 2**31 - 1  # more than any weighed label
MOST_CORNERS = 4096  # of more, one would have to look at too many


def cut_corners(corners: IntArray, covered: IntArray) -> IntArray:
    """The corners (c, k) that are left when a solution covers all from `covered` (k,) on.

    >>> cut_corners(np.array([[9, 9]]), np.array([4, 6])).tolist()
    [[3, 9], [9, 5]]
    """
    hit = (covered <= corners).all(axis=1)
    if not hit.any():
        return corners
    old, kept = corners[hit], corners[~hit]
    k = corners.shape[1]
    new = np.repeat(old, k, axis=0)
    new[np.arange(len(new)), np.tile(np.arange(k), len(old))] = np.tile(covered - 1, len(old))
    new = np.unique(new[(new >= 0).all(axis=1)], axis=0)
    within = np.array([(one <= kept).all(axis=1).any() or (one <= new).all(axis=1).sum() > 1 for one in new], np.bool_)
    return np.concatenate([kept, new[~within]])


def weighed_corners(corners: IntArray, weights: FloatArray) -> NDArray[np.int32]:
    """Weigh corners (c, k) by the weights (b, LANES, k) of joint bounds: (c, b, LANES)."""
    weighed = np.zeros((len(corners), *weights.shape[:2]))
    for j in range(corners.shape[1]):
        limit = corners[:, j, None, None]
        weighed += np.where((limit < ANYTHING) | (weights[:, :, j] == 0), weights[:, :, j] * limit, np.inf)
    return np.minimum(weighed * UP + 1, NEVER).astype(np.int32)


@lean
def may_improve(
    joint: Joint,
    corners: IntArray,
    lanes: NDArray[np.int32],
    row: int,
    g: IntArray,
    f: IntArray,
    hint: IntArray,
    weighed: NDArray[np.int32],
) -> bool:
    """Whether a label in a state, of that row, with costs g and estimate f (k,) may become what no solution covers.

    hint (1,) is the corner that the last one got into; weighed (b, LANES) is room.
    """
    k = len(g)
    tables = len(joint.rows)
    for b in range(tables):
        for lane in range(LANES):
            total = 0.0
            for j in range(k):
                total += joint.weights[b, lane, j] * g[j]
            weighed[b, lane] = np.int32(min(FAR - 1.0, total * DOWN)) + joint.rows[b, row, lane]
    for i in range(-1, len(corners)):
        c = i
        if i < 0:
            c = hint[0]
            if c >= len(corners):
                continue
        inside = True
        for j in range(k):
            inside &= f[j] <= corners[c, j]
        if not inside:
            continue
        for b in range(tables):
            for lane in range(LANES):
                inside &= weighed[b, lane] <= lanes[c, b, lane]
            if not inside:
                break
        if inside:
            hint[0] = c
            return True
    return False
