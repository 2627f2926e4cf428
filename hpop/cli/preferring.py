"""Command ``hpop prefer``: ask a person which of two trajectories is better, until the best one for them is known."""

from __future__ import annotations

import io
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

import hpop
from hpop import cli
from hpop.base.text import argument
from hpop.cli import results
from hpop.cli.page_words import LANGUAGES
from hpop.cli.results import loaded, problem_of
from hpop.cli.terminal import echo, imports_option, user_errors
from hpop.errors import OutputError, StudyError

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hpop.cli.picking import Difference
    from hpop.preference import FitCheck, Preference
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem

FILE, PICTURE = "preference.json", "pair.png"
DPI = 80
PREFER, COMFORT = "prefer", "comfort"
QUESTIONS = 12
ANSWERS = {"a": "a", "b": "b", "t": "tie", "tie": "tie", "s": "stop", "stop": "stop"}
MOST_PORT = 65_535


class Asking:
    """Series of questions to one person about the trajectories of a front; each answer is saved at once.

    most    the largest number of questions
    texts   texts of the page and of the questions, in the participant's language
    tested  True to test afterwards whether a weighted sum fits the person, by some more questions
    check   that test; None until it begins
    why     reason why no more questions are asked; "" while they go on
    pair    rows of the two trajectories of the current question; None after the last
    """

    def __init__(
        self,
        person: Preference,
        problem: Problem,
        front: Front,
        file: Path,
        most: int,
        tested: bool = False,
        language: str = "en",
    ) -> None:
        self.person, self.problem, self.front, self.file, self.most = person, problem, front, file, most
        self.tested, self.texts = tested, cli.page_words.words_of(language)
        self.check: FitCheck | None = None
        self.why = self._why()
        self.pair = self._next()

    @property
    def number(self) -> int:
        """Return the number of the current question, counted from 1."""
        return len(self.person.answers) + 1

    @property
    def words(self) -> str:
        """Return the text of the current question, with its number."""
        return f"{self.number}. {self.texts.say(self.person.question)}"

    @property
    def is_over(self) -> bool:
        """Return whether no question is left."""
        return self.pair is None

    def answer(self, word: str) -> None:
        """Save an answer (a, b or tie) and choose the next question; "stop" ends the questions."""
        assert self.pair is not None
        if word == "stop":
            self.pair, self.why = None, "as asked"
            return
        a, b = self.pair
        chosen = {"a": a, "b": b, "tie": None}[word]
        check = None if self.check is None else self.check.told(a, b, chosen)
        person = self.person.told(a, b, chosen)
        with results.output_errors(f"cannot write {self.file}", "choose another --out"):
            person.save(self.file)
        self.person, self.check = person, check  # only after it is saved
        self.why = self._why()
        self.pair = self._next()

    def differences(self) -> list[Difference]:
        """Compare the costs of the two trajectories of the current question."""
        assert self.pair is not None
        return cli.picking.differences(self.front, self.pair, self.texts.language)

    def picture(self) -> bytes:
        """Return a PNG image for the page: a map of both trajectories, without words, which would be English."""
        return _png(self.figure(wordless=True))

    def figure(self, *, wordless: bool) -> Figure:
        """Return a map of the two trajectories of the current question, with legends or without words."""
        import numpy as np

        assert self.pair is not None
        both = self.front[np.isin(np.arange(len(self.front)), self.pair)]
        places = {name: int(row > min(self.pair)) for name, row in zip("ab", self.pair, strict=True)}
        figure = hpop.view.draw_map(self.problem, both, chosen=places)
        if wordless:
            whole, *bars = figure.axes
            whole.set_axis_off()
            captions = [text for text in whole.texts if text.get_gid() == "caption"]
            for part in [*bars, *figure.legends, *figure.texts, *captions]:
                part.remove()
        return figure

    def result(self) -> list[str]:
        """Return the result in words: the person's best trajectory, or a warning that no preference can be seen."""
        best, texts = self.person.best(), self.texts
        share = texts.number(f"{best.probability[best.row]:.2f}")
        words = [] if self.person.can_be_seen else [texts.say("unseen")]
        words.append(texts.say("best", row=best.row, share=share))
        if self.check is not None:
            words.append(texts.say("fits") if self.check.fits else texts.say("unfit", row=self.check.best))
        return words

    def _why(self) -> str:
        return self.person.why_stop(self.most)

    def _next(self) -> tuple[int, int] | None:
        if not self.why:
            pair = self.person.next_pair()
            self.why = "" if pair else "all trajectories that differ noticeably were compared"
            if pair:
                return pair
        if self.tested and self.check is None and self.person.answers:
            self.check = hpop.study.FitCheck.of(self.person)
        return None if self.check is None else self.check.next_pair()


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE", help=f"File for the answers. [FOLDER/{FILE}]")
@click.option(
    "--question", type=click.Choice([PREFER, COMFORT]), default=PREFER, show_default=True, help="Question to ask."
)
@click.option(
    "--most", type=click.IntRange(1, 200), default=QUESTIONS, show_default=True, help="Largest number of questions."
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    metavar="N",
    help="Random seed, which decides which trajectory is a and which b. [any]",
)
@click.option("--check", is_flag=True, help="Test with 3 to 24 more questions whether a weighted sum fits the person.")
@click.option("--web", is_flag=True, help="Ask on a page in a browser, on this machine only.")
@click.option(
    "--language",
    type=click.Choice(LANGUAGES),
    metavar="|".join(LANGUAGES),
    help="Language of the page: English, German or Finnish. [en]",
)
@click.option("--port", type=click.IntRange(0, MOST_PORT), default=0, metavar="PORT", help="Port of the page. [any]")
@imports_option
@user_errors
def prefer(
    folder: Path,
    out: Path | None,
    question: str,
    most: int,
    seed: int | None,
    check: bool,
    web: bool,
    language: str | None,
    port: int,
    imports: tuple[str, ...],
) -> None:
    """Ask a person to choose between pairs of trajectories.

    FOLDER holds the front that `hpop plan` wrote. Each question is the most informative one. Asking ends when the best
    trajectory is known, after --most questions, or with "stop"; --check adds 3 to 24 questions. After Ctrl-C the
    answers are kept, and the same command continues. The answers and the inferred weights of costs are written to a
    file, for `hpop show --preference` and `choose` in a scenario.
    """
    if language is not None and not web:
        raise click.UsageError("--language is that of the page: give --web too; the terminal asks in English")
    cli.user_code.register(imports)
    path, front = loaded(folder)
    problem = problem_of(path, front)
    file = path.with_name(FILE) if out is None else out
    asking = Asking(_person(front, file, question, seed), problem, front, file, most, check, language or "en")
    try:
        if web and not asking.is_over:
            cli.serving.serve(asking, port, echo)
        elif not asking.is_over:
            _ask(asking, path.with_name(PICTURE))
    finally:
        if asking.person.answers:
            if asking.why:
                echo(f"no more questions: {asking.why}")
            cli.picking.print_preference(asking.person, front)
            if asking.check is not None:
                echo(asking.check.words())
            shell = f"hpop show {argument(folder)} --web --preference {argument(file)}"
            echo(f"written: {file}; `{shell}` marks the best one on a page")


def _person(front: Front, file: Path, question: str, seed: int | None) -> Preference:
    """Load the preference in a file, to continue its questions; if there is no file, begin a new preference.

    Raises StudyError if the file has answers to another question, or another seed.
    """
    from hpop.base.randomness import seed_of

    if not file.exists():
        if not file.parent.is_dir():
            raise OutputError(f"cannot write {file}: its folder does not exist; create it, or choose another --out")
        seed = seed_of(None) if seed is None else seed
        return hpop.study.Preference.fit(front, question=question, ties=True, seed=seed)
    with results.output_errors(f"cannot read {file}", "choose another --out"):
        person = hpop.study.Preference.load(file).on(front)
    if person.question != question or not person.ties:
        raise StudyError(
            f"{file} has answers to another question ({person.question}); give another --out, or remove that file"
        )
    if seed is not None and seed != person.seed:
        raise StudyError(
            f"{file} was begun with --seed {person.seed}, got {seed}; leave out --seed to continue, or give another "
            "--out"
        )
    echo(f"continuing after {len(person.answers)} answers in {file}; if this is another person, give another --out")
    return person


def _ask(asking: Asking, picture: Path) -> None:
    """Ask the questions on the terminal. Meanwhile a file holds a map of the two trajectories."""
    from rich.console import Console

    try:
        while asking.pair is not None:
            with results.output_errors(f"cannot write {picture}", "give a folder that can be written to"):
                picture.write_bytes(_png(asking.figure(wordless=False)))
            echo(f"\n{asking.words}")
            cli.report.print_wide(Console(), cli.picking.pair_table(asking.front, asking.pair))
            echo(f"both on the map: {picture}")
            asking.answer(_answered())
    finally:
        with suppress(OSError):
            picture.unlink(missing_ok=True)


def _png(figure: Figure) -> bytes:
    """Return a figure as a PNG image without margins."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=DPI, bbox_inches="tight")
    return data.getvalue()


def _answered() -> str:
    """Ask for an answer until it is a, b, tie or stop; return it. The end of the input means stop."""
    while True:
        click.echo("a, b, tie or stop? ", nl=False)
        line = sys.stdin.readline()
        if not line:
            click.echo()
            return "stop"
        word = ANSWERS.get(line.strip().lower())
        if word is not None:
            return word
        echo("answer a, b, tie (no difference) or stop")
