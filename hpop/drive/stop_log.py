"""Stops of a tour in the event log of a drive: those that were visited, passed over, or skipped on request."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hpop.drive.moment import DriveProgress
from hpop.drive.storage import EventLog
from hpop.errors import DriveError
from hpop.planners.needs import people_move, refuse_speeds

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

NOTED = ("visited", "passed over")
"""Events of the log that follow from others; a drive that is repeated notes them again."""


def refuse_among_people(problem: Problem) -> None:
    """Raise QueryError for a robot with several speeds among people who move."""
    if people_move(problem):
        refuse_speeds(problem, "a drive among moving people")


class StopLog(EventLog):
    """Event log of a drive that may have a tour."""

    _progress: DriveProgress

    def skip(self, stop: str, now: float | None = None) -> tuple[str, ...]:
        """Skip a stop of the tour, given by name; return the names of the stops that remain.

        The robot keeps its plan until an option is taken; the next options leave the stop out. Raises DriveError if the
        stop is unknown, or was visited, passed over or skipped before. Then the drive does not change.

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
