"""Files of a study: strict JSON with schema and version, tables, locks on the folder, and the record of a report.

The system releases a lock when its holder ends, however it ends; nothing is left behind.
"""

from __future__ import annotations

import csv
import io
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from math import isnan
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from hpop.base.arguments import checked_arguments
from hpop.base.files import read_regular, replacing
from hpop.base.text import printable, shown
from hpop.errors import StudyError
from hpop.frontier.strict_json import parse, pieces
from hpop.problems.front import Front

MOST_FAULTS = 3
"""Faults of a file that are told one by one."""


class Part(BaseModel):
    """An object of a file: its keys and no others, each of its type."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


T = TypeVar("T", bound=Part)


def read(path: str | os.PathLike[str], kind: type[T], what: str, most: int) -> T:
    """Return the contents of a file of at most ``most`` bytes, checked; ``what`` it is to be, in words."""
    return checked(path, parsed(path, read_bytes(path, most), what), kind, what)


def read_bytes(path: str | os.PathLike[str], most: int) -> bytes:
    """Return the bytes of a regular file, at most ``most``."""
    try:
        return read_regular(path, most)
    except OSError as error:
        raise StudyError(f"cannot read {path}: {error.strerror or error}") from None


def parsed(place: object, data: bytes, what: str) -> Any:
    """Parse JSON without checking its schema; ``place`` is named in the error."""
    try:
        return parse(data)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{place}: expected {what} as JSON, found {printable(error):.200}") from None


def checked(place: object, values: Any, kind: type[T], what: str) -> T:
    """Return values as an object of a kind; ``place`` is named in the error: a file, or an event of it."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise StudyError(f"{place}: expected {what}, found {in_words(error)}") from None


def in_words(error: ValidationError) -> str:
    """Return the first faults that pydantic found, and how many more there are."""
    faults = error.errors(include_url=False, include_context=False)
    said = "; ".join(_said(dict(fault)) for fault in faults[:MOST_FAULTS])
    return said + (f"; and {len(faults) - MOST_FAULTS:,} more" if len(faults) > MOST_FAULTS else "")


def write(path: str | os.PathLike[str], values: Any) -> None:
    """Write a JSON file, whole or not at all."""
    write_bytes(path, ("".join(pieces(values)) + "\n").encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file, whole or not at all; StudyError where that cannot be."""
    try:
        with replacing(Path(path)) as file:
            file.write(data)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror or error}") from None


def _said(fault: dict[str, Any]) -> str:
    """Return a fault that pydantic found: where, what was expected, what came."""
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{printable(part)}" for part in fault["loc"])
    came = "" if fault["type"] == "missing" else f", got {shown(fault['input'], 40)}"
    return f"at {where.lstrip('.') or 'the top'}: {fault['msg']}{came}"


try:
    import fcntl
except ImportError:  # no such locks on this system: only one program may be at work on a study
    fcntl = None  # type: ignore[assignment]


@contextmanager
def changing(folder: Path) -> Iterator[None]:
    """Change what is in a study's folder alone, after who does so already; not to be nested."""
    held = hold(folder, wait=True)
    try:
        yield
    finally:
        release(held)


def serve_alone(folder: Path) -> int | None:
    """Hold a folder for the one server of its answers, until :func:`release`; StudyError where another server does."""
    try:
        return hold(folder, wait=False)
    except BlockingIOError:
        raise StudyError(
            f"{folder.parent} is served already, by another `hpop study serve`: two would take answers from each "
            "other; use the addresses that it printed, or end it with Ctrl-C first"
        ) from None


def release(held: int | None) -> None:
    """Let go of a lock."""
    if held is not None:
        os.close(held)


def hold(folder: Path, *, wait: bool) -> int | None:
    """Return a folder, open and locked, for :func:`release`; None on systems without such locks.

    BlockingIOError where somebody else holds it and there is no waiting, StudyError where it cannot be locked.
    """
    if fcntl is None:
        return None
    held = None
    try:
        held = os.open(folder, os.O_RDONLY)
        fcntl.flock(held, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        release(held)
        if isinstance(error, BlockingIOError):
            raise
        raise StudyError(
            f"cannot lock {folder}: {error.strerror or error}; put the study on a disk of this machine"
        ) from None
    return held


FORMULA = "=+-@\t\r\n＝＋－＠"
"""What a cell begins with that a spreadsheet takes for a formula."""


class Column(NamedTuple):
    """A column: its name, and its type in SQLite."""

    name: str
    kind: str


class Contents(NamedTuple):
    """A table's columns and rows."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]


def csv_bytes(table: Contents) -> bytes:
    r"""Return a table as CSV: UTF-8, commas, points, a heading; nothing where there is no value.

    Text that a spreadsheet would run as a formula begins with an apostrophe.

    >>> csv_bytes(Contents([Column("a", "TEXT"), Column("b", "REAL")], [("=1+1", 0.5), ("x", None), ("\n=1", 2)]))
    b'a,b\n\'=1+1,0.5\nx,\n"\'\n=1",2\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def sqlite_bytes(tables: Mapping[str, Contents]) -> bytes:
    """Return tables as a file of SQLite."""
    with sqlite3.connect(":memory:") as base:
        for name, table in tables.items():
            columns = ", ".join(f'"{column.name}" {column.kind}' for column in table.columns)
            base.execute(f'CREATE TABLE "{name}" ({columns})')
            gaps = ", ".join("?" * len(table.columns))
            base.executemany(f'INSERT INTO "{name}" VALUES ({gaps})', _without_nan(table.rows))
        base.commit()
        data = base.serialize()
    base.close()
    return data


def _cell(value: Any) -> Any:
    if value is None or (isinstance(value, float) and isnan(value)):
        return ""
    return f"'{value}" if isinstance(value, str) and value[:1] and value[0] in FORMULA else value


def _without_nan(rows: Iterable[Sequence[Any]]) -> list[list[Any]]:
    return [[None if isinstance(value, float) and isnan(value) else value for value in row] for row in rows]


@checked_arguments
def front_digest(front: Front) -> str:
    """Return SHA-256 of a front: its criteria, costs and trajectories, and the problem without the places of its files.

    The same before and after the front is saved, loaded and moved; another where a cost, a state or the map differs.
    """
    criteria = list(zip(front.names, front.units, front.quanta.tolist(), strict=True))
    digest = sha256(json.dumps([criteria, front.question], sort_keys=True).encode())
    digest.update(front.integers.astype("<i8").tobytes())
    for trajectory in front.trajectories:
        states = trajectory.states
        digest.update(json.dumps([list(trajectory.kinds), list(states.names)]).encode())
        for name in states.names:
            digest.update(np.asarray(getattr(states, name), dtype="<f8").tobytes())
    return digest.hexdigest()


REPORT = "report.json"
REPORT_SCHEMA, REPORT_VERSION = "hpop-study-report", 1
MOST_REPORT = 100_000
REPORT_NAME = r"^[a-z][a-z_-]{0,60}\.(html|csv|png|py)$"


class ReportFile(Part):
    """What report.json holds."""

    schema_: Annotated[Literal["hpop-study-report"], Field(alias="schema")]
    version: Literal[1]
    score: Annotated[list[str], Field(min_length=2, max_length=2)]
    method: Literal["default", "paper"]
    correction: Literal["holm", "bonferroni", "none"]
    mark: Annotated[str, StringConstraints(max_length=200)]
    files: Annotated[list[Annotated[str, StringConstraints(pattern=REPORT_NAME)]], Field(max_length=100)]


def read_report(folder: Path) -> ReportFile:
    """Read the record of the report in a folder; raise StudyError for a file that is none."""
    return read(folder / REPORT, ReportFile, "what a report was made of", MOST_REPORT)


def write_report(folder: Path, score: tuple[str, str], how: dict[str, str], mark: str, files: Iterable[str]) -> None:
    """Write down what the report in a folder is made of, and its files."""
    known = {
        "schema": REPORT_SCHEMA,
        "version": REPORT_VERSION,
        "score": list(score),
        **how,
        "mark": mark,
        "files": list(files),
    }
    write(folder / REPORT, known)


def remove_report(folder: Path) -> None:
    """Remove the files of the report that was made in a folder, if one was; StudyError where they cannot be."""
    if not (folder / REPORT).exists():
        return
    try:
        for name in read_report(folder).files:
            (folder / name).unlink(missing_ok=True)
        (folder / REPORT).unlink()
    except OSError as error:
        raise StudyError(f"cannot remove the report in {folder}: {error.strerror or error}") from None
