"""A trajectory as the page rides along it: poses of the camera and of links twenty times a second, and rates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.problems.trace import trace
from hpop.trajectories.poses import poses
from hpop.trajectories.trajectory import Trajectory
from hpop.view.explorer.along import taken_together, told_ends
from hpop.view.ride.bodies import link_poses
from hpop.world import World

RATE = 20.0
"""Poses a second."""
LENGTH, TURN = 1e-5, 1e-7
"""Steps in which positions, m, and quaternions are told."""
LINK_LENGTH, LINK_TURN = 1e-4, 1e-4
"""The same of links, which are only looked at."""
FIGURES = 4
"""Of rates."""
MOST_PIECES = 1500
"""Of a trace, between which rates are told."""


def track(trajectory: Trajectory) -> dict[str, Any]:
    """Where the camera is when the trajectory is executed, as JSON; the page takes what is between from neighbours."""
    seen = poses(trajectory, rate=RATE)
    links: list[FloatArray] = []
    turns: list[FloatArray] = []
    for positions, quaternions in link_poses(trajectory.model, seen.states):
        links.append(positions)
        turns.append(quaternions)
    columns = [np.hstack([p / LINK_LENGTH, q / LINK_TURN]) for p, q in zip(links, turns, strict=True)]
    return {
        "duration": float(seen.times[-1]),
        "rate": RATE,
        "positions": packed(seen.positions, LENGTH),
        "quaternions": packed(seen.quaternions, TURN),
        "links": packed(np.hstack(columns) * LINK_TURN if columns else np.zeros((len(seen), 0)), LINK_TURN),
    }


def rates(criteria: Sequence[Criterion], trajectory: Trajectory, world: World) -> dict[str, Any] | None:
    """How criteria arise while the trajectory is executed, as JSON; None where it stays at its start."""
    run = trajectory.execution()
    if not len(run) or not criteria:
        return None
    found = trace(criteria, run, world)
    ends = told_ends(len(found.pieces), MOST_PIECES)
    columns = [
        [float(f"{value:.{FIGURES}g}") for value in taken_together(found, column, ends).tolist()]
        for column in range(len(found.criteria))
    ]
    return {"times": np.round(found.times[ends], 4).tolist(), "values": columns}


def packed(values: FloatArray, scale: float) -> dict[str, Any]:
    """Columns of numbers (N, C) in whole steps, each differenced twice: of even motion most are 0.

    >>> packed(np.array([[1.0], [2.0], [3.0]]), 0.5)
    {'scale': 0.5, 'columns': [[2, 0, 0]]}
    """
    counts = np.rint(values / scale).astype(np.int64)
    for _ in range(2):
        counts = np.diff(counts, axis=0, prepend=0)
    return {"scale": scale, "columns": counts.T.tolist()}
