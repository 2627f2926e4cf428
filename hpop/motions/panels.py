"""How finely motions are looked at, phase by phase: so many panels, cut where predictions of people have kinks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hpop.base.arrays import Column, FloatArray, IntArray, numbered
from hpop.motions.laws import Phase
from hpop.runtime import limits

if TYPE_CHECKING:
    from hpop.motions.batch import Motions

PANEL_ANGLE = np.deg2rad(10.0)  # a quadrature panel turns no body by more than this
HELD = 1.0  # s: no panel of a hold lasts longer
FASTEST = 10.0  # m/s: nobody runs faster; who is said to is looked at as often as one who does
AT_ONCE = 2**18  # panels that are cut together
INTEGRATED = "costs were integrated along motions"
JUST = 1e-9  # s: a moment just before another
FINEST = 0.125  # of a field cell: no detail of a rate makes panels shorter
CURVE_PANELS = 8  # a curve has at least as many: rates have kinks where a speed changes its sign or exceeds a limit


class Nodes(NamedTuple):
    """Nodes of a phase, of a run of motions or of a part of one motion.

    run     the motions
    owner   (N,) motion of each node
    u       (N,) fraction of the phase's time
    weight  (N,) of a mean over the phase
    """

    run: slice
    owner: IntArray
    u: FloatArray
    weight: FloatArray

    def sums(self, values: FloatArray) -> FloatArray:
        """Sums of values (N,) over each motion of the run."""
        each = np.bincount(self.owner - self.run.start, values, minlength=self.run.stop - self.run.start)
        return np.asarray(each, dtype=np.float64)


def quadrature_nodes(
    motions: Motions, phase: Phase, within: FloatArray, timed: bool, detail: float | None = None
) -> Iterator[Nodes]:
    """Yield the nodes of all motions, panels no coarser than promised.

    About `AT_ONCE` panels are cut together, so that long motions take time and not memory; in between, the limits are
    asked.
    """
    panels = panel_counts(motions, phase, timed, detail)
    first, last = kinks_between(motions, phase) if timed else (0 * panels, 0 * panels)
    for run in runs(panels + last - first):
        if run.start:
            limits.check(INTEGRATED)
        yield from _nodes(motions, phase, within, run, panels[run], (first[run], last[run]))


def runs(sizes: IntArray) -> Iterator[slice]:
    """Runs of so many panels (M,) each motion, of at most `AT_ONCE` together, or of one motion."""
    until, begin = np.cumsum(sizes), 0
    while begin < sizes.size:
        before = int(until[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(until, before + AT_ONCE, side="right")))
        yield slice(begin, end)
        begin = end


def _nodes(
    motions: Motions, phase: Phase, within: FloatArray, run: slice, panels: IntArray, kinks: tuple[IntArray, IntArray]
) -> Iterator[Nodes]:
    """Nodes of a run of motions of so many panels each, cut at kinks, the first of each and the first beyond."""
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
    """Motion and fraction of the phase's time of the kinks of predictions within it, or of so many seconds before."""
    each = last - first
    if not each.any():
        return np.empty(0, np.int64), np.empty(0)
    owner, number = numbered(each)
    whose = owner + run.start
    since = motions.world.content.kinks[first[owner] + number] - (motions.t0 + elapsed_before(motions, phase))[whose]
    return whose, np.clip((since - before) / np.maximum(phase.duration[whose], JUST), 0.0, 1.0)


def before_kinks(motions: Motions, phase: Phase) -> tuple[IntArray, FloatArray]:
    """Motion and fraction of the phase's time just before every kink after its begin, up to its end.

    A prediction that jumps has its new value at the kink itself: who leaves is there until just before.
    """
    return _kinks_in(motions, phase, slice(0, len(motions)), *kinks_between(motions, phase, JUST), before=JUST)


def kinks_between(motions: Motions, phase: Phase, beyond: float = 0.0) -> tuple[IntArray, IntArray]:
    """Places (M,) among the kinks of the first within a phase and of the first beyond it, or so many seconds later."""
    kinks = motions.world.content.kinks if motions.panels is None and motions.t0 is not None else np.empty(0)
    if not kinks.size:
        return np.zeros(len(motions), dtype=np.int64), np.zeros(len(motions), dtype=np.int64)
    begin = motions.t0 + elapsed_before(motions, phase)
    first = np.searchsorted(kinks, begin, side="right")
    return first, np.maximum(first, np.searchsorted(kinks, begin + phase.duration + beyond, side="left"))


def panel_counts(motions: Motions, phase: Phase, timed: bool, detail: float | None = None) -> IntArray:
    """Number (M,) of panels in a phase: fixed, or so that none is longer or turns further than promised.

    detail  m  of a rate's change: the robot and the fastest person together go no farther than half of it in a panel
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
    """Time (M,) from the start of each motion to the start of a phase, s."""
    elapsed: Column = 0.0
    for other in motions.phases:
        if other is phase:
            break
        elapsed = elapsed + other.duration
    return elapsed
