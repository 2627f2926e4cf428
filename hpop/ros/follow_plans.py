"""Goals of a follower, the people and map that it sees around the robot, and plans from the robot's place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from threading import Event
from typing import Any, NamedTuple

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.arrays import BoolArray, FloatArray
from hpop.base.options import MOST, real, truth
from hpop.base.text import shown
from hpop.errors import OptionError
from hpop.motions import States
from hpop.planners.base import Planner
from hpop.problems.front import Front
from hpop.problems.problem import Planning, Problem
from hpop.ros.messages import Message, PlanarPose
from hpop.ros.observations import FilterScale, OccupancyGrid, with_grid
from hpop.ros.planning import GoalPlanner
from hpop.ros.protocol import LONGEST_CHOICE, ErrorCode, Failure, Interface
from hpop.simulation.tracking import Command
from hpop.trajectories.trajectory import Trajectory
from hpop.world import Person, World

CHECKED = 0.05  # s between the poses of the plan that are checked ahead of the robot
PEOPLE_LAST = 2.0  # s after the last message of people for which the robot stops for them
SLIGHT = 1e-3  # m of change of a gap that does not count
ABSENT = 1e5  # m: a person that far away has no effect


class Sighting:
    """Latest knowledge of the robot's pose and of the world around it. Times, s, are on the caller's clock.

    planner  plans the goals, in the world of the scenario
    world    the world of the scenario, as the last map and keep-out mask show it
    """

    def __init__(self, planner: GoalPlanner) -> None:
        self.planner, self.world = planner, planner.problem.world
        self._pose: tuple[PlanarPose, float] | None = None
        self._people: tuple[tuple[Person, ...], float] | None = None
        self._grid: OccupancyGrid | None = None
        self._keep_out: OccupancyGrid | None = None
        self._speeds: tuple[OccupancyGrid, FilterScale] | None = None

    def forget(self) -> None:
        """Forget the pose and the people."""
        self._pose = self._people = None

    def located(self, pose: PlanarPose, at: float) -> None:
        """Take the pose of the robot, as it was at a time, s."""
        if self._pose is None or at >= self._pose[1]:
            self._pose = pose, at

    def saw(self, people: Sequence[Person], at: float) -> None:
        """Take all people who are seen, as they were at a time, s."""
        self._people = tuple(people), at

    def mapped(self, grid: OccupancyGrid) -> None:
        """Take a map; RosError if it cannot be used."""
        self.world = with_grid(self.planner.problem.world, grid, self._keep_out)
        self._grid = grid

    def filtered(self, mask: OccupancyGrid, scale: FilterScale) -> None:
        """Take the mask of a costmap filter: areas to keep out of, or speed limits."""
        if scale.kind:
            self._speeds = mask, scale
            return
        values = np.where(mask.cells < 0, 0, scale.base + scale.multiplier * mask.cells)
        closed = replace(mask, cells=np.clip(values, 0, 100).astype(np.int8))
        self.world = with_grid(self.planner.problem.world, self._grid, closed)
        self._keep_out = closed

    def pose(self, now: float, late: float) -> PlanarPose | None:
        """Return the pose of the robot; None if it is older than ``late``, s."""
        return None if self._pose is None or now - self._pose[1] > late else self._pose[0]

    def missing(self, now: float) -> str:
        """Return in words why there is no pose to drive by: none has come, or the last one is too old."""
        if self._pose is None:
            return "no pose of the robot has come"
        return f"the pose of the robot is {now - self._pose[1]:.1f} s old"

    def people(self, now: float, at: float) -> tuple[Person, ...]:
        """Return the people known ``now`` as predicted for the time ``at``, s; else those of the scenario.

        There are no people if the last message names none, or was sent over `PEOPLE_LAST` + 5 s ago. If the scenario
        has people, one person far away then stands for them, as a criterion may need one.
        """
        own = self.planner.problem.world.content.people
        if self._people is None:
            return own
        people, seen = self._people
        if people and now - seen <= PEOPLE_LAST + 5.0:
            return tuple(person.later(max(0.0, at - seen)) for person in people)
        return tuple(Person(person.x + ABSENT, person.y) for person in own[:1])  # for criteria that need one

    def people_here(self, now: float) -> tuple[Person, ...]:
        """Return the people of the last message, as predicted for now; none after `PEOPLE_LAST` s."""
        if self._people is None or now - self._people[1] > PEOPLE_LAST:
            return ()
        return tuple(person.later(max(0.0, now - self._people[1])) for person in self._people[0])

    def world_with_people(self, now: float, at: float) -> World:
        """Return the world with the people known ``now``, as predicted for the time ``at``, s."""
        content = self.world.content
        groups = content.groups if self._people is None else ()
        return self.world.with_content(
            people=self.people(now, at), groups=groups, landmarks=content.landmarks, zones=content.zones
        )

    def free(self, states: States) -> BoolArray:
        """Return which states (n,) of the robot touch no obstacle and no closed area."""
        return self.planner.problem.model.collision(self.world).states_free(states)

    def meets_people(self, soon: States, pose: PlanarPose, now: float, near: float) -> bool:
        """Return whether the robot would come within ``near``, m, of a person, and nearer than if it stood at ``pose``.

        ``soon`` are its planned states (n,) from now on, `CHECKED` s apart. Each person may walk on as now, or
        stop: both are checked. Without a message of people for `PEOPLE_LAST` s, the result is False.
        """
        times = CHECKED * np.arange(soon.size, dtype=np.float64)
        here = self.planner.state_at(pose).take(np.zeros(soon.size, np.int64))
        parts = self.planner.problem.model.platform
        for person in self.people_here(now):
            for vx, vy in {person.velocity, (0.0, 0.0)}:
                x, y = person.x + vx * times, person.y + vy * times
                moving, standing = (_gaps(parts, states, x, y) - person.radius for states in (soon, here))
                if ((moving < near) & (moving < standing - SLIGHT)).any():
                    return True
        return False

    def speed_limit(self, pose: PlanarPose | None, cruise: float) -> float:
        """Return the speed limit, m/s, of the filter's mask where the robot is; infinite for none.

        ``cruise`` is the robot's speed, m/s, of which limits may be a share.
        """
        if self._speeds is None or pose is None:
            return math.inf
        mask, scale = self._speeds
        return scale.speed(mask.value_at(pose.x, pose.y), cruise)


@dataclass(eq=False)
class StatesAhead:
    """Executed states (n,) of a plan, `CHECKED` s apart, that are compared with obstacles and people as last seen."""

    states: States
    _world: World | None = None
    _free: BoolArray | None = None

    @classmethod
    def of(cls, trajectory: Trajectory) -> StatesAhead:
        """Return the executed states of a trajectory."""
        run = trajectory.execution()
        return cls(run.at(np.minimum(np.arange(0.0, run.duration + CHECKED, CHECKED), run.duration)))

    def index(self, clock: float) -> int:
        """Return the index of the state at a time of the plan, s."""
        return min(max(int(clock / CHECKED), 0), self.states.size - 1)

    def end(self, clock: float, seconds: float) -> int:
        """Return the index after the states up to some seconds after a time of the plan, s."""
        return min(self.index(clock) + math.ceil(seconds / CHECKED) + 1, self.states.size)

    def soon(self, clock: float, seconds: float) -> States:
        """Return the states of the plan from a time on, for some seconds."""
        return self.states.take(np.arange(self.index(clock), self.end(clock, seconds)))

    def blocked(self, seen: Sighting, clock: float, seconds: float) -> tuple[bool, bool]:
        """Return whether an obstacle or closed area blocks the plan within some seconds from a time of it, and later.

        ``seconds`` is the time in which the robot can stop.
        """
        if self._free is None or self._world is not seen.world:  # a new map has come
            self._world = seen.world
            self._free = seen.free(self.states)
        begin, end = self.index(clock), self.end(clock, seconds)
        return not self._free[begin:end].all(), not self._free[end:].all()


def _gaps(parts: Sequence[Any], states: States, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the distances (n,), m, from n points to the robot's outline in n states; 0 or less within it."""
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


KEPT = 0.15  # m from people
SAME_PLACE = 0.05  # m that a measured pose may be off the place of the plan where the robot stopped


@checked_arguments
@dataclass(frozen=True)
class FollowSettings:
    """Choices and limits of a follower.

    choice    trajectory that it takes, such as "knee" or "fewest turns"
    asks      after a stop it publishes the options and waits until one is taken, instead of taking ``choice``
    late      s     age from which a pose is too old to drive by
    off       m     distance from the plan from which the robot stops and plans again
    near      m     gap to people below which it stops; within the stopping distance, and unless it drives away
    reaction  s     time that is added to the time in which it can stop, to look ahead at people and obstacles
    within    m     distance at which a pose on the way counts as visited
    delay     s     after which a command takes effect
    offers    s     between options that are published while the robot drives; 0 for none
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
    offers: float = 0.0
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

    since    s, when it came
    choice   trajectory to take
    passed   number of poses that were reached
    tried    s, from which patience counts: when the goal came, a plan was found, or the robot last drove or was halted
    stopped  whether the robot had to stop on the way, and no option was taken since
    """

    id: str
    poses: tuple[PlanarPose, ...]
    since: float
    choice: str
    passed: int = 0
    tried: float = 0.0
    stopped: bool = False


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


class FollowStep(NamedTuple):
    """Result of a step: the command, None if there is no goal and nothing to send, and what has happened since."""

    command: Command | None
    events: tuple[Ended | Planned, ...]


class GivenUp(Exception):
    """Signal that stops planning of a goal that is no longer followed."""


@checked_arguments
class FollowPlanner(GoalPlanner):
    """Planner of a follower's goals: its graph does not depend on the start, and is updated when the map changes.

    problem   world, model and criteria, as for :class:`GoalPlanner`
    planners  their fronts are joined
    known     names of frames
    near      m, least distance that plans keep from people, for planners with the option ``margin``; choose it larger
              than :attr:`FollowSettings.near`, or the follower stops on its own plans
    """

    def __init__(self, problem: Problem, planners: Sequence[Planner], known: Interface, *, near: float = KEPT) -> None:
        super().__init__(problem, [_keeping(planner, near).anchored() for planner in planners], known)
        self._before = problem.world

    def way(
        self, goal: FollowGoal, starts: Sequence[PlanarPose], worlds: tuple[World, World], within: float, over: Event
    ) -> Front:
        """Plan through the poses of a goal that were not reached yet, and return the front; raises Failure.

        Parameters
        ----------
        starts : the measured pose, and perhaps the place of the plan where the robot stopped, from which it is planned
            if the measured pose is a little within a wall
        worlds : the world without and with the people who are seen
        within : m, distance at which a pose on the way counts as visited
        over : set when the goal is no longer followed
        """

        def progress(_: Any) -> None:
            if over.is_set():
                raise GivenUp

        before, self._before = self._before, worlds[0]
        for planner in self.planners if before is not worlds[0] else ():
            own = self.problem
            Planning(before, own.model, own.criteria, planner, quanta=own.quanta).updated(worlds[0])
        *between, end = goal.poses[goal.passed :]
        stops = [
            {"at": pose[:2], "within": within, "name": f"pose {i}"} for i, pose in enumerate(between, goal.passed + 1)
        ]
        tour = {"stops": stops, "order": "given"} if stops else None
        measured, *others = starts
        try:
            return self.solved(measured, end, progress, world=worlds[1], tour=tour)
        except Failure as failure:
            near = [other for other in others if math.dist(measured[:2], other[:2]) <= SAME_PLACE]
            if failure.code is not ErrorCode.START_OCCUPIED or not near:
                raise
        return self.solved(near[0], end, progress, world=worlds[1], tour=tour)


def _keeping(planner: Planner, margin: float) -> Planner:
    """Return a planner that keeps a distance from people, m, or more; the planner itself if it has no such option."""
    if planner.margin >= margin or not is_dataclass(planner) or "margin" not in {each.name for each in fields(planner)}:
        return planner
    return replace(planner, margin=margin)
