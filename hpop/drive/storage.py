"""What a drive is told and what changes make of it, as a record and as a file."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from shapely.geometry import mapping

from hpop.base.files import read_regular, replacing
from hpop.base.options import MOST, real
from hpop.base.text import shown
from hpop.drive.closings import polygon_of
from hpop.drive.plan import SAME
from hpop.errors import DriveError
from hpop.frontier import strict_json
from hpop.frontier.storage import checked_path
from hpop.frontier.strict_json import parse, pieces, plain
from hpop.planners.base import Planner
from hpop.problems.front import found_from_file, seen_from_file
from hpop.trajectories.motion_table import MotionTable
from hpop.world import Person
from hpop.world.content.people import described_person

if TYPE_CHECKING:
    from hpop.drive.execution import Execution

SCHEMA, VERSION = "hpop-drive", 1
SIZE_LIMIT = 512 * 1024**2  # bytes
LEFT_OUT = ("checkpoint",)  # of a planner's options: a file of another search
KEYS = {"schema", "version", "problem", "planner", "begin", "patience", "notice", "ways", "events"}


def write(drive: Execution, path: str | os.PathLike[str]) -> None:
    """Write a drive to a JSON file, whole or not at all; raises OSError where it cannot be written."""
    stored = {
        "schema": SCHEMA,
        "version": VERSION,
        "problem": seen_from_file(path, plain(drive.problem.describe())),
        "planner": _described(drive.planner),
        "begin": drive.begin,
        "patience": drive.patience,
        "notice": drive.notice,
        "ways": MotionTable.of([drive.choice, *drive.ways]).describe(),  # the plan that was chosen is the first
        "events": drive.record,
    }
    with replacing(checked_path(path)) as file:
        for piece in pieces(stored):
            file.write(piece.encode(errors="backslashreplace"))


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """What :func:`write` wrote, with the problem's files as they are found from the folder of this one.

    Raises DriveError for a file that is none of a drive, OSError for one that cannot be read.
    """
    source = checked_path(path)
    try:
        stored = parse(read_regular(source, SIZE_LIMIT))
    except (ValueError, RecursionError) as error:
        raise DriveError(f"{source}: expected the JSON of a drive, found {error!s:.200}; save it again") from None
    if not isinstance(stored, dict) or stored.get("schema") != SCHEMA or set(stored) != KEYS:
        raise DriveError(f"{source}: expected a drive, as drive.save writes it, found something else")
    if stored["version"] != VERSION:
        raise DriveError(f"{source}: expected version {VERSION} of a drive, found {shown(stored['version'])}")
    if not isinstance(stored["problem"], dict):
        raise DriveError(f"{source}: expected the problem of a drive, found {shown(stored['problem'])}")
    return {**stored, "problem": found_from_file(source, stored["problem"])}


def _described(planner: Planner) -> dict[str, dict[str, Any]]:
    """A planner as JSON, from which :func:`hpop.planners.base.make_planner` makes it again."""
    known = [field for field in fields(planner) if field.name not in LEFT_OUT]  # type: ignore[arg-type]
    given = {field.name: getattr(planner, field.name) for field in known}
    changed = {field.name: given[field.name] for field in known if given[field.name] != field.default}
    return {planner.name: plain(changed)}


class Telling:
    """The record of what was told from a beginning on.

    begin   s, when the robot leaves
    record  what was told, as JSON
    """

    def __init__(self, begin: float) -> None:
        """Begin, with nothing told."""
        self.begin = real("begin", begin, -MOST, MOST, "a time in s", error=DriveError)
        self.record: list[dict[str, Any]] = []
        self._last = -np.inf  # s, when it was last told anything

    def _time(self, now: float) -> float:
        return float(real("now", now, -MOST, MOST, "a time in s", error=DriveError))

    def _in_order(self, now: float) -> float:
        """A time at which something is told or asked; DriveError where something was told later."""
        now = self._time(now)
        if now < self._last - SAME:
            raise DriveError(f"it was {self._last:.3f} s already, now it is {now:.3f} s: tell events in order of time")
        return max(now, self._last)

    def _told(self, now: float) -> float:
        """The same, and that it is told now."""
        self._last = self._in_order(now)
        return self._last

    def _now(self) -> float:
        """When it was last told anything, s."""
        return max(self._last, self.begin)

    def _note(self, event: str, now: float, **what: Any) -> None:
        """Write into the record."""
        told = json.dumps({"event": event, "now": now, **what}, allow_nan=False, default=strict_json.of_numpy)
        self.record.append(json.loads(told))


def deadline_of(seconds: float) -> float:
    """A deadline, s; DriveError for what is none."""
    return float(real("deadline", seconds, 0, MOST, "a time in s", error=DriveError))


@dataclass(frozen=True)
class Change:
    """What a change of the world makes of a drive.

    now         s, of the drive
    safe_until  s, of the drive, until when the present plan may be driven; None for all the way
    stops_at    s, of the drive, when the robot stands if nothing else is taken; None where it arrives
    brakes      whether it cannot come to where it might take another way
    invalid     of the last options, by number, those that are closed now, or whose beginning is not driven to any more
    notes       what was made of that: people within obstacles, predictions that were cut, whom the robot touches
    """

    now: float
    safe_until: float | None
    stops_at: float | None
    brakes: bool
    invalid: tuple[int, ...]
    notes: tuple[str, ...] = ()


def written(
    close: Any,
    open_: Any,
    people: Iterable[Person] | None,
    groups: Iterable[Iterable[int]],
    stop: Any,
    name: str,
) -> dict[str, Any]:
    """What a change was told by, as JSON."""
    if close is not None or open_ is not None:
        area = open_ if close is None else close
        return {"area": area if isinstance(area, str) else mapping(polygon_of(area, "an area")), "name": name}
    if people is not None:
        return {"people": [described_person(person) for person in people], "groups": [list(group) for group in groups]}
    return {"person": stop.name if isinstance(stop, Person) else stop}
