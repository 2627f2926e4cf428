"""Where a drive is, and what it has cost so far."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from hpop.criteria.base import Criterion, trajectory_costs
from hpop.drive.plan import Plan, between, held
from hpop.drive.surroundings import Surroundings
from hpop.motions import States
from hpop.trajectory import Trajectory


class Stretch(NamedTuple):
    """Since when a drive is in some surroundings, and as early or late as it is.

    begins  s, of the plan: a motion that is under way is of the surroundings in which it began
    lag     s, of the drive, at which the plan began, as far as it was known where the robot is
    """

    surroundings: Surroundings
    begins: float
    lag: float


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

    Criteria with memory are of the whole way in the world as it is now.
    """
    totals = dict.fromkeys((criterion.name for criterion in criteria), 0.0)
    plain = [criterion for criterion in criteria if criterion.aggregate != "trajectory"]
    ends = [stretch.begins for stretch in stretches[1:]]
    for stretch, end in zip(stretches, [*ends, until], strict=True):
        end = min(end, until)
        if end <= stretch.begins:
            continue
        way = between(plan.announced, stretch.begins, end)
        problem = stretch.surroundings.at(way.states.take([0]), stretch.lag + stretch.begins)
        values = trajectory_costs(plain, [way], problem.world)[0].tolist()
        for criterion, value in zip(plain, values, strict=True):
            name = criterion.name
            if criterion.aggregate == "max":
                totals[name] = max(totals[name], value)
            else:
                totals[name] += value * (way.duration if criterion.aggregate == "time-mean" else 1.0)
    if memory := [criterion for criterion in criteria if criterion.aggregate == "trajectory"]:
        way = between(plan.announced, 0.0, until)
        values = trajectory_costs(memory, [way], stretches[-1].surroundings.problem.world)[0].tolist()
        totals |= dict(zip((criterion.name for criterion in memory), values, strict=True))
    return Past(totals, until)


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
        """What is still to be driven of it."""
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
