"""Check of pushes by brute force, imported by the planner of the benchmark live.py; it is no benchmark of its own.

Each push is kept with the ways among which it chose. When the file of the environment variable CHECKED_PUSHES exists,
after the last push, all are compared: no way that was not found blocked lies nearer to the push than the one taken.
The result is written to the same name with .json.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

import numpy as np

import hpop
from hpop.base.arrays import FloatArray
from hpop.live import cards, offered_drive
from hpop.trajectories.trajectory import Trajectory


@hpop.criterion("checked_pushes", group="O", unit="s", aggregate="sum")
@dataclass(frozen=True)
class Nothing:
    """Cost of nothing: a file that is imported has to register something."""

    def cost(self, m: hpop.Motions) -> FloatArray:
        """Return 0 for each motion."""
        return np.zeros(len(m))


ASKED = Path(os.environ.get("CHECKED_PUSHES", os.devnull))
kept: list[tuple[tuple[Trajectory, ...], float, set[int], int | None]] = []


def observed(
    ways: cards.Ways, heading: float, is_open: Callable[[int], bool] = lambda row: True
) -> cards.Pushed | None:
    """Return the way nearest to a push, and keep what it chose from."""
    blocked = set[int]()

    def noted(row: int) -> bool:
        if is_open(row):
            return True
        blocked.add(row)
        return False

    found = cards.nearest_to_push(ways, heading, noted)
    kept.append((ways.trajectories, heading, blocked, None if found is None else found.row))
    return found


def mean_angle(way: Trajectory, heading: float) -> float:
    """Return the mean angle, rad, between a heading and that of a way, at 0, 0.1, ..., 3 s."""
    yaws = way.at(np.minimum(0.1 * np.arange(31), way.duration)).yaw
    return float(np.abs(np.angle(np.exp(1j * (yaws - heading)))).mean())


def check() -> None:
    """Wait for the file, compare all pushes, and write the result."""
    while not ASKED.is_file():
        time.sleep(0.5)
    wrong = compared = 0
    for ways, heading, blocked, row in kept:
        gaps = [np.inf if i in blocked else mean_angle(way, heading) for i, way in enumerate(ways)]
        compared += len(gaps)
        wrong += len(blocked) < len(gaps) if row is None else gaps[row] > min(gaps) + 1e-9
    if kept:
        result = {"pushes": len(kept), "ways": compared, "wrong": int(wrong)}
        part = ASKED.with_suffix(".part")
        part.write_text(json.dumps(result))
        part.rename(ASKED.with_suffix(".json"))


if "CHECKED_PUSHES" in os.environ:
    offered_drive.nearest_to_push = observed
    Thread(target=check, daemon=True).start()
