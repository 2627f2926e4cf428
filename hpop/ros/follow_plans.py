"""Goals of a follower, how it behaves, and planning from where the robot is in the world as it is now."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from threading import Event
from typing import Any, NamedTuple

from hpop.base.arguments import checked_arguments
from hpop.base.options import MOST, real, truth
from hpop.base.text import shown
from hpop.errors import OptionError
from hpop.planners.base import Planner
from hpop.problems.front import Front
from hpop.problems.problem import Planning, Problem
from hpop.ros.messages import Message, PlanarPose
from hpop.ros.planning import GoalPlanner
from hpop.ros.protocol import LONGEST_CHOICE, ErrorCode, Failure, Interface
from hpop.simulation.tracking import Command
from hpop.world import World

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
