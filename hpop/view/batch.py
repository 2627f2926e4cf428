"""Figure of a batch: box plots of planning time, front size and hypervolume for each planner."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.errors import OptionError

if TYPE_CHECKING:
    from hpop.batches.summary import PlannerSummary

PANELS = (
    ("seconds", "planning time, s", "log"),
    ("points", "trajectories on the front", "log"),
    ("shares", "share of the joint hypervolume", "linear"),
)


@checked_arguments
def draw_batch(found: Sequence[PlannerSummary], path: Path) -> None:
    """Write box plots of planning time, front size and hypervolume for each planner to a PNG, PDF or SVG file.

    ``found`` is the result of :func:`hpop.batches.summaries`. Raises OptionError for another ending of ``path``.
    """
    if path.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise OptionError(f"expected a file name that ends in .png, .pdf or .svg, got {path.name!r}")
    figure = _figure(found)
    with replacing(path) as file:
        figure.savefig(file, format=path.suffix[1:].lower(), dpi=150)


def _figure(found: Sequence[PlannerSummary]) -> Figure:
    figure = Figure(figsize=(10.0, 1.4 + 0.5 * len(found)), layout="constrained")
    axes = figure.subplots(1, len(PANELS), sharey=True)
    labels = [each.planner for each in found]
    for axis, (name, heading, scale) in zip(axes, PANELS, strict=True):
        numbers = [np.asarray(getattr(each, name)) for each in found]
        if scale == "log":
            numbers = [values[values > 0] for values in numbers]
        axis.boxplot(numbers, orientation="horizontal", widths=0.6, medianprops={"color": "tab:red"})
        if not any(values.size for values in numbers):
            axis.text(0.5, 0.5, "nothing to compare", transform=axis.transAxes, ha="center", va="center")
        elif scale == "log":
            axis.set_xscale("log")
            axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.xaxis.set_major_formatter("{x:g}")
            axis.xaxis.set_minor_locator(NullLocator())
        axis.set_xlabel(heading)
        axis.set_yticks(range(1, len(labels) + 1), labels)
        axis.grid(visible=True, axis="x", color="0.9")
    axes[0].invert_yaxis()
    return figure
