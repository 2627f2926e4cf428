"""Integrals over time of the share of flags that are set along motions, such as the rays of sight that are blocked.

The flags are computed at places evenly spread along a motion. Where a flag has different values at two neighbouring
places, it changes in between. Let the possible error of an interval be its duration times the share of the flags that
differ. As long as that is more than a small share of the whole, the interval is halved; in its middle, only the flags
that differ are computed. At last, changes are taken to happen in the middle of their interval, on average.

A flag that changes twice between two neighbouring places, and nowhere else, is not noticed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hpop.base.arrays import FloatArray, IntArray, numbered
from hpop.motions.bodies import Instants
from hpop.runtime import limits

ASKED = 2  # value of a flag that is to be computed
FLAG_STEP = 0.25  # rad: largest rotation of a body between two of the first places
FEWEST = 4  # intervals of a motion before any halving
OPEN = 5e-3  # share of the largest value times the duration: possible error of an interval that is not halved
HALVINGS = 10  # most halvings of an interval
AT_ONCE = 1 << 22  # flags that are kept together
FEW = 32  # fewer flags of a place do not let more places be kept together: poses of bodies need memory too

Flags = NDArray[np.int8]
"""Flags (N, K) at N places: 0, 1 or ASKED."""

FlagsOf = Callable[[Instants, Flags], None]
"""Function that takes moments within motions, and flags, which it computes where ASKED; it reads no times."""

FlagsAt = Callable[[FloatArray, IntArray, Flags], None]
"""Function that takes shares of motions (N,), indices of motions (N,), and flags, which it computes where ASKED."""

TimeAt = Callable[[FloatArray, IntArray], FloatArray]
"""Function that returns the time (N,), s, after which shares (N,) of motions, with their indices (N,), are done."""


def share_of(flags: FlagsOf, count: int) -> Callable[[Instants], FloatArray]:
    """Return a rate: the share (N,) of ``count`` flags that are set."""

    def share(s: Instants) -> FloatArray:
        values: Flags = np.full((s.state.size, count), ASKED, np.int8)
        flags(s, values)
        return np.asarray(values.mean(axis=1))

    return share


def flags_within(flags: FlagsOf, instants: Callable[[FloatArray, IntArray], Instants]) -> FlagsAt:
    """Return flags as a function of shares of motions; ``instants`` takes shares (N,) and indices of motions (N,)."""
    return lambda share, owner, values: flags(instants(share, owner), values)


def flag_integrals(flags_at: FlagsAt, time_at: TimeAt, motions: IntArray, turned: FloatArray, count: int) -> FloatArray:
    """Return the integral (M,), s, of the share of ``count`` flags that are set, over some motions; 0 for all others.

    flags_at, time_at  compute flags and times
    motions            indices of the motions to integrate over
    turned             bound (M,), rad, on the rotation of any body in each motion
    """
    totals = np.zeros(turned.size)
    steps = np.maximum(FEWEST, np.ceil(turned[motions] / FLAG_STEP)).astype(np.int64)
    until = np.cumsum((steps + 1) * max(count, FEW))
    begin = 0
    while begin < motions.size:
        before = until[begin - 1] if begin else 0
        end = max(begin + 1, int(np.searchsorted(until, before + AT_ONCE, side="right")))
        some = motions[begin:end]
        totals[some] = _of_a_block(flags_at, time_at, some, steps[begin:end], count)
        begin = end
        limits.check("flags were integrated along motions")
    return totals


def _of_a_block(flags_at: FlagsAt, time_at: TimeAt, motions: IntArray, steps: IntArray, count: int) -> FloatArray:
    """Return the integral (M,), s, over some motions that are first cut into ``steps`` (M,) intervals."""
    owner, number = numbered(steps + 1)
    share = number / steps[owner]
    flags: Flags = np.full((owner.size, count), ASKED, np.int8)
    flags_at(share, motions[owner], flags)
    time, sums = time_at(share, motions[owner]), flags.sum(axis=1, dtype=np.int64)
    largest = np.maximum.reduceat(sums, np.flatnonzero(number == 0))
    lasts = time[number == steps[owner]]
    most = OPEN * largest * lasts
    low = np.flatnonzero(number < steps[owner])
    high, owner, totals = low + 1, owner[low], np.zeros(motions.size)
    for halvings in range(HALVINGS + 1):
        width = time[high] - time[low]
        differ = flags[low] != flags[high]
        rough = differ.sum(axis=1) * width > most[owner]
        rough &= halvings < HALVINGS
        done = ~rough
        middle = 0.5 * (sums[low[done]] + sums[high[done]])
        totals += np.bincount(owner[done], middle * width[done], minlength=motions.size)
        if not rough.any():
            break
        low, high, owner, differ = low[rough], high[rough], owner[rough], differ[rough]
        between = 0.5 * (share[low] + share[high])
        found = flags[low]
        found[differ] = ASKED
        flags_at(between, motions[owner], found)
        new = np.arange(owner.size) + share.size
        share, flags = np.concatenate([share, between]), np.concatenate([flags, found])
        time = np.concatenate([time, time_at(between, motions[owner])])
        sums = np.concatenate([sums, found.sum(axis=1, dtype=np.int64)])
        low, high, owner = np.concatenate([low, new]), np.concatenate([new, high]), np.concatenate([owner, owner])
    return totals / count
