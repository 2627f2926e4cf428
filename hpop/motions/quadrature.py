"""Means of rates over a phase: an adaptive rule for laws under which a few moments say nearly all.

Two Gauss nodes lie among the five of Kronrod's rule (Kronrod 1965), so both are had at once. Where they differ by more
than a share of the mean, the piece is halved and looked at again. Two rules of degrees 3 and 7 that agree to that share
leave an error of about its square.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from hpop.arrays import Column, FloatArray, IntArray

NODES = 0.5 + 0.5 * np.array([-math.sqrt(6 / 7), -math.sqrt(1 / 3), 0.0, math.sqrt(1 / 3), math.sqrt(6 / 7)])
KRONROD = 0.5 * np.array([98 / 495, 27 / 55, 28 / 45, 27 / 55, 98 / 495])
GAUSS = 0.5 * np.array([0.0, 1.0, 0.0, 1.0, 0.0])
AGREE = 1e-2  # share of the mean by which both rules may differ
HALVINGS = 8  # of a piece, at most: of a rate that jumps, a piece of 1/256 is left
BLOCK = 4096  # pieces at once: their columns stay in the processor's cache


def adaptive_means(values_at: Callable[[FloatArray, IntArray], Column], phases: IntArray, size: int) -> FloatArray:
    """Means (size,) over a phase, of the motions ``phases`` among them; 0 of others.

    values_at : values (N,) of the rate at fractions (N,) of the phase's time, of motions (N,)
    """
    means = np.zeros(size)
    for block in np.array_split(phases, max(1, -(-phases.size // BLOCK))):
        owner, begin, width = block, np.zeros(block.size), 1.0
        scale = np.zeros(0)
        for halvings in range(HALVINGS + 1):
            fractions = begin[:, None] + width * NODES
            values = np.broadcast_to(values_at(fractions.ravel(), np.repeat(owner, NODES.size)), fractions.size)
            values = values.reshape(fractions.shape)
            fine, coarse = values @ KRONROD, values @ GAUSS
            scale = np.abs(values) @ KRONROD if not halvings else scale
            rough = width * np.abs(fine - coarse) > AGREE * scale
            if halvings == HALVINGS:
                rough[:] = False
            means += np.bincount(owner[~rough], width * fine[~rough], minlength=size) if halvings else 0.0
            if not halvings:
                means[owner[~rough]] = fine[~rough]
            if not rough.any():
                break
            width *= 0.5
            owner, scale = np.repeat(owner[rough], 2), np.repeat(scale[rough], 2)
            begin = (begin[rough][:, None] + np.array([0.0, width])).ravel()
    return means
