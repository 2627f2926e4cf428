"""Follower of plans: from goals, poses, maps and people to velocity commands, whatever carries the messages.

The rosbridge server (:mod:`hpop.ros.follow_server`) and the node for rclpy (``examples/ros2/hpop_follower.py``) pass
messages to and from a :class:`Follower`, and call :meth:`Follower.step` at a fixed rate. Times, s, are on the caller's
clock, so a simulation may run at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from threading import RLock

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import RosError
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow
from hpop.ros.follow_drive import GoalDrive, HandOver, UnderWay
from hpop.ros.follow_plans import FollowGoal, FollowPlanner, FollowSettings, FollowStep
from hpop.ros.messages import Message, PlanarPose
from hpop.ros.observations import FilterScale, OccupancyGrid
from hpop.ros.planning import choice_of, chosen_row
from hpop.ros.protocol import LONGEST_CHOICE, Failure
from hpop.simulation.tracking import Command, DriveLimits
from hpop.world import Person

STAND = Command(0.0, 0.0)
STOPPED = 1e-3  # m/s and rad/s below which a command is to stand
SLOWEST = 0.05  # m/s, least speed limit of a mask that is kept


@checked_arguments
class Follower(GoalDrive):
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
        super().__init__(planner, settings, executor, say)
        self.limits = DriveLimits.of(planner.problem.model)
        self._lock, self._sent = RLock(), STAND

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
            self.next_try = -math.inf

    def filtered(self, mask: OccupancyGrid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter: areas to keep out of, or speed limits."""
        self.seen.filtered(mask, scale)
        with self._lock:
            self.next_try = -math.inf

    def halt(self, stopped: bool) -> None:
        """Stop the robot, or let it go again."""
        with self._lock:
            self.halted = stopped

    def follow(self, goal: str, poses: Sequence[PlanarPose], now: float, choice: str = "") -> None:
        """Drive to poses, one after another; a goal that is followed already is aborted."""
        if not poses:
            raise RosError("a goal must have at least one pose, got none")
        with self._lock:
            if self.goal is not None:
                self.end(False, "a newer goal took its place")
            self.goal = FollowGoal(goal, tuple(poses), now, choice or self.settings.choice, tried=now)
            self.next_try = self._next_offer = -math.inf
            self.say(f"goal {goal}: {len(poses)} pose{'s' * (len(poses) > 1)}")

    def cancel(self, goal: str) -> None:
        """Give up a goal; the robot brakes. RosError if there is no such goal."""
        with self._lock:
            if self.goal is None or self.goal.id != goal:
                followed = shown(self.goal.id) if self.goal else "none now"
                raise RosError(f"cancel must name the goal that the robot follows, {followed}, got {shown(goal)}")
            self.end(False, "canceled", canceled=True)

    def drop(self, why: str = "the connection was lost") -> None:
        """Give up the goal, and forget the robot's pose, its plan and the people."""
        with self._lock:
            if self.goal is not None:
                self.end(False, why)
            self.seen.forget()
            self.run = None

    def take(self, option: str, now: float) -> None:
        """Take an option: "knee", "fewest turns" or a row of the front that was last published.

        A robot that drives changes its plan at a place ahead, without a stop unless the option turns there. If there is
        no such place, it first stops, and plans again from there. While it drives, a row can be taken only from options
        that were offered on the way, until their time ``until``. Raises RosError for an option that cannot be taken.
        """
        if not isinstance(option, str) or not 0 < len(option) <= LONGEST_CHOICE:
            raise RosError(f"an option must be a name such as knee, or a row, got {shown(option)}")
        with self._lock:
            if self.goal is None:
                raise RosError("an option can be taken only while a goal is followed")
            choice = choice_of(option)
            ahead = self.ahead if self.ahead is not None and self.is_before(self.ahead[0], now) else None
            front = self.offered if ahead is None else ahead[1]
            if front is not None:
                try:
                    row = chosen_row(front, choice)
                except Failure as failure:
                    raise RosError(failure.why) from None
                self._refuse_met(ahead, row, now)
                if ahead is not None:
                    if not choice.isdecimal():
                        self.goal.choice = choice
                    self.hand_over(ahead[0], front, row)
                else:
                    self.goal.stopped = False
                    self.start(front, row, now)
                return
            if choice.isdecimal():
                raise RosError(f"row {choice} belongs to an earlier front; give a name, such as 'fewest turns'")
            self.goal.choice = choice
            if self.run is not None and not self.run.tracker.stopping:
                self.look_ahead(self.goal, self.run, now, takes=True)

    def _refuse_met(self, ahead: tuple[HandOver, Front] | None, row: NamedRow, now: float) -> None:
        """Raise RosError if the robot would meet a person along a row, as people are seen now; then plan again.

        ahead  place where the row begins, and its front; None if it begins where the robot stands
        """
        met = self.met(row.point.trajectory, 0.0, now, now) if ahead is None else self.met_ahead(ahead[0], row, now)
        if met:
            self.ahead = self.offered = None
            self.next_try = self._next_offer = -math.inf
            raise RosError(f"{met}; it is planned again: wait for new options, or give a name, such as knee")

    # The loop

    def step(self, now: float) -> FollowStep:
        """Return the command for now, and what has happened since the last step; call it 10 to 50 times a second."""
        with self._lock:
            self.take_up(now)
            command = self._drive(now)
            self._sent = command or STAND
            self.plan_again(now)
            events, self.events = tuple(self.events), []
            return FollowStep(command, events)

    def state(self, now: float) -> Message:
        """Return what the follower does and why, its goal and pose, and what remains of the plan (s, m), as JSON."""
        with self._lock:
            goal, run, pose = self.goal, self.run, self.seen.pose(now, self.settings.late)
            doing = "idle"
            if goal is not None:
                doing = "asks" if self.offered is not None else "planning" if self.job is not None else "waiting"
            time = length = late = off = 0.0
            if run is not None:
                t, tracker = max(0.0, now - run.begin), run.tracker
                doing = "stopping" if tracker.stopping else "driving"
                time = tracker.duration - tracker.clock(t)
                length = float(run.far[-1] - run.far[run.ahead.index(run.clock(now))])
                late, off = tracker.late, 0.0 if pose is None else tracker.off(t, pose[:3])
            return {
                "state": doing,
                "why": self.why,
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
        run, goal = self.run, self.goal
        if run is None:
            return STAND if goal is not None or self._sent != STAND else None
        t, pose, tracker = now - run.begin, self.seen.pose(now, self.settings.late), run.tracker
        if t < 0.0:
            return STAND
        if goal is not None:
            goal.tried = now
            self._pass_poses(goal, pose)
        if not tracker.stopping and (why := self._trouble(run, now, pose)):
            self.brake(why)
        limit = self.seen.speed_limit(pose, self.limits.speed)
        tracker.limits = replace(self.limits, speed=max(SLOWEST, min(self.limits.speed, limit)))
        command = tracker.command(t, None if pose is None else pose[:3])
        if tracker.stopping and max(map(abs, command)) < STOPPED:
            self.stood = PlanarPose(*tracker.reference(t), self.planner.known.frame_id)
            self.run = None
        elif tracker.finished(t) and goal is not None:
            self.run = None
            if pose is not None and math.dist(pose[:2], goal.poses[-1][:2]) <= self.settings.off:
                self.end(True, "reached")
            else:
                self._drop_job()  # it plans from a place ahead, and there is none any more
        return command

    def _trouble(self, run: UnderWay, now: float, pose: PlanarPose | None) -> str:
        """Return the reason why the robot must stop; "" if there is none."""
        if self.halted:
            return "told to stop"
        if self.goal is None:
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

    def _pass_poses(self, goal: FollowGoal, pose: PlanarPose | None) -> None:
        """Count the poses on the way that the robot has reached."""
        while pose is not None and goal.passed < len(goal.poses) - 1:
            if math.dist(pose[:2], goal.poses[goal.passed][:2]) > self.settings.within:
                return
            goal.passed += 1
