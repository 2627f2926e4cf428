"""The drive of a live session, with the ways that it can take; another thread may answer pushes from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from threading import RLock
from time import perf_counter
from typing import Any

from hpop.base.text import printable
from hpop.drive.execution import Execution
from hpop.drive.plan import joined
from hpop.drive.script import follow
from hpop.drive.surroundings import DriveSurroundings
from hpop.errors import DriveError, HpopError
from hpop.live.cards import beginnings, first_turn, nearest_to_push
from hpop.live.offers import Offer, bare_problem, plan_message
from hpop.live.places import Destination
from hpop.models.execution import Ramps
from hpop.problems.problem import Planning, Problem
from hpop.trajectories.trajectory import Trajectory

Message = dict[str, Any]
Pose = tuple[float, float, float]

AHEAD = 0.8
"""Time, s, until ways begin that are offered ahead; braking comes in addition. Pushes are answered from them."""
STALE = 0.1
"""Delay of the robot, s, since an offer of ways to a new destination, above which they are computed anew."""
LEAD = 0.1
"""Time, s, from a question until its options can begin; braking comes in addition."""
PASSED = "the robot has passed the place where this way begins; choose again"
WITHIN = 0.2
"""Time, s, in which the ways of a drive must be found; among people, the graph may be built anew meanwhile."""


class OfferedDrive:
    """The drive of a session, and the ways that were offered last. Two threads may use it.

    One thread answers requests, the other one answers pushes (`push_at_once`) while the first one computes. Both change
    the drive, and yield the messages that say so, only while they hold the lock ``changing``.

    clock     returns the time of the session, s, at present: later than the time ``now`` of a request that takes long;
              without it, each request counts as answered at once
    template  problem of the scenario without its tour and its people
    drive     the present drive; None while the robot has no plan
    prefix    what was driven before it without a stop between; None for nothing
    goal      destination of the offered ways; None while the offered ways change the plan of the present drive
    offer     the ways that can be taken now; None if they are not known
    """

    def __init__(self, problem: Problem, planner: Any) -> None:
        self.template = bare_problem(problem)
        self.planning = Planning(self.template.world, problem.model, problem.criteria, planner)
        self.surroundings = DriveSurroundings.of(self.template, 0.0, self.planning.planner.margin)
        ramps = Ramps.of(problem.model)
        self.brakes = 0.0 if ramps is None else ramps.half
        self.changing = RLock()
        self.drive: Execution | None = None
        self.prefix: Trajectory | None = None
        self.goal: Destination | None = None
        self.offer: Offer | None = None
        self._checked: tuple[tuple[Trajectory, ...], DriveSurroundings, set[int], set[tuple[int, ...]]]
        self._checked = (), self.surroundings, set(), set()  # numbers of clear ways; motions that begin blocked ones
        self.took = 0.0  # s, that finding the ways of the drive last took
        self._pushes = 0  # number of pushes that have changed the plan beside a request
        self._pushed = -math.inf  # s, time of the last push beside a request, or of the last options
        self.clock: Callable[[], float] = lambda: -math.inf

    def _offer_rest(
        self, now: float, lead: float = LEAD, *, within: float = WITHIN, anew: bool = False
    ) -> Offer | None:
        """Store and return the offer of the ways that the present drive can still take; None without a drive.

        They are searched for ``within`` s.

        While the graph is built anew for people who walk elsewhere than predicted, only ways that are known already are
        found. The last offer, which may have more, then stays as long as it can be used, unless ``anew``.
        """
        if self.drive is None:
            return None
        while True:
            pushes, surroundings = self._pushes, self.surroundings
            with self.changing:  # a push that was sent before this event may come after it
                now = self._pushed = max(now, self._pushed)
            began = perf_counter()
            try:
                options = self.drive.options(now, lead + self.brakes, within)
            except HpopError:
                if pushes == self._pushes:
                    raise
                continue
            self.took = perf_counter() - began
            if len(options):
                beginnings(options.ways)  # ahead of a push
            with self.changing:
                if pushes != self._pushes:  # of a plan that a push has changed meanwhile
                    continue
                if anew or self.offer is None or math.isfinite(options.gap) or not self._stands(self.offer, now):
                    self.offer = Offer.of_drive(options, surroundings)
                return self.offer

    def _stands(self, offer: Offer, now: float) -> bool:
        """Return whether the present plan can still be changed to a way of an offer."""
        return offer.options is not None and self.goal is None and not self._is_late(offer, now)

    def _is_late(self, offer: Offer, now: float) -> bool:
        """Return whether it is too late to take a way of an offer: the robot could no longer change to it in time."""
        now = max(now, self.clock())
        if offer.options is None and offer.before is None:
            return self.surroundings.moving and now > offer.time
        arrives = offer.options is not None and offer.options.commit.arrives  # no other way is left
        return not arrives and now + self.brakes > offer.time

    def _is_behind(self, offer: Offer, now: float) -> bool:
        """Return whether the robot is over `STALE` s later than an offer assumed, as after a stop."""
        if offer.before is None or self.drive is None or now < self.drive.begin:
            return False
        passed = self.drive.at(now).planned + (0.0 if self.prefix is None else self.prefix.duration)
        return offer.before.duration - (offer.time - now) - passed > STALE

    def _is_open(self, offer: Offer, now: float, option: int) -> bool:
        """Return whether a way of an offer is clear of closed areas and people as they are predicted now.

        Ways to a new destination, and those found in the present surroundings, count as clear.
        """
        if offer.options is None or self.drive is None or offer.surroundings is self.surroundings:
            return True
        if self._checked[0] is not offer.ways.trajectories or self._checked[1] is not self.surroundings:
            self._checked = offer.ways.trajectories, self.surroundings, set(), set()
        _, _, clear, blocked = self._checked
        if option in clear:
            return True
        motions = offer.ways.motions[option]
        if any(motions[: len(first)] == first for first in blocked):
            return False
        count = self.drive.blocked_by(option, now, offer.options)
        if count is None:
            clear.add(option)
        else:
            blocked.add(motions[:count])
        return count is None

    def _taken(self, now: float, offer: Offer, option: int, by: str) -> Iterator[Message]:
        """Take a way of an offer: yield the plan for the robot, and the message "taken"."""
        trajectory = offer.ways.trajectories[option]
        taken = {"type": "taken", "option": option, "by": by, "words": first_turn(trajectory)}
        if offer.options is not None:
            with self.changing:
                assert self.drive is not None
                try:
                    if self._is_late(offer, now):
                        raise DriveError(PASSED)
                    self.drive.take(option, now, offer.options)
                except DriveError as error:
                    yield {"type": "refused", "words": printable(str(error))}
                    return
                self.offer = offer.with_taken(option)  # another push may still change to another of its ways
                yield self._plan(now)
                yield taken
            return
        assert offer.problem is not None
        with self.changing:
            self.prefix, self.goal, self.offer, self.drive = offer.before, None, None, None
            whole = trajectory if offer.before is None else joined(offer.before, trajectory)
            begin = offer.time if offer.before is not None or trajectory.punctual else now
            elapsed = now - begin + (0.0 if offer.before is None else offer.before.duration)
            yield plan_message(whole, now, elapsed)
            yield taken
        planner = self.planning.planner
        drive = follow(offer.problem, offer.ways.front, option, planner=planner, begin=max(0.0, begin), waits=False)
        with self.changing:
            self.drive = drive
        self._offer_rest(max(now, self.clock()), AHEAD, within=0.0)  # for pushes, until the graph is built

    def push_at_once(self, now: float, pose: Pose, direction: float) -> Iterator[Message]:
        """Answer a push beside a request that another thread is answering; no message if it has to wait for that.

        It must wait if the ways of the present drive are not known, or begin too soon.
        """
        with self.changing:
            if self.drive is None or self.offer is None or not self._stands(self.offer, now):
                return
            now = self._pushed = max(now, self._pushed)
            for message in self._answer(now, pose[2] + direction):
                self._pushes += message["type"] == "taken"
                yield message

    def _answer(self, now: float, heading: float) -> Iterator[Message]:
        """Take the open way of the offer that lies nearest to a heading in the world, rad; yield messages about it."""
        with self.changing:
            offer = self.offer
            many = 0 if offer is None else len(offer.ways.trajectories)
            found = None if offer is None else nearest_to_push(offer.ways, heading, partial(self._is_open, offer, now))
            if offer is None or found is None:
                words = "there is no way to choose from; choose a destination first"
                if many:
                    words = "no way is clear of people and closed areas now; wait, or choose another destination"
                yield {"type": "pushed", "followed": False, "option": None, "words": words}
                return
            if self._is_late(offer, now) and found.row != offer.ways.present:
                words = "the robot has passed the place where the ways begin; push again"
                yield {"type": "pushed", "followed": False, "option": offer.ways.present, "words": words}
                return
            words = first_turn(offer.ways.trajectories[found.row])
            if not found.follows:
                words = f"no way leads there within 3 s; the robot {words}"
            yield {"type": "pushed", "followed": found.follows, "option": found.row, "words": words}
            if found.row != offer.ways.present:
                yield from self._taken(now, offer, found.row, "push")

    # The drive

    def _pose(self, pose: Pose) -> tuple[float, ...]:
        """Return the state of a pose; variables other than x, y and yaw as at the start."""
        names = self.template.model.space.names
        values = dict(zip(names, self.template.start, strict=True)) | dict(zip(("x", "y", "yaw"), pose, strict=True))
        return tuple(values[name] for name in names)

    def _see(self, now: float, pose: Pose) -> float:
        """Report the measured pose to the drive; if the robot has left its plan, end the drive and drop its offer.

        Return the time ``now``, or that of a push that was answered since, as times of a drive are in order.
        """
        with self.changing:
            now = max(now, self._pushed)
            if self.drive is None or now < self.drive.begin:
                return now
            try:
                self.drive.at(now, self._pose(pose))
            except DriveError:
                self.drive = self.prefix = self.offer = None
            return now

    def _whole(self, trajectory: Trajectory) -> Trajectory:
        """Return a part of the drive's plan, joined to the motion before this drive if there was no stop in between."""
        return trajectory if self.prefix is None else joined(self.prefix, trajectory)

    def _plan(self, now: float) -> Message:
        """Return the drive's plan as the message "plan" to the robot."""
        assert self.drive is not None
        before = 0.0 if self.prefix is None else self.prefix.duration
        plan, elapsed = self.drive.plan, before + self.drive.at(now).planned
        return plan_message(self._whole(plan), now, elapsed, arrives=plan.duration >= self.drive.announced.duration)
