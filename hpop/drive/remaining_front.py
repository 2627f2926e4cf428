"""The front of remaining plans of a drive, with the present plan among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion, index_of_role
from hpop.criteria.costs import trajectory_costs
from hpop.criteria.visits import Visits
from hpop.drive.moment import Past
from hpop.frontier.dominance import quantised
from hpop.planners.base import Candidates
from hpop.problems import solving
from hpop.problems.evaluation import claimable
from hpop.problems.front import Front, Point
from hpop.trajectories.motion_table import MotionTable
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

WHOLE = "worst moments and means are those of the whole drive"


def front_of_rest(
    problem: Problem,
    candidates: Candidates,
    present: Trajectory | None,
    past: Callable[[], Past],
    visits: Visits | None = None,
) -> tuple[Front, Point | None, int | None]:
    """Return the front of remaining plans, a point for a dominated present plan, and the index of the present plan.

    A dominated present plan has the index after the last point of the front. The point is None if the present plan is
    in the front; point and index are None if there is no present plan.

    Costs that are sums cover only the remaining plan, because the past adds the same to all plans. Worst moments and
    means cover the whole drive, so plans with the same values become one point.

    problem  its start and time are those at which the remaining plans begin
    present  the present plan from there, None if an area or a person is in its way
    past     function that returns the costs of the drive up to there
    visits   visits of the present plan, with those that are under way where it begins; None without a tour
    """
    front = solving.front(problem, candidates)
    criteria = [claimable(problem)[name] for name in (*front.names, *front.reported_names)]
    rows = _CostedPlans.of(front)
    if present is None:
        own = _CostedPlans.none(front)
    else:
        values = trajectory_costs(criteria, [present], problem.world)
        if visits is not None and (missed := index_of_role("stops_missed", criteria)) is not None:
            values[:, missed] = visits.missed
        own = _CostedPlans.alone(present, values, problem, visits)
    if any(criterion.aggregate in ("max", "time-mean") for criterion in criteria):
        costs_so_far = past()
        rows, own = (plans.whole(criteria, costs_so_far) for plans in (rows, own))
        front = rows.front(front)
        front = replace(front, certificate=f"{front.certificate}; {WHOLE}")
    if present is None:
        return front, None, None
    place = _place(front, own)
    if place is None and not (front.integers <= _counts(front, own)).all(axis=1).any():
        front = _CostedPlans.of(front).and_those_of(own).front(front)
        place = _place(front, own)
    if place is None:
        return front, own.point(front), len(front)
    items = tuple(present if i == place else trajectory for i, trajectory in enumerate(front.items))
    if problem.tour is not None:  # plans with equal costs may visit the stops in other orders
        own_visits = {"visits": own.origins[0]["visits"]}
        origins = (origin | own_visits if i == place else origin for i, origin in enumerate(front.provenance))
        front = replace(front, provenance=tuple(origins))
    return replace(front, items=items), None, place  # of plans with equal costs, the present one is no change


@dataclass(frozen=True, eq=False)
class _CostedPlans:
    """Remaining plans with their costs and reported values (n, k + r), and their provenance (planner and options)."""

    trajectories: tuple[Trajectory, ...]
    values: FloatArray
    origins: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, front: Front) -> _CostedPlans:
        """Return the plans of a front."""
        return cls(front.trajectories, np.hstack([front.costs, front.reported]), front.provenance)

    @classmethod
    def alone(cls, present: Trajectory, values: FloatArray, problem: Problem, visits: Visits | None) -> _CostedPlans:
        """Return a collection with only the present plan."""
        origin: dict[str, Any] = {"planner": "drive", "kept": True}
        if problem.tour is not None and visits is not None:
            origin["visits"] = visits.described(problem.tour)
        return cls((present,), values, (origin,))

    @classmethod
    def none(cls, front: Front) -> _CostedPlans:
        """Return an empty collection with the columns of a front."""
        return cls((), np.zeros((0, len(front.names) + len(front.reported_names))), ())

    def and_those_of(self, others: _CostedPlans) -> _CostedPlans:
        """Return a collection of these plans and ``others``."""
        values = np.concatenate([self.values, others.values])
        return _CostedPlans(self.trajectories + others.trajectories, values, self.origins + others.origins)

    def whole(self, criteria: Sequence[Criterion], past: Past) -> _CostedPlans:
        """Return the plans with worst moments and means over the whole drive; ``past`` has the costs so far."""
        if not self.trajectories:
            return self
        values, durations = self.values.copy(), MotionTable.of(self.trajectories).durations
        for j, criterion in enumerate(criteria):
            if criterion.aggregate == "max":
                values[:, j] = np.maximum(values[:, j], past.totals[criterion.name])
            elif criterion.aggregate == "time-mean":
                total = past.duration + durations
                integral = past.totals[criterion.name] + values[:, j] * durations
                values[:, j] = np.divide(integral, total, out=np.zeros(total.size), where=total > 0.0)
        return replace(self, values=values)

    def front(self, like: Front) -> Front:
        """Return the front of these plans, with names, certificate and problem taken from the front ``like``."""
        k = len(like.names)
        return Front.of(
            self.values[:, :k],
            self.trajectories,
            names=like.names,
            units=like.units,
            quanta=like.quanta,
            groups=like.groups,
            reported=self.values[:, k:],
            reported_names=like.reported_names,
            reported_units=like.reported_units,
            status=like.status,
            certificate=like.certificate,
            provenance=self.origins,
            problem=like.problem,
            runs=like.runs,
        )

    def point(self, front: Front) -> Point:
        """Return the only plan as a point, with the index after the last point of a front."""
        values, k = self.values[0].tolist(), len(front.names)
        return Point(
            index=len(front),
            costs=dict(zip(front.names, values[:k], strict=True)),
            reported=dict(zip(front.reported_names, values[k:], strict=True)),
            item=self.trajectories[0],
            provenance=self.origins[0],
        )


def _counts(front: Front, own: _CostedPlans) -> IntArray:
    return quantised(own.values[:, : len(front.names)], front.quanta)


def _place(front: Front, own: _CostedPlans) -> int | None:
    """Return the index of the point of a front that has the same costs as a plan; None if there is none."""
    same = np.flatnonzero((front.integers == _counts(front, own)).all(axis=1))
    return int(same[0]) if same.size else None
