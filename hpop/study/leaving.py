"""Participants who leave a study: answers of drop-outs are kept, all data of withdrawn participants are deleted."""

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
from hpop.study.documents import REPORT, locked_for_changes, read_report, remove_report
from hpop.study.folder import PAGES, STIMULI, write_pages

BEGINNING, MOST_READ = 2**20, 2**26

"""Number of bytes that are searched for an id: at the beginning of a file of answers, and of any other file."""
TABLES = (*CSV, SQLITE, REMARKS)


class Withdrawal(NamedTuple):
    """Result of deleting a participant's data.

    removed    files, relative to the study's folder
    remade     tables and reports that were rewritten without the participant
    successor  id of the next person in this place
    notes      remaining tasks for the researcher
    """

    removed: tuple[str, ...]
    remade: tuple[str, ...]
    successor: str
    notes: tuple[str, ...]


@checked_arguments
def replace(folder: str | os.PathLike[str], participant: str) -> str:
    """Let a successor take the place of a participant who dropped out, and return the successor's id.

    The successor has the next free id, an equal order, and a page of its own. The participant's answers are kept.
    Raises StudyError if no participant with this id is expected.
    """
    target = Path(folder)
    Design.load(target)  # raises an error before a folder that is not a study is locked
    with locked_for_changes(target):
        return _record_departure(Design.load(target).after(participant, withdrawn=False), target, participant)


@checked_arguments
def withdraw(folder: str | os.PathLike[str], participant: str) -> Withdrawal:
    """Delete all data of a participant, rewrite tables and reports, and let a successor take the place.

    Every file in the folder that is named after the participant, or holds the participant's answers, is removed:
    answers, page, preference, and leftovers of killed programs. Existing tables and reports are rewritten from the
    remaining answers, or removed if these do not suffice. The call can be repeated after a crash.
    """
    target = Path(folder)
    Design.load(target)
    with locked_for_changes(target):
        design = Design.load(target)
        if participant not in design.withdrawn:
            design = design.after(participant, withdrawn=True)
        successor = _record_departure(design, target, participant)
        removed = sorted(_files_of(target, participant))
        for path in removed:
            path.unlink(missing_ok=True)
        for inner in (target, *_folders(target)):
            sweep(inner)
        remade, notes = _made_again(target, design)
    names = tuple(str(path.relative_to(target)) for path in removed)
    return Withdrawal(names, tuple(remade), successor, (*notes, *_files_naming(target, participant)))


def known_of(folder: str | os.PathLike[str], participant: str) -> tuple[str, ...]:
    """Return the files that :func:`withdraw` would remove, relative to the study's folder.

    Raises StudyError if there is no study, or it never had a participant with this id.
    """
    target = Path(folder)
    design = Design.load(target)
    if participant not in design.withdrawn:
        design.after(participant, withdrawn=True)
    return tuple(str(path.relative_to(target)) for path in sorted(_files_of(target, participant)))


def _record_departure(design: Design, folder: Path, participant: str) -> str:
    """Save that a participant left, and write the page of the successor; return the successor's id."""
    successor = next(one.successor for one in design.left if one.participant == participant)
    design.save(folder)
    if (folder / STIMULI).is_dir() and successor not in {one.participant for one in design.left}:
        write_pages(design, folder, [successor])
    return successor


def _folders(folder: Path) -> Iterator[Path]:
    """Yield all folders within a folder, without links."""
    yield from (path for path in folder.rglob("*") if path.is_dir() and not path.is_symlink())


def _files(folder: Path) -> Iterator[Path]:
    """Yield all files within a folder, without links."""
    yield from (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def _files_of(folder: Path, participant: str) -> Iterator[Path]:
    """Yield the files of a participant: those whose names begin with the id, and answer files that contain the id."""
    called = re.compile(rf"\.?{participant}(?![0-9])")
    says = re.compile(rf'"participant"\s*:\s*"{participant}"'.encode())
    for path in _files(folder):
        in_answers = path.parent == folder / ANSWERS
        if called.match(path.name) or (in_answers and says.search(_bytes(path, BEGINNING))):
            yield path


def _files_naming(folder: Path, participant: str) -> Iterator[str]:
    """Yield a note on each file that mentions a participant and was not written by hpop, such as a copy of a table."""
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
        yield f"{path} names {participant}, and hpop did not write it: remove this participant's data from it"


def _bytes(path: Path, most: int) -> bytes:
    """Return the first bytes of a file."""
    with path.open("rb") as file:
        return file.read(most)


def _made_again(folder: Path, design: Design) -> tuple[list[str], list[str]]:
    """Rewrite existing tables and reports without the participant, or remove them.

    Returns the names of the rewritten ones, and notes on the removed ones.
    """
    tables = [path for path in (folder / name for name in TABLES) if path.exists()]
    reports = sorted(path.parent for path in _files(folder) if path.name == REPORT)
    if not tables and not reports:
        return [], []
    try:
        answers = Answers.load(folder, design)
    except StudyError as error:
        for path in tables:
            path.unlink()
        notes = [f"tables and reports were removed, and cannot be made again until this is fixed: {error}"]
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
    """Rewrite a report from the answers, or only remove it without answers; return a note if it was not rewritten."""
    try:
        made = read_report(report)
        remove_report(report)
    except StudyError as error:
        return f"the report in {report} may still have data of the person who withdrew: remove it ({error})"
    if answers is None:
        return ""
    try:
        form, score = made.score
        analysis = analyse(answers.design, answers, score=(form, score), method=made.method, correction=made.correction)
        analysis.save(report)
    except StudyError as error:
        return f"the report in {report} was removed, and not made again: {error}"
    return ""
