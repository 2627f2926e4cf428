"""Picture of what benchmarks/lattice.py measured: labels against states, and time against labels.

python benchmarks/lattice_plot.py [out/bench/lattice.json] [--out out/bench/lattice.png]
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import museums
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLOURS = {0.0: "#1f4e79", 0.01: "#d9822b", 0.1: "#3a9d6e"}  # by eps
MICROSECONDS = (0.1, 1.0, 10.0)  # a label, of the lines to compare with


def main() -> None:
    """Draw the file that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("measured", type=Path, nargs="?", default=Path("out/bench/lattice.json"))
    parser.add_argument("--out", type=Path, default=Path("out/bench/lattice.png"))
    arguments = parser.parse_args()
    draw(json.loads(arguments.measured.read_text())["instances"]).savefig(arguments.out, dpi=130)


def draw(rows: list[dict[str, Any]]) -> Figure:
    """Two panels: how the work grows with the world, and what it costs."""
    figure = Figure(figsize=(12, 5.2), layout="constrained")
    figure.suptitle(
        "Exact search and its approximations: museums made by seed (lines), real buildings (rings)", fontsize=11
    )
    growth, cost = figure.subplots(1, 2)
    for eps, colour in COLOURS.items():
        some = [row for row in rows if row["eps"] == eps]
        name = f"within {eps:.0%} (eps = {eps:g})" if eps else "exact: the whole front"
        scatter(growth, some, "states", "labels_generated", colour, name)
        scatter(cost, some, "labels_generated", "cpu_s", colour, name)
    for axes, x, y in ((growth, "states", "labels_generated"), (cost, "labels_generated", "cpu_s")):
        for row in rows:
            if row["eps"] == 0:
                name_point(axes, row, x, y)
    growth.set(
        xlabel="states of the lattice (positions × headings; steps of 0.25 m unless said)",
        ylabel="labels generated (partial paths)",
    )
    growth.set_title("Labels against states", loc="left", fontsize=10)
    cost.set(xlabel="labels generated (partial paths)", ylabel="processor time of the search, bounds included [s]")
    cost.set_title("Time against labels", loc="left", fontsize=10)
    guide(cost, [row["labels_generated"] for row in rows])
    for axes in (growth, cost):
        axes.set(xscale="log", yscale="log")
        axes.grid(which="major", alpha=0.3)
    growth.margins(x=0.25, y=0.12)
    cost.margins(x=0.25)
    growth.legend(loc="upper left", fontsize=8)
    return figure


def scatter(axes: Axes, rows: list[dict[str, Any]], x: str, y: str, colour: str, name: str) -> None:
    """Museums joined by a line, real buildings as rings."""
    made = [row for row in rows if row["instance"] in museums.SIZES]
    real = [row for row in rows if row["instance"] not in museums.SIZES]
    axes.plot([row[x] for row in made], [row[y] for row in made], "o-", color=colour, label=name, markersize=5)
    axes.plot([row[x] for row in real], [row[y] for row in real], "o", color=colour, markerfacecolor="white")


def name_point(axes: Axes, row: dict[str, Any], x: str, y: str) -> None:
    """Museums' names left of their points, buildings' right below."""
    made = row["instance"] in museums.SIZES
    text = row["instance"].replace("_", " ") + (f", {row['step']:g} m" if row["step"] != museums.CELL else "")
    offset, side = ((-6, 5), "right") if made else ((6, -11), "left")
    axes.annotate(text, (row[x], row[y]), xytext=offset, textcoords="offset points", ha=side, fontsize=8)


def guide(axes: Axes, labels: list[int]) -> None:
    """Lines of constant time a label, named at their upper ends."""
    ends = np.array([min(labels), max(labels)])
    for each in MICROSECONDS:
        axes.plot(ends, each * 1e-6 * ends, "--", color="0.6", linewidth=0.8, zorder=0)
        end = (ends[1], each * 1e-6 * ends[1])
        axes.annotate(f"{each:g} µs a label", end, xytext=(4, 4), textcoords="offset points", fontsize=8, color="0.4")


if __name__ == "__main__":
    main()
