"""Where a drive is, its costs so far, and the front of what remains of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray, IntArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs, running_costs, trajectory_costs
from hpop.drive.plan import SAME, Plan, between, held, motion_ends
from hpop.drive.surroundings import Surroundings
from hpop.frontier.dominance import quantised
from hpop.motions import States
from hpop.planners.base import Candidates
from hpop.problems import solving
from hpop.problems.evaluation import claimable
from hpop.problems.front import Front, Point
from hpop.trajectories.history import sections
from hpop.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from hpop.problems.problem import Problem


class Stretch(NamedTuple):
    """Since when a drive is in some surroundings, and as early or late as it is.

    begins  s, of the plan: a motion that is under way is of the surroundings in which it began
    lag     s, of the drive, at which the plan began, as far as it was known where the robot is
    driven  where a motion of it was stopped and made two since, the plan as it was, and when that was, s of it
    """

    surroundings: Surroundings
    begins: float
    lag: float
    driven: tuple[Trajectory, float] | None = None


class Past(NamedTuple):
    """What a drive has cost so far, by criterion.

    totals    sums; worst moments; integrals of time-means
    duration  s
    """

    totals: dict[str, float]
    duration: float

    def cost(self, criterion: Criterion) -> float:
        """The cost of what was driven; of a mean over its time."""
        total = self.totals[criterion.name]
        if criterion.aggregate == "time-mean":
            return total / self.duration if self.duration > 0.0 else 0.0
        return total


def past(plan: Plan, until: float, stretches: Sequence[Stretch], criteria: Sequence[Criterion]) -> Past:
    """What a plan has cost until a time of its own, s: each stretch as its world was when the robot was there.

    Criteria with memory are of the whole way in the world as it is now; within a motion they grow evenly.
    """
    totals, duration = dict.fromkeys((criterion.name for criterion in criteria), 0.0), 0.0
    plain = [criterion for criterion in criteria if criterion.aggregate != "trajectory"]
    ends = [stretch.begins for stretch in stretches[1:]]
    for stretch, end in zip(stretches, [*ends, until], strict=True):
        way, end = stretch.driven or (plan.announced, min(end, until))
        duration += max(0.0, end - stretch.begins)
        for values in _costs(plain, way, stretch, end):
            for criterion, value in zip(plain, values.tolist(), strict=True):
                total = totals[criterion.name]
                totals[criterion.name] = max(total, value) if criterion.aggregate == "max" else total + value
    if memory := [criterion for criterion in criteria if criterion.aggregate == "trajectory"]:
        world = stretches[-1].surroundings.problem.world
        way = between(plan.announced, 0.0, motion_ends(plan.announced, until))
        for criterion in memory:
            running = np.append(0.0, running_costs(criterion, way, world))
            totals[criterion.name] = float(np.interp(until, way.times, running))
    return Past(totals, duration)


def _costs(criteria: Sequence[Criterion], way: Trajectory, stretch: Stretch, end: float) -> Iterator[FloatArray]:
    """Costs (k,) of what of a stretch is done at a time, s of a way: of whole motions, and of the one under way.

    That is costed in its own timing: a part of a turn would take longer as a turn of its own.
    """
    last = float(way.times[max(0, int(np.searchsorted(way.times, end + SAME, side="right")) - 1)])
    last = max(stretch.begins, last)
    for begin, until in ((stretch.begins, last), (last, motion_ends(way, end))):
        if min(until, end) <= begin + SAME:
            continue
        some = between(way, begin, until)
        world = stretch.surroundings.at(some.states.take([0]), stretch.lag + begin).world
        if until <= end + SAME:
            means = [criterion.aggregate == "time-mean" for criterion in criteria]
            yield trajectory_costs(criteria, [some], world)[0] * np.where(means, some.duration, 1.0)
            continue
        for _, whole in some.batches(world):
            ends = (some.at(moment) for moment in (0.0, end - begin))
            here, there = (States(**{name: getattr(at, name) for name in whole.start.names}) for at in ends)
            begun = sections(whole, np.zeros(1, np.int64), np.zeros(1), np.array([end - begin]), (here, there), None)
            yield np.concatenate([np.zeros(0), *(motion_costs(criterion, begun) for criterion in criteria)])


def stopped(
    stretches: Sequence[Stretch], t: float, begins: float, lag: float, driven: Trajectory | None = None
) -> list[Stretch]:
    """Stretches of a drive that stops at a time of its plan, s: what was to begin with the next motion begins then.

    begins, lag  of what follows, by the plan as it is now
    driven       the plan as it was, if the motion that was under way then was stopped and made two
    """
    last, begun = stretches[-1], [stretch for stretch in stretches if stretch.begins < t]
    if driven is not None:
        begun[-1] = begun[-1]._replace(driven=(driven, t))
    elif last.begins < t:
        return begun
    return [*begun, Stretch(last.surroundings, begins, lag)]


@dataclass(frozen=True, eq=False)
class Moment:
    """Where a drive is at some time.

    now      s, of the drive
    planned  s, of the plan: where the robot is on it
    state    (1,) of the robot
    stands   whether the robot stands because the rest of its way is closed
    arrived  whether it is at the goal
    plan     what is driven from the beginning on, if nothing changes any more
    """

    now: float
    planned: float
    state: States
    stands: bool
    arrived: bool
    _plan: Plan
    _stretches: tuple[Stretch, ...]
    _lag: float

    @property
    def plan(self) -> Trajectory:
        """What is driven from the beginning on, if nothing changes any more."""
        return self._plan.driven

    @cached_property
    def rest(self) -> Trajectory:
        """What is still to be driven of it, as a plan from here: what is left of a turn begins and ends at rest."""
        return between(self._plan.driven, self.planned, self._plan.driven.duration)

    @cached_property
    def past(self) -> dict[str, float]:
        """What the drive has cost so far, by criterion, each stretch in the world as it was then.

        Also the time for which the robot has stood because the rest of its way is closed.
        """
        criteria = self._stretches[-1].surroundings.problem.criteria
        plan, end = self._plan, self.planned
        if self.stands:
            plan = Plan(held(plan.driven, self.now - self._lag - end))
            end = plan.end
        found = past(plan, end, self._stretches, criteria)
        return {criterion.name: found.cost(criterion) for criterion in criteria}


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
