"""Look-up of rows of a front by number, or by a name such as "knee" or "least turns"."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from hpop.base.scalars import is_whole, python_value
from hpop.base.text import printable, shown
from hpop.errors import OptionError, UnknownName, did_you_mean
from hpop.problems.front import Front, Point

NO_LETTERS = re.compile(r"[\W_]+")
NUMBER = re.compile(r"\d{1,18}")
MOST_LETTERS = 40  # largest number of characters of a row's name in the name of a file


@dataclass(frozen=True)
class NamedRow:
    """Row of a front, with the name by which a user requested it: "knee", "least turns", or "" if by its number."""

    point: Point
    name: str

    @property
    def number(self) -> int:
        """Row number in the front, counted from 0."""
        return self.point.index

    def __str__(self) -> str:
        return f"{printable(self.name)} (row {self.number})" if self.name else f"row {self.number}"

    @property
    def stem(self) -> str:
        """Stem for names of files about the row, of letters, digits and underscores: ``knee_70`` or ``row_3``."""
        letters = NO_LETTERS.sub("_", self.name).strip("_")[:MOST_LETTERS]
        return f"{letters or 'row'}_{self.number}"


def named_rows(front: Front, asked: Sequence[int | str]) -> tuple[NamedRow, ...]:
    """Return the rows of a front that a user requests, in this order and without repetitions.

    Parameters
    ----------
    asked : numbers of rows, counted from 0; "knee"; or "least NAME" or NAME, for the row with the smallest cost in the
        criterion NAME

    Raises OptionError for a front without rows or a number out of range, and UnknownName for other names.
    """
    if isinstance(asked, str) or not isinstance(asked, Iterable):
        raise OptionError(f"rows must be a list of numbers and names, such as ['knee', 3], got {shown(asked)}")
    if not len(front):
        raise OptionError(
            "rows can only be taken from a front with trajectories, but the front has no trajectories; its search "
            f"ended with {shown(front.status)}"
        )
    names = front.named()
    rows: dict[int, NamedRow] = {}
    for request in asked:
        row = _number(front, request)
        if row is not None:
            rows.setdefault(row, NamedRow(front[row], ""))
        else:
            name = name_meant(names, request)
            point = names[name]
            rows.setdefault(point.index, NamedRow(point, name))
    return tuple(rows.values())


def _number(front: Front, request: object) -> int | None:
    """Return the row that a request names by number, also as text; None for a request by name.

    Raises OptionError for a number out of range.
    """
    if isinstance(request, str) and NUMBER.fullmatch(request.strip()) and request.strip() not in front.names:
        request = int(request)
    if isinstance(request, str):
        return None
    row = int(python_value(request)) if is_whole(request) else -1
    if not 0 <= row < len(front):
        last = len(front) - 1
        kind = f"the front has rows 0 to {last:,}" if last else "the front has row 0 alone"
        raise OptionError(f"no row {shown(request)}: {kind}; `hpop show` lists them")
    return row


def name_meant(names: Iterable[str], request: object) -> str:
    """Return the full name of a point ("least turns") for a user's request, which may be the criterion alone ("turns").

    names  names of all points

    Raises UnknownName for other requests.
    """
    choices = list(names)
    meant = str(request).strip()
    for name in choices:
        if name in (meant, f"least {meant}", f"{meant} of those found", f"least {meant} of those found"):
            return name
    raise UnknownName(
        f"no row is called {shown(meant)}.{did_you_mean(meant, choices)} Give a row number, or one of "
        f"{', '.join(map(printable, choices))}"
    )
