"""Where the parts of a map's picture go, in inches: title, map, colour bars, legends, what is claimed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hpop.view.ground import View

Box = tuple[float, float, float, float]  # left, bottom, width, height, as shares of the figure

MOST_WIDE, MOST_HIGH = 6.4, 6.2  # of the map
LEAST = 1.6
LEFT, TOP, BELOW = 0.75, 0.88, 0.62  # round the map: ticks and label, title and scale bar, ticks and label
BAR, PITCH, GAP = 0.16, 0.95, 0.15  # a colour bar, from one to the next at least, before each
LEGEND = 8.0  # width of the two legends
SYMBOLS = 4.95  # where the second one begins
LINE = 0.205  # height of a line of the legends
CLAIM_LINE = 0.155  # and of what is claimed


@dataclass(frozen=True)
class Sheet:
    """A page: sizes in inches, places as shares of the figure.

    width, height          of the figure
    map_width, map_height  of the map, in the proportions of what it shows where these are not extreme
    left, bottom           of the map
    bars                   left edges of the colour bars
    """

    width: float
    height: float
    map_width: float
    map_height: float
    left: float
    bottom: float
    bars: tuple[float, ...]

    @classmethod
    def of(cls, view: View, *, words: Sequence[float], lines: int, claim: int) -> Sheet:
        """Lay out a map of a view with lines of legend and of what is claimed, and colour bars with so wide words."""
        map_width, map_height = _size(view)
        offsets = np.cumsum([GAP, *(max(PITCH, BAR + wide + GAP) for wide in words)])
        with_bars = LEFT + map_width + offsets[-1]
        width = max(with_bars, LEGEND)
        bottom = BELOW + LINE * lines + 0.2 + CLAIM_LINE * claim
        left = LEFT + (width - with_bars) / 2
        bars = tuple(float(left + map_width + offset) for offset in offsets[:-1])
        return cls(float(width), bottom + map_height + TOP, map_width, map_height, float(left), bottom, bars)

    @property
    def title(self) -> tuple[float, float]:
        """Middle of the title's upper edge."""
        return 0.5, 1.0 - 0.1 / self.height

    @property
    def legends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Upper left corners of the two legends."""
        margin = (self.width - LEGEND) / 2 + 0.1
        top = (self.bottom - BELOW) / self.height
        return (margin / self.width, top), ((margin + SYMBOLS) / self.width, top)

    @property
    def claim(self) -> tuple[float, float]:
        """Lower left corner of what is claimed."""
        return self.legends[0][0], 0.08 / self.height

    def map_box(self) -> Box:
        """Place the map."""
        return self._box(self.left, self.map_width)

    def bar_box(self, position: int) -> Box:
        """Place a colour bar, counted from the map outwards."""
        return self._box(self.bars[position], BAR)

    def _box(self, left: float, width: float) -> Box:
        return left / self.width, self.bottom / self.height, width / self.width, self.map_height / self.height


def stretch_of(view: View) -> float:
    """How many times as large as its width the height of a view is drawn that fills its place."""
    width, height = _size(view)
    return (height / view.height) / (width / view.width)


def _size(view: View) -> tuple[float, float]:
    """Width and height, inches, of the place of a view."""
    scale = min(MOST_WIDE / view.width, MOST_HIGH / view.height)
    return max(LEAST, scale * view.width), max(LEAST, scale * view.height)
