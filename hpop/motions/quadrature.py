"""Integrals of rates by adaptive rules, for laws under which a few moments of a motion say nearly all.

Five nodes, those of Kronrod's rule (1965), interpolate the rate on a piece of the motion; so do the inner three.
Where the two integrals differ by more than a share of the whole, the piece is halved and looked at again. Interpolants
of degree 2 and 4 that agree to that share leave an error of about its square, but where they agree by chance: of 400
reaches through the whole space of an arm, rotation and look_at of the worst were 1 % off, and half within 3e-6. What
happens between nodes alone is not seen: of a rate that jumps, as occlusion's, a fifth of a motion was missed.

A rate that reads the states alone is interpolated over the share of the motion done, and integrated over time exactly:
one rule then serves all phases of a law's timing, whose joints would be kinks of the rate over time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.arrays import Column, FloatArray, IntArray

if TYPE_CHECKING:
    from hpop.motions.laws import Phase

NODES = 0.5 + 0.5 * np.array([-math.sqrt(6 / 7), -math.sqrt(1 / 3), 0.0, math.sqrt(1 / 3), math.sqrt(6 / 7)])
KRONROD = 0.5 * np.array([98 / 495, 27 / 55, 28 / 45, 27 / 55, 98 / 495])
GAUSS = 0.5 * np.array([0.0, 1.0, 0.0, 1.0, 0.0])
POWERS = np.arange(5)
OF_MOMENTS = np.linalg.inv(NODES ** POWERS[:, None])  # what moments of degree up to 4 make of the weights of the nodes
OF_FIRST_MOMENTS = np.zeros((5, 5))
OF_FIRST_MOMENTS[1:4, :3] = np.linalg.inv(NODES[1:4] ** POWERS[:3, None])
LEGENDRE = 0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]  # exact for polynomials of degree 9 in time
LEGENDRE_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(5)[1]
AGREE = 3e-3  # share of the whole integral by which both interpolants of a piece may differ
HALVINGS = 8  # of a motion, at most: of a rate that jumps, a piece of 1/256 is left
BLOCK = 4096  # pieces at once: their columns stay in the processor's cache

ValuesAt = Callable[[FloatArray, IntArray], Column]
"""Values (N,) of a rate at fractions (N,) of the motion, of motions (N,)."""


class Weights(NamedTuple):
    """What the values (P, 5) at the nodes of P pieces are multiplied by for the integrals over them."""

    fine: FloatArray
    coarse: FloatArray


WeightsOf = Callable[[FloatArray, float, IntArray], Weights]
"""Weights of pieces that begin at fractions (P,), all of one width, of motions (P,)."""


def evenly(begin: FloatArray, width: float, owner: IntArray) -> Weights:
    """Of means over the fraction."""
    return Weights(width * KRONROD, width * GAUSS)


def timed(phases: Sequence[Phase]) -> WeightsOf:
    """Of time integrals over the share done, under phases that cover a motion."""

    def weights(begin: FloatArray, width: float, owner: IntArray) -> Weights:
        moments = np.zeros((POWERS.size, begin.size))
        for phase in phases:
            first, last = phase.begin[owner], phase.end[owner]
            covered = np.where(last > first, last - first, 1.0)
            ends = (np.clip((edge - first) / covered, 0.0, 1.0) for edge in (begin, begin + width))
            change = phase.change[owner] if phase.shape == "ramp" else 0.0
            low, high = (_time_of(phase.shape, change, part) for part in ends)
            lasts = np.where(last > first, phase.duration[owner] * (high - low), 0.0)
            for node, weight in zip(LEGENDRE, LEGENDRE_WEIGHTS, strict=True):
                share = phase._replace(begin=first, end=last, change=change).share(low + (high - low) * node)
                place, power = (share - begin) / width, weight * lasts
                for moment in moments:
                    moment += power
                    power = power * place
        # By einsum: products of matrices so small would be shared by threads that wait for each other.
        return Weights(*(np.einsum("ij,jp->pi", some, moments) for some in (OF_MOMENTS, OF_FIRST_MOMENTS)))

    return weights


def _time_of(shape: str, change: Column, part: FloatArray) -> FloatArray:
    """Fraction of a phase's time in which a part of its share is done: the inverse of ``Phase.share``."""
    if shape == "ramp":
        below = (1.0 - change) + np.sqrt(np.maximum(0.0, (1.0 - change) ** 2 + 4.0 * change * part))
        return np.asarray(np.minimum(1.0, np.divide(2.0 * part, below, out=np.zeros_like(part), where=below > 0)))
    if shape == "speed-up":
        return np.sqrt(part)
    return 1.0 - np.sqrt(1.0 - part) if shape == "slow-down" else part


class Look(NamedTuple):
    """Integrals (P,) over pieces by five nodes and by three, and of the size of the rate by five."""

    fine: FloatArray
    coarse: FloatArray
    scale: FloatArray


def adaptive_integrals(values_at: ValuesAt, weights_of: WeightsOf, motions: IntArray, size: int) -> FloatArray:
    """Integrals (size,) over some motions; 0 of others."""
    totals, scale = np.zeros(size), np.zeros(0)
    owner, begin, width = motions, np.zeros(motions.size), 1.0
    for halvings in range(HALVINGS + 1):
        if not owner.size:
            break
        # Pieces of a level are looked at together: of few at once most time would go between operations.
        parts = np.array_split(np.arange(owner.size), -(-owner.size // BLOCK))
        looks = [_look(values_at, weights_of, owner[part], begin[part], width) for part in parts]
        fine, coarse, sizes = (np.concatenate(columns) for columns in zip(*looks, strict=True))
        scale = scale if halvings else sizes
        rough = (np.abs(fine - coarse) > AGREE * scale) & (halvings < HALVINGS)
        totals += np.bincount(owner[~rough], fine[~rough], minlength=size)
        width *= 0.5
        owner, scale = np.repeat(owner[rough], 2), np.repeat(scale[rough], 2)
        begin = (begin[rough][:, None] + np.array([0.0, width])).ravel()
    return totals


def _look(values_at: ValuesAt, weights_of: WeightsOf, owner: IntArray, begin: FloatArray, width: float) -> Look:
    """Integrals over pieces, each of a motion (P,), that begin at fractions (P,) of it, all of one width."""
    fractions = begin[:, None] + width * NODES
    values = np.broadcast_to(values_at(fractions.ravel(), np.repeat(owner, NODES.size)), fractions.size)
    values = values.reshape(fractions.shape)
    fine, coarse = (values * some for some in weights_of(begin, width, owner))
    return Look(fine.sum(axis=1), coarse.sum(axis=1), np.abs(fine).sum(axis=1))
