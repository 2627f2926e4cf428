"""Offers of a live session: the ways that a viewer may take, and plans, as messages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from hpop.base.text import printable
from hpop.drive.options import Options
from hpop.errors import CriterionError
from hpop.live.cards import Ways, cards, described, line_of
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory

HORIZON = 8.0
"""Time, s, up to which people are predicted, if the scenario says nothing else."""


@dataclass(frozen=True, eq=False)
class Offer:
    """Ways that a viewer may take.

    ways     the ways, and their front
    time     s, time of the session at which they begin
    place    (x, y) where they begin, m
    status, certificate, gap  what is claimed of them
    before   the plan up to there, from its beginning; None if the robot stands
    problem  of a new destination; None for ways of the present drive
    options  of the present drive; None for a new destination
    """

    ways: Ways
    time: float
    place: tuple[float, float]
    status: str
    certificate: str
    gap: float
    before: Trajectory | None = None
    problem: Problem | None = None
    options: Options | None = None

    def message(self, now: float, preference: Any) -> dict[str, Any]:
        """Return the message "options"."""
        return {
            "type": "options",
            "asked": now,
            "commit": {"t": self.time, "x": self.place[0], "y": self.place[1]},
            "cards": cards(self.ways, preference),
            "all": described(self.ways),
            "present": self.ways.present,
            "certificate": printable(self.certificate),
            "status": self.status,
            "gap": self.gap if math.isfinite(self.gap) else None,
        }


def plan_message(trajectory: Trajectory, now: float, elapsed: float, *, arrives: bool = True) -> dict[str, Any]:
    """Return a plan for the robot; ``elapsed`` is the time of the plan, s, at the time ``now`` of the session."""
    told = {"now": now, "elapsed": elapsed, "arrives": arrives}
    return {"type": "plan", **told, "trajectory": trajectory.describe(), "line": line_of(trajectory)}


def bare_problem(problem: Problem) -> Problem:
    """Return a problem without tour and, unless a criterion needs them, without people, who are told as they are seen.

    People who are needed are predicted for `HORIZON` s at most.
    """
    content = problem.world.content
    try:
        world = problem.world.with_content(landmarks=content.landmarks, zones=content.zones)
        return replace(problem, tour=None, world=world)
    except CriterionError:
        return replace(problem, tour=None, horizon=min(problem.horizon or HORIZON, HORIZON))


def apart(chosen: Trajectory, other: Trajectory) -> float:
    """Return the mean distance, m, of the corners of a path from the chosen path, which may begin earlier."""
    path = shapely.LineString([*line_of(chosen), line_of(chosen)[-1]])
    points = shapely.points(np.array(line_of(other)))
    return float(shapely.distance(path, points).mean())
