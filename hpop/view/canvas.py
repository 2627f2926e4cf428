"""Where a picture is drawn: on a new figure, which shows itself in a notebook, or in the place of given axes."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, FigureBase, SubFigure

from hpop.base.text import shown
from hpop.errors import OptionError

SCREEN = 90  # dots an inch in a notebook


class Picture(Figure):
    """A figure that no global state knows of, and that a notebook shows as the last value of a cell."""

    def _repr_png_(self) -> bytes:
        return png_of(self, SCREEN)


def new_figure(width: float, height: float, layout: Any = "constrained") -> Picture:
    """Make a white figure of a size in inches."""
    figure = Picture(figsize=(width, height), layout=layout, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def figure_for(ax: Axes | None, width: float, height: float, layout: Any = "constrained") -> Figure | SubFigure:
    """A new figure of a size in inches; or in the place of axes, which are removed, a part of theirs.

    Raises OptionError for what are no axes of a grid.
    """
    if ax is None:
        return new_figure(width, height, layout)
    place = checked(ax).get_subplotspec()
    parent = ax.get_figure(root=False)
    if place is None or parent is None:
        raise OptionError(
            "a picture of several panels takes the place of axes of a grid, such as plt.subplots(1, 2) makes; these "
            "are in none"
        )
    ax.remove()
    return parent.add_subfigure(place)


def checked(ax: Any) -> Axes:
    """Axes, or OptionError."""
    if not isinstance(ax, Axes):
        raise OptionError(f"ax must be axes of Matplotlib, such as one of plt.subplots(1, 2)[1], got {shown(ax)}")
    return ax


def whole(figure: FigureBase) -> Figure:
    """The figure of which this is a part, or itself."""
    return figure.get_figure(root=True)


def png_of(figure: Figure, dpi: float) -> bytes:
    """A figure as a PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue()
