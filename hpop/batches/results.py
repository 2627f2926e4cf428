"""Results of a batch: a folder with Parquet files, one row per trajectory, and a journal file with the newest rows.

Each finished case is one line of the journal, written to the disk before the case counts as done. When the
journal is large, and at the end, its lines become a further Parquet file. A killed batch loses only the cases
that were being solved.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from hpop.base.arguments import checked_arguments
from hpop.base.files import replacing
from hpop.base.lazy import library
from hpop.base.text import shown
from hpop.batches.cases import Case
from hpop.errors import OutputError

if TYPE_CHECKING:
    import pandas
    import pyarrow

FOLDER, JOURNAL, PATTERN = "results", "unwritten.jsonl", "part-*.parquet"
LARGEST = 16_000_000  # size of the journal, in bytes, at which it becomes a Parquet file
MOST_LINES = 2_000  # number of cases at which it becomes a Parquet file
COST = "cost_"
COLUMNS = {
    "case": "int64",
    "id": "string",
    "problem": "string",
    "planner": "string",
    "status": "string",
    "error": "string",
    "row": "int64",
    "points": "int64",
    "seconds": "float64",
    "processor_seconds": "float64",
    "labels": "int64",
    "memory": "int64",
    "seed": "int64",
    "certificate": "string",
    "provenance": "string",
    "trajectory": "string",
    "versions": "string",
}
"""First columns of every data set; the varied keys and the costs (``cost_NAME``) follow."""


def _parquet() -> Any:
    return library("pyarrow.parquet", "a batch")


class Writer:
    """Writer of the rows of finished cases to the folder of a batch.

    done  identifiers of the cases that already have rows
    """

    def __init__(self, folder: Path, *, again: bool = False) -> None:
        """Open a folder, which is created if missing.

        ``again`` removes rows with errors, so that these cases are solved again.
        """
        self._folder, self._parts = folder, folder / FOLDER
        self._journal = folder / JOURNAL
        self.done: set[str] = set()
        self._bytes = self._lines = 0
        _parquet()
        try:
            self._parts.mkdir(parents=True, exist_ok=True)
            if again:
                self._drop_errors()
            self.done |= identifiers(folder)
            kept = [line for line in _journal_lines(self._journal) if line["id"] not in self.done]
            if again:
                kept = [line for line in kept if line["rows"][0]["error"] is None]
            with replacing(self._journal) as file:
                file.writelines(_encode_line(line) for line in kept)
            self.done.update(line["id"] for line in kept)
            self._lines, self._bytes = len(kept), self._journal.stat().st_size
            self._file = self._journal.open("ab")
        except OSError as error:
            raise _write_error(folder, error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        if kind is None or not issubclass(kind, OutputError):
            self._flush()
            with suppress(OSError):
                self._journal.unlink()

    def write(self, case: Case, rows: Sequence[Mapping[str, Any]]) -> None:
        """Write the rows of a case; they are on the disk when this method returns."""
        values = {key: _number_or_text(value) for key, value in case.values.items() if key != "planner"}
        common = {"case": case.number, "id": case.id, "problem": case.problem, "planner": case.planner}
        line = _encode_line({"id": case.id, "values": values, "rows": [{**common, **row} for row in rows]})
        try:
            self._file.write(line)
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _write_error(self._folder, error) from None
        self.done.add(case.id)
        self._lines, self._bytes = self._lines + 1, self._bytes + len(line)
        if self._lines >= MOST_LINES or self._bytes >= LARGEST:
            self._flush()
            self._file.truncate(0)
            self._lines = self._bytes = 0

    def _flush(self) -> None:
        """Write the lines of the journal to a further Parquet file."""
        lines = list(_journal_lines(self._journal))
        if not lines:
            return
        taken = [int(part.stem.partition("-")[2]) for part in parts_of(self._folder)]
        path = self._parts / f"part-{max(taken, default=-1) + 1:06d}.parquet"
        try:
            with replacing(path) as file:
                _parquet().write_table(_table(lines), file, compression="zstd")
        except OSError as error:
            raise _write_error(self._folder, error) from None

    def _drop_errors(self) -> None:
        """Remove rows with errors from all Parquet files."""
        compute = library("pyarrow.compute", "a batch")
        for part in parts_of(self._folder):
            table = _parquet().read_table(part)
            kept = table.filter(compute.is_null(table["error"]))
            if len(kept) < len(table):
                with replacing(part) as file:
                    _parquet().write_table(kept, file, compression="zstd")


def parts_of(folder: Path) -> list[Path]:
    """Return the Parquet files in a batch's folder, oldest first."""
    return sorted((folder / FOLDER).glob(PATTERN))


def identifiers(folder: Path) -> set[str]:
    """Return the identifiers of all cases in the Parquet files of a batch's folder."""
    tables = (_parquet().read_table(part, columns=["id"]) for part in parts_of(folder))
    return {each for table in tables for each in table["id"].to_pylist()}


def _write_error(folder: Path, error: OSError) -> OutputError:
    """Return the error for a folder that cannot be written to."""
    return OutputError(f"cannot write to {folder}: {error.strerror or error}; choose another folder for the results")


def _encode_line(line: Mapping[str, Any]) -> bytes:
    """Return a line of the journal as bytes."""
    return json.dumps(line).encode() + b"\n"


def _journal_lines(journal: Path) -> Iterator[dict[str, Any]]:
    """Yield the complete lines of a journal; a last line that was cut when the process was killed is left out."""
    try:
        with journal.open("rb") as file:
            for line in file:
                if line.endswith(b"\n"):
                    yield json.loads(line)
    except FileNotFoundError:
        return


def _number_or_text(value: Any) -> Any:
    """Return a varied value as a number or as text, which a column can hold."""
    if isinstance(value, bool | None | list | dict):
        return json.dumps(value)
    return value if isinstance(value, int | float) else str(value)


def _table(lines: Sequence[Mapping[str, Any]]) -> pyarrow.Table:
    """Convert lines of the journal to a table of their rows."""
    arrow = library("pyarrow", "a batch")
    types = {key: getattr(arrow, kind)() for key, kind in COLUMNS.items()}
    units: dict[str, str] = {}
    rows: list[dict[str, Any]] = []
    for line in lines:
        for row in line["rows"]:
            costs = {f"{COST}{name}": value for name, value in row.get("costs", {}).items()}
            units.update({f"{COST}{name}": unit for name, unit in row.get("units", {}).items()})
            types.update(dict.fromkeys(costs, arrow.float64()))
            rows.append({**line["values"], **costs, **{key: row[key] for key in COLUMNS if key in row}})
    varied = dict.fromkeys(key for line in lines for key in line["values"] if key not in types)
    for key in varied:
        cells = [line["values"].get(key) for line in lines]
        numbers = all(isinstance(cell, int | float | None) for cell in cells)
        types[key] = arrow.float64() if numbers else arrow.string()
        if not numbers:
            for row in rows:
                if row.get(key) is not None:
                    row[key] = str(row[key])
    fields = [
        arrow.field(key, kind, metadata={"unit": units[key]} if key in units else None) for key, kind in types.items()
    ]
    return arrow.Table.from_pylist(rows, schema=arrow.schema(fields))


def _with_text_columns(table: pyarrow.Table, names: set[str]) -> pyarrow.Table:
    """Return a table with the named columns converted to text."""
    arrow = library("pyarrow", "a batch")
    fields = [field.with_type(arrow.string()) if field.name in names else field for field in table.schema]
    return table.cast(arrow.schema(fields))


@checked_arguments
class Results:
    """Results of a batch, which are read from its folder.

    >>> Results("nowhere")
    Traceback (most recent call last):
    hpop.errors.OutputError: nowhere holds no results of a batch; `hpop batch SPEC --out nowhere` writes them
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        if not (self.folder / FOLDER).is_dir():
            raise OutputError(
                f"{self.folder} holds no results of a batch; `hpop batch SPEC --out {self.folder}` writes them"
            )

    def __repr__(self) -> str:
        return f"<Results of a batch in {shown(str(self.folder))}>"

    def tables(self, columns: Sequence[str] | None = None) -> Iterator[pyarrow.Table]:
        """Yield the table of each Parquet file in turn, which needs little memory, then that of the journal.

        ``columns`` limits each table to these columns, as far as it has them.
        """
        for part in parts_of(self.folder):
            file = _parquet().ParquetFile(part)
            names = None if columns is None else [name for name in columns if name in file.schema_arrow.names]
            yield file.read(columns=names)
        lines = list(_journal_lines(self.folder / JOURNAL))
        if lines:  # if a process was killed while writing a Parquet file, its lines are in both files
            written = identifiers(self.folder)
            table = _table([line for line in lines if line["id"] not in written])
            yield table if columns is None else table.select([name for name in columns if name in table.column_names])

    def table(self, columns: Sequence[str] | None = None) -> pyarrow.Table:
        """Return all rows in one table, ordered by case and row, with all columns or only some.

        A column that holds numbers in one file and text in another becomes text.
        """
        arrow = library("pyarrow", "a batch")
        keys = ["case", "id", "row"]  # numbers of cases change as the specification grows
        wanted = None if columns is None else list(dict.fromkeys((*columns, *keys)))
        tables = list(self.tables(wanted))
        if not tables:
            return arrow.table({name: [] for name in columns or COLUMNS})
        text = {field.name for table in tables for field in table.schema if arrow.types.is_string(field.type)}
        joined = arrow.concat_tables(
            [_with_text_columns(table, text) for table in tables], promote_options="permissive"
        )
        joined = joined.sort_by([(key, "ascending") for key in keys])
        return joined if columns is None else joined.select(columns)

    def frame(self, columns: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return all rows as a pandas DataFrame."""
        library("pandas", "a data frame")
        frame: pandas.DataFrame = self.table(columns).to_pandas()
        return frame
