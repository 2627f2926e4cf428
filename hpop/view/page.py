"""Layout of pictures: the figure, a map with colour bars, and legends, title and certificate around it."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill as wrapped
from typing import Any, Literal, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure, FigureBase, SubFigure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from hpop.base.text import printable, shown
from hpop.errors import OptionError
from hpop.frontier.points import JOINT
from hpop.problems.front import Front
from hpop.runtime.limits import Status
from hpop.view.ground import View
from hpop.view.style import LARGE, MOST_HIGH, MOST_WIDE, NORMAL, QUIET, SMALL, how_many_drawn, quantities, whole_ticks

SCREEN = 90  # dots an inch in a notebook


class Picture(Figure):
    """Figure outside pyplot's global state, which a notebook shows if it is the last value of a cell."""

    def _repr_png_(self) -> bytes:
        return png_of(self, SCREEN)


def new_figure(width: float, height: float, layout: Any = "constrained") -> Picture:
    """Create an empty white figure, with its size in inches."""
    figure = Picture(figsize=(width, height), layout=layout, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def figure_for(ax: Axes | None, width: float, height: float, layout: Any = "constrained") -> Figure | SubFigure:
    """Return a new figure with its size in inches, or the part of a user's figure that ``ax`` occupies.

    ``ax`` is removed. Raises OptionError unless it is in a grid.
    """
    if ax is None:
        return new_figure(width, height, layout)
    place = checked_axes(ax).get_subplotspec()
    parent = ax.get_figure(root=False)
    if place is None or parent is None:
        raise OptionError(
            "ax must be axes in a grid, such as plt.subplots(1, 2) creates, because a picture of several panels takes "
            "their place; got axes that are in no grid"
        )
    ax.remove()
    return parent.add_subfigure(place)


def checked_axes(ax: Any) -> Axes:
    """Return ``ax`` unchanged; raise OptionError unless it is a Matplotlib Axes."""
    if not isinstance(ax, Axes):
        raise OptionError(f"ax must be axes of Matplotlib, such as one of plt.subplots(1, 2)[1], got {shown(ax)}")
    return ax


def whole(figure: FigureBase) -> Figure:
    """Return the complete figure that a figure or subfigure belongs to."""
    return figure.get_figure(root=True)


def png_of(figure: Figure, dpi: float) -> bytes:
    """Return a figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()


Box = tuple[float, float, float, float]  # left, bottom, width, height, as shares of the figure
# Inches:
LEAST = 1.6
LEFT, TOP, BELOW = 0.75, 0.88, 0.62  # round the map: ticks and label, title and scale bar, ticks and label
BAR, PITCH, GAP = 0.16, 0.95, 0.15  # width of a colour bar, least distance from bar to bar, gap before a bar
LEGEND = 8.0  # width of the two legends
SYMBOLS = 4.95  # left edge of the second legend
LINE = 0.205  # height of a line of the legends
CLAIM_LINE = 0.155  # height of a line of the certificate


@dataclass(frozen=True)
class PageLayout:
    """Layout of a page with a map. Fields are in inches; methods and properties return shares of the figure.

    width, height          of the figure
    map_width, map_height  of the map, with its true proportions unless these are extreme
    left, bottom           of the map, from the left and the lower edge of the figure
    bars                   left edges of the colour bars, from the left edge of the figure
    """

    width: float
    height: float
    map_width: float
    map_height: float
    left: float
    bottom: float
    bars: tuple[float, ...]

    @classmethod
    def of(cls, view: View, *, words: Sequence[float], lines: int, claim: int) -> PageLayout:
        """Compute the layout of a page for a map that shows ``view``.

        words  inches, width of the labels beside each colour bar
        lines  number of lines of the longer legend
        claim  number of lines of the certificate
        """
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
        """Return the position of the title: the middle of its upper edge."""
        return 0.5, 1.0 - 0.1 / self.height

    @property
    def legends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Return the upper left corners of the two legends."""
        margin = (self.width - LEGEND) / 2 + 0.1
        top = (self.bottom - BELOW) / self.height
        return (margin / self.width, top), ((margin + SYMBOLS) / self.width, top)

    @property
    def claim(self) -> tuple[float, float]:
        """Return the position of the certificate's lower left corner."""
        return self.legends[0][0], 0.08 / self.height

    def map_box(self) -> Box:
        """Return the box that the map occupies in the figure."""
        return self._box(self.left, self.map_width)

    def bar_box(self, position: int) -> Box:
        """Return the box of a colour bar, by its number counted from the map outwards."""
        return self._box(self.bars[position], BAR)

    def _box(self, left: float, width: float) -> Box:
        return left / self.width, self.bottom / self.height, width / self.width, self.map_height / self.height


def stretch_of(view: View) -> float:
    """Return by which factor a view is stretched vertically: its vertical scale divided by its horizontal scale."""
    width, height = _size(view)
    return (height / view.height) / (width / view.width)


def _size(view: View) -> tuple[float, float]:
    """Return width and height, inches, of the box in which a view is drawn."""
    scale = min(MOST_WIDE / view.width, MOST_HIGH / view.height)
    return max(LEAST, scale * view.width), max(LEAST, scale * view.height)


WHOLE = (0.0, 0.0, 1.0, 1.0)  # box of axes before the layout
CLAIM_WRAP = 118  # characters per line of the certificate
Handle = Line2D | Patch
Corner = Literal["upper left", "upper center"]


@dataclass(frozen=True, eq=False)
class Bar:
    """Colour bar to be drawn beside a map.

    of      mapping from values to the colours that the bar explains
    words   label
    counts  whether the values are counts, with whole numbers as ticks
    extend  end that is drawn as an arrow, for values beyond the bar: "neither" or "max"
    """

    of: ScalarMappable
    words: str
    counts: bool
    extend: str = "neither"


def lay_on(axes: Axes, front: Front, *, bars: Sequence[Bar], lines: Sequence[Handle]) -> Figure:
    """Add the title, colour bars and a legend of named trajectories around a user's axes; return the figure."""
    figure = cast(FigureBase, axes.get_figure(root=False))
    for bar in bars:
        drawn = figure.colorbar(bar.of, ax=axes, extend=bar.extend, extendfrac=0.025, shrink=0.8)
        drawn.set_label(bar.words, fontsize=SMALL)
        drawn.ax.tick_params(labelsize=SMALL)
        whole_ticks(drawn.ax.yaxis, bar.counts, most=8)
    axes.set_title(title_of(front), fontsize=NORMAL, pad=18.0)
    if lines:
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
        axes.legend(handles=list(lines), fontsize=SMALL, frameon=False, handlelength=4.0, **below)
    return whole(figure)


def lay_out(
    axes: Axes,
    view: View,
    *,
    title: str,
    claim: str,
    bars: Sequence[Bar],
    lines: Sequence[Handle],
    symbols: Sequence[Handle],
) -> Figure:
    """Place the map of a new figure, write title, legends and certificate around it, and fit the size of the figure."""
    figure = whole(cast(FigureBase, axes.get_figure(root=True)))
    drawn = [_draw_bar(figure, bar) for bar in bars]
    sheet = PageLayout.of(
        view,
        words=[_width_of_words(figure, cax) for cax in drawn],
        lines=max(height_of(lines), height_of(symbols)),
        claim=claim.count("\n") + 1,
    )
    figure.set_size_inches(sheet.width, sheet.height)
    axes.set_position(sheet.map_box())
    for place, cax in enumerate(drawn):
        cax.set_position(sheet.bar_box(place))
    figure.suptitle(title, x=sheet.title[0], y=sheet.title[1], va="top", fontsize=LARGE)
    if lines:
        _draw_legend(figure, lines, sheet.legends[0], "upper left")
        _draw_legend(figure, symbols, sheet.legends[1], "upper left")
    else:
        _draw_legend(figure, symbols, (0.5, sheet.legends[0][1]), "upper center")
    figure.text(*sheet.claim, claim, fontsize=SMALL, color=QUIET, va="bottom", gid="claim")
    return figure


def draw_caption(axes: Axes, words: str) -> None:
    """Write a caption above the upper left corner of the axes."""
    axes.text(0.0, 1.02, words, transform=axes.transAxes, ha="left", va="bottom", fontsize=SMALL, gid="caption")


def height_of(handles: Sequence[Handle]) -> int:
    """Return the number of lines of text that legend entries take."""
    return sum(1 + str(handle.get_label()).count("\n") for handle in handles)


def _draw_bar(figure: Figure, bar: Bar) -> Axes:
    """Draw a colour bar at a provisional position."""
    cax = figure.add_axes((0.0, 0.0, 0.1, 1.0), label=bar.words)
    drawn = figure.colorbar(bar.of, cax=cax, extend=bar.extend, extendfrac=0.025)
    drawn.set_label(bar.words, fontsize=NORMAL)
    cax.tick_params(labelsize=SMALL)
    whole_ticks(cax.yaxis, bar.counts, most=8)
    return cax


def _width_of_words(figure: Figure, cax: Axes) -> float:
    """Return how far the ticks and the label of a colour bar reach beyond its right side, in inches."""
    box = cast(Bbox, cax.get_tightbbox())
    return float(box.x1 - cax.bbox.x1) / figure.dpi


def _draw_legend(figure: Figure, handles: Sequence[Handle], at: tuple[float, float], corner: Corner) -> None:
    figure.legend(
        handles=list(handles),
        loc=corner,
        bbox_to_anchor=at,
        fontsize=SMALL,
        frameon=False,
        handlelength=4.0,
        borderaxespad=0.0,
    )


def claim_of(front: Front) -> str:
    """Return the certificate of a front as text to print below a picture, with a paragraph for each planner."""
    return paragraphs(front.certificate.split(JOINT))


def paragraphs(parts: Sequence[str]) -> str:
    """Wrap each text to the width of a page, and join them by line breaks."""
    return "\n".join(wrapped(printable(part), CLAIM_WRAP) for part in parts)


def title_of(front: Front) -> str:
    """Return a title: the number of trajectories, their costs, and the status of the search."""
    if not len(front):
        if front.status == Status.NO_PATH:
            return "No path from start to goal"
        return f"No path found: the search ended with {printable(front.status)!r}"
    ended = "" if front.status == Status.COMPLETE else f" (search ended: {printable(front.status)})"
    if Status.UNFINISHED in front.status:
        ended = " (the search goes on)"
    count = f"{len(front)} trajectories{ended}{how_many_drawn(front)}, none better than another in all of"
    if len(front) == 1:
        count = f"1 trajectory{ended}, none found is better in any of"
    criteria = ", ".join(column.label for column in quantities(front)[: len(front.names)])
    return f"{count}\n{criteria}"
