"""Motions of two arms: that of the working arm, given in advance, and the law of the viewing arm, which has a time."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from hpop.base.arrays import Column, FloatArray, frozen
from hpop.base.text import shown
from hpop.errors import ModelError
from hpop.models.serial_arm.chain import Chain
from hpop.models.serial_arm.laws import CLOCK, Extremes, JointSpline, rate_of
from hpop.motions import LawDefaults, Phase, States
from hpop.trajectories.trajectory import Trajectory

TIME = "time"  # s since the working arm began its motion; a state of the viewing arm
PACE = "pace"  # speed of the joint that is nearest to its top speed, as a share of it; a state of the viewing arm
PEAK = (
    1.5,
    6.0,
)  # largest speed and acceleration of a motion from rest to rest that takes 1 s, as multiples of its length
STEP = 0.01  # s between the samples of a trajectory: joints of 6 rad/s² are then off by at most 1e-4 rad
LONGEST = 3600.0  # s
MOST_ROWS = 100_000
MOST_BYTES = 50_000_000  # of a file
BEYOND = 1e-6  # rad or m: tolerance of joint limits
FORM = (
    "motion must be a trajectory of the working arm, the path of a CSV file with the columns t and each joint, or "
    '{"times": [...], "joints": {joint: [...]}}'
)


@dataclass(frozen=True, eq=False)
class WorkMotion:
    """Motion of an arm that is known in advance: rows of joint values at times.

    names  names of the n joints
    times  (N,)    s, rising from 0
    rows   (N, n)  rad or m; between two rows each joint changes evenly with time
    """

    names: tuple[str, ...]
    times: FloatArray
    rows: FloatArray

    @classmethod
    def of(cls, given: Any, chain: Chain) -> WorkMotion:
        """Return the motion that a user gives for an arm with these joints; its times are shifted to begin at 0.

        given  trajectory, path of a CSV file, or {"times": [...], "joints": {joint: [...]}}

        Raises ModelError for an invalid motion, such as one with other joints.
        """
        columns, names = _columns(given), chain.names
        if sorted(columns) != sorted(("t", *names)):
            raise ModelError(
                f"the motion must give the time t and the joints of the working arm, {', '.join(names)}, got "
                f"{', '.join(map(str, columns)) or 'no columns'}; give the motion of this arm, or rename the columns"
            )
        numbers = {name: _numbers(name, column) for name, column in columns.items()}
        if len({column.size for column in numbers.values()}) > 1:
            raise ModelError("all columns of the motion must have as many rows as the times; complete them")
        times = numbers["t"] - numbers["t"][:1]
        return cls(names, frozen(times), frozen(np.stack([numbers[name] for name in names], axis=1)))._checked(chain)

    def _checked(self, chain: Chain) -> WorkMotion:
        """Return this motion; raise ModelError for too few or too many rows, wrong times, and joints beyond limits."""
        if not 2 <= self.times.size <= MOST_ROWS or self.times[-1] > LONGEST:
            raise ModelError(
                f"the motion must have 2 to {MOST_ROWS:,} rows within {LONGEST:g} s, got {self.times.size:,} "
                f"rows within {self.times.max(initial=0.0):g} s; give times in s, or another number of rows"
            )
        if (steps := np.diff(self.times)).min() <= 0.0:
            row = int(np.argmax(steps <= 0.0)) + 1
            raise ModelError(
                f"the times of the motion must rise, but that of row {row}, {self.times[row]:g} s, is not later than "
                "the one before; sort the rows and leave repeated ones out"
            )
        beyond = ((self.rows < chain.low - BEYOND) | (self.rows > chain.high + BEYOND)) & ~chain.turning
        if beyond.any():
            row, k = (int(place) for place in np.argwhere(beyond)[0])
            raise ModelError(
                f"joint {self.names[k]!r} of the working arm is at {self.rows[row, k]:.4g} in row {row} of its motion, "
                f"beyond its limits of {chain.low[k]:.4g} to {chain.high[k]:.4g}; give values in rad or m within these"
            )
        return self

    @property
    def duration(self) -> float:
        """Duration of the motion, s."""
        return float(self.times[-1])

    def at(self, time: Column) -> FloatArray:
        """Return the joint values (..., n) at times (...), s; before the first row and after the last, it stands."""
        return np.stack([np.interp(time, self.times, column) for column in self.rows.T], axis=-1)

    def states(self, time: Column) -> States:
        """Return the states (M,) of the arm at times (M,), s."""
        return States(**dict(zip(self.names, np.moveaxis(self.at(time), -1, 0), strict=True)))

    def rates(self, time: Column) -> States:
        """Return the joint speeds (M,) at times (M,), s: at a row those after it, at the last row those before it.

        Before the first row and after the last, the speeds are 0.
        """
        after = np.clip(np.searchsorted(self.times, time, side="right"), 1, self.times.size - 1)
        slopes = (np.diff(self.rows, axis=0) / np.diff(self.times)[:, None])[after - 1]
        slopes = np.where(np.asarray((time < 0.0) | (time > self.duration))[..., None], 0.0, slopes)
        return States(**dict(zip(self.names, np.moveaxis(slopes, -1, 0), strict=True)))

    @cached_property
    def _ways(self) -> FloatArray:
        """Distance (N, n) that each joint has moved up to each row, back and forth, rad or m."""
        return np.concatenate([np.zeros((1, len(self.names))), np.cumsum(np.abs(np.diff(self.rows, axis=0)), axis=0)])

    def ways(self, begin: Column, end: Column) -> FloatArray:
        """Return how far (M, n), rad or m, each joint moves, back and forth, between times (M,)."""
        return np.stack(
            [np.interp(end, self.times, way) - np.interp(begin, self.times, way) for way in self._ways.T], axis=-1
        )

    def bends(self, begin: FloatArray, end: FloatArray) -> FloatArray:
        """Return how far (M, n), rad or m, each joint strays at most from an even change between two times (M,)."""
        first = np.searchsorted(self.times, begin, side="right")
        last = np.searchsorted(self.times, end, side="left")
        counts = np.maximum(0, last - first)
        owner = np.repeat(np.arange(begin.size), counts)
        row = first[owner] + np.arange(owner.size) - np.repeat(np.cumsum(counts) - counts, counts)
        low, high = self.at(begin), self.at(end)
        share = ((self.times[row] - begin[owner]) / (end - begin)[owner])[:, None]
        found = np.zeros(low.shape)
        np.maximum.at(found, owner, np.abs(self.rows[row] - low[owner] - share * (high - low)[owner]))
        return found

    def describe(self) -> dict[str, Any]:
        """Return times and joint values for JSON, from which an equal motion can be made."""
        joints = {name: column.tolist() for name, column in zip(self.names, self.rows.T, strict=True)}
        return {"times": self.times.tolist(), "joints": joints}


def _columns(given: Any) -> dict[str, Any]:
    """Return the columns of a motion by name, unchecked, the times as "t" (:meth:`WorkMotion.of`)."""
    if isinstance(given, Trajectory):
        table = given.table(STEP, body="joints")
        return {name: table[name] for name in ("t", *given.model.joints)}
    if isinstance(given, Mapping) and set(given) == {"times", "joints"} and isinstance(given["joints"], Mapping):
        return {"t": given["times"], **given["joints"]}
    if isinstance(given, str | os.PathLike):
        return _read(Path(given))
    raise ModelError(f"{FORM}, got {shown(given)}")


def _read(path: Path) -> dict[str, Any]:
    """Return the columns of a CSV file by name; comments, units, rates and accelerations of joints are left out."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ValueError(f"it is larger than {MOST_BYTES / 1e6:g} MB")
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.reader(line for line in file if not line.startswith("#")))
    except (OSError, ValueError, csv.Error) as error:
        said = f"{error.strerror}; check the path" if isinstance(error, OSError) else error
        raise ModelError(f"cannot read the motion of the working arm from {shown(str(path))}: {said}") from None
    names, *rows = [row for row in lines if row] or [[]]
    names = [name.partition("(")[0].strip() for name in names]
    if any(len(row) != len(names) for row in rows):
        raise ModelError(f"each row of {shown(str(path))} must have {len(names)} numbers, as its first line has names")
    derived = {f"{name}{end}" for name in names for end in ("_rate", "_acceleration")}
    return {name: column for name, *column in zip(names, *rows, strict=True) if name not in derived}


def _numbers(name: str, column: Any) -> FloatArray:
    """Return a column as finite floats; raise ModelError for other values."""
    try:
        values = np.asarray(column, float)
    except (TypeError, ValueError):
        values = np.array([np.nan])
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ModelError(f"column {name!r} of the motion must have one finite number for each row, got {shown(column)}")
    return values


@dataclass(frozen=True)
class ReachInTime(LawDefaults):
    """Law "reach" of an arm whose states have a time: along a straight line in joint space, from rest to rest.

    spline  law of the joints: cubic polynomials of time

    The states say when the motion begins and ends. At each moment all joints have done an equal share of their changes,
    which is a cubic polynomial of time. Without a change of the joints, the motion is a wait. A motion that is cut into
    parts follows this law in each part. Such a part need not begin and end at rest: states at its ends have a pace.
    """

    spline: JointSpline
    kind: str = "reach"

    quadrature: ClassVar[str] = "adaptive"
    even: ClassVar[frozenset[str]] = frozenset({TIME})  # states with a constant second time derivative

    @property
    def varies(self) -> frozenset[str]:
        """Names of the states that change: all joints, the pace and the time."""
        return frozenset((*self.spline.names, PACE, TIME))

    def least(self, start: States, end: States) -> Column:
        """Return the least time (M,), s, that a motion from rest to rest takes; 0 if no joint changes."""
        spline, (speed, acceleration) = self.spline, PEAK
        ways = [self.ways(name, start, end) for name in spline.names]
        by_speed = (speed * way / limit for way, limit in zip(ways, spline.speeds, strict=True))
        by_change = (np.sqrt(acceleration * way / a) for way, a in zip(ways, spline.accelerations, strict=True))
        return np.maximum.reduce([*by_speed, *by_change])

    def phases(self, start: States, end: States) -> tuple[Phase, ...]:
        """Return one phase, in which the share of the motion done is the share of its time."""
        duration = end.time - start.time
        return (Phase(duration, 0.0 * duration, 1.0 + 0.0 * duration, "drive"),)

    def interpolate(self, name: str, start: States, end: States, share: Column) -> Column:
        """Return the time, the pace, or the value of a joint, when ``share`` (0 to 1) of the time is over."""
        if name == TIME:
            return start.time + (end.time - start.time) * share
        ends = self._knots(start, end)
        if name != PACE:
            return self.spline.interpolate(name, *ends, share)
        rates = (np.abs(self.spline.interpolate(rate_of(joint), *ends, share)) for joint in self.spline.names)
        return np.maximum.reduce([rate / speed for rate, speed in zip(rates, self.spline.speeds, strict=True)])

    def slopes(self, name: str, start: States, end: States, share: Column) -> tuple[Column, Column]:
        """Return the first and second derivatives of a state with respect to the share of the time; 0 for the pace."""
        if name == TIME:
            return end.time - start.time + 0.0 * share, 0.0 * (end.time + share)
        if name == PACE:
            return 0.0 * (end.time + share), 0.0 * (end.time + share)
        return self.spline.slopes(name, *self._knots(start, end), share)

    def bends(self, start: States, end: States) -> tuple[Column, Column]:
        """Return zeros (M,), because an arm has no heading and so makes no turns."""
        none = 0.0 * (end.time - start.time)
        return none, none

    def strays(self, start: States, end: States) -> Column:
        """Return the error (M,) of the given end states: 0 if the time advances, inf if it runs backwards.

        If the time stands still, the error is the largest jump of a joint value or speed.
        """
        return self.spline.strays(*self._knots(start, end))

    def ways(self, name: str, start: States, end: States) -> Column:
        """Return how far (M,), rad or m, a joint travels."""
        return np.abs(getattr(end, name) - getattr(start, name))

    def extremes(self, name: str, start: States, end: States) -> Extremes:
        """Return the exact extremes of a joint along each motion (M,)."""
        return self.spline.extremes(name, *self._knots(start, end))

    def _knots(self, start: States, end: States) -> tuple[States, States]:
        """Return both ends as states of the spline, with the joint speeds that follow from their paces."""
        names, speeds = self.spline.names, self.spline.speeds
        ways = [getattr(end, name) - getattr(start, name) for name in names]
        longest = np.maximum.reduce([np.abs(way) / speed for way, speed in zip(ways, speeds, strict=True)])
        scale = np.where(longest > 0.0, 1.0 / np.where(longest > 0.0, longest, 1.0), 0.0)
        return self._knot(start, ways, scale), self._knot(end, ways, scale)

    def _knot(self, state: States, ways: list[Column], scale: Column) -> States:
        names = self.spline.names
        rates = {rate_of(name): state.pace * scale * way for name, way in zip(names, ways, strict=True)}
        return States(**{name: getattr(state, name) for name in names}, **rates, **{CLOCK: state.time})
