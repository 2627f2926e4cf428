"""Properties of features as GIS and OpenStreetMap write them: numbers and lengths as text, several values in one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from hpop.base.text import shown
from hpop.errors import MapError

UNITS = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    "cm": 0.01,
    "mm": 0.001,
    **dict.fromkeys(("ft", "feet", "foot", "'"), 0.3048),
    **dict.fromkeys(("in", "inch", "inches", '"'), 0.0254),
}
"""Metres a unit. OpenStreetMap's lengths without a unit are in metres (wiki, Key:height)."""
LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z]*|'|\")")
FEET_INCHES = re.compile(r"(\d+)\s*(?:'|ft)\s*(\d+(?:\.\d+)?)\s*(?:\"|in)?")
RANGE = re.compile(r"(-?\d{1,3})-(-?\d{1,3})")
"""A range of levels: "0-2", "-1-3"."""
RANGED = frozenset({"level", "repeat_on"})
"""Properties whose text may be a range (OpenStreetMap, Simple Indoor Tagging)."""
YES, NO = frozenset({"yes", "true", "1"}), frozenset({"no", "false", "0", ""})


def length(value: Any) -> float | None:
    """Return a length in m, from a number or from text with or without a unit; None for anything else.

    >>> length(3), length("3"), length("12 ft"), length("250 cm"), length(f'''6'11"'''), length("high")
    (3.0, 3.0, 3.6576000000000004, 2.5, 2.1082, None)
    """
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value) if abs(value) <= 1e9 else None
    if not isinstance(value, str) or len(value) > 40:
        return None
    text = value.strip()
    if both := FEET_INCHES.fullmatch(text):
        return round(int(both[1]) * 0.3048 + float(both[2]) * 0.0254, 9)
    found = LENGTH.fullmatch(text)
    metres = UNITS.get(found[2].lower()) if found else None
    return float(found[1]) * metres if found and metres is not None else None


def number(value: Any) -> Any:
    """Return the number that a text is, and every other value as it is."""
    if isinstance(value, str) and len(value) <= 40 and (found := LENGTH.fullmatch(value.strip())) and not found[2]:
        return float(found[1])
    return value


def truth(value: Any) -> bool | None:
    """Return what a property says of yes or no, as a number, a boolean or text; None where it says neither."""
    if isinstance(value, bool | int | float):
        return bool(value)
    text = value.strip().lower() if isinstance(value, str) else None
    return True if text in YES else False if text in NO else None


def values(key: str, value: Any) -> set[str]:
    """Return what a property says, as texts: each of a list or between semicolons, and each level of a range.

    >>> sorted(values("level", "0-2")), sorted(values("level", 0.0)), sorted(values("type", "room;hall"))
    (['0', '1', '2'], ['0'], ['hall', 'room'])
    """
    several = value if isinstance(value, list) else value.split(";") if isinstance(value, str) else [value]
    found = set()
    for item in several:
        text = _text(item)
        between = RANGE.fullmatch(text) if key in RANGED else None
        if between and int(between[1]) <= int(between[2]):
            found |= {str(level) for level in range(int(between[1]), int(between[2]) + 1)}
        else:
            found.add(text)
    return found


def _text(value: Any) -> str:
    """A value as text that is the same for 0, 0.0 and "0"."""
    read = number(value)
    if isinstance(read, float) and read.is_integer() and abs(read) < 1e15:
        return str(int(read))
    if isinstance(read, bool):
        return "true" if read else "false"
    return "" if read is None else str(read).strip()


class Choice:
    """Features chosen by their properties.

    >>> rooms = Choice({"indoor": ["room", "corridor"], "level": 0})
    >>> rooms.takes({"indoor": "room", "level": "0;1"}), rooms.takes({"indoor": "room"})
    (True, False)
    """

    def __init__(self, where: Mapping[str, Any] | None) -> None:
        if where is not None and not (isinstance(where, Mapping) and all(map(_is_choice, where.items()))):
            raise MapError(
                "where must name properties, each with a value or a list of values, such as {indoor: room, level: [0, "
                f"1]}}; got {shown(where)}."
            )
        self.given: dict[str, Any] = {
            key: list(value) if isinstance(value, list | tuple) else value for key, value in (where or {}).items()
        }
        self._wanted = {
            key: {_text(item) for item in (value if isinstance(value, list | tuple) else [value])}
            for key, value in self.given.items()
        }

    def __bool__(self) -> bool:
        return bool(self._wanted)

    def takes(self, properties: Mapping[str, Any], keys: Iterable[str] | None = None) -> bool:
        """Whether properties have the values that are asked for, of all keys or of some."""
        asked = self._wanted.items() if keys is None else [(k, w) for k, w in self._wanted.items() if k in keys]
        return all(wanted & values(key, properties.get(key)) for key, wanted in asked)

    def __str__(self) -> str:
        return ", ".join(f"{key}: {shown(value)}" for key, value in self.given.items())


def _is_choice(entry: tuple[Any, Any]) -> bool:
    key, value = entry
    several = value if isinstance(value, list | tuple) else [value]
    return isinstance(key, str) and bool(several) and all(isinstance(v, str | int | float) for v in several)
