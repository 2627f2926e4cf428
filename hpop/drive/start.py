"""The way in: a point of a front becomes a drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from hpop.base.arguments import checked_arguments
from hpop.base.registry import planners
from hpop.base.scalars import is_whole
from hpop.base.text import shown
from hpop.drive.adaptation import NOTICE, PATIENCE
from hpop.drive.execution import Execution
from hpop.errors import DriveError, QueryError, did_you_mean
from hpop.frontier.choices import Preferring
from hpop.frontier.strict_json import plain
from hpop.planners.base import Planner, PlannerSpec, make_planner
from hpop.planners.needs import refuse_unsupported
from hpop.problems.front import Front, Point, question_of
from hpop.problems.problem import Problem

OF_TIME = ("clock", "hold", "arrive_by", "margin")  # what a plan says among whose origins they are


@checked_arguments
def follow(
    problem: Problem,
    front: Front,
    choice: Point | int | str | Preferring,
    *,
    planner: PlannerSpec | None = None,
    begin: float = 0.0,
    patience: float = PATIENCE,
    notice: float = NOTICE,
) -> Execution:
    """Drive one of a front's plans: where the robot is, and what may be chosen instead on the way.

    Parameters
    ----------
    problem : what the front answers
    choice : a point of the front, its row, or a name it goes by, such as "knee" (:meth:`hpop.Front.named`); or a
        person (:class:`hpop.study.Preference`): then what the person prefers, on the way as well, where the robot
        chooses by itself
    planner : whose graph other ways are looked for on; else the planner that found the choice, with its options
    begin : s, when the robot leaves, on the clock by which everything is told
    patience, notice : see :class:`hpop.drive.Execution`

    Raises QueryError where the front is of another problem, DriveError for what is no point of it, for a plan that is
    not made of turns, straight moves and holds, and where no graph is known to look for others on; UnsupportedModel
    for a planner whose graph the robot cannot drive.
    """
    if not isinstance(problem, Problem):
        raise DriveError(f"follow an answer to an hpop.Problem, got {shown(problem)}")
    if not isinstance(front, Front):
        raise DriveError(f"follow a point of a front of trajectories, an hpop.Front, got {shown(front)}")
    if front.problem is not None and question_of(front.problem) != question_of(plain(problem.describe())):
        raise QueryError(
            "the front answers another problem than the one given; hpop.Problem.from_description(front.problem) is its "
            "own"
        )
    preference = choice if isinstance(choice, Preferring) else None
    point = _point(front, choice) if preference is None else front.select(preference=preference)
    made = _planner_of(point.provenance) if planner is None else make_planner(planner)
    refuse_unsupported(made, problem.model)
    given: dict[str, Any] = {"begin": begin, "patience": patience, "notice": notice, "preference": preference}
    return Execution(problem, front.trajectories, point.item, made, **given)


def _point(front: Front, choice: Any) -> Point:
    """The point that is chosen."""
    if isinstance(choice, str):
        named = front.named()
        if choice not in named:
            raise DriveError(
                f"no point of the front is called {shown(choice)}.{did_you_mean(choice, named)} Known: "
                f"{', '.join(named)}"
            )
        return named[choice]
    if isinstance(choice, Point):
        if not any(item is choice.item for item in front.items):
            raise DriveError("the choice is a point of another front")
        return choice
    if is_whole(choice) and -len(front) <= choice < len(front):
        return front[int(choice)]
    raise DriveError(f"the choice is a point of the front, or its row, 0 to {len(front) - 1}; got {shown(choice)}")


def _planner_of(origin: Mapping[str, Any]) -> Planner:
    """The planner that found a point, with the options that make its graph and those of time; no other options."""
    name = origin.get("planner")
    options: tuple[str, ...] = planners[name].graph_options if isinstance(name, str) and name in planners else ()
    if not options:
        raise DriveError(
            f"{shown(name)} has no graph on which other ways can be looked for; plan with lattice or roadmap, or in "
            "Python give one of them, planner='lattice'"
        )
    given = {option: origin[option] for option in (*options, *OF_TIME) if option in origin}
    return make_planner({cast(str, name): given})
