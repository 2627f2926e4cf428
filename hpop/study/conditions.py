"""What participants are shown, under letters that tell nothing of it."""

from __future__ import annotations

import string
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hpop.base.text import printable
from hpop.errors import StudyError
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows
from hpop.study.orders import MOST_STIMULI
from hpop.trajectories.trajectory import Trajectory

VIEW = "view"
"""What stands for a row: the still view from the start, the baseline."""
KINDS = ("ride", "video")
ENDINGS = {"ride": "html", "video": "mp4", VIEW: "html"}
ALIKE = 0.1
"""Share by which stimuli may differ in duration without a note."""


class Baseline(NamedTuple):
    """A trajectory that is shown beside rows of the front, such as what a common planner makes; no front holds it.

    name        what it is, for the researcher
    trajectory  the ride
    costs       by criterion, such as ``problem.evaluate(trajectory)``
    """

    name: str
    trajectory: Trajectory
    costs: Mapping[str, float]


@dataclass(frozen=True)
class Condition:
    """What a participant is shown under a letter.

    id        "A", "B", ...: dealt at random, so that it tells nothing of the row
    row       of the front; None for the still view and for baselines
    name      what the row was asked for as, such as "knee"; "" of a number
    kind      "ride", "video" or "view"
    costs     by criterion; none of the still view
    duration  s, executed
    """

    id: str
    row: int | None
    name: str
    kind: str
    costs: Mapping[str, float]
    duration: float

    @property
    def stimulus(self) -> str:
        """Its file in the study's folder."""
        return f"stimuli/{self.id}.{ENDINGS[self.kind]}"

    def __str__(self) -> str:
        if self.row is None:
            return "the still view" if self.kind == VIEW else f"{printable(self.name)} (baseline)"
        return f"{printable(self.name)} (row {self.row})" if self.name else f"row {self.row}"


def lettered(
    front: Front,
    rows: Sequence[int | str | NamedRow],
    kind: str,
    rng: np.random.Generator,
    baselines: Sequence[Baseline] = (),
) -> tuple[Condition, ...]:
    """Rows, the still view where it is among them, and baselines under letters dealt at random; in their order."""
    found = [_named(front, row) for row in rows if row != VIEW]
    count = len(found) + (VIEW in rows) + len(baselines)
    if list(rows).count(VIEW) > 1:
        raise StudyError("the still view is named more than once: show it once")
    if not found or not 2 <= count <= MOST_STIMULI:
        raise StudyError(
            f"a study shows 2 to {MOST_STIMULI} stimuli, at least one of them a row of the front, got {count}"
        )
    _check_different(found)
    lasts = [row.point.trajectory.execution().duration for row in found]
    letters = iter(rng.permutation(list(string.ascii_uppercase[:count])).tolist())
    made = [
        Condition(next(letters), row.number, row.name, kind, dict(row.point.costs), lasts[i])
        for i, row in enumerate(found)
    ]
    for beside in baselines:
        lasts.append(beside.trajectory.execution().duration)
        made.append(Condition(next(letters), None, beside.name, kind, dict(beside.costs), lasts[-1]))
    if VIEW in rows:
        made.append(Condition(next(letters), None, VIEW, VIEW, {}, float(np.mean(lasts))))
    return tuple(sorted(made, key=lambda condition: condition.id))


def _named(front: Front, row: int | str | NamedRow) -> NamedRow:
    """A row, with the name by which it was asked for."""
    (found,) = named_rows(front, [row.number if isinstance(row, NamedRow) else row])
    return NamedRow(found.point, row.name if isinstance(row, NamedRow) else found.name)


def _check_different(rows: Sequence[NamedRow]) -> None:
    """StudyError where two names stand for the same row."""
    first: dict[int, NamedRow] = {}
    for row in rows:
        if row.number in first:
            same = first[row.number]
            raise StudyError(f"{same} and {row} are the same trajectory: show each once, and name another row instead")
        first[row.number] = row


def unlike(conditions: Sequence[Condition]) -> str:
    """What is said where stimuli differ much in duration; nothing where they do not."""
    first, *_, last = sorted(conditions, key=lambda condition: condition.duration)
    if last.duration <= (1 + ALIKE) * first.duration:
        return ""
    return (
        f"stimuli last {first.duration:.1f} s ({first}) to {last.duration:.1f} s ({last}): longer exposure makes "
        "sicker by itself"
    )
