"""Follower of plans: from goals, poses, maps and people to velocity commands, whatever carries the messages.

The rosbridge server (:mod:`hpop.ros.follow_server`) and the node for rclpy (``examples/ros2/hpop_follower.py``) pass
messages to and from a :class:`Follower`, and call :meth:`Follower.step` at a fixed rate. Times, s, are on the caller's
clock, so a simulation may run at any speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, fields, replace
from threading import RLock
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import FloatArray
from hpop.base.options import MOST, real, truth
from hpop.base.text import printable, shown
from hpop.errors import HpopError, OptionError, RosError
from hpop.motions import States
from hpop.problems.front import Front
from hpop.problems.problem import Planning
from hpop.ros.messages import Message, PlanarPose
from hpop.ros.observations import FilterScale, Grid, with_grid
from hpop.ros.paths import path_message
from hpop.ros.planning import GoalPlanner, choice_of, chosen_row, options_of
from hpop.ros.protocol import LONGEST_CHOICE, ErrorCode, Failure
from hpop.simulate.tracking import Command, DriveLimits, Tracker
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

STAND = Command(0.0, 0.0)
STOPPED = 1e-3  # m/s and rad/s below which a command is to stand
CHECKED = 0.05  # s between the poses of the plan that are checked ahead of the robot
PEOPLE_LAST = 2.0  # s for which people are predicted after their last message
PERMANENT = (ErrorCode.GOAL_OUTSIDE_MAP, ErrorCode.INVALID_PLANNER)  # failures that waiting does not mend
ABSENT = 1e5  # m: a person that far away has no effect


@checked_arguments
@dataclass(frozen=True)
class FollowSettings:
    """How a follower chooses, and when it stops.

    choice    trajectory that it takes, such as "knee" or "fewest turns"
    asks      after a stop it publishes the options and waits until one is taken, instead of taking ``choice``
    late      s     age from which a pose is too old to drive by
    off       m     distance from the plan from which the robot stops and plans again
    near      m     gap to people below which it stops
    reaction  s     time that it keeps in addition to the time in which it stops
    within    m     distance at which a pose on the way counts as visited
    delay     s     after which a command takes effect
    retry     s     between attempts to plan
    patience  s     for which it waits for a way; then the goal is aborted

    Raises OptionError for an invalid value.
    """

    choice: str = "knee"
    asks: bool = False
    late: float = 0.5
    off: float = 0.5
    near: float = 0.1
    reaction: float = 0.3
    within: float = 0.5
    delay: float = 0.0
    retry: float = 2.0
    patience: float = 60.0

    def __post_init__(self) -> None:
        for option in fields(self):
            if isinstance(option.default, float):
                most = 1.0 if option.name == "delay" else MOST
                real(option.name, getattr(self, option.name), 0, most, "a number of at least 0")
        truth("asks", self.asks)
        if not isinstance(self.choice, str) or not 0 < len(self.choice) <= LONGEST_CHOICE:
            raise OptionError(f"choice must be a name such as knee or 'fewest turns', got {shown(self.choice)}")


@dataclass(eq=False)
class FollowGoal:
    """Goal that is followed: poses to reach in this order; the last one is the goal, at the others the robot may turn.

    passed  number of poses that were reached
    since   s, when it came; ``tried`` when a way to it was last seen
    """

    id: str
    poses: tuple[PlanarPose, ...]
    since: float
    passed: int = 0
    tried: float = 0.0
    choice: str = ""


class Ended(NamedTuple):
    """End of a goal: reached, or the reason why not."""

    goal: str
    reached: bool
    words: str
    canceled: bool = False


class Planned(NamedTuple):
    """Plan of a goal: a nav_msgs/Path, and the front as JSON; the path is None while a choice is awaited."""

    goal: str
    path: Message | None
    options: Message


class Step(NamedTuple):
    """Result of a step: the command, None if the robot belongs to others, and what has happened."""

    command: Command | None
    events: tuple[Ended | Planned, ...]


class _Plan(NamedTuple):
    """Finished planning: the front, and when the robot was taken to leave, s."""

    front: Front
    leaves: float


@dataclass(eq=False)
class _Job:
    """Planning under way for a goal."""

    goal: FollowGoal
    future: Future[_Plan]
    given_up: list[bool] = field(default_factory=list)


class _GivenUpJob(Exception):
    """Signal that stops planning of a goal that is no longer followed."""


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
        planner: GoalPlanner,
        settings: FollowSettings,
        executor: Executor,
        *,
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.planner, self.settings, self.say = planner, settings, say
        self.limits = DriveLimits.of(planner.problem.model)
        self.world = planner.problem.world
        self._executor, self._lock = executor, RLock()
        self._graph_world = self.world
        self._pose: tuple[PlanarPose, float] | None = None
        self._people: tuple[tuple[Person, ...], float] | None = None
        self._grid: Grid | None = None
        self._keep_out: Grid | None = None
        self._speeds: tuple[Grid, FilterScale] | None = None
        self._halted, self._changed = False, False
        self._goal: FollowGoal | None = None
        self._job: _Job | None = None
        self._tracker: Tracker | None = None
        self._run: Trajectory | None = None  # as executed
        self._begin, self._next_try, self._took = 0.0, -math.inf, 0.5
        self._offered: Front | None = None
        self._waits = False  # until an option is taken
        self._why = ""
        self._events: list[Ended | Planned] = []

    # What it is told

    def located(self, pose: PlanarPose, at: float) -> None:
        """Take the pose of the robot in the frame of the map, as it was at a time, s."""
        with self._lock:
            self._pose = pose, at

    def mapped(self, grid: Grid) -> None:
        """Take a map; RosError if it cannot be used."""
        self._enter(grid, self._keep_out)

    def filtered(self, mask: Grid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter: areas to keep out of, or speed limits."""
        if scale.kind:
            with self._lock:
                self._speeds = mask, scale
            return
        values = np.where(mask.cells < 0, 0, scale.base + scale.multiplier * mask.cells)
        self._enter(self._grid, replace(mask, cells=np.clip(values, 0, 100).astype(np.int8)))

    def saw(self, people: Sequence[Person], at: float) -> None:
        """Take all people who are seen, as they were at a time, s."""
        with self._lock:
            self._people = tuple(people), at

    def halt(self, stopped: bool) -> None:
        """Stop the robot, or let it go again."""
        with self._lock:
            self._halted = stopped

    def follow(self, goal: str, poses: Sequence[PlanarPose], now: float, choice: str = "") -> None:
        """Drive to poses, one after another; a goal before this one is aborted."""
        if not poses:
            raise RosError("a goal must have at least one pose, got none")
        with self._lock:
            if self._goal is not None:
                self._end(False, "a newer goal took its place")
            self._goal = FollowGoal(goal, tuple(poses), now, 0, now, choice or self.settings.choice)
            self._next_try, self._waits = -math.inf, False
            self.say(f"goal {goal}: {len(poses)} pose{'s' * (len(poses) > 1)}")

    def cancel(self, goal: str) -> None:
        """Give up a goal; the robot brakes. RosError if there is no such goal."""
        with self._lock:
            if self._goal is None or self._goal.id != goal:
                raise RosError(f"cancel of {shown(goal)}, which is not being followed")
            self._end(False, "canceled", canceled=True)

    def drop(self) -> None:
        """Give up the goal and forget where the robot is, as after a lost connection."""
        with self._lock:
            if self._goal is not None:
                self._end(False, "the connection was lost")
            self._pose = self._people = self._tracker = self._run = None

    def take(self, option: str) -> None:
        """Take an option: "knee", "fewest turns" or a row of the front that was last published.

        A robot that drives first stops, and plans again from there; then only a name can be taken.
        """
        if not isinstance(option, str) or not 0 < len(option) <= LONGEST_CHOICE:
            raise RosError(f"an option must be a name such as knee, or a row, got {shown(option)}")
        with self._lock:
            if self._goal is None:
                raise RosError("an option can be taken only while a goal is followed")
            choice = choice_of(option)
            if self._waits and self._offered is not None:
                chosen_row(self._offered, choice)  # Failure if there is none
            elif choice.isdecimal():
                raise RosError(f"row {choice} belongs to an earlier front; give a name, such as 'fewest turns'")
            self._goal.choice = choice
            if self._waits:
                self._waits, self._next_try = False, -math.inf
            elif self._tracker is not None:
                self._brake("another option was taken")

    # The loop

    def step(self, now: float) -> Step:
        """Return the command for now, and what has happened since the last step; call it 10 to 50 times a second."""
        with self._lock:
            self._take_up(now)
            command = self._drive(now)
            self._plan_again(now)
            events, self._events = tuple(self._events), []
            return Step(command, events)

    def state(self, now: float) -> Message:
        """Return what the follower does, as JSON."""
        with self._lock:
            goal, tracker, pose = self._goal, self._tracker, self._fresh(now)
            doing = "idle"
            if goal is not None:
                doing = "asks" if self._waits else "planning" if self._job is not None else "waiting"
            if tracker is not None:
                doing = "stopping" if tracker.stopping else "driving"
            t = 0.0 if tracker is None else max(0.0, now - self._begin)
            remaining = 0.0 if tracker is None or self._run is None else self._length_from(tracker.clock(t))
            return {
                "state": doing,
                "why": self._why,
                "goal": None if goal is None else goal.id,
                "pose": None if pose is None else list(pose[:3]),
                "elapsed": 0.0 if goal is None else now - goal.since,
                "remaining_time": 0.0 if tracker is None else max(0.0, tracker.duration - tracker.clock(t)),
                "remaining_length": remaining,
                "late": 0.0 if tracker is None else tracker.late,
                "off": 0.0 if tracker is None or pose is None else tracker.off(t, pose[:3]),
                "poses_remaining": 0 if goal is None else len(goal.poses) - goal.passed,
            }

    def _drive(self, now: float) -> Command | None:
        """Return the command of the law, and let the robot brake if there is a reason to stop."""
        tracker, goal = self._tracker, self._goal
        if tracker is None:
            return STAND if goal is not None else None
        t, pose = now - self._begin, self._fresh(now)
        if t < 0.0:
            return STAND
        if goal is not None and pose is not None:
            self._pass_poses(goal, pose)
        if not tracker.stopping and (why := self._trouble(now, t, pose)):
            self._brake(why)
        tracker.limits = replace(self.limits, speed=max(0.05, min(self.limits.speed, self._speed_limit(pose))))
        command = tracker.command(t, None if pose is None else pose[:3])
        stands = max(map(abs, command)) < STOPPED
        if tracker.stopping and stands:
            self._tracker = self._run = None
        elif tracker.finished(t) and goal is not None:
            self._tracker = self._run = None
            if pose is not None and math.dist(pose[:2], goal.poses[-1][:2]) <= self.settings.off:
                self._end(True, "reached")
        return STAND if self._tracker is None else command

    def _trouble(self, now: float, t: float, pose: PlanarPose | None) -> str:
        """Return the reason why the robot must stop; "" if there is none."""
        assert self._tracker is not None and self._run is not None
        if self._halted:
            return "told to stop"
        if self._goal is None:
            return "the goal was given up"
        if pose is None:
            return self._lost(now)
        if (off := self._tracker.off(t, pose[:3])) > self.settings.off:
            return f"{off:.2f} m off the plan"
        clock, end = self._tracker.clock(t), self._run.duration
        stop = self._time_to_stop()
        soon = self._run.at(np.minimum(np.arange(clock, clock + stop + CHECKED, CHECKED), end))
        if self._meets(soon, pose, now):
            return "a person is within the stopping distance"
        if not self._free(soon):
            return "an obstacle is within the stopping distance"
        if self._changed:
            self._changed = False
            if not self._free(self._run.at(np.arange(clock, end, 2 * CHECKED))):
                return "the map closes the plan"
        return ""

    def _time_to_stop(self) -> float:
        """Return the time, s, in which the robot stops from its largest speeds, with the reaction time."""
        of = self.limits
        return max(of.speed / of.acceleration, of.turn_rate / of.turn_acceleration) + self.settings.reaction

    def _lost(self, now: float) -> str:
        """Return how the pose of the robot is missing, in words."""
        if self._pose is None:
            return "no pose of the robot has come"
        return f"the pose of the robot is {now - self._pose[1]:.1f} s old"

    def _brake(self, why: str) -> None:
        assert self._tracker is not None
        self._tracker.stop()
        self._why = why
        self.say(f"stops: {why}")

    def _fresh(self, now: float) -> PlanarPose | None:
        """Return the pose of the robot, if it is not too old to drive by."""
        return None if self._pose is None or now - self._pose[1] > self.settings.late else self._pose[0]

    def _free(self, states: States) -> bool:
        """Return whether no state (n,) of the robot touches an obstacle or a closed area."""
        return bool(self.planner.problem.model.collision(self.world).states_free(states).all())

    def _meets(self, soon: States, pose: PlanarPose, now: float) -> bool:
        """Return whether the robot comes nearer to a person on its plan than if it stopped, and nearer than `near`."""
        if self._people is None or now - self._people[1] > PEOPLE_LAST:
            return False
        times = np.arange(soon.size) * CHECKED
        here = self.planner.state_at(pose).take(np.zeros(soon.size, np.int64))
        parts = self.planner.problem.model.platform
        for person in (one.later(now - self._people[1]) for one in self._people[0]):
            x, y = person.x + person.velocity[0] * times, person.y + person.velocity[1] * times
            moving, standing = (_gaps(parts, states, x, y) - person.radius for states in (soon, here))
            if ((moving < self.settings.near) & (moving < standing - STOPPED)).any():
                return True
        return False

    def _speed_limit(self, pose: PlanarPose | None) -> float:
        """Return the speed limit, m/s, of the filter's mask where the robot is."""
        if self._speeds is None or pose is None:
            return math.inf
        mask, scale = self._speeds
        return scale.speed(mask.value_at(pose.x, pose.y), self.limits.speed)

    def _length_from(self, clock: float) -> float:
        """Return the length of the remaining plan, m."""
        assert self._run is not None
        states = self._run.at(np.linspace(clock, self._run.duration, 200))
        return float(np.hypot(np.diff(states.x), np.diff(states.y)).sum())

    def _pass_poses(self, goal: FollowGoal, pose: PlanarPose) -> None:
        """Count the poses on the way that the robot has reached."""
        while goal.passed < len(goal.poses) - 1:
            if math.dist(pose[:2], goal.poses[goal.passed][:2]) > self.settings.within:
                return
            goal.passed += 1

    def _enter(self, grid: Grid | None, mask: Grid | None) -> None:
        """Take the present map and keep-out mask."""
        world = with_grid(self.planner.problem.world, grid, mask)
        with self._lock:
            self._grid, self._keep_out, self.world, self._changed = grid, mask, world, True
            self._next_try = -math.inf

    # Planning

    def _plan_again(self, now: float) -> None:
        """Begin to plan, if the robot stands, has a goal, and can see where it is."""
        goal = self._goal
        if goal is None or self._tracker is not None or self._job is not None or self._waits or now < self._next_try:
            return
        pose = self._fresh(now)
        if self._halted or pose is None:
            self._why = "told to stop" if self._halted else self._lost(now)
            return
        if now - goal.tried > self.settings.patience:
            self._end(False, f"gave up after {now - goal.tried:.0f} s: {self._why}")
            return
        self._changed = False
        moving = any(person.moves for person in self._present(now))
        leaves = now + min(1.5 * self._took + 0.2, 5.0) if moving else now
        job = _Job(goal, Future())
        world, people = self.world, self._present(leaves)
        job.future = self._executor.submit(self._solve, job, pose, world, people, leaves)
        self._job, self._began = job, now

    def _present(self, at: float) -> tuple[Person, ...]:
        """Return the people, as predicted for a time, s; those of the scenario if none were ever seen."""
        own = self.planner.problem.world.content.people
        if self._people is None:
            return own
        people, seen = self._people
        now = tuple(person.later(max(0.0, at - seen)) for person in people) if at - seen <= PEOPLE_LAST + 5.0 else ()
        return now or tuple(Person(person.x + ABSENT, person.y) for person in own[:1])  # for criteria that need one

    def _solve(
        self, job: _Job, pose: PlanarPose, world: World, people: tuple[Person, ...], leaves: float
    ) -> _Plan:
        """Plan, in the executor's thread; raises Failure."""

        def progress(_: Any) -> None:
            if job.given_up:
                raise _GivenUpJob

        self._keep_graph(world)
        content, settings = world.content, self.settings
        groups = content.groups if self._people is None else ()
        world = world.with_content(people=people, groups=groups, landmarks=content.landmarks, zones=content.zones)
        *between, end = job.goal.poses[job.goal.passed :]
        stops = [{"at": pose[:2], "within": settings.within, "name": f"pose {i}"} for i, pose in enumerate(between, 1)]
        tour = {"stops": stops, "order": "given"} if stops else None
        return _Plan(self.planner.solved(pose, end, progress, world=world, tour=tour), leaves)

    def _keep_graph(self, world: World) -> None:
        """Update the planner's graph to a changed map, instead of building it anew."""
        before, self._graph_world = self._graph_world, world
        if before is not world:
            own = self.planner.problem
            for planner in self.planner.planners:
                Planning(before, own.model, own.criteria, planner, quanta=own.quanta).updated(world)

    def _take_up(self, now: float) -> None:
        """Take up finished planning: drive, ask for a choice, or say why there is no way."""
        job = self._job
        if job is None or not job.future.done():
            return
        self._job, self._took = None, now - self._began
        if job.goal is not self._goal:
            return
        try:
            plan = job.future.result()
            row = chosen_row(plan.front, choice_of(job.goal.choice))
        except Failure as failure:
            self._no_way(now, failure.why, ends=failure.code in PERMANENT)
            return
        except (HpopError, ValueError, RuntimeError) as error:
            self._no_way(now, printable(f"planning failed ({type(error).__name__}: {error})"), ends=True)
            return
        job.goal.tried = now
        options = {"goal": job.goal.id, **options_of(plan.front, row)}
        asked = self.settings.asks and bool(self._why) and self._offered is not plan.front and not self._asked
        self._offered = plan.front
        if asked:
            self._waits, self._asked = True, True
            self._events.append(Planned(job.goal.id, None, options))
            self.say(f"asks which of {len(plan.front):,} trajectories to take, after: {self._why}")
            return
        self._asked = False
        path = path_message(row.point.trajectory, frame_id=self.planner.known.frame_id)
        self._events.append(Planned(job.goal.id, path, options))
        self._start(row.point.trajectory, max(now, plan.leaves))
        self.say(f"goal {job.goal.id}: drives row {row.number} of {len(plan.front):,}, {self._tracker_seconds():.1f} s")

    _asked = False
    _began = 0.0

    def _tracker_seconds(self) -> float:
        return 0.0 if self._tracker is None else self._tracker.duration

    def _start(self, trajectory: Trajectory, begin: float) -> None:
        """Drive along a trajectory, from a time on, s."""
        self._tracker, self._begin, self._why = Tracker(trajectory, delay=self.settings.delay), begin, ""
        self._run = trajectory.execution()
        self._changed = True

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
            self._job.given_up.append(True)
            self._job = None
        self._goal, self._waits, self._why = None, False, "" if reached else words
        if self._tracker is not None and not self._tracker.stopping:
            self._brake(words)


def _gaps(parts: Sequence[Any], states: States, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the distances (n,), m, from points to the robot's outline, each in its own state; 0 within it."""
    nearest = np.full(states.size, np.inf)
    for part in parts:
        corners = part.placed(states)
        if corners.shape[1] == 1:
            apart = np.hypot(corners[:, 0, 0] - x, corners[:, 0, 1] - y)
        else:
            outlines = shapely.convex_hull(shapely.multipoints(corners))
            apart = shapely.distance(outlines, shapely.points(x, y))
        nearest = np.minimum(nearest, apart - part.radius)
    return nearest
