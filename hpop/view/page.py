"""What stands round the lines of a front in a picture: colour bars, legends, title, and what is claimed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill as wrapped
from typing import Any, Literal, cast

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import Bbox

from hpop.base.text import printable
from hpop.frontier.union import JOINT
from hpop.problems.front import Front
from hpop.runtime.status import Status
from hpop.view.canvas import whole
from hpop.view.ground import View
from hpop.view.sheet import Sheet
from hpop.view.style import (
    LARGE,
    NORMAL,
    QUIET,
    SMALL,
    how_many_drawn,
    quantities,
    whole_ticks,
)

WHOLE = (0.0, 0.0, 1.0, 1.0)  # of a figure, where axes are that have no place yet
CLAIM_WRAP = 118  # characters a line of what is claimed
Handle = Line2D | Patch
Corner = Literal["upper left", "upper center"]


@dataclass(frozen=True, eq=False)
class Bar:
    """A colour bar to come: what it explains, in which words."""

    of: ScalarMappable
    words: str
    counts: bool
    extend: str = "neither"


def lay_on(axes: Axes, front: Front, *, bars: Sequence[Bar], lines: Sequence[Handle]) -> Figure:
    """Write round axes of somebody's figure, which is returned: colour bars, the title, the named trajectories."""
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
    """Give the axes of a new figure their place, write what belongs round them, and make the figure fit."""
    figure = whole(cast(FigureBase, axes.get_figure(root=True)))
    drawn = [_draw_bar(figure, bar) for bar in bars]
    sheet = Sheet.of(
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
    """Write what is seen, and from where, above the upper left corner of a picture."""
    axes.text(0.0, 1.02, words, transform=axes.transAxes, ha="left", va="bottom", fontsize=SMALL, gid="caption")


def height_of(handles: Sequence[Handle]) -> int:
    """Lines of text in a legend."""
    return sum(1 + str(handle.get_label()).count("\n") for handle in handles)


def _draw_bar(figure: Figure, bar: Bar) -> Axes:
    """Draw a colour bar that has no place yet."""
    cax = figure.add_axes((0.0, 0.0, 0.1, 1.0), label=bar.words)
    drawn = figure.colorbar(bar.of, cax=cax, extend=bar.extend, extendfrac=0.025)
    drawn.set_label(bar.words, fontsize=NORMAL)
    cax.tick_params(labelsize=SMALL)
    whole_ticks(cax.yaxis, bar.counts, most=8)
    return cax


def _width_of_words(figure: Figure, cax: Axes) -> float:
    """Width of what stands beside a colour bar, ticks and label, inches."""
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
    """What is claimed, a paragraph for each planner: a picture is passed on without its front."""
    return paragraphs(front.certificate.split(JOINT))


def paragraphs(parts: Sequence[str]) -> str:
    """Text under a picture, wrapped."""
    return "\n".join(wrapped(printable(part), CLAIM_WRAP) for part in parts)


def title_of(front: Front) -> str:
    """How many trajectories there are, in which costs, and how the search ended."""
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
