"""Who leaves a study: the answers of who dropped out stay, of who withdraws nothing is kept."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.files import sweep
from hpop.errors import StudyError
from hpop.study.analysis import analyse
from hpop.study.answers import CSV, REMARKS, SQLITE, Answers
from hpop.study.answers import FOLDER as ANSWERS
from hpop.study.design import Design
from hpop.study.design_file import FILE, FRONT, PEOPLE, SCHEDULE
from hpop.study.documents import REPORT, changing, read_report, remove_report
from hpop.study.folder import PAGES, STIMULI, write_pages

BEGINNING = 2**20
MOST_READ = 2**26
"""Bytes of a file that is looked through for an id."""
TABLES = (*CSV, SQLITE, REMARKS)


class Withdrawal(NamedTuple):
    """What was removed of a participant.

    removed    files, as they are called in the study's folder
    remade     files and reports that were made again, without the participant
    successor  who has the place
    notes      what is still to be done
    """

    removed: tuple[str, ...]
    remade: tuple[str, ...]
    successor: str
    notes: tuple[str, ...]


@checked_arguments
def replace(folder: str | os.PathLike[str], participant: str) -> str:
    """Replace a participant who dropped out: the next id, with the same order and its own page.

    What the participant answered stays. Raises StudyError where nobody of this id is expected.
    """
    target = Path(folder)
    Design.load(target)  # what is no study is not locked
    with changing(target):
        return _followed(Design.load(target).after(participant, withdrawn=False), target, participant)


@checked_arguments
def withdraw(folder: str | os.PathLike[str], participant: str) -> Withdrawal:
    """Return delete all that is known of a participant; tables and reports are made again; the next id takes the place.

    Every file in the folder that is called after the participant, or that holds the participant's answers, is removed:
    answers, page, preference, what a writer left that was killed. Tables that are there, and reports in the folder, are
    made again of the others' answers, or removed where these do not suffice. It may be called again after a crash.
    """
    target = Path(folder)
    Design.load(target)
    with changing(target):
        design = Design.load(target)
        if participant not in design.withdrawn:
            design = design.after(participant, withdrawn=True)
        successor = _followed(design, target, participant)
        removed = sorted(_files_of(target, participant))
        for path in removed:
            path.unlink(missing_ok=True)
        for inner in (target, *_folders(target)):
            sweep(inner)
        remade, notes = _made_again(target, design)
    names = tuple(str(path.relative_to(target)) for path in removed)
    return Withdrawal(names, tuple(remade), successor, (*notes, *_naming(target, participant)))


def known_of(folder: str | os.PathLike[str], participant: str) -> tuple[str, ...]:
    """Return the files that :func:`withdraw` would remove, as they are called in the study's folder.

    Raises StudyError where there is no study, or never was a participant of this id.
    """
    target = Path(folder)
    design = Design.load(target)
    if participant not in design.withdrawn:
        design.after(participant, withdrawn=True)
    return tuple(str(path.relative_to(target)) for path in sorted(_files_of(target, participant)))


def _followed(design: Design, folder: Path, participant: str) -> str:
    """Save who left, and write the page of the successor."""
    successor = next(one.successor for one in design.left if one.participant == participant)
    design.save(folder)
    if (folder / STIMULI).is_dir() and successor not in {one.participant for one in design.left}:
        write_pages(design, folder, [successor])
    return successor


def _folders(folder: Path) -> Iterator[Path]:
    yield from (path for path in folder.rglob("*") if path.is_dir() and not path.is_symlink())


def _files(folder: Path) -> Iterator[Path]:
    yield from (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def _files_of(folder: Path, participant: str) -> Iterator[Path]:
    """Files that are called after a participant, hidden ones of a writer that was killed too, or hold its answers."""
    called = re.compile(rf"\.?{participant}(?![0-9])")
    says = re.compile(rf'"participant"\s*:\s*"{participant}"'.encode())
    for path in _files(folder):
        in_answers = path.parent == folder / ANSWERS
        if called.match(path.name) or (in_answers and says.search(_bytes(path, BEGINNING))):
            yield path


def _naming(folder: Path, participant: str) -> Iterator[str]:
    """Yield which files of others than hpop name a participant: copies of tables, for instance."""
    own = {folder / name for name in (FILE, FRONT, PEOPLE, SCHEDULE, *TABLES)}
    own_folders = {folder / name for name in (ANSWERS, PAGES, STIMULI)} | {
        path.parent for path in _files(folder) if path.name == REPORT
    }
    word = re.compile(rf"(?<![A-Za-z0-9+/]){participant}(?![A-Za-z0-9+/])".encode())
    found = [
        path
        for path in _files(folder)
        if path not in own and path.parent not in own_folders and word.search(_bytes(path, MOST_READ))
    ]
    for path in sorted(found):
        yield f"{path} names {participant}, and hpop does not keep it: remove what is theirs from it"


def _bytes(path: Path, most: int) -> bytes:
    with path.open("rb") as file:
        return file.read(most)


def _made_again(folder: Path, design: Design) -> tuple[list[str], list[str]]:
    """Make tables and reports that are there again, or remove them; which were made, and why the others were not."""
    tables = [path for path in (folder / name for name in TABLES) if path.exists()]
    reports = sorted(path.parent for path in _files(folder) if path.name == REPORT)
    if not tables and not reports:
        return [], []
    try:
        answers = Answers.load(folder, design)
    except StudyError as error:
        for path in tables:
            path.unlink()
        notes = [f"tables and reports were removed, and cannot be made again before this is mended: {error}"]
        return [], notes + [said for report in reports if (said := _reported_again(report, None))]
    remade = [path.name for path in answers.save_tables(folder)] if tables else []
    notes = []
    for report in reports:
        if why := _reported_again(report, answers):
            notes.append(why)
        else:
            remade.append(f"{report.relative_to(folder)}/")
    return remade, notes


def _reported_again(report: Path, answers: Answers | None) -> str:
    """Remove a report, and make it again of answers where there are any; what is to be said of it, or nothing."""
    try:
        made = read_report(report)
        remove_report(report)
    except StudyError as error:
        return f"the report in {report} may still show who withdrew: remove it ({error})"
    if answers is None:
        return ""
    try:
        form, score = made.score
        analysis = analyse(answers.design, answers, score=(form, score), method=made.method, correction=made.correction)
        analysis.save(report)
    except StudyError as error:
        return f"the report in {report} was removed, and not made again: {error}"
    return ""
