"""Goal that is followed, the plan under way to it, and planning: from where the robot stands, or from a place ahead.

:class:`.Follower` adds what the robot sees, and its commands. Times, s, are on the caller's clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from threading import Event

import numpy as np

from hpop.base.arrays import FloatArray
from hpop.base.text import printable
from hpop.drive.plan import joined, part, speed_of
from hpop.errors import HpopError
from hpop.motions import is_curve, laws_of
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow
from hpop.ros.follow_plans import (
    CHECKED,
    Ended,
    FollowGoal,
    FollowPlanner,
    FollowSettings,
    Planned,
    Sighting,
    StatesAhead,
)
from hpop.ros.messages import PlanarPose
from hpop.ros.paths import path_message
from hpop.ros.planning import choice_of, chosen_row, options_of
from hpop.ros.protocol import ErrorCode, Failure
from hpop.simulation.tracking import DriveLimits, Tracker
from hpop.trajectories.contacts import first_contact
from hpop.trajectories.trajectory import Trajectory

PERMANENT = (ErrorCode.GOAL_OUTSIDE_MAP, ErrorCode.INVALID_PLANNER)  # failures that waiting does not mend
LONGEST_WAIT = 5.0  # s before leaving, for which people are predicted while planning
ARRIVED = 0.01  # m from a place of the plan at which the robot has come there


@dataclass(frozen=True, eq=False)
class HandOver:
    """Place of a plan under way at which another plan may take over while the robot drives.

    before  the plan up to there
    latest  s, of the plan's clock; later, the robot could not brake any more for a turn there
    there   s, of the plan's clock, when the robot is there
    after   s, from the time of the query until the robot is there
    pose    x m, y m, yaw rad
    """

    before: Trajectory
    latest: float
    there: float
    after: float
    pose: tuple[float, float, float]


@dataclass(eq=False)
class UnderWay:
    """Plan under way: its tracking law, when it began, s, and its executed states (n,).

    far  (n,) m, length of the plan's path up to each executed state
    """

    trajectory: Trajectory
    tracker: Tracker
    begin: float
    ahead: StatesAhead
    far: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory, tracker: Tracker, begin: float) -> UnderWay:
        """Return the plan along a trajectory, which a law tracks and whose robot leaves at ``begin``, s."""
        ahead = StatesAhead.of(trajectory)
        return cls(trajectory, tracker, begin, ahead, _lengths(ahead.states.x, ahead.states.y))

    def clock(self, now: float) -> float:
        """Return the time of the plan, s, at which the robot should be at ``now``, s."""
        return self.tracker.clock(max(0.0, now - self.begin))

    def place_ahead(self, now: float, lead: float) -> HandOver | None:
        """Return the first place at which a plan that is ready in ``lead`` s may take over; None for none.

        Such places are ends of straight moves: there, the robot goes straight on or stops to turn. A plan with
        curves has none.
        """
        plan, laws = self.trajectory, laws_of(self.trajectory.model)
        limits = DriveLimits.of(plan.model)  # of the plan, also where a mask allows less
        if any(is_curve(laws[kind]) for kind in plan.kinds):
            return None
        clock, states, speeds, waits = self.clock(now), plan.states, speed_of(plan.states), max(0.0, self.begin - now)
        lengths, braking = _lengths(states.x, states.y), 0.5 * limits.speed**2 / limits.acceleration
        for i, kind in enumerate(plan.kinds[:-1], 1):
            if speeds[i] or "x" not in laws[kind].varies:
                continue
            latest = CHECKED * (int(np.searchsorted(self.far, lengths[i] - braking)) - 2)
            if latest + waits < clock + lead:
                continue
            there = CHECKED * int(np.searchsorted(self.far, lengths[i] - ARRIVED))
            there = float(plan.times[i]) if plan.punctual else there
            pose = (float(states.x[i]), float(states.y[i]), float(states.yaw[i]))
            return HandOver(part(plan, 0, i), latest, there, there - clock + waits, pose)
        return None

    def passes(self, goal: FollowGoal, place: HandOver, now: float, within: float) -> int:
        """Return how many poses of a goal the robot will have reached at a place, each within a distance, m."""
        clock = self.clock(now)
        begin, end = self.ahead.index(clock), self.ahead.index(clock + place.after - max(0.0, self.begin - now))
        x, y = (column[begin : end + 1] for column in (self.ahead.states.x, self.ahead.states.y))
        passed = goal.passed
        while passed < len(goal.poses) - 1:
            near = np.flatnonzero(np.hypot(x - goal.poses[passed].x, y - goal.poses[passed].y) <= within)
            if not near.size:
                break
            x, y, passed = x[near[0] :], y[near[0] :], passed + 1
        return passed

    def handed_over(self, place: HandOver, trajectory: Trajectory) -> UnderWay:
        """Return the plan that takes another trajectory from a place on, and let the tracking law follow it.

        Up to this place, the robot drives as it would without the change.
        """
        whole = joined(place.before, trajectory)
        self.tracker.follow(whole)
        return UnderWay.of(whole, self.tracker, self.begin)


@dataclass(eq=False)
class PlanningJob:
    """Planning under way for a goal.

    leaves  s, time for which it is planned that the robot leaves
    over    set when the result is no longer needed, so that planning ends
    place   where the plan under way may change; None for a robot that stands
    takes   True if the plan under way is to change there; False if the options are only offered
    """

    goal: FollowGoal
    future: Future[Front]
    leaves: float
    over: Event
    place: HandOver | None = None
    takes: bool = True


class GoalDrive:
    """The goal that a robot follows, its plan, and planning for it.

    goal     None while there is none
    run      plan under way, until the robot stands
    job      planning that is under way
    offered  options of a robot that stands and waits until one is taken
    ahead    options of a robot that drives, and the place where they begin
    events   what has happened since the list was last read
    """

    def __init__(
        self, planner: FollowPlanner, settings: FollowSettings, executor: Executor, say: Callable[[str], None]
    ) -> None:
        self.planner, self.settings, self.say = planner, settings, say
        self.seen = Sighting(planner)
        self.goal: FollowGoal | None = None
        self.run: UnderWay | None = None
        self.job: PlanningJob | None = None
        self.offered: Front | None = None
        self.ahead: tuple[HandOver, Front] | None = None
        self.stood: PlanarPose | None = None  # place of the plan at which the robot stopped
        self.why = ""  # the robot stands or brakes
        self.halted = False
        self.next_try = -math.inf  # s, of planning
        self.events: list[Ended | Planned] = []
        self._executor = executor
        self._began, self._next_offer, self._took = 0.0, -math.inf, 0.5

    def plan_again(self, now: float) -> None:
        """Begin to plan to the goal if the robot stands and its pose is known, or if options ahead are due.

        A robot that has found no plan for longer than the settings' ``patience`` gives up its goal.
        """
        goal, run, every = self.goal, self.run, self.settings.offers
        if goal is None or self.job is not None or self.offered is not None:
            return
        if run is not None:
            is_offered = self.ahead is not None and self.is_before(self.ahead[0], now)
            if every and now >= self._next_offer and not is_offered and not run.tracker.stopping:
                self._next_offer = now + every
                self.look_ahead(goal, run, now, takes=False)
            return
        if now < self.next_try:
            return
        pose = self.seen.pose(now, self.settings.late)
        if self.halted:
            self.why, goal.tried = "told to stop", now
        elif now - goal.tried > self.settings.patience:
            self.end(False, f"gave up after {now - goal.tried:.0f} s: {self.why or self.seen.missing(now)}")
        elif pose is None:
            self.why = self.seen.missing(now)
        else:
            self._plan(goal, pose, now)

    def _plan(self, goal: FollowGoal, pose: PlanarPose, now: float) -> None:
        """Begin to plan from a pose; among moving people for the time when planning is expected to have ended."""
        leaves = now + self._wait if self._moves(now) else now
        starts = [pose] if self.stood is None else [pose, self.stood]
        self._begin(goal, goal, starts, leaves, now)

    def _begin(
        self,
        goal: FollowGoal,
        rest: FollowGoal,
        starts: Sequence[PlanarPose],
        leaves: float,
        now: float,
        place: HandOver | None = None,
        *,
        takes: bool = True,
    ) -> None:
        """Begin to plan for a goal, from ``starts``; other parameters are those of :class:`PlanningJob`.

        ``rest`` is the goal, with its poses that will have been passed by then counted as passed.
        """
        over, worlds = Event(), (self.seen.world, self.seen.world_with_people(now, leaves))
        future = self._executor.submit(self.planner.way, rest, starts, worlds, self.settings.within, over)
        self.job, self._began = PlanningJob(goal, future, leaves, over, place, takes), now

    @property
    def _wait(self) -> float:
        """Time, s, in which planning is expected to have ended."""
        return min(1.5 * self._took + 0.2, LONGEST_WAIT)

    def _moves(self, now: float) -> bool:
        return any(person.moves for person in self.seen.people(now, now))

    def look_ahead(self, goal: FollowGoal, run: UnderWay, now: float, *, takes: bool) -> None:
        """Begin to plan from a place ahead; if there is none and an option ``takes`` over, brake."""
        self._drop_job()
        lead = self._wait + self.settings.delay + (0.0 if takes else self.settings.offers)
        place = run.place_ahead(now, lead)
        if self._moves(now) and not run.trajectory.punctual:
            place = None  # its times do not count, but those of a plan among people do
        if place is not None:
            start = PlanarPose(*place.pose, self.planner.known.frame_id)
            passed = run.passes(goal, place, now, self.settings.within)
            self._begin(goal, replace(goal, passed=passed), [start], now + place.after, now, place, takes=takes)
        elif takes:
            self.brake("another option was taken, for which the plan cannot change on the way any more")
            goal.stopped = False

    def is_before(self, place: HandOver, now: float) -> bool:
        """Return whether the plan can still change at a place."""
        run = self.run
        return run is not None and not run.tracker.stopping and run.clock(now) + self.settings.delay <= place.latest

    def take_up(self, now: float) -> None:
        """Use the result of planning, once it has ended: drive, ask for a choice, or say why there is no way."""
        job = self.job
        if job is None or not job.future.done():
            return
        self.job, self._took = None, now - self._began
        if job.goal is not self.goal:
            return
        try:
            front = job.future.result()
            row = chosen_row(front, choice_of(job.goal.choice))
        except Failure as failure:
            self._no_way(job, now, failure.why, ends=failure.code in PERMANENT)
            return
        except (HpopError, ValueError, RuntimeError) as error:
            self._no_way(job, now, printable(f"planning failed ({type(error).__name__}: {error})"), ends=True)
            return
        if job.place is not None:
            self._offer_ahead(job, job.place, front, row, now)
            return
        job.goal.tried = now
        if self.settings.asks and job.goal.stopped:
            self.offered = front
            self.events.append(Planned(job.goal.id, None, {"goal": job.goal.id, **options_of(front, row)}))
            self.say(f"asks which of {len(front):,} trajectories to take, after: {self.why}")
        elif met := self.met(row.point.trajectory, 0.0, begin := max(now, job.leaves), now):  # planning took long
            self._no_way(job, now, met, ends=False)
        else:
            self.start(front, row, begin)

    def _offer_ahead(self, job: PlanningJob, place: HandOver, front: Front, row: NamedRow, now: float) -> None:
        """Change the plan at a place ahead to what was planned from there, or offer this."""
        run = self.run
        assert run is not None
        if job.takes and (not self.is_before(place, now) or self.met_ahead(place, row, now)):  # planning took long
            self.look_ahead(job.goal, run, now, takes=True)
        elif job.takes:
            self.hand_over(place, front, row)
        elif self.is_before(place, now):
            self.ahead, x, y, yaw = (place, front), *place.pose
            until = place.latest - run.clock(now) + max(0.0, run.begin - now) - self.settings.delay
            ahead = {"x": x, "y": y, "yaw": yaw, "after": place.after + self._began - now, "until": until}
            told = {"goal": job.goal.id, **options_of(front, row), "ahead": ahead}
            self.events.append(Planned(job.goal.id, None, told))

    def met_ahead(self, place: HandOver, row: NamedRow, now: float) -> str:
        """Return which person a trajectory from a place ahead meets, as :meth:`met` does."""
        assert self.run is not None
        at = now + place.there - self.run.clock(now) + max(0.0, self.run.begin - now)
        return self.met(joined(place.before, row.point.trajectory), place.there, at, now)

    def met(self, trajectory: Trajectory, begin: float, at: float, now: float) -> str:
        """Return in words which person the robot meets along a trajectory from its time ``begin``, s; "" for none.

        People are predicted from how they were seen last, not as when the trajectory was planned: for a robot that
        comes to this place of the trajectory at the time ``at``, s.
        """
        parts, near = self.planner.problem.model.platform, self.settings.near
        found = first_contact(parts, self.seen.people(now, at), trajectory.execution(), near, begin=begin)
        if found is None:
            return ""
        return f"people are elsewhere now: {found[1]} would be within {near:g} m of the robot {found[0]:.1f} s later"

    def hand_over(self, place: HandOver, front: Front, row: NamedRow) -> None:
        """Take a trajectory of a front from a place ahead of the robot on."""
        assert self.run is not None
        trajectory = row.point.trajectory
        self._drive_along(self.run.handed_over(place, trajectory), front, row)
        stops = not trajectory.kinds or "x" not in laws_of(trajectory.model)[trajectory.kinds[0]].varies
        x, y, _ = place.pose
        self.say(f"the plan changes at ({x:.2f}, {y:.2f}), {'where the robot stops' if stops else 'without a stop'}")

    def start(self, front: Front, row: NamedRow, begin: float) -> None:
        """Drive along a trajectory of the planned front, from a time on, s."""
        trajectory = row.point.trajectory
        tracker = Tracker(trajectory, delay=self.settings.delay)
        self._drive_along(UnderWay.of(trajectory, tracker, begin), front, row)

    def _drive_along(self, run: UnderWay, front: Front, row: NamedRow) -> None:
        """Follow a plan whose trajectory is a row of a front; publish its path and the options of the front."""
        assert self.goal is not None
        self.run, self.why, self.offered, self.ahead = run, "", None, None
        path = path_message(run.trajectory, frame_id=self.planner.known.frame_id)
        self.events.append(Planned(self.goal.id, path, {"goal": self.goal.id, **options_of(front, row)}))
        self.say(f"goal {self.goal.id}: drives {row}, {run.tracker.duration:.1f} s")

    def _drop_job(self) -> None:
        """End planning that is under way."""
        if self.job is not None:
            self.job.over.set()
            self.job = None

    def _no_way(self, job: PlanningJob, now: float, why: str, *, ends: bool) -> None:
        """Plan again later or, with ``ends``, end the goal; a robot that drives goes on along its plan."""
        self.say(f"no {'other ' if job.place else ''}way: {why}")
        if job.place is None:
            self.why, self.next_try = why, now + self.settings.retry
            if ends:
                self.end(False, why)

    def end(self, reached: bool, words: str, *, canceled: bool = False) -> None:
        """End the goal; a robot that drives brakes."""
        assert self.goal is not None
        self.events.append(Ended(self.goal.id, reached, words, canceled))
        self.say(f"goal {self.goal.id}: {words}")
        self._drop_job()
        self.goal, self.offered, self.ahead, self.why = None, None, None, "" if reached else words
        if self.run is not None and not self.run.tracker.stopping:
            self.brake(words)

    def brake(self, why: str) -> None:
        """Brake the robot along its plan; options that were offered on the way are void."""
        assert self.run is not None
        self.run.tracker.stop()
        self.why, self.ahead = why, None
        self._drop_job()
        if self.goal is not None:
            self.goal.stopped = True
        self.say(f"stops: {why}")


def _lengths(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the length (n,), m, of a path through points (n,) up to each of them."""
    return np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
