"""Folder of a study: created completely or not at all, and checked for faults."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.errors import HpopError, StudyError
from hpop.problems.front import Front
from hpop.problems.problem import Problem
from hpop.runtime.status import ProgressCallback
from hpop.study.answers import FOLDER as ANSWERS
from hpop.study.answers import Answers, read_sessions
from hpop.study.conditions import VIEW, Baseline
from hpop.study.design import Design
from hpop.study.design_file import FRONT
from hpop.study.documents import front_digest, hold, read_bytes, release, write_bytes
from hpop.study.page import rides_of, session_page
from hpop.study.stimuli import save_stimuli
from hpop.study.words import FOLDER as WORDS
from hpop.study.words import MOST_BYTES as MOST_WORDS
from hpop.study.words import checked_file
from hpop.trajectories.trajectory import Trajectory

PAGES, STIMULI, REPORT = "pages", "stimuli", "report"
KEPT = (ANSWERS, PAGES, STIMULI, WORDS)
"""Folders that hold only the study's own files, where no report may be written."""
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
    wanted = {one.name: one.id for one in design.conditions if one.row is None and one.kind != VIEW}
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

    Raises StudyError if the folder has no valid design, or too many files of answers.
    """
    target = Path(folder)
    design = Design.load(target)
    faults = []
    try:
        front_of(target, design)
    except StudyError as error:
        faults.append(str(error))
    needed = [condition.stimulus for condition in design.conditions]
    needed += [f"{PAGES}/{person.id}.html" for person in design.expected]
    faults += [f"{target / name} is missing" for name in needed if not (target / name).is_file()]
    sessions, refused = read_sessions(target, design)
    answers = Answers(design, tuple(sessions))
    return Checked((*faults, *refused, *answers.faults), (*design.notes, *answers.notes))
