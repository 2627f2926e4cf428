"""Messages that a page may send to a live session, checked before they are used."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from hpop.base.text import shown

LONGEST_TEXT = 200
"""Most characters of a name or a wish."""
MOST_CORNERS = 200
MOST_STOPS = 20
MOST_SAMPLES = 120
FARTHEST = 1e6
"""Largest coordinate, m."""
LATEST = 1e14
"""Largest time, ms."""

Check = Callable[[Any], Any]


def number(value: Any) -> float:
    """Return a number of at most `LATEST`, such as a time in ms; ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LATEST:
        raise ValueError("a number")
    return float(value)


def real(value: Any) -> float:
    """Return a number of at most `FARTHEST`, such as a coordinate in m; ValueError for anything else."""
    if abs(number(value)) > FARTHEST:
        raise ValueError(f"a number up to {FARTHEST:,.0f}")
    return float(value)


def angle(value: Any) -> float:
    """Return an angle, rad, as one from -pi to pi; ValueError for anything else."""
    return math.remainder(real(value), math.tau)


def whole(value: Any) -> int:
    """Return a whole number from 0 to `FARTHEST`; ValueError for anything else."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= FARTHEST:
        raise ValueError("a whole number")
    return value


def text(value: Any) -> str:
    """Return a short text; ValueError for anything else."""
    if not isinstance(value, str) or not 0 < len(value) <= LONGEST_TEXT:
        raise ValueError(f"a text of 1 to {LONGEST_TEXT} characters")
    return value


def flag(value: Any) -> bool:
    """Return a truth value; ValueError for anything else."""
    if not isinstance(value, bool):
        raise ValueError("true or false")
    return value


def role(value: Any) -> str:
    """Return the role that a viewer wants, "drive" or "watch"; ValueError for anything else."""
    if value not in ("drive", "watch"):
        raise ValueError("drive or watch")
    return str(value)


def listed(check: Check, least: int, most: int) -> Check:
    """Return a check of a list with ``least`` to ``most`` values."""

    def checked(value: Any) -> list[Any]:
        if not isinstance(value, list) or not least <= len(value) <= most:
            raise ValueError(f"a list of {least} to {most} values")
        return [check(each) for each in value]

    return checked


def place(value: Any) -> dict[str, Any]:
    """Return a destination, {x, y} or {landmark}; ValueError for anything else."""
    if isinstance(value, Mapping) and value.keys() == {"landmark"}:
        return {"landmark": text(value["landmark"])}
    if isinstance(value, Mapping) and value.keys() == {"x", "y"}:
        return {"x": real(value["x"]), "y": real(value["y"])}
    raise ValueError("x and y, or landmark")


POINT = listed(real, 2, 2)
FORMS: dict[str, tuple[dict[str, Check], ...]] = {
    "hello": ({"token": text, "role": role}, {"role": role}),
    "alive": ({},),
    "destination": ({"x": real, "y": real}, {"landmark": text}, {"stops": listed(place, 1, MOST_STOPS)}),
    "take": ({"option": whole}, {"option": whole, "asked": number}),
    "push": ({"direction": angle},),
    "why": ({"x": real, "y": real}, {"region": text}),
    "wish": ({"wish": text},),
    "stop": ({},),
    "go": ({},),
    "close": ({"corners": listed(POINT, 3, MOST_CORNERS), "name": text}, {"corners": listed(POINT, 3, MOST_CORNERS)},
              {"name": text}),
    "open": ({"name": text},),
    "head": ({"samples": listed(listed(number, 3, 3), 0, MOST_SAMPLES)},),
    "setting": ({"name": text, "value": flag},),
}  # fmt: skip
"""For each type of a message, the sets of fields that it may have, and their checks."""
WATCHING = {"hello", "alive", "head"}
"""Types that a viewer who does not drive may send."""


def checked(message: Any) -> tuple[str, dict[str, Any]]:
    """Return the type and the checked fields of a message; ValueError says what was expected."""
    if not isinstance(message, Mapping) or not isinstance(kind := message.get("type"), str) or kind not in FORMS:
        raise ValueError(f"expected a message with a type of {', '.join(FORMS)}, got {shown(message)}")
    given = {name: value for name, value in message.items() if name not in ("type", "at")}
    for form in FORMS[kind]:
        if form.keys() == given.keys():
            values = {}
            for name, check in form.items():
                try:
                    values[name] = check(given[name])
                except (ValueError, TypeError, OverflowError) as error:
                    raise ValueError(f"{kind}: expected {error} as {name}, got {shown(given[name])}") from None
            return kind, values
    forms = " or ".join(", ".join(form) or "no fields" for form in FORMS[kind])
    raise ValueError(f"{kind}: expected {forms}, got {', '.join(map(shown, given)) or 'no fields'}")
