"""Poses along a trajectory that are as far apart as paths ask for, whatever the time between them."""

from __future__ import annotations

import numpy as np

from hpop.trajectories.poses import Poses, poses_at
from hpop.trajectories.trajectory import Trajectory

APART = 0.05  # m between the poses of a path, at most; a cell of a usual map
TURNED = np.deg2rad(45.0)  # between them, at most, so that it is clear which way round a turn goes
FINE = 0.02  # s between the moments that are looked at
STEPS = 8  # of these in each motion, at least
SAME = 1e-9  # of what poses are apart: what has moved less has not


def spaced(run: Trajectory, body: str, *, planned: bool, timed: bool = False) -> Poses:
    """Poses of a body where each motion begins and ends, and between these every 5 cm or 45 degrees.

    A turn in place has several poses at one position, bit for bit. What stands still has none of its own, unless the
    poses are ``timed``: then the pose is there twice, when it is reached and when it is left.

    Parameters
    ----------
    run : a plan, or an execution; ``planned`` says which
    """
    durations = run.durations
    pieces = np.maximum(STEPS, np.ceil(durations / FINE)).astype(np.int64)
    owner = np.repeat(np.arange(len(run)), pieces)
    within = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    times = np.append(run.times[owner] + within * (durations / pieces)[owner], run.duration)
    times, first = np.unique(times, return_index=True)  # motions that last no time
    owner, within = np.append(owner, len(run))[first], np.append(within, 0)[first]
    fine = poses_at(run, times, body=body, planned=planned)
    moved = np.linalg.norm(np.diff(fine.positions, axis=0), axis=1)
    chords = np.linalg.norm(np.diff(fine.quaternions, axis=0), axis=1)
    turned = 4.0 * np.arcsin(np.minimum(1.0, 0.5 * chords))
    far = np.append(0.0, np.cumsum(np.maximum(moved / APART, turned / TURNED)))
    begins = within == 0
    since = far - np.maximum.accumulate(np.where(begins, far, 0.0))
    kept = begins | (np.diff(np.floor(since + 1e-9), prepend=0.0) > 0)
    chosen = np.flatnonzero(kept)
    early = np.append(np.diff(far[chosen]) < SAME, False) & ~begins[chosen]  # the half of a turn that stands, its end
    chosen = chosen[~early]
    again = np.append(False, np.diff(far[chosen]) < SAME)  # the end of a hold
    return poses_at(run, times[chosen if timed else chosen[~again]], body=body, planned=planned)
