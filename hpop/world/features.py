"""Features of GeoJSON files, and what is noted of them: a line for all of a file that share a fault, not one each."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

RANGES = 8
"""Ranges of numbers that a note lists, at most."""


class Feature(NamedTuple):
    """What a file says of one thing, and where: its path, and the feature's number in it."""

    path: str | Path
    number: int
    data: dict[str, Any]

    def __str__(self) -> str:
        return f"{self.path}: feature {self.number}"


class FeatureNotes:
    r"""What was left out or mended.

    >>> notes = FeatureNotes()
    >>> for number in (0, 1, 2, 5):
    ...     notes.add(Feature("plan.geojson", number, {}), "no geometry, left out")
    >>> notes.add(Feature("plan.geojson", 3, {}), "no properties")
    >>> print(*notes.lines(), sep="\n")
    plan.geojson: 4 features (0 to 2, 5): no geometry, left out.
    plan.geojson: feature 3: no properties.
    """

    def __init__(self) -> None:
        self._found: dict[tuple[str, str], list[Feature]] = {}

    def add(self, feature: Feature, what: str) -> None:
        """Note a feature; again and again, for its parts, is once."""
        found = self._found.setdefault((str(feature.path), what), [])
        if not found or found[-1].number != feature.number:
            found.append(feature)

    def lines(self, path: str | Path | None = None) -> tuple[str, ...]:
        """Put the notes on all files in words, or on one; those of a file in the order of its features."""
        files = list(dict.fromkeys(of for of, _ in self._found))
        notes = sorted(self._found.items(), key=lambda note: (files.index(note[0][0]), note[1][0].number))
        return tuple(
            f"{found[0]}: {what}."
            if len(found) == 1
            else f"{of}: {len(found):,} features ({_ranges(sorted({feature.number for feature in found}))}): {what}."
            for (of, what), found in notes
            if path is None or of == str(path)
        )


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
