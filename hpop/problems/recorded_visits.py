"""Visits of a tour's stops as a front records them, for tables, pages and exports."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hpop.goals import Tour
from hpop.problems.front import Front


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


def stop_visits(front: Front, row: int, *, executed: bool = False) -> list[StopVisit]:
    """Return the visits of a row in order of time, at planned times or at those of the execution.

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
    passed = trajectory.model.execution(trajectory)[1]  # s, at which the execution passes the planned states
    times = np.interp([(visit.begin, visit.end) for visit in visits] or np.zeros((0, 2)), trajectory.times, passed)
    return [visit._replace(begin=begin, end=end) for visit, (begin, end) in zip(visits, times.tolist(), strict=True)]


def visit_order(front: Front, row: int) -> str:
    """Return the numbers of the stops in the order in which a row visits them, such as "2 1 3"; "-" if none."""
    return " ".join(str(visit.number) for visit in stop_visits(front, row)) or "-"
