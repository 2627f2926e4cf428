"""Visits of a tour's stops as a front records them, for tables, pages and exports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.options import LEAST
from hpop.goals import Tour
from hpop.motions import HOLD
from hpop.problems.front import Front
from hpop.trajectories.trajectory import Trajectory


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

    A planned standstill may be longer than the executed one, in which the robot also stops and starts. The visit begins
    as long after the beginning of the one as of the other, and lasts as long.

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
