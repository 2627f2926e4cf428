"""Commands ``hpop study score``, ``report``, ``preregister`` and ``power``: tables, tests, plan, number of people."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click

import hpop
from hpop import cli
from hpop.cli.terminal import echo, user_errors

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from hpop.study import Answers
    from hpop.study.results import Method
    from hpop.study.statistics.scores import Correction

folder_argument = click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))


@click.command()
@folder_argument
@user_errors
def score(folder: Path) -> None:
    """Make tables of the answers; print medians.

    Writes answers.csv, scores.csv, choices.csv, wide.csv and answers.sqlite, and a description of the columns beside
    each CSV file; free text of participants goes to remarks.csv only.
    The exit code is 17 if the front has changed since the study began.
    """
    from hpop.study.conditions import FILE
    from hpop.study.documents import locked_for_changes

    design = hpop.study.Design.load(folder)
    with locked_for_changes(folder):  # not while a participant is withdrawn
        answers = hpop.study.Answers.load(folder, design)
        written = answers.save_tables(folder)
    for said in (*answers.faults, *answers.notes):
        echo(f"note: {said}")
    _print_scores(answers)
    echo(f"written to {folder}: {', '.join(path.name for path in written)}")
    echo(f"{folder / FILE} says which letter is which row: to stay blind, open it only after the last session")
    hpop.study.folder.front_of(folder, design)


@click.command()
@folder_argument
@click.option(
    "--score",
    "named",
    default="ssq.total",
    metavar="FORM.SCORE",
    help="Score to test, such as comfort.comfort, or a measure of a task, such as tasks.reaction_median. [ssq.total]",
)
@click.option(
    "--method",
    default="default",
    metavar="NAME",
    help="default; paper: the tests of the paper; or mixed: an ordinal mixed model, with carry-over. [default]",
)
@click.option("--correction", metavar="NAME", help="For several comparisons: holm, bonferroni or none. [the method's]")
@click.option("--out", type=click.Path(path_type=Path), metavar="FOLDER", help="Folder of the report. [DIR/report]")
@user_errors
def report(folder: Path, named: str, method: str, correction: str | None, out: Path | None) -> None:
    """Test a score of the answers; write a report.

    The report has a page, tables, figures, and code that repeats the analysis. The exit code is 17 if the front has
    changed since the study began.
    """
    answers = hpop.study.Answers.load(folder)
    analysis = hpop.study.analyse(
        answers.design,
        answers,
        method=cast("Method", method),
        score=_score(named),
        correction=cast("Correction | None", correction),
    )
    page = analysis.save(out or folder / hpop.study.documents.REPORTS)
    echo(analysis.text())
    echo(f"written: {page}")
    hpop.study.folder.front_of(folder, answers.design)


@click.command()
@folder_argument
@click.option("--score", "named", default="ssq.total", metavar="FORM.SCORE", help="Primary score. [ssq.total]")
@click.option("--method", default="default", metavar="NAME", help="default, paper or mixed, as in a report. [default]")
@click.option("--correction", metavar="NAME", help="For several comparisons: holm, bonferroni or none. [the method's]")
@click.option("--effect", metavar="SD,SD", help="Smallest effect that matters, as in `hpop study power`.")
@click.option("--correlation", type=float, default=0.5, metavar="R", help="Correlation between two answers. [0.5]")
@user_errors
def preregister(
    folder: Path, named: str, method: str, correction: str | None, effect: str | None, correlation: float
) -> None:
    """Print a preregistration, made from the design.

    It names no letters, so you stay blind. What hpop cannot know, such as hypotheses, is left to fill in. With
    --effect, it gives the power of the planned number of participants.
    """
    design = hpop.study.Design.load(folder)
    test = "kruskal" if method == "paper" else "mixed" if method == "mixed" else None
    found = None
    if effect is not None:
        found = hpop.study.power(
            _shifts(effect), n=len(design.enrolled), k=len(design.letters), correlation=correlation, test=test
        )
    echo(
        hpop.study.preregistration(
            design,
            score=_score(named),
            method=cast("Method", method),
            correction=cast("Correction | None", correction),
            power=found,
        )
    )


def _score(text: str) -> tuple[str, str]:
    """Split FORM.SCORE into the id of the questionnaire and the name of its score."""
    form, _, name = text.partition(".")
    if not form or not name:
        raise click.UsageError(f"--score: expected FORM.SCORE, such as ssq.total, got {text!r}")
    return form, name


@click.command()
@click.option(
    "--effect",
    metavar="SD,SD",
    help="Shift of each stimulus, in standard deviations. A single number is that of the last; that of the first is "
    "then 0, and the others lie evenly between.",
)
@click.option("--people", type=int, metavar="N", help="Number of people; by default the least number is computed.")
@click.option("--stimuli", type=int, metavar="K", help="Number of stimuli. [3]")
@click.option("--correlation", type=float, metavar="R", help="Correlation between two answers of one person. [0.5]")
@click.option("--test", metavar="NAME", help="friedman, wilcoxon or kruskal. [friedman; wilcoxon for two stimuli]")
@click.option(
    "--target", type=float, default=0.8, metavar="SHARE", help="Power to reach, if --people is left out. [0.8]"
)
@click.option(
    "--pilot",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder of a pilot study: simulated people are drawn from its answers.",
)
@click.option("--score", "named", metavar="FORM.SCORE", help="Score of the pilot study to use. [ssq.total]")
@click.option("--seed", type=int, default=0, metavar="N", help="Random seed of the simulation. [0]")
@user_errors
def power(
    effect: str | None,
    people: int | None,
    stimuli: int | None,
    correlation: float | None,
    test: str | None,
    target: float,
    pilot: Path | None,
    named: str | None,
    seed: int,
) -> None:
    """Compute how many people a study needs.

    With --people, compute the power instead: the probability that so large a study finds the difference. Both are
    simulated before the study. Give --effect, the smallest difference that would matter, or --pilot.
    """
    if (effect is None) == (pilot is None):
        raise click.UsageError("give either --effect or --pilot")
    shifts = None if effect is None else _shifts(effect)
    several = len(shifts) if isinstance(shifts, list) else 3
    if stimuli is not None and (pilot is not None or (isinstance(shifts, list) and stimuli != several)):
        raise click.UsageError(
            "give --stimuli only with a single number for --effect: --pilot, or several numbers, set it already"
        )
    if (correlation if effect is None else named) is not None:
        raise click.UsageError("give --correlation only with --effect, and --score only with --pilot")
    found = hpop.study.power(
        shifts,
        n=people,
        k=several if stimuli is None else stimuli,
        correlation=0.5 if correlation is None else correlation,
        test=test,
        pilot=None if pilot is None else hpop.study.Answers.load(pilot).matrix(*_score(named or "ssq.total")).values,
        target=target,
        seed=seed,
    )
    echo(found.text())


def _shifts(text: str) -> Any:
    """Parse the value of --effect: a number, or a list of numbers between commas.

    "observed" is returned as text; the power analysis refuses it with a reason.
    """
    if text == "observed":
        return text
    try:
        several = [float(part) for part in text.split(",")]
    except ValueError:
        raise click.UsageError(f"--effect: expected a number, or numbers between commas, got {text!r}") from None
    if several == [0.0] or (len(several) > 1 and len(set(several)) == 1):
        raise click.UsageError(
            f"--effect {text} means no difference, which no study can find; give the smallest difference that would "
            "matter, such as 0.5"
        )
    return several if len(several) > 1 else several[0]


def _print_scores(answers: Answers) -> None:
    """Print the median of each score before the first stimulus and after each, with the number of people."""
    import numpy as np
    from rich.console import Console

    if not answers.sessions:
        return
    table = cli.report.plain_table()
    for name in ("form", "score", "before", *answers.design.letters):
        table.add_column(name, justify="left" if name in ("form", "score") else "right")
    rated = [form for form in answers.design.questionnaires if form.kind == "ratings"]
    scores = [(form.id, name) for form in rated for name in form.score_names]
    scores += [("tasks", name) for name in hpop.study.tasks.task_scores(answers.design)]
    for form, name in scores:
        columns = [answers.before(form, name), *answers.matrix(form, name).values.T]
        present = [column[~np.isnan(column)] for column in columns]
        cells = [f"{np.median(column):.2f} (n {column.size})" if column.size else "-" for column in present]
        table.add_row(form, name, *cells)
    echo("Medians")
    cli.report.print_wide(Console(), table)
