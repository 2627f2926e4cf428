"""Follower of plans: from goals, poses, maps and people to velocity commands, whatever carries the messages.

The rosbridge server (:mod:`hpop.ros.follow_server`) and the node for rclpy (``examples/ros2/hpop_follower.py``) pass
messages to and from a :class:`Follower`, and call :meth:`Follower.step` at a fixed rate. Times, s, are on the caller's
clock, so a simulation may run at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from threading import Event, RLock

import numpy as np

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.text import printable, shown
from hpop.errors import HpopError, RosError
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow
from hpop.ros.follow_plans import Ended, FollowGoal, FollowPlanner, FollowSettings, FollowStep, Planned
from hpop.ros.messages import Message, PlanarPose
from hpop.ros.observations import FilterScale, OccupancyGrid
from hpop.ros.paths import path_message
from hpop.ros.planning import choice_of, chosen_row, options_of
from hpop.ros.protocol import LONGEST_CHOICE, ErrorCode, Failure
from hpop.ros.sighting import Sighting, StatesAhead
from hpop.simulation.tracking import Command, DriveLimits, Tracker
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person

STAND = Command(0.0, 0.0)
STOPPED = 1e-3  # m/s and rad/s below which a command is to stand
PERMANENT = (ErrorCode.GOAL_OUTSIDE_MAP, ErrorCode.INVALID_PLANNER)  # failures that waiting does not mend
LONGEST_WAIT = 5.0  # s before leaving, for which people are predicted while planning
SLOWEST = 0.05  # m/s, least speed limit of a mask that is kept


@dataclass(eq=False)
class _UnderWay:
    """Plan under way: its tracking law, when it began, s, and its executed states (n,).

    far  (n,) m, length of the plan's path up to each state
    """

    tracker: Tracker
    begin: float
    ahead: StatesAhead
    far: FloatArray

    @classmethod
    def of(cls, trajectory: Trajectory, delay: float, begin: float) -> _UnderWay:
        """Return the plan along a trajectory, whose robot leaves at ``begin``, s, and obeys after ``delay``, s."""
        ahead = StatesAhead.of(trajectory)
        far = np.append(0.0, np.cumsum(np.hypot(np.diff(ahead.states.x), np.diff(ahead.states.y))))
        return cls(Tracker(trajectory, delay=delay), begin, ahead, far)

    def clock(self, now: float) -> float:
        """Return the time of the plan, s, at which the robot should be at ``now``, s."""
        return self.tracker.clock(max(0.0, now - self.begin))


@dataclass(eq=False)
class _Job:
    """Planning under way for a goal.

    leaves  s, time for which it is planned that the robot leaves
    over    set when the goal is no longer followed, so that planning ends
    """

    goal: FollowGoal
    future: Future[Front]
    leaves: float
    over: Event


@checked_arguments
class Follower:
    """Drives a robot to goals along plans of hpop, and stops where it must.

    It stops if the pose of the robot is lost or late, if something is within the stopping distance, if a new map closes
    the plan, if the robot is off its plan, and if it is told to. When the robot stands and the reason is gone, it plans
    again from there.

    Parameters
    ----------
    planner : plans the goals
    settings : limits and the choice among trajectories
    executor : runs the planning, in one thread
    say : called with a line of text for each event
    """

    def __init__(
        self,
        planner: FollowPlanner,
        settings: FollowSettings,
        executor: Executor,
        *,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.planner, self.settings, self.say = planner, settings, say
        self.limits = DriveLimits.of(planner.problem.model)
        self.seen = Sighting(planner)
        self._executor, self._lock = executor, RLock()
        self._halted = False
        self._goal: FollowGoal | None = None
        self._job: _Job | None = None
        self._run: _UnderWay | None = None  # until the robot stands
        self._began, self._next_try, self._took = 0.0, -math.inf, 0.5  # of planning
        self._offered: Front | None = None  # while the robot waits until an option is taken
        self._stood: PlanarPose | None = None  # place of the plan at which the robot stopped
        self._why, self._sent = "", STAND
        self._events: list[Ended | Planned] = []

    # What it is told

    def located(self, pose: PlanarPose, at: float) -> None:
        """Take the pose of the robot in the frame of the map, as it was at a time, s."""
        with self._lock:
            self.seen.located(pose, at)

    def saw(self, people: Sequence[Person], at: float) -> None:
        """Take all people who are seen, as they were at a time, s."""
        with self._lock:
            self.seen.saw(people, at)

    def mapped(self, grid: OccupancyGrid) -> None:
        """Take a map; RosError if it cannot be used."""
        self.seen.mapped(grid)
        with self._lock:
            self._next_try = -math.inf

    def filtered(self, mask: OccupancyGrid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter: areas to keep out of, or speed limits."""
        self.seen.filtered(mask, scale)
        with self._lock:
            self._next_try = -math.inf

    def halt(self, stopped: bool) -> None:
        """Stop the robot, or let it go again."""
        with self._lock:
            self._halted = stopped

    def follow(self, goal: str, poses: Sequence[PlanarPose], now: float, choice: str = "") -> None:
        """Drive to poses, one after another; a goal that is followed already is aborted."""
        if not poses:
            raise RosError("a goal must have at least one pose, got none")
        with self._lock:
            if self._goal is not None:
                self._end(False, "a newer goal took its place")
            self._goal = FollowGoal(goal, tuple(poses), now, choice or self.settings.choice, tried=now)
            self._next_try = -math.inf
            self.say(f"goal {goal}: {len(poses)} pose{'s' * (len(poses) > 1)}")

    def cancel(self, goal: str) -> None:
        """Give up a goal; the robot brakes. RosError if there is no such goal."""
        with self._lock:
            if self._goal is None or self._goal.id != goal:
                followed = shown(self._goal.id) if self._goal else "none now"
                raise RosError(f"cancel must name the goal that the robot follows, {followed}, got {shown(goal)}")
            self._end(False, "canceled", canceled=True)

    def drop(self) -> None:
        """Give up the goal and forget where the robot is, as after a lost connection."""
        with self._lock:
            if self._goal is not None:
                self._end(False, "the connection was lost")
            self.seen.forget()
            self._run = None

    def take(self, option: str, now: float) -> None:
        """Take an option: "knee", "fewest turns" or a row of the front that was last published.

        A robot that drives first stops, and plans again from there; then only a name can be taken.
        """
        if not isinstance(option, str) or not 0 < len(option) <= LONGEST_CHOICE:
            raise RosError(f"an option must be a name such as knee, or a row, got {shown(option)}")
        with self._lock:
            if self._goal is None:
                raise RosError("an option can be taken only while a goal is followed")
            choice = choice_of(option)
            if self._offered is not None:
                try:
                    row = chosen_row(self._offered, choice)
                except Failure as failure:
                    raise RosError(failure.why) from None
                self._goal.stopped = False
                self._start(self._offered, row, now)
                return
            if choice.isdecimal():
                raise RosError(f"row {choice} belongs to an earlier front; give a name, such as 'fewest turns'")
            self._goal.choice = choice
            if self._run is not None:
                self._brake("another option was taken")
                self._goal.stopped = False

    # The loop

    def step(self, now: float) -> FollowStep:
        """Return the command for now, and what has happened since the last step; call it 10 to 50 times a second."""
        with self._lock:
            self._take_up(now)
            command = self._drive(now)
            self._sent = command or STAND
            self._plan_again(now)
            events, self._events = tuple(self._events), []
            return FollowStep(command, events)

    def state(self, now: float) -> Message:
        """Return what the follower does and why, its goal and pose, and what remains of the plan (s, m), as JSON."""
        with self._lock:
            goal, run, pose = self._goal, self._run, self.seen.pose(now, self.settings.late)
            doing = "idle"
            if goal is not None:
                doing = "asks" if self._offered is not None else "planning" if self._job is not None else "waiting"
            time = length = late = off = 0.0
            if run is not None:
                t, tracker = max(0.0, now - run.begin), run.tracker
                doing = "stopping" if tracker.stopping else "driving"
                time = tracker.duration - tracker.clock(t)
                length = float(run.far[-1] - run.far[run.ahead.index(run.clock(now))])
                late, off = tracker.late, 0.0 if pose is None else tracker.off(t, pose[:3])
            return {
                "state": doing,
                "why": self._why,
                "goal": None if goal is None else goal.id,
                "pose": None if pose is None else list(pose[:3]),
                "elapsed": 0.0 if goal is None else now - goal.since,
                "remaining_time": max(0.0, time),
                "remaining_length": length,
                "late": late,
                "off": off,
                "poses_remaining": 0 if goal is None else len(goal.poses) - goal.passed,
            }

    def _drive(self, now: float) -> Command | None:
        """Return the command of the law, and let the robot brake if there is a reason to stop."""
        run, goal = self._run, self._goal
        if run is None:
            return STAND if goal is not None or self._sent != STAND else None
        t, pose, tracker = now - run.begin, self.seen.pose(now, self.settings.late), run.tracker
        if t < 0.0:
            return STAND
        if goal is not None:
            goal.tried = now
            self._pass_poses(goal, pose)
        if not tracker.stopping and (why := self._trouble(run, now, pose)):
            self._brake(why)
        limit = self.seen.speed_limit(pose, self.limits.speed)
        tracker.limits = replace(self.limits, speed=max(SLOWEST, min(self.limits.speed, limit)))
        command = tracker.command(t, None if pose is None else pose[:3])
        if tracker.stopping and max(map(abs, command)) < STOPPED:
            self._stood = PlanarPose(*tracker.reference(t), self.planner.known.frame_id)
            self._run = None
        elif tracker.finished(t) and goal is not None:
            self._run = None
            if pose is not None and math.dist(pose[:2], goal.poses[-1][:2]) <= self.settings.off:
                self._end(True, "reached")
        return command

    def _trouble(self, run: _UnderWay, now: float, pose: PlanarPose | None) -> str:
        """Return the reason why the robot must stop; "" if there is none."""
        if self._halted:
            return "told to stop"
        if self._goal is None:
            return "the goal was given up"
        if pose is None:
            return self.seen.missing(now)
        if (off := run.tracker.off(now - run.begin, pose[:3])) > self.settings.off:
            return f"{off:.2f} m off the plan"
        clock, stops = run.clock(now), self.limits.time_to_stop + self.settings.reaction
        if self.seen.meets_people(run.ahead.soon(clock, stops), pose, now, self.settings.near):
            return "a person is within the stopping distance"
        soon, later = run.ahead.blocked(self.seen, clock, stops)
        if soon:
            return "an obstacle is within the stopping distance"
        return "the map closes the plan" if later else ""

    def _brake(self, why: str) -> None:
        assert self._run is not None
        self._run.tracker.stop()
        self._why = why
        if self._goal is not None:
            self._goal.stopped = True
        self.say(f"stops: {why}")

    def _pass_poses(self, goal: FollowGoal, pose: PlanarPose | None) -> None:
        """Count the poses on the way that the robot has reached."""
        while pose is not None and goal.passed < len(goal.poses) - 1:
            if math.dist(pose[:2], goal.poses[goal.passed][:2]) > self.settings.within:
                return
            goal.passed += 1

    # Planning

    def _plan_again(self, now: float) -> None:
        """Begin to plan, if the robot stands, has a goal, and can see where it is."""
        goal = self._goal
        if goal is None or self._run is not None or self._job is not None or self._offered is not None:
            return
        if now < self._next_try:
            return
        pose = self.seen.pose(now, self.settings.late)
        if self._halted:
            self._why, goal.tried = "told to stop", now
        elif now - goal.tried > self.settings.patience:
            self._end(False, f"gave up after {now - goal.tried:.0f} s: {self._why or self.seen.missing(now)}")
        elif pose is None:
            self._why = self.seen.missing(now)
        else:
            self._plan(goal, pose, now)

    def _plan(self, goal: FollowGoal, pose: PlanarPose, now: float) -> None:
        """Begin to plan from a pose; among moving people for the time when planning is expected to have ended."""
        moving = any(person.moves for person in self.seen.people(now))
        leaves = now + min(1.5 * self._took + 0.2, LONGEST_WAIT) if moving else now
        over, worlds = Event(), (self.seen.world, self.seen.world_with_people(leaves))
        starts = [pose] if self._stood is None else [pose, self._stood]
        future = self._executor.submit(self.planner.way, goal, starts, worlds, self.settings.within, over)
        self._job, self._began = _Job(goal, future, leaves, over), now

    def _take_up(self, now: float) -> None:
        """Use the result of planning, once it has ended: drive, ask for a choice, or say why there is no way."""
        job = self._job
        if job is None or not job.future.done():
            return
        self._job, self._took = None, now - self._began
        if job.goal is not self._goal:
            return
        try:
            front = job.future.result()
            row = chosen_row(front, choice_of(job.goal.choice))
        except Failure as failure:
            self._no_way(now, failure.why, ends=failure.code in PERMANENT)
            return
        except (HpopError, ValueError, RuntimeError) as error:
            self._no_way(now, printable(f"planning failed ({type(error).__name__}: {error})"), ends=True)
            return
        job.goal.tried = now
        if self.settings.asks and job.goal.stopped:
            self._offered = front
            self._events.append(Planned(job.goal.id, None, {"goal": job.goal.id, **options_of(front, row)}))
            self.say(f"asks which of {len(front):,} trajectories to take, after: {self._why}")
        else:
            self._start(front, row, max(now, job.leaves))

    def _start(self, front: Front, row: NamedRow, begin: float) -> None:
        """Drive along a trajectory of the planned front, from a time on, s."""
        assert self._goal is not None
        trajectory = row.point.trajectory
        self._run, self._why, self._offered = _UnderWay.of(trajectory, self.settings.delay, begin), "", None
        path = path_message(trajectory, frame_id=self.planner.known.frame_id)
        self._events.append(Planned(self._goal.id, path, {"goal": self._goal.id, **options_of(front, row)}))
        self.say(f"goal {self._goal.id}: drives {row}, {self._run.tracker.duration:.1f} s")

    def _no_way(self, now: float, why: str, *, ends: bool) -> None:
        """Wait and plan again later, or end the goal."""
        self._why, self._next_try = why, now + self.settings.retry
        self.say(f"no way: {why}")
        if ends:
            self._end(False, why)

    def _end(self, reached: bool, words: str, *, canceled: bool = False) -> None:
        """End the goal; a robot that drives brakes."""
        assert self._goal is not None
        self._events.append(Ended(self._goal.id, reached, words, canceled))
        self.say(f"goal {self._goal.id}: {words}")
        if self._job is not None:
            self._job.over.set()
            self._job = None
        self._goal, self._offered, self._why = None, None, "" if reached else words
        if self._run is not None and not self._run.tracker.stopping:
            self._brake(words)
