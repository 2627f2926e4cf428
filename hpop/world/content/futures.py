"""Possible futures (weighted predictions) of a person, and checks of the numbers of people, landmarks and zones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

from hpop.base.arguments import checked_arguments
from hpop.base.math import not_radians
from hpop.base.options import FARTHEST, LEAST, MOST, one_of, real
from hpop.base.text import shown
from hpop.errors import MapError
from hpop.world.tracks.track import FASTEST, Track

if TYPE_CHECKING:
    from hpop.world.content.people import Person

Afterwards = Literal["gone", "stays"]
STANDS = (0.0, 0.0)
SAME_SUM = 1e-12  # tolerance of the sum of normalised weights


def named_as(what: str, name: object) -> str:
    """Return "person 'Ada'" or "a person" as the subject of an error message; MapError if the name is no text.

    >>> named_as("person", "Ada"), named_as("person", "")
    ("person 'Ada'", 'a person')
    """
    if not isinstance(name, str):
        raise MapError(f"a {what}'s name must be text; got {shown(name)}.")
    return f"{what} {name!r}" if name else f"a {what}"


def set_numbers(value: object, what: str, *names: str) -> None:
    """Convert the named attributes of a frozen value to floats in place, so that equal values have equal descriptions.

    Raises MapError if one is no finite number; ``what`` names the value in the message.
    """
    for name in names:
        object.__setattr__(value, name, number(what, name, getattr(value, name)))


def number(what: str, name: str, value: Any, least: float | None = None) -> float:
    """Return a value as a finite float of at least ``least``; MapError otherwise.

    ``what`` and ``name`` are for the message. Values named "x" or "y" must also be plausible coordinates.
    """
    most = FARTHEST if name in ("x", "y") else MOST
    return float(real(f"{what}: {name}", value, -most if least is None else least, most, error=MapError))


def pair(what: str, name: str, value: Any, unit: str) -> tuple[float, float]:
    """Return a vector (x, y) as two finite floats; MapError otherwise.

    ``what``, ``name`` and ``unit`` are for the message.
    """
    try:
        x, y = value
    except (TypeError, ValueError):
        raise MapError(f"{what} needs a {name} (x, y), {unit}; got {shown(value)}.") from None
    return number(what, name, x), number(what, name, y)


def check_radians(what: str, name: str, angle: float) -> None:
    """Raise MapError for an angle so large that it was probably given in degrees instead of radians."""
    if advice := not_radians(angle):
        raise MapError(f"{what}: {name} {advice}.")


@checked_arguments
@dataclass(frozen=True)
class Future:
    """One possible future of a person: a predicted motion and its probability (weight).

    weight      above 0; the weights of a person's futures are normalised to sum 1
    velocity    (x, y) m/s
    track       positions over time, instead of a velocity
    until       s   when this future ends, if the person's prediction does not end earlier; None: when that ends
    x, y        m   where this future begins; None: at the person's position. With a track, the future begins where
                the track is at time 0 instead. The track must then be at the person's position, unless x or y is
                given, whatever its value
    yaw, afterwards, spread, growth  see `Person`; None: the person's own values
    """

    weight: float
    velocity: tuple[float, float] = STANDS
    track: Track | None = None
    until: float | None = None
    afterwards: Afterwards | None = None
    spread: float | None = None
    growth: float | None = None
    x: float | None = None
    y: float | None = None
    yaw: float | None = None

    def __post_init__(self) -> None:
        what = "a future"
        object.__setattr__(self, "weight", number(what, "weight", self.weight, LEAST**2))
        object.__setattr__(self, "velocity", checked_velocity(what, self.velocity))
        if self.track is not None:
            check_track(what, self.track, self.velocity)
        for name in ("x", "y", "yaw", "until", "spread", "growth"):
            if getattr(self, name) is not None:
                least = None if name in ("x", "y", "yaw") else 0.0
                object.__setattr__(self, name, number(what, name, getattr(self, name), least))
        check_radians(what, "yaw", self.yaw or 0.0)
        if self.afterwards is not None:
            one_of(f"{what}: afterwards", self.afterwards, get_args(Afterwards), error=MapError)

    @classmethod
    def of(cls, weight: float, person: Person) -> Future:
        """Convert a person with a single prediction to a future with this weight."""
        names = ("velocity", "track", "until", "afterwards", "spread", "growth", "x", "y", "yaw")
        return cls(weight, **{name: getattr(person, name) for name in names})


def check_track(what: str, track: object, velocity: tuple[float, float]) -> None:
    """Raise MapError if a track has the wrong type, or if a velocity is given as well."""
    if not isinstance(track, Track):
        raise MapError(f"{what} needs an hpop.world.Track as its track; got {shown(track)}.")
    if velocity != STANDS:
        raise MapError(f"{what} has a track and a velocity; the track already gives the speed: leave the velocity out.")


def checked_velocity(what: str, given: tuple[float, float]) -> tuple[float, float]:
    """Return a velocity (x, y), m/s, as floats; MapError if it is too fast for a person, as in a wrong unit.

    Speeds below `LEAST`, such as the noise of a tracker, become 0.
    """
    velocity = pair(what, "velocity", given, "m/s")
    speed = math.hypot(*velocity)
    if speed > FASTEST:
        raise MapError(
            f"{what} has a velocity of {speed:.3g} m/s, faster than anybody runs ({FASTEST:g} m/s). Velocities are in "
            "m/s: check the unit."
        )
    return velocity if speed >= LEAST else STANDS


def heading_along(velocity: tuple[float, float]) -> float:
    """Return the direction of a velocity as a heading, rad; 0 for velocity 0."""
    return math.atan2(velocity[1], velocity[0]) if velocity != STANDS else 0.0


def checked_futures(what: str, given: Any, looks_ahead: bool) -> tuple[Future, ...]:
    """Return the futures of a person with weights normalised to sum 1; MapError unless they are a list of `Future`.

    With ``looks_ahead``, a future without a heading (yaw) faces in the direction of its velocity.
    """
    futures = tuple(given) if isinstance(given, Iterable) and not isinstance(given, str) else None
    if futures is None or not all(isinstance(future, Future) for future in futures):
        raise MapError(
            f"{what}: futures must be a list of hpop.world.Future(weight, velocity=...); got {shown(given)}."
        )
    if looks_ahead:
        futures = tuple(replace(f, yaw=heading_along(f.velocity)) if f.yaw is None else f for f in futures)
    total = math.fsum(future.weight for future in futures)
    if not futures or abs(total - 1.0) <= SAME_SUM:
        return futures
    return tuple(replace(future, weight=future.weight / total) for future in futures)
