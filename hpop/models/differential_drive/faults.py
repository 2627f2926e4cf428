"""What a differential drive cannot do: slide sideways, go back, or turn its wheels faster than they can."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from hpop.base.arrays import BoolArray, IntArray
from hpop.motions import Law, States, is_curve, laws_of
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.models.differential_drive.model import DifferentialDrive

CLOSE = 1e-5  # m or rad: two states written in decimals are the same
STEPS = 100  # in which a curve is looked at
FASTER = 1e-3  # share by which a wheel may exceed its limits


def doubtful(law: Law, start: States, end: States) -> BoolArray:
    """Motions (M,) that slide sideways or go back, and all curves, of which only a closer look can tell."""
    if is_curve(law):
        return np.ones(start.size, dtype=bool)
    if not {"x", "y"} <= law.varies:
        return np.zeros(start.size, dtype=bool)
    dx, dy, ahead, left = end.x - start.x, end.y - start.y, np.cos(start.yaw), np.sin(start.yaw)
    astray: BoolArray = (np.abs(dy * ahead - dx * left) > CLOSE) | (dx * ahead + dy * left < -CLOSE)
    return astray


def faults(model: DifferentialDrive, trajectory: Trajectory) -> Iterator[str]:
    """Motions that slide sideways or go back, or whose wheels are faster than the model's, in words."""
    states, wrong = trajectory.states, np.zeros(len(trajectory), dtype=bool)
    kinds = np.array(trajectory.kinds, dtype=object)
    curved = np.zeros(len(trajectory), dtype=bool)
    for kind in dict.fromkeys(trajectory.kinds):
        of_law, law = np.flatnonzero(kinds == kind), laws_of(trajectory.model)[kind]
        if is_curve(law):
            curved[of_law] = True
        else:
            wrong[of_law] = doubtful(law, states.take(of_law), states.take(of_law + 1))
    if wrong.any():
        first = int(np.argmax(wrong))
        yield f"does not go ahead in motion {first}, a {trajectory.kinds[first]}"
    yield from _of_curves(model, trajectory, np.flatnonzero(curved))


def _of_curves(model: DifferentialDrive, trajectory: Trajectory, curved: IntArray) -> Iterator[str]:
    """Told by differences of places and headings over hundredths of each motion."""
    lasts = trajectory.durations[curved]
    times = trajectory.times[curved][:, None] + lasts[:, None] * np.linspace(0.0, 1.0, STEPS + 1)  # (c, STEPS + 1)
    s = trajectory.at(times.ravel())
    x, y, yaw = (np.reshape(column, times.shape) for column in (s.x, s.y, s.yaw))
    dx, dy, turned, heading = np.diff(x), np.diff(y), np.diff(yaw), 0.5 * (yaw[:, 1:] + yaw[:, :-1])
    ahead, side = dx * np.cos(heading) + dy * np.sin(heading), dy * np.cos(heading) - dx * np.sin(heading)
    wheels = np.stack([ahead + sign * 0.5 * model.wheel_base * turned for sign in (-1.0, 1.0)])  # (2, c, STEPS), m
    fastest = np.abs(wheels).max(axis=(0, 2), initial=0.0) * STEPS
    hardest = np.abs(np.diff(wheels)).max(axis=(0, 2), initial=0.0) * STEPS**2
    for wrong, fault in (
        ((np.abs(side) > CLOSE).any(axis=1) | (ahead < -CLOSE).any(axis=1), "does not go ahead"),
        (fastest > model.wheel_speed * lasts * (1 + FASTER) + CLOSE, "drives faster than its wheels can turn"),
        (
            hardest > model.wheel_acceleration * lasts**2 * (1 + FASTER) + CLOSE,
            "speeds up or turns harder than its wheels can",
        ),
    ):
        if wrong.any():
            i = curved[np.argmax(wrong)]
            yield f"{fault} in motion {i}, a {trajectory.kinds[i]}"
