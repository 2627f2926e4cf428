"""Tables: columns of numbers with their units, and HTML tables for notebooks."""

from __future__ import annotations

import base64
import csv
import io
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

from hpop.base.arrays import FloatArray
from hpop.base.files import replacing
from hpop.base.lazy import library
from hpop.base.text import printable, shown
from hpop.errors import OptionError, OutputError, UnknownName, did_you_mean

if TYPE_CHECKING:
    import pandas

PICTURES: dict[type, Callable[[Any], bytes | None]] = {}
"""By type: function that draws a value as a small PNG picture, or returns None if there is nothing to draw."""


def table_html(headings: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """Return an HTML table; all text is escaped.

    >>> table_html(["a<b"], [["1"]])
    '<table><thead><tr><th>a&lt;b</th></tr></thead><tbody><tr><td>1</td></tr></tbody></table>'
    """
    head = "".join(f"<th>{_escaped(heading)}</th>" for heading in headings)
    body = "".join(f"<tr>{''.join(f'<td>{_escaped(cell)}</td>' for cell in row)}</tr>" for row in rows)
    caption_html = f"<caption>{_escaped(caption)}</caption>" if caption else ""
    return f"<table>{caption_html}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def facts_html(facts: Sequence[tuple[str, str]]) -> str:
    """Return an HTML table of two columns, names and values; all text is escaped."""
    left = "style='text-align:left'"  # notebooks align cells to the right, as numbers
    rows = (f"<tr><th {left}>{_escaped(name)}</th><td {left}>{_escaped(value)}</td></tr>" for name, value in facts)
    return f"<table><tbody>{''.join(rows)}</tbody></table>"


def picture_html(value: Any) -> str:
    """Return HTML with a picture of a value; if no imported module can draw its type, return a hint to import one."""
    draw = next((PICTURES[cls] for cls in type(value).__mro__ if cls in PICTURES), None)
    if draw is None:
        return "<p><small><code>import hpop.view</code> adds a picture.</small></p>"
    png = draw(value)
    alt = f"Picture of a {type(value).__name__}"
    return f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(png).decode()}">' if png else ""


def _escaped(text: str) -> str:
    """Return a text with its HTML and control characters escaped."""
    return escape(printable(text))


MOST_SHOWN = 8  # largest number of rows of a table in a notebook


@dataclass(frozen=True, eq=False, repr=False)
class Table:
    """Table of numbers: columns (N,) by name, and their units by name ("1" for no unit).

    >>> import numpy as np
    >>> table = Table({"t": np.array([0.0, 0.1]), "x": np.array([2.0, 2.5])}, {"t": "s", "x": "m"})
    >>> table, table["x"].tolist()
    (<Table: 2 rows of t (s), x (m)>, [2.0, 2.5])
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def __getitem__(self, name: str) -> FloatArray:
        """Return a column (N,) by its name; raise UnknownName for an unknown name."""
        try:
            return self.columns[name]
        except (KeyError, TypeError):
            raise UnknownName(
                f"the table has no column {shown(name)}.{did_you_mean(name, self.columns)} "
                f"Its columns: {', '.join(self.columns)}"
            ) from None

    def __repr__(self) -> str:
        return f"<Table: {len(self):,} rows of {', '.join(self.headings)}>"

    @property
    def headings(self) -> list[str]:
        """Name and unit of each column: "x (m)"."""
        return [name if (unit := self.units[name]) == "1" else f"{name} ({unit})" for name in self.columns]

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write a CSV file: headings such as "x (m)", then one line for each row. It is complete or not written at all.

        Numbers are written so that equal float64 are read back. Raises OutputError if the file cannot be written.
        """
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(map(printable, self.headings))
        writer.writerows(zip(*(column.tolist() for column in self.columns.values()), strict=True))
        try:
            with replacing(path) as file:
                file.write(text.getvalue().encode())
        except TypeError:
            raise OptionError(f"path must be the path of a file to write, got {shown(path)}") from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise OutputError(f"cannot write {shown(os.fspath(path))}: {reason}; choose another file") from None

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the columns as a pandas table, with their units in ``attrs``; needs the extra ``tables``."""
        frame = library("pandas", "to_dataframe()").DataFrame(dict(self.columns))
        frame.attrs["units"] = dict(self.units)
        return frame

    def _repr_html_(self) -> str:
        columns = list(self.columns.values())
        rows = [[f"{column[row]:.6g}" for column in columns] for row in range(min(len(self), MOST_SHOWN))]
        return table_html(self.headings, rows, f"{len(self):,} rows")
