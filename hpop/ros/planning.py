"""Planning of the goals of the action ComputePathToPose: from a goal message to the path of one trajectory."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from time import perf_counter
from typing import Any, cast

import numpy as np
import shapely

from hpop.base.arguments import checked_arguments
from hpop.base.text import shown
from hpop.errors import HpopError, LimitError, OptionError, QueryError, RosError, UnknownName
from hpop.frontier.points import JOINT
from hpop.motions import States
from hpop.motions.states import Values
from hpop.planners.base import Planner
from hpop.problems.front import Front
from hpop.problems.named_rows import NamedRow, named_rows
from hpop.problems.problem import Problem, TourSpec
from hpop.ros.messages import Message, PlanarPose, mapping, planar_pose
from hpop.ros.paths import MOST_POSES, path_message
from hpop.ros.protocol import LONGEST_CHOICE, ErrorCode, Failure, GoalResult, GoalStatus, Interface, failed, values_of
from hpop.runtime.limits import ProgressCallback, Status, no_path_note
from hpop.world import World

LEAST = re.compile(r"(?:least|fewest)[ _](.+)")
MOST_OPTIONS = 500  # most points of a front in a message
OF = ("x", "y", "yaw")  # states that a pose gives
CODES = {Status.NO_PATH: ErrorCode.NO_VALID_PATH, Status.TIME_LIMIT: ErrorCode.TIMEOUT}


@checked_arguments
class GoalPlanner:
    """Planner of ROS goals. It solves a problem in which start and goal are replaced by those of each ROS goal.

    problem   world, model and criteria; start and goal also give the states that no pose has, such as angles of a head
    planners  their fronts are joined
    known     names of the action, topics and frames in ROS

    Raises OptionError for a robot without a base with position and heading.
    """

    def __init__(self, problem: Problem, planners: Sequence[Planner], known: Interface) -> None:
        self.problem, self.planners, self.known = problem, tuple(planners), known
        names = problem.model.space.names
        if "base" not in problem.model.provides or not set(OF) <= set(names):
            raise OptionError(
                f"a path needs a base with the states x, y and yaw, but this robot's are {', '.join(names)}"
            )
        self.names: tuple[str, ...] = ()

    def rehearsed(self, progress: ProgressCallback | None = None) -> Front:
        """Plan once from the problem's own start to its own goal, and return the front, before the first goal arrives.

        So kernels are compiled, and errors found, before a robot waits. Raises UnknownName if the default choice is not
        "knee", a criterion (also as "fewest turns" or "least length") or a row number. Whether a front has the row is
        checked later, for each goal.
        """
        front = self.problem.solve(self.planners, progress=progress)
        self.names = front.names
        if not self._is_known(choice_of(self.known.choice)):
            raise UnknownName(f"choice must be one of {self._choices()}, got {shown(self.known.choice)}")
        return front

    def answer(self, goal: Any, robot: PlanarPose | None, progress: ProgressCallback | None = None) -> GoalResult:
        """Plan a goal, and return the result: a path, or the reason why there is none.

        Parameters
        ----------
        goal : fields of the goal, as received
        robot : pose of the robot, if known, for goals without a start
        progress : called regularly; an exception that it raises ends planning
        """
        began = perf_counter()
        try:
            asked = _checked(goal)
            choice = self._choice(asked.get("planner_id", ""))
            start, end = self._start(asked, robot), self._pose(asked.get("goal"), "the goal")
            front = self.solved(start, end, progress)
            row = chosen_row(front, choice)
            path = path_message(row.point.trajectory, frame_id=self.known.frame_id)
            if len(path["poses"]) > MOST_POSES:
                long = f"the path has {len(path['poses']):,} poses, more than {MOST_POSES:,}; give a nearer goal"
                raise Failure(ErrorCode.UNKNOWN, long)
        except Failure as failure:
            return failed(self.known, failure, perf_counter() - began)
        values = values_of(self.known, path, perf_counter() - began)
        return GoalResult(GoalStatus.SUCCEEDED, values, options_of(front, row))

    def _choice(self, planner_id: Any) -> str:
        """Return the name or row number that a planner_id chooses, see `choice_of`; Failure if it is unknown.

        An empty planner_id stands for the default choice.
        """
        if not isinstance(planner_id, str) or len(planner_id) > LONGEST_CHOICE:
            raise Failure(ErrorCode.INVALID_PLANNER, f"planner_id must be a short text, got {shown(planner_id)}")
        choice = choice_of(planner_id or self.known.choice)
        if self.names and not self._is_known(choice):
            known = self._choices()
            raise Failure(ErrorCode.INVALID_PLANNER, f"planner_id must be one of {known}, got {shown(planner_id)}")
        return choice

    def _is_known(self, choice: str) -> bool:
        """Return whether a choice is a row number (any), "knee", or a criterion of the rehearsed front."""
        return choice.isdecimal() or choice in ("knee", *self.names)

    def _choices(self) -> str:
        """Return the possible choices as text, for messages."""
        return ", ".join(["knee", *(f"least {name}" for name in self.names)]) + " or a row number"

    def _start(self, asked: Mapping[str, Any], robot: PlanarPose | None) -> PlanarPose:
        """Return the start of a goal: its own if ``use_start`` is true, else the robot's pose; Failure if unknown."""
        if asked.get("use_start") is True:
            return self._pose(asked.get("start"), "the start")
        if robot is None:
            raise Failure(
                ErrorCode.TF_ERROR,
                f"use_start is false, but no pose of the robot in {self.known.frame_id} has come from "
                f"{self.known.pose_topic}; publish it, or send a start",
            )
        return robot

    def _pose(self, message: Any, where: str) -> PlanarPose:
        """Read a pose; Failure unless it is in the frame of the map."""
        try:
            pose = planar_pose(message, where)
        except RosError as error:
            raise Failure(ErrorCode.UNKNOWN, str(error)) from None
        if pose.frame != self.known.frame_id:
            raise Failure(
                ErrorCode.TF_ERROR,
                f"{where} must be in the frame {self.known.frame_id}, because this server does not use tf; got "
                f"{shown(pose.frame)}",
            )
        return pose

    def solved(
        self,
        start: PlanarPose,
        end: PlanarPose,
        progress: ProgressCallback | None = None,
        *,
        world: World | None = None,
        tour: TourSpec = None,
    ) -> Front:
        """Solve the problem between two poses and return its front, which has points.

        Raises Failure if a pose is blocked or off the map, if planning fails, and if no path is found.

        Parameters
        ----------
        world : the present world; None for that of the problem
        tour : stops on the way
        """
        own, world = self.problem, world or self.problem.world
        whole = own.goal if isinstance(own.goal, tuple) else own.start
        begin, finish = self._state(own.start, start), self._state(whole, end)
        self._check_free(world, begin, "start", ErrorCode.START_OUTSIDE_MAP, ErrorCode.START_OCCUPIED)
        self._check_free(world, finish, "goal", ErrorCode.GOAL_OUTSIDE_MAP, ErrorCode.GOAL_OCCUPIED)
        try:
            asked: dict[str, Any] = {"quanta": own.quanta, "horizon": own.horizon, "tour": tour}
            problem = Problem(world, own.model, cast(Any, begin), finish, own.criteria, **asked)
            front = problem.solve(self.planners, progress=progress)
        except QueryError as error:  # free, but unreachable
            raise Failure(ErrorCode.NO_VALID_PATH, str(error)) from None
        except LimitError as error:
            raise Failure(ErrorCode.TIMEOUT, str(error)) from None
        except HpopError as error:
            raise Failure(ErrorCode.UNKNOWN, str(error)) from None
        except MemoryError:
            raise Failure(ErrorCode.UNKNOWN, "out of memory; take a larger step, or set max_memory") from None
        if not len(front):
            ended = [CODES.get(cast(Status, one), ErrorCode.UNKNOWN) for one in front.status.split(JOINT)]
            code = next((one for one in ended if one is not ErrorCode.NO_VALID_PATH), ErrorCode.NO_VALID_PATH)
            raise Failure(code, no_path_note(front.notes) or f"no path was found: {front.status}; {front.certificate}")
        return front

    def _state(self, whole: Values, pose: PlanarPose) -> Values:
        """Return the state ``whole`` of the robot with x, y and yaw of its base replaced by those of a pose."""
        told: dict[str, float] = dict(zip(OF, pose[:3], strict=True))
        return tuple(told.get(name, value) for name, value in zip(self.problem.model.space.names, whole, strict=True))

    def state_at(self, pose: PlanarPose) -> States:
        """Return the state (1,) of the robot at a pose; other values than x, y and yaw are those at the start."""
        return self.problem.model.space.state(self._state(self.problem.start, pose))

    def _check_free(self, world: World, values: Values, what: str, outside: ErrorCode, occupied: ErrorCode) -> None:
        """Raise Failure if the start or goal (named by ``what``) is off the map or blocked, with the case's code.

        ``values`` is a state; a value of None, which is free at the goal, is taken from the start of the problem.
        """
        own = self.problem
        space = own.model.space
        full = [own.start[i] if value is None else value for i, value in enumerate(values)]
        told = dict(zip(space.names, full, strict=True))
        if not world.extent.covers(shapely.Point(told["x"], told["y"])):
            raise Failure(outside, f"the {what} ({told['x']:g}, {told['y']:g}) is off the map")
        if why := own.model.collision(world).why_blocked(space.state(full)):
            raise Failure(occupied, f"the {what} is blocked: {why}")


def choice_of(planner_id: str) -> str:
    """Return which trajectory a planner_id chooses: "knee", the name of a criterion (for its least), or a row number.

    >>> choice_of("fewest turns"), choice_of("least_personal_space"), choice_of("knee")
    ('turns', 'personal_space', 'knee')
    """
    match = LEAST.fullmatch(planner_id.strip())
    return (match.group(1) if match else planner_id).strip().replace(" ", "_")


def options_of(front: Front, chosen: NamedRow) -> Message:
    """Describe a front for the options topic: costs of its points, named points, the chosen row, and the certificate.

    A front of more than 500 points is reduced to 500 evenly spaced ones and the named ones.
    """
    named = {name: point.index for name, point in front.named().items()}
    rows = np.unique(np.linspace(0, len(front) - 1, min(len(front), MOST_OPTIONS)).round().astype(int))
    told = sorted({*rows.tolist(), *named.values(), chosen.number})
    return {
        "names": list(front.names),
        "units": list(front.units),
        "points": len(front),
        "rows": told,
        "costs": front.costs[told].tolist(),
        "named": named,
        "chosen": chosen.number,
        "status": front.status,
        "certificate": front.certificate,
    }


def chosen_row(front: Front, choice: str) -> NamedRow:
    """Return the row of a front that a choice names; Failure if there is none."""
    try:
        (row,) = named_rows(front, [choice])
    except (OptionError, UnknownName) as error:
        raise Failure(ErrorCode.INVALID_PLANNER, str(error)) from None
    return row


def _checked(goal: Any) -> Mapping[str, Any]:
    """Return the fields of a goal; Failure if the goal is not a message with fields."""
    try:
        return mapping(goal, "the goal")
    except RosError as error:
        raise Failure(ErrorCode.UNKNOWN, str(error)) from None
