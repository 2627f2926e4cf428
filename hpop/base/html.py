"""What a notebook shows of a value: a table, and a picture where something that can draw is imported.

The core imports no plotting: :mod:`hpop.view` puts into ``PICTURES`` what it can draw.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from hpop.base.text import printable

PICTURES: dict[type, Callable[[Any], bytes | None]] = {}
"""By type what makes a small picture (PNG) of a value, or None where there is nothing to draw."""


def table_html(headings: Sequence[str], rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """A table; all text is escaped.

    >>> table_html(["a<b"], [["1"]])
    '<table><thead><tr><th>a&lt;b</th></tr></thead><tbody><tr><td>1</td></tr></tbody></table>'
    """
    head = "".join(f"<th>{_text(heading)}</th>" for heading in headings)
    body = "".join(f"<tr>{''.join(f'<td>{_text(cell)}</td>' for cell in row)}</tr>" for row in rows)
    said = f"<caption>{_text(caption)}</caption>" if caption else ""
    return f"<table>{said}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def facts_html(facts: Sequence[tuple[str, str]]) -> str:
    """A table of two columns: what, and what it is."""
    left = "style='text-align:left'"  # notebooks put cells to the right, as numbers
    rows = (f"<tr><th {left}>{_text(name)}</th><td {left}>{_text(value)}</td></tr>" for name, value in facts)
    return f"<table><tbody>{''.join(rows)}</tbody></table>"


def picture_html(value: Any) -> str:
    """A picture of a value, if what draws its type is imported; else how to get one."""
    draw = next((PICTURES[cls] for cls in type(value).__mro__ if cls in PICTURES), None)
    if draw is None:
        return "<p><small><code>import hpop.view</code> adds a picture.</small></p>"
    png = draw(value)
    alt = f"Picture of a {type(value).__name__}"
    return f'<img alt="{alt}" src="data:image/png;base64,{base64.b64encode(png).decode()}">' if png else ""


def _text(text: str) -> str:
    return escape(printable(text))
