"""Folder of a study: created completely or not at all, checked for faults, and cleared of participants who leave.

Answers of drop-outs are kept; all data of withdrawn participants are deleted.
"""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.files import sweep
from hpop.errors import HpopError, StudyError
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.limits import ProgressCallback
from hpop.study import tasks
from hpop.study.analysis import analyse
from hpop.study.answers import CSV, REMARKS, SQLITE, Answers, read_sessions
from hpop.study.conditions import FILE, FRONT, LIVE, OWN_KINDS, PEOPLE, SCHEDULE, Baseline
from hpop.study.design import Design
from hpop.study.documents import (
    ANSWERS,
    MOST_WORDS,
    PAGES,
    REPORT,
    STIMULI,
    WORDS,
    checked_file,
    front_digest,
    hold,
    locked_for_changes,
    read_bytes,
    read_report,
    release,
    remove_report,
    write_bytes,
)
from hpop.study.live import live_table
from hpop.study.page import rides_of, save_stimuli, session_page
from hpop.trajectories.trajectory import Trajectory

PRIVATE = 0o700
"""Permissions of a study's folder: only its owner may read people's answers."""


@checked_arguments
def prepare(
    design: Design,
    front: Front,
    folder: str | os.PathLike[str],
    *,
    baselines: Sequence[Baseline] = (),
    words: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Path:
    """Write everything that a study needs to a new folder, completely or not at all.

    It contains design.json, schedule.csv, front.json (a copy, so that the study does not depend on the original),
    stimuli/, and a page for each participant in pages/. Only the folder's owner may read it.

    Parameters
    ----------
    baselines : baselines of the design, with their trajectories
    words : texts of the pages, if hpop has none in the design's language: a translation of its ``en.json``
    progress : progress callback for videos, as for :func:`hpop.view.save_video`

    Raises StudyError if the folder is in use, the front is not the design's, or texts are missing; OutputError if a
    stimulus cannot be written.
    """
    target = Path(folder)
    check_unused(target)
    if front_digest(front) != design.front_sha256:
        raise StudyError(
            "expected the front from which the design was made, got another one; give that front, or make a new design"
        )
    problem = Problem.from_description(front.problem or {})
    with _whole(target) as made:
        if words is not None:
            checked_file(words)
            (made / WORDS).mkdir()
            write_bytes(made / WORDS / f"{design.language}.json", read_bytes(words, MOST_WORDS))
        design.save(made)
        front.save(made / FRONT)
        (made / ANSWERS).mkdir()
        save_stimuli(
            problem,
            front,
            design.conditions,
            made / STIMULI,
            baselines=_baseline_trajectories(design, baselines),
            language=design.language,
            study=made,
            progress=progress,
        )
        write_pages(design, made, [person.id for person in design.enrolled])
    return target


def _baseline_trajectories(design: Design, baselines: Sequence[Baseline]) -> dict[str, Trajectory]:
    """Return the trajectories of the design's baselines, by letter; StudyError if the given ones do not match."""
    known = {baseline.name: baseline.trajectory for baseline in baselines}
    wanted = {one.name: one.id for one in design.conditions if one.row is None and one.kind not in OWN_KINDS}
    if known.keys() != wanted.keys():
        raise StudyError(
            f"the design's baselines are {', '.join(wanted) or 'none'}, got {', '.join(known) or 'none'}; give prepare "
            "the same baselines as Design.of"
        )
    return {wanted[name]: trajectory for name, trajectory in known.items()}


def check_unused(folder: Path) -> None:
    """Raise StudyError unless a new study can begin in a folder: it must not exist yet, or be empty."""
    try:
        in_use = folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir())))
    except (OSError, ValueError) as error:
        raise StudyError(f"cannot use {folder}: {error}") from None
    if in_use:
        raise StudyError(f"{folder} is in use, but a study must begin in a new or empty folder; choose another")


def write_pages(design: Design, folder: Path, participants: list[str]) -> None:
    """Write the session pages of participants into the study's folder."""
    (folder / PAGES).mkdir(exist_ok=True)
    rides = rides_of(design.public(participants[0]), folder)
    for participant in participants:
        page = session_page(design.public(participant), folder, rides=rides)
        write_bytes(folder / PAGES / f"{participant}.html", page.encode())


def front_of(folder: str | os.PathLike[str], design: Design) -> Front:
    """Load the front of a study; StudyError if the file has changed since the study began."""
    path = Path(folder) / FRONT
    try:
        front = Front.load(path)
    except (OSError, ValueError, LookupError) as error:
        raise StudyError(f"the study's front cannot be read: {error}; restore {path}") from None
    if front_digest(front) != design.front_sha256:
        raise StudyError(
            f"{path} has changed since the study began: its rows are not those that people see; restore the file"
        )
    return front


@contextmanager
def _whole(target: Path) -> Iterator[Path]:
    """Yield a temporary folder that is renamed to ``target`` at the end, or removed after an error."""
    made = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    held = None
    try:
        made.parent.mkdir(parents=True, exist_ok=True)
        _sweep(target)
        made.mkdir(PRIVATE)
        held = hold(made, wait=False)
        yield made
        made.rename(target)
    except HpopError as error:  # it may name the temporary folder
        error.args = tuple(str(said).replace(str(made), str(target)) for said in error.args)
        raise
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}; choose another folder") from None
    finally:
        release(held)
        shutil.rmtree(made, ignore_errors=True)


def _sweep(target: Path) -> None:
    """Remove unfinished study folders that killed programs have left beside ``target``."""
    for made in target.parent.glob(f".{escape(target.name)}.{'[0-9a-f]' * 32}.tmp"):
        with suppress(OSError, StudyError):
            if (held := hold(made, wait=False)) is not None:
                shutil.rmtree(made, ignore_errors=True)
                release(held)


class Checked(NamedTuple):
    """Result of checking a study's folder.

    faults  faults that need action: unreadable files, incomplete sessions, missing items
    notes   information: participants still expected, stimuli of unequal duration
    """

    faults: tuple[str, ...]
    notes: tuple[str, ...]


@checked_arguments
def check(folder: str | os.PathLike[str]) -> Checked:
    """Check the front, stimuli, pages and answers in a study's folder, and return faults and notes.

    Raises StudyError if the folder has no valid design, too many files of answers, or a live session's record of an
    unexpected participant or size; OutputError for a file that is no record.
    """
    target = Path(folder)
    design = Design.load(target)
    faults = []
    try:
        front_of(target, design)
    except StudyError as error:
        faults.append(str(error))
    needed = [condition.stimulus for condition in design.conditions if condition.stimulus]
    needed += [f"{PAGES}/{person.id}.html" for person in design.expected]
    faults += [f"{target / name} is missing" for name in needed if not (target / name).is_file()]
    sessions, refused = read_sessions(target, design)
    answers = Answers(design, tuple(sessions), live_table(target, design))
    faults += _without_live(answers)
    return Checked((*faults, *refused, *answers.faults), (*design.notes, *answers.notes))


def _without_live(answers: Answers) -> list[str]:
    """Return a fault for each participant whose session has ended without a record of the live session."""
    if not any(condition.kind == LIVE for condition in answers.design.conditions):
        return []
    recorded = {row["participant"] for row in answers.live}
    return [
        f"{session.person.id} has no record of the live session; it is made by `hpop study live`"
        for session in answers.sessions
        if session.ended and session.person.id not in recorded
    ]


BEGINNING, MOST_READ = 2**20, 2**26

"""Number of bytes that are searched for an id: at the beginning of a file of answers, and of any other file."""
TABLES = (*CSV, SQLITE, REMARKS, *tasks.TABLES)


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
    """Yield the files of a participant: their names begin with the id, or they are answers with the id in the text."""
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
    """Rewrite a report from the answers, or only remove it without answers; return a note, "" if rewritten."""
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
