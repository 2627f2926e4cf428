"""Progress of a drive: the position of the robot, the costs so far, and the front of remaining plans.

Times of the drive are on the clock of the caller, s. Times of the plan begin at 0 at the beginning of the plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.criteria.base import Criterion
from hpop.criteria.costs import motion_costs, running_costs, trajectory_costs
from hpop.drive.options import Commit, LeavePoints, Options
from hpop.drive.plan import SAME, Cut, Plan, between, cut_of, held, joined, motion_ends, part, until
from hpop.drive.surroundings import DriveSurroundings
from hpop.drive.tour import TourProgress
from hpop.motions import States, laws_of
from hpop.planners.graphs.timed.safety import LEAVING
from hpop.problems.named_rows import StopVisit
from hpop.trajectories.contacts import STEP
from hpop.trajectories.history import sections
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person


class Stretch(NamedTuple):
    """A part of a drive in which surroundings and lag do not change.

    begins  s, time of the plan; a motion under way belongs to the surroundings in which it began
    lag     s, time of the drive at which the plan began, corrected by measured states
    driven  if the last motion of this part was split: the plan before the split, and the time of the split on that
            plan, s; else None
    """

    surroundings: DriveSurroundings
    begins: float
    lag: float
    driven: tuple[Trajectory, float] | None = None


class Past(NamedTuple):
    """Costs of a drive so far.

    totals    by criterion: the sum, the worst moment, or the time integral of a time-mean
    duration  s, elapsed
    """

    totals: dict[str, float]
    duration: float

    def cost(self, criterion: Criterion) -> float:
        """Return the cost of a criterion so far; a time-mean is taken over the elapsed time."""
        total = self.totals[criterion.name]
        if criterion.aggregate == "time-mean":
            return total / self.duration if self.duration > 0.0 else 0.0
        return total


def past(plan: Plan, end: float, stretches: Sequence[Stretch], criteria: Sequence[Criterion]) -> Past:
    """Return the costs of a plan up to time ``end``, s; each part of the drive is evaluated in its own surroundings.

    Criteria with memory are evaluated along the whole path in the present world, and grow evenly within a motion.
    """
    totals, duration = dict.fromkeys((criterion.name for criterion in criteria), 0.0), 0.0
    plain = [criterion for criterion in criteria if criterion.aggregate != "trajectory"]
    ends = [stretch.begins for stretch in stretches[1:]]
    for stretch, last in zip(stretches, [*ends, end], strict=True):
        trajectory, stretch_end = stretch.driven or (plan.announced, min(last, end))
        duration += max(0.0, stretch_end - stretch.begins)
        for values in _costs(plain, trajectory, stretch, stretch_end):
            for criterion, value in zip(plain, values.tolist(), strict=True):
                total = totals[criterion.name]
                totals[criterion.name] = max(total, value) if criterion.aggregate == "max" else total + value
    if memory := [criterion for criterion in criteria if criterion.aggregate == "trajectory"]:
        world = stretches[-1].surroundings.problem.world
        trajectory = between(plan.announced, 0.0, motion_ends(plan.announced, end))
        for criterion in memory:
            running = np.append(0.0, running_costs(criterion, trajectory, world))
            totals[criterion.name] = float(np.interp(end, trajectory.times, running))
    return Past(totals, duration)


def _costs(criteria: Sequence[Criterion], trajectory: Trajectory, stretch: Stretch, end: float) -> Iterator[FloatArray]:
    """Yield the costs (k,) of a stretch up to a time, s: first of whole motions, then of the motion under way.

    The cost of a time-mean is its time integral here.

    The part of the motion under way keeps the timing of the whole motion, because a part of a turn would take longer as
    a turn of its own.
    """
    last = float(trajectory.times[max(0, int(np.searchsorted(trajectory.times, end + SAME, side="right")) - 1)])
    last = max(stretch.begins, last)
    for begin, motion_end in ((stretch.begins, last), (last, motion_ends(trajectory, end))):
        if min(motion_end, end) <= begin + SAME:
            continue
        driven = between(trajectory, begin, motion_end)
        world = stretch.surroundings.at(driven.states.take([0]), stretch.lag + begin).world
        if motion_end <= end + SAME:
            means = [criterion.aggregate == "time-mean" for criterion in criteria]
            yield trajectory_costs(criteria, [driven], world)[0] * np.where(means, driven.duration, 1.0)
            continue
        for _, motion in driven.batches(world):
            ends = (driven.at(moment) for moment in (0.0, end - begin))
            here, there = (States(**{name: getattr(at, name) for name in motion.start.names}) for at in ends)
            begun = sections(motion, np.zeros(1, np.int64), np.zeros(1), np.array([end - begin]), (here, there), None)
            yield np.concatenate([np.zeros(0), *(motion_costs(criterion, begun) for criterion in criteria)])


def stopped(
    stretches: Sequence[Stretch], t: float, begins: float, lag: float, driven: Trajectory | None = None
) -> list[Stretch]:
    """Return the stretches of a drive whose plan is stopped at time ``t`` of the plan, s.

    Stretches that begin at ``t`` or later are dropped. If there are any, or if the motion under way was split, a new
    stretch in the present surroundings follows.

    begins, lag  of the new stretch, in times of the new plan
    driven       the plan before the split, if the motion under way was split at ``t``; else None
    """
    last, begun = stretches[-1], [stretch for stretch in stretches if stretch.begins < t]
    if driven is not None:
        begun[-1] = begun[-1]._replace(driven=(driven, t))
    elif last.begins < t:
        return begun
    return [*begun, Stretch(last.surroundings, begins, lag)]


class ChangedPlan(NamedTuple):
    """The plan with an option in place of its rest, and how far it is open.

    asked  the options, the number of the option, the time, the plan before and the surroundings
    """

    asked: tuple[object, ...]
    plan: Plan
    cut: Cut

    @property
    def blocked_by(self) -> int | None:
        """Number of the first motions of the option that alone decide that it is blocked; None if it is clear.

        The motion in which the robot meets something is executed as one run with the moves before and after it, and
        up to half a ramp later than planned.
        """
        if self.cut.safe is None:
            return None
        plan, laws = self.plan.announced, laws_of(self.plan.announced.model)
        begin = int(np.searchsorted(plan.times, self.plan.chosen + SAME, side="right")) - 1
        last = int(np.searchsorted(plan.times, self.cut.safe + self.plan.ramp + STEP))
        while last < len(plan) and "x" in laws[plan.kinds[last]].varies:
            last += 1
        return max(0, min(last + 1, len(plan)) - begin) if self.cut.safe > self.plan.chosen else 0


class DriveProgress:
    """The plan that a robot follows, its position on the plan, and the surroundings on the way.

    plan       the present plan
    lag        s, time of the drive at which the plan began, corrected by measured states
    stretches  parts of the drive by surroundings; the last one has the present surroundings
    margin     m, distance to keep from moving people
    tour       progress along the tour at the last event; None without a tour
    """

    def __init__(self, plan: Plan, surroundings: DriveSurroundings, begin: float, margin: float) -> None:
        self.plan, self.lag, self.margin = plan, begin, margin
        tour = surroundings.problem.tour
        self.tour = None if tour is None else TourProgress(tour)
        self.stretches = [Stretch(surroundings, 0.0, begin)]
        self._changed: ChangedPlan | None = None
        self._walking: tuple[DriveSurroundings, float, tuple[Person, ...]] = surroundings, -math.inf, ()

    @property
    def surroundings(self) -> DriveSurroundings:
        """The present world of the drive, with its closed areas."""
        return self.stretches[-1].surroundings

    def planned(self, now: float) -> float:
        """Return the time on the plan, s, that the robot has reached at time ``now`` of the drive, s."""
        return min(max(now - self.lag, 0.0), self.plan.end)

    def state(self, now: float) -> States:
        """Return the state (1,) of the robot at time ``now`` of the drive, s."""
        return self.plan.driven.at(self.planned(now))

    def commit(self, now: float, deadline: float) -> Commit:
        """Return the first place of the plan, at least ``deadline`` s after ``now``, where the robot may change it.

        If the plan ends before, it is the end of the plan. `Commit` has its time, state and remaining plan.
        """
        plan, lag, t = self.plan, self.lag, now + deadline - self.lag
        driven, place = plan.driven, plan.next_arrival(t)
        at_end = place == len(driven)
        arrives = at_end and plan.stops is None
        stands = t - float(driven.times[place]) if at_end and not arrives else 0.0
        stands = max(stands, plan.stops_for) if stands > 0.0 else 0.0
        time = lag + float(driven.times[place]) + stands
        states = plan.states
        times = lag + driven.times[plan.arrivals]
        soon = (times > time + SAME) & (times <= time + LEAVING)
        later = LeavePoints(times[soon], states.take(plan.arrivals[soon]))
        before = held(part(driven, 0, place), stands)
        begins = min(float(driven.times[place]), math.inf if plan.stops is None else plan.stops)
        remaining = between(plan.announced, begins, plan.announced.duration)
        here, tour = states.take(np.array([place])), None
        if self.tour is not None:
            problem = self.surroundings.at(here, time)
            tour = self.tour.after(joined(before, remaining), before.duration, lag, problem).tour
        return Commit(time, here, place, stands, arrives, before, remaining, later, tour)

    def moment(self, now: float) -> Moment:
        """Return the position of the robot at a time of the drive, s, with the costs so far."""
        planned, plan = self.planned(now), self.plan
        at_end = planned >= plan.end - SAME
        stands, arrived = plan.stops is not None and at_end, plan.stops is None and at_end
        stretches = tuple(self.stretches)
        return Moment(now, planned, self.state(now), stands, arrived, plan, stretches, self.lag, self.tour)

    def shift(self, now: float) -> None:
        """Begin a new `Stretch` with the present lag at the end of the motion under way; the surroundings stay.

        If the last stretch begins there or later, the new one replaces it, and begins where it began.
        """
        begins, last = self.plan.motion_ends(self.planned(now)), self.stretches[-1]
        if last.begins >= begins - SAME:
            self.stretches.pop()
            begins = last.begins
        self.stretches.append(Stretch(last.surroundings, begins, self.lag))

    def enter(self, surroundings: DriveSurroundings, now: float) -> Cut:
        """Continue the drive in changed surroundings; return how far the plan is open there."""
        self._stand(now)
        if surroundings.people != self.surroundings.people:
            self.plan = self.plan.among_others()
        begins = self.plan.motion_ends(self.planned(now))
        self.stretches.append(Stretch(surroundings, begins, self.lag))
        return self.cut(now)

    def _stand(self, now: float) -> None:
        """Insert a stop into the plan, for the time that the robot has stood before what is in the way."""
        plan, stood = self.plan, now - self.lag - self.plan.end
        if plan.stops is not None and now - self.lag - plan.stops > SAME:
            self.plan = Plan(*plan.waiting(max(stood, plan.stops_for) if stood > SAME else 0.0))

    def cut_of(self, plan: Plan, now: float) -> Cut:
        """Return how far a plan, which begins like the present one up to ``now``, is open."""
        surroundings, then = self.surroundings, max(now, self.lag)  # people walk on before the robot leaves
        predicted = self._walking  # another thread may replace it meanwhile
        if predicted[0] is not surroundings or predicted[1] != then:
            people = zip(surroundings.predicted(then), surroundings.people, strict=True)
            walking = tuple(person for person, before in people if before.moves)  # also if a person has stopped since
            predicted = self._walking = surroundings, then, walking
        reached = min(max(now - self.lag, 0.0), plan.end)  # a robot that stands may be past the end of its present plan
        return cut_of(plan, reached, surroundings.closed, predicted[2], self.margin)

    def with_option(self, options: Options, place: int, now: float) -> ChangedPlan:
        """Return the plan with an option, given by its number; it is checked once for each time ``now``."""
        if place == options.keep_on:
            return ChangedPlan((), self.plan, Cut(self.plan.stops, self.plan.stops))
        asked, changed = (options, place, now, self.plan, self.surroundings), self._changed
        if changed is None or any(a is not b for a, b in zip(asked, changed.asked, strict=True)):
            plan = self.plan.then(options.commit.place, options.commit.stands, options.ways[place])
            changed = self._changed = ChangedPlan(asked, plan, self.cut_of(plan, now))
        return changed

    def cut(self, now: float, known: Cut | None = None) -> Cut:
        """Stop the plan before closed areas and people in the way; return how far it is open.

        known  the result of :meth:`cut_of` for the present plan, if it was computed before
        """
        t, announced = self.planned(now), self.plan.announced
        cut = self.cut_of(self.plan, now) if known is None else known
        if cut.stops == t and t not in announced.times:
            # The motion under way ends here; each part of a split turn takes a time of its own.
            before = until(announced, t)
            self.plan = Plan(joined(before, between(announced, t, announced.duration)))
            self.lag = now - before.duration
            self.stretches = stopped(self.stretches, t, before.duration, self.lag, announced)
            cut = self.cut_of(self.plan, now)
        elif cut.stops is not None:
            self.stretches = stopped(self.stretches, cut.stops, cut.stops, self.lag)
        self.plan = self.plan.closed_at(cut.stops)
        return cut


@dataclass(frozen=True, eq=False)
class Moment:
    """The position of the robot on its plan at a time of a drive, and the costs so far.

    now      s, time of the drive
    planned  s, time on the plan that the robot has reached
    state    (1,) state of the robot
    stands   whether the robot stands because a closed area or a person is in the way of the remaining plan
    arrived  whether it is at the goal
    plan     the trajectory from the beginning on, as the robot follows it if nothing changes
    """

    now: float
    planned: float
    state: States
    stands: bool
    arrived: bool
    _plan: Plan
    _stretches: tuple[Stretch, ...]
    _lag: float
    _tour: TourProgress | None = None

    @property
    def plan(self) -> Trajectory:
        """The trajectory from the beginning of the drive on, as the robot follows it if nothing changes."""
        return self._plan.driven

    @cached_property
    def rest(self) -> Trajectory:
        """The remaining plan from here on; the remaining part of a turn begins and ends at rest."""
        return between(self._plan.driven, self.planned, self._plan.driven.duration)

    @cached_property
    def past(self) -> dict[str, float]:
        """The costs so far by criterion; each part of the drive is evaluated in the surroundings at that time.

        They include the time for which the robot has stood before a closed area or a person in its way.
        """
        criteria = self._stretches[-1].surroundings.problem.criteria
        plan, end = self._plan, self.planned
        if plan.stops is not None and end > plan.stops - SAME:
            plan = Plan(held(plan.driven, self.now - self._lag - end) if self.stands else plan.driven)
            end = plan.end if self.stands else end
        costs = past(plan, end, self._stretches, criteria)
        return {criterion.name: costs.cost(criterion) for criterion in criteria}

    @cached_property
    def stops(self) -> TourProgress | None:
        """Progress along the tour at this time: the stops that are done, and those that remain; None without a tour."""
        if self._tour is None:
            return None
        plan, t, problem = self._plan, self.planned, self._stretches[-1].surroundings.problem
        announced, stood = plan.announced, self.now - self._lag - plan.end
        if self.stands and stood > SAME:
            announced, t = plan.waiting(stood)
        elif plan.stops is not None and t > plan.stops:
            announced = plan.waiting(0.0)[0]
        return self._tour.after(announced, t, self._lag, problem)

    @property
    def visits(self) -> tuple[StopVisit, ...]:
        """Visits of the tour's stops so far, in order of time, with times of the drive; () without a tour."""
        return () if self.stops is None else self.stops.visits
