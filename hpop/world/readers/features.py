"""Features of GeoJSON files, and what is noted of them: a line for all of a file that share a fault, not one each."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from hpop.base.text import shown

RANGES = 8
"""Features, or ranges of their numbers, that a note lists, at most."""


class Feature(NamedTuple):
    """What a file says of one thing, and where: its path, and the feature's number in it."""

    path: str | Path
    number: int
    data: dict[str, Any]

    @property
    def properties(self) -> dict[str, Any]:
        """What the file says of it beside its geometry; nothing where that is no object."""
        found = self.data.get("properties")
        return found if isinstance(found, dict) else {}

    @property
    def name(self) -> str:
        """What it is called: by ``name``, ``label``, ``title``, its ``id``, or the properties ``id`` and ``type``."""
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
        """Its number, and its name if it has one."""
        return f"{self.number} {shown(self.name)}" if self.name else str(self.number)

    def __str__(self) -> str:
        return f"{self.path}: feature {self.called}"


class FeatureNotes:
    r"""What was left out or mended.

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
        """Note a feature; again and again, for its parts, is once."""
        found = self._found.setdefault((str(feature.path), what), [])
        if not found or found[-1].number != feature.number:
            found.append(feature)

    def __contains__(self, what: object) -> bool:
        """Whether anything was noted of any feature in these words."""
        return any(said == what for _, said in self._found)

    def lines(self, path: str | Path | None = None) -> tuple[str, ...]:
        """Put the notes on all files in words, or on one; those of a file in the order of its features."""
        files = list(dict.fromkeys(of for of, _ in self._found))
        notes = sorted(self._found.items(), key=lambda note: (files.index(note[0][0]), note[1][0].number))
        return tuple(
            f"{found[0]}: {what}." if len(found) == 1 else f"{of}: {len(found):,} features ({_listed(found)}): {what}."
            for (of, what), found in notes
            if path is None or of == str(path)
        )


def _listed(features: list[Feature]) -> str:
    """Features by number and name, or where none has a name by ranges of numbers."""
    if not any(feature.name for feature in features):
        return _ranges(sorted({feature.number for feature in features}))
    called = dict.fromkeys(feature.called for feature in sorted(features, key=lambda feature: feature.number))
    return ", ".join([*list(called)[:RANGES], *["..."] * (len(called) > RANGES)])


def _ranges(numbers: list[int]) -> str:
    """Numbers that increase, as few words: "0 to 2, 5"."""
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][-1] + 1:
            ranges[-1][1:] = [number]
        else:
            ranges.append([number])
    words = [" to ".join(map(str, ends)) for ends in ranges[:RANGES]]
    return ", ".join([*words, *["..."] * (len(ranges) > RANGES)])
