"""Figures of a study: the scores of each person with medians, and the choices between pairs."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from hpop.base.arrays import FloatArray
from hpop.base.options import one_of
from hpop.base.text import counted
from hpop.errors import StudyError
from hpop.study.protocol import MEASURED
from hpop.study.results import BEFORE, label, scores_by_position
from hpop.study.statistics import describe
from hpop.view.page import new_figure
from hpop.view.style import COLOURS, HALO, LARGE, NORMAL, QUIET, SMALL, plain

if TYPE_CHECKING:
    from hpop.study.analysis import Analysis

NAMES = ("scores", "order", "choices")
DOT, MEDIAN, MARK = "#0072B2", "#D55E00", "#B00020"
PERSON = "#9aa7b2"
ASIDE = 0.05
"""Distance between the dots of equal scores, side by side; columns are 1 apart."""
WIDEST = 0.28
NAME_WIDTH = 18


@plain
def draw(analysis: Analysis, name: str = "scores") -> Figure:
    """Draw a figure by its name: "scores", "order" or "choices".

    Raises StudyError for another name, or if no pairs were compared.
    """
    one_of("figure", name, NAMES, error=StudyError)
    if name == "choices":
        return _choices(analysis)
    return _scores(analysis) if name == "scores" else _order(analysis)


def figures(analysis: Analysis) -> list[str]:
    """Return the names of the figures that the answers suffice for."""
    return [name for name in NAMES if name != "choices" or "choices" in analysis.tables]


def _scores(analysis: Analysis) -> Figure:
    """Draw the scores of each person, before the first stimulus (if asked) and after each, by stimulus."""
    columns = list(analysis.matrix.values.T)
    names = [label(analysis.design, letter) for letter in analysis.matrix.conditions]
    if analysis.before is not None:
        columns, names = [analysis.before, *columns], [BEFORE, *names]
    figure = new_figure(1.6 + 1.7 * len(columns), 4.6)
    axes = figure.add_subplot()
    _columns(axes, columns, names)
    axes.set_xlabel("stimulus")
    return _add_legends(figure, axes, analysis, "by stimulus")


def _order(analysis: Analysis) -> Figure:
    """Draw the scores of each person, before the first stimulus (if asked) and after each, by place in the session."""
    columns = list(scores_by_position(analysis.matrix).T)
    names = [f"place {place}" for place in range(1, len(columns) + 1)]
    if analysis.before is not None:
        columns, names = [analysis.before, *columns], [BEFORE, *names]
    figure = new_figure(1.6 + 1.7 * len(columns), 4.6)
    axes = figure.add_subplot()
    _columns(axes, columns, names)
    axes.set_xlabel("place in the session, whatever the stimulus")
    return _add_legends(figure, axes, analysis, "by place")


def _columns(axes: Axes, columns: Sequence[FloatArray], names: Sequence[str]) -> None:
    """Draw columns of scores: a dot for each score, a line for each person, and the median with quartiles."""
    across = np.arange(len(columns), dtype=float)
    scores = np.array(columns)  # (columns, n)
    aside = np.array([_aside(column) for column in scores])
    for person in range(scores.shape[1]):
        axes.plot(across + aside[:, person], scores[:, person], color=PERSON, linewidth=0.7, alpha=0.55, zorder=1)
    for i, column in enumerate(scores):
        axes.plot(across[i] + aside[i], column, "o", color=DOT, markersize=4, alpha=0.75, zorder=2)
        five = describe(column)
        if five.people:
            left, right = across[i] - 0.36, across[i] + 0.36
            axes.fill_between([left, right], five.lower, five.upper, color=MEDIAN, alpha=0.14, linewidth=0, zorder=0)
            axes.plot([left, right], [five.median] * 2, color=MEDIAN, linewidth=2.6, zorder=3)
            axes.annotate(
                f"{five.median:.4g}",
                (right, five.median),
                (3, 0),
                textcoords="offset points",
                va="center",
                color=MEDIAN,
                fontsize=NORMAL,
                weight="bold",
                path_effects=HALO,
                zorder=4,
            )
    axes.set_xticks(across, [fill(name, NAME_WIDTH) for name in names], fontsize=NORMAL)
    axes.set_xlim(-0.6, len(columns) - 0.25)


def _aside(column: FloatArray) -> FloatArray:
    """Return the sideways shift (n,) of each dot of a column of scores, so that equal scores are side by side."""
    aside = np.zeros(len(column))
    for value in np.unique(column[~np.isnan(column)]):
        same = np.flatnonzero(column == value)
        step = min(ASIDE, 2 * WIDEST / len(same))
        aside[same] = (np.arange(len(same)) - (len(same) - 1) / 2) * step
    return aside


def _add_legends(figure: Figure, axes: Axes, analysis: Analysis, what: str) -> Figure:
    """Add a title, a legend in words, and the mark of simulated answers to a figure."""
    asked = analysis.variable
    worse = {"low": " (higher is worse)", "high": " (higher is better)", "": ""}[asked.better]
    is_named = asked.form in (asked.name, MEASURED)
    axes.set_ylabel(f"{asked.name}{worse}" if is_named else f"{asked.form.upper()} {asked.name}{worse}")
    people = counted(len(analysis.matrix.people), "session")
    axes.set_title(f"{asked.title}, {what}: {people}", fontsize=LARGE)
    axes.grid(axis="y", linewidth=0.4, alpha=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    figure.text(
        0.01,
        0.005,
        "Dots: scores. Lines: one person each. Bars: medians, with quartiles shaded.",
        fontsize=SMALL,
        color=QUIET,
    )
    _leave_room(figure)
    return _mark_simulated(figure, analysis)


def _choices(analysis: Analysis) -> Figure:
    """Draw a bar for each pair of stimuli: how many people chose the left one, neither, or the right one."""
    rows = analysis.tables.get("choices")
    if not rows:
        raise StudyError("no participant compared pairs, so there is no figure of choices; draw scores or order")
    questions = list(dict.fromkeys(str(row["question"]) for row in rows))
    figure = new_figure(8.2, 1.3 + 0.62 * len(rows) + 0.55 * len(questions))
    panels = figure.subplots(len(questions), 1, squeeze=False)[:, 0]
    for axes, question in zip(panels, questions, strict=True):
        own = [row for row in rows if row["question"] == question][::-1]
        for y, row in enumerate(own):
            counts = [int(row[key]) for key in ("first chosen", "neither", "second chosen")]
            left = 0
            for count, colour in zip(counts, (COLOURS[2], "#d9dee2", COLOURS[5]), strict=True):
                axes.barh(y, count, left=left, color=colour, height=0.62)
                if count:
                    axes.text(
                        left + count / 2,
                        y,
                        str(count),
                        ha="center",
                        va="center",
                        fontsize=NORMAL,
                        color="white" if colour == COLOURS[2] else "black",
                    )
                left += count
            axes.text(-0.4, y, fill(str(row["first"]), NAME_WIDTH), ha="right", va="center", fontsize=NORMAL)
            axes.text(left + 0.4, y, fill(str(row["second"]), NAME_WIDTH), ha="left", va="center", fontsize=NORMAL)
        axes.set_title(_question_text(analysis, question), fontsize=LARGE)
        axes.set_yticks([])
        axes.set_xticks([])
        axes.spines[:].set_visible(False)
    figure.text(
        0.01,
        0.005,
        "Of each pair, how many people chose the left stimulus, neither (grey), or the right one.",
        fontsize=SMALL,
        color=QUIET,
    )
    _leave_room(figure)
    return _mark_simulated(figure, analysis)


def _question_text(analysis: Analysis, question: str) -> str:
    """Return the text of a question about pairs, in the study's language; its id if the design lacks the question."""
    for form in analysis.design.questionnaires:
        if form.kind == "pairs" and question in [item.id for item in form.items]:
            return form.item(question).text[analysis.design.language]
    return question


def _leave_room(figure: Figure) -> None:
    """Leave space for the line of text at the bottom, and for the warning at the top."""
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.set(rect=(0, 0.055, 1, 0.945 - 0.045))  # type: ignore[call-arg]


def _mark_simulated(figure: Figure, analysis: Analysis) -> Figure:
    """Write the warning of simulated answers on a figure, if there are any."""
    if analysis.mark:
        figure.text(0.5, 0.992, analysis.mark, ha="center", va="top", color=MARK, weight="bold", fontsize=NORMAL)
    return figure
