"""Rows of a front as a person asks for them: by their numbers, or by a name such as "knee" or "least turns"."""

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
MOST_LETTERS = 40  # of a name in the name of a file


@dataclass(frozen=True)
class NamedRow:
    """A row of a front, and what it was asked for as: "knee", "least turns", or "" of a number."""

    point: Point
    name: str

    @property
    def number(self) -> int:
        """Its number in the front, counted from 0."""
        return self.point.index

    def __str__(self) -> str:
        return f"{printable(self.name)} (row {self.number})" if self.name else f"row {self.number}"

    @property
    def stem(self) -> str:
        """What files of it are called: letters, digits and underscores, such as ``knee_70`` or ``row_3``."""
        letters = NO_LETTERS.sub("_", self.name).strip("_")[:MOST_LETTERS]
        return f"{letters or 'row'}_{self.number}"


def named_rows(front: Front, asked: Sequence[int | str]) -> tuple[NamedRow, ...]:
    """The rows that are asked for, each once, in that order.

    Parameters
    ----------
    asked : numbers, counted from 0; "knee"; "least NAME" or the NAME of a criterion, for the least in that

    Raises OptionError for a front without rows and for a number that is none of its rows, UnknownName for other names.
    """
    if isinstance(asked, str) or not isinstance(asked, Iterable):
        raise OptionError(f"rows is a list of numbers and names, such as ['knee', 3], got {shown(asked)}")
    if not len(front):
        raise OptionError(f"the front has no trajectories; its search ended with {shown(front.status)}")
    names = front.named()
    found: dict[int, NamedRow] = {}
    for one in asked:
        row = _number(front, one)
        if row is not None:
            found.setdefault(row, NamedRow(front[row], ""))
        else:
            name = name_meant(names, one)
            point = names[name]
            found.setdefault(point.index, NamedRow(point, name))
    return tuple(found.values())


def _number(front: Front, one: object) -> int | None:
    """The row of a number, also where that is text; None for a name."""
    if isinstance(one, str) and NUMBER.fullmatch(one.strip()) and one.strip() not in front.names:
        one = int(one)
    if isinstance(one, str):
        return None
    row = int(python_value(one)) if is_whole(one) else -1
    if not 0 <= row < len(front):
        last = len(front) - 1
        kind = f"the front has rows 0 to {last:,}" if last else "the front has row 0 alone"
        raise OptionError(f"no row {shown(one)}: {kind}; `hpop show` lists them")
    return row


def name_meant(names: Iterable[str], one: object) -> str:
    """The name of a point that is meant: as it is, or a criterion's; UnknownName where there is none."""
    several = list(names)
    meant = str(one).strip()
    for known in several:
        if known in (meant, f"least {meant}", f"{meant} of those found", f"least {meant} of those found"):
            return known
    raise UnknownName(
        f"no row is called {shown(meant)}.{did_you_mean(meant, several)} Rows are numbers, or one of "
        f"{', '.join(map(printable, several))}"
    )
