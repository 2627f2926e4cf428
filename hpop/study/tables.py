"""Answers as tables: CSV for a spreadsheet, SQLite for queries; each file appears whole or not at all."""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from math import isnan
from typing import Any, NamedTuple

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
    r"""A table as CSV: UTF-8, commas, points, a heading; nothing where there is no value.

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
    """Tables as a file of SQLite."""
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
