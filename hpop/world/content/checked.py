"""What content is made of, checked: names, numbers and angles, with errors that say whose they are."""

from __future__ import annotations

from typing import Any

from hpop.base.math import not_radians
from hpop.base.options import FARTHEST, MOST, real
from hpop.base.text import shown
from hpop.errors import MapError


def named_as(what: str, name: object) -> str:
    """What an error is about; a name is text.

    >>> named_as("person", "Ada"), named_as("person", "")
    ("person 'Ada'", 'a person')
    """
    if not isinstance(name, str):
        raise MapError(f"a {what}'s name must be text; got {shown(name)}.")
    return f"{what} {name!r}" if name else f"a {what}"


def set_numbers(value: object, what: str, *names: str) -> None:
    """Make attributes floats, so that a description holds the same numbers."""
    for name in names:
        object.__setattr__(value, name, number(what, name, getattr(value, name)))


def number(what: str, name: str, value: Any, least: float | None = None) -> float:
    """A finite number, a coordinate where its name is one; MapError where it is none, or below the least."""
    most = FARTHEST if name in ("x", "y") else MOST
    return float(real(f"{what}: {name}", value, -most if least is None else least, most, error=MapError))


def pair(what: str, name: str, value: Any, unit: str) -> tuple[float, float]:
    """Two finite numbers (x, y), such as a velocity; MapError where they are none."""
    try:
        x, y = value
    except (TypeError, ValueError):
        raise MapError(f"{what} needs a {name} (x, y), {unit}; got {shown(value)}.") from None
    return number(what, name, x), number(what, name, y)


def check_radians(what: str, name: str, angle: float) -> None:
    """Raise MapError for an angle that cannot be in radians."""
    if advice := not_radians(angle):
        raise MapError(f"{what}: {name} {advice}.")
