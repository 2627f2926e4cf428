"""Rows of a front by number or by a name such as "knee" or "least turns", and the visits of a tour's stops in a row."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import LEAST
from hpop.base.text import is_whole, printable, python_value, shown
from hpop.errors import OptionError, UnknownName, did_you_mean
from hpop.goals import Tour
from hpop.motions import HOLD
from hpop.problems.front import Front, Point
from hpop.trajectories.trajectory import Trajectory

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


class StopVisit(NamedTuple):
    """Visit of a stop by a trajectory.

    number      of the stop, from 1, in the order in which the tour lists the stops
    name        of the stop
    begin, end  s from the start; equal for a stop without dwell
    """

    number: int
    name: str
    begin: float
    end: float


def stop_names(front: Front) -> tuple[str, ...]:
    """Return the names of the stops of a front's tour; () without a tour."""
    tour = (front.problem or {}).get("tour")
    return () if tour is None else Tour.of(tour).names


def stop_numbers(front: Front) -> dict[str, int]:
    """Return the number of each stop of a front's tour, from 1, by its name; {} without a tour."""
    return {name: number for number, name in enumerate(stop_names(front), 1)}


def stop_visits(front: Front, row: int, *, executed: bool = False, passed: FloatArray | None = None) -> list[StopVisit]:
    """Return the visits of a row in order of time, at planned times or at those of the execution.

    ``passed`` (n+1,), s, are the times at which the execution passes the planned states, if they are known.

    The list is empty without a tour, and for visits that are not recorded in the form that hpop writes.
    """
    numbers = stop_numbers(front)
    recorded = front.provenance[row].get("visits") if numbers else None
    try:
        visits = [
            StopVisit(numbers[str(visit["stop"])], str(visit["stop"]), float(visit["begin"]), float(visit["end"]))
            for visit in recorded or ()
        ]
    except (TypeError, KeyError, ValueError):
        return []
    trajectory = front.trajectories[row]
    if not executed or not len(trajectory):
        return visits
    passed = trajectory.model.execution(trajectory)[1] if passed is None else passed
    times = (executed_times(visit.begin, visit.end, trajectory, passed) for visit in visits)
    return [visit._replace(begin=begin, end=end) for visit, (begin, end) in zip(visits, times, strict=True)]


def executed_times(begin: float, end: float, trajectory: Trajectory, passed: FloatArray) -> tuple[float, float]:
    """Return begin and end, s, of a visit in the execution of a trajectory, given those in its plan.

    During a planned standstill, the visit keeps its delay after the beginning of the standstill, and its duration. The
    executed standstill may be shorter, because the robot also brakes and starts; the visit ends with it at the latest.
    Outside of standstills, times are interpolated.

    passed  (n+1,)  s, times at which the execution passes the planned states
    """
    kinds, times = trajectory.kinds, trajectory.times
    first = last = int(np.searchsorted(times, begin + LEAST, side="right")) - 1
    if begin == end or not 0 <= first < len(kinds) or kinds[first] != HOLD.kind:
        return float(np.interp(begin, times, passed)), float(np.interp(end, times, passed))
    while first > 0 and kinds[first - 1] == HOLD.kind:
        first -= 1
    while last < len(kinds) and kinds[last] == HOLD.kind:
        last += 1
    executed = float(passed[first] + begin - times[first])
    return executed, min(executed + end - begin, float(passed[last]))


def visit_order(front: Front, row: int) -> str:
    """Return the numbers of the stops in the order in which a row visits them, such as "2 1 3"; "-" if none."""
    return " ".join(str(visit.number) for visit in stop_visits(front, row)) or "-"
