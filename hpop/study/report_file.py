"""report.json: what a report was made of, beside it, so that it can be made again, or removed as a whole."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from hpop.errors import StudyError
from hpop.study import documents

FILE = "report.json"
SCHEMA, VERSION = "hpop-study-report", 1
MOST_BYTES = 100_000
FILE_NAME = r"^[a-z][a-z_-]{0,60}\.(html|csv|png|py)$"


class ReportFile(documents.Part):
    """What report.json holds."""

    schema_: Annotated[Literal["hpop-study-report"], Field(alias="schema")]
    version: Literal[1]
    score: Annotated[list[str], Field(min_length=2, max_length=2)]
    method: Literal["default", "paper"]
    correction: Literal["holm", "bonferroni", "none"]
    mark: Annotated[str, StringConstraints(max_length=200)]
    files: Annotated[list[Annotated[str, StringConstraints(pattern=FILE_NAME)]], Field(max_length=100)]


def read(folder: Path) -> ReportFile:
    """What the report in a folder was made of; StudyError where the file is none."""
    return documents.read(folder / FILE, ReportFile, "what a report was made of", MOST_BYTES)


def write(folder: Path, score: tuple[str, str], how: dict[str, str], mark: str, files: Iterable[str]) -> None:
    """Write down what the report in a folder is made of, and its files."""
    known = {"schema": SCHEMA, "version": VERSION, "score": list(score), **how, "mark": mark, "files": list(files)}
    documents.write(folder / FILE, known)


def remove(folder: Path) -> None:
    """Remove the files of the report that was made in a folder, if one was; StudyError where they cannot be."""
    if not (folder / FILE).exists():
        return
    try:
        for name in read(folder).files:
            (folder / name).unlink(missing_ok=True)
        (folder / FILE).unlink()
    except OSError as error:
        raise StudyError(f"cannot remove the report in {folder}: {error.strerror or error}") from None
