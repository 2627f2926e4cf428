"""What is wrong with a study's folder, and what to know of it, all at once."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.errors import StudyError
from hpop.study.answers import Answers, read_sessions
from hpop.study.design import Design
from hpop.study.folder import PAGES, front_of


class Checked(NamedTuple):
    """What a check found.

    faults  that want doing something: files that cannot be read, half sessions, missing items
    notes   that are no faults: who is still to come, stimuli of unequal duration
    """

    faults: tuple[str, ...]
    notes: tuple[str, ...]


@checked_arguments
def check(folder: str | os.PathLike[str]) -> Checked:
    """Look at the front, stimuli, pages and answers of a study; StudyError where there is no design to go by."""
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
