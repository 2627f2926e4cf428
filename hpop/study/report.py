"""Report of a study: tables as text and CSV, figures, a page that names every decision, and code to repeat it."""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from html import escape
from math import isinf, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy

import hpop
from hpop.base.table import table_html
from hpop.base.text import printable
from hpop.errors import StudyError
from hpop.study import conditions
from hpop.study.conditions import unlike
from hpop.study.documents import (
    KEPT,
    REPORTS,
    Contents,
    TableColumn,
    csv_bytes,
    remove_report,
    write_bytes,
    write_report,
)
from hpop.study.figures import draw, figures
from hpop.study.results import Cell, Row
from hpop.study.sharing import variable_names
from hpop.study.statistics.pairs import STEP
from hpop.view.page import png_of

if TYPE_CHECKING:
    from hpop.study.analysis import Analysis

PAGE, SCRIPT = "report.html", "repeat.py"
DPI = 130
TITLES = {
    "stimuli": "Stimuli: how long each lasts, and its costs",
    "scores": "Scores",
    "test": "Do the stimuli differ?",
    "factors": "Which factors matter? (likelihood-ratio tests, without interactions)",
    "pairs": "Which stimuli differ? (positive: the second scores higher)",
    "against before": "Against the answers before (positive: the stimulus scores higher)",
    "places": "Scores by place",
    "carry-over": "Order and carry-over",
    "stimulus before": "Scores by the stimulus before (above 1: higher after this one than after the mean one)",
    "balance": "Complete scores by stimulus and place",
    "choices": "Choices of pairs",
    "favourites": "Favourites: chosen over each other stimulus",
    "live": "Live sessions: what each participant did (head: degrees turned per second)",
    "strengths": "Strengths (Bradley and Terry; logarithms, mean 0)",
}
CAPTIONS = {
    "scores": "The scores of each person, by stimulus",
    "order": "The scores of each person, by place",
    "choices": "The choices of pairs",
}
P_COLUMNS = ("p", "adjusted p")
HEADINGS = {"lower": "lower quartile", "upper": "upper quartile", "low": "95 % from", "high": "95 % to"}
"""Headings of columns in texts and on the page; CSV files have the short names."""
ROUNDED = 1e-12
"""Size below which a number counts as a rounding error and is shown as 0."""
OPEN_ENDS = {("low", STEP): "> 0", ("high", -STEP): "< 0"}
"""Texts for an interval's end that is only a rounding step beside 0, because the interval does not contain 0."""
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'"
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1c2429; max-width: 70rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.15rem; margin-top: 2.2rem }
.scroll { overflow-x: auto } .scroll td { white-space: nowrap } .scroll td:first-child { white-space: normal;
  min-width: 8.5rem; position: sticky; left: 0; background: white; border-right: 1px solid #d8dee2 }
table { border-collapse: collapse; font-size: .9rem }
th, td { padding: .3rem .5rem; border-bottom: 1px solid #d8dee2; text-align: right; vertical-align: top }
th:first-child, td:first-child { text-align: left } thead th { border-bottom: 2px solid #7d8b94 }
.choices th, .choices td { text-align: left } .choices th { min-width: 9rem } .choices td { overflow-wrap: anywhere }
@media (max-width: 600px) { .choices th, .choices td { display: block; border: 0; padding: 0 }
  .choices th { padding-top: .7rem } }
@media print { body { margin: 0; max-width: none } .scroll { overflow: visible } .scroll td { white-space: normal }
  .mark { position: static; print-color-adjust: exact } .scroll td:first-child { position: static }
  h2 { break-after: avoid } tr, img { break-inside: avoid } pre { white-space: pre-wrap } }
p { overflow-wrap: anywhere }
.mark { background: #b00020; color: white; font-weight: bold; padding: .6rem 1rem; position: sticky; top: 0 }
img { max-width: 100%; height: auto } pre { background: #f2f5f7; padding: 1rem; overflow-x: auto }
"""


def save(analysis: Analysis, folder: str | os.PathLike[str]) -> Path:
    """Write the report of an analysis to a folder, created if missing, and return the page's path.

    Raises StudyError if it cannot be written.
    """
    target = Path(folder)
    _check_own(target)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(
            f"cannot make the folder {target}: {error.strerror or error}; choose another folder for the report"
        ) from None
    pictures = {name: png_of(draw(analysis, name), DPI) for name in figures(analysis)}
    files = {
        f"{name.replace(' ', '_')}.csv": csv_bytes(_contents(rows, analysis.mark))
        for name, rows in analysis.tables.items()
    }
    files |= {f"{name}.png": png for name, png in pictures.items()}
    files |= {SCRIPT: code(analysis).encode(), PAGE: page(analysis, pictures).encode()}
    remove_report(target)  # an earlier one may have had other tables
    write_report(target, (analysis.form, analysis.score), _how(analysis), analysis.mark, files)
    for name, data in files.items():
        write_bytes(target / name, data)
    return target / PAGE


def _check_own(folder: Path) -> None:
    """Raise StudyError if a report would be written into a study's folder itself, or into one of its own subfolders."""
    there = folder.resolve()
    for study in (there, *there.parents):
        inside = there.relative_to(study).parts[:1]
        if (study / conditions.FILE).exists() and (not inside or inside[0] in KEPT):
            raise StudyError(
                f"{folder} is a study's folder, but a report needs a folder of its own, such as {study / REPORTS}"
            )


def as_text(analysis: Analysis) -> str:
    """Return all tables and decisions of an analysis as plain text."""
    parts = [_heading(analysis), *([analysis.mark] if analysis.mark else [])]
    for name, rows in analysis.tables.items():
        parts.append("\n".join([TITLES[name], *_aligned_lines(rows)]))
    parts.append("\n".join(["Decisions of the analysis", *(f"  {k}: {v}" for k, v in analysis.choices.items())]))
    return printable("\n\n".join(parts) + "\n", newlines=True)


def code(analysis: Analysis) -> str:
    """Return Python code that repeats the analysis from the study's folder."""
    mark = f"# {analysis.mark}\n" if analysis.mark else ""
    return (
        f"{mark}# hpop {hpop.__version__}, NumPy {np.__version__}, SciPy {scipy.__version__}\n"
        "from hpop import study\n\n"
        'folder = "."  # of the study\n'
        "design = study.Design.load(folder)\n"
        f'assert design.digest == "{analysis.design.digest}"\n'
        "answers = study.Answers.load(folder, design)\n"
        f"score = {(analysis.form, analysis.score)!r}\n"
        f"how = {_how(analysis)!r}\n"
        "result = study.analyse(design, answers, score=score, **how)\n"
        'result.save("report")\n'
    )


def _how(analysis: Analysis) -> dict[str, str]:
    """Return method and correction, as keyword arguments of :func:`hpop.study.analyse`."""
    return {"method": analysis.method, "correction": analysis.correction}


def page(analysis: Analysis, pictures: Mapping[str, bytes]) -> str:
    """Return the report as an HTML page, self-contained and without scripts; ``pictures`` are PNG files by name."""
    mark = f'<p class="mark">{_text(analysis.mark)}</p>' if analysis.mark else ""
    heading = _text(_heading(analysis))
    shown = {"scores": "test", "order": "balance", "choices": "choices"}  # a figure stands before this table
    body = []
    for name, rows in analysis.tables.items():
        body += [_figure(figure, pictures[figure]) for figure in pictures if shown[figure] == name]
        title = _text(TITLES[name])
        table = f'<div class=scroll role=region tabindex=0 aria-label="{title}">{_table(rows)}</div>'
        body.append(f"<h2>{title}</h2>{table}")
    body += [_figure(figure, pictures[figure]) for figure in pictures if shown[figure] not in analysis.tables]
    chosen = "".join(f"<tr><th>{_text(what)}</th><td>{_text(how)}</td></tr>" for what, how in analysis.choices.items())
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{heading}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}"><style>{STYLE}</style></head><body><main>'
        f"{mark}<h1>{heading}</h1><p>{_text(_summary(analysis))}</p>{''.join(body)}"
        f'<h2>Every decision of this analysis</h2><table class="choices">{chosen}</table>'
        f"<h2>To repeat it</h2><p>With the design whose SHA-256 is {_text(analysis.design.digest)}:</p>"
        f"<pre tabindex=0>{_text(code(analysis), newlines=True)}</pre>"
        f"{mark and f'<p>{_text(analysis.mark)}</p>'}</main></body></html>\n"
    )


def _heading(analysis: Analysis) -> str:
    """Return the heading of the report: questionnaire or measure, score and method."""
    method = {"default": "", "paper": ", by the method of the paper", "mixed": ", by a mixed model"}[analysis.method]
    return f"{analysis.variable.title}: {analysis.score}{method}"


def _summary(analysis: Analysis) -> str:
    """Summarise the test of all stimuli in a sentence or two."""
    people = analysis.choices["People"]
    lasting = unlike(analysis.design.conditions)
    also = f" {lasting[0].upper()}{lasting[1:]}." if lasting else ""
    for row in analysis.tables.get("test", ()):
        p = cell_text("p", row["p"])
        found = "differ" if float(row["p"]) < 0.05 else "are not found to differ"
        effect = next(
            (f", {key} = {value:.3f}" for key, value in row.items() if key in ("Kendall's W", "epsilon squared")), ""
        )
        return (
            f"{people}. The stimuli {found}: {row['test']} chi-square({row['df']}) = {row['chi-square']:.3f}, "
            f"p {'' if p.startswith('<') else '= '}{p}{effect}.{also}"
        )
    return f"{people}.{also}"


def _figure(name: str, png: bytes) -> str:
    """Return a figure as an HTML element that contains its PNG."""
    data = base64.b64encode(png).decode()
    return f'<p><img alt="{_text(CAPTIONS[name])}" src="data:image/png;base64,{data}"></p>'


def _table(rows: Sequence[Row]) -> str:
    """Return rows as an HTML table."""
    columns = _columns(rows)
    headings = [HEADINGS.get(column, column) for column in columns]
    return table_html(headings, [[cell_text(key, row.get(key, nan)) for key in columns] for row in rows])


def _aligned_lines(rows: Sequence[Row]) -> list[str]:
    """Return rows as lines of text with aligned columns."""
    columns = _columns(rows)
    headings = [HEADINGS.get(column, column) for column in columns]
    cells = [headings, *([cell_text(key, row.get(key, nan)) for key in columns] for row in rows)]
    widths = [max(len(line[i]) for line in cells) for i in range(len(headings))]
    words = [isinstance(rows[0].get(key), str) for key in columns]
    return [
        "  "
        + "  ".join(
            cell.ljust(width) if word else cell.rjust(width)
            for cell, width, word in zip(line, widths, words, strict=True)
        ).rstrip()
        for line in cells
    ]


def _columns(rows: Sequence[Row]) -> list[str]:
    """Return the names of all columns in some rows, in order of appearance."""
    return list(dict.fromkeys(key for row in rows for key in row))


def cell_text(column: str, value: Cell) -> str:
    """Format a cell of a table: p to four decimals, other numbers to four digits, a dash if missing.

    >>> cell_text("p", 0.00003), cell_text("z", -1.31479), cell_text("people", 36), cell_text("low", float("-inf"))
    ('< .0001', '-1.315', '36', 'unbounded')
    >>> cell_text("strength", 2.4e-15), cell_text("length", nan), cell_text("low", 1e-9)
    ('0', '-', '> 0')
    """
    if not isinstance(value, float):
        return str(value)
    if isnan(value):
        return "-"
    if isinf(value):
        return "unbounded"
    if column in P_COLUMNS or column.startswith(("p of", "p (")):
        return "< .0001" if value < 0.0001 else f"{value:.4f}"
    if (column, value) in OPEN_ENDS:
        return OPEN_ENDS[column, value]
    return "0" if abs(value) < ROUNDED else f"{value:.4g}"


def _contents(rows: Sequence[Row], mark: str) -> Contents:
    """Return rows as a table for CSV, in full precision; an extra column marks simulated answers.

    Headings are names of variables for R, JASP and SPSS.
    """
    headings = _columns(rows)
    columns = [TableColumn(name, "TEXT") for name in variable_names(headings)]
    cells = [[row.get(heading) for heading in headings] for row in rows]
    if mark:
        columns, cells = [*columns, TableColumn("simulated", "TEXT")], [[*line, "SIMULATED"] for line in cells]
    return Contents(columns, cells)


def _text(text: str, *, newlines: bool = False) -> str:
    """Escape text for HTML."""
    return escape(printable(text, newlines=newlines))
