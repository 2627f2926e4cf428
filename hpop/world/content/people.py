"""People: their positions, predictions, and the uncertainty of both.

A person stands, walks at a constant velocity, follows a track, or has several possible futures. A prediction may be
uncertain (an isotropic normal distribution about the predicted position), and it may end.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, get_args

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import Column, FloatArray
from hpop.base.math import smooth_step
from hpop.base.options import LEAST, one_of
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.content.futures import (
    STANDS,
    Afterwards,
    Future,
    check_radians,
    check_track,
    checked_futures,
    checked_velocity,
    heading_along,
    named_as,
    number,
    set_numbers,
)
from hpop.world.tracks.track import Track

SAME_PLACE = 1e-3  # m, tolerance between a person's position and the track at time 0
WIDEST = 2.0
"""Largest radius, m, of a person, including a pram or trolley; a greater number must be in another unit."""


@checked_arguments
@dataclass(frozen=True)
class Person:
    """Person with a position, a heading and a predicted motion. By default the velocity is constant for ever.

    x, y        m     position now
    yaw         rad   heading of the body; default: along the velocity, 0 for a standing person
    velocity    (x, y) m/s
    radius      m     of the body
    name        in messages and pictures
    track       waypoints or a recorded track, instead of a velocity; at time 0 it must be at (x, y)
    futures     several possible futures, instead of a velocity or a track
    spread      m     standard deviation of the position now, along each axis
    growth      m/s   growth of the standard deviation: σ(t)² = spread² + (growth (t + age))², up to ``until``
    until       s     when the prediction ends, None: never; the end of a track ends it too
    afterwards  "gone": the person is absent once the prediction ends; "stays": the person stands there
    age         s     time since the prediction was made

    Raises MapError for contradictory or impossible values.
    """

    x: float
    y: float
    yaw: float = None  # type: ignore[assignment]  # a number from the construction on
    velocity: tuple[float, float] = STANDS
    radius: float = 0.25
    name: str = ""
    track: Track | None = None
    futures: tuple[Future, ...] = ()
    spread: float = 0.0
    growth: float = 0.0
    until: float | None = None
    afterwards: Afterwards = "gone"
    age: float = 0.0

    def __post_init__(self) -> None:
        what = named_as("person", self.name)
        object.__setattr__(self, "velocity", checked_velocity(what, self.velocity))
        looks_ahead = self.yaw is None
        if looks_ahead:
            object.__setattr__(self, "yaw", heading_along(self.velocity))
        set_numbers(self, what, "x", "y", "yaw", "radius")
        check_radians(what, "yaw", self.yaw)
        if not self.radius >= LEAST:
            raise MapError(f"{what} needs a radius above {LEAST:g} m; got {self.radius!r}.")
        if self.radius > WIDEST:
            raise MapError(f"{what} needs a radius of at most {WIDEST:g} m; got {self.radius:g}. Radii are in m.")
        for name in ("spread", "growth", "age", *(() if self.until is None else ("until",))):
            object.__setattr__(self, name, number(what, name, getattr(self, name), 0.0))
        one_of(f"{what}: afterwards", self.afterwards, get_args(Afterwards), error=MapError)
        if self.track is not None:
            self._set_track(what, self.track)
        object.__setattr__(self, "futures", checked_futures(what, self.futures, looks_ahead))
        for future in self.futures:
            self._check_begin(what, future)
        if self.futures and (self.track is not None or self.velocity != STANDS):
            raise MapError(
                f"{what} has futures, each with a velocity or track of its own: leave the person's velocity and track "
                "out."
            )

    def _set_track(self, what: str, track: Track) -> None:
        """Check that the track is at the person's position at time 0; end the prediction with the track."""
        check_track(what, track, self.velocity)
        x, y = (float(place) for place in track.at(0.0))
        if math.hypot(self.x - x, self.y - y) > SAME_PLACE:
            raise MapError(
                f"{what} is at ({self.x:g}, {self.y:g}), but the track is at ({x:g}, {y:g}) at time 0; give the same "
                "position, or use hpop.world.Person.along(track), which takes the position from the track."
            )
        if self.until is not None and self.until < track.begin:
            raise MapError(
                f"{what}: the prediction ends at {self.until:g} s, before the track begins, at {track.begin:g} s; "
                "give a later end (until), or leave the person out."
            )
        until = track.end if self.until is None else min(self.until, track.end)
        for name, value in (("x", x), ("y", y), ("until", max(until, 0.0))):
            object.__setattr__(self, name, value)

    def _check_begin(self, what: str, future: Future) -> None:
        """Check that the track of a future begins at the person, unless the future has a position (x, y) of its own."""
        if future.track is None or future.x is not None or future.y is not None:
            return
        x, y = (float(place) for place in future.track.at(0.0))
        if math.hypot(self.x - x, self.y - y) > SAME_PLACE:
            raise MapError(
                f"{what} is at ({self.x:g}, {self.y:g}), but the track of a future is at ({x:g}, {y:g}) at time 0; "
                "begin the track where the person is, or give that future its own x and y."
            )

    @classmethod
    def along(cls, track: Track, **others: Any) -> Person:
        """Return a person who follows a track; ``others`` are further attributes."""
        if not isinstance(track, Track):
            raise MapError(f"Person.along needs an hpop.world.Track to follow; got {shown(track)}.")
        x, y = track.at(0.0)
        return cls(float(x), float(y), track=track, **others)

    @property
    def moves(self) -> bool:
        """Return whether the position, the presence or the uncertainty of the person changes over time."""
        leaves = self.until is not None and self.afterwards == "gone"
        return self.velocity != STANDS or self.track is not None or bool(self.futures) or self.growth > 0 or leaves

    @property
    def recorded(self) -> bool:
        """Return whether the person follows a recorded track rather than a prediction."""
        return self.track is not None and self.track.recorded

    @property
    def speed(self) -> float:
        """Return the greatest predicted or recorded speed, m/s, over all futures; 0 for a standing person."""
        if self.futures:
            return max(person.speed for _, person in self.hypotheses)
        return math.hypot(*self.velocity) if self.track is None else self.track.speed

    @property
    def settled(self) -> float:
        """Return the time, s, after which nothing about the person changes: 0 if standing, ∞ if it never settles."""
        if self.futures:
            return max(person.settled for _, person in self.hypotheses)
        if not self.moves:
            return 0.0
        return math.inf if self.until is None else self.until

    @cached_property
    def hypotheses(self) -> tuple[tuple[float, Person], ...]:
        """Return one pair (weight, person) per future: the person with this future as the only prediction.

        The weights sum to 1. A person without futures gives one pair, (1.0, person).
        """
        if not self.futures:
            return ((1.0, self),)
        return tuple((future.weight, self._with(future)) for future in self.futures)

    @property
    def likeliest(self) -> Person:
        """Return the hypothesis with the greatest weight, for pictures of a single future."""
        return max(self.hypotheses, key=lambda hypothesis: hypothesis[0])[1]

    @property
    def begin(self) -> float:
        """Return the time, s, at which the person first appears: 0, or the start of a track that starts later.

        Raises MapError for a person with several futures.
        """
        self._check_one("begin")
        return 0.0 if self.track is None else max(self.track.begin, 0.0)

    def way(self) -> FloatArray:
        """Return the predicted path as corners (N, 4): time, s; x, y, m; heading, rad, up to the next corner.

        The person moves straight and at constant speed between corners, and stands or is gone after the last one. The
        first corner is at time 0, also if the person appears only later (:attr:`begin`).

        Raises MapError for several futures or a prediction without end. In a :class:`hpop.Problem` every prediction
        ends.
        """
        self._check_one("way")
        end = self.settled
        if not math.isfinite(end):
            raise MapError(
                f"{named_as('person', self.name)} has a prediction without end, so way() would be endless: give the "
                "time at which the prediction ends (until)."
            )
        corners = [0.0, end] if self.track is None else [0.0, *self.track.times.tolist(), end]
        times = np.unique(np.clip(corners, 0.0, end))
        x, y = self.at(times)
        yaw = np.broadcast_to(self.yaw_at(times), times.shape)
        return np.stack([times, np.broadcast_to(x, times.shape), np.broadcast_to(y, times.shape), yaw], axis=1)

    def _with(self, future: Future) -> Person:
        """Return the person with one of its futures as the only prediction."""
        names = ("x", "y", "yaw", "until", "afterwards", "spread", "growth")
        own = {name: value for name in names if (value := getattr(future, name)) is not None}
        if future.until is not None and self.until is not None:
            own["until"] = min(self.until, future.until)
        if future.track is not None:
            own["x"], own["y"] = (float(place) for place in future.track.at(0.0))
        return replace(self, velocity=future.velocity, track=future.track, futures=(), **own)

    def shifted(self, x: float, y: float) -> Person:
        """Return the person shifted by (x, y), m, with all its tracks and futures."""

        def shifted_track(track: Track | None) -> Track | None:
            return None if track is None else replace(track, x=track.x + x, y=track.y + y)

        def added(value: float | None, shift: float) -> float | None:
            return None if value is None else value + shift

        futures = tuple(
            replace(future, track=shifted_track(future.track), x=added(future.x, x), y=added(future.y, y))
            for future in self.futures
        )
        return replace(self, x=self.x + x, y=self.y + y, track=shifted_track(self.track), futures=futures)

    def at(self, t: Column) -> tuple[Column, Column]:
        """Return the position (x, y), m, at times t, s; it is constant after ``until``.

        Raises MapError for a person with several futures.
        """
        self._check_one("at")
        if self.track is not None:
            return self.track.at(self._up_to_end(t))
        t = self._up_to_end(t)
        return self.x + self.velocity[0] * t, self.y + self.velocity[1] * t

    def velocity_at(self, t: Column) -> tuple[Column, Column]:
        """Return the velocity (x, y), m/s, at times t, s; 0 from ``until`` on.

        Raises MapError for a person with several futures.
        """
        self._check_one("velocity_at")
        if self.velocity == STANDS and self.track is None:
            return STANDS
        vx, vy = self.velocity if self.track is None else self.track.velocity(t)
        walks = 1.0 if self.until is None else 1.0 - smooth_step(t - self.until)
        return vx * walks, vy * walks

    def ahead_at(self, t: Column) -> tuple[Column, Column]:
        """Return the unit vector (x, y) in which the person walks or, at rest, faces, at times t, s.

        A person who stops keeps the direction of the last movement. Raises MapError for a person with several futures.
        """
        self._check_one("ahead_at")
        along = None if self.track is None else self.track.ahead(self._up_to_end(t))
        if along is not None:
            return along
        yaw = self.yaw if self.velocity == STANDS else math.atan2(self.velocity[1], self.velocity[0])
        return math.cos(yaw), math.sin(yaw)

    def yaw_at(self, t: Column) -> Column:
        """Return the heading of the body, rad, at times t, s: along the track if there is one, else ``yaw``.

        Raises MapError for a person with several futures.
        """
        self._check_one("yaw_at")
        along = None if self.track is None else self.track.ahead(np.asarray(self._up_to_end(t)))
        return self.yaw if along is None else np.arctan2(along[1], along[0])

    def there(self, t: Column) -> Column:
        """Return 1 where the person is present at times t (N,), s, else 0; one 1.0 for a person who is always present.

        A person with a track is absent before its first time. A person who is "gone" afterwards is absent from
        ``until`` on.
        """
        self._check_one("there")
        there: Column = 1.0
        if self.until is not None and self.afterwards == "gone":
            there = 1.0 - smooth_step(t - self.until)
        if self.track is not None and self.track.begin > 0:
            there = there * smooth_step(t - self.track.begin)
        return there

    def deviation(self, t: Column) -> Column:
        """Return the standard deviation σ(t) of the position along each axis, m, at times t, s; 0 if it is certain."""
        if self.growth == 0.0:
            return self.spread
        grown = self.growth * (self._up_to_end(t) + self.age)
        return np.sqrt(self.spread * self.spread + grown * grown)

    def later(self, t: float) -> Person:
        """Return the person as predicted ``t`` seconds from now; that moment becomes time 0."""
        if not self.moves:
            return self
        if self.futures:
            each = [(weight, person.later(t)) for weight, person in self.hypotheses]
            x, y = (math.fsum(weight * getattr(person, name) for weight, person in each) for name in "xy")
            futures = tuple(Future.of(weight, person) for weight, person in each)
            return replace(self, x=x, y=y, futures=futures, until=None, age=self._age(t))
        x, y = (float(place) for place in self.at(np.float64(t)))
        if self.until is None:
            return replace(self, x=x, y=y, age=self._age(t))
        if t < self.until:
            track = None if self.track is None else self.track.later(t)
            return replace(self, x=x, y=y, track=track, until=self.until - t, age=self._age(t))
        ux, uy = self.ahead_at(np.float64(t))
        until, yaw = 0.0 if self.afterwards == "gone" else None, math.atan2(uy, ux)
        ended = replace(self, x=x, y=y, yaw=yaw, velocity=STANDS, track=None, until=until)
        return replace(ended, spread=float(self.deviation(t)), growth=0.0, age=0.0)

    def _age(self, t: float) -> float:
        """Return the age, s, that the prediction will have ``t`` seconds from now.

        The age is left unchanged if the uncertainty does not grow, because then it has no effect.
        """
        grows = any(person.growth > 0 for _, person in self.hypotheses)
        return self.age + t if grows else self.age

    def _up_to_end(self, t: Column) -> Column:
        return t if self.until is None else np.minimum(t, self.until)

    def _check_one(self, name: str) -> None:
        if self.futures:
            raise MapError(
                f"{named_as('person', self.name)} has {len(self.futures)} futures, so {name} has no single value: "
                "take it for each (weight, person) of person.hypotheses."
            )


def described_person(person: Person) -> dict[str, Any]:
    """Return a JSON-able description of a person; :func:`person_from` turns it into an equal person.

    Attributes with default values are left out, except position, heading, velocity, radius and name.
    """
    always = ("x", "y", "yaw", "velocity", "radius", "name")
    return {name: _plain(value) for name, value in _attributes(person) if name in always or value != _DEFAULTS[name]}


def person_from(data: Mapping[str, Any]) -> Person:
    """Build a person from a description; MapError, TypeError or LookupError if it is malformed."""
    futures = tuple(Future(**_with_track(future)) for future in data.get("futures", ()))
    return Person(**{**_with_track(data), "futures": futures})


def _with_track(data: Mapping[str, Any]) -> dict[str, Any]:
    return {**data, "track": Track(**data["track"])} if data.get("track") is not None else {**data}


def _attributes(value: Person | Future) -> Iterator[tuple[str, Any]]:
    return ((field.name, getattr(value, field.name)) for field in fields(value))


def _plain(value: Any) -> Any:
    """Return a person's attribute as a JSON-able value."""
    if isinstance(value, Track):
        return value.describe()
    if isinstance(value, Future):
        return {name: _plain(item) for name, item in _attributes(value) if item is not None}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


_DEFAULTS = {field.name: field.default for field in fields(Person)}
