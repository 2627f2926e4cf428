"""Commands ``hpop study``: run a study in which people judge trajectories, from its design to tables of answers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import hpop
from hpop import cli
from hpop.base.files import read_regular
from hpop.base.text import argument, counted
from hpop.cli.results import loaded
from hpop.cli.study_scores import folder_argument, power, preregister, report, score
from hpop.cli.terminal import Commands, echo, imports_option, listed, user_errors
from hpop.errors import HpopError, StudyError
from hpop.runtime import limits
from hpop.runtime.limits import Progress

# Heavy modules are imported inside functions, so that `hpop --help` and usage errors answer at once.

if TYPE_CHECKING:
    from hpop.problems.front import Front
    from hpop.problems.named_rows import NamedRow

DEFAULT_COUNT = 3
MOST_LINES = 40
PORT = 8000
LIVE_PORT = 8020
MOST_CONSENT = 100_000  # bytes


@click.group(cls=Commands)
def study() -> None:
    """Ask people about trajectories: design, pages, answers, scores.

    Everything is in one folder DIR: `hpop study init DIR` creates it, and the other commands use it.
    """


for _command in (power, preregister, report, score):
    study.add_command(_command)


def _strata(context: click.Context, option: click.Parameter, given: Sequence[str]) -> dict[str, list[str]]:
    """Parse the values NAME=LEVEL,LEVEL of the repeated option --strata, such as sex=f,m; return the levels by name."""
    found: dict[str, list[str]] = {}
    for text in given:
        name, _, levels = text.partition("=")
        if not name or not levels or name in found:
            raise click.BadParameter(
                f"expected NAME=LEVEL,LEVEL, such as sex=f,m, and each NAME once, got {text!r}", context, option
            )
        found[name] = levels.split(",")
    return found


def _factors(context: click.Context, option: click.Parameter, given: Sequence[str]) -> dict[str, list[str | float]]:
    """Parse the values NAME=LEVEL,LEVEL of --factor; return the levels by name, those that are numbers as numbers."""
    return {name: [_number(level) for level in levels] for name, levels in _strata(context, option, given).items()}


def _number(text: str) -> str | float:
    """Return a text as a number if it is one."""
    try:
        return float(text)
    except ValueError:
        return text


@study.command()
@folder_argument
@click.option(
    "--front", type=click.Path(path_type=Path), required=True, metavar="DIR", help="Folder that `hpop plan` wrote."
)
@click.option(
    "--rows",
    metavar="ROW,ROW",
    multiple=True,
    callback=listed,
    help="Rows to show: numbers from `hpop show`, knee, or a criterion, for the row with its least value; view is a "
    "baseline, the still view from the start; live is a session of `hpop study live`. [the knee and two others]",
)
@click.option(
    "--count", type=int, metavar="N", help="Number of rows in all; those that differ most from --rows are added."
)
@click.option("--by", metavar="NAME", help="Difference by which --count adds rows: of costs, or of paths. [costs]")
@click.option(
    "--share",
    type=float,
    metavar="SHARE",
    help="Add only rows of similar duration: 0.1 lets the longest last at most 10 % longer than the shortest.",
)
@click.option("--participants", type=int, required=True, metavar="N", help="Number of people who take part.")
@click.option(
    "--order",
    default="permutations",
    metavar="NAME",
    help="Balancing of orders: permutations, williams, latin or random. [permutations]",
)
@click.option(
    "--strata",
    multiple=True,
    metavar="NAME=A,B",
    callback=_strata,
    help="Property of people that is balanced within each order, such as sex=f,m. Repeatable.",
)
@click.option("--consent", type=click.Path(path_type=Path), required=True, metavar="FILE", help="Text of the consent.")
@click.option(
    "--forms",
    metavar="NAME,NAME",
    multiple=True,
    callback=listed,
    default=["ssq,comfort"],
    help="Questionnaires: ssq, vrsq, csq_vr, fms, nasa_tlx, sus, comfort, naturalness, gaming, mssq, or files of your "
    "own. [ssq,comfort]",
)
@click.option(
    "--comparisons/--no-comparisons",
    default=True,
    help="Whether participants compare pairs of stimuli at the end. [yes]",
)
@click.option("--rest", type=float, default=180.0, metavar="S", help="Least rest between stimuli. [180]")
@click.option("--video", is_flag=True, help="Show 360 degree videos in your own player instead of rides in the page.")
@click.option(
    "--factor",
    "factors",
    multiple=True,
    metavar="NAME=A,B",
    callback=_factors,
    help="Factor beside the rows, with its levels: cue, latency, restrictor or setting, as in latency=0,0.5. "
    "Repeatable.",
)
@click.option("--tasks", type=click.Path(path_type=Path), metavar="FILE", help="Tasks during each ride, in YAML.")
@click.option(
    "--language", default="en", metavar="CODE", help="Language of the pages: en, de, fi, or that of --words. [en]"
)
@click.option("--words", type=click.Path(path_type=Path), metavar="FILE", help="Texts of the pages in that language.")
@click.option("--seed", type=int, default=0, metavar="N", help="Random seed of letters, orders and pairs. [0]")
@user_errors
def init(
    folder: Path,
    front: Path,
    rows: list[str],
    count: int | None,
    by: str | None,
    share: float | None,
    participants: int,
    order: str,
    strata: dict[str, list[str]],
    consent: Path,
    forms: list[str],
    comparisons: bool,
    rest: float,
    video: bool,
    factors: dict[str, list[str | float]],
    tasks: Path | None,
    language: str,
    words: Path | None,
    seed: int,
) -> None:
    """Begin a study of some trajectories of a front.

    Writes the design, the schedule, the stimuli, a page for each participant, and a copy of the front
    to a new folder DIR.
    """
    hpop.study.folder.check_unused(folder)
    text = _consent(consent)
    path, planned = loaded(front)
    shown = _rows(planned, rows, count, by, share)
    with _beside(partial(_check_words, language, words)):
        design = hpop.study.Design.of(
            planned,
            shown,
            participants=participants,
            consent=text,
            order=order,
            strata=strata,
            forms=forms,
            comparisons=comparisons,
            kind="video" if video else "ride",
            factors=factors,
            protocol=hpop.study.Protocol(rest_s=rest, tasks=_tasks(tasks)),
            language=language,
            seed=seed,
        )
    with limits.progress_bar() as progress:
        progress(Progress("stimuli and pages"))
        hpop.study.prepare(design, planned, folder, words=words, progress=progress)
    for note in design.notes:
        echo(f"note: {note}")
    echo(f"{participants:,} participants, {len(design.orders):,} orders of {len(design.letters)} stimuli of {path}")
    echo(f"written to {folder}: schedule.csv says who sees what; `hpop study serve {argument(folder)}` shows the pages")


@study.command()
@folder_argument
@click.option("--port", type=click.IntRange(0, 65535), default=PORT, metavar="N", help=f"Port to serve on. [{PORT}]")
@click.option("--network", is_flag=True, help="Serve headsets in the network too, over https: needs hpop[serve].")
@click.option("--lsl", is_flag=True, help="Send each event as a marker of Lab Streaming Layer: needs hpop[lab].")
@user_errors
def serve(folder: Path, port: int, network: bool, lsl: bool) -> None:
    """Serve the pages to participants, and save each answer.

    Runs until Ctrl-C. Pages are served to this machine, and to a headset on a cable after `adb reverse`; with --network
    also to other machines.
    """
    from hpop.study.markers import Markers
    from hpop.study.server import StudyServer, token_of

    serving = cli.serving
    design = hpop.study.Design.load(folder)  # refuses a folder that is no study
    markers = Markers(design.digest) if lsl else None
    here = serving.own_address() if network else serving.LOCAL
    certificate = serving.certificate_for(here) if network else None
    with StudyServer(
        folder,
        port=port,
        host=serving.EVERYWHERE if network else serving.LOCAL,
        names=[here],
        token=token_of(folder),
        secured=None if certificate is None else serving.context_of(certificate),
        tell=lambda said: echo(f"error: {said}", err=True),
        markers=markers,
    ) as server:
        serving.serve_headsets(server, certificate, f"sessions, until Ctrl-C: {server.address(here)}")
        echo("no longer served; every answer that a page called saved is in answers/")


@study.command()
@folder_argument
@click.argument("participant")
@click.argument("scenario", type=click.Path(path_type=Path))
@click.option("--port", type=click.IntRange(0, 65535), default=LIVE_PORT, metavar="N", help=f"Port. [{LIVE_PORT}]")
@imports_option
@user_errors
def live(folder: Path, participant: str, scenario: Path, port: int, imports: Sequence[str]) -> None:
    """Run a live session, in which a participant drives.

    PARTICIPANT is an id, such as p07; SCENARIO has the robot and its map. The session is served to this machine, as by
    `hpop live`, until Ctrl-C. Its record becomes a part of the answers in DIR, and `hpop study report` has a table of
    what each participant did.
    """
    from hpop.cli.living import server_of
    from hpop.study.live import record_name

    design = hpop.study.Design.load(folder)
    name = record_name(design, participant)
    with server_of(scenario, folder / hpop.study.documents.ANSWERS, imports, name=name, port=port) as server:
        echo(f"drive: {server.address(cli.serving.LOCAL)}")
        echo(f"record: {server.session.record_path}")
        server.serve_forever()


@study.command()
@folder_argument
@user_errors
def check(folder: Path) -> None:
    """Look for faults in the front, pages and answers.

    The exit code is 17 if the front, stimuli, pages or answers of the study in DIR have faults.
    """
    found = hpop.study.check(folder)
    for note in found.notes:
        echo(f"note: {note}")
    for fault in found.faults[:MOST_LINES]:
        echo(f"fault: {fault}", err=True)
    if found.faults:
        more = f", {MOST_LINES} of them listed" if len(found.faults) > MOST_LINES else ""
        raise StudyError(f"{folder} has {counted(len(found.faults), 'fault')}{more}")
    echo("no faults")


@study.command()
@folder_argument
@click.argument("participant")
@user_errors
def replace(folder: Path, participant: str) -> None:
    """Replace a person who dropped out by another one.

    PARTICIPANT is the id of the person who dropped out, such as p07. Answers so far are kept.
    """
    successor = hpop.study.replace(folder, participant)
    echo(f"{participant} dropped out; {successor} takes the place, in the same order: pages/{successor}.html")


@study.command()
@folder_argument
@click.argument("participant")
@click.option("--yes", is_flag=True, help="Do not ask for a confirmation.")
@user_errors
def withdraw(folder: Path, participant: str, yes: bool) -> None:
    """Delete all data of a PARTICIPANT who withdraws.

    PARTICIPANT is an id, such as p07. The data are deleted after a confirmation, or with --yes; tables and reports are
    made again without them. The next person takes the place, under another id.
    """
    from hpop.study.folder import known_of

    files = known_of(folder, participant)
    if not yes:
        if not sys.stdin.isatty():
            raise StudyError(
                "nothing was deleted, because there is no terminal to confirm it: give --yes to delete all data of "
                f"{participant}"
            )
        echo(f"this deletes for good: {', '.join(files) or 'no file, as none is left'}; tables are made again")
        click.confirm(f"delete all data of {participant}?", abort=True)
    done = hpop.study.withdraw(folder, participant)
    echo(f"{participant} withdrew; removed: {', '.join(done.removed) or 'no file, as none was left'}")
    if done.remade:
        echo(f"made again without {participant}: {', '.join(done.remade)}")
    for note in done.notes:
        echo(f"note: {note}", err=True)
    echo(f"{done.successor} takes the place, in the same order")


def _check_words(language: str, path: Path | None) -> None:
    """Raise StudyError unless the pages' texts are complete: those in the file ``path``, or hpop's own without a file.

    ``language`` selects hpop's own texts.
    """
    if path is None:
        hpop.study.documents.words(language)
    else:
        hpop.study.documents.checked_file(path)


@contextmanager
def _beside(check: Callable[[], None]) -> Iterator[None]:
    """Run a check, then the ``with`` block. If one or both raise StudyError, raise one StudyError with all messages."""
    said = []
    try:
        check()
    except StudyError as error:
        said.append(str(error))
    try:
        yield
    except StudyError as error:
        said.insert(0, str(error))
    if said:
        raise StudyError("; and ".join(said))


def _rows(
    front: Front, asked: list[str], count: int | None, by: str | None, share: float | None
) -> list[str | NamedRow]:
    """Return the rows named by --rows and, up to ``count`` in all, further rows that differ most from them."""
    from hpop.study.conditions import OWN_KINDS

    if asked and count is None:
        if share is not None or by is not None:
            raise click.UsageError("--share and --by choose the rows that --count adds: give --count as well")
        return [*asked]
    views = [row for row in asked if row in OWN_KINDS]
    named = [row for row in asked if row not in OWN_KINDS] or ["knee"]
    several = DEFAULT_COUNT if count is None else count
    if several < max(2, len(named) + len(views)):
        raise click.UsageError(
            f"--count is the number of all stimuli: expected {max(2, len(named) + len(views))} or more, got {several}"
        )
    return [*hpop.study.pick(front, several - len(views), always=named, by=by or "costs", share=share), *views]


def _tasks(path: Path | None) -> Any:
    """Return the tasks in a YAML file, {} without one; StudyError if it cannot be read."""
    from hpop.scenario.yaml_lines import Document

    try:
        return {} if path is None else Document(path).values
    except HpopError as error:
        raise StudyError(str(error)) from None


def _consent(path: Path) -> str:
    """Return the text in the consent file; StudyError if it cannot be read."""
    try:
        return read_regular(path, MOST_CONSENT).decode()
    except OSError as error:
        raise StudyError(
            f"cannot read the consent text {path}: {error.strerror or error}; write what participants agree to before "
            "they begin into a text file, and name it by --consent"
        ) from None
    except UnicodeDecodeError:
        raise StudyError(f"{path}: the consent text must be UTF-8; save it as UTF-8") from None
