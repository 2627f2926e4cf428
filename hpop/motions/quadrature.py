"""Quadrature nodes and adaptive integrals of rates along motions.

A rate is a cost per second. Adaptive quadrature serves laws whose motions need only a few samples of the rate.

A motion is cut into pieces of equal length; a motion that turns farther gets more pieces. On each piece the rate is
interpolated at five equidistant nodes (degree 4), and also at the first, middle and last node only (degree 2). If the
two interpolants differ at the other nodes by more than a small share of the whole integral, the piece is halved, which
takes four new nodes. Values are compared, not integrals, because differences of both signs would cancel in integrals.
The ends of a piece are nodes, so that a kink near an end is noticed. Let s be the allowed share. The error is then
about s² where the rate is smooth, and about s/10 at a kink.

A rate that jumps, such as a count, is not close to any polynomial. It starts with more pieces. A piece is halved while
the values in it differ, until its possible error (its length times the difference) is a small share of the whole.

A rate that depends on the states only is interpolated as a function of the share of the motion done, and this
interpolant is integrated over time exactly. One set of pieces then serves all phases of a motion (speeding up,
cruising, slowing down), although the rate has kinks over time where two phases meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray, numbered
from hpop.motions.laws import Phase
from hpop.runtime import limits

if TYPE_CHECKING:
    from hpop.motions.batch import Motions

NODES = np.linspace(0.0, 1.0, 5)
BOOLE = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90.0  # weights of the nodes in the mean over a piece
BETWEEN = np.array([[0.375, 0.75, -0.125], [-0.125, 0.75, 0.375]])  # parabola through nodes 0, 2, 4 at nodes 1 and 3
POWERS = np.arange(5)
OF_MOMENTS = np.linalg.inv(NODES ** POWERS[:, None])  # from moments of degree up to 4 to weights of the nodes
LEGENDRE = 0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]  # exact for polynomials of degree 9 in time
LEGENDRE_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(5)[1]
AGREE = 1e-3  # share of the mean rate: allowed difference of the interpolants in a piece of the whole duration
HALVINGS = 10  # most halvings of a piece: for a rate that jumps, down to 1/1024
LONG = 3.0  # rad: largest rotation of a body in a piece before any halving
LONG_FOR_JUMPS = 0.6  # rad: as LONG, for rates that jump
HIDDEN = 2e-2  # share of the largest rate times the duration: allowed error by jumps within pieces
GRAIN = 2.0**20  # fractions are multiples of 1/GRAIN, so that sums of widths are exact
BLOCK = 4096  # pieces in a block: their columns fit the processor's cache

ValuesAt = Callable[[FloatArray, IntArray], Column]
"""Function that evaluates a rate: takes fractions (N,) and indices of motions (N,), returns the values (N,) there."""


WeightsOf = Callable[[FloatArray, FloatArray, IntArray], FloatArray]
"""Function that returns the weights (P, 5) of the rate's values at the nodes of P pieces, to integrate over each piece.

It takes for each piece the fraction (P,) at which it begins, its width (P,) and the index of its motion (P,).
"""
PANEL_ANGLE = np.deg2rad(10.0)  # a quadrature panel turns no body by more than this
HELD = 1.0  # s: no panel of a hold lasts longer
FASTEST = 10.0  # m/s: faster people are sampled as if at this speed
AT_ONCE = 2**18  # panels that are cut together
INTEGRATED = "costs were integrated along motions"
JUST = 1e-9  # s: a moment just before another
FINEST = 0.125  # share of a field cell: least length of a panel, whatever the detail of a rate
CURVE_PANELS = 8  # least panels of a curve: rates have kinks where a speed changes its sign or exceeds a limit


def evenly(begin: FloatArray, width: FloatArray, owner: IntArray) -> FloatArray:
    """Return the weights (P, 5) of the values at the nodes of P pieces, whose weighted sum is the mean over a motion.

    ``begin`` and ``width`` of pieces are fractions, 0 to 1, of the motion or phase. The weights of all its pieces add
    up to 1, if the pieces cover it.
    """
    return width[:, None] * BOOLE


def timed(phases: Sequence[Phase]) -> WeightsOf:
    """Return a function (:data:`WeightsOf`) whose weights integrate over time, s.

    It takes begin and width of pieces as shares of the motion done, not as fractions of its time.

    phases  timing of the motions, which says at what time each share is done
    """

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
        # einsum uses one thread, which is faster for such small matrices.
        return np.asarray(np.einsum("ij,jp->pi", OF_MOMENTS, moments))

    return weights


def elapsed_time(phases: Sequence[Phase]) -> Callable[[FloatArray, IntArray], FloatArray]:
    """Return a function of shares (N,) of motions, with their indices (N,): the time (N,), s, until they are done.

    phases  timing of the motions
    """

    def time_at(share: FloatArray, owner: IntArray) -> FloatArray:
        time = np.zeros(owner.size)
        for phase in phases:
            first, last = phase.begin[owner], phase.end[owner]
            covered = np.where(last > first, last - first, 1.0)
            change = phase.change[owner] if phase.shape == "ramp" else 0.0
            part = np.where(last > first, np.clip((share - first) / covered, 0.0, 1.0), 0.0)
            time += phase.duration[owner] * _time_of(phase.shape, change, part)
        return time

    return time_at


def _time_of(shape: str, change: Column, part: FloatArray) -> FloatArray:
    """Return the fraction of a phase's time after which ``part`` (0 to 1) of its share is done.

    It inverts :meth:`Phase.share`; ``shape`` and ``change`` are those of the phase.
    """
    if shape == "ramp":
        below = (1.0 - change) + np.sqrt(np.maximum(0.0, (1.0 - change) ** 2 + 4.0 * change * part))
        return np.asarray(np.minimum(1.0, np.divide(2.0 * part, below, out=np.zeros_like(part), where=below > 0)))
    if shape == "speed-up":
        return np.sqrt(part)
    return 1.0 - np.sqrt(1.0 - part) if shape == "slow-down" else part


def pieces_of(turned: Column, *, jumps: bool = False) -> IntArray:
    """Return into how many pieces (M,) each motion is cut before any halving.

    turned  bound (M,), rad, on the rotation of any body in each motion
    jumps   True if the rate to be integrated has jumps, which needs more pieces
    """
    return np.asarray(np.maximum(1.0, np.ceil(turned / (LONG_FOR_JUMPS if jumps else LONG))), dtype=np.int64)


def adaptive_integrals(
    values_at: ValuesAt, weights_of: WeightsOf, motions: IntArray, pieces: IntArray, *, jumps: bool = False
) -> FloatArray:
    """Return the integral (M,) of a rate over each of some motions, and 0 for all other motions.

    values_at   evaluates the rate
    weights_of  gives the quadrature weights of pieces
    motions     indices of the motions to integrate over
    pieces      (M,) number of pieces of each motion before any halving
    jumps       True if the rate has jumps, as a count has
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
    """Return slices that divide ``size`` pieces into blocks small enough for the processor's cache."""
    return [slice(begin, begin + BLOCK) for begin in range(0, size, BLOCK)]


def _evenly_cut(motions: IntArray, pieces: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cut motions into pieces of equal width; return index of the motion, begin and width (P,) of each piece.

    Begins and widths are fractions of the motion, rounded to multiples of 1/GRAIN.
    """
    motion, piece = numbered(pieces)
    begin, end = (np.round(number / pieces[motion] * GRAIN) / GRAIN for number in (piece, piece + 1))
    return motions[motion], begin, end - begin


def _at_nodes(
    values_at: ValuesAt, motions: IntArray, owner: IntArray, begin: FloatArray, width: FloatArray
) -> FloatArray:
    """Return the values (P, 5) of a rate at the nodes of pieces; a node shared by two pieces is evaluated once."""
    before = _values(values_at, begin, width, owner, NODES[:-1])
    ends = np.append(before[1:, 0], np.zeros(min(1, owner.size)))
    whole = np.zeros(motions.size), np.ones(motions.size)
    ends[begin + width == 1.0] = _values(values_at, *whole, motions, NODES[-1:])[:, 0]
    return np.column_stack([before, ends])


def _values(
    values_at: ValuesAt, begin: FloatArray, width: FloatArray, owner: IntArray, nodes: FloatArray
) -> FloatArray:
    """Return the values (P, K) of a rate at K nodes of each piece; ``nodes`` (K,) are fractions of a piece."""
    values = np.empty((owner.size, nodes.size))
    for part in _blocks(owner.size):
        fractions = begin[part, None] + width[part, None] * nodes
        found = values_at(fractions.ravel(), np.repeat(owner[part], nodes.size))
        values[part] = np.broadcast_to(found, fractions.size).reshape(fractions.shape)
    return values


def _differences(values: FloatArray, *, jumps: bool) -> FloatArray:
    """Return how much the values (P, 5) at a piece's nodes differ from a parabola through three of them (P,).

    For a rate that jumps, return the largest minus the smallest value.
    """
    if jumps:
        return np.asarray(values.max(axis=1) - values.min(axis=1))
    return np.asarray(np.abs(values[:, 1::2] - np.einsum("ij,pj->pi", BETWEEN, values[:, ::2])).max(axis=1))


def _may_stay_open(values: FloatArray, weights: FloatArray, owner: IntArray, size: int, *, jumps: bool) -> FloatArray:
    """Return the error (M,), by motion, that a piece may have without being halved.

    The error of a piece is estimated as its :func:`_differences` times its duration. The bound is a share of the
    integral of the absolute rate over the motion; for a rate that jumps, a share of its largest absolute value times
    the motion's duration.
    """
    if not jumps:
        return np.asarray(AGREE * np.bincount(owner, np.abs(values * weights).sum(axis=1), minlength=size))
    largest = np.zeros(size)
    np.maximum.at(largest, owner, np.abs(values).max(axis=1))
    return np.asarray(HIDDEN * largest * np.bincount(owner, weights.sum(axis=1), minlength=size))


class Nodes(NamedTuple):
    """Quadrature nodes of one phase, for consecutive motions of a batch, or for a part of one long motion.

    run     slice of the batch: the motions
    owner   (N,) index of the motion of each node
    u       (N,) fraction of the phase's time at each node
    weight  (N,) weight of each node in the mean over the phase
    """

    run: slice
    owner: IntArray
    u: FloatArray
    weight: FloatArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Return, for each motion of the run, the sum of its nodes' values (N,)."""
        each = np.bincount(self.owner - self.run.start, values, minlength=self.run.stop - self.run.start)
        return np.asarray(each, dtype=np.float64)


def quadrature_nodes(
    motions: Motions, phase: Phase, within: FloatArray, timed: bool, detail: float | None = None
) -> Iterator[Nodes]:
    """Yield the quadrature nodes of one phase of all motions, block by block.

    within  positions of the nodes in a panel (a quadrature interval), 0 to 1
    timed   True if the rate depends on the time; panels then also end where a moving person turns, comes or goes
    detail  m, length within which the rate changes; None for a field cell

    Panels are as short as :meth:`Motions.integrate` promises. A block has about ``AT_ONCE`` panels, to bound memory;
    between blocks the time limit is checked.
    """
    panels = panel_counts(motions, phase, timed, detail)
    first, last = kinks_between(motions, phase) if timed else (0 * panels, 0 * panels)
    for run in runs(panels + last - first):
        if run.start:
            limits.check(INTEGRATED)
        yield from _nodes(motions, phase, within, run, panels[run], (first[run], last[run]))


def runs(sizes: IntArray) -> Iterator[slice]:
    """Yield slices that divide motions, in order, into blocks of at most ``AT_ONCE`` panels, or of a single motion.

    sizes  (M,) number of panels of each motion
    """
    until, begin = np.cumsum(sizes), 0
    while begin < sizes.size:
        before = int(until[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(until, before + AT_ONCE, side="right")))
        yield slice(begin, end)
        begin = end


def _nodes(
    motions: Motions, phase: Phase, within: FloatArray, run: slice, panels: IntArray, kinks: tuple[IntArray, IntArray]
) -> Iterator[Nodes]:
    """Yield the nodes of one block of motions, the slice ``run``.

    panels  number of panels of each motion
    kinks   for each motion, as from :func:`kinks_between`: index of the first kink at which its panels are also cut,
            and of the first one after these
    """
    motion, panel = numbered(panels)
    owner, count = motion + run.start, panels[motion]
    whose, at = _kinks_in(motions, phase, run, *kinks)
    if at.size:
        owner, begin = np.concatenate([owner, whose]), np.concatenate([panel / count, at])
        order = np.lexsort((begin, owner))
        owner, begin = owner[order], begin[order]
        end = np.where(np.diff(owner, append=run.stop) > 0, 1.0, np.append(begin[1:], 1.0))
    for low in range(0, owner.size, 2 * AT_ONCE):
        if low:
            limits.check(INTEGRATED)
        part = slice(low, low + 2 * AT_ONCE)
        if at.size:
            share = end[part] - begin[part]
            u = (begin[part, None] + share[:, None] * within).ravel()
        else:
            share = 1.0 / count[part]
            u = ((panel[part, None] + within) / count[part, None]).ravel()  # (nodes,)
        yield Nodes(run, np.repeat(owner[part], within.size), u, np.repeat(share / within.size, within.size))


def _kinks_in(
    motions: Motions, phase: Phase, run: slice, first: IntArray, last: IntArray, before: float = 0.0
) -> tuple[IntArray, FloatArray]:
    """Return the kinks in a phase, or the moments ``before`` s earlier, as motion indices and fractions of its time.

    A kink is a time at which a moving person turns, comes or goes. ``first`` and ``last`` are each motion's indices
    among the kinks of the world, as from :func:`kinks_between`.
    """
    each = last - first
    if not each.any():
        return np.empty(0, np.int64), np.empty(0)
    owner, number = numbered(each)
    whose = owner + run.start
    since = motions.world.content.kinks[first[owner] + number] - (motions.t0 + elapsed_before(motions, phase))[whose]
    return whose, np.clip((since - before) / np.maximum(phase.duration[whose], JUST), 0.0, 1.0)


def before_kinks(motions: Motions, phase: Phase) -> tuple[IntArray, FloatArray]:
    """Return the moments just before the kinks in a phase, as motion indices and fractions of the phase's time.

    A kink is a time at which a moving person turns, comes or leaves. A prediction that jumps has its new value at the
    kink itself. A person who leaves is therefore seen only just before the kink.
    """
    return _kinks_in(motions, phase, slice(0, len(motions)), *kinks_between(motions, phase, JUST), before=JUST)


def kinks_between(motions: Motions, phase: Phase, beyond: float = 0.0) -> tuple[IntArray, IntArray]:
    """Return, for each motion (M,), indices in the world's kinks: of the first within a phase, and the first after it.

    A kink is a time at which a moving person turns, comes or leaves. ``beyond`` s are added to the end of the phase.
    """
    kinks = motions.world.content.kinks if motions.panels is None and motions.t0 is not None else np.empty(0)
    if not kinks.size:
        return np.zeros(len(motions), dtype=np.int64), np.zeros(len(motions), dtype=np.int64)
    begin = motions.t0 + elapsed_before(motions, phase)
    first = np.searchsorted(kinks, begin, side="right")
    return first, np.maximum(first, np.searchsorted(kinks, begin + phase.duration + beyond, side="left"))


def panel_counts(motions: Motions, phase: Phase, timed: bool, detail: float | None = None) -> IntArray:
    """Return into how many panels (quadrature intervals) a phase of each motion is cut (M,).

    The number is ``motions.panels`` if that is set. Otherwise it is so large that in each panel the robot moves and
    turns no more than :meth:`Motions.integrate` says.

    timed   True if the rate depends on the time: in a panel, no person then walks farther than a field cell
    detail  m, length within which a rate changes: in a panel, the robot and the fastest person together move at most
            half of it
    """
    if motions.panels is not None:
        return np.full(len(motions), motions.panels)
    cell = motions.world.cell
    fine = np.inf if detail is None else max(0.5 * detail, FINEST * cell)
    walked = min(motions.world.content.fastest, FASTEST) * phase.duration if timed else 0.0 * phase.duration
    if motions.stands:
        lasting = np.maximum(phase.duration / HELD, walked / min(cell, fine))
        return np.asarray(np.maximum(1, np.ceil(lasting - 1e-9)), dtype=np.int64)
    share = phase.end - phase.begin
    farthest, most_turned = motions.model.extent(motions)
    # Under constant acceleration the fastest panel covers up to twice the mean; 2.42 times where it changes sign.
    stretch = {"speed-up": 2.0, "slow-down": 2.0, "ramp": 2.0, "drive": 2.42}.get(phase.shape, 1.0)
    lengths, angles = stretch * farthest * share, stretch * most_turned * share
    panels = np.maximum(np.maximum(lengths, walked) / cell, np.maximum(angles / PANEL_ANGLE, (lengths + walked) / fine))
    least = CURVE_PANELS if phase.shape == "drive" else 1
    return np.asarray(np.maximum(least, np.ceil(panels - 1e-9)), dtype=np.int64)


def elapsed_before(motions: Motions, phase: Phase) -> Column:
    """Return the time (M,), s, from the start of each motion to the start of one of its phases."""
    elapsed: Column = 0.0
    for other in motions.phases:
        if other is phase:
            break
        elapsed = elapsed + other.duration
    return elapsed
