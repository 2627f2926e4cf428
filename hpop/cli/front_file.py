"""A front that `hpop plan` saved, read for a command, and the problem that it answers."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from hpop.cli import results
from hpop.cli.results import SAVED
from hpop.errors import UnknownName

if TYPE_CHECKING:
    from hpop.problems.front import Front
    from hpop.problems.problem import Problem


def loaded(folder: Path) -> tuple[Path, Front]:
    """The file of a front, and the front in it."""
    from hpop.problems.front import Front

    path = folder / SAVED if os.path.isdir(folder) else folder
    with results.output_errors(f"cannot read {path}", "give the folder that `hpop plan` wrote"):
        return path, Front.load(path)


def problem_of(path: Path, front: Front) -> Problem:
    """The problem that a saved front answers."""
    from hpop.problems.problem import Problem

    try:
        return Problem.from_description(front.problem or {})
    except UnknownName as error:
        raise UnknownName(f"{path} was planned with a criterion that is not known here: {error}") from None
