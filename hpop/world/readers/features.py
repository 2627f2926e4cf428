"""Features of GeoJSON files: their names, values of their properties, selection by properties, and notes on faults.

One note (a warning to print) covers all features of a file with the same fault. Properties are read as GIS programs and
OpenStreetMap write them: numbers and lengths may be text, and one text may hold several values.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hpop.base.text import shown, some
from hpop.errors import MapError, did_you_mean

RANGES = 8
"""Largest number of features, or of ranges of their numbers, that a note lists."""
UNITS = {
    **dict.fromkeys(("", "m", "metre", "metres", "meter", "meters"), 1.0),
    "cm": 0.01,
    "mm": 0.001,
    **dict.fromkeys(("ft", "feet", "foot", "'"), 0.3048),
    **dict.fromkeys(("in", "inch", "inches", '"'), 0.0254),
}
"""Metres per unit. A length of OpenStreetMap without a unit is in metres (wiki, Key:height)."""
LENGTH = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-zA-Z]*|'|\")")
FEET_INCHES = re.compile(r"(\d+)\s*(?:'|ft)\s*(\d+(?:\.\d+)?)\s*(?:\"|in)?")
RANGE = re.compile(r"(-?\d{1,3})-(-?\d{1,3})")
"""Range of levels as text: "0-2", "-1-3"."""
RANGED = frozenset({"level", "repeat_on"})
"""Properties whose text may be a range (OpenStreetMap, Simple Indoor Tagging)."""
YES, NO = frozenset({"yes", "true", "1"}), frozenset({"no", "false", "0", ""})
LEVELS = ("level", "floor")
"""Properties that state the floor of a feature."""
TOLD = 8
"""Largest number of values of a property that a message lists."""


class Feature(NamedTuple):
    """Feature of a GeoJSON file: path of the file, number of the feature in it, and the JSON data of the feature."""

    path: str | Path
    number: int
    data: dict[str, Any]

    @property
    def properties(self) -> dict[str, Any]:
        """Return the properties; {} if the feature has no JSON object of properties."""
        properties = self.data.get("properties")
        return properties if isinstance(properties, dict) else {}

    @property
    def name(self) -> str:
        """Return a name for messages; "" if there is none.

        It is the first text among the properties ``name``, ``label``, ``title``, the feature's own member ``id``, and
        the properties ``id`` and ``type``.
        """
        own = self.properties
        named = [own.get(key) for key in ("name", "label", "title")]
        candidates = [
            *named,
            self.data.get("id"),
            own.get("id"),
            own.get("type"),
        ]
        texts = (" ".join(str(item).split()) for item in candidates if isinstance(item, str | int))
        return next((text for text in texts if text), "")

    @property
    def called(self) -> str:
        """Return the number of the feature, followed by its name if it has one, for messages."""
        return f"{self.number} {shown(self.name)}" if self.name else str(self.number)

    def __str__(self) -> str:
        return f"{self.path}: feature {self.called}"


class FeatureNotes:
    r"""Notes on features that were left out or repaired; equal notes on several features become one line.

    >>> notes = FeatureNotes()
    >>> for number in (0, 1, 2, 5):
    ...     notes.add(Feature("plan.geojson", number, {}), "no geometry, left out")
    >>> notes.add(Feature("plan.geojson", 3, {"properties": {"name": "door"}}), "a 'Point', left out")
    >>> print(*notes.lines(), sep="\n")
    plan.geojson: 4 features (0 to 2, 5): no geometry, left out.
    plan.geojson: feature 3 'door': a 'Point', left out.
    """

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], list[Feature]] = {}

    def add(self, feature: Feature, what: str) -> None:
        """Add a note on a feature; repeating the last one, such as for another part of its geometry, has no effect."""
        features = self._found.setdefault((str(feature.path), what), [])
        if not features or features[-1].number != feature.number:
            features.append(feature)

    def __contains__(self, what: object) -> bool:
        """Return whether any feature has a note with this text."""
        return any(said == what for _, said in self._found)

    def lines(self, path: str | Path | None = None) -> tuple[str, ...]:
        """Return the notes on all files, or on the file at ``path``, as lines in the order of the features."""
        files = list(dict.fromkeys(of for of, _ in self._found))
        notes = sorted(self._found.items(), key=lambda note: (files.index(note[0][0]), note[1][0].number))
        return tuple(
            f"{found[0]}: {what}." if len(found) == 1 else f"{of}: {len(found):,} features ({_listed(found)}): {what}."
            for (of, what), found in notes
            if path is None or of == str(path)
        )


def _listed(features: list[Feature]) -> str:
    """Return a list of features as text: numbers with names, or ranges of numbers if no feature has a name."""
    if not any(feature.name for feature in features):
        return _ranges(sorted({feature.number for feature in features}))
    called = dict.fromkeys(feature.called for feature in sorted(features, key=lambda feature: feature.number))
    return ", ".join([*list(called)[:RANGES], *["..."] * (len(called) > RANGES)])


def _ranges(numbers: list[int]) -> str:
    """Return increasing numbers as text with ranges: "0 to 2, 5"."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1][1:] = [number]
        else:
            ranges.append([number])
    words = [" to ".join(map(str, ends)) for ends in ranges[:RANGES]]
    return ", ".join([*words, *["..."] * (len(ranges) > RANGES)])


def length(value: Any) -> float | None:
    """Return a length, m, from a number up to 1e9 or a short text, in metres if it has no unit; None for other values.

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
    """Return text that is a number as a float, and any other value unchanged."""
    if isinstance(value, str) and len(value) <= 40 and (found := LENGTH.fullmatch(value.strip())) and not found[2]:
        return float(found[1])
    return value


def truth(value: Any) -> bool | None:
    """Return the truth value of a number, a boolean or a text such as "yes"; None if it is neither true nor false."""
    if isinstance(value, bool | int | float):
        return bool(value)
    text = value.strip().lower() if isinstance(value, str) else None
    return True if text in YES else False if text in NO else None


def values(key: str, value: Any) -> set[str]:
    """Return the values of a property as texts: items of a list, or parts between semicolons.

    A range is replaced by its levels if the property is in RANGED.

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
    """Return a value as text for comparison; 0, 0.0 and "0" give the same text."""
    read = number(value)
    if isinstance(read, float) and read.is_integer() and abs(read) < 1e15:
        return str(int(read))
    if isinstance(read, bool):
        return "true" if read else "false"
    return "" if read is None else str(read).strip()


class FeatureFilter:
    """Filter of features by their properties.

    >>> rooms = FeatureFilter({"indoor": ["room", "corridor"], "level": 0})
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
        """Return whether properties have one of the values for each key of this filter, or for those in ``keys``."""
        asked = self._wanted.items() if keys is None else [(k, w) for k, w in self._wanted.items() if k in keys]
        return all(wanted & values(key, properties.get(key)) for key, wanted in asked)

    def __str__(self) -> str:
        return ", ".join(f"{key}: {shown(value)}" for key, value in self.given.items())


def _is_choice(entry: tuple[Any, Any]) -> bool:
    key, value = entry
    several = value if isinstance(value, list | tuple) else [value]
    return isinstance(key, str) and bool(several) and all(isinstance(v, str | int | float) for v in several)


def chosen_features(
    features: Sequence[Feature],
    choice: FeatureFilter,
    path: str | Path,
    *,
    by_level: Callable[[Feature], bool] | None = None,
) -> tuple[list[Feature], tuple[str, ...]]:
    """Return the features that pass a filter, and a note on their number; MapError if no feature passes.

    For features such as doors, for which ``by_level`` returns True, only the level must pass the filter.
    """
    if not choice:
        return list(features), ()
    found = [
        feature
        for feature in features
        if choice.takes(feature.properties, LEVELS if by_level is not None and by_level(feature) else None)
    ]
    if found:
        return found, (f"{path}: {len(found):,} of {len(features):,} features are read, those with {choice}.",)
    for key in choice.given:
        there: dict[str, None] = {}
        for feature in features:
            if key in feature.properties:
                there.update(dict.fromkeys(sorted(values(key, feature.properties[key]))))
        if not there:
            known = dict.fromkeys(str(name) for feature in features for name in feature.properties)
            raise MapError(
                f"{path}: where: no feature has a property {shown(key)}.{did_you_mean(key, known)} The file has the "
                f"properties {shown(some(list(known), TOLD), 300) if known else 'none'}."
            )
        if not any(FeatureFilter({key: choice.given[key]}).takes(feature.properties) for feature in features):
            raise MapError(
                f"{path}: where: no feature has {key}: {shown(choice.given[key])}. Values in the file: "
                f"{shown(some(list(there), TOLD), 300)}."
            )
    raise MapError(f"{path}: where: no feature has all of {choice} at once. Leave some of them out.")


def notes_of_levels(of: Sequence[Feature], choice: FeatureFilter, path: str | Path) -> Iterator[str]:
    """Yield a note if features of several floors are read as one floor."""
    for key in LEVELS:
        if key in choice.given:
            continue
        there = sorted({v for feature in of if key in feature.properties for v in values(key, feature.properties[key])})
        if len(there) > 1:
            yield (
                f"{path}: its features have several values of {key} ({shown(some(there, TOLD), 200)}), all read as one "
                f"floor. where: {{{key}: {there[0]}}} chooses one floor."
            )
