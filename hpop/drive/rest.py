"""The front of the rest of a drive: candidates from where it may leave its plan, and the plan itself among them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop import solving
from hpop.criteria.base import trajectory_costs
from hpop.drive.moment import Past
from hpop.front import Front, Point
from hpop.frontier.dominance import quantised
from hpop.further import claimable
from hpop.planners.base import Candidates
from hpop.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problem import Problem

WHOLE = "worst moments and means are those of the whole drive"


def front_of_rest(
    problem: Problem, candidates: Candidates, kept: Trajectory | None, past: Past
) -> tuple[Front, Point | None, int | None]:
    """The front of what may be driven from now on; the present plan where others are better; its place, if any.

    Sums are of the rest alone, for the past adds the same to all. What was worst stays worst: so a worst moment, and a
    mean, are those of the whole drive, and what differs in nothing else is the same.

    problem  from where and when the rest begins
    kept     the present plan from there, where it is open
    past     what the drive has cost until then
    """
    front = solving.front(problem, candidates)
    names = [*front.names, *front.reported_names]
    criteria = [claimable(problem)[name] for name in names]
    table = np.hstack([front.costs, front.reported])
    ways, origins = list(front.trajectories), list(front.provenance)
    if kept is not None:
        own = trajectory_costs(criteria, [kept], problem.world)
        table = np.concatenate([table, own])
        ways.append(kept)
        origins.append({"planner": "drive", "kept": True})
    for j, criterion in enumerate(criteria):
        if criterion.aggregate == "max":
            table[:, j] = np.maximum(table[:, j], past.totals[criterion.name])
        elif criterion.aggregate == "time-mean":
            lasts = np.array([way.duration for way in ways])
            whole = past.duration + lasts
            integral = past.totals[criterion.name] + table[:, j] * lasts
            table[:, j] = np.divide(integral, whole, out=np.zeros(whole.size), where=whole > 0.0)
    is_whole = any(criterion.aggregate in ("max", "time-mean") for criterion in criteria)
    k = len(front.names)
    whole_front = Front.of(
        table[:, :k],
        ways,
        names=front.names,
        units=front.units,
        quanta=front.quanta,
        groups=front.groups,
        reported=table[:, k:],
        reported_names=front.reported_names,
        reported_units=front.reported_units,
        status=front.status,
        certificate=front.certificate + f"; {WHOLE}" * is_whole,
        provenance=origins,
        problem=front.problem,
        runs=front.runs,
    )
    if kept is None:
        return whole_front, None, None
    same = (whole_front.integers == quantised(table[-1:, :k], front.quanta)).all(axis=1)
    if same.any():  # of ways that cost the same the present plan is no change
        place = int(np.flatnonzero(same)[0])
        items = tuple(kept if i == place else way for i, way in enumerate(whole_front.items))
        return replace(whole_front, items=items), None, place
    values: Any = table[-1].tolist()
    point = Point(
        index=len(whole_front),
        costs=dict(zip(front.names, values[:k], strict=True)),
        reported=dict(zip(front.reported_names, values[k:], strict=True)),
        item=kept,
        provenance=origins[-1],
    )
    return whole_front, point, len(whole_front)
