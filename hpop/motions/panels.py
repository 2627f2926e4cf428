"""How finely motions are looked at, phase by phase: so many panels, cut where predictions of people have kinks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hpop.arrays import Column, FloatArray, IntArray
from hpop.motions.laws import Phase

if TYPE_CHECKING:
    from hpop.motions.batch import Motions

PANEL_ANGLE = np.deg2rad(10.0)  # a quadrature panel turns no body by more than this
HELD = 1.0  # s: no panel of a hold lasts longer
FASTEST = 10.0  # m/s: nobody runs faster; who is said to is looked at as often as one who does
CURVE_PANELS = 8  # a curve has at least as many: rates have kinks where a speed changes its sign or exceeds a limit


def quadrature_nodes(
    motions: Motions, phase: Phase, within: FloatArray, timed: bool
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Motion, fraction of the phase's time and weight of every node, panels no coarser than promised."""
    panels = panel_counts(motions, phase, timed)
    owner = np.repeat(np.arange(len(motions)), panels)
    panel = np.arange(owner.size) - np.repeat(np.cumsum(panels) - panels, panels)
    count = panels[owner]
    whose, at = kinks_in(motions, phase) if timed else (np.empty(0, np.int64), np.empty(0))
    if not at.size:
        u = ((panel[:, None] + within) / count[:, None]).ravel()  # (nodes,)
        weight = np.repeat(1.0 / (count * within.size), within.size)
        return np.repeat(owner, within.size), u, weight
    owner, begin = np.concatenate([owner, whose]), np.concatenate([panel / count, at])
    order = np.lexsort((begin, owner))
    owner, begin = owner[order], begin[order]
    end = np.where(np.diff(owner, append=len(motions)) > 0, 1.0, np.append(begin[1:], 1.0))
    u = (begin[:, None] + (end - begin)[:, None] * within).ravel()
    return np.repeat(owner, within.size), u, np.repeat((end - begin) / within.size, within.size)


def kinks_in(motions: Motions, phase: Phase) -> tuple[IntArray, FloatArray]:
    """Motion and fraction of the phase's time of every moment within it at which a prediction has a kink."""
    first, last = kinks_between(motions, phase)
    each = last - first
    owner = np.repeat(np.arange(len(motions)), each)
    number = np.arange(owner.size) - np.repeat(np.cumsum(each) - each, each)
    since = motions.world.content.kinks[first[owner] + number] - (motions.t0 + elapsed_before(motions, phase))[owner]
    return owner, np.minimum(since / phase.duration[owner], 1.0)


def kinks_between(motions: Motions, phase: Phase) -> tuple[IntArray, IntArray]:
    """Places (M,) among the kinks of the first within a phase and of the first beyond it."""
    kinks = motions.world.content.kinks if motions.panels is None and motions.t0 is not None else np.empty(0)
    if not kinks.size:
        return np.zeros(len(motions), dtype=np.int64), np.zeros(len(motions), dtype=np.int64)
    begin = motions.t0 + elapsed_before(motions, phase)
    first = np.searchsorted(kinks, begin, side="right")
    return first, np.maximum(first, np.searchsorted(kinks, begin + phase.duration, side="left"))


def panel_counts(motions: Motions, phase: Phase, timed: bool) -> IntArray:
    """Number (M,) of panels in a phase: fixed, or so that none is longer or turns further than promised."""
    if motions.panels is not None:
        return np.full(len(motions), motions.panels)
    walked = min(motions.world.content.fastest, FASTEST) / motions.world.cell * phase.duration if timed else 0.0
    if motions.stands:
        lasting = np.maximum(phase.duration / HELD, walked)
        return np.asarray(np.maximum(1, np.ceil(lasting - 1e-9)), dtype=np.int64)
    share = phase.end - phase.begin
    farthest, most_turned = motions.model.extent(motions)
    lengths = farthest * share / motions.world.cell
    angles = most_turned * share / PANEL_ANGLE
    # Under constant acceleration the fastest panel covers up to twice the mean; 2.42 times where it changes sign.
    stretch = {"speed-up": 2.0, "slow-down": 2.0, "ramp": 2.0, "drive": 2.42}.get(phase.shape, 1.0)
    panels = np.ceil(np.maximum(stretch * np.maximum(lengths, angles), walked) - 1e-9)
    return np.asarray(np.maximum(CURVE_PANELS if phase.shape == "drive" else 1, panels), dtype=np.int64)


def elapsed_before(motions: Motions, phase: Phase) -> Column:
    """Time (M,) from the start of each motion to the start of a phase, s."""
    elapsed: Column = 0.0
    for other in motions.phases:
        if other is phase:
            break
        elapsed = elapsed + other.duration
    return elapsed
