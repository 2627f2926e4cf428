"""Offers of a live session: the ways that a viewer may take, and plans, as messages."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely

from hpop.base.arrays import FloatArray
from hpop.base.math import wrap
from hpop.base.text import printable
from hpop.drive.options import Options
from hpop.drive.surroundings import DriveSurroundings
from hpop.errors import CriterionError
from hpop.live.cards import Ways, cards, described, line_of
from hpop.motions import States
from hpop.problems.problem import Problem
from hpop.trajectories.trajectory import Trajectory

HORIZON = 8.0
"""Time, s, up to which people are predicted, if the scenario says nothing else."""


@dataclass(frozen=True, eq=False)
class Offer:
    """Ways that a viewer may take.

    ways     the ways, and their front
    time     s, time of the session at which they begin
    place    (x, y, theta) where they begin, m and rad
    status, certificate, gap  of the search that found them; the gap is relative: for every cost vector that is missing,
             one of the ways is at most a factor 1 + gap worse; infinite if nothing is proved
    before   the present plan from its beginning to ``place``; None if the robot stands
    problem  planning problem of a new destination; None for ways of the present drive
    options  options of the present drive; None for a new destination
    surroundings  closed areas and people when the options were found; None for a new destination
    """

    ways: Ways
    time: float
    place: tuple[float, float, float]
    status: str
    certificate: str
    gap: float
    before: Trajectory | None = None
    problem: Problem | None = None
    options: Options | None = None
    surroundings: DriveSurroundings | None = None

    @classmethod
    def of_drive(cls, options: Options, surroundings: DriveSurroundings) -> Offer:
        """Return the offer of the options of a drive, found in these surroundings."""
        commit, front = options.commit, options.front
        costs: FloatArray = front.costs
        if options.kept is not None:
            costs = np.vstack([costs, [options.kept.costs[name] for name in front.names]])
        ways = Ways(options.ways, costs, front, options.keep_on)
        found = str(options.status), options.certificate
        return cls(
            ways, commit.time, pose_of(commit.state), *found, options.gap, options=options, surroundings=surroundings
        )

    def with_taken(self, option: int) -> Offer:
        """Return the offer after one of its ways, by number, has become the plan of the present drive."""
        assert self.options is not None
        return replace(self, ways=replace(self.ways, present=option), options=replace(self.options, keep_on=option))

    def message(self, now: float, preference: Any) -> dict[str, Any]:
        """Return the message "options", which shows the ways to viewers; ``now`` is the time of the session, s."""
        return {
            "type": "options",
            "asked": now,
            "commit": {"t": self.time, **dict(zip(("x", "y", "theta"), self.place, strict=True))},
            "cards": cards(self.ways, preference),
            "all": described(self.ways),
            "present": self.ways.present,
            "certificate": printable(self.certificate),
            "status": self.status,
            "gap": self.gap if math.isfinite(self.gap) else None,
        }


def pose_of(state: States) -> tuple[float, float, float]:
    """Return the pose (x, y, yaw), m and rad, of a state (1,)."""
    return float(state.x[0]), float(state.y[0]), float(wrap(state.yaw[0]))


def plan_message(trajectory: Trajectory, now: float, elapsed: float, *, arrives: bool = True) -> dict[str, Any]:
    """Return the message "plan" for the robot, which follows the trajectory.

    elapsed  s, time of the plan at the time ``now`` of the session, s
    arrives  whether the plan leads to the destination
    """
    told = {"now": now, "elapsed": elapsed, "arrives": arrives}
    return {"type": "plan", **told, "trajectory": trajectory.describe(), "line": line_of(trajectory)}


def bare_problem(problem: Problem) -> Problem:
    """Return a problem without its tour and its people; a session adds the people that are seen.

    If a criterion needs people, they stay, and are predicted for `HORIZON` s at most.
    """
    content = problem.world.content
    try:
        world = problem.world.with_content(landmarks=content.landmarks, zones=content.zones)
        return replace(problem, tour=None, world=world)
    except CriterionError:
        return replace(problem, tour=None, horizon=min(problem.horizon or HORIZON, HORIZON))


def apart(chosen: Trajectory, other: Trajectory) -> float:
    """Return the mean distance, m, of the corners of the path of ``other`` from the path of ``chosen``."""
    path = shapely.LineString([*line_of(chosen), line_of(chosen)[-1]])
    points = shapely.points(np.array(line_of(other)))
    return float(shapely.distance(path, points).mean())
