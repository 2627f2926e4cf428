"""Files of a study: strict JSON with schema and version, tables, locks on the folder, reports, and texts of pages.

The operating system releases a lock when its process ends, however it ends; nothing is left behind. Texts of the
participant's pages are JSON files, one for each language, so that a new language needs no code.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from hashlib import sha256
from importlib import resources
from math import isnan
from pathlib import Path
from string import Formatter
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
"""Largest number of faults in a file that an error lists."""


class StrictObject(BaseModel):
    """JSON object of a file with fixed keys of fixed types."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


T = TypeVar("T", bound=StrictObject)


def read(path: str | os.PathLike[str], kind: type[T], what: str, most: int) -> T:
    """Read a JSON file of at most ``most`` bytes and check it against a schema; ``what`` describes it in errors."""
    return validated(path, parse_json(path, read_bytes(path, most), what), kind, what)


def read_bytes(path: str | os.PathLike[str], most: int) -> bytes:
    """Return the bytes of a regular file; StudyError if it cannot be read or has more than ``most`` bytes."""
    try:
        return read_regular(path, most)
    except OSError as error:
        raise StudyError(f"cannot read {path}: {error.strerror or error}") from None


def parse_json(place: object, data: bytes, what: str) -> Any:
    """Parse JSON without checking its schema; ``place`` (a file or an event) and ``what`` are named in the error."""
    try:
        return parse(data)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{place}: expected {what} as JSON, found {printable(error):.200}") from None


def validated(place: object, values: Any, kind: type[T], what: str) -> T:
    """Check values against a schema, and return an instance of it; ``place`` and ``what`` are named in the error."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise StudyError(f"{place}: expected {what}, found {in_words(error)}") from None


def in_words(error: ValidationError) -> str:
    """Describe the first few faults that pydantic found, and say how many more there are."""
    faults = error.errors(include_url=False, include_context=False)
    said = "; ".join(_said(dict(fault)) for fault in faults[:MOST_FAULTS])
    return said + (f"; and {len(faults) - MOST_FAULTS:,} more" if len(faults) > MOST_FAULTS else "")


def write(path: str | os.PathLike[str], values: Any) -> None:
    """Write a JSON file, completely or not at all."""
    write_bytes(path, ("".join(pieces(values)) + "\n").encode())


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file, completely or not at all; StudyError if it cannot be written."""
    try:
        with replacing(Path(path)) as file:
            file.write(data)
    except OSError as error:
        raise StudyError(f"cannot write {path}: {error.strerror or error}") from None


def _said(fault: dict[str, Any]) -> str:
    """Describe one fault that pydantic found: its position, the expected value and the actual value."""
    where = "".join(f"[{part}]" if isinstance(part, int) else f".{printable(part)}" for part in fault["loc"])
    came = "" if fault["type"] == "missing" else f", got {shown(fault['input'], 40)}"
    return f"at {where.lstrip('.') or 'the top'}: {fault['msg']}{came}"


try:
    import fcntl
except ImportError:  # no locks on this system: only one program may work on a study
    fcntl = None  # type: ignore[assignment]


@contextmanager
def locked_for_changes(folder: Path) -> Iterator[None]:
    """Lock a study's folder while the ``with`` block changes it, after waiting for other programs.

    These locks must not be nested.
    """
    held = hold(folder, wait=True)
    try:
        yield
    finally:
        release(held)


def serve_alone(folder: Path) -> int | None:
    """Lock the folder of answers for one server, and return the lock for :func:`release`, as :func:`hold` does.

    Raises StudyError if another server has the lock.
    """
    try:
        return hold(folder, wait=False)
    except BlockingIOError:
        raise StudyError(
            f"{folder.parent} is served already, by another `hpop study serve`, and two servers would conflict; use "
            "the addresses that it printed, or end it with Ctrl-C first"
        ) from None


def release(held: int | None) -> None:
    """Release a lock that `hold` or `serve_alone` returned; None is ignored."""
    if held is not None:
        os.close(held)


def hold(folder: Path, *, wait: bool) -> int | None:
    """Lock a folder and return its file descriptor, for :func:`release`; None on systems without such locks.

    Raises BlockingIOError if another program has the lock and ``wait`` is False, StudyError if it cannot be locked.
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
"""First characters by which a spreadsheet takes a cell for a formula."""


class TableColumn(NamedTuple):
    """Column of a table: its name, and its type in SQLite."""

    name: str
    kind: str


class Contents(NamedTuple):
    """Table to be written: its columns and its rows."""

    columns: Sequence[TableColumn]
    rows: Sequence[Sequence[Any]]


def csv_bytes(table: Contents) -> bytes:
    r"""Return a table as CSV: UTF-8, commas, decimal points, a line of headings; missing values are empty.

    Text that a spreadsheet would run as a formula begins with an apostrophe.

    >>> columns = [TableColumn("a", "TEXT"), TableColumn("b", "REAL")]
    >>> csv_bytes(Contents(columns, [("=1+1", 0.5), ("x", None), ("\n=1", 2)]))
    b'a,b\n\'=1+1,0.5\nx,\n"\'\n=1",2\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    writer.writerows([_cell(value) for value in row] for row in table.rows)
    return text.getvalue().encode()


def sqlite_bytes(tables: Mapping[str, Contents]) -> bytes:
    """Return tables as the bytes of an SQLite file."""
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
    """Return a value as a cell of a CSV file: "" if missing, and text that looks like a formula with an apostrophe."""
    if value is None or (isinstance(value, float) and isnan(value)):
        return ""
    return f"'{value}" if isinstance(value, str) and value[:1] and value[0] in FORMULA else value


def _without_nan(rows: Iterable[Sequence[Any]]) -> list[list[Any]]:
    """Return rows with None in place of NaN."""
    return [[None if isinstance(value, float) and isnan(value) else value for value in row] for row in rows]


@checked_arguments
def front_digest(front: Front) -> str:
    """Return the SHA-256 of a front: of its criteria, costs, trajectories, and its problem without paths of files.

    It does not change when the front is saved, loaded or moved, and changes with any cost, state or the map.
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


class ReportFile(StrictObject):
    """Schema of report.json, which records how a report was made."""

    schema_: Annotated[Literal["hpop-study-report"], Field(alias="schema")]
    version: Literal[1]
    score: Annotated[list[str], Field(min_length=2, max_length=2)]
    method: Literal["default", "paper", "mixed"]
    correction: Literal["holm", "bonferroni", "none"]
    mark: Annotated[str, StringConstraints(max_length=200)]
    files: Annotated[list[Annotated[str, StringConstraints(pattern=REPORT_NAME)]], Field(max_length=100)]


def read_report(folder: Path) -> ReportFile:
    """Read report.json in the folder of a report; StudyError if the file is missing or invalid."""
    return read(folder / REPORT, ReportFile, "the record of a report", MOST_REPORT)


def write_report(folder: Path, score: tuple[str, str], how: dict[str, str], mark: str, files: Iterable[str]) -> None:
    """Write report.json: how a report was made, and which files it has."""
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
    """Remove all files of the report in a folder, if there is one; StudyError if they cannot be removed."""
    if not (folder / REPORT).exists():
        return
    try:
        for name in read_report(folder).files:
            (folder / name).unlink(missing_ok=True)
        (folder / REPORT).unlink()
    except OSError as error:
        raise StudyError(
            f"cannot remove the report in {folder}: {error.strerror or error}; allow writing to this folder"
        ) from None


ANSWERS, PAGES, STIMULI = "answers", "pages", "stimuli"
WORDS = "words"
"""Folder in a study for texts in languages that hpop does not have."""
KEPT = (ANSWERS, PAGES, STIMULI, WORDS)
"""Folders that hold only the study's own files, where no report may be written."""
REPORTS = "report"
MOST_WORDS = 200_000
LANGUAGE = re.compile(r"[a-z]{2,3}(-[A-Z]{2})?")
Words = dict[str, str]


def words(language: str, study: Path | None = None) -> Words:
    """Return the texts of the participants' pages in a language, by name.

    They are read from the study's ``words/LANGUAGE.json``, or from hpop's own file. A file must have exactly the texts
    of hpop's ``en.json``, with equal ``{names}`` in them. Raises StudyError for a language without texts, and for an
    incomplete file, with all faults at once.

    >>> words("en")["stop"]
    'Stop'
    """
    shipped = resources.files("hpop.study").joinpath("words")
    english = _english()
    if not LANGUAGE.fullmatch(language):
        raise StudyError(f"language must be a code such as 'en', 'de' or 'pt-BR', got {shown(language)}")
    name = f"{language}.json"
    own = None if study is None else study / WORDS / name
    if own is not None and own.is_file():
        return checked_file(own)
    if not shipped.joinpath(name).is_file():
        raise StudyError(
            f"hpop has no texts in {shown(language)}: translate its hpop/study/words/en.json, and give "
            f"the file to `hpop study init --words`, which keeps it as {WORDS}/{name}"
        )
    return _checked_texts(_read(shipped.joinpath(name).read_bytes(), name), english, name)


def checked_file(path: str | os.PathLike[str]) -> Words:
    """Read a file of texts; StudyError if it cannot be read or is incomplete."""
    try:
        return _checked_texts(_read(read_regular(path, MOST_WORDS), str(path)), _english(), str(path))
    except OSError as error:
        raise StudyError(
            f"cannot read {path}: {error.strerror or error}; give a translation of hpop/study/words/en.json"
        ) from None


def _english() -> Words:
    """Return the English texts, which every language must have."""
    return _read(resources.files("hpop.study").joinpath("words", "en.json").read_bytes(), "en.json")


def _read(data: bytes, file: str) -> Words:
    """Parse texts from JSON; StudyError unless they are an object of texts."""
    try:
        read = parse(data)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{file}: expected texts as JSON: {error}") from None
    if not isinstance(read, dict) or not all(isinstance(text, str) for text in read.values()):
        raise StudyError(f'{file}: expected an object of texts, such as {{"stop": "Stop"}}')
    return read


def _checked_texts(texts: Words, english: Words, file: str) -> Words:
    """Return texts if they are complete; StudyError, with all faults, if they differ in names or placeholders."""
    lacking, others = sorted(english.keys() - texts.keys()), sorted(texts.keys() - english.keys())
    said = [f"lacks the texts {', '.join(lacking)}"] if lacking else []
    said += [f"has {shown(', '.join(others))}, which no page uses"] if others else []
    said += [
        f"{name} must have the placeholders of the English text, {english[name]!r}"
        for name, text in texts.items()
        if name in english and _placeholders(text) != _placeholders(english[name])
    ]
    if said:
        raise StudyError(f"{file} {'; '.join(said)}; translate each text of hpop's en.json, no others")
    return texts


def _placeholders(text: str) -> set[str] | None:
    """Return the names between braces; None if braces do not match."""
    try:
        return {field for _, field, _, _ in Formatter().parse(text) if field is not None}
    except ValueError:
        return None
