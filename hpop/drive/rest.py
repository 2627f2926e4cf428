"""The front of the rest of a drive: candidates from where it may leave its plan, and the plan itself among them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import trajectory_costs
from hpop.drive.moment import Past
from hpop.frontier.dominance import quantised
from hpop.planners.base import Candidates
from hpop.problems import solving
from hpop.problems.evaluation import claimable
from hpop.problems.front import Front, Point
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem

WHOLE = "worst moments and means are those of the whole drive"


def front_of_rest(
    problem: Problem, candidates: Candidates, kept: Trajectory | None, past: Callable[[], Past]
) -> tuple[Front, Point | None, int | None]:
    """The front of what may be driven from now on; the present plan where others are better; its place, if any.

    Sums are of the rest alone, for the past adds the same to all. What was worst stays worst: so a worst moment, and a
    mean, are those of the whole drive, and what differs in nothing else is the same.

    problem  from where and when the rest begins
    kept     the present plan from there, where it is open
    past     what the drive has cost until then, asked where it matters
    """
    front = solving.front(problem, candidates)
    criteria = [claimable(problem)[name] for name in (*front.names, *front.reported_names)]
    whole = any(criterion.aggregate in ("max", "time-mean") for criterion in criteria)
    rows = _Rows.of(front)
    own = _Rows.none(front) if kept is None else _Rows.alone(kept, trajectory_costs(criteria, [kept], problem.world))
    if whole:
        gone = past()
        rows, own = (some.whole(criteria, gone) for some in (rows, own))
        front = rows.front(front)
        front = replace(front, certificate=f"{front.certificate}; {WHOLE}")
    if kept is None:
        return front, None, None
    place = _place(front, own)
    if place is None and not _is_dominated(front, own):
        front = _Rows.of(front).and_those_of(own).front(front)
        place = _place(front, own)
    if place is None:
        return front, own.point(front), len(front)
    items = tuple(kept if i == place else way for i, way in enumerate(front.items))
    return replace(front, items=items), None, place  # of ways that cost the same the present plan is no change


@dataclass(frozen=True, eq=False)
class _Rows:
    """Ways with their costs and reported values (n, k + r), and where they come from."""

    ways: tuple[Trajectory, ...]
    values: FloatArray
    origins: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, front: Front) -> _Rows:
        """Those of a front."""
        return cls(front.trajectories, np.hstack([front.costs, front.reported]), front.provenance)

    @classmethod
    def alone(cls, kept: Trajectory, values: FloatArray) -> _Rows:
        """The present plan."""
        return cls((kept,), values, ({"planner": "drive", "kept": True},))

    @classmethod
    def none(cls, front: Front) -> _Rows:
        """No way."""
        return cls((), np.zeros((0, len(front.names) + len(front.reported_names))), ())

    def and_those_of(self, others: _Rows) -> _Rows:
        """These and others."""
        values = np.concatenate([self.values, others.values])
        return _Rows(self.ways + others.ways, values, self.origins + others.origins)

    def whole(self, criteria: Sequence[Criterion], past: Past) -> _Rows:
        """The same, worst moments and means those of the whole drive."""
        values = self.values.copy()
        for j, criterion in enumerate(criteria):
            if criterion.aggregate == "max":
                values[:, j] = np.maximum(values[:, j], past.totals[criterion.name])
            elif criterion.aggregate == "time-mean":
                lasts = np.array([way.duration for way in self.ways])
                all_ = past.duration + lasts
                integral = past.totals[criterion.name] + values[:, j] * lasts
                values[:, j] = np.divide(integral, all_, out=np.zeros(all_.size), where=all_ > 0.0)
        return replace(self, values=values)

    def front(self, like: Front) -> Front:
        """The front of these ways, in all else like another."""
        k = len(like.names)
        return Front.of(
            self.values[:, :k],
            self.ways,
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
        """The one way as a point that a front does not have."""
        values, k = self.values[0].tolist(), len(front.names)
        return Point(
            index=len(front),
            costs=dict(zip(front.names, values[:k], strict=True)),
            reported=dict(zip(front.reported_names, values[k:], strict=True)),
            item=self.ways[0],
            provenance=self.origins[0],
        )


def _counts(front: Front, own: _Rows) -> IntArray:
    return quantised(own.values[:, : len(front.names)], front.quanta)


def _place(front: Front, own: _Rows) -> int | None:
    """The point of a front that costs the same."""
    same = np.flatnonzero((front.integers == _counts(front, own)).all(axis=1))
    return int(same[0]) if same.size else None


def _is_dominated(front: Front, own: _Rows) -> bool:
    return bool((front.integers <= _counts(front, own)).all(axis=1).any())
