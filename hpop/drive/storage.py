"""The event log of a drive with the stops of its tour, the file of a drive, and the effect of a change of the world.

Stops in the log are those that were visited, passed over, or skipped on request.
"""

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
from hpop.drive.moment import DriveProgress
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
    from hpop.problems.problem import Problem

SCHEMA, VERSION = "hpop-drive", 1
SIZE_LIMIT = 512 * 1024**2  # bytes
LEFT_OUT = ("checkpoint",)  # options of a planner that are not stored, such as the file of another search
KEYS = {"schema", "version", "problem", "planner", "begin", "patience", "notice", "ways", "events"}


def write(drive: Execution, path: str | os.PathLike[str]) -> None:
    """Write a drive to a JSON file, completely or not at all; OSError if it cannot be written."""
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
    """Read a file of :func:`write`, and return its JSON object.

    Paths of map files, which it stores relative to its folder, become absolute.
    Raises DriveError for any other file, OSError if it cannot be read.
    """
    source = checked_path(path)
    try:
        stored = parse(read_regular(source, SIZE_LIMIT))
    except (ValueError, RecursionError) as error:
        raise DriveError(f"{source}: expected the JSON of a drive, found {error!s:.200}; save it again") from None
    if not isinstance(stored, dict) or stored.get("schema") != SCHEMA or set(stored) != KEYS:
        raise DriveError(f"{source}: expected a drive, found something else; name a file that drive.save wrote")
    if stored["version"] != VERSION:
        raise DriveError(
            f"{source}: expected version {VERSION} of a drive, found {shown(stored['version'])}; load it with the hpop "
            "that wrote it"
        )
    if not isinstance(stored["problem"], dict):
        raise DriveError(f"{source}: expected the problem of a drive, found {shown(stored['problem'])}")
    return {**stored, "problem": found_from_file(source, stored["problem"])}


def _described(planner: Planner) -> dict[str, dict[str, Any]]:
    """Return a planner as JSON, from which :func:`hpop.planners.base.make_planner` builds it again."""
    stored = [field for field in fields(planner) if field.name not in LEFT_OUT]  # type: ignore[arg-type]
    options = {field.name: getattr(planner, field.name) for field in stored}
    changed = {field.name: options[field.name] for field in stored if options[field.name] != field.default}
    return {planner.name: plain(changed)}


class EventLog:
    """Log of the events of a drive.

    begin   s, time at which the robot leaves
    record  the events so far, as JSON
    """

    def __init__(self, begin: float) -> None:
        """Create an empty log of a drive that leaves at time ``begin``, s, on the clock of the caller."""
        self.begin = real("begin", begin, -MOST, MOST, "a time in s", error=DriveError)
        self.record: list[dict[str, Any]] = []
        self._last = -np.inf  # s, of the last event

    def _time(self, now: float) -> float:
        return float(real("now", now, -MOST, MOST, "a time in s", error=DriveError))

    def _in_order(self, now: float) -> float:
        """Return ``now``, s, the time of an event; DriveError if it is earlier than the last event."""
        now = self._time(now)
        if now < self._last - SAME:
            raise DriveError(
                f"the last event was at {self._last:.3f} s, this one is at {now:.3f} s: give events in order of time"
            )
        return max(now, self._last)

    def _told(self, now: float) -> float:
        """Return the time ``now``, s, checked by :meth:`_in_order`, and store it as that of the last event."""
        self._last = self._in_order(now)
        return self._last

    def _now(self) -> float:
        """Return the time of the last event, s; before the first one, the time at which the robot leaves."""
        return max(self._last, self.begin)

    def _note(self, event: str, now: float, **values: Any) -> None:
        """Append an event to the record, with its values as JSON."""
        line = json.dumps({"event": event, "now": now, **values}, allow_nan=False, default=strict_json.of_numpy)
        self.record.append(json.loads(line))


DEADLINE, TOUR_DEADLINE = 0.2, 2.0
"""Default deadline for options, s: without a tour, and along a tour, whose graph has a copy for each set of stops."""


def deadline_of(seconds: float | None, problem: Problem) -> float:
    """Return a checked deadline, s, or the default for None; DriveError for an invalid one."""
    if seconds is None:
        return DEADLINE if problem.tour is None else TOUR_DEADLINE
    return float(real("deadline", seconds, 0, MOST, "a time in s", error=DriveError))


@dataclass(frozen=True)
class Change:
    """Effect of a change of the world on a drive.

    Times are in s on the clock of the caller, as ``now`` in the methods of the drive.

    now         time of the change
    safe_until  time until which the present plan is free; None if it is free to its end
    stops_at    time at which the robot comes to rest if it takes no option; None if it arrives at the goal
    brakes      whether the robot must brake before it reaches a place where it may change its plan
    invalid     indices of options of the last call of ``options`` that are now closed, or that the plan no longer
                reaches
    notes       warnings to print: people within obstacles, predictions that were cut, people in contact with the robot
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
    """Return the arguments of a change of the world (`Execution.world`) as JSON for the event log.

    One of ``close``, ``open_``, ``people`` and ``stop`` is given, the others are None.
    """
    if close is not None or open_ is not None:
        area = open_ if close is None else close
        return {"area": area if isinstance(area, str) else mapping(polygon_of(area, "an area")), "name": name}
    if people is not None:
        return {"people": [described_person(person) for person in people], "groups": [list(group) for group in groups]}
    return {"person": stop.name if isinstance(stop, Person) else stop}


NOTED = ("visited", "passed over")
"""Events of the log that follow from others; a drive that is repeated notes them again."""


class StopLog(EventLog):
    """Event log of a drive that may have a tour."""

    _progress: DriveProgress

    def skip(self, stop: str, now: float | None = None) -> tuple[str, ...]:
        """Skip a stop of the tour, given by name; return the names of the stops that remain.

        The robot keeps its plan until an option is taken; the next options leave the stop out. Raises DriveError if
        there is no tour, or the stop is unknown, or was visited, passed over or skipped before. Then the drive does
        not change.

        now  s; by default the time of the last event
        """
        now = self._in_order(self._now() if now is None else now)
        stops = self._progress.moment(now).stops
        if stops is None:
            raise DriveError("the problem of this drive has no tour, so there is no stop to skip")
        without = stops.without(stop)
        self._note_visits(self._told(now))
        self._note("skip", now, stop=stop)
        self._progress.tour = without
        return without.remaining

    def _note_visits(self, now: float) -> None:
        """Append to the record the visits since the last event, and the optional stops that were passed over."""
        before, stops = self._progress.tour, self._progress.moment(now).stops
        if before is None or stops is None:
            return
        for visit in stops.visits[len(before.visits) :]:
            self._note("visited", now, stop=visit.name, begin=visit.begin, end=visit.end)
        for name in stops.passed_over[len(before.passed_over) :]:
            self._note("passed over", now, stop=name)
        self._progress.tour = stops
