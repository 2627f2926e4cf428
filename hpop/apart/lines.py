"""Lines and filled areas of a drawing, collected layer by layer, no more than a building has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np

from hpop.apart.answer import Answer, Refused

MOST_POINTS = 500_000
"""Points of all lines."""
MOST_THINGS = 1_000_000
"""Things of a drawing that are looked at, references to blocks or forms included."""
MOST_DEEP = 16
"""Blocks within blocks."""
FARTHEST = 1e12
"""Greatest coordinate, in the drawing's units."""
SAG = 5e-4
"""How far a curve may be from its chords, for each unit of the size of the curve."""


HIDDEN = "on layers that are off or frozen"
"""What is said of things that are not shown."""


class Lines:
    """What is found of a drawing.

    layers : names of the layers that are asked for, or None for all that are shown
    """

    def __init__(self, layers: Sequence[str] | None) -> None:
        self._asked = None if layers is None else {name.casefold() for name in layers}
        self._points: list[tuple[float, float]] = []
        self._starts = [0]
        self._layer: list[int] = []
        self._area: list[int] = []
        self._width: list[float] = []
        self._areas = 0
        self._things = 0
        self._layers: dict[str, int] = {}
        self.counted: Counter[str] = Counter()
        """How many lines and areas each layer has, those that are not asked for included."""
        self.left_out: Counter[str] = Counter()
        self.wide = 0
        """How many lines are areas as well, as thick as they are drawn."""

    def look(self) -> None:
        """Count one more thing that is looked at; `Refused` where there are too many."""
        self._things += 1
        if self._things > MOST_THINGS:
            raise Refused(f"it has more than {MOST_THINGS:,} things in it; expected a floor plan. Leave some out")

    def wants(self, layer: str, *, shown: bool = True) -> bool:
        """Count a thing of a layer, and say whether it is asked for."""
        self.counted[layer] += 1
        if self._asked is not None:
            return layer.casefold() in self._asked
        if not shown:
            self.left_out[HIDDEN] += 1
        return shown

    def add(
        self,
        layer: str,
        paths: Iterable[Sequence[tuple[float, float]]],
        *,
        filled: bool = False,
        width: float = 0.0,
    ) -> None:
        """Add lines, each through points; together they bound an area where they are filled.

        width  how thick they are drawn, in the drawing's units, where their ends are cut off; 0 for the width of a pen
        """
        self._areas += filled
        for path in paths:
            if len(path) < 2:
                continue
            self._points += path
            self._starts.append(len(self._points))
            self._layer.append(self._layers.setdefault(layer, len(self._layers)))
            self._area.append(self._areas if filled else 0)
            self._width.append(width)
            if len(self._points) > MOST_POINTS:
                raise Refused(
                    f"its lines have more than {MOST_POINTS:,} points; expected a floor plan. Choose layers, or leave "
                    f"some out; it has {said(self.counted)}"
                )

    def answer(self, known: Iterable[str], **words: Any) -> Answer:
        """What was found; `Refused` where a layer that is asked for is not there.

        known : names of layers that the file lists, those without lines included
        """
        names = {name.casefold(): name for name in (*known, *self.counted)}
        for name in sorted(self._asked or ()):
            if name not in names:
                near = get_close_matches(name[:100], list(names)[:10_000], n=1)
                hint = f" Did you mean {names[near[0]]!r}?" if near else ""
                raise Refused(f"it has no layer {name[:100]!r}.{hint} It has {said(self.counted) or 'none'}")
        points = np.array(self._points, dtype=np.float64).reshape(-1, 2)
        if not (np.abs(points) <= FARTHEST).all():
            raise Refused(f"its coordinates must be finite numbers, at most {FARTHEST:.0e}")
        words |= {
            "layers": list(self._layers),
            "counted": dict(self.counted.most_common(100)),
            "left_out": dict(self.left_out.most_common(20)),
            "wide": self.wide,
        }
        arrays = {"starts": self._starts, "layer": self._layer, "area": self._area}
        whole = {name: np.asarray(numbers, "<i8") for name, numbers in arrays.items()}
        return Answer(words, {"points": points, "width": np.asarray(self._width, "<f8"), **whole})


def said(counted: Counter[str] | dict[str, int], most: int = 12) -> str:
    """Names with their counts, the most first."""
    several = sorted(counted.items(), key=lambda entry: (-entry[1], entry[0]))
    return ", ".join(f"{name} ({count:,})" for name, count in several[:most]) + ", ..." * (len(several) > most)
