"""Where a drive is, and what it has cost so far."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs, running_costs, trajectory_costs
from hpop.drive.plan import SAME, Plan, between, held, motion_ends
from hpop.drive.surroundings import Surroundings
from hpop.motions import States
from hpop.trajectories.history import sections
from hpop.trajectories.trajectory import Trajectory


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
