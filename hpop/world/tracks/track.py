"""Track of a person: recorded or predicted positions at times, with straight lines between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray, frozen
from hpop.base.math import is_symbolic
from hpop.base.options import FARTHEST, MOST, truth
from hpop.base.symbols import lift
from hpop.base.text import shown
from hpop.errors import MapError

FASTEST = 10.0
"""Speed, m/s, above which a unit or frame rate must be wrong: no person in a building runs faster."""
FASTEST_VEHICLE = 100.0
"""Speed, m/s, above which the track of a vehicle must be wrong."""
MOST_POINTS = 100_000
"""Largest number of points of a track: more than an hour at 25 per second."""


@checked_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Track:
    """Track of a person: positions at times, joined by straight lines at constant speed.

    times     (N,)  s  rising, at least two; 0 is now, and earlier times are allowed
    x, y      (N,)  m
    recorded  whether it is a recording rather than a prediction; a recording is not cut at walls and horizons
    vehicle   whether a vehicle moves, which may be faster than a person

    Raises MapError for times that do not rise, invalid numbers, fewer than two points, or a speed above ``FASTEST``
    (for a recording its mean speed, because single points may be wrong); of a vehicle, above ``FASTEST_VEHICLE``.

    >>> track = Track.through([(0, 0.0, 0.0), (2, 2.0, 0.0), (3, 2.0, 1.0)])
    >>> [float(column) for column in track.at(2.5)], [float(column) for column in track.velocity(2.5)]
    ([2.0, 0.5], [0.0, 1.0])
    """

    times: FloatArray
    x: FloatArray
    y: FloatArray
    recorded: bool = False
    vehicle: bool = False

    def __post_init__(self) -> None:
        for name, most in (("times", MOST), ("x", FARTHEST), ("y", FARTHEST)):
            object.__setattr__(self, name, _column(name, getattr(self, name), most))
        for name in ("recorded", "vehicle"):
            object.__setattr__(self, name, truth(name, getattr(self, name), error=MapError))
        count = self.times.size
        if not count == self.x.size == self.y.size:
            raise MapError(
                f"times, x and y of a track must have one length; got {count}, {self.x.size} and {self.y.size}."
            )
        if not 2 <= count <= MOST_POINTS:
            least = "; a standing person needs no track" if count < 2 else ""
            raise MapError(f"a track must have 2 to {MOST_POINTS:,} points; got {count:,}{least}.")
        steps = np.diff(self.times)
        if not (steps > 0).all():
            place = int(np.argmin(steps > 0))
            before, after = self.times[place : place + 2].tolist()
            fault = "the same time twice" if before == after else "a time that goes back"
            raise MapError(
                f"the times of a track must rise; got {fault}: {before:g} s at point {place}, then {after:g} s (points "
                "are counted from 0). Sort the points by time, and leave repeated ones out."
            )
        ways = np.hypot(np.diff(self.x), np.diff(self.y))
        with np.errstate(over="ignore"):  # for times 1e-320 s apart, which are refused
            legs, whole = ways / steps, ways.sum() / np.float64(self.end - self.begin)
        speed = whole if self.recorded and np.isfinite(legs).all() else legs.max()
        most, whose = (FASTEST_VEHICLE, "any vehicle goes") if self.vehicle else (FASTEST, "anybody runs")
        if speed > most:
            raise MapError(
                f"a track has a speed of {speed:.3g} m/s, faster than {whose} ({most:g} m/s). Positions are in "
                "m and times in s: check the unit (cm, mm?) and the frame rate."
            )

    @classmethod
    def through(cls, waypoints: Sequence[Sequence[float]]) -> Track:
        """Return a predicted track through waypoints (t, x, y), in s and m; MapError for invalid waypoints."""
        wrong = f"waypoints must be a list of (t, x, y), s and m; got {shown(waypoints)}."
        try:
            rows = [tuple(point) for point in waypoints]
        except TypeError:
            raise MapError(wrong) from None
        if any(len(row) != 3 for row in rows):
            raise MapError(wrong)
        times, x, y = ([row[i] for row in rows] for i in range(3))
        return cls(times, x, y)  # type: ignore[arg-type]  # checked there

    @property
    def begin(self) -> float:
        """Return the first time, s."""
        return float(self.times[0])

    @property
    def end(self) -> float:
        """Return the last time, s."""
        return float(self.times[-1])

    @property
    def speed(self) -> float:
        """Return the greatest speed between two successive points, m/s."""
        return float(np.hypot(*self._velocities).max())

    def at(self, t: Column) -> tuple[Column, Column]:
        """Return the position (x, y), m, at times t, s; beyond the ends the first or last position."""
        if not is_symbolic(t):
            return np.interp(t, self.times, self.x), np.interp(t, self.times, self.y)
        within = np.minimum(np.maximum(t, self.begin), self.end)
        legs = _symbolic_legs(self.times[:-1], within)
        since = within - legs(self.times[:-1])
        vx, vy = self._velocities
        return legs(self.x[:-1]) + legs(vx) * since, legs(self.y[:-1]) + legs(vy) * since

    def velocity(self, t: Column) -> tuple[Column, Column]:
        """Return the velocity (x, y), m/s, at times t, s; it is 0 before the first and from the last time on.

        At a time of the track it is the velocity towards the next point.
        """
        vx, vy = (np.concatenate([[0.0], part, [0.0]]) for part in self._velocities)
        return self._of_leg(t, vx), self._of_leg(t, vy)

    def ahead(self, t: Column) -> tuple[Column, Column] | None:
        """Return the unit vector (x, y) in which the person walks at times t, s; None if the person never walks.

        At rest it is the direction of the last movement, and before any movement that of the first.
        """
        if self._ahead is None:
            return None
        ux, uy = self._ahead
        return self._of_leg(t, ux), self._of_leg(t, uy)

    def later(self, t: float) -> Track:
        """Return the track with its time ``t``, s, as the new time 0, without points before the leg at this time.

        At least the last two points stay.
        """
        first = min(max(int(np.searchsorted(self.times, t, side="right")) - 1, 0), self.times.size - 2)
        return replace(self, times=self.times[first:] - t, x=self.x[first:], y=self.y[first:])

    def until(self, t: float) -> Track:
        """Return the track up to time t, s; unchanged if it ends before. MapError unless t is after its first time."""
        kept = int(np.searchsorted(self.times, t, side="left"))
        if kept == 0 or t <= self.begin:
            raise MapError(f"a track that begins at {self.begin:g} s cannot end at {t:g} s; give a later time.")
        if kept == self.times.size:
            return self
        x, y = self.at(t)
        parts = ((self.times, t), (self.x, x), (self.y, y))
        times, x, y = (np.append(column[:kept], last) for column, last in parts)
        return replace(self, times=times, x=x, y=y)

    def describe(self) -> dict[str, Any]:
        """Return a JSON-able description: the constructor's arguments."""
        columns = {"times": self.times.tolist(), "x": self.x.tolist(), "y": self.y.tolist()}
        return {**columns, **{name: True for name in ("recorded", "vehicle") if getattr(self, name)}}

    @cached_property
    def _velocities(self) -> tuple[FloatArray, FloatArray]:
        """Return the velocity (x, y) on each leg, m/s: two columns (N-1,)."""
        steps = np.diff(self.times)
        return np.diff(self.x) / steps, np.diff(self.y) / steps

    @cached_property
    def _ahead(self) -> tuple[FloatArray, FloatArray] | None:
        """Return the directions (N+1,) of movement before the track, on its legs, and after it, as unit vectors.

        At rest it is the direction of the last movement, and before any movement that of the first. Return None if the
        person never walks.
        """
        vx, vy = self._velocities
        speed = np.hypot(vx, vy)
        walks = np.flatnonzero(speed > 0)
        if not walks.size:
            return None
        last = walks[np.maximum(np.searchsorted(walks, np.arange(speed.size), side="right") - 1, 0)]
        last = np.concatenate([last[:1], last, last[-1:]])
        return vx[last] / speed[last], vy[last] / speed[last]

    def _of_leg(self, t: Column, values: FloatArray) -> Column:
        """Return values at times t, s, from values (N+1,) that hold before the track, on its legs, and after it."""
        if is_symbolic(t):
            before = np.array([min(self.begin, 0.0) - MOST])
            return _symbolic_legs(np.concatenate([before, self.times]), t)(values)
        return values[np.searchsorted(self.times, t, side="right")]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Track):
            return NotImplemented
        pairs = ((self.times, other.times), (self.x, other.x), (self.y, other.y))
        kinds = (self.recorded, self.vehicle), (other.recorded, other.vehicle)
        return kinds[0] == kinds[1] and all(np.array_equal(own, others) for own, others in pairs)

    def __hash__(self) -> int:
        return hash((self.recorded, self.times.tobytes(), self.x.tobytes(), self.y.tobytes()))

    def __repr__(self) -> str:
        kind = "recorded" if self.recorded else "predicted"
        return f"<Track: {kind}, {self.times.size} points, {self.begin:g} to {self.end:g} s>"


def _column(name: str, values: Any, most: float) -> FloatArray:
    """Return numbers as a read-only array (N,); MapError unless all are from -``most`` to ``most``."""
    try:
        array = np.array(values)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0, dtype=object)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise MapError(f"{name} of a track must be a list of numbers; got {shown(values)}.")
    column = array.astype(np.float64)
    if not (np.abs(column) <= most).all():
        place = int(np.argmin(np.abs(column) <= most))
        raise MapError(
            f"{name} of a track must be numbers from {-most:,.0f} to {most:,.0f}; got {column[place]} at "
            f"point {place} (counted from 0)."
        )
    return frozen(column)


def _symbolic_legs(begins: FloatArray, t: Column) -> Any:
    """Return a function that looks up a value per leg: it takes one value for each leg, and returns them at times t, s.

    t are CasADi symbols. Legs begin at the times ``begins``.
    """
    import casadi  # slow to import

    expression = t.to_casadi()
    if isinstance(expression, casadi.SX):  # cannot be looked up in a table: a sum of steps

        def stepped(values: FloatArray) -> Column:
            rises = np.diff(values).tolist()
            steps = zip(begins[1:].tolist(), rises, strict=True)
            total = sum((rise * (expression >= begin) for begin, rise in steps), casadi.SX(float(values[0])))
            return lift(total + 0.0 * expression, t.shape)

        return stepped
    knots = np.append(begins, begins[-1] + MOST)  # the last leg begins at the last but one
    leg = casadi.low(casadi.DM(knots), casadi.vec(expression), {"lookup_mode": "binary"})
    return lambda values: lift(casadi.MX(casadi.DM(values))[leg], t.shape)
