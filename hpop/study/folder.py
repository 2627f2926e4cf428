"""A study's folder: made whole or not at all, and emptied of whoever withdraws."""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from hpop.errors import HpopError, StudyError
from hpop.front import Front
from hpop.problem import Problem
from hpop.status import ProgressCallback
from hpop.study.answers import CSV, REMARKS, SQLITE, Answers
from hpop.study.answers import FOLDER as ANSWERS
from hpop.study.conditions import VIEW, Baseline
from hpop.study.design import Design
from hpop.study.design_file import FRONT
from hpop.study.documents import read_bytes, write_bytes
from hpop.study.identity import front_digest
from hpop.study.page import rides_of, session_page
from hpop.study.stimuli import save_stimuli
from hpop.study.words import FOLDER as WORDS
from hpop.study.words import MOST_BYTES as MOST_WORDS
from hpop.trajectory import Trajectory

PAGES, STIMULI, REPORT = "pages", "stimuli", "report"
BEGINNING = 2**20
PRIVATE = 0o700
"""A study's folder is its owner's alone: it holds what people answer about how they feel."""


class Withdrawal(NamedTuple):
    """What was removed of a participant.

    removed    files, as they are called in the study's folder
    successor  who has the place
    notes      what is still to be done
    """

    removed: tuple[str, ...]
    successor: str
    notes: tuple[str, ...]


def prepare(
    design: Design,
    front: Front,
    folder: str | os.PathLike[str],
    *,
    baselines: Sequence[Baseline] = (),
    words: str | os.PathLike[str] | None = None,
    progress: ProgressCallback | bool | None = None,
) -> Path:
    """Write all that a study needs into a folder of its own, whole or not at all.

    design.json, schedule.csv, front.json (a copy, so that nothing depends on where the front came from), stimuli/ and a
    page for each participant in pages/. Only the folder's owner may look into it.

    Parameters
    ----------
    baselines : those of the design, with their trajectories
    words : texts of the pages in the design's language, where hpop brings none: a translation of its ``en.json``
    progress : for videos, as for :func:`hpop.view.save_video`

    Raises StudyError where the folder is in use, the front is not the design's, or texts are missing; OutputError where
    a stimulus cannot be written.
    """
    target = Path(folder)
    check_unused(target)
    if front_digest(front) != design.front_sha256:
        raise StudyError("this is not the front that the design was made of; make the design of this one")
    problem = Problem.from_description(front.problem or {})
    with _whole(target) as made:
        if words is not None:
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
            baselines=_ridden(design, baselines),
            language=design.language,
            study=made,
            progress=progress,
        )
        write_pages(design, made, [person.id for person in design.enrolled])
    return target


def _ridden(design: Design, baselines: Sequence[Baseline]) -> dict[str, Trajectory]:
    """The trajectories of a design's baselines, by letter; StudyError where one is not given."""
    known = {baseline.name: baseline.trajectory for baseline in baselines}
    wanted = {one.name: one.id for one in design.conditions if one.row is None and one.kind != VIEW}
    if known.keys() != wanted.keys():
        raise StudyError(
            f"the design's baselines are {', '.join(wanted) or 'none'}, got {', '.join(known) or 'none'}; give "
            "prepare those that Design.of was given"
        )
    return {wanted[name]: trajectory for name, trajectory in known.items()}


def check_unused(folder: Path) -> None:
    """StudyError where a study cannot be begun in a folder: something is in it, or it is no folder."""
    try:
        in_use = folder.is_symlink() or (folder.exists() and (not folder.is_dir() or any(folder.iterdir())))
    except (OSError, ValueError) as error:
        raise StudyError(f"cannot use {folder}: {error}") from None
    if in_use:
        raise StudyError(f"{folder} is in use: a study begins in a folder that is new or empty; choose another")


def write_pages(design: Design, folder: Path, participants: list[str]) -> None:
    """Write the pages of some participants, who share what they see."""
    (folder / PAGES).mkdir(exist_ok=True)
    rides = rides_of(design.public(participants[0]), folder)
    for participant in participants:
        page = session_page(design.public(participant), folder, rides=rides)
        write_bytes(folder / PAGES / f"{participant}.html", page.encode())


def front_of(folder: str | os.PathLike[str], design: Design) -> Front:
    """The front of a study, as it was when the study began; StudyError where it is not."""
    path = Path(folder) / FRONT
    try:
        front = Front.load(path)
    except (OSError, ValueError, LookupError) as error:
        raise StudyError(f"the study's front cannot be read: {error}; put {path} back") from None
    if front_digest(front) != design.front_sha256:
        raise StudyError(
            f"{path} has changed since the study began: its rows are not those that people see; put the file back"
        )
    return front


def replace(folder: str | os.PathLike[str], participant: str) -> str:
    """Who takes the place of a participant who dropped out: the next id, with the same order, and a page of its own.

    What the participant answered stays. Raises StudyError where nobody of this id is expected.
    """
    target = Path(folder)
    after = Design.load(target).after(participant, withdrawn=False)
    return _followed(after, target, participant)


def withdraw(folder: str | os.PathLike[str], participant: str) -> Withdrawal:
    """Delete all that is known of a participant, and make the tables again without it; the next id takes the place.

    Every file in the folder that is called after the participant, or that holds the participant's answers, is removed:
    answers, page, preference. What a report shows is not: a note says so. It may be called again after a crash.
    """
    target = Path(folder)
    design = Design.load(target)
    if participant not in design.withdrawn:
        design = design.after(participant, withdrawn=True)
    successor = _followed(design, target, participant)
    removed = sorted(_files_of(target, participant))
    for path in removed:
        path.unlink(missing_ok=True)
    notes = _tables_again(target, design)
    if (target / REPORT).exists():
        notes.append(
            f"{target / REPORT} was made with the answers of {participant}: `hpop study report` makes it again"
        )
    return Withdrawal(tuple(str(path.relative_to(target)) for path in removed), successor, tuple(notes))


def _followed(design: Design, folder: Path, participant: str) -> str:
    """Save who left, and write the page of the successor."""
    successor = next(one.successor for one in design.left if one.participant == participant)
    design.save(folder)
    if (folder / STIMULI).is_dir() and successor not in {one.participant for one in design.left}:
        write_pages(design, folder, [successor])
    return successor


def _files_of(folder: Path, participant: str) -> Iterator[Path]:
    """Files that are called after a participant, hidden ones of a writer that was killed too, or hold its answers."""
    called = re.compile(rf"\.?{participant}(?![0-9])")
    says = re.compile(rf'"participant"\s*:\s*"{participant}"'.encode())
    for path in folder.rglob("*"):
        if path.is_file() and not path.is_symlink():
            in_answers = path.parent == folder / ANSWERS
            if called.match(path.name) or (in_answers and says.search(_beginning(path))):
                yield path


def _beginning(path: Path) -> bytes:
    """As much of a file as says whose answers it holds."""
    with path.open("rb") as file:
        return file.read(BEGINNING)


def _tables_again(folder: Path, design: Design) -> list[str]:
    """Make tables that are there again; remove them where other answers cannot be read, and say so."""
    tables = [folder / name for name in (*CSV, SQLITE, REMARKS)]
    if not any(path.exists() for path in tables):
        return []
    try:
        Answers.load(folder, design).save_tables(folder)
    except StudyError as error:
        for path in tables:
            path.unlink(missing_ok=True)
        return [f"the tables were removed, and cannot be made again before this is mended: {error}"]
    return []


@contextmanager
def _whole(target: Path) -> Iterator[Path]:
    """A folder to write into, which takes the place of ``target`` at the end, and is removed after any error."""
    made = target.with_name(f".{target.name}.{uuid.uuid4().hex}.tmp")
    try:
        made.parent.mkdir(parents=True, exist_ok=True)
        made.mkdir(PRIVATE)
        yield made
        made.rename(target)
    except HpopError:
        raise
    except OSError as error:
        raise StudyError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(made, ignore_errors=True)
