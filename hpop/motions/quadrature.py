"""Integrals of rates by adaptive rules, for laws under which a few moments of a motion say nearly all.

A motion is cut into even pieces, the more the farther it goes. Five nodes, even as well, interpolate the rate on a
piece, and so do the first, the middle and the last alone. Where the two differ at the other nodes by more than a share
of the whole, the piece is halved, which takes four nodes more. Values are compared, and not integrals, in which
differences of both signs cancel; and as the ends are nodes, a kink near one is seen too. Interpolants of degree 2 and 4
that agree to that share leave an error of about its square where a rate is smooth, and a tenth of it at a kink.

A rate that jumps is no polynomial anywhere. It begins with more pieces, which are halved while the values within one
differ, until what its length times the difference can hide is a share of the whole.

A rate that reads the states alone is interpolated over the share of the motion done, and integrated over time exactly:
one rule then serves all phases of a law's timing, whose joints would be kinks of the rate over time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray, numbered

if TYPE_CHECKING:
    from hpop.motions.laws import Phase

NODES = np.linspace(0.0, 1.0, 5)
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0  # of means over a piece
BETWEEN = np.array([[0.375, 0.75, -0.125], [-0.125, 0.75, 0.375]])  # a parabola by nodes 0, 2 and 4, at nodes 1 and 3
POWERS = np.arange(5)
OF_MOMENTS = np.linalg.inv(NODES ** POWERS[:, None])  # what moments of degree up to 4 make of the weights of the nodes
LEGENDRE = 0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]  # exact for polynomials of degree 9 in time
LEGENDRE_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(5)[1]
AGREE = 1e-3  # of the mean rate: by so much the interpolants of a piece that takes all of the time may differ
HALVINGS = 10  # of a piece, at most: of a rate that jumps, a piece of 1/1024 is left
LONG = 3.0  # rad that a body turns at most in a piece at the beginning
LONG_FOR_JUMPS = 0.6  # the same of rates that jump
HIDDEN = 2e-2  # of the largest rate times the duration: what values that differ within a piece may hide
GRAIN = 2.0**20  # of which fractions are multiples: adding up widths is exact, and what has ended has, under a root too
BLOCK = 4096  # pieces at once: their columns stay in the processor's cache

ValuesAt = Callable[[FloatArray, IntArray], Column]
"""Values (N,) of a rate at fractions (N,) of the motion, of motions (N,)."""


WeightsOf = Callable[[FloatArray, FloatArray, IntArray], FloatArray]
"""What values (P, 5) at the nodes of pieces are multiplied by for the integrals over them.

The pieces begin at fractions (P,) and have widths (P,), of motions (P,).
"""


def evenly(begin: FloatArray, width: FloatArray, owner: IntArray) -> FloatArray:
    """Weights (P, 5) of means over the fraction."""
    return width[:, None] * BOOLE


def timed(phases: Sequence[Phase]) -> WeightsOf:
    """Of time integrals over the share done, under phases that cover a motion."""

    def weights(begin: FloatArray, width: FloatArray, owner: IntArray) -> FloatArray:
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
        # By einsum: products with a matrix so small would be shared by threads that wait for each other.
        return np.asarray(np.einsum("ij,jp->pi", OF_MOMENTS, moments))

    return weights


def _time_of(shape: str, change: Column, part: FloatArray) -> FloatArray:
    """Fraction of a phase's time in which a part of its share is done: the inverse of ``Phase.share``."""
    if shape == "ramp":
        below = (1.0 - change) + np.sqrt(np.maximum(0.0, (1.0 - change) ** 2 + 4.0 * change * part))
        return np.asarray(np.minimum(1.0, np.divide(2.0 * part, below, out=np.zeros_like(part), where=below > 0)))
    if shape == "speed-up":
        return np.sqrt(part)
    return 1.0 - np.sqrt(1.0 - part) if shape == "slow-down" else part


def pieces_of(turned: Column, *, jumps: bool = False) -> IntArray:
    """Pieces (M,) to begin with, of motions in which no body turns farther than so many rad."""
    return np.asarray(np.maximum(1.0, np.ceil(turned / (LONG_FOR_JUMPS if jumps else LONG))), dtype=np.int64)


def adaptive_integrals(
    values_at: ValuesAt, weights_of: WeightsOf, motions: IntArray, pieces: IntArray, *, jumps: bool = False
) -> FloatArray:
    """Integrals (M,) over some of M motions, 0 of the others.

    pieces  (M,) to begin with, of each motion
    jumps   whether the rate jumps
    """
    totals, may_stay = np.zeros(pieces.size), np.zeros(0)
    owner, begin, width = _evenly_cut(motions, pieces[motions])
    values = _at_nodes(values_at, motions, owner, begin, width)
    for halvings in range(HALVINGS + 1):
        if not owner.size:
            break
        weights = np.concatenate([weights_of(begin[part], width[part], owner[part]) for part in _blocks(owner.size)])
        if not halvings:
            may_stay = _may_stay_open(values, weights, owner, pieces.size, jumps=jumps)
        rough = _differences(values, jumps=jumps) * weights.sum(axis=1) > may_stay[owner]
        rough &= halvings < HALVINGS
        totals += np.bincount(owner[~rough], (values * weights)[~rough].sum(axis=1), minlength=pieces.size)
        owner, begin, width, values = owner[rough], begin[rough], width[rough], values[rough]
        between = _values(values_at, begin, width, owner, NODES[:-1] + 0.5 * NODES[1])
        values = np.insert(values, [1, 2, 3, 4], between, axis=1)  # (P, 9)
        values = np.stack([values[:, :5], values[:, 4:]], axis=1).reshape(-1, 5)
        owner, width = np.repeat(owner, 2), np.repeat(0.5 * width, 2)
        begin = np.repeat(begin, 2) + width * np.tile([0.0, 1.0], begin.size)
    return totals


def _blocks(size: int) -> list[slice]:
    """Pieces whose columns stay in the processor's cache; of few at once most time would go between operations."""
    return [slice(begin, begin + BLOCK) for begin in range(0, size, BLOCK)]


def _evenly_cut(motions: IntArray, pieces: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Owner, begin and width (P,) of so many even pieces of each of some motions; all are multiples of 1/GRAIN."""
    motion, piece = numbered(pieces)
    begin, end = (np.round(number / pieces[motion] * GRAIN) / GRAIN for number in (piece, piece + 1))
    return motions[motion], begin, end - begin


def _at_nodes(
    values_at: ValuesAt, motions: IntArray, owner: IntArray, begin: FloatArray, width: FloatArray
) -> FloatArray:
    """Values (P, 5) at the nodes of the pieces of some motions, each shared end once."""
    before = _values(values_at, begin, width, owner, NODES[:-1])
    ends = np.append(before[1:, 0], np.zeros(min(1, owner.size)))
    whole = np.zeros(motions.size), np.ones(motions.size)
    ends[begin + width == 1.0] = _values(values_at, *whole, motions, NODES[-1:])[:, 0]
    return np.column_stack([before, ends])


def _values(
    values_at: ValuesAt, begin: FloatArray, width: FloatArray, owner: IntArray, nodes: FloatArray
) -> FloatArray:
    """Values (P, K) at K nodes of pieces."""
    values = np.empty((owner.size, nodes.size))
    for part in _blocks(owner.size):
        fractions = begin[part, None] + width[part, None] * nodes
        found = values_at(fractions.ravel(), np.repeat(owner[part], nodes.size))
        values[part] = np.broadcast_to(found, fractions.size).reshape(fractions.shape)
    return values


def _differences(values: FloatArray, *, jumps: bool) -> FloatArray:
    """How far (P,) the values (P, 5) of a piece are from a parabola, or from each other if the rate jumps."""
    if jumps:
        return np.asarray(values.max(axis=1) - values.min(axis=1))
    return np.asarray(np.abs(values[:, 1::2] - np.einsum("ij,pj->pi", BETWEEN, values[:, ::2])).max(axis=1))


def _may_stay_open(values: FloatArray, weights: FloatArray, owner: IntArray, size: int, *, jumps: bool) -> FloatArray:
    """How large (M,) differences times what a piece lasts may be, by the pieces that a motion begins with."""
    if not jumps:
        return np.asarray(AGREE * np.bincount(owner, np.abs(values * weights).sum(axis=1), minlength=size))
    largest = np.zeros(size)
    np.maximum.at(largest, owner, np.abs(values).max(axis=1))
    return np.asarray(HIDDEN * largest * np.bincount(owner, weights.sum(axis=1), minlength=size))
